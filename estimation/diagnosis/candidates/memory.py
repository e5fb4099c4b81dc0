"""What a lag or a delay of an input or of a sensor holds when a recording begins: anything, but of the size of that signal.

The first samples hardly tell the inner states of a delay. Were nothing known of them, a fit would fill it with whatever rids these samples
of their noise, a thousand times the signal, where nothing is straight any more.
"""

from __future__ import annotations

import numpy as np

from backsight.models.language import Component
from backsight.models.signals import Delay, Lag

from ...problem import Known, Problem
from ...recordings.outliers import screened
from .candidate import Candidate
from .edits import Alike, Insert

FASTER = 3.0  # times a state: the next one, its derivative in units of the delay (the poles of a delay of 1 s are at 4 rad/s)


def remembered(problem: Problem, candidate: Candidate) -> dict[str, Known]:
    """State of the candidate's blocks in channels -> what is known of it whenever a recording begins."""
    parts = [part for edit in candidate.edits for part in (edit.parts if isinstance(edit, Alike) else (edit,))]
    found = dict[str, Known]()
    for part in parts:
        if isinstance(part, Insert) and isinstance(part.component, Lag | Delay) and (size := _size(problem, part.place)) is not None:
            middle, half = size
            for k, state in enumerate(_states(part.component)):
                found[f"{part.name}.{state}"] = Known(0.0 if k else middle, std=half * FASTER**k, always=True)
    return found


def _states(block: Component) -> list[str]:
    """A signal and its derivatives."""
    return ["y"] if isinstance(block, Lag) else ["x_1", "x_2", "x_3"]


def _size(problem: Problem, place: str) -> tuple[float, float] | None:
    """Middle and half of the range of what was recorded of an input or a sensor; of one value that value twice, None of nothing."""
    kind, _, name = place.partition(":")
    own = [r.inputs if kind == "input" else screened(r).outputs for r in problem.recordings]
    values = np.concatenate([signals[name] for signals in own if name in signals] or [np.empty(0)])
    values = values[np.isfinite(values)]
    if not np.any(values):
        return None
    middle, half = float(values.max() + values.min()) / 2, float(np.ptp(values)) / 2
    return middle, half or abs(middle)
