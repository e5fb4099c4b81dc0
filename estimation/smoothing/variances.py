"""Weights that nobody gave, from the data: the variances that make the fit's own residuals as large as they are said to be.

The fixed point of `families.py`, iterated from a loose start by secant steps in log s, a few solves warm-started from each other. It goes
back where a step has led to less evidence than there was. A simple rule for a start: it supposes that what is left over is white.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from backsight.models.errors import SolveError
from backsight.ocp import Solution, Status, Transcription
from backsight.ocp.nlp import Values

from ..validation.criteria import criteria
from ..validation.innovations import innovations
from .families import FARTHEST, Family
from .rest import with_room
from .robust import RobustSolution

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Mask = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
Solve = Callable[[Array, Values, bool], Solution]
Say = Callable[[str], None]

ROUNDS = 12
CLOSE = 0.1  # relative change of every standard deviation at which the iteration ends
LEAST_NOISE = 0.3  # of an output's noise where its differences show it: less is a fit that swallows the noise
RAN_AWAY = 1e3  # times the first cost, or the number of rows, that squares cost with weights that have no end
STALLED = 0.1  # of the cost, a log-likelihood: a round of steps that saves less is half a deviation from its end, and squares do not notice
CREEPING = 0.02  # share of the cost: nor do they notice less than that, and with much room for forces some ways have no end
BEYOND_WORDS = 700.0  # log of a factor that no number holds
LESS = 10.0  # nats of evidence: with so much less weights have moved on too far


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


@dataclass(frozen=True, kw_only=True)
class Weighted:
    """A program whose numbers go with the factors of some families of its rows.

    values: of the program, at the first deviations; at_rest (n_soft, N): what they have near rest; is_open (H, ny): outputs of which a
    factor is sought.
    """

    transcription: Transcription
    values: Values
    at_rest: Array
    is_open: Mask
    families: Sequence[Family]

    @property
    def factors(self) -> tuple[Array, Array]:
        """What the families make of the first deviations of forces (n_soft,) and outputs (H, ny)."""
        force_factor, output_factor = np.ones(len(self.transcription.soft)), np.ones(self.is_open.shape)
        for family in self.families:
            if family.term == "samples":
                output_factor[self.is_open[:, family.row], family.row] = np.exp(family.log)
            else:
                force_factor[family.row] = np.exp(family.log)
        return force_factor, output_factor

    @property
    def numbers(self) -> Values:
        """The program's numbers with these factors."""
        t, (force_factor, output_factor) = self.transcription, self.factors
        room = with_room(force_factor * t.force_std, self.at_rest) / with_room(t.force_std, self.at_rest)
        values = t.with_force_std(self.values, room)
        factor = np.repeat(output_factor, [len(h.time) for h in t.horizons], axis=0).T
        scale = tuple(s / factor if term.name == "samples" else s for term, s in zip(t.nlp.terms, values.scale, strict=True))
        return replace(values, scale=scale)

    @property
    def logs(self) -> list[float]:
        """Of the factors."""
        return [family.log for family in self.families]

    def put(self, logs: Sequence[float]) -> None:
        """Other factors."""
        for family, log in zip(self.families, logs, strict=True):
            family.log = log


