"""A model as text: what `backsight models NAME` prints."""

from __future__ import annotations

import math
import shutil
import textwrap
from collections.abc import Iterable, Sequence
from typing import Any

import casadi as ca

from ..compilation.compiler import compile_model
from ..compilation.flat import connection_sets
from ..dae import Dae
from ..errors import SolveError
from ..language import Component, Signal
from ..model import Change, Model
from ..text import abbreviated, equation_text, expression_text, is_longer, wrapped
from .identifiability import Identifiability, identifiability
from .isolability import isolability

SX = Any  # casadi has no type stubs
LONGEST = 500  # characters of an equation before what it repeats gets names
NARROWEST = 60
WIDEST_CELL = 44  # of a column that is not the last
SLOW = 2.0  # seconds worth a mention


def describe(model: Model, width: int | None = None) -> str:
    """Components, connections, equations with their origin, states, parameters, signals and places, and what the outputs cannot tell.

    width  characters of a line; that of the terminal by default

    Raises ModelError for a model that cannot be compiled.
    """
    width = max(NARROWEST, width or shutil.get_terminal_size((120, 24)).columns)
    dae = compile_model(model)
    title = f"{model.name}: {model.description}" if model.description else model.name
    blocks = [textwrap.fill(title, width), *_declared(model, width), _equations(dae, width), *_quantities(model, dae, width)]
    return "\n\n".join(block for block in [*blocks, _told(dae, width), _apart(dae, width)] if block)


def _declared(model: Model, width: int) -> list[str]:
    return [
        _table("components", ((name, _kind(c), _law(type(c).__doc__)) for name, c in model.components.items()), width),
        _table("connections", ((line,) for line in _connections(model)), width),
        _table("shared parameters", ((a, f"= {b}") for a, b in model.bindings.items()), width),
        _table("onsets", ((path, f"{_when(*onset[:1], *onset[2:])}; {onset[1]:g} before") for path, onset in model.onsets.items()), width),
        _table("changes", (_changing(name, change) for name, change in model.changes.items()), width),
    ]


def _changing(name: str, change: Change) -> tuple[str, str]:
    if len(change) == 4:
        return change[0], f"+ {name} little by little, {_when(change[1])}, all of it at {change[2]:g} s, at the rate {change[3]}"
    return change[0], f"+ {name} {_when(*change[1:])}"


def _when(since: float, until: float | None = None) -> str:
    return f"from {since:g} s on" if until is None else f"from {since:g} to {until:g} s"


def _connections(model: Model) -> list[str]:
    """One line per node: flanges joined by =, signals with the output first."""
    signals = [(a, b) for a, b in model.connections if isinstance(model.end(a), Signal) or isinstance(model.end(b), Signal)]
    nodes = [" = ".join(members) for members in connection_sets(model) if not any({*pair} <= {*members} for pair in signals)]
    return nodes + [f"{a} -> {b}" for a, b in signals]


def _equations(dae: Dae, width: int) -> str:
    rows = [row for column in (dae.residual, dae.output, dae.invariants) for row in ca.vertsplit(column) if row.shape[0]]
    short, definitions, dropped = _shortened(dae, rows)
    count, outputs = len(dae.equations), len(dae.outputs)
    lines = [(f"{name} = {expression_text(value)}", "") for name, value in definitions]
    lines += [(equation_text(row), e.origin) for row, e in zip(short[:count], dae.equations, strict=True)]
    lines += [(f"{q.name} = {expression_text(y)}", "output") for q, y in zip(dae.outputs, short[count : count + outputs], strict=True)]
    lines += [(equation_text(row), "invariant: holds from the start") for row in short[count + outputs :]]
    reduced = f"index {dae.index}{', reduced' if dae.index > 1 else ''}"
    head = f"equations ({_number(len(dae.states), 'state')}, {_number(len(dae.algebraics), 'algebraic variable')}, {reduced})"
    text = "\n".join([head, *(line for text, origin in lines for line in _equation(text, origin, width))])
    if not dropped:
        return text
    return "\n".join([text, *_item(f"In the long ones terms are left out that are absent with {', '.join(dropped)} = 0.", width)])


def _shortened(dae: Dae, rows: list[SX]) -> tuple[list[SX], list[tuple[str, SX]], list[str]]:
    """Rows fit to read: long ones without what is absent (a parameter of 0), and with names for what they repeat."""
    long = [i for i, row in enumerate(rows) if is_longer(row, LONGEST)]
    if not long:
        return rows, [], []
    absent = [i for i, q in enumerate(dae.parameters) if q.value == 0.0 and not q.smoothing]
    column = ca.vertcat(*(rows[i] for i in long))
    inside = {s.name() for s in ca.symvar(column)}
    absent = [i for i in absent if dae.parameters[i].name in inside]
    if absent:
        column = ca.substitute(column, ca.vertcat(*(dae.p[i] for i in absent)), ca.SX.zeros(len(absent)))
    pieces = ca.vertsplit(column)
    named, definitions = abbreviated(pieces) if any(is_longer(piece, LONGEST) for piece in pieces) else (pieces, [])
    out = list(rows)
    for i, row in zip(long, named, strict=True):
        out[i] = row
    return out, definitions, [dae.parameters[i].name for i in absent]


def _equation(text: str, origin: str, width: int) -> list[str]:
    """An equation and, behind it or below it, where it comes from."""
    indent = at + 5 if (at := text.find(" = ")) < width // 3 else 8
    lines = wrapped("  " + text, width, indent)
    tag = f"    [{origin}]" if origin else ""
    if len(lines[-1]) + len(tag) <= width:
        return [*lines[:-1], lines[-1] + tag]
    return [*lines, " " * indent + f"[{origin}]"]


