"""The library of what inputs and sensors may do: gains, offsets, drifts, lags, delays, limits, dead zones, sensors that are turned.

Gains, offsets and drifts are blocks that are linear in their strength. Of the others the score is that of the difference they make to the
recorded input or to the smoothed output, on a grid of their shape.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from backsight.models import Model
from backsight.models.language import Component
from backsight.models.model import Output
from backsight.models.signals import DeadZone, Delay, Drift, Gain, Lag, Offset, PeriodicError, Rotation, Saturation, Sum

from .candidate import Candidate, Signal
from .edits import Alike, Insert, Rebuild
from .places import free_name

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Changes = Sequence[tuple[float, Callable[[Array, Array], Array]]]

TIMES = 14  # lags and delays looked at
SHORTEST = 0.25  # of a sampling interval: the shortest
BEYOND = 3.0  # times the longest of them: where a fit ends
LONGEST = 0.05  # of a recording: the longest of them
LIMITS = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)  # of the largest input: where it may be cut off
ZONES = (0.003, 0.01, 0.03, 0.06, 0.1, 0.2)  # of the rms input: where it may have no effect
GAINS = (0.2, 5.0)
TURN = 0.5  # rad: a sensor that is turned further is mounted otherwise
ORDERS = range(2, 9)  # waves a turn of what teeth or a disk do
OFF_CENTRE = 0.3  # of a disk's or a wheel's radius: an axis that is further off is another machine's


def lagged(time: Array, values: Array, tau: float, held: bool = True) -> Array:
    """tau y' = u - y, y(0) = u(0), of a value that is held from row to row, as its mean there; of one that is not, at the rows."""
    step = np.diff(time, append=2 * time[-1] - time[-2])
    if np.ptp(step) < 1e-3 * step.mean():
        a = float(np.exp(-step.mean() / tau))
        at_rows = lfilter([0.0, 1 - a], [1.0, -a], values, zi=[values[0] * 1.0])[0] if held else _followed(values, a)
    else:
        at_rows = np.empty_like(values)
        now, until = values[0], values if held else (values + np.append(values[1:], values[-1])) / 2
        for k, (u, h) in enumerate(zip(until, step, strict=True)):
            at_rows[k] = now
            now = u + (now - u) * np.exp(-h / tau)
    if not held:
        return np.asarray(at_rows)
    share = tau / step * (1 - np.exp(-step / tau))
    return np.asarray(values + (at_rows - values) * share)


def _followed(values: Array, a: float) -> Array:
    return np.asarray(lfilter([(1 - a) / 2, (1 - a) / 2], [1.0, -a], values, zi=[values[0] * (1 - (1 - a) / 2)])[0])


def late(time: Array, values: Array, delay: float, held: bool = True) -> Array:
    """The value a delay before: of one that is held from row to row its mean over the row."""
    if not held:
        return np.asarray(np.interp(time - delay, time, values))
    step = np.diff(time, append=2 * time[-1] - time[-2])
    integral = np.concatenate([[0.0], np.cumsum(values * step)])
    edges = np.append(time, time[-1] + step[-1])

    def until(t: Array) -> Array:
        return np.asarray(np.interp(t, edges, integral) + np.minimum(t - edges[0], 0.0) * values[0])

    return np.asarray((until(edges[1:] - delay) - until(edges[:-1] - delay)) / step)


