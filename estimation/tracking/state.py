"""An estimator's state in a file: stopped and resumed, it goes on as if it had not been stopped, to the last bit.

A numpy archive of arrays and one JSON text; nothing in it is executed. The file is replaced whole or not at all.
"""

from __future__ import annotations

import json
import zipfile
from collections import deque
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from backsight.models.errors import InputError
from backsight.ocp.moving.trajectory import Known, Trajectory

from ..problem import Free, Problem, Weights
from ..whole_files import written_whole
from .estimate import Outcome
from .estimator import Estimator
from .tuning import of_weights

VERSION = 1  # of the format


def save(estimator: Estimator, path: str | Path) -> None:
    """Write the state of an estimator to a file."""
    path, window, tuning = Path(path), estimator.window, estimator.tuning
    arrays: dict[str, Any] = {
        "x": window.here.x,
        "inner": window.here.inner,
        "p": window.here.p,
        "d": window.d,
        "newest": window.newest,
        "faith": window.faith,
        "faith_newest": window.faith_newest,
        "noise": tuning.noise,
        "corner": tuning.corner,
        "driven_times": np.array(estimator.driven.times),
        "driven_values": np.array(estimator.driven.values).reshape(len(estimator.driven.times), len(estimator.driven.last)),
        "driven_last": estimator.driven.last,
        "latency": estimator.latency.counts,
        "gone": estimator.layout.gone,
        "guess": estimator.readings.guess,
        "doubt": estimator.room.doubt,
    }
    named = {"told": window.told, "ahead": window.ahead, "before": window.before}
    named |= {f"known_{k}": known for k, known in enumerate(window.known) if known is not None}
    for name, known in named.items():
        arrays[f"{name}_Rd"], arrays[f"{name}_at"] = known.Rd, known.reference
    asked = tuning.asked
    facts = {
        "version": VERSION,
        "layout": _layout(estimator),
        "samples": estimator.samples,
        "iterations": estimator.iterations,
        "update": window.update,
        "degree": window.stage.degree,
        "knots": len(window.known),
        "passed": window.passed,
        "weights": {name: dict(getattr(asked.weights, name)) for name in ("W", "V", "tau", "kind")},
        "widths": tuning.widths,
        "force_std": {tuning.problem.dae.places[k].name: std for k, std in tuning.force_std.items()},
        "stages": tuning.stages,
        "sampling": tuning.sampling,
        "gap": tuning.gap if np.isfinite(tuning.gap) else None,
        "notes": list(tuning.notes),
        "time": estimator.newest,
        "origin": estimator.origin,
        "longest": estimator.latency.longest,
        "counts": {outcome.name: n for outcome, n in estimator.counts.items()},
        "steps": estimator.steps,
        "rows": estimator.rows,
    }
    arrays["facts"] = np.array(json.dumps(facts))
    try:
        with written_whole(path) as file:
            np.savez(file, **arrays)
    except OSError as error:
        raise InputError(f"{path}: the state cannot be written ({error.strerror or error}); choose another file") from None


def resumed(problem: Problem, path: str | Path, *, jit: bool = True) -> Estimator:
    """The estimator whose state is in a file; problem: the one that it was made for. Raises InputError where the two do not match."""
    path = Path(path)
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        facts = json.loads(str(arrays["facts"]))
        version = facts["version"]
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; a state is written by save(estimator, path) or track --state") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile):
        raise InputError(f"{path}: this is no state of an estimator; name another file, or remove it to start anew") from None
    if version != VERSION:
        raise InputError(f"{path}: its format is {version} and this is backsight's {VERSION}; remove it to start anew")
    weights = Weights(**facts["weights"])
    _same_weights(problem, weights, path)
    settled = replace(problem, weights=weights, parameters={**problem.parameters, **facts["widths"]})
    tuning = of_weights(
        settled,
        widths=facts["widths"],
        force_std=facts["force_std"],
        noise=arrays["noise"],
        corner=arrays["corner"],
        stages=facts["stages"],
        sampling=facts["sampling"],
        gap=np.inf if facts["gap"] is None else facts["gap"],
        notes=tuple(facts["notes"]),
    )
    estimator = Estimator(
        problem,
        samples=facts["samples"],
        iterations=facts["iterations"],
        update=facts["update"],
        degree=facts["degree"],
        tuning=tuning,
        jit=jit,
    )
    if _layout(estimator) != facts["layout"]:
        raise InputError(f"{path}: this state is of another model, or of other free parameters or fixed values; remove it to start anew")
    try:
        _fill(estimator, arrays, facts)
    except KeyError as missing:
        raise InputError(f"{path}: {missing} is not in this state; remove the file to start anew") from None
    return estimator


def _same_weights(problem: Problem, kept: Weights, path: Path) -> None:
    """Raise InputError where the problem gives another weight than the state was made with."""
    for table in ("W", "V"):
        for name, std in getattr(problem.weights, table).items():
            was = getattr(kept, table).get(name)
            if was is not None and abs(std / was - 1.0) > 1e-9:
                raise InputError(
                    f"{path}: this state was made with {table} of {name} = {was:g}, and now it is {std:g}; remove it to start anew"
                )


def _fill(estimator: Estimator, arrays: dict[str, Any], facts: dict[str, Any]) -> None:
    window = estimator.window

    def known(name: str) -> Known:
        return Known(Rd=arrays[f"{name}_Rd"], reference=arrays[f"{name}_at"])

    window.here = Trajectory(arrays["x"], arrays["inner"], arrays["p"])
    window.d, window.newest = arrays["d"], arrays["newest"]
    window.faith, window.faith_newest = arrays["faith"], arrays["faith_newest"]
    window.known = deque(known(f"known_{k}") if f"known_{k}_Rd" in arrays else None for k in range(facts["knots"]))
    window.told, window.ahead, window.before, window.passed = known("told"), known("ahead"), known("before"), facts["passed"]
    driven = estimator.driven
    driven.times, driven.values, driven.last = arrays["driven_times"].tolist(), list(arrays["driven_values"]), arrays["driven_last"]
    estimator.latency.counts, estimator.latency.longest = arrays["latency"], facts["longest"]
    estimator.counts = {outcome: facts["counts"].get(outcome.name, 0) for outcome in Outcome}
    estimator.steps, estimator.newest, estimator.origin = facts["steps"], facts["time"], facts["origin"]
    estimator.rows = facts["rows"]
    estimator.layout.gone, estimator.readings.guess, estimator.room.doubt = arrays["gone"], arrays["guess"], arrays["doubt"]
    estimator.read_again()
    estimator.readings.guess = arrays["guess"]


def _layout(estimator: Estimator) -> list[list[str]]:
    """The model and the order of the unknowns."""
    dae, stage = estimator.problem.dae, estimator.window.stage
    places = [dae.places[k].name for k in stage.soft]
    inputs = [q.name for q in dae.inputs]
    return [
        [dae.name],
        [q.name for q in dae.states],
        [dae.parameters[i].name for i in stage.free],
        places,
        inputs,
        [q.name for q in dae.outputs],
        [f"{name} = {value!r}" for name, value in sorted(estimator.problem.parameters.items()) if not isinstance(value, Free)],
    ]
