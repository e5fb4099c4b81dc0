"""The plants, as the command lists and prints them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from backsight.models import Dae, Model, SolveError

from ..study.model_source import compiled, load_model


def catalogue() -> dict[str, str]:
    """Name and one sentence of every plant."""
    from backsight.models.plants import PLANTS

    return {name: " ".join((plant().description or plant.__doc__ or "").split()) for name, plant in PLANTS.items()}


def description(name: str) -> str:
    """Everything about one model as text; `name` is a plant or "file.py:function"."""
    model = load_model(name, Path(), label="models")
    return (model.describe() if isinstance(model, Model) else repr(model)).rstrip("\n") + "\n"


def details(name: str) -> dict[str, Any]:
    """Components, connections, signals, parameters, places, equations and what the outputs can tell, for other programs."""
    model = load_model(name, Path(), label="models")
    dae = compiled(model, label=f"models {name}")
    declared = (
        {
            "components": {n: {"kind": type(c).__name__, "parameters": dict(c.parameters)} for n, c in model.components.items()},
            "connections": [list(pair) for pair in model.connections],
        }
        if isinstance(model, Model)
        else {}
    )
    return {
        "model": dae.name,
        "description": getattr(model, "description", ""),
        **declared,
        "inputs": {q.name: q.unit for q in dae.inputs},
        "outputs": {q.name: q.unit for q in dae.outputs},
        "noise_std": {q.name: q.noise_std for q in dae.outputs},
        "states": {q.name: q.unit for q in dae.states},
        "algebraic": {q.name: q.unit for q in dae.algebraics},
        "index": dae.index,
        "parameters": {
            p.name: {"value": p.value, "unit": p.unit, "min": p.minimum, "max": p.maximum, "smoothing": p.smoothing} for p in dae.parameters
        },
        "places": {p.name: {"unit": p.unit, "enabled": p.enabled, "origin": p.origin} for p in (*dae.places, *dae.dormant_places)},
        "equations": [e.origin for e in dae.equations],
        "identifiability": _told(dae),
    }


def _told(dae: Dae) -> dict[str, Any]:
    """Which parameters and states the outputs can tell: names, combinations and sentences; only `notes` where it cannot be judged."""
    # the listing of all plants does without it, and is quick
    from backsight.models.analysis.identifiability import identifiability

    try:
        found = identifiability(dae)
    except SolveError as error:
        return {"notes": [str(error)]}
    return {
        "identifiable": dict(found.identifiable),
        "combinations": [{"parameters": dict(d.changes), "kind": d.kind, "states": list(d.states)} for d in found.directions],
        "unobservable": list(found.unobservable),
        "entangled": list(found.entangled),
        "known": list(found.known),
        "notes": found.sentences(),
    }
