"""One sentence out of what pydantic found: file, line, the key as it was typed, the value seen, the remedy."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from pydantic import BaseModel, ValidationError

from backsight.models.errors import suggestion

from .schema import StudyFile

Path = Sequence[str | int]

_STRING_OR_COMMENT = re.compile(r'''("""|'{3}).*?\1|"(?:\\.|[^"\\\n])*"|'[^'\n]*'|#[^\n]*''', re.DOTALL)
_AFTER_A_KEY = re.compile(r"[ \t]*[=.\]]")

_RULES = {
    "float_type": "a number is wanted",
    "int_type": "a whole number (an integer) is wanted",
    "int_from_float": "a whole number (an integer) is wanted",
    "bool_type": "true or false is wanted, without quotes",
    "string_type": "text in quotes is wanted",
    "list_type": "a list is wanted, [first, second]",
    "finite_number": "a finite number is wanted, not nan or inf",
    "too_short": "it has too few values, {min_length} are wanted",
    "too_long": "it has too many values, {max_length} are wanted",
    "greater_than": "it must be greater than {gt:g}",
    "greater_than_equal": "it must be at least {ge:g}",
    "literal_error": "it must be {expected}",
}

_HOME = {  # where a key belongs that stands elsewhere
    "W": 'it stands under [weights], as in W = { "place" = { std = 0.1 } }',
    "V": 'it stands under [weights], as in V = { "output" = { std = 0.1 } }',
    "column": 'it is said of a signal, as in x = { column = "x_m" }',
    "unit": 'it is said of a column, as in x = { column = "x_mm", unit = "mm" } or time = { column = "t_ms", unit = "ms" }',
    "std": 'it is said of a column, as in x = { column = "x_m", std = 2e-6 }',
    "delay": 'it is said of a column, as in x = { column = "x_m", delay = 0.001 }',
    "loss": 'it is said of a column, as in x = { column = "x_m", loss = "auto" }',
    "limits": 'it is said of an input\'s column, as in F = { column = "F_N", limits = [-500, 500] }',
    **dict.fromkeys(("guess", "drift", "per_recording"), 'it is said of a parameter, as in "mass.m" = { guess = 1.0 } under [parameters]'),
    **dict.fromkeys(
        ("file", "role", "time", "range", "every", "hold", "clock_std", "gap", "inputs", "outputs"), "it stands under [[recording]]"
    ),
    "samples": "it stands under [horizon]",
}


def sentence(error: ValidationError, label: str, text: str) -> str:
    """The message for the first of the errors, unknown keys before missing ones (a misspelt key is both)."""
    found = sorted(error.errors(), key=lambda e: {"extra_forbidden": 0, "missing": 2}.get(e["type"], 1))
    first = found[0]
    path = [part for part in first["loc"] if not str(part).startswith("<")]
    kind, context, seen = first["type"], first.get("ctx", {}), first.get("input")
    if kind == "extra_forbidden":
        known = _known_keys(path[:-1])
        where = f" in {dotted(path[:-1])}" if len(path) > 1 else ""
        return f'{place(label, text, path)}: unknown key "{path[-1]}"{where}; {_belongs(path) or suggestion(str(path[-1]), known)}'
    if kind == "missing":
        example = {
            "model": 'model = "actuator"',
            "file": 'file = "run.csv"',
            "time": 'time = "t_s"',
            "guess": "guess = 1.0",
            "value": "value = 0.0",
        }
        remedy = f", as in {example[str(path[-1])]}" if str(path[-1]) in example else ""
        where = f" of {dotted(path[:-1])}" if len(path) > 1 else ""
        return f'{place(label, text, path[:-1])}: "{path[-1]}"{where} is missing; add it{remedy}'
    if kind == "value_error":
        return f"{place(label, text, path)}: {dotted(path)}: {context['error']}"
    rule = _special(kind, path, seen) or (_RULES[kind].format(**context) if kind in _RULES else first["msg"])
    return f"{place(label, text, path)}: {dotted(path)} is {shown(seen)}; {rule}"


def no_signal(name: str) -> str | None:
    """The remedy where what belongs to a column stands as if it were an input or output; None where that is not so."""
    return _HOME[name] if name in {*_known_keys(["outputs"]), *_known_keys(["inputs"])} else None


def _belongs(path: Path) -> str | None:
    """Where a key belongs that does not belong where it stands."""
    if path[0] == "parameters":
        own = {
            "unit": "it is that of the model, as `backsight models` shows it; leave this out",
            "value": "write guess, or a bare number to fix the parameter",
        }
        return own.get(str(path[-1]))
    return _HOME.get(str(path[-1])) if len(path) == 1 or path[0] == "recording" else None


def _special(kind: str, path: Path, seen: Any) -> str | None:
    """The rule where it depends on the key, with an example of it; None where that of the kind will do."""
    key, plain = path[-1], isinstance(seen, (int, float)) and not isinstance(seen, bool)
    name = f'"{key}"' if re.search(r"\W", str(key)) else key
    if key == "delay" and kind == "literal_error":
        known = "it must be 'estimate'"
        return f"{known} or a number of seconds" if "outputs" in path else f"{known}, for all inputs; give a known one to every output"
    if kind == "greater_than" and key == "std" and "outputs" in path:
        return "it must be greater than 0; leave it out where nobody knows it, then it is chosen from the data"
    if kind == "string_type" and path[-2:-1] in (["inputs"], ["outputs"]) and (home := no_signal(str(key))):
        return home
    if kind == "list_type" and path == ["recording"]:
        return "write [[recording]], in double brackets"
    if kind not in ("dict_type", "model_type"):
        return None
    example = "{ key = value }"
    if key in ("W", "V"):
        example = f'{key} = {{ "{"place" if key == "W" else "output"}" = {{ std = {seen if plain else 0.1} }} }}'
    elif path[:1] == ["weights"]:
        example = f"{name} = {{ std = {seen if plain else 0.1} }}"
    elif path[:1] == ["bounds"]:
        example = f"{name} = {{ min = 0.0, max = 1.0 }}"
    elif key in ("inputs", "outputs"):
        example = f'{key} = {{ x = "x_m" }}, the model\'s signal and the column of the file'
    return f"a table is wanted, as in {example}"


def place(label: str, text: str, path: Path) -> str:
    """`study.toml, line 12`, or only the file where the line cannot be found."""
    line = line_of(text, path)
    return f"{label}, line {line}" if line else label


def dotted(path: Path) -> str:
    """The keys as a user would say them: `recording 2, outputs, "x", std`."""
    words: list[str] = []
    for part in path:
        if isinstance(part, int):
            words[-1] += f" {part + 1}"
        else:
            words.append(part if not words else f'"{part}"' if re.search(r"\W", part) else part)
    return ", ".join(words) if words else "the file"


def shown(value: Any) -> str:
    """The value as it stands in the file, cut where it is long."""
    text = f'"{value}"' if isinstance(value, str) else str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def line_of(text: str, path: Path) -> int | None:
    """The line of a TOML file where the key at `path` stands; None when it is not found.

    TOML's parser keeps no positions, so the keys are looked for one after the other, each from where the last one stood.
    """
    lines = _without_values(text).splitlines()
    at, table = 0, ""
    found: int | None = None
    for part in path:
        if isinstance(part, int):
            heads = [i for i, line in enumerate(lines) if re.match(rf"\s*\[\[\s*{re.escape(table)}\s*\]\]", line)]
            if part >= len(heads):
                return found
            at = heads[part]
        else:
            table = part
            key = re.compile(rf"(?:^|[\s{{,\[.\"']){re.escape(part)}(?=[\s\"'=.\]])")
            hits = [i for i in range(at, len(lines)) if key.search(lines[i])]
            if not hits:
                return found
            at = hits[0]
        found = at + 1
    return found


def _without_values(text: str) -> str:
    """A TOML text without its comments and without strings that are no keys, every line where it was."""

    def kept(found: re.Match[str]) -> str:
        return found[0] if _AFTER_A_KEY.match(text, found.end()) else "\n" * found[0].count("\n")

    return _STRING_OR_COMMENT.sub(kept, text)


def _known_keys(path: Path) -> list[str]:
    """The keys that the table at `path` may hold."""
    from . import schema

    tables: dict[str, type[BaseModel]] = {
        "parameters": schema.FreeParameter,
        "recording": schema.RecordingTable,
        "inputs": schema.InputTable,
        "outputs": schema.OutputTable,
        "time": schema.InputTable,
        "weights": schema.WeightTable,
        "W": schema.Weight,
        "V": schema.Weight,
        "initial": schema.InitialTable,
        "bounds": schema.BoundTable,
        "horizon": schema.Horizon,
    }
    names = [str(part) for part in path if str(part) in tables]
    return list((tables[names[-1]] if names else StudyFile).model_fields)
