"""Do the weights agree with what the fit leaves over? Of right ones a family of rows r, of leverage l, keeps

    E sum r^2 = sum (1 - l) = f,        var sum r^2 <= 2 f,

for the residuals of linear least squares are M e with a projection M, 1 - l its diagonal, and sum_j M_ij^2 = M_ii. So f is how many of its
rows the data tell.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from backsight.ocp import Solution

from ..problem import Problem
from ..supposed import INPUT, PARAMETER
from ..wording import listed
from .rest import near_rest
from .robust import row_squares

if TYPE_CHECKING:
    from .outcome import Run

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

FLOOR = 0.5  # sum r^2 over f, 1 where W settled; below, far beyond the iteration's own tolerance, W could go no lower
TOLD = 8.0  # values that tell W: with fewer W^2 is within two of its own deviations of zero
OFF = 1.25  # times what a weight allows is worth a word,
SURE = 5.0  # where that is as many deviations of the sum of squares
MISLEAD = "Values and deviations mislead."
SHARPER = 2.0  # the noise that the samples show over the one that was given: what is wrong there is not the model
COLOURED = 2.0  # times the noise that the samples' differences show: three quarters of the variance are something else


def nothing_there(problem: Problem, run: Run) -> set[str]:
    """Places whose W from the data ended at its floor, and not where the data want it.

    A fixed point of `variances.py` has sum r^2 = f, and its W^2 a deviation of sqrt(2/f) of itself. The intervals near rest, which have
    more room, do not count.
    """
    solution, found = run.choice.solution, set[str]()
    t = solution.transcription
    if not t.soft or solution.curvature is None or not run.choice.settled:
        return found
    for i, k in enumerate(t.soft):
        place = t.dae.places[k]
        if place in problem.dae.places and place.name not in problem.weights.W:
            squares, f = force_squares(solution, i)
            if squares < FLOOR * f or f < TOLD:
                found.add(place.name)
    return found


def too_sharp(problem: Problem, run: Run, noise: Array) -> dict[tuple[str, str], str]:
    """Recording and output -> a sentence, where the V that was given is less than what its samples show of noise, (H, ny)."""
    return {
        where: (
            f"{which} is given as {std:.3g} {unit}, and its samples have noise of {shown:.2g} {unit}, by how they alternate or by their "
            f"steps. What is more than V allows then passes for forces, or for what the model lacks. {MISLEAD} Give it about that, or "
            "leave it out."
        )
        for where, which, unit, std, shown, given in _below_samples(problem, run, noise)
        if given
    }


def far_below(problem: Problem, run: Run, noise: Array) -> dict[tuple[str, str], str]:
    """Recording and output -> a sentence, where V came out far below what its samples show: they may be the answer to an input."""
    return {
        where: (
            f"{which} came out as {std:.3g} {unit}, {shown / std:.2g} times less than how its samples alternate or step. That may be what "
            "an input that steps at every sample does; if none does, the model contradicts this sensor, or another one: give V."
        )
        for where, which, unit, std, shown, given in _below_samples(problem, run, noise)
        if not given
    }


def _below_samples(problem: Problem, run: Run, noise: Array) -> Iterable[tuple[tuple[str, str], str, str, float, float, bool]]:
    """Where V is less than what samples show, (H, ny): recording and output, V in words, its unit, both sizes, and whether V was given."""
    several = len({piece.name for piece in problem.fitted}) > 1
    for i, (q, shown) in enumerate(zip(run.choice.solution.transcription.dae.outputs, noise.T, strict=True)):
        for h, (piece, table) in enumerate(zip(problem.fitted, run.stds, strict=True)):
            if q.name in table and shown[h] > SHARPER * (std := run.noise(h, q.name, i)):
                which = f"V of {q.name}{f' of {piece.name}' if several else ''}"
                yield (piece.name, q.name), which, q.unit, std, float(shown[h]), q.name not in run.open_outputs[h]


def contradictions(problem: Problem, run: Run, shown: Array) -> list[str]:
    """A sentence for every weight that was given and is exceeded by what it weighs, and for noises from the data that are no noise.

    shown (H, ny): the noise that differences of the samples show; what these are rounded to says nothing of how much more it is.
    """
    solution = run.choice.solution
    t, found = solution.transcription, list[str]()
    if solution.curvature is None:
        return found
    for i, k in enumerate(t.soft):
        place = t.dae.places[k]
        ours = place not in problem.dae.places or place.name in problem.weights.W
        if ours and (times := _excess(*force_squares(solution, i))):
            found.append(f"{_exceeded(place.name, times)}: that contradicts the data, or the model lacks something there. {MISLEAD}")
    for i, q in enumerate(t.dae.outputs):
        with_it = [h for h, table in enumerate(run.stds) if q.name in table]
        given = [h for h in with_it if q.name not in run.open_outputs[h]]
        times = _excess(*output_squares(solution, i, given))
        if times:
            found.append(
                f"{q.name}: measured minus smoothed is {times:.2g} times what V of {q.name} allows: that contradicts the data, or W "
                f"leaves too little room. {MISLEAD}"
            )
        noise = max((run.noise(h, q.name, i) / shown[h, i] for h in with_it if h not in given and shown[h, i] > 0), default=0.0)
        if noise > COLOURED:
            held = [p.name for p in problem.dae.places if p.name in problem.weights.W]
            what = f"W of {listed(held)} leaves too little room for it" if held else "of the sensor, of its time stamps, or of the model"
            found.append(
                f"V of {q.name} is {noise:.2g} times the noise that differences of its samples show: most of what the fit leaves over is "
                f"something else, {'and ' if held else ''}{what}. {MISLEAD}"
            )
    return found


def loose_weights(problem: Problem, run: Run) -> list[str]:
    """A sentence for every W that was given and allows far more than there is."""
    solution = run.choice.solution
    t, found = solution.transcription, list[str]()
    for i, k in enumerate(t.soft if solution.curvature is not None else ()):
        place = t.dae.places[k]
        given = place in problem.dae.places and place.name in problem.weights.W
        if given and (times := _wanting(*force_squares(solution, i))):
            found.append(f"W of {place.name} allows at least {times:.2g} times what there is: deviations are too large.")
    return found


def _exceeded(place: str, times: float) -> str:
    """Which weight of a place is exceeded, and by how much."""
    kind, colon, name = place.partition(":")
    if kind + colon == INPUT:
        return f"What {name} is off by is {times:.2g} times what V of {name} allows"
    if kind + colon == PARAMETER:
        return f"{name} moves {times:.2g} times as far as its drift allows"
    return f"residual.{place} is {times:.2g} times what W of {place} allows"


def _excess(squares: float, f: float) -> float:
    """How many times as large as supposed a family is, where that is sure and worth a word, else 0."""
    return _times(squares, f, f)


def _wanting(squares: float, f: float) -> float:
    """How many times as large a weight is as what it weighs, where that is sure and worth a word, else 0."""
    return _times(f, squares, f) if f > TOLD else 0.0


def _times(more: float, less: float, f: float) -> float:
    times = float(np.sqrt(more / less)) if less > 0 else 0.0
    return times if times > OFF and more - less > SURE * np.sqrt(2.0 * f) else 0.0


def force_squares(solution: Solution, i: int) -> tuple[float, float]:
    """sum r^2 and f of the i-th soft place, without the intervals near rest."""
    t = solution.transcription
    number = solution.term(t.force_term)
    moving = ~near_rest(t.force_std_at(solution.values))[i, t.nlp.terms[number].interval]
    return _summed(solution, number, slice(i, None, len(t.soft)), moving)


def output_squares(solution: Solution, i: int, horizons: list[int]) -> tuple[float, float]:
    """The same of the i-th output's samples in these horizons."""
    t = solution.transcription
    ours = np.repeat(np.isin(np.arange(len(t.horizons)), horizons), [len(h.time) for h in t.horizons])
    return _summed(solution, solution.term("samples"), slice(i, i + 1), ours)


def _summed(solution: Solution, number: int, part: slice, columns: NDArray[np.bool_]) -> tuple[float, float]:
    there = (solution.values.scale[number][part] > 0) & columns
    squares, f = (float(np.sum(rows[part][there])) for rows in row_squares(solution, number))
    return squares, f
