"""Weights that nobody gave, from the data: the variances that make the fit's own residuals as large as they are said to be.

With r the rows of one family (the moments of one place's balance, or one output's differences) for standard deviation s, and l their
leverage (the share of each that the fit could choose freely, l = J C J'/s^2 with C the posterior covariance), the fixed point

    s^2 = sum r^2 s^2 / sum (1 - l)

is where the marginal likelihood is stationary (MacKay, Neural Computation 4, 1992). It is iterated from a loose start by secant steps in
log s, a few solves warm-started from each other, and goes back where a step has led to less evidence than there was. A simple rule for a
start: it supposes that what is left over is white.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from backsight.models.errors import SolveError
from backsight.ocp import Solution, Status, Transcription
from backsight.ocp.nlp import Values

from ..validation.criteria import criteria
from ..validation.innovations import innovations
from .rest import with_room
from .robust import RobustSolution, row_squares

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Mask = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]

ROUNDS = 12
CLOSE = 0.1  # relative change of every standard deviation at which the iteration ends
LEAST_NOISE = 0.3  # of an output's noise where its differences show it: less is a fit that swallows the noise
UNTOLD = 0.1  # of a row: what a family always has of freedom and of squares, so that one that nothing tells about stays as it is
UNDECIDED = 0.3  # of the deviation of a log-likelihood's slope: a residual force's std that is nearer to its best cannot be told from it
BOLDEST = 4.0  # times the fixed point's own step, at most
RAN_AWAY = 1e3  # times the first cost, or the number of rows, that squares cost with weights that have no end
STALLED = 0.1  # of the cost, a log-likelihood: a round of steps that saves less is half a deviation from its end, and squares do not notice
CREEPING = 0.02  # share of the cost: nor do they notice less than that, and with much room for forces some ways have no end
NOTHING = 1.0  # sum of squares that a family costs when no one can tell it from none, and
CHOSEN = 0.05  # the share of its rows that the fit chooses then, at most
BEYOND_WORDS = 700.0  # log of a factor that no number holds
LESS = 10.0  # nats of evidence: with so much less weights have moved on too far
FARTHEST, FARTHEST_DOWN = 30.0, 8.0  # largest factors of one round, up and down


@dataclass(frozen=True, kw_only=True)
class Choice:
    """The solution at the weights in force.

    force_std (n_soft,). output_factor (H, ny): on every recording's given or first standard deviations; those given stay as they are.
    """

    solution: Solution
    force_std: Array
    output_factor: Array
    rounds: int
    settled: bool
    iterations: int


@dataclass(frozen=True, kw_only=True)
class Open:
    """Standard deviations that nobody gave: of the residual forces at these places, and of every horizon of these outputs.

    What nobody gave of one output is one factor. least_std: place -> below which nobody can tell, so that the iteration goes no lower;
    most_std: place -> above which it goes no higher; least_noise (H, ny): the least factors on the outputs' first standard deviations.
    """

    places: Collection[int]
    outputs: Sequence[Collection[str]]
    least_std: Mapping[int, float]
    most_std: Mapping[int, float]
    least_noise: Array

    def families(self, t: Transcription, at_rest: Array) -> list[Family]:
        """Those of a transcription that are iterated."""
        found, is_open = list[Family](), self.of_outputs(t)
        for i, (k, std) in enumerate(zip(t.soft, t.force_std, strict=True)):
            if k in self.places:
                lowest, highest = np.log(max(self.least_std.get(k, 0.0) / std, 1e-300)), np.log(self.most_std.get(k, np.inf) / std)
                found.append(Family(t.force_term, i, lowest, _moving(at_rest[i]), highest))
        for i in np.flatnonzero(is_open.any(axis=0)).tolist():
            least = float(np.log(max(self.least_noise[is_open[:, i], i].max(), 1e-300)))
            found.append(Family("samples", i, least, _samples_of(t, is_open[:, i])))
        return found

    def of_outputs(self, t: Transcription) -> Mask:
        """Which outputs of every horizon have none, (H, ny)."""
        names = [q.name for q in t.dae.outputs]
        return np.array([[name in own for name in names] for own in self.outputs]).reshape(len(self.outputs), len(names))


def choose_weights(
    solve: Callable[[Array, Values, bool], Solution],
    start: Array,
    values: Values,
    transcription: Transcription,
    at_rest: Array,
    wanted: Open,
    say: Callable[[str], None],
    *,
    hasty: bool = False,
    hopeless: float = np.inf,
) -> Choice:
    """Solve with the weights given; where places or outputs have none, iterate theirs.

    solve(decisions, values, to the full tolerance) -> Solution. at_rest (n_soft, N): what the values have near rest (`rest.py`), which
    tells nothing about the weights elsewhere. hasty: weights move on from where a solve stopped at its limit of iterations, far from its
    end or not. Where weights run away, so that squares cost ever more, those of the start are taken again, and have not settled; nor have
    those that were gone back to. Raises SolveError where the first solve, at the weights given, leaves a cost above `hopeless`.
    """
    is_open, families = wanted.of_outputs(transcription), wanted.families(transcription, at_rest)
    iterations, rounds, settled, cost, change, begun = 0, 0, not families, np.inf, np.inf, start
    best: Seen | None = None
    usual = float(sum(term.target.size for term in transcription.nlp.terms))

    def weighted() -> Values:
        return _weighted(values, transcription, at_rest, *_factors(families, transcription, is_open))

    for rounds in range(1, ROUNDS + 1) if families else ():
        solution = solve(start, weighted(), False)
        start, iterations = solution.solved.decisions, iterations + solution.solved.iterations
        before, cost = cost, solution.solved.cost
        usual = max(usual, cost) if rounds == 1 else usual
        if cost > RAN_AWAY * usual:
            start, best = begun, None
            _put(families, [0.0] * len(families))
            break
        if rounds == 1 and cost > hopeless:
            raise SolveError(
                f"Given up: at the weights that it began with its cost is {cost:.4g}, and more than {hopeless:.4g} is hopeless."
            )
        if solution.solved.status is Status.ITERATIONS and abs(before - cost) > max(STALLED, CREEPING * cost) and not hasty:
            continue  # on its way: the next round goes on from here
        if not (solution.solved.status.converged or solution.solved.status is Status.ITERATIONS):
            break
        if solution.curvature is None:
            break  # without covariances nobody knows how much of a residual the fit could choose
        seen = Seen.of(solution, families) if best is not None or change < np.log(FARTHEST) else None
        if seen is not None and best is not None and seen.too_far(best):
            start, change = best.decisions, max(family.halfway_to(log) for family, log in zip(families, best.logs, strict=True))
            settled, to_go = False, "too far, and halfway back"
        else:
            best = seen if seen is not None and seen.evidence > (-np.inf if best is None else best.evidence) else best
            change = max(family.step(solution) for family in families)
            settled, to_go = change < CLOSE, f"{100 * np.expm1(min(change, BEYOND_WORDS)):.3g} % to go"
        say(f"weights from the data, round {rounds}: {to_go}")
        if change < CLOSE:
            break
    solution = solve(start, weighted(), True)
    iterations += solution.solved.iterations
    if best is not None and Seen.of(solution, families).too_far(best):
        say("weights from the data: those with the most evidence on the way")
        last = [family.log for family in families]
        _put(families, best.logs)
        again = solve(best.decisions, weighted(), True)
        iterations += again.solved.iterations
        if again.solved.status.converged:
            solution, settled = again, False
        else:
            _put(families, last)
    force_factor, output_factor = _factors(families, transcription, is_open)
    return Choice(
        solution=solution,
        force_std=transcription.force_std * force_factor,
        output_factor=output_factor,
        rounds=rounds,
        settled=settled,
        iterations=iterations,
    )


def _put(families: Sequence[Family], logs: Sequence[float]) -> None:
    """Other factors for the families."""
    for family, log in zip(families, logs, strict=True):
        family.log = log


def _factors(families: Sequence[Family], transcription: Transcription, is_open: Mask) -> tuple[Array, Array]:
    """What the families make of the first deviations of forces (n_soft,) and outputs (H, ny)."""
    force_factor, output_factor = np.ones(len(transcription.soft)), np.ones(is_open.shape)
    for family in families:
        if family.term == "samples":
            output_factor[is_open[:, family.row], family.row] = np.exp(family.log)
        else:
            force_factor[family.row] = np.exp(family.log)
    return force_factor, output_factor


@dataclass(frozen=True)
class Seen:
    """A solution on the way: its decisions, logs of the families' factors there, and the log evidence of these weights [nats].

    evidence: -inf of what has not come to rest, or has none; of losses that are no squares, too: there the fixed point is another one.

    The fixed point is where the likelihood of a model is stationary whose trajectories do not bend it. Near rest they do: weights may move
    on from where they are best, by the fixed point's own step, to where residual forces do everything.
    """

    decisions: Array
    logs: Sequence[float]
    evidence: float

    @classmethod
    def of(cls, solution: Solution, families: Sequence[Family]) -> Seen:
        """A solution, at the families' factors."""
        found = None
        if solution.solved.status.converged and not isinstance(solution, RobustSolution):
            with suppress(np.linalg.LinAlgError):
                found = criteria(solution, innovations(solution))
        evidence = -np.inf if found is None or found.log_evidence is None else found.log_evidence
        return cls(solution.solved.decisions, [family.log for family in families], evidence)

    def too_far(self, best: Seen) -> bool:
        """Whether it has come to rest where there is less evidence, beyond what rough solves make of it."""
        return -np.inf < self.evidence < best.evidence - LESS


