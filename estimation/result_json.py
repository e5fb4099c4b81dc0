"""result.json: what the command says about its results, in plain numbers and words."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from backsight.models import Dae

    from .results import OutputFit, Smoothing
    from .simulation import Simulation


def result_of_smoothing(answer: Smoothing, *, command: str) -> dict[str, Any]:
    """The content of result.json for `smooth` and `demo`."""
    return {
        "command": command,
        "model": answer.model,
        "recordings": list(answer.estimates),
        "parameters": {
            name: {"value": p.value, "std": p.std, "unit": p.unit, "fixed": p.fixed, "identifiable": p.identifiable}
            for name, p in answer.parameters.items()
        },
        "weights": {
            "W": {
                name: {"std": std} | ({"tau": answer.weights.tau[name]} if name in answer.weights.tau else {})
                for name, std in answer.weights.W.items()
            },
            "V": {name: {"std": std} for name, std in answer.weights.V.items()},
        },
        "fit": _fit(answer.fit),
        "residuals": {name: {"rms": r.rms, "unit": r.unit, "origin": r.origin} for name, r in answer.residual_places.items()},
        "solver": {
            "status": answer.solver.status,
            "converged": answer.solver.converged,
            "iterations": answer.solver.iterations,
            "seconds": answer.solver.seconds,
            "build_seconds": answer.solver.build_seconds,
            "variables": answer.solver.variables,
        },
        "notes": list(answer.notes),
        "version": version("backsight"),
        "seed": None,
    }


def result_of_simulation(answer: Simulation, dae: Dae) -> dict[str, Any]:
    """The content of result.json for `simulate`: nothing is estimated, so every parameter is fixed and has no deviation."""
    units = {p.name: p.unit for p in dae.parameters}
    return {
        "command": "simulate",
        "model": answer.model,
        "recordings": list(answer.estimates),
        "parameters": {
            name: {"value": value, "std": None, "unit": units[name], "fixed": True, "identifiable": None}
            for name, value in answer.parameters.items()
        },
        "weights": {"W": {}, "V": {}},
        "fit": _fit(answer.fit),
        "solver": {
            "status": "integrated to the end of every recording",
            "iterations": 0,
            "seconds": answer.seconds,
            "build_seconds": answer.build_seconds,
            "variables": len(dae.states) + len(dae.algebraics),
        },
        "version": version("backsight"),
        "seed": None,
    }


def _fit(fit: Mapping[str, Mapping[str, OutputFit]]) -> dict[str, Any]:
    return {
        recording: {name: {"rms": f.rms, "fit_percent": f.fit_percent, "whiteness_p": f.whiteness_p} for name, f in outputs.items()}
        for recording, outputs in fit.items()
    }