@dataclass(frozen=True, kw_only=True)
class _Channel:
    """An input or a sensor: its place, the family of what it may do, and the beginning of the names of that."""

    model: Model
    place: str
    family: str
    word: str

    def name(self, fault: str) -> str:
        """Of a block."""
        return free_name(self.model, f"{self.word}_{fault}_{self.place.partition(':')[2]}")

    def linear(self, fault: str, block: Component, parameter: str, start: tuple[float, float, float] | None = None) -> Candidate:
        """A block that is linear in a parameter."""
        path, candidate = self._block(fault, block, parameter)
        return replace(candidate, strengths=(path,), start={path: start} if start else {})

    def shaped(self, fault: str, block: Component, parameter: str, start: tuple[float, float, float], grid: Changes) -> Candidate:
        """A block that is not: value of its parameter -> what would be read with it."""
        path, candidate = self._block(fault, block, parameter)
        signals = tuple(Signal(of=(self.place,), changed=changed, start={path: value}) for value, changed in grid)
        return replace(candidate, start={path: start}, signals=signals)

    def _block(self, fault: str, block: Component, parameter: str) -> tuple[str, Candidate]:
        """A block in the channel: the path of its parameter, and what they all have."""
        name = self.name(fault)
        path = f"{name}.{parameter}"
        edits = (Insert(place=self.place, component=block, name=name),)
        return path, Candidate(place=self.place, family=self.family, physics=f"{self.word}_{fault}", edits=edits, named={parameter: path})

    def turned(self) -> Candidate:
        """An angle read from a disk that is not centred."""
        return self._waving("eccentricity", "eccentricity", PeriodicError())

    def uneven(self, order: int) -> Candidate:
        """An angle read from a disk, or over teeth, that are uneven so many times a turn."""
        candidate = self._waving(f"wave_{order}", "kinematic_error", PeriodicError(period=2 * np.pi / order))
        return replace(candidate, named={**candidate.named, "period": f"{candidate.strengths[0].rpartition('.')[0]}.period"})

    def _waving(self, fault: str, physics: str, block: PeriodicError) -> Candidate:
        path, candidate = self._block(fault, block, "amplitude")
        phase, most = f"{path.rpartition('.')[0]}.phase", OFF_CENTRE * block.parameters.get("period", 2 * np.pi) / (2 * np.pi)
        return replace(
            candidate,
            physics=physics,
            strengths=(path,),
            quadrature=phase,
            start={path: (0.0, -most, most), phase: (0.0, -3 * np.pi, 3 * np.pi)},
            named={"amplitude": path, "phase": phase},
        )

    def slow(self, interval: float, duration: float, held: bool) -> list[Candidate]:
        """Lag and delay; held: whether values are held from row to row."""
        times, start = _times(interval, duration)
        return [
            self.shaped("lag", Lag(tau=interval), "tau", _of_lag(start), [(t, _by(lagged, t, held)) for t in times]),
            self.shaped("delay", Delay(delay=interval), "delay", start, [(t, _by(late, t, held)) for t in times]),
        ]


def of_input(model: Model, name: str, values: Sequence[Array], interval: float, duration: float) -> list[Candidate]:
    """What the input may do."""
    everything = np.concatenate(values)
    largest, rms = float(np.abs(everything).max(initial=0.0)), float(np.sqrt(np.mean(everything**2)))
    if not rms > 0:
        return []
    channel = _Channel(model=model, place=f"input:{name}", family="actuator", word="input")
    limits = [(s * largest, _limited(s * largest)) for s in LIMITS]
    zones = [(s * rms, _dead(s * rms)) for s in ZONES]
    return [
        channel.linear("gain", Gain(), "gain", (1.0, *GAINS)),
        channel.linear("offset", Offset(), "bias"),
        *channel.slow(interval, duration, held=True),
        channel.shaped("saturation", Saturation(limit=largest), "limit", (largest, largest / 100, largest), limits),
        channel.shaped("dead_zone", DeadZone(width=rms / 100), "width", (rms / 100, rms * 1e-5, largest), zones),
    ]


def of_alike(model: Model, names: Sequence[str], interval: float, duration: float) -> list[Candidate]:
    """What inputs of parts of one kind may do all together, as what they come from does: they lag, or are late."""
    found = list[Candidate]()
    times, start = _times(interval, duration)
    places = tuple(f"input:{name}" for name in names)
    blocks: tuple[tuple[type[Component], str, str, Callable[..., Array], tuple[float, float, float]], ...] = (
        (Lag, "lag", "tau", lagged, _of_lag(start)),
        (Delay, "delay", "delay", late, start),
    )
    for block, fault, word, changed, bounds in blocks:
        own = [free_name(model, f"input_{fault}_{name}") for name in names]
        path = f"{free_name(model, f'input_{fault}')}.{word}"
        if path in model.parameters:
            continue  # it is there already
        parts = tuple(Insert(place=place, component=block(), name=name) for place, name in zip(places, own, strict=True))
        found.append(
            Candidate(
                place=places[0],
                family="actuator",
                physics=f"input_{fault}",
                edits=(Alike(parts=parts, parameter=path, word=word, value=interval),),
                start={path: bounds},
                named={word: path},
                signals=tuple(Signal(of=places, changed=_by(changed, t, True), start={path: t}) for t in times),
            )
        )
    return found


