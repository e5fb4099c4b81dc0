"""Hypotheses on what the friction laws of a model have done: a phase for each, what is known of the state under it, and how likely it is.

A law stays in its phase while its margins g are positive (`models/simulation/phases.py`): the velocity of a body that slides, what is left
of the breakaway level of one that is held. Over an interval the estimate of a margin falls from N(g0, s^2) to N(g1, s^2): those that began
between 0 and g0 - g1 end within it, which is a probability, a mean instant and a spread about it. That part of the Gaussian is cut out and
goes on in the other phase from the mean instant; the rest stays. Both are Gaussians again, of the same mean and variance as the parts
(truncation: D. Simon & D. L. Simon, Int. J. Systems Science 41, 2010), so that an event which may happen any time says what it says and one
that must happen says nothing; the spread about the instant becomes one of the state (`Belief.switched`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.special import logsumexp, ndtr, ndtri

from backsight.ocp.moving.belief import Belief, Flow

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Phase = tuple[int, ...]

SCAN = int(__import__("os").environ.get("SCAN","10"))
MASS = float(__import__("os").environ.get("MASS","1e-5"))  # probability below which an event is not followed: rarer than a sample in an hour at 20 Hz
SMALLEST = 1e-200  # probability that a floating-point number still tells from none, with its square
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

    def __init__(self, flow: Callable[[Phase], tuple[Flow, tuple[int, ...], tuple[int, ...]]], keep: int, sampling: float) -> None:
        self._flow, self.keep, self.lately = flow, keep, SCAN * sampling
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
        self._pruned(interval.end)

    def sampled(self, newest: Array) -> None:
        """After a sample."""
        after = []
        for h in self.hypotheses:
            belief, likelihood = self._flow(h.phase)[0].sampled(h.belief, newest)
            after.append(replace(h, belief=belief, weight=h.weight + likelihood))
        self.hypotheses = after
        self._pruned(float(newest[0]))

    def _pruned(self, now: float) -> None:
        """The likeliest, after those that agree in what happened lately have become one."""
        alike: dict[tuple[object, ...], list[Hypothesis]] = {}
        for h in self.hypotheses:
            recent = tuple((int(at / self.lately * SCAN), phase) for at, phase in h.changes if at > now - self.lately)
            alike.setdefault((h.phase, h.just, recent), []).append(h)
        merged = sorted((_merged(group) for group in alike.values()), key=lambda h: -h.weight)
        kept = [h for h in merged[: self.keep] if h.weight >= np.log(MASS) + merged[0].weight]
        total = logsumexp([h.weight for h in kept])
        self.hypotheses = [replace(h, weight=float(h.weight - total)) for h in kept]

    def _followed(self, h: Hypothesis, time: float, interval: Interval) -> tuple[Hypothesis | None, list[tuple[Hypothesis, float]]]:
        """The hypothesis at the end, if it may stay in its phase until then, and those that leave it before."""
        flow, of, beyond = self._flow(h.phase)
        end = self._moved(flow, h.belief, time, interval.end, interval)
        start, stop = flow.at(h.belief, interval.input(time), time), flow.at(end, interval.input(interval.end), interval.end)
        stays, left = h.weight, list[tuple[Hypothesis, float]]()
        many = sum(at > interval.start for at, _ in h.changes) >= CHANGES
        for i, law in enumerate(of):
            fall = float(start.g[i] - stop.g[i])
            if many or fall <= 0.0:
                continue
            cut = Cut(float(start.g[i]), fall, float(stop.std[i]), float(stop.noise[i]))
            mass = cut.mass
            if mass < MASS:
                continue
            left += self._left(replace(h, weight=stays + np.log(mass)), time, interval, i, cut, beyond[i])
            stays += np.log1p(-min(mass, 1.0 - 1e-15))
            end = end.reshaped(stop.J[i], *cut.rest()) if mass < 1.0 - MASS else end
        stayed = replace(h, belief=end, weight=stays, just=None)
        return (stayed if stays >= h.weight + np.log(MASS) else None), left

    def _left(self, h: Hypothesis, time: float, interval: Interval, i: int, cut: Cut, beyond: int) -> list[tuple[Hypothesis, float]]:
        """What follows when margin i ends on the way to the end of the interval; the law then goes `beyond` or is held."""
        flow, of, _ = self._flow(h.phase)
        law, span = of[i], interval.end - time
        at, rate = time + cut.share * span, -cut.fall / span
        here = self._moved(flow, h.belief, time, at, interval)
        u = interval.input(at)
        instant = flow.at(here, u, at)
        here = here.reshaped(instant.J[i], *cut.ends(-float(instant.g[i])))
        old = flow.at(here, u, at)

        def into(s: int) -> tuple[Phase, Belief, float]:
            """The phase, what is known in it, and the probability that its margins allow it."""
            phase = (*h.phase[:law], s, *h.phase[law + 1 :])
            other, of_other, _ = self._flow(phase)
            new = other.at(here, u, at)
            belief = here.switched(new.rate - old.rate, old.J[i], rate)
            if s:
                return phase, belief, 1.0
            holds = [ndtr(m / std) if std else float(m > 0) for m, std, k in zip(new.g, new.std, of_other, strict=True) if k == law]
            return phase, belief.reshaped(old.J[i], 0.0, 0.0), float(np.prod(holds))

        through, slides, _ = into(beyond)
        if h.phase[law] == 0:
            return [(self._changed(h, through, slides, h.weight, at, law), at)]
        held, rests, holds = into(0)
        both = [(held, rests, holds, None), (through, slides, 1.0 - holds, law)]
        return [(self._changed(h, phase, belief, h.weight + np.log(m), at, just), at) for phase, belief, m, just in both if m >= MASS]

    @staticmethod
    def _changed(h: Hypothesis, phase: Phase, belief: Belief, weight: float, at: float, just: int | None) -> Hypothesis:
        return replace(h, phase=phase, belief=belief, weight=weight, changes=(*h.changes[-MEMORY:], (at, phase)), just=just)

    @staticmethod
    def _moved(flow: Flow, belief: Belief, start: float, end: float, interval: Interval) -> Belief:
        if end - start <= LEAST * (interval.end - interval.start):
            return belief
        for d in interval.whole if (start, end) == (interval.start, interval.end) else interval.stages(start, end):
            belief = flow.over(belief, d)
        return belief


def _merged(group: list[Hypothesis]) -> Hypothesis:
    """One Gaussian of the same mean and variance, with the past of the likeliest."""
    best = max(group, key=lambda h: h.weight)
    if len(group) == 1:
        return best
    total = float(logsumexp([h.weight for h in group]))
    shares = np.exp([h.weight - total for h in group])
    mean = np.asarray(sum(w * h.belief.mean for w, h in zip(shares, group, strict=True)))
    columns = [np.sqrt(w) * np.column_stack([h.belief.root, h.belief.mean - mean]) for w, h in zip(shares, group, strict=True)]
    root = np.linalg.qr(np.column_stack(columns).T, mode="r").T
    return replace(best, belief=Belief(mean=mean, root=root), weight=total)


class Cut:
    """Of a margin that begins as N(margin, std^2 + noise^2) and falls by `fall`, those that end.

    They began below `fall`, and not where the margin had ended before: below zero, if there is no noise; anywhere, if all is noise, which
    is another one in every interval. mass: their probability; share: of the interval, after which they end on the average.
    """

    def __init__(self, margin: float, fall: float, std: float, noise: float) -> None:
        self._std = max(std, LEAST * fall)
        self.fall, self._whole = fall, float(np.hypot(self._std, noise))
        a, b = -margin / self._whole, (fall - margin) / self._whole
        a = float(ndtri((self._std / self._whole) ** 2 * ndtr(a))) if noise else a
        part, lasted = (float(ndtr(b) - ndtr(a)) if a < 0 else float(ndtr(-a) - ndtr(-b))), float(ndtr(-a))
        self.mass = part / lasted if lasted > SMALLEST else 1.0
        if part < SMALLEST:
            self.mass, self.share, self._mean, self._square = round(self.mass), LEAST, 0.0, 1.0
            self._part = 0.0
            return
        at_a, at_b = (np.exp(-(e**2) / 2) / np.sqrt(2 * np.pi) for e in (a, b))
        self._mean = float(at_a - at_b) / part  # and mean square of those that end, from `margin` and over the deviation of all
        self._square = 1.0 + float((a * at_a if np.isfinite(a) else 0.0) - b * at_b) / part
        self._part = part
        self.share = float(np.clip((margin + self._whole * self._mean) / fall, LEAST, 1.0))

    def ends(self, move: float) -> tuple[float, float]:
        """How far the mean of the margin without noise moves, and the ratio of its deviations, for those that end; `move` with noise."""
        return self._without(move, self._square - self._mean**2)

    def rest(self) -> tuple[float, float]:
        """The same for those that do not end."""
        left = max(1.0 - self._part, MASS)
        mean = -self._mean * self._part / left
        return self._without(self._whole * mean, (1.0 - self._part * self._square) / left - mean**2)

    def _without(self, move: float, variance: float) -> tuple[float, float]:
        """Of a sum of which the variance becomes a part of what it was, the summand that has the variance std^2."""
        part = float((self._std / self._whole) ** 2)
        return part * move, float(np.sqrt(np.clip(1.0 - part * (1.0 - variance), 0.0, 1.0)))


def edges(start: float, end: float, count: int) -> list[tuple[float, float]]:
    """Equal parts of an interval."""
    return list(pairwise(np.linspace(start, end, count + 1).tolist()))
