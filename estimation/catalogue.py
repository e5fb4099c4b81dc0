"""The plants, as the command lists and prints them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from backsight.models import Model

from .model_source import compiled, load_model


def catalogue() -> dict[str, str]:
    """Name and one sentence of every plant."""
    from backsight.models.plants import PLANTS

    return {name: " ".join((plant().description or plant.__doc__ or "").split()) for name, plant in PLANTS.items()}


def description(name: str) -> str:
    """Everything about one model as text; `name` is a plant or "file.py:function"."""
    model = load_model(name, Path(), label="models")
    return (model.describe() if isinstance(model, Model) else repr(model)).rstrip("\n") + "\n"


def details(name: str) -> dict[str, Any]:
    """Signals, parameters, places and equations of one model, for other programs."""
    model = load_model(name, Path(), label="models")
    dae = compiled(model, label=f"models {name}")
    return {
        "model": dae.name,
        "description": getattr(model, "description", ""),
        "inputs": {q.name: q.unit for q in dae.inputs},
        "outputs": {q.name: q.unit for q in dae.outputs},
        "states": {q.name: q.unit for q in dae.states},
        "parameters": {p.name: {"value": p.value, "unit": p.unit, "min": p.minimum, "max": p.maximum} for p in dae.parameters},
        "places": {p.name: {"unit": p.unit, "enabled": p.enabled, "origin": p.origin} for p in (*dae.places, *dae.dormant_places)},
        "equations": [e.origin for e in dae.equations],
    }
