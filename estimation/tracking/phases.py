"""Which phase every friction law is in, sticking or sliding one way, on-line and with its probability.

    estimator = PhaseEstimator(problem)
    now = estimator.update(Sample(time=t, inputs={"V": 15.0}, outputs={"I_m": 0.4}))
    now.phases["bit"].stuck, now.phases["bit"].since           # probability; s

A rounded sign creeps where a body stands still, and does not know that a velocity which reaches zero stays there. Here each phase has
equations of its own without rounding, and the moving horizon is one sampling interval long, but several run side by side, one for each
likely history of the phases (`hypotheses.py`). What they know of states and parameters is linearised about their own mean.

Interacting models with state-dependent transitions: C. E. Seah & I. Hwang, IEEE Trans. Aerospace and Electronic Systems 45, 2009; the
instants as conditions that hold exactly are our own.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import product

import numpy as np
import pandas as pd
from scipy.special import logsumexp

from backsight.models.errors import InputError
from backsight.models.simulation.phases import Phases
from backsight.ocp.moving.belief import Belief, Flow
from backsight.ocp.moving.stage import Stage

from ..problem import Free, Problem
from ..recordings.gaps import gap_limit
from ..recordings.recording import Recording
from ..smoothing.horizons import output_stds
from .driven import Driven
from .estimate import Sample
from .hypotheses import LEAST, Bank, Hypothesis, Interval, Phase, edges
from .tuning import tuned

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

HYPOTHESES = 6  # at most: with 5 the drillstring loses nothing below 3 mA of noise, with 30 it gains nothing
WIDE = 2.0  # prior of a parameter of which only a guess is given, over that guess, as in `estimator.py`
UNKNOWN = 10.0  # prior of a state of which nothing is known, over its nominal size: hypotheses are compared by what they predict
DEGREE = 2  # of the polynomials in a stage
FINEST, ACCURATE, LOOKED_AT = (
    16,
    0.1,
    40,
)  # stages between two samples at most; what they may miss, over the noise; rows where that is judged


@dataclass(frozen=True, kw_only=True)
class LawPhase:
    """Probabilities that a law sticks, slides forwards or backwards, and since when [s] it is in the most probable phase.

    since: the last change of the most probable hypothesis, NaN where it has seen none.
    """

    stuck: float
    forwards: float
    backwards: float
    since: float

    @property
    def sticks(self) -> bool:
        """Whether sticking is more probable than sliding."""
        return self.stuck > 0.5


@dataclass(frozen=True, kw_only=True)
class PhaseEstimate:
    """Of the newest time [s]: phases of the laws, by component; states and parameters of all hypotheses together, with std [SI].

    hypotheses: how many are followed; surprise: minus twice the logarithm of the sample's likelihood less the noise's constant.
    """

    time: float
    phases: Mapping[str, LawPhase]
    values: Mapping[str, float]
    stds: Mapping[str, float]
    hypotheses: int
    seconds: float = field(repr=False)

    def __getitem__(self, name: str) -> float:
        """A state or parameter by its name."""
        return self.values[name]

    def std(self, name: str) -> float:
        """Its standard deviation."""
        return self.stds[name]


class PhaseEstimator:
    """Phases, states and parameters from a stream of samples.

    problem: `weights.W` names the places with a residual force, the other equations hold exactly; without any they are found from the
    leading rows (`tuning.py`). hypotheses: on the past, at most. Outputs that look at accelerations are left out. Raises InputError for a
    model without a law that sticks.
    """

    def __init__(self, problem: Problem, *, hypotheses: int = HYPOTHESES, progress: Callable[[str], None] | None = None) -> None:
        if hypotheses < 2:
            raise InputError(f"PhaseEstimator(hypotheses={hypotheses}): sticking and sliding are two; needs 2 at least.")
        settled = problem if problem.weights.W else tuned(problem, progress or (lambda _: None)).asked
        self.problem = posed = settled.posed
        dae, first = posed.dae, posed.fitted[0]
        self._phases = Phases(dae, posed.values)
        self.laws = self._phases.names
        if not self.laws:
            raise InputError(f"PhaseEstimator: {dae.name} has no friction law that sticks; Estimator follows it.")
        self._free, self._soft = posed.free, tuple(k for k, place in enumerate(dae.places) if place.name in posed.weights.W)
        self._force_std = np.array([posed.weights.W[dae.places[k].name] for k in self._soft])
        stds = output_stds(posed)[0][0]
        self._scales = np.array([1.0 / stds[q.name] if q.name in stds else 0.0 for q in dae.outputs])
        self._outputs, self._inputs = tuple(q.name for q in dae.outputs), tuple(q.name for q in dae.inputs)
        self.names = (*(q.name for q in dae.states), *(dae.parameters[i].name for i in self._free))
        self._driven = Driven(len(self._inputs), first.hold)
        self.sampling, self._gap = first.sampling, gap_limit(first)
        self._flows: dict[Phase, tuple[Flow, tuple[int, ...], tuple[int, ...]]] = {}
        self._bank = Bank(self._flow, hypotheses, self.sampling)
        self.stages = self._stages(first)
        self.newest: float | None = None
        self.estimate: PhaseEstimate | None = None

    def update(self, sample: Sample) -> PhaseEstimate:
        """The estimate at the sample's time; one that is not later than the last adds nothing."""
        began = clock.perf_counter()
        if not np.isfinite(sample.time):
            raise InputError(f"update: time is {sample.time}; a sample has a finite time in seconds.")
        inputs, read = _vector(sample.inputs, self._inputs, "input"), _vector(sample.outputs, self._outputs, "output")
        if self.newest is not None and self.estimate is not None and sample.time <= self.newest + LEAST * self.sampling:
            return self.estimate
        if self.newest is None or sample.time - self.newest > self._gap:
            self._begin(sample.time)
            self._driven.put(sample.time, inputs)
        else:
            self._driven.put(sample.time, inputs)
            self._bank.move(Interval(start=self.newest, end=sample.time, stages=self._numbers, input=self._input))
            self._driven.forget(sample.time)
        self.newest = sample.time
        there = np.isfinite(read) & (self._scales > 0)
        self._bank.sampled(
            np.concatenate([[sample.time], self._driven.last, np.where(there, read, 0.0), np.where(there, self._scales, 0.0)])
        )
        self.estimate = self._read(sample.time, began)
        return self.estimate

    def hold(self, time: float, inputs: Mapping[str, float]) -> None:
        """The inputs changed at a time [s] between samples."""
        self._driven.put(time, _vector(inputs, self._inputs, "input"))

    def at(self, law: str, time: float) -> LawPhase:
        """The phase of a law at an earlier time [s], from the samples up to now: with a lag it is surer than it was then.

        `since` is that of the phase then. Raises InputError for a name that is no law.
        """
        if law not in self.laws:
            raise InputError(f"at({law!r}): {self.problem.dae.name} has the laws {', '.join(self.laws)}.")
        return self._phase(self.laws.index(law), time)

    # ---- what comes out

    def _read(self, time: float, began: float) -> PhaseEstimate:
        likely = self._bank.hypotheses
        weights = np.exp([h.weight for h in likely])
        means, stds = np.array([h.belief.mean for h in likely]), np.array([h.belief.std for h in likely])
        mean = weights @ means
        std = np.sqrt(weights @ (stds**2 + (means - mean) ** 2))
        return PhaseEstimate(
            time=time,
            phases={law: self._phase(k, time) for k, law in enumerate(self.laws)},
            values=dict(zip(self.names, mean.tolist(), strict=True)),
            stds=dict(zip(self.names, std.tolist(), strict=True)),
            hypotheses=len(likely),
            seconds=clock.perf_counter() - began,
        )

    def _phase(self, law: int, time: float) -> LawPhase:
        share = {s: sum(np.exp(h.weight) for h in self._bank.hypotheses if h.phase_at(time)[law] == s) for s in (0, 1, -1)}
        most = max(share, key=lambda s: share[s])
        best = next(h for h in self._bank.hypotheses if h.phase_at(time)[law] == most)
        return LawPhase(stuck=float(share[0]), forwards=float(share[1]), backwards=float(share[-1]), since=_since(best, law, time))

    # ---- what goes in

    def _numbers(self, start: float, end: float) -> list[Array]:
        """Of the stages between two times."""
        count = max(1, int(np.ceil(self.stages * (end - start) / self.sampling - LEAST)))
        return [self._stage_numbers(a, b) for a, b in edges(start, end, count)]

    def _stage_numbers(self, start: float, end: float) -> Array:
        nothing = np.zeros(len(self._outputs))
        return np.concatenate([[end - start, start], self._driven.over(start, end), nothing, 1 / self._force_std, nothing])

    def _input(self, time: float) -> Array:
        """What acts just before a time, or, at the first one that is still needed, just after it."""
        before = max(time - LEAST * self.sampling, self._driven.times[0])
        return self._driven.over(before, before + LEAST * self.sampling)[len(self._inputs) :]

    def _flow(self, phase: Phase) -> tuple[Flow, tuple[int, ...], tuple[int, ...]]:
        """The model in a phase, made when it is first asked for."""
        if phase not in self._flows:
            posed, within = self.problem, self._phases.within(phase)
            stage = Stage(within.dae, self._free, posed.values, self._soft, DEGREE)
            bounds = np.array([posed.parameter_range(i) for i in self._free]).reshape(-1, 2)
            flow = Flow(stage, within.margins, bounds, self._force_std / np.sqrt(self.sampling))
            self._flows[phase] = flow, within.of, within.beyond
        return self._flows[phase]

    def _begin(self, time: float) -> None:
        """Every combination of phases is equally likely; what was learnt of the parameters stays."""
        first, before = self._first(), self._bank.hypotheses
        if before:
            nx, mean, root = len(self.problem.dae.states), first.mean.copy(), first.root.copy()
            mean[nx:], root[nx:] = before[0].belief.mean[nx:], 0.0
            root[nx:, nx:] = np.linalg.qr(before[0].belief.root[nx:].T, mode="r").T
            first = Belief(mean=mean, root=root)
        self._driven.clear()
        found = []
        for phase in product((0, 1, -1), repeat=len(self.laws)):
            belief = self._resting(first, phase)
            found.append(Hypothesis(phase=phase, belief=belief, weight=-float(np.log(3.0)) * len(self.laws), changes=((-np.inf, phase),)))
        self._bank.hypotheses = found

    def _resting(self, belief: Belief, phase: Phase) -> Belief:
        """With the velocities of the laws that stick at zero."""
        sliding = self._flow(tuple(1 for _ in phase))[0]
        for k in (k for k, s in enumerate(phase) if s == 0):
            here = sliding.at(belief, np.zeros(len(self._inputs)), 0.0)
            belief = belief.reshaped(here.J[k], -float(here.g[k]), 0.0)
        return belief

    def _first(self) -> Belief:
        """What is known before the first sample."""
        posed, dae = self.problem, self.problem.dae
        reference, std = np.zeros((2, len(self.names)))
        for i, q in enumerate(dae.states):
            if q.name in posed.start:
                reference[i], std[i] = posed.start[q.name].value, posed.start[q.name].std
            elif q.name in posed.varying:
                reference[i], std[i] = _guessed(posed.varying[q.name], q.nominal)
            else:
                reference[i], std[i] = q.start, UNKNOWN * q.nominal
        for k, i in enumerate(self._free, len(dae.states)):
            given = posed.parameters[dae.parameters[i].name]
            if isinstance(given, Free):
                reference[k], std[k] = _guessed(given, dae.parameters[i].nominal)
        return Belief(mean=reference, root=np.diag(std))

    def _stages(self, recording: Recording) -> int:
        """Stages between two samples with which no output is wrong by more than ACCURATE of its noise, all laws sliding, under its inputs."""
        flow = self._flow(tuple(1 for _ in self.laws))[0]
        first = self._first().mean
        rows = min(LOOKED_AT, len(recording.time) - 1)
        table = np.column_stack([recording.inputs[name] for name in self._inputs]) if self._inputs else np.zeros((rows + 1, 0))
        for k in range(rows + 1):
            self._driven.put(float(recording.time[k]), table[k])
        last = np.concatenate([np.zeros(len(self._inputs)), np.zeros(len(self._outputs)), self._scales])

        def ends(count: int) -> Array:
            found, x = [], first[: len(self.problem.dae.states)]
            for k in range(rows):
                for a, b in edges(float(recording.time[k]), float(recording.time[k + 1]), count):
                    x = flow.end(x, first[len(x) :], self._stage_numbers(a, b))
                found.append(flow.outputs(x, first[len(x) :], np.concatenate([recording.time[k + 1 : k + 2], last])))
            return np.array(found)

        count, coarse = 1, ends(1)
        while count < FINEST:
            fine = ends(2 * count)
            if np.abs(fine - coarse).max(initial=0.0) <= ACCURATE:
                break
            count, coarse = 2 * count, fine
        self._driven.clear()
        return count


