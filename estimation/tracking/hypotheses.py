"""Hypotheses on what the friction laws of a model have done: a phase for each, what is known of the state under it, and how likely it is.

A law stays in its phase while its margins g are positive (`models/simulation/phases.py`): the velocity of a body that slides, what is
left of the breakaway level of one that is held. Over an interval the estimate of a margin falls, and a part of its Gaussian ends
(`cut.py`). That part is cut out and goes on in the other phase from the mean instant; the rest stays. Both are Gaussians again, of the
same mean and variance as the parts (truncation: D. Simon & D. L. Simon, Int. J. Systems Science 41, 2010), so that an event which may
happen any time says much about the state and the parameters when it does, and one that must happen says nothing; that the instant is not
known becomes a deviation of the state (`Belief.switched`). Residual forces move a margin in every interval anew: breakaway is not at a
sharp level.

Hypotheses with the same changes in the last LATELY samples become one Gaussian (the generalised pseudo-Bayesian estimator of that order:
Y. Bar-Shalom, X.-R. Li & T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 11.6.3).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from backsight.ocp.moving.belief import Belief, Flow, triangular_root

from .cut import LEAST, SMALLEST, Cut

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Phase = tuple[int, ...]

MASS = 1e-4  # of the likeliest hypothesis: what is less is not followed; an event is that rare once in some minutes at 20 Hz
LATELY = 10  # samples; a change has shown in the outputs by then, or its instant matters no more
MEMORY = 100  # changes of a hypothesis that are kept
CHANGES = 4  # of a hypothesis within a sampling interval, at most: sampled data tell nothing of more
EVEN = np.sqrt(12.0)  # width of an even distribution over its deviation


class Moving(NamedTuple):
    """A model in a phase; margin i is of law of[i], which then goes on the way beyond[i] (`InPhase`)."""

    flow: Flow
    of: tuple[int, ...]
    beyond: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """Phases of all laws now, with the logarithm of its probability; changes: time [s] and the phase from then on, the latest last."""

    phase: Phase
    belief: Belief
    weight: float
    changes: tuple[tuple[float, Phase], ...]

    def phase_at(self, time: float) -> Phase:
        """Of all laws at a time since the first of the changes that are kept."""
        return next((phase for start, phase in reversed(self.changes) if start <= time), self.changes[0][1])

    def since(self, law: int, time: float) -> float:
        """When a law entered the phase that it has at a time; -inf if it has not been seen to."""
        now, since = self.phase_at(time)[law], -np.inf
        for start, phase in reversed(self.changes):
            if start <= time:
                if phase[law] != now:
                    break
                since = start
        return float(since)


@dataclass(frozen=True, kw_only=True)
class Interval:
    """Between two samples: numbers of the stages from a time to another, and the input (nu,) just before a time.

    before: the input that acted just before the start; `input` says there what acts just after it.
    """

    start: float
    end: float
    before: Array
    stages: Callable[[float, float], Sequence[Array]]
    input: Callable[[float], Array]

    @cached_property
    def whole(self) -> Sequence[Array]:
        """Numbers from start to end, which every hypothesis begins with."""
        return self.stages(self.start, self.end)


class Bank:
    """At most `keep` hypotheses; sampling: the usual interval [s]."""

    def __init__(self, model: Callable[[Phase], Moving], keep: int, sampling: float) -> None:
        self._model, self.keep, self._sampling = model, keep, sampling
        self.hypotheses: list[Hypothesis] = []

    def move(self, interval: Interval) -> None:
        """Over an interval, with all that may happen in it."""
        found, waiting = list[Hypothesis](), [(h, interval.start) for h in self.hypotheses]
        while waiting:
            stayed, left = self._followed(*waiting.pop(), interval)
            found += stayed
            waiting += left
        self.hypotheses = self._pruned(found, interval.end)

    def sampled(self, newest: Array) -> None:
        """After a sample with the numbers `newest`, time first."""
        after = []
        for h in self.hypotheses:
            belief, likelihood = self._model(h.phase).flow.sampled(h.belief, newest)
            after.append(replace(h, belief=belief, weight=h.weight + likelihood))
        self.hypotheses = self._pruned(after, float(newest[0]))

    def _pruned(self, hypotheses: list[Hypothesis], now: float) -> list[Hypothesis]:
        """The likeliest, the likeliest first, after those that agree in what happened lately have become one."""
        alike: dict[object, list[Hypothesis]] = {}
        for h in hypotheses:
            recent = [(int(at / self._sampling), phase) for at, phase in h.changes if at > now - LATELY * self._sampling]
            alike.setdefault((h.phase, *recent), []).append(h)
        likely = sorted((merged(group) for group in alike.values()), key=lambda h: -h.weight)
        kept = [h for h in likely[: self.keep] if h.weight >= np.log(MASS) + likely[0].weight]
        total = np.logaddexp.reduce([h.weight for h in kept])
        return [replace(h, weight=float(h.weight - total)) for h in kept]

    def _followed(self, h: Hypothesis, time: float, interval: Interval) -> tuple[list[Hypothesis], list[tuple[Hypothesis, float]]]:
        """The hypothesis at the end, if it may stay in its phase until then, and those that leave it before."""
        flow, of, beyond = self._model(h.phase)
        end = _moved(flow, h.belief, time, interval.end, interval)
        first, last = flow.at(h.belief, interval.input(time), time), flow.at(end, interval.input(interval.end), interval.end)
        jump = np.zeros(len(of))
        if time == interval.start and 0 in h.phase:  # what holds a body steps with the input
            after, first = first, flow.at(h.belief, interval.before, time)
            jump = first.g - after.g
        stays, left = h.weight, list[tuple[Hypothesis, float]]()
        for i in range(len(of)) if sum(at > interval.start for at, _ in h.changes) < CHANGES else ():
            fall, std, noise = float(first.g[i] - last.g[i]), float(last.std[i]), float(last.noise[i])
            cut = Cut(margin=float(first.g[i]), fall=fall, std=std, noise=noise, jump=float(jump[i]))
            if cut.mass >= MASS:
                left += self._left(replace(h, weight=stays + np.log(cut.mass)), time, interval, i, cut, fall, beyond[i])
                stays += np.log(max(1.0 - cut.mass, LEAST * MASS))
                end = end.reshaped(last.J[i], *cut.rest())
        return [replace(h, belief=end, weight=stays)] if stays >= h.weight + np.log(MASS) else [], left

    def _left(
        self, h: Hypothesis, time: float, interval: Interval, i: int, cut: Cut, fall: float, beyond: int
    ) -> list[tuple[Hypothesis, float]]:
        """What follows when margin i ends, which falls so much until the end of the interval; the law then goes `beyond` or is held."""
        flow, of, _ = self._model(h.phase)
        law, span = of[i], interval.end - time
        at = time + cut.share * span
        u, here = interval.input(at), _moved(flow, h.belief, time, at, interval)
        old = flow.at(here, u, at)
        here = here.reshaped(old.J[i], *cut.ends(cut.left - float(old.g[i])))
        old = flow.at(here, u, at)
        rate = -max(fall, EVEN * float(old.std[i]), SMALLEST) / span  # what noise ended, did so within the interval

        def into(s: int) -> tuple[Hypothesis, float]:
            """The law in its phase s, and the probability that its margins allow that."""
            phase = (*h.phase[:law], s, *h.phase[law + 1 :])
            other, of_other, _ = self._model(phase)
            new = other.at(here, u, at)
            belief, allowed = here.switched(new.rate - old.rate, old.J[i], rate), 1.0
            if s == 0:
                belief = belief.reshaped(old.J[i], 0.0, 0.0)
                shares = [ndtr(g / std) if std else float(g > 0) for g, std, k in zip(new.g, new.std, of_other, strict=True) if k == law]
                allowed = float(np.prod(shares))
            return replace(h, phase=phase, belief=belief, changes=(*h.changes[-MEMORY:], (at, phase))), allowed

        slides, _ = into(beyond)
        if h.phase[law] == 0:
            return [(slides, at)]
        rests, held = into(0)
        both = ((rests, held), (slides, 1.0 - held))
        return [(replace(other, weight=h.weight + np.log(m)), at) for other, m in both if m >= MASS]


def edges(start: float, end: float, count: int) -> list[tuple[float, float]]:
    """Equal parts of an interval."""
    return list(pairwise(np.linspace(start, end, count + 1).tolist()))


def _moved(flow: Flow, belief: Belief, start: float, end: float, interval: Interval) -> Belief:
    if end - start <= LEAST * (interval.end - interval.start):
        return belief
    for d in interval.whole if (start, end) == (interval.start, interval.end) else interval.stages(start, end):
        belief = flow.over(belief, d)
    return belief


def merged(group: list[Hypothesis]) -> Hypothesis:
    """One Gaussian of the same mean and variance, with the past of the likeliest."""
    best = max(group, key=lambda h: h.weight)
    if len(group) == 1:
        return best
    total = float(np.logaddexp.reduce([h.weight for h in group]))
    shares, beliefs = np.exp([h.weight - total for h in group]), [h.belief for h in group]
    mean = np.asarray(sum(w * b.mean for w, b in zip(shares, beliefs, strict=True)))
    columns = [np.sqrt(w) * np.column_stack([b.root, b.mean - mean]) for w, b in zip(shares, beliefs, strict=True)]
    return replace(best, belief=Belief(mean=mean, root=triangular_root(np.hstack(columns))), weight=total)
