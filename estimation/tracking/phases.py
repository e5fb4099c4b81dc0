"""Which phase every friction law is in, sticking or sliding one way, on-line and with its probability.

    estimator = PhaseEstimator(problem)
    now = estimator.update(Sample(time=t, inputs={"V": 15.0}, outputs={"I_m": 0.4}))
    now.phases["bit"].stuck, now.phases["bit"].since           # probability; s

A rounded sign creeps where a body stands still, and does not know that a velocity which reaches zero stays there. Here each phase has
equations of its own without rounding, and the horizon is one sampling interval long, but several run side by side, one for each likely
history of the phases (`hypotheses.py`): an interacting multiple-model filter of which the transitions depend on the state (C. E. Seah & I.
Hwang, IEEE Trans. Aerospace and Electronic Systems 45, 2009), and not on a clock. All is linearised about the mean of a hypothesis, so the
parameters should be known to some 20 %.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product

import casadi as ca
import numpy as np
import pandas as pd

from backsight.models.errors import InputError
from backsight.ocp.moving.belief import Belief, triangular_root

from ..problem import Problem
from ..recordings.gaps import gap_limit
from .cut import LEAST
from .driven import Driven
from .estimate import Sample
from .hypotheses import Bank, Hypothesis, Interval, edges, merged
from .phase_models import PhaseModels

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

HYPOTHESES = 12  # at most: as many changes as may still be in doubt, one for each of the last samples


@dataclass(frozen=True, kw_only=True)
class LawPhase:
    """Probabilities that a law sticks, slides forwards or backwards, and since when [s] it is in the most probable phase.

    since: by the most probable hypothesis that has it there, -inf where it was so from the start.
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

    hypotheses: how many are followed. seconds: that the estimate took.
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

    problem: `weights.W` names the places with a residual force, the other equations hold exactly. hypotheses: on the past, at most. Raises
    InputError without any W, for a model without a law that sticks and for an output that reads a force at once. There is no test for
    outliers, and a late sample is left out.
    """

    def __init__(self, problem: Problem, *, hypotheses: int = HYPOTHESES) -> None:
        if hypotheses < 2:
            raise InputError(f"PhaseEstimator(hypotheses={hypotheses}): sticking and sliding are two; needs 2 at least.")
        if not problem.weights.W:
            raise InputError(
                "PhaseEstimator: needs weights.W, the room for residual forces: where a body sticks and slips, the samples do not tell it."
            )
        self.problem = posed = problem.posed
        self._models, first = PhaseModels(posed), posed.fitted[0]
        self.laws, self._scales = self._models.phases.names, self._models.scales
        self._outputs, self._inputs = (tuple(q.name for q in infos) for infos in (posed.dae.outputs, posed.dae.inputs))
        self.names = (*(q.name for q in posed.dae.states), *(posed.dae.parameters[i].name for i in posed.free))
        self.sampling, self._gap, self.stages = first.sampling, gap_limit(first), self._models.stages(first)
        self._driven = Driven(len(self._inputs), first.hold)
        self._before: Array = self._driven.last
        self._bank = Bank(self._models.moving, hypotheses, self.sampling)
        self.newest: float | None = None
        self.estimate: PhaseEstimate | None = None
        # the clock's own start would cost digits; only a model that knows the time needs it
        self._timed = ca.depends_on(ca.vertcat(posed.dae.residual, posed.dae.output), posed.dae.t)
        self._origin = 0.0

    def update(self, sample: Sample) -> PhaseEstimate:
        """The estimate at the sample's time; one that is not later than the last adds nothing."""
        began = clock.perf_counter()
        if not np.isfinite(sample.time):
            raise InputError(f"update: time is {sample.time}; a sample has a finite time in seconds.")
        inputs, read = _vector(sample.inputs, self._inputs, "input"), _vector(sample.outputs, self._outputs, "output")
        if self.newest is not None and self.estimate is not None and sample.time <= self.newest + LEAST * self.sampling:
            return self.estimate
        if self.newest is None or sample.time - self.newest > self._gap:
            self._begin()
            self._origin = 0.0 if self._timed else sample.time
            now = sample.time - self._origin
            self._driven.put(now, inputs)
        else:
            now = sample.time - self._origin
            self._driven.put(now, inputs)
            interval = Interval(start=self.newest - self._origin, end=now, before=self._before, stages=self._numbers, input=self._input)
            self._bank.move(interval)
        self._before = self._input(now)
        self._driven.forget(now)
        self.newest = sample.time
        there = np.isfinite(read) & (self._scales > 0)
        seen, scales = np.where(there, read, 0.0), np.where(there, self._scales, 0.0)
        self._bank.sampled(np.concatenate([[now], self._driven.last, seen, scales]))
        self.estimate = self._read(sample.time, began)
        return self.estimate

    def hold(self, time: float, inputs: Mapping[str, float]) -> None:
        """The inputs changed at a time [s] between samples."""
        if self.newest is None or time > self.newest + LEAST * self.sampling:
            self._driven.add(time - self._origin, _vector(inputs, self._inputs, "input"))

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
        likely, time = self._bank.hypotheses, time - self._origin
        share = {s: float(sum(np.exp(h.weight) for h in likely if h.phase_at(time)[law] == s)) for s in (0, 1, -1)}
        most = max(share, key=lambda s: share[s])
        since = next(h.since(law, time) for h in likely if h.phase_at(time)[law] == most)
        return LawPhase(stuck=share[0], forwards=share[1], backwards=share[-1], since=since + self._origin)

    # ---- what goes in

    def _numbers(self, start: float, end: float) -> list[Array]:
        """Of the stages between two times."""
        count = max(1, int(np.ceil(self.stages * (end - start) / self.sampling - LEAST)))
        return [self._models.numbers(self._driven, a, b) for a, b in edges(start, end, count)]

    def _input(self, time: float) -> Array:
        """What acts just before a time, or, at the first one that is still needed, just after it."""
        before = max(time - LEAST * self.sampling, self._driven.times[0])
        return self._driven.over(before, before + LEAST * self.sampling)[len(self._inputs) :]

    def _begin(self) -> None:
        """Every combination of phases is equally likely; what was learnt of the parameters stays."""
        first, before = self._models.first(), self._bank.hypotheses
        if before:
            nx, mean, root = len(self.problem.dae.states), first.mean.copy(), first.root.copy()
            learnt = merged(before).belief
            mean[nx:], root[nx:] = learnt.mean[nx:], 0.0
            root[nx:, nx:] = triangular_root(learnt.root[nx:])
            first = Belief(mean=mean, root=root)
        self._driven.clear()
        phases = list(product((0, 1, -1), repeat=len(self.laws)))
        self._bank.hypotheses = [
            Hypothesis(phase=s, belief=self._models.resting(first, s), weight=-float(np.log(len(phases))), changes=((-np.inf, s),))
            for s in phases
        ]


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


def _vector(given: Mapping[str, float], names: tuple[str, ...], what: str) -> Array:
    for name in given:
        if name not in names:
            raise InputError(f"update: the model has no {what} {name!r}; it has {', '.join(names) or 'none'}.")
    return np.array([given.get(name, np.nan) for name in names], dtype=np.float64)