class Family:
    """The standard deviation of one family of rows, as log of its factor on the first one, sought by secant steps.

    columns: of the term that belong to it; None is all.
    """

    def __init__(self, term: str, row: int, lowest: float, columns: Mask | None = None, highest: float = np.inf) -> None:
        self.term, self.row, self.lowest, self.highest, self.columns, self.log = term, row, lowest, highest, columns, 0.0
        self._last: tuple[float, float] | None = None

    def step(self, solution: Solution) -> float:
        """Move towards ratio = 1; returns how far that may be: as far as it moved, or more where nobody knows yet how slow the way is."""
        ratio, settled = _ratio(solution, self.term, self.row, self.columns)
        if self.term != "samples" and settled:
            return 0.0
        wanted = float(np.log(ratio))
        move, known = wanted, False
        if self._last is not None and self.log != self._last[0]:
            slope = (wanted - self._last[1]) / (self.log - self._last[0])
            # a slope of -1 is the fixed point's own step; towards 0 it converges ever slower, and the secant is bolder
            known = slope < -1.0 / BOLDEST
            move = -wanted / slope if known else wanted * BOLDEST
        # downwards in smaller steps: where an equation holds as it stands, an ever smaller number only costs digits
        move = float(np.clip(move, -np.log(FARTHEST_DOWN), np.log(FARTHEST)))
        before, self._last = self.log, (self.log, wanted)
        self.log = max(min(self.log + move, self.highest), self.lowest)
        moved = abs(self.log - before)
        return moved if known or moved == 0 else max(moved, BOLDEST * abs(wanted))

    def halfway_to(self, log: float) -> float:
        """Move halfway to another one, and forget how it went; returns how far that is."""
        moved = (log - self.log) / 2
        self._last, self.log = None, self.log + moved
        return abs(moved)