def of_sensor(
    model: Model,
    name: str,
    others: Sequence[str],
    interval: float,
    duration: float,
    *,
    scaled: bool = True,
    span: float | None = None,
    begin: float = 0.0,
) -> list[Candidate]:
    """What the sensor may do; others: outputs of one kind with it, of which a part may be in its reading.

    scaled: a gain too. span: of its reading, where that is an angle [rad]: of an error that comes back several times a turn it has to hold
    half a wave. begin: of the recordings on the model's clock [s], from which it drifts.
    """
    of = f"sensor:{name}"
    channel = _Channel(model=model, place=of, family="sensor", word="sensor")
    found = [
        *([channel.linear("gain", Gain(), "gain", (1.0, *GAINS))] if scaled else []),
        channel.linear("bias", Offset(), "bias"),
        channel.linear("drift", Drift(t_0=begin), "rate"),
        *channel.slow(interval, duration, held=False),
        *([channel.turned()] if span is not None else []),
        *(channel.uneven(order) for order in ORDERS if span is not None and order * span > np.pi),
    ]
    return found + [one for other in others for one in _misaligned(model, name, other)]


def _misaligned(model: Model, name: str, other: str) -> list[Candidate]:
    """A sensor that reads a part of what another one does; and both of them turned, once for the two."""
    channel = _Channel(model=model, place=f"sensor:{name}", family="sensor", word="sensor")
    found = list[Candidate]()
    for block, parameter in ((Sum(k_2=0.0), "k_2"), (Rotation(), "angle")) if name < other else ((Sum(k_2=0.0), "k_2"),):
        both = isinstance(block, Rotation)
        title = channel.name(f"{'turned' if both else 'misalignment'}_{other}")
        edit = _Mixed(of=name, other=other, name=title, block=block)
        found.append(
            Candidate(
                place=channel.place,
                family="sensor",
                physics="sensor_misalignment",
                edits=(Rebuild(edit=edit, said=f"{title} = {type(block).__name__}() of {name} and {other} at {channel.place}"),),
                strengths=(f"{title}.{parameter}",),
                start={f"{title}.{parameter}": (0.0, -TURN, TURN)},
                named={"angle": f"{title}.{parameter}"},
            )
        )
    return found


@dataclass(frozen=True, kw_only=True)
class _Mixed:
    """A sensor that reads a part of what another one reads, by a `Sum`; or both of them turned, by a `Rotation`."""

    of: str
    other: str
    name: str
    block: Component

    def __call__(self, model: Model) -> Model:
        read = (self.of, self.other) if isinstance(self.block, Rotation) else (self.of,)
        outputs = dict(model.outputs)
        for k, output in enumerate(read, 1):
            outputs[output] = Output(f"{self.name}.y{f'_{k}' if len(read) > 1 else ''}", model.measured[output].noise_std)
        grown = replace(model, components={**model.components, self.name: self.block}, outputs=outputs)
        sources = (model.measured[output].variable for output in (self.of, self.other))
        return replace(grown, connections=(*grown.connections, *((v, f"{self.name}.u_{k}") for k, v in enumerate(sources, 1))))


def _times(interval: float, duration: float) -> tuple[tuple[float, ...], tuple[float, float, float]]:
    """Lags and delays that are looked at, and guess, least and largest of a fit."""
    longest = max(LONGEST * duration, interval)
    times = np.geomspace(SHORTEST * interval, longest, TIMES)
    return tuple(float(t) for t in times), (interval, interval / 50, BEYOND * longest)


def _of_lag(start: tuple[float, float, float]) -> tuple[float, float, float]:
    """Guess, least and largest of a lag: one shorter than a part of an interval is none on such a mesh, but a delay of its own making."""
    guess, _, largest = start
    return guess, SHORTEST * guess, largest


def _by(change: Callable[..., Array], t: float, held: bool) -> Callable[[Array, Array], Array]:
    return lambda time, values: change(time, values, t, held)


def _limited(limit: float) -> Callable[[Array, Array], Array]:
    return lambda _, values: np.clip(values, -limit, limit)


def _dead(width: float) -> Callable[[Array, Array], Array]:
    return lambda _, values: values - np.clip(values, -width, width)