@dataclass(kw_only=True)
class Iteration:
    """The way to the weights: where the next solve starts, how far it is to go [log of a factor], the best that was seen on it.

    solve(decisions, values, to the full tolerance) -> Solution.
    """

    solve: Solve
    weighted: Weighted
    start: Array
    say: Say
    rounds: int = field(default=0, init=False)
    iterations: int = field(default=0, init=False)
    to_go: float = field(default=np.inf, init=False)
    settled: bool = field(default=False, init=False)
    best: Seen | None = field(default=None, init=False)

    def run(self, *, hasty: bool, hopeless: float) -> None:
        """Rounds, until the weights stay as they are; arguments as of `choose_weights`."""
        usual = float(sum(term.target.size for term in self.weighted.transcription.nlp.terms))
        begun, cost = self.start, np.inf
        while self.rounds < ROUNDS and not self.to_go < CLOSE:
            self.rounds += 1
            solution = self.solved(fully=False)
            before, cost, status = cost, solution.solved.cost, solution.solved.status
            usual = max(usual, cost) if self.rounds == 1 else usual
            if cost > RAN_AWAY * usual:
                self.start, self.best = begun, None
                self.weighted.put([0.0] * len(self.weighted.families))
                return
            if self.rounds == 1 and cost > hopeless:
                raise SolveError(
                    f"Given up: at the weights that it began with its cost is {cost:.4g}, and more than {hopeless:.4g} is hopeless."
                )
            if status is Status.ITERATIONS and abs(before - cost) > max(STALLED, CREEPING * cost) and not hasty:
                continue  # on its way: the next round goes on from here
            # without covariances nobody knows how much of a residual the fit could choose
            if not (status.converged or status is Status.ITERATIONS) or solution.curvature is None:
                return
            self.say(f"weights from the data, round {self.rounds}: {self._move(solution)}")

    def solved(self, *, fully: bool) -> Solution:
        """The program at the weights as they are, from where the last solve ended."""
        solution = self.solve(self.start, self.weighted.numbers, fully)
        self.start, self.iterations = solution.solved.decisions, self.iterations + solution.solved.iterations
        return solution

    def _move(self, solution: Solution) -> str:
        """New factors: by the families' own steps, or halfway back to the best ones; in words, how far that is to go."""
        asked = self.best is not None or self.to_go < np.log(FARTHEST)
        seen = Seen.of(solution, self.weighted.logs) if asked else None
        if seen is not None and self.best is not None and seen.too_far(self.best):
            self.start, self.settled = self.best.decisions, False
            self.to_go = max(family.halfway_to(log) for family, log in zip(self.weighted.families, self.best.logs, strict=True))
            return "too far, and halfway back"
        if seen is not None and seen.evidence > (-np.inf if self.best is None else self.best.evidence):
            self.best = seen
        self.to_go = max(family.step(solution) for family in self.weighted.families)
        self.settled = self.to_go < CLOSE
        return f"{100 * np.expm1(min(self.to_go, BEYOND_WORDS)):.3g} % to go"

    def end(self) -> Solution:
        """To the full tolerance; with the best weights that were seen, where those at which the way ended are worse."""
        solution, last = self.solved(fully=True), self.weighted.logs
        if self.best is None or not Seen.of(solution, last).too_far(self.best):
            return solution
        self.say("weights from the data: those with the most evidence on the way")
        self.weighted.put(self.best.logs)
        self.start = self.best.decisions
        again = self.solved(fully=True)
        if not again.solved.status.converged:
            self.weighted.put(last)
            return solution
        self.settled = False
        return again


def choose_weights(
    solve: Solve,
    start: Array,
    values: Values,
    transcription: Transcription,
    at_rest: Array,
    wanted: Open,
    say: Say,
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
    weighted = Weighted(
        transcription=transcription,
        values=values,
        at_rest=at_rest,
        is_open=wanted.of_outputs(transcription),
        families=wanted.families(transcription, at_rest),
    )
    way = Iteration(solve=solve, weighted=weighted, start=start, say=say)
    if weighted.families:
        way.run(hasty=hasty, hopeless=hopeless)
    solution = way.end()
    force_factor, output_factor = weighted.factors
    return Choice(
        solution=solution,
        force_std=transcription.force_std * force_factor,
        output_factor=output_factor,
        rounds=way.rounds,
        settled=way.settled or not weighted.families,
        iterations=way.iterations,
    )


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
    def of(cls, solution: Solution, logs: Sequence[float]) -> Seen:
        """A solution, at these factors."""
        found = None
        if solution.solved.status.converged and not isinstance(solution, RobustSolution):
            with suppress(np.linalg.LinAlgError):
                found = criteria(solution, innovations(solution))
        evidence = -np.inf if found is None or found.log_evidence is None else found.log_evidence
        return cls(solution.solved.decisions, logs, evidence)

    def too_far(self, best: Seen) -> bool:
        """Whether it has come to rest where there is less evidence, beyond what rough solves make of it."""
        return -np.inf < self.evidence < best.evidence - LESS


def _samples_of(transcription: Transcription, horizons: Mask) -> Mask:
    """Which columns of the samples belong to these of the horizons, (all samples,)."""
    return np.repeat(horizons, [len(h.time) for h in transcription.horizons])


def _moving(at_rest: Array) -> Mask | None:
    """The intervals (N,) that are not near rest; all where there is no other."""
    return at_rest == 0 if np.any(at_rest == 0) else None
