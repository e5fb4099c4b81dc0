"""Columns that are not what a study says: in another unit, with the other sign, exchanged with another one.

Residual forces let a smoother follow what no machine would do, but not what no machine could: outputs of bodies that are joined, one of
them in degrees or under the other's name. There it comes to rest nowhere, further from an output than that output's mean, or, at rest or
not, where the joint has run to nothing and forces do everything. Every such misreading is taken back in turn, and one with which the
model comes to rest, and explains what it did not, is told.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import TypeVar

import numpy as np

from backsight.models.augmentation.parameters import case_name
from backsight.models.dae import Quantity

from ...problem import Free, Problem, noise_names
from ...recordings.units import OTHERS, to_si
from ...results import Smoothing
from ...smoothing.explaining import EXPLAINS_NOTHING
from ...wording import quoted
from ..scores.shares import FLOOR, left_over

Array = np.ndarray[tuple[int], np.dtype[np.float64]]
Reading = Callable[[Problem], Problem]
Value = TypeVar("Value")

LOST = -100.0  # percent of fit: residuals are twice what the mean would leave
MORE = 3.0  # times the residual forces of the best reading: with as much one is none
FAR_OFF = 100.0  # times its guess, or a part of it: no reading that is right makes a parameter so
LESS = 0.1  # of the residual forces of a model that explains nothing: with more another reading explains little more


def lost(result: Smoothing) -> bool:
    """Whether a smoothing has come to rest nowhere, and explains nothing or follows an output worse than its mean would."""
    if result.solver.converged:
        return False
    fits = [f.ordinary.fit_percent for outputs in result.fit.values() for f in outputs.values()]
    return _explains_nothing(result) or any(fit is not None and not fit > LOST for fit in fits)


def idle(result: Smoothing) -> bool:
    """Whether a smoothing has come to rest where residual forces do what the model should."""
    return result.solver.converged and _explains_nothing(result)


def _explains_nothing(result: Smoothing) -> bool:
    return any(EXPLAINS_NOTHING in note for note in result.notes)


def misread(problem: Problem, result: Smoothing, smoothed: Callable[[str, Reading], Smoothing | None]) -> str:
    """What a study's columns may be, and the remedy; "" where no other reading of one or two of its outputs makes the model explain them.

    Units are left as they are where signs or an exchange explain all that matters. result: of the problem as it is. smoothed: what it is
    called, how it is read -> its smoothing, None where there is none in time.
    """
    found = dict[str, float]()
    for readings in (_mixed_up(problem), _in_other_units(problem)):
        explained = False
        for said, remedy, read in readings:
            there = smoothed(f" if {said}", read)
            if there is not None and there.solver.converged and not idle(there) and _plausible(problem, there):
                found[f"{said}: {remedy}"] = _force(there)
                explained |= max(left_over(read(problem), there).values(), default=0.0) < FLOOR
        if explained:
            break
    most = MORE * min(found.values(), default=0.0)
    if idle(result):
        most = min(most, LESS * _force(result))
    return ", or if ".join(words for words, force in found.items() if force <= most)


def _plausible(problem: Problem, result: Smoothing) -> bool:
    """Whether free parameters are somewhere near their guesses: read a million times too small friction explains any motion by itself."""
    values = {p.name: p.value for p in result.parameters.values()}
    guesses = {name: given.guess for name, given in problem.parameters.items() if isinstance(given, Free) and given.guess}
    return all(1.0 / FAR_OFF < values[name] / guess < FAR_OFF for name, guess in guesses.items() if name in values)


def _force(result: Smoothing) -> float:
    """Residual force, the geometric mean of all places that have any."""
    forces = [r.rms for r in result.residual_places.values() if r.rms > 0]
    return float(np.exp(np.mean(np.log(forces)))) if forces else 0.0


def _mixed_up(problem: Problem) -> Iterator[tuple[str, str, Reading]]:
    """What columns may be in words, what to do then, and the problem as it is then, for signs and exchanged columns."""
    outputs = _recorded(problem)
    for q in outputs:
        yield f"{q.name} has the other sign", f"negate the column of {q.name}", _changed(q.name, np.negative)
    for a, b in sorted(combinations(outputs, 2), key=lambda pair: pair[0].unit != pair[1].unit):
        yield f"the columns of {a.name} and {b.name} are exchanged", "exchange them in the study", _exchanged(a.name, b.name)


def _in_other_units(problem: Problem) -> Iterator[tuple[str, str, Reading]]:
    """The same for units."""
    for power, words in ((1.0, "{0} read as {1}"), (-1.0, "{1} read as {0}")):
        for q in _recorded(problem):
            for unit in OTHERS.get(q.unit, ()):
                times = float(to_si(np.ones(1), unit, q.unit, where=q.name)[0]) ** power
                said = f"{q.name} is {times:.4g} times what its column says, as of {words.format(quoted([unit]), quoted([q.unit]))}"
                yield said, f"mend its unit in the study at {q.name}", _changed(q.name, partial(np.multiply, times))


def _recorded(problem: Problem) -> list[Quantity]:
    return [q for q in problem.dae.outputs if any(q.name in r.outputs for r in problem.recordings)]


def _changed(name: str, change: Callable[[Array], Array]) -> Reading:
    def read(problem: Problem) -> Problem:
        recordings = [replace(r, outputs={n: change(y) if n == name else y for n, y in r.outputs.items()}) for r in problem.recordings]
        return replace(problem, recordings=recordings)

    return read


def _noise_name(output: str, recording: str | None) -> str:
    return output if recording is None else case_name(output, recording)


def _exchanged(a: str, b: str) -> Reading:
    """With all that belongs to a column: its noise, its loss, what it lags behind, its weight."""
    to = {a: b, b: a}

    def other(table: Mapping[str, Value]) -> dict[str, Value]:
        return {to.get(name, name): value for name, value in table.items()}

    def read(problem: Problem) -> Problem:
        recordings = [
            replace(
                r,
                outputs=other(r.outputs),
                output_std=other(r.output_std),
                output_loss=other(r.output_loss),
                advanced=other(r.advanced),
            )
            for r in problem.recordings
        ]
        V, whose = problem.weights.V, noise_names(problem.weights.V, problem.dae)
        turned = {_noise_name(to.get(of, of), recording): V[name] for name, (of, recording) in whose.items()}
        return replace(problem, recordings=recordings, weights=replace(problem.weights, V=turned))

    return read
