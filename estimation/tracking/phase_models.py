"""What a problem says to an estimator of phases: the model in every phase, what is known beforehand, and how fine its stages are."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np

from backsight.models.errors import InputError
from backsight.models.simulation.phases import Phases
from backsight.ocp.moving.belief import Belief, Flow
from backsight.ocp.moving.stage import Stage

from ..problem import Free, Problem
from ..recordings.recording import Recording
from ..smoothing.horizons import output_stds
from .driven import Driven
from .hypotheses import Moving, Phase, edges

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

WIDE = 2.0  # prior of a parameter of which only a guess is given, over that guess, as in `estimator.py`
UNKNOWN = 10.0  # prior of a state of which nothing is known, over its nominal size: hypotheses are compared by what they predict
DEGREE = 2  # of the polynomials in a stage
FINEST, ACCURATE = 16, 0.1  # stages between two samples at most; what they may miss, over the noise
LOOKED_AT = 40  # rows where that is judged


@dataclass(frozen=True)
class PhaseModels:
    """Of a problem as it is posed, all its weights given; places without one have no residual force."""

    posed: Problem
    _made: dict[Phase, Moving] = field(default_factory=dict, repr=False)

    @cached_property
    def phases(self) -> Phases:
        """The laws. Raises InputError where there are none."""
        found = Phases(self.posed.dae, self.posed.values)
        if not found.names:
            raise InputError(f"PhaseEstimator: {self.posed.dae.name} has no friction law that sticks; Estimator follows it.")
        return found

    @cached_property
    def soft(self) -> tuple[int, ...]:
        """Places with a residual force."""
        return tuple(k for k, place in enumerate(self.posed.dae.places) if place.name in self.posed.weights.W)

    @cached_property
    def force_std(self) -> Array:
        """Of the residual forces, (n_soft,)."""
        return np.array([self.posed.weights.W[self.posed.dae.places[k].name] for k in self.soft])

    @cached_property
    def scales(self) -> Array:
        """One over the deviations of the outputs, (ny,); zero for those that are not recorded. Raises InputError for an accelerometer."""
        posed, stage = self.posed, self.moving(tuple(0 for _ in self.phases.names)).flow.stage
        stds = output_stds(posed)[0][0]
        at_once = [q.name for i, q in enumerate(posed.dae.outputs) if i not in stage.prompt and q.name in stds]
        if at_once:
            raise InputError(f"PhaseEstimator: output {at_once[0]!r} reads a force at once, which jumps with the phase; leave it out.")
        return np.array([1.0 / stds[q.name] if q.name in stds else 0.0 for q in posed.dae.outputs])

    def moving(self, phase: Phase) -> Moving:
        """The model in a phase, made when it is first asked for."""
        if phase not in self._made:
            posed, within = self.posed, self.phases.within(phase)
            stage = Stage(within.dae, posed.free, posed.values, self.soft, DEGREE)
            bounds = np.array([posed.parameter_range(i) for i in posed.free]).reshape(-1, 2)
            flow = Flow(stage, within.margins, bounds, self.force_std / np.sqrt(posed.fitted[0].sampling))
            self._made[phase] = Moving(flow, within.of, within.beyond)
        return self._made[phase]

    @cached_property
    def sliding(self) -> Flow:
        """All laws slide forwards; its margins are their velocities."""
        return self.moving(tuple(1 for _ in self.phases.names)).flow

    def first(self) -> Belief:
        """What is known of [x; p] before the first sample."""
        posed, states = self.posed, self.posed.dae.states
        known = [(0.0, 0.0)] * len(states)
        for i, q in enumerate(states):
            if q.name in posed.start:
                known[i] = posed.start[q.name].value, posed.start[q.name].std
            elif q.name in posed.varying:
                known[i] = _guessed(posed.varying[q.name], q.nominal)
            else:
                known[i] = q.start, UNKNOWN * q.nominal
        for info in (posed.dae.parameters[i] for i in posed.free):
            given = posed.parameters[info.name]
            known.append(_guessed(given, info.nominal) if isinstance(given, Free) else (float(given), 0.0))
        mean, std = np.array(known).T
        return Belief(mean=mean, root=np.diag(std))

    def resting(self, belief: Belief, phase: Phase) -> Belief:
        """With the velocities of the laws that stick at zero."""
        for k in (k for k, s in enumerate(phase) if s == 0):
            here = self.sliding.at(belief, np.zeros(len(self.posed.dae.inputs)), 0.0)
            belief = belief.reshaped(here.J[k], -float(here.g[k]), 0.0)
        return belief

    def numbers(self, driven: Driven, start: float, end: float) -> Array:
        """Of a stage between two times [s]."""
        nothing = np.zeros(len(self.posed.dae.outputs))
        return np.concatenate([[end - start, start], driven.over(start, end), nothing, 1 / self.force_std, nothing])

    def stages(self, recording: Recording) -> int:
        """Stages between two samples with which no output is wrong by more than ACCURATE of its noise, all laws sliding."""
        dae, rows = self.posed.dae, min(LOOKED_AT, len(recording.time) - 1)
        driven, time = Driven(len(dae.inputs), recording.hold), recording.time[: rows + 1].tolist()
        for k, t in enumerate(time):
            driven.put(t, np.array([recording.inputs[q.name][k] for q in dae.inputs]))
        x, p = np.split(self.first().mean, [len(dae.states)])
        nothing = np.zeros(len(dae.inputs) + len(dae.outputs))

        def read(count: int) -> Array:
            found, now = [], x
            for start, end in pairwise(time):
                for a, b in edges(start, end, count):
                    now = self.sliding.end(now, p, self.numbers(driven, a, b))
                found.append(self.sliding.outputs(now, p, np.concatenate([[end], nothing, self.scales])))
            return np.array(found)

        count, coarse = 1, read(1)
        while count < FINEST:
            fine = read(2 * count)
            if np.abs(fine - coarse).max(initial=0.0) <= ACCURATE:
                break
            count, coarse = 2 * count, fine
        return count


def _guessed(given: Free, nominal: float) -> tuple[float, float]:
    """First value and its deviation."""
    return given.guess, given.std or WIDE * (abs(given.guess) or nominal)
