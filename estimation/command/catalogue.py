"""The plants and the components that plants are made of, as the command lists and prints them."""

from __future__ import annotations

import inspect
from importlib import import_module
from pathlib import Path
from typing import Any

from backsight.models import Component, Dae, Model, SolveError
from backsight.models.errors import suggestion

from ..study.model_source import compiled, load_model

LIBRARIES = {
    "translational": "mechanics.translational",
    "rotational": "mechanics.rotational",
    "planar": "mechanics.planar",
    "spatial": "mechanics.spatial",
    "electrical": "electrical",
    "signals": "signals",
}


Entry = tuple[str, type[Component]]  # the module that a component is imported from, and itself


def library(name: str) -> list[Entry]:
    """The components of a library, or those of that name in all of them; none where there are none."""
    if name not in LIBRARIES:
        return list(dict.fromkeys(entry for known in LIBRARIES for entry in library(known) if entry[1].__name__ == name))
    module = import_module(f"backsight.models.{LIBRARIES[name]}")
    members = [getattr(module, n) for n in module.__all__]
    return [(module.__name__, kind) for kind in members if inspect.isclass(kind) and issubclass(kind, Component)]


def meant(name: str) -> str:
    """What a name that is no plant may have been meant to be: "did you mean ...", empty where nothing is near, or it is one."""
    from backsight.models.plants import PLANTS

    if name in PLANTS or ":" in name:
        return ""
    kinds = [kind.__name__ for known in LIBRARIES for _, kind in library(known)]
    said = suggestion(name, dict.fromkeys([*PLANTS, *LIBRARIES, *kinds]))
    return said if said.startswith("did you mean") else ""


def explained(components: list[Entry]) -> str:
    """Of every component what it is, and its connectors, variables, signals and parameters."""
    return "\n".join(
        f"{kind.__name__}    from {module} import {kind.__name__}\n{_indented(inspect.cleandoc(kind.__doc__ or ''))}\n"
        for module, kind in components
    )


def declared(components: list[Entry]) -> list[dict[str, Any]]:
    """The same for other programs."""
    return [
        {
            "name": kind.__name__,
            "module": module,
            "description": inspect.cleandoc(kind.__doc__ or ""),
            "connectors": {n: type(c).__name__ for n, c in kind.declared_connectors.items()},
            "signals": {n: {"kind": type(s).__name__, "unit": s.unit} for n, s in kind.declared_signals.items()},
            "variables": {n: {"unit": v.unit, "state": v.state} for n, v in kind.declared_variables.items()},
            "parameters": {
                n: {"unit": p.unit, "default": p.default, "min": p.min, "max": p.max} for n, p in kind.declared_parameters.items()
            },
        }
        for module, kind in components
    ]


def _indented(text: str) -> str:
    return "\n".join(f"    {line}".rstrip() for line in text.splitlines())


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