def _quantities(model: Model, dae: Dae, width: int) -> list[str]:
    outputs = model.measured
    return [
        _table("states", ((q.name, f"[{q.unit}]", f"from {q.start:g}" if q.start else "", q.description) for q in dae.states), width),
        _table("algebraic variables", ((q.name, f"[{q.unit}]", f"guess {q.start:g}", q.description) for q in dae.algebraics), width),
        _table(
            "parameters",
            (
                (
                    q.name,
                    f"{q.value:g} {'' if q.unit == '1' else q.unit}".rstrip(),
                    _bounds(q.minimum, q.maximum),
                    q.description + (" (smoothing, no physics)" if q.smoothing else ""),
                )
                for q in dae.parameters
            ),
            width,
        ),
        _table("inputs", ((q.name, f"[{q.unit}]", model.inputs[q.name], q.description) for q in dae.inputs), width),
        _table(
            "outputs",
            ((q.name, f"[{q.unit}]", outputs[q.name].variable, _noise(q.noise_std, q.unit), q.description) for q in dae.outputs),
            width,
        ),
        _table(
            "places",
            [
                (q.name, f"[{q.unit}]", q.origin, "residual on" if q.enabled else "off unless asked for")
                for q in (*dae.places, *dae.dormant_places)
            ]
            + _merged(dae),
            width,
        ),
    ]


def _merged(dae: Dae) -> list[tuple[str, str, str, str]]:
    """Bodies without a residual of their own, one row for each place that stands for some."""
    stands: dict[str, list[str]] = {}
    for place, other in dae.merged_places.items():
        stands.setdefault(other, []).append(place)
    return [("", "", f"{other} stands for" if other else "no motion of their own", ", ".join(places)) for other, places in stands.items()]


def _told(dae: Dae, width: int) -> str:
    """What the model's outputs can tell, and what was taken as known for that."""
    if not dae.outputs:
        return ""
    try:
        found = identifiability(dae)
    except SolveError as error:
        return "\n".join(["what the outputs can tell", *_item(f"not judged: {error}", width)])
    slow = f" ({found.seconds:.1f} s)" if found.seconds > SLOW else ""
    head = textwrap.fill(f"what the outputs can tell, with inputs that are known and rich enough{slow}", width)
    return "\n".join([head, *(line for sentence in judged(found) for line in _item(sentence, width))])


def _apart(dae: Dae, width: int) -> str:
    """Faults of places, inputs and outputs that no recording of these outputs can tell apart."""
    if not dae.outputs:
        return ""
    found = isolability(dae)
    lines = [f"{', '.join(names)}: one as well as another" for names in found.classes]
    lines += [f"{', '.join(found.unseen)}: not seen at all"] if found.unseen else []
    head = textwrap.fill(
        "forces and faults of any course that the outputs cannot tell apart (one that follows a law may be told all the same)", width
    )
    return "\n".join([head, *(line for sentence in lines or ["none"] for line in _item(sentence, width))])


def judged(found: Identifiability) -> list[str]:
    """The verdict on a model in sentences, with what was taken as known."""
    known = [f"taken as known: {', '.join(found.known)}"] if found.known else []
    return found.sentences() + known


def _item(text: str, width: int) -> list[str]:
    return textwrap.wrap(text, width, initial_indent="  ", subsequent_indent="    ", break_long_words=False, break_on_hyphens=False)


def _kind(component: Component) -> str:
    """Class and the parameters that are not at their defaults."""
    declared = component.declared_parameters
    values = ", ".join(f"{name}={value:g}" for name, value in component.parameters.items() if value != declared[name].default)
    return f"{type(component).__name__}({values})"


def _law(doc: str | None) -> str:
    return (doc or "").strip().split("\n")[0]


def _noise(std: float | None, unit: str) -> str:
    return "" if std is None else f"noise {std:g} {unit}".rstrip()


def _number(count: int, noun: str) -> str:
    return f"{count or 'no'} {noun}{'' if count == 1 else 's'}"


def _bounds(low: float, high: float) -> str:
    if math.isinf(low) and math.isinf(high):
        return ""
    return f">= {low:g}" if math.isinf(high) else f"<= {high:g}" if math.isinf(low) else f"{low:g} to {high:g}"


def _table(title: str, rows: Iterable[Sequence[str]], width: int) -> str:
    """Columns one under the other; the last is wrapped, and begins on a line of its own behind a cell that is wider than its column."""
    cells = [list(row) for row in rows]
    if not cells:
        return ""
    used = [i for i in range(len(cells[0])) if i == 0 or any(row[i] for row in cells)]
    cells = [[row[i] for i in used] for row in cells]
    widths = [min(max(len(row[i]) for row in cells), WIDEST_CELL) for i in range(len(used) - 1)]
    lines = [title]
    for row in cells:
        lines += _row(row, widths, width)
    return "\n".join(lines)


def _row(row: Sequence[str], widths: Sequence[int], width: int) -> list[str]:
    lines, line, start = [], "  ", 2
    for cell, room in zip(row[:-1], widths, strict=True):
        line += cell
        start += room + 2
        if len(line) > start - 2 and row[-1]:
            lines.append(line)
            line = ""
        line = line.ljust(start)
    if width - start < NARROWEST // 3:
        lines, line, start = [*lines, line.rstrip()], " " * 6, 6
    if not row[-1]:
        return [*lines, line.rstrip()]
    parts = textwrap.wrap(row[-1], max(width - start, 1), break_long_words=False, break_on_hyphens=False, drop_whitespace=True) or [""]
    return [*lines, line + parts[0], *(" " * start + part for part in parts[1:])]
