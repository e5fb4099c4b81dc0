"""A model as a Python file: what was put together by edits, or found by estimation, in the words in which a user would have written it."""

from __future__ import annotations

import json
import keyword
import re
import sys
import textwrap
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Any

from ..errors import ModelError
from ..language import Component, Parameter
from ..model import Model, Output

PACKAGE = __name__.partition(".models")[0] + ".models"
WIDTH = 120  # of what stands above


def python_code(model: Model, said: str = "") -> str:
    """A Python file with a function of the model's name that returns it: equal to this one, every number to its last digit.

    said: what stands above it. Raises ModelError for a component whose class is not of the library: such a file could not import it.
    """
    imported = defaultdict[str, set[str]](set)
    noisy = any(o.noise_std is not None for o in model.measured.values())
    imported[PACKAGE] |= {"Model", *(["Output"] if noisy else []), *(["Parameter"] if model.parameters else [])}
    for name, component in model.components.items():
        imported[_home(model, name, component)].add(type(component).__name__)
    lines = [f"from {module} import {', '.join(sorted(names))}" for module, names in sorted(imported.items())]
    parts = [f"name={_text(model.name)},", *([f"description={_text(model.description)},"] if model.description else [])]
    parts += _table("components", {name: _component(c) for name, c in model.components.items()})
    parts += _list("connections", [_pair(c) for c in model.connections])
    parts += _table("inputs", {name: _text(to) for name, to in model.inputs.items()})
    parts += _table("outputs", {name: _output(o) for name, o in model.measured.items()})
    parts += _table("parameters", {name: _declared(p) for name, p in model.parameters.items()})
    parts += _table("bindings", {path: _text(to) for path, to in model.bindings.items()})
    for word in ("start", "onsets"):
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


def _home(model: Model, name: str, component: Component) -> str:
    """The shortest name of a package of the library from which the component's class is imported."""
    kind = type(component)
    parts = kind.__module__.split(".")
    for count in range(PACKAGE.count(".") + 1, len(parts) + 1):
        module = ".".join(parts[:count])
        if module.startswith(PACKAGE) and getattr(sys.modules.get(module), kind.__name__, None) is kind:
            return module
    raise ModelError(
        f"python_code: component '{name}' of '{model.name}' is a {kind.__name__} of {kind.__module__}, which is not in the library: "
        f"a file could not import it; edit the function that makes the model by hand"
    )


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
