"""A model as text: what `backsight models NAME` prints."""

from __future__ import annotations

import math
from collections.abc import Sequence

from .compiler import compile_model
from .model import Model
from .text import equations_text


def describe(model: Model) -> str:
    """Components, connections, equations with their origin, parameters, inputs, outputs and places.

    Raises ModelError for a model that cannot be compiled.
    """
    dae = compile_model(model)
    blocks = [f"{model.name}: {model.description}" if model.description else model.name]
    blocks.append(_table("components", [(name, repr(c), (type(c).__doc__ or "").split("\n")[0]) for name, c in model.components.items()]))
    blocks.append(_table("connections", [(f"{a} = {b}",) for a, b in model.connections]))
    blocks.append(
        "equations (states: "
        + (", ".join(q.name for q in dae.states) or "none")
        + (f"; algebraic: {', '.join(q.name for q in dae.algebraics)}" if dae.algebraics else "")
        + ")\n"
        + "\n".join(f"  {line}" for line in equations_text(dae).splitlines())
    )
    blocks.append(
        _table(
            "parameters",
            [
                (
                    q.name,
                    f"{q.value:g} {q.unit}",
                    _bounds(q.minimum, q.maximum),
                    q.description + (" (smoothing, no physics)" if q.smoothing else ""),
                )
                for q in dae.parameters
            ],
        )
    )
    blocks.append(_table("inputs", [(q.name, f"[{q.unit}]", model.inputs[q.name], q.description) for q in dae.inputs]))
    blocks.append(_table("outputs", [(q.name, f"[{q.unit}]", model.measured[q.name].variable, q.description) for q in dae.outputs]))
    blocks.append(
        _table(
            "places",
            [
                (q.name, f"[{q.unit}]", q.origin, "residual on" if q.enabled else "off unless asked for")
                for q in (*dae.places, *dae.dormant_places)
            ]
            + [(place, "", f"moves rigidly with {other}", "") for place, other in dae.merged_places.items()],
        )
    )
    return "\n\n".join(block for block in blocks if block)


def _bounds(low: float, high: float) -> str:
    if math.isinf(low) and math.isinf(high):
        return ""
    return f">= {low:g}" if math.isinf(high) else f"<= {high:g}" if math.isinf(low) else f"{low:g} to {high:g}"


def _table(title: str, rows: Sequence[tuple[str, ...]]) -> str:
    if not rows:
        return ""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return title + "\n" + "\n".join("  " + "  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows)