def _samples_of(transcription: Transcription, horizons: Mask) -> Mask:
    """Which columns of the samples belong to these of the horizons, (all samples,)."""
    return np.repeat(horizons, [len(h.time) for h in transcription.horizons])


def _moving(at_rest: Array) -> Mask | None:
    """The intervals (N,) that are not near rest; all where there is no other."""
    return at_rest == 0 if np.any(at_rest == 0) else None


def _weighted(values: Values, transcription: Transcription, at_rest: Array, force_factor: Array, output_factor: Array) -> Values:
    """The program's numbers with these factors on the first standard deviations."""
    std = transcription.force_std
    values = transcription.with_force_std(values, with_room(force_factor * std, at_rest) / with_room(std, at_rest))
    factor = np.repeat(output_factor, [len(h.time) for h in transcription.horizons], axis=0).T
    scale = tuple(s / factor if t.name == "samples" else s for t, s in zip(transcription.nlp.terms, values.scale, strict=True))
    return replace(values, scale=scale)


def _ratio(solution: Solution, term: str, i: int, columns: Mask | None) -> tuple[float, bool]:
    """Factor by which the standard deviation of family i of a term should change, and whether no change would be felt.

    Rows that the fit cannot choose, and yet cost nothing, are those of an equation that holds as it stands. The slope of the log-likelihood
    in log s is  sum r^2 - sum (1 - l),  of variance 2 sum (1 - l): where it is small beside that, s is as good as any other nearby.
    """
    number = solution.term(term)
    families = len(solution.transcription.dae.outputs) if term == "samples" else len(solution.transcription.soft)
    scale = solution.values.scale[number][i::families]
    there = scale > 0 if columns is None else (scale > 0) & columns
    squares, freedom = (float(np.sum(rows[i::families][there])) for rows in row_squares(solution, number))
    count = np.count_nonzero(there)
    exact = bool(freedom > (1.0 - CHOSEN) * count and squares < NOTHING)
    # of a force, where the likelihood's slope cannot be told from none, another std would be no better
    undecided = term != "samples" and abs(squares - freedom) < UNDECIDED * np.sqrt(2.0 * max(freedom, 0.0))
    return float(np.sqrt((squares + UNTOLD) / (max(freedom, 0.0) + UNTOLD))), exact or undecided
