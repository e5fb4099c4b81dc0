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
    "string_type": "text in quotes is wanted",
    "dict_type": "a table is wanted, {{ key = value }}",
    "model_type": "a table is wanted, {{ key = value }}",
    "list_type": "a list is wanted, [first, second]",
    "finite_number": "a finite number is wanted, not nan or inf",
    "too_short": "it has too few values, {min_length} are wanted",
    "too_long": "it has too many values, {max_length} are wanted",
    "greater_than": "it must be greater than {gt:g}",
    "greater_than_equal": "it must be at least {ge:g}",
    "literal_error": "it must be {expected}",
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
        return f'{place(label, text, path)}: unknown key "{path[-1]}"{where}; {suggestion(str(path[-1]), known)}'
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
    rule = _RULES.get(kind, "").format(**context) if kind in _RULES else first["msg"]
    return f"{place(label, text, path)}: {dotted(path)} is {shown(seen)}; {rule}"


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
