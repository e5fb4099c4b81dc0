"""When an effect acts: from the start, or from some time on.

The columns of a candidate are those of its rows. With the rows from a time on alone, the score asks what the effect would gain if it acted
from there on and not before. What acts so is a candidate of its own (`Candidate.since`): its parameter may be one that the model has, and
estimates, so that all along it would gain nothing; or it may be seen as something else if it has to act all along.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...recordings.recording import Recording
from .score import Columns, Linearised
from .screen import Screened, gain, only_scale, plainly
from .supermodel import Look

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

Span = tuple[float, float | None]  # from when until when something acts [s]; None: to the end

ONSETS = 24  # times that are looked at
FINER = 17  # and then about the best of these
RATES = (0.03, 1.5, 5.0, 15.0, 50.0)  # of what changes little by little, times the time that was recorded
EDGE = 0.04  # of the recording: what starts before that starts with it
SETTING_IN = frozenset(
    ("coulomb_friction", "viscous_friction", "constant_force", "added_mass", "input_gain", "input_offset", "sensor_gain", "sensor_bias")
)


def clocks_notes(recordings: Sequence[Recording]) -> list[str]:
    """What setting in means, where recordings have each a clock of its own; nothing where they follow each other."""
    spans = sorted((float(piece.time[0]), float(piece.time[-1])) for r in recordings for piece in r.pieces)
    if not any(later[0] < earlier[1] for earlier, later in pairwise(spans)):
        return []
    return [
        "The times of the recordings overlap: what sets in was sought at the same time of each. For what sets in once and stays, give "
        "times that run on from one recording to the next."
    ]


def _joined(spans: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """What is covered by any of them, in order."""
    first, *rest = sorted(spans)
    out = [first]
    for begin, end in rest:
        if begin <= out[-1][1]:
            out[-1] = (out[-1][0], max(end, out[-1][1]))
        else:
            out.append((begin, end))
    return tuple(out)


def late(base: Linearised, looks: Sequence[Look], changing: Sequence[Look] = ()) -> Iterator[Look]:
    """What sets in of the effects that are looked at, and the parameters that may change, at a row of times and little by little."""
    clock = _Clock.of(base)
    told = _told(base, clock, changing)
    for look in (*(look for look in looks if look.candidate.physics in SETTING_IN), *told):
        for time in clock.grid:
            since = look.candidate.since(time)
            if since is not None:
                yield Look(candidate=since, shape=look.shape, columns=clock.during(look.columns, time), whole=look)
        if look.candidate.change:
            yield from _slowly(clock, look)


def _slowly(clock: _Clock, look: Look) -> Iterator[Look]:
    """A parameter that changes little by little over all that was recorded, at several rates."""
    candidate = look.candidate.slowly(clock.low, clock.high, clock.span)
    for rate in (times / clock.span for times in RATES):
        shape = {change.rate: rate for change in candidate.changes}
        yield Look(candidate=candidate, shape=look.shape | shape, columns=clock.slowly(look.columns, rate), whole=look)


def _told(base: Linearised, clock: _Clock, changing: Sequence[Look]) -> list[Look]:
    """Those whose parameter does more, from the middle of the recordings on, than scale what residual forces do from then on."""
    if not changing:
        return []
    half = clock.grid[len(clock.grid) // 2]
    scaling = only_scale(base, [clock.during(look.columns, half) for look in changing], clock.during(base.residual_forces, half))
    return [look for look, scales in zip(changing, scaling, strict=True) if not scales]


def dated(base: Linearised, found: Screened) -> Screened:
    """With the times when it sets in, and ends, found more closely; as it is if it acts all along."""
    clock, whole, onset = _Clock.of(base), found.look.whole, found.candidate.onset
    if whole is None or onset is None:
        return found
    span, most = (onset, found.candidate.until), found.gain
    for spans in (clock.begun_about, clock.ended_about):
        times = spans(span, clock.step)
        if times:
            there, gains = clock.best(base, whole.columns, times)
            span, most = (there, gains) if gains > most else (span, most)
    since = whole.candidate.since(*span)
    if since is None or most <= found.gain:
        return found
    columns = clock.during(whole.columns, *span)
    at = base.scores(columns)
    estimate = np.asarray(np.linalg.lstsq(at.G, -at.b, rcond=None)[0], dtype=np.float64)
    look = replace(found.look, candidate=since, columns=columns)
    return replace(found, look=look, gain=most, estimate=estimate, origin=found.origin or found)


def moved(base: Linearised, whole: Look, strengths: Array, span: Span) -> tuple[Span, float]:
    """When an effect sets in, and ends, that a fit has in a span, and what that gains beside it [nats], with these strengths.

    base: of the fit; whole: a look there at the same effect acting all along.
    """
    clock = _Clock.of(base)
    had, best, most = clock.during(whole.columns, *span), span, 0.0
    for step in (clock.step, clock.step / (FINER - 1)):
        for about in (clock.begun_about, clock.ended_about):
            spans = about(best, step)
            if not spans:
                continue
            parts = [clock.during(whole.columns, *one).less(had).times(strengths) for one in spans]
            scores = base.scores(Columns.joined(parts))
            gains = -scores.b - np.diag(scores.G) / 2
            k = int(np.argmax(gains))
            if gains[k] > most:
                best, most = spans[k], float(gains[k])
    return best, most


def onset(base: Linearised, found: Screened) -> float | None:
    """The time from which on it acts [s]; None from the start.

    Of what might set in as a candidate of its own, what that says; of others, what their score says.
    """
    if found.candidate.physics in SETTING_IN or found.candidate.changes:
        return found.candidate.onset
    clock = _Clock.of(base)
    first, _ = clock.best(base, found.look.columns, [(time, None) for time in clock.grid])
    (time, _), most = clock.best(base, found.look.columns, clock.begun_about(first, clock.step))
    return time if plainly(most, found.gain) and time > clock.low + EDGE * clock.span else None


@dataclass(frozen=True, kw_only=True, eq=False)
class _Clock:
    """Time of every row of the squares, and of those with multipliers; stretches: of time that was recorded, in order [s].

    It is the model's: of recordings that have each a clock of its own what sets in does so at the same time of each.
    """

    squares: Array
    multiplied: Array
    stretches: tuple[tuple[float, float], ...]

    @classmethod
    def of(cls, base: Linearised) -> _Clock:
        t = base.solution.transcription
        starts = np.concatenate([h.clock + h.mesh.knots[:-1] for h in t.horizons])
        squares, multiplied = [np.empty(0)], [np.empty(0)]
        for term in t.nlp.terms:
            at = starts[term.interval]
            if term.tau is not None:
                at = at + term.tau * t.nlp.steps[term.interval]
            elif term.nodes is not None:
                at = at + t.nlp.steps[term.interval] / 2
            (multiplied if term.equality or term.heavy else squares).append(np.repeat(at, term.target.shape[0]))
        recorded = _joined([(float(h.clock + h.time[0]), float(h.clock + h.time[-1])) for h in t.horizons])
        return cls(squares=np.concatenate(squares), multiplied=np.concatenate(multiplied), stretches=recorded)

    @property
    def low(self) -> float:
        """Of the first sample [s]."""
        return self.stretches[0][0]

    @property
    def high(self) -> float:
        """Of the last sample [s]."""
        return self.stretches[-1][1]

    @property
    def span(self) -> float:
        """What was recorded altogether [s]."""
        return sum(end - begin for begin, end in self.stretches)

    @property
    def step(self) -> float:
        """Between two times that are looked at first [s]."""
        return self.span / (ONSETS + 1)

    @property
    def grid(self) -> list[float]:
        """Times that are looked at first: one after every step of what was recorded, and the end of every pause that is longer than one."""
        ended = np.cumsum([0.0, *(end - begin for begin, end in self.stretches)])
        passed = self.step * np.arange(1, ONSETS + 1)
        within = np.searchsorted(ended, passed, side="right") - 1
        evenly = [self.stretches[k][0] + float(time - ended[k]) for k, time in zip(within, passed, strict=True)]
        return sorted([*evenly, *(later[0] for earlier, later in pairwise(self.stretches) if later[0] - earlier[1] > self.step)])

    def begun_about(self, span: Span, step: float) -> list[Span]:
        """Spans that begin about as one does, a step before to a step after it [s]."""
        since, until = span
        return [(time, until) for time in self._about(since, step) if until is None or time < until]

    def ended_about(self, span: Span, step: float) -> list[Span]:
        """Spans that end about as one does; none of what does not end."""
        since, until = span
        return [] if until is None else [(since, time) for time in self._about(until, step) if time > since]

    def _about(self, time: float, step: float) -> list[float]:
        return [time + step * (2 * k / (FINER - 1) - 1) for k in range(FINER)]

    def during(self, columns: Columns, since: float, until: float | None = None) -> Columns:
        """Of what acts from a time on, or until another."""

        def acting(times: Array) -> Array:
            return np.asarray((times >= since) & (times < (np.inf if until is None else until)), dtype=float)[:, None]

        return Columns(squares=columns.squares * acting(self.squares), multiplied=columns.multiplied * acting(self.multiplied))

    def slowly(self, columns: Columns, rate: float) -> Columns:
        """Of what changes little by little from the first to the last sample, at a rate [1/s] (`Model.changing`)."""

        def grown(times: Array) -> Array:
            passed = np.clip(times - self.low, 0.0, None)
            return np.asarray(np.expm1(-rate * passed) / np.expm1(-rate * (self.high - self.low)))[:, None]

        return Columns(squares=columns.squares * grown(self.squares), multiplied=columns.multiplied * grown(self.multiplied))

    def best(self, base: Linearised, columns: Columns, spans: Sequence[Span]) -> tuple[Span, float]:
        """The span of these in which an effect gains most, and how much."""
        scores, n = base.scores(Columns.joined([self.during(columns, *span) for span in spans])), len(columns)
        gains = [gain(scores, range(k * n, (k + 1) * n)) for k in range(len(spans))]
        k = int(np.argmax(gains))
        return spans[k], gains[k]