def follow_phases(problem: Problem, *, hypotheses: int = HYPOTHESES) -> dict[str, pd.DataFrame]:
    """Recording -> one row per sample, from the samples up to its own.

    t_s; for every law <law>.stuck, .forwards, .backwards (probabilities) and .since [s]; states and parameters, each with .std [SI].
    Every fitted recording starts anew. Raises InputError as `PhaseEstimator` does.
    """
    found = {}
    for recording in problem.posed.fitted:
        estimator = PhaseEstimator(problem, hypotheses=hypotheses)
        rows = []
        for k, time in enumerate(recording.time.tolist()):
            inputs = {name: float(u[k]) for name, u in recording.inputs.items()}
            outputs = {name: float(y[k]) for name, y in recording.outputs.items()}
            now = estimator.update(Sample(time=time, inputs=inputs, outputs=outputs))
            row = {"t_s": time}
            for law, s in now.phases.items():
                row |= {f"{law}.stuck": s.stuck, f"{law}.forwards": s.forwards, f"{law}.backwards": s.backwards, f"{law}.since": s.since}
            for name, value in now.values.items():
                row |= {name: value, f"{name}.std": now.stds[name]}
            rows.append(row)
        found[recording.name] = pd.DataFrame(rows)
    return found


def _since(h: Hypothesis, law: int, time: float) -> float:
    """When a law entered the phase that it has at a time."""
    past = [(start, phase[law]) for start, phase in h.changes if start <= time]
    since = past[-1][0]
    for start, phase in reversed(past):
        if phase != past[-1][1]:
            break
        since = start
    return float(since) if np.isfinite(since) else float("nan")


def _guessed(given: Free, nominal: float) -> tuple[float, float]:
    """First value and its deviation."""
    return given.guess, given.std or WIDE * (abs(given.guess) or nominal)


def _vector(given: Mapping[str, float], names: tuple[str, ...], what: str) -> Array:
    for name in given:
        if name not in names:
            raise InputError(f"update: the model has no {what} {name!r}; it has {', '.join(names) or 'none'}.")
    return np.array([given.get(name, np.nan) for name in names], dtype=np.float64)
