"""result.json of `diagnose`: that of smoothing with the repaired model, the verdict, its proof, and what could not have been seen."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Literal

from .result_json import result_of_smoothing

if TYPE_CHECKING:
    from pathlib import Path

    from ..diagnosis import Diagnosis, Explanation, Finding, HeldOut, Tried


def result_of_diagnosis(found: Diagnosis) -> dict[str, Any]:
    """The content of result.json for `diagnose`."""
    from ..diagnosis.answer.words import sentence

    return result_of_smoothing(found.after, command="diagnose") | {
        "verdict": found.verdict,
        "why": sentence(found),
        "findings": [_finding(f) for f in found.findings],
        "held_out": None if found.held_out is None else _held_out(found.held_out),
        "not_detectable": [
            {"place": u.place, "physics": u.physics, "parameter": u.parameter, "minimum_strength": u.strength, "unit": u.unit}
            for u in found.undetectable
        ],
        "tried": [_tried(t) for t in found.tried],
        "notes": list(dict.fromkeys((*found.notes, *found.after.notes))),
        "seconds": found.seconds,
        "seed": found.seed,
    }


def repaired_code(found: Diagnosis, folder: Path) -> tuple[str | None, list[str]]:
    """The repaired model as a Python file in a folder, for a study, a simulation or an export; and notes on why there is none.

    None where nothing that has a name was found, and where a component is of a class that no file has, so that it could not be imported.
    """
    from backsight.models.errors import ModelError
    from backsight.models.exchange import python_code

    from ..diagnosis.answer.words import repairs, sentence

    if not repairs(found):
        return None, []
    try:
        return python_code(found.model, said=sentence(found), folder=folder), []
    except ModelError as error:
        return None, [f"The repaired model was not written as code: {error}."]


def _finding(f: Finding) -> dict[str, Any]:
    from ..diagnosis.answer.words import when

    return {
        "place": f.explanation.place,
        "family": f.explanation.family,
        "physics": f.explanation.physics,
        "parameters": {name: asdict(strength) for name, strength in f.explanation.parameters.items()},
        "regime": when(f),
        "onset_s": f.onset,
        "until_s": f.until,
        "share_of_force": f.share,
        "p_value": f.p_value,
        "log_evidence_gain": f.gain,
        "alternatives": [{**_which(e), "log_evidence_gap": e.gap} for e in f.alternatives],
        "ambiguous_with": [_which(e) for e in f.rivals],
        "would_separate": f.separates or None,
        "described": f.described or None,
        "model_change": f.change,
    }


def _which(e: Explanation) -> dict[str, Any]:
    subject: dict[str, Any] = {"parameter_names": list(e.subject)} if e.subject else {}
    return {"place": e.place, "physics": e.physics} | subject | ({"changes": True} if e.changes else {})


def _tried(t: Tried) -> dict[str, Any]:
    return {**_which(t.explanation), "predicted_gain": t.predicted, "log_evidence_gain": t.fitted, "refused": t.refused or None}


def _held_out(held: HeldOut) -> dict[str, Any]:
    units = {name: errors.unit for name, errors in held.before.items()}
    return {
        "repaired": held.repaired,
        "before": _errors(held, "before"),
        "after": _errors(held, "after"),
        "improvement_percent": held.improvement_percent,
        "p_value": held.p_value,
        "attainable_percent": held.attainable_percent,
        "blocks": held.blocks,
        "recordings": list(held.recordings),
        "role": held.role,
        "units": units | {f"residual.{place}": unit for place, (_, _, unit) in held.force.items()},
    }


def _errors(held: HeldOut, side: Literal["before", "after"]) -> dict[str, dict[str, float]]:
    """Output -> horizon [s] -> rms of the prediction error; "residual.<place>" -> rms of its residual force."""
    table = held.before if side == "before" else held.after
    found = {name: {f"{span:.4g}": rms for span, rms in errors.windows.items()} for name, errors in table.items()}
    return found | {f"residual.{place}": {"rms": then if side == "after" else first} for place, (first, then, _) in held.force.items()}
