"""Hypotheses on what the friction laws of a model have done: a phase for each, what is known of the state under it, and how likely it is.

A law stays in its phase while its margins g are positive (`models/simulation/phases.py`): the velocity of a body that slides, what is left
of the breakaway level of one that is held. Over an interval the estimate of a margin goes from N(g0, s0^2) to N(g1, s1^2), so that

    P(it ends within)   = [Phi(-g1/s1) - Phi(-g0/s0)] / Phi(g0/s0)

and it ends, on the average, where the margin would be zero that was in the middle of those that do. There the other hypothesis begins,
with g = 0 known exactly: this is what makes a filter that tells slip from stick sharp, more than the difference of their dynamics.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.special import logsumexp, ndtr

from backsight.ocp.moving.belief import Belief, Flow

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Phase = tuple[int, ...]

MASS = 1e-5  # probability below which an event is not followed: rarer than a sample in an hour at 20 Hz
LEAST = 1e-6  # of a sampling interval: shorter ones are not integrated
MEMORY = 100  # changes of a hypothesis that are kept
CHANGES = 4  # of a hypothesis within a sampling interval, at most: sampled data tell nothing of more


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """Phases of all laws now, and since when: (time [s], law) of past changes with the phase after them, the latest last."""

    phase: Phase
    belief: Belief
    weight: float  # logarithm of its probability
    changes: tuple[tuple[float, Phase], ...]
    just: int | None = None  # law that changed at the instant that the hypothesis stands at

    def phase_at(self, time: float) -> Phase:
        """Of all laws at a time since the first of the changes that are kept."""
        return next((phase for start, phase in reversed(self.changes) if start <= time), self.changes[0][1])


@dataclass(frozen=True, kw_only=True)
class Interval:
    """Between two samples: numbers of the stages from a time to another, and the input (nu,) just before a time.

    whole: the numbers from start to end, which every hypothesis begins with.
    """

    start: float
    end: float
    stages: Callable[[float, float], Sequence[Array]]
    input: Callable[[float], Array]

    @cached_property
    def whole(self) -> Sequence[Array]:
        return self.stages(self.start, self.end)


class Bank:
    """At most `keep` hypotheses; flow: phase -> the model in it, of, beyond: see `InPhase`."""

    def __init__(self, flow: Callable[[Phase], tuple[Flow, tuple[int, ...], tuple[int, ...]]], keep: int) -> None:
        self._flow, self.keep = flow, keep
        self.hypotheses: list[Hypothesis] = []

    def move(self, interval: Interval) -> None:
        """Over an interval, with all that may happen in it."""
        found, waiting = list[Hypothesis](), [(h, interval.start) for h in self.hypotheses]
        while waiting:
            h, time = waiting.pop()
            stayed, left = self._followed(h, time, interval)
            waiting += left
            if stayed is not None:
                found.append(stayed)
        self.hypotheses = found
        self._pruned()

    def sampled(self, newest: Array) -> None:
        """After a sample."""
        after = []
        for h in self.hypotheses:
            belief, likelihood = self._flow(h.phase)[0].sampled(h.belief, newest)
            after.append(replace(h, belief=belief, weight=h.weight + likelihood))
        self.hypotheses = after
        self._pruned()

    def _pruned(self) -> None:
        total = logsumexp([h.weight for h in self.hypotheses])
        likely = sorted((replace(h, weight=float(h.weight - total)) for h in self.hypotheses), key=lambda h: -h.weight)
        self.hypotheses = [h for h in likely[: self.keep] if h.weight >= np.log(MASS) + likely[0].weight]

    def _followed(self, h: Hypothesis, time: float, interval: Interval) -> tuple[Hypothesis | None, list[tuple[Hypothesis, float]]]:
        """The hypothesis at the end, if it may stay in its phase until then, and those that leave it before."""
        flow, of, beyond = self._flow(h.phase)
        end = self._moved(flow, h.belief, time, interval.end, interval)
        g0, _, s0 = flow.margins(h.belief, interval.input(time), time)
        g1, _, s1 = flow.margins(end, interval.input(interval.end), interval.end)
        stays, left = h.weight, list[tuple[Hypothesis, float]]()
        for i, law in enumerate(of):
            passed = 0.0 if h.just == law else float(ndtr(-g0[i] / s0[i]))
            mass = float(np.clip((ndtr(-g1[i] / s1[i]) - passed) / max(1.0 - passed, MASS), 0.0, 1.0))
            if mass < MASS or g1[i] >= g0[i] or sum(at > interval.start for at, _ in h.changes) >= CHANGES:
                continue
            share = _share(float(g0[i]), float(g0[i] - g1[i]), float(s1[i]))
            left += self._left(replace(h, weight=stays + np.log(mass)), time, interval, i, share, beyond[i])
            stays += np.log1p(-min(mass, 1.0 - 1e-15))
        stayed = replace(h, belief=end, weight=stays, just=None)
        return (stayed if stays >= h.weight + np.log(MASS) else None), left

    def _left(self, h: Hypothesis, time: float, interval: Interval, i: int, share: float, beyond: int) -> list[tuple[Hypothesis, float]]:
        """What follows when margin i ends after a share of the time until the end, where the law then goes `beyond` or is held."""
        flow, of, _ = self._flow(h.phase)
        law, at = of[i], time + share * (interval.end - time)
        here = self._moved(flow, h.belief, time, at, interval)
        g, J, _ = flow.margins(here, interval.input(at), at)
        belief = here.told(J[i : i + 1], g[i : i + 1], 0.0)[0]
        other = (*h.phase[:law], beyond, *h.phase[law + 1 :])
        if h.phase[law] == 0:
            return [(self._changed(h, other, belief, h.weight, at, law), at)]
        held = (*h.phase[:law], 0, *h.phase[law + 1 :])
        holding, of_held, _ = self._flow(held)
        room, _, std = holding.margins(belief, interval.input(at), at)
        holds = float(np.prod([ndtr(m / s) for m, s, k in zip(room, std, of_held, strict=True) if k == law]))
        both = [(held, holds, None), (other, 1.0 - holds, law)]
        return [(self._changed(h, phase, belief, h.weight + np.log(m), at, just), at) for phase, m, just in both if m >= MASS]

    @staticmethod
    def _changed(h: Hypothesis, phase: Phase, belief: Belief, weight: float, at: float, just: int | None) -> Hypothesis:
        return replace(h, phase=phase, belief=belief, weight=weight, changes=(*h.changes[-MEMORY:], (at, phase)), just=just)

    @staticmethod
    def _moved(flow: Flow, belief: Belief, start: float, end: float, interval: Interval) -> Known:
        if end - start <= LEAST * (interval.end - interval.start):
            return belief
        for d in interval.whole if (start, end) == (interval.start, interval.end) else interval.stages(start, end):
            belief = flow.over(belief, d)
        return belief


def _share(margin: float, fall: float, std: float) -> float:
    """Of an interval, after which a margin ends on the average: N(margin, std^2), of which what lies in (0, fall) ends within."""
    a, b = -margin / std, (fall - margin) / std
    mass = float(ndtr(b) - ndtr(a))
    middle = margin + std * float(np.exp(-a * a / 2) - np.exp(-b * b / 2)) / np.sqrt(2 * np.pi) / mass if mass > MASS else margin
    return float(np.clip(middle / fall, LEAST, 1.0))


def edges(start: float, end: float, count: int) -> list[tuple[float, float]]:
    """Equal parts of an interval."""
    return list(pairwise(np.linspace(start, end, count + 1).tolist()))
