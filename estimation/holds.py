"""How inputs act between their samples, where nobody knows: held or straight, as the recordings say by the evidence of two solves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from .problem import Problem
    from .results import Smoothing

HOLDS: tuple[Literal["zero", "linear"], ...] = ("zero", "linear")
CLEAR = 3.0  # of log evidence: odds of twenty


def with_better_hold(problem: Problem, smooth: Callable[[Problem], Smoothing]) -> Smoothing:
    """The problem smoothed with the inputs of those recordings that leave it open held, then straight; the one of more evidence.

    Held where the evidence of one of them is not determined.
    """
    names = [r.name for r in problem.recordings if r.open_hold]
    if not names:
        return smooth(problem)
    held, straight = (smooth(_with_hold(problem, hold)) for hold in HOLDS)
    one, other = _evidence(held), _evidence(straight)
    if one is None or other is None:
        chosen = straight if straight.solver.converged and not held.solver.converged else held
        told = "its evidence could not be compared with that of the other"
    else:
        chosen = straight if other > one else held
        told = f"more by {abs(other - one):.3g} in log evidence than the other" + (
            "" if abs(other - one) > CLEAR else ", hardly a difference"
        )
    how = "straight from sample to sample" if chosen is straight else "held from sample to sample"
    return replace(chosen, notes=(*chosen.notes, f"Inputs of {', '.join(names)} were taken as {how}: {told}."))


def _with_hold(problem: Problem, hold: Literal["zero", "linear"]) -> Problem:
    recordings = [replace(r, hold=hold, open_hold=False) if r.open_hold else r for r in problem.recordings]
    return replace(problem, recordings=recordings)


def _evidence(result: Smoothing) -> float | None:
    return result.criteria.log_evidence if result.solver.converged and result.criteria is not None else None
