"""result.json: what the command says about its results, in plain numbers and words."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from backsight.models.augmentation.delay import delay_name
from backsight.models.augmentation.parameters import without_case
from backsight.models.errors import InputError, suggestion

if TYPE_CHECKING:
    from backsight.models import Dae

    from ..problem import Weights
    from ..results import OutputFit, Prediction, Profile, ResidualSummary, Smoothing
    from ..simulation import Simulation
    from ..tracking import Tracking
    from ..weighing import Outcome, Weighing


def result_of_smoothing(answer: Smoothing, *, command: str) -> dict[str, Any]:
    """The content of result.json for `smooth` and `demo`."""
    return {
        "command": command,
        "model": answer.model,
        "recordings": list(answer.estimates),
        "parameters": _parameters(answer),
        "correlation": {"parameters": list(answer.correlation), "matrix": answer.correlation.to_numpy().tolist()},
        "weights": _weights(answer.weights),
        "fit": _fit(answer.fit) | {name: _predicted(prediction) for name, prediction in answer.held_out.items()},
        "residuals": {name: _residual(r) for name, r in answer.residual_places.items()},
        "criteria": None if answer.criteria is None else asdict(answer.criteria),
        "profile": {name: _profile(p) for name, p in answer.profiles.items()},
        "solver": asdict(answer.solver),
        "notes": list(answer.notes),
        "version": version("backsight"),
        "seed": None,
    }


def result_of_tracking(answer: Tracking) -> dict[str, Any]:
    """The content of result.json for `track`."""
    return {
        "command": "track",
        "model": answer.model,
        "recordings": list(answer.estimates),
        "parameters": _parameters(answer),
        "weights": _weights(answer.weights),
        "fit": _fit(answer.fit),
        "horizon": {"samples": answer.samples},
        "latency_ms": answer.latency_ms,
        "failed_steps": answer.failed_steps,
        "outcomes": {outcome.word: count for outcome, count in answer.outcomes.items()},
        "solver": asdict(answer.solver),
        "notes": list(answer.notes),
        "version": version("backsight"),
        "seed": None,
    }


def result_of_weighing(found: Weighing) -> dict[str, Any]:
    """The content of result.json for `weigh`: that of smoothing with the recommended weights, the table of settings, and the reasons."""
    from ..weighing.chosen import grid

    weights = _weights(found.recommended.weights)
    drifts = {label.removeprefix("drift of "): std for label, std in found.best.weights.items() if label.startswith("drift of ")}
    weights |= {"drift": {name: {"std": std} for name, std in drifts.items()}} if drifts else {}
    for label, component in found.components.items():
        kind, name = label.split(" of ", 1)
        if name in weights.get(kind, {}):
            low, high = component.interval
            own = {"from_data": component.std, "interval": [low, high], "p_zero": component.p_zero, "unit": component.unit}
            weights[kind][name] |= own
    units = {name: p.unit for name, p in found.recommended.parameters.items()}
    factors = {name: {"factors": dict(zip(found.varied, of, strict=True))} for name, of in grid(found.varied).items()}
    return result_of_smoothing(found.recommended, command="weigh") | {
        "study": [_setting(o, units) | factors.get(o.setting.name, {}) for o in found.outcomes],
        "recommended": {**weights, "setting": found.chosen, "why": found.why},
        "influence": {
            label: {
                n: {"slope": s, **dict(zip(("tenth", "tenfold"), found.moves.get(label, {}).get(n, (None, None)), strict=True))}
                for n, s in of.items()
            }
            for label, of in found.slopes.items()
        },
        "influence_on_states": {label: dict(of) for label, of in found.state_slopes.items()},
        "notes": list(found.notes),
    }


def _setting(o: Outcome, units: Mapping[str, str]) -> dict[str, Any]:
    return {
        "name": o.setting.name,
        "group": o.setting.group,
        "factor": o.setting.factor,
        "weights": dict(o.weights),
        "converged": o.converged,
        "status": o.status,
        "iterations": o.iterations,
        "seconds": o.seconds,
        "fit": {name: {"rms": rms, "balance": balance} for name, (rms, balance) in o.misfit.items()},
        "residuals": {name: {"rms": rms, "balance": balance} for name, (rms, balance) in o.force.items()},
        "parameters": {n: {"value": value, "std": std, "unit": units.get(n, "")} for n, (value, std) in o.parameters.items()},
        "marginal": o.arrived,
        "log_evidence": o.log_likelihood,
        "held_out": o.held_out,
        "condition": o.condition,
    }


def estimated_parameters(folder: Path, dae: Dae, *, every: bool = False) -> dict[str, float]:
    """The parameters that a result.json says were estimated, of the same model; `folder` holds it.

    Those that were fixed stay what the study makes them, unless `every` one is asked for; of those that every recording has of its own it
    is the mean. Raises InputError where there are no such results.
    """
    path = folder / "result.json"
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
        model = result["model"]
        found = {str(name): float(p["value"]) for name, p in result["parameters"].items() if every or not p["fixed"]}
        found = {name: value for name, value in found.items() if not name.startswith(delay_name(""))}  # a sensor's, not the plant's
    except OSError as error:
        raise InputError(f"--estimates {folder}: {path} cannot be read ({error.strerror or error}); name a folder of results") from None
    except (ValueError, KeyError, TypeError, AttributeError):
        raise InputError(f"--estimates {folder}: {path} holds no results of smooth; smooth the study anew") from None
    if model != dae.name:
        raise InputError(f'--estimates {folder}: these are results of the model "{model}" and the study has "{dae.name}"; use one model')
    known = [p.name for p in dae.parameters]
    own = {without_case(name) for name in found if name not in known} & set(known)  # every recording's own: their mean
    for parameter in own:
        values = [found.pop(name) for name in list(found) if name.startswith(f"{parameter} [")]
        found[parameter] = sum(values) / len(values)
    for name, value in found.items():
        if name not in known:
            raise InputError(f'--estimates {folder}: {dae.name} has no parameter "{name}"; {suggestion(name, known)}')
        if not math.isfinite(value):
            raise InputError(f'--estimates {folder}: "{name}" is {value}; smooth the study anew')
    if not found:
        raise InputError(f"--estimates {folder}: nothing was estimated there; smooth a study with a parameter that has a guess")
    return found


def repaired_model(folder: Path) -> str | None:
    """The `model` of a study that takes the repaired one of a diagnosis in `folder`; None where it repaired none.

    Raises InputError where it did, and the model could not be written as code.
    """
    from backsight.models.exchange import function_name

    from ..diagnosis.answer.words import UNKNOWN

    try:
        result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
        file, name = result["repaired_model"], result["model"]
        found = [str(finding["physics"]) for finding in result["findings"]]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    if file is not None:
        return f"{(folder / file).resolve()}:{function_name(name)}"
    if any(physics != UNKNOWN for physics in found):
        raise InputError(
            f"--estimates {folder}: its repaired model has a component of a class that no file has, and was not written; "
            f"put {', '.join(found)} into the study's model and smooth that"
        )
    return None


def result_of_simulation(answer: Simulation, dae: Dae, roles: Mapping[str, str]) -> dict[str, Any]:
    """The content of result.json for `simulate`: nothing is estimated, so every parameter is fixed and has no deviation.

    roles: recording -> fit or held_out, as the study says.
    """
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
        "fit": _fit(answer.fit, roles),
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


def _parameters(answer: Smoothing | Tracking) -> dict[str, Any]:
    return {
        name: {"value": p.value, "std": p.std, "unit": p.unit, "fixed": p.fixed, "identifiable": p.identifiable}
        for name, p in answer.parameters.items()
    }


def _weights(weights: Weights) -> dict[str, Any]:
    more = (("tau", weights.tau), ("kind", weights.kind))
    return {
        "W": {name: {"std": std} | {key: table[name] for key, table in more if name in table} for name, std in weights.W.items()},
        "V": {name: {"std": std} for name, std in weights.V.items()},
    }


def _residual(r: ResidualSummary) -> dict[str, Any]:
    follows, memory = (None if found is None else asdict(found) for found in (r.follows, r.memory))
    rest = {"share": r.rest_share, "rms": r.rest_rms}
    size = {"rms": r.rms, "near_rest": rest, "unit": r.unit}
    return size | {"origin": r.origin, "whiteness_p": r.whiteness_p, "memory": memory, "follows": follows}


def _profile(p: Profile) -> dict[str, Any]:
    """Values with the cost above the optimum's; a side of the interval that is null is open."""
    return {
        "unit": p.unit,
        "value": p.estimate,
        "lower": p.lower,
        "upper": p.upper,
        "open": [side for side, end in (("lower", p.lower), ("upper", p.upper)) if end is None],
        "limited_by_bound": list(p.limited),
        "asymmetry": p.asymmetry,
        "values": p.values,
        "cost": p.cost,
    }


def _fit(fit: Mapping[str, Mapping[str, OutputFit]], roles: Mapping[str, str] | None = None) -> dict[str, Any]:
    """roles: recording -> what it is for; fitted where none are given."""
    return {
        recording: {
            name: {
                "rms": f.rms,
                "fit_percent": f.fit_percent,
                "whiteness_p": f.whiteness_p,
                "normality_p": f.normality_p,
                "effective_samples": f.effective_samples,
                "samples": f.samples,
                "prediction_rms": f.prediction_rms,
                "without_outliers": None if f.trimmed is None else asdict(f.trimmed),
                "role": roles[recording] if roles else "fit",
            }
            for name, f in outputs.items()
        }
        for recording, outputs in fit.items()
    }


def _predicted(prediction: Prediction) -> dict[str, Any]:
    """The fit of what was held out: marked, and with the error over windows."""
    (outputs,) = _fit({"": prediction.fit}, {"": "held_out"}).values()
    for name, rms in prediction.window_rms.items():
        outputs[name] |= {"window_s": prediction.window_s, "window_rms": rms}
    return dict(outputs)
