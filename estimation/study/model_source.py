"""The model a study names: a plant of the library, a function in a Python file of the user's, or a class in a Modelica file."""

from __future__ import annotations

import importlib.util
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from backsight.models import Dae, Model, compile_model
from backsight.models.errors import InputError, ModelError, suggestion


def load_model(text: str, folder: Path, *, label: str) -> Model | Dae:
    """The model behind "actuator", "file.py:function" or "file.mo:Class"; files are looked for in `folder`.

    `label` begins the messages: the study's file and line. Raises InputError; an error in the user's file is given with its line there.
    """
    if _parts(text)[0].endswith(".mo"):
        return _from_modelica(text, folder, label)
    if _parts(text)[0].endswith(".py"):
        return _from_file(text, folder, label)
    from backsight.models.plants import PLANTS

    if text not in PLANTS:
        own = 'a model of your own: "file.py:function" or "file.mo:Class"'
        raise InputError(f'{label}: model = "{text}" is no plant; {suggestion(text, PLANTS)} ({own})')
    model: Model | Dae = PLANTS[text]()
    return model


def _parts(text: str) -> tuple[str, str]:
    """File and what it holds; a folder may have a colon, too."""
    file, _, name = text.rpartition(":")
    return (text, "") if text.endswith((".py", ".mo")) else (file, name)


def compiled(model: Model | Dae, *, label: str, places: tuple[str, ...] = ()) -> Dae:
    """The model's equations, the residuals at `places` switched on; a model that is declared wrongly is an InputError."""
    if isinstance(model, Dae):
        return model
    try:
        return compile_model(model, places=places) if places else compile_model(model)
    except ModelError as error:
        raise InputError(f"{label}: {_one_line(str(error))}") from error


def _from_file(text: str, folder: Path, label: str) -> Model | Dae:
    file, function = _parts(text)
    if not function:
        raise InputError(f'{label}: model = "{text}" names no function; write "{file}:function", with the function that returns the model')
    path = folder / file
    if not path.is_file():
        files = sorted(p.name for p in path.parent.glob("*.py")) if path.parent.is_dir() else []
        remedy = suggestion(path.name, files) if files else "there is no Python file in that folder"
        raise InputError(f'{label}: model = "{text}": no file {file} in {folder.resolve()}; {remedy}')
    module = _module(path, file, label)
    maker = getattr(module, function, None)
    if not callable(maker):
        made = [name for name, value in vars(module).items() if callable(value) and getattr(value, "__module__", "") == module.__name__]
        problem = "is not a function" if hasattr(module, function) else "does not exist"
        raise InputError(
            f'{label}: model = "{text}": {function} {problem} in {file}; {suggestion(function, made) if made else "it defines no function"}'
        )
    model = _run(maker, path, file, f'{label}: model = "{text}"')
    if not isinstance(model, (Model, Dae)):
        raise InputError(
            f'{label}: model = "{text}": {function}() in {file} returned {model!r:.60} ({type(model).__name__}); it must return a Model'
        )
    return model


def _from_modelica(text: str, folder: Path, label: str) -> Model:
    file, name = _parts(text)
    from backsight.models.exchange.modelica import load_modelica

    try:
        return load_modelica(folder / file, name)
    except ModelError as error:
        raise InputError(f'{label}: model = "{text}": {_one_line(str(error))}') from error
    except InputError as error:
        raise InputError(f"{label}: {_one_line(str(error))}") from error


def _module(path: Path, file: str, label: str) -> ModuleType:
    """The user's file, run as a module of its own; the folder it stands in can be imported from while it runs."""
    name = f"backsight_study_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise InputError(f"{label}: {file} cannot be loaded as Python")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses and pickles look their module up
    quiet, sys.dont_write_bytecode = sys.dont_write_bytecode, True  # nothing is written beside the user's file
    sys.path.insert(0, str(path.parent.resolve()))
    loader = spec.loader
    try:
        _run(lambda: loader.exec_module(module), path, file, label)
    finally:
        sys.path.remove(str(path.parent.resolve()))
        sys.dont_write_bytecode = quiet
    return module


def _run(call: Callable[[], Any], path: Path, file: str, label: str) -> Any:
    """Call the user's code; whatever it raises becomes an InputError with the line of the user's file."""
    try:
        return call()
    except SyntaxError as error:
        raise InputError(f"{label}: {file}, line {error.lineno}: {error.msg}") from error
    except (KeyboardInterrupt, MemoryError):
        raise
    except (Exception, SystemExit) as error:
        own = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if Path(frame.filename) == path]
        where = f"{file}, line {own[-1]}" if own else file
        raise InputError(f"{label}: {where}: {type(error).__name__}: {_one_line(str(error))}") from error


def _one_line(text: str) -> str:
    return " ".join(text.split())
