"""A model as a Python file: what was put together by edits, or found by estimation, in the words in which a user would have written it."""

from __future__ import annotations

import json
import keyword
import os
import re
import sys
import textwrap
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from ..errors import ModelError
from ..language import Component, Parameter
from ..model import Model, Output

PACKAGE = __name__.partition(".models")[0] + ".models"
WIDTH = 120  # of what stands above


def python_code(model: Model, said: str = "", folder: Path | None = None) -> str:
    """A Python file with a function of the model's name that returns it: equal to this one, every number to its last digit.

    said: what stands above it. folder: where the file will stand, from where it imports classes that are not of the library, of the files
    that they were loaded from. Raises ModelError for a component of such a class without a folder, or of no file.
    """
    imported, own = defaultdict[str, set[str]](set), defaultdict[str, set[str]](set)
    noisy = any(o.noise_std is not None for o in model.measured.values())
    imported[PACKAGE] |= {"Model", *(["Output"] if noisy else []), *(["Parameter"] if model.parameters else [])}
    for name, component in model.components.items():
        if (home := _home(component)) is not None:
            imported[home].add(type(component).__name__)
        else:
            own[_file(model, name, component, folder)].add(type(component).__name__)
    lines = [f"from {module} import {', '.join(sorted(names))}" for module, names in sorted(imported.items())]
    if folder is not None and own:
        lines = ["import sys", "from pathlib import Path", "", *lines, "", *_from_files(own, folder)]
    parts = [f"name={_text(model.name)},", *([f"description={_text(model.description)},"] if model.description else [])]
    parts += _table("components", {name: _component(c) for name, c in model.components.items()})
    parts += _list("connections", [_pair(c) for c in model.connections])
    parts += _table("inputs", {name: _text(to) for name, to in model.inputs.items()})
    parts += _table("outputs", {name: _output(o) for name, o in model.measured.items()})
    parts += _table("parameters", {name: _declared(p) for name, p in model.parameters.items()})
    parts += _table("bindings", {path: _text(to) for path, to in model.bindings.items()})
    for word in ("start", "onsets", "changes"):
        parts += _table(word, {name: repr(value) for name, value in getattr(model, word).items()})
    for word in ("states", "residuals"):
        parts += _list(word, [_text(name) for name in getattr(model, word)])
    body = "\n".join(f"        {line}" for line in parts)
    above = "\n".join(textwrap.wrap(said or f"The model {model.name}.", WIDTH)).replace("\\", "\\\\").replace('"', '\\"')
    top = f'"""{above}"""\n\n'
    return top + "\n".join(lines) + f"\n\n\ndef {function_name(model.name)}() -> Model:\n    return Model(\n{body}\n    )\n"


def function_name(model: str) -> str:
    """What the function for a model of this name is called: the same, as far as it can be one."""
    name = re.sub(r"\W", "_", model) or "model"
    return f"_{name}" if name[0].isdigit() or keyword.iskeyword(name) else name


def _home(component: Component) -> str | None:
    """The shortest name of a package of the library from which the component's class is imported; None where it is of none."""
    kind = type(component)
    parts = kind.__module__.split(".")
    for count in range(PACKAGE.count(".") + 1, len(parts) + 1):
        module = ".".join(parts[:count])
        if module.startswith(PACKAGE) and getattr(sys.modules.get(module), kind.__name__, None) is kind:
            return module
    return None


def _file(model: Model, name: str, component: Component, folder: Path | None) -> str:
    """The file of a class that is not of the library, from which another file can import it."""
    kind = type(component)
    file = getattr(sys.modules.get(kind.__module__), "__file__", None)
    if folder is None or file is None or not Path(file).stem.isidentifier() or "." in kind.__qualname__:
        raise ModelError(
            f"python_code: component '{name}' of '{model.name}' is a {kind.__name__} of {kind.__module__}, which is not in the library: "
            f"a file could not import it; edit the function that makes the model by hand"
        )
    return str(file)


def _from_files(own: Mapping[str, set[str]], folder: Path) -> list[str]:
    """Imports of a user's own classes: file -> their names. By the way from the folder, so that both may move together."""
    where = sorted({os.path.relpath(Path(file).resolve().parent, folder.resolve()) for file in own})
    ways = [f"sys.path.insert(0, str((Path(__file__).parent / {_text(Path(way).as_posix())}).resolve()))" for way in where]
    return [*ways, *(f"from {Path(file).stem} import {', '.join(sorted(names))}" for file, names in sorted(own.items()))]


def _component(component: Component) -> str:
    values = ", ".join(f"{name}={float(value)!r}" for name, value in component.parameters.items())
    return f"{type(component).__name__}({values})"


def _declared(parameter: Parameter) -> str:
    """Without what is as it is by itself."""
    own = {f.name: (getattr(parameter, f.name), f.default) for f in fields(parameter)}
    return f"Parameter({', '.join(f'{name}={_value(v)}' for name, (v, usual) in own.items() if usual is MISSING or v != usual)})"


def _value(value: Any) -> str:
    infinite = isinstance(value, float) and value in (float("inf"), float("-inf"))
    return f'float("{value}")' if infinite else _text(value) if isinstance(value, str) else repr(value)


def _output(output: Output) -> str:
    return _text(output.variable) if output.noise_std is None else f"Output({_text(output.variable)}, noise_std={output.noise_std!r})"


def _pair(pair: Sequence[str]) -> str:
    return f"({_text(pair[0])}, {_text(pair[1])})"


def _text(words: str) -> str:
    return json.dumps(words, ensure_ascii=False)


def _table(word: str, values: Mapping[str, str]) -> list[str]:
    return [f"{word}={{", *(f"    {_text(name)}: {value}," for name, value in values.items()), "},"] if values else []


def _list(word: str, values: Sequence[str]) -> list[str]:
    return [f"{word}=[", *(f"    {value}," for value in values), "],"] if values else []
