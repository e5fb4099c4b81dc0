"""The library of what inputs and sensors may do: gains, offsets, drifts, lags, delays, limits, dead zones, sensors that are turned.

Gains, offsets and drifts are blocks that are linear in their strength. Of the others the score is that of the difference they make to the
recorded input or to the smoothed output, on a grid of their shape.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from backsight.models import Model
from backsight.models.model import Output
from backsight.models.signals import DeadZone, Delay, Drift, Gain, Lag, Offset, Saturation, Sum

from .candidates import Candidate, Insert, Rebuild, Signal

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

TIMES = 14  # lags and delays looked at
LONGEST = 0.05  # of a recording: the longest of them
LIMITS = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)  # of the largest input: where it may be cut off
ZONES = (0.003, 0.01, 0.03, 0.06, 0.1, 0.2)  # of the rms input: where it may have no effect
GAINS = (0.2, 5.0)
TURN = 0.5  # rad: a sensor that is turned further is mounted otherwise


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


def of_input(model: Model, name: str, values: Sequence[Array], interval: float, duration: float) -> list[Candidate]:
    """What the input may do."""
    of, everything = f"input:{name}", np.concatenate(values)
    largest, rms = float(np.abs(everything).max(initial=0.0)), float(np.sqrt(np.mean(everything**2)))
    if not rms > 0:
        return []
    times = _times(interval, duration)

    gain, offset = _name(model, "input_gain", name), _name(model, "input_offset", name)
    lag, delay = _name(model, "input_lag", name), _name(model, "input_delay", name)
    limit, zone = _name(model, "input_saturation", name), _name(model, "input_dead_zone", name)
    return [
        Candidate(
            place=of,
            family="actuator",
            physics="input_gain",
            edits=(Insert(place=of, component=Gain(), name=gain),),
            strengths=(f"{gain}.gain",),
            start={f"{gain}.gain": (1.0, *GAINS)},
            named={"gain": f"{gain}.gain"},
        ),
        Candidate(
            place=of,
            family="actuator",
            physics="input_offset",
            edits=(Insert(place=of, component=Offset(), name=offset),),
            strengths=(f"{offset}.bias",),
            named={"bias": f"{offset}.bias"},
        ),
        Candidate(
            place=of,
            family="actuator",
            physics="input_lag",
            edits=(Insert(place=of, component=Lag(tau=interval), name=lag),),
            named={"tau": f"{lag}.tau"},
            start={f"{lag}.tau": (interval, interval / 50, duration)},
            signals=tuple(Signal(of=of, changed=_by(lagged, t), start={f"{lag}.tau": t}) for t in times),
        ),
        Candidate(
            place=of,
            family="actuator",
            physics="input_delay",
            edits=(Insert(place=of, component=Delay(delay=interval), name=delay),),
            named={"delay": f"{delay}.delay"},
            start={f"{delay}.delay": (interval, interval / 50, duration)},
            signals=tuple(Signal(of=of, changed=_by(late, t), start={f"{delay}.delay": t}) for t in times),
        ),
        Candidate(
            place=of,
            family="actuator",
            physics="input_saturation",
            edits=(Insert(place=of, component=Saturation(limit=largest), name=limit),),
            named={"limit": f"{limit}.limit"},
            start={f"{limit}.limit": (largest, largest / 100, largest)},
            signals=tuple(Signal(of=of, changed=_limited(s * largest), start={f"{limit}.limit": s * largest}) for s in LIMITS),
        ),
        Candidate(
            place=of,
            family="actuator",
            physics="input_dead_zone",
            edits=(Insert(place=of, component=DeadZone(width=rms / 100), name=zone),),
            named={"width": f"{zone}.width"},
            start={f"{zone}.width": (rms / 100, rms * 1e-5, largest)},
            signals=tuple(Signal(of=of, changed=_dead(s * rms), start={f"{zone}.width": s * rms}) for s in ZONES),
        ),
    ]


def of_sensor(model: Model, name: str, others: Sequence[str], interval: float, duration: float) -> list[Candidate]:
    """What the sensor may do; others: outputs of one kind with it, of which a part may be in its reading."""
    of = f"sensor:{name}"
    gain, bias, drift = (_name(model, word, name) for word in ("sensor_gain", "sensor_bias", "sensor_drift"))
    lag, delay = _name(model, "sensor_lag", name), _name(model, "sensor_delay", name)
    times = _times(interval, duration)
    found = [
        Candidate(
            place=of,
            family="sensor",
            physics="sensor_gain",
            edits=(Insert(place=of, component=Gain(), name=gain),),
            strengths=(f"{gain}.gain",),
            start={f"{gain}.gain": (1.0, *GAINS)},
            named={"gain": f"{gain}.gain"},
        ),
        Candidate(
            place=of,
            family="sensor",
            physics="sensor_bias",
            edits=(Insert(place=of, component=Offset(), name=bias),),
            strengths=(f"{bias}.bias",),
            named={"bias": f"{bias}.bias"},
        ),
        Candidate(
            place=of,
            family="sensor",
            physics="sensor_drift",
            edits=(Insert(place=of, component=Drift(), name=drift),),
            strengths=(f"{drift}.rate",),
            named={"rate": f"{drift}.rate"},
        ),
        Candidate(
            place=of,
            family="sensor",
            physics="sensor_lag",
            edits=(Insert(place=of, component=Lag(tau=interval), name=lag),),
            named={"tau": f"{lag}.tau"},
            start={f"{lag}.tau": (interval, interval / 50, duration)},
            signals=tuple(Signal(of=of, changed=_by(lagged, t, held=False), start={f"{lag}.tau": t}) for t in times),
        ),
        Candidate(
            place=of,
            family="sensor",
            physics="sensor_delay",
            edits=(Insert(place=of, component=Delay(delay=interval), name=delay),),
            named={"delay": f"{delay}.delay"},
            start={f"{delay}.delay": (interval, interval / 50, duration)},
            signals=tuple(Signal(of=of, changed=_by(late, t, held=False), start={f"{delay}.delay": t}) for t in times),
        ),
    ]
    for other in others:
        mixed = _name(model, f"sensor_misalignment_{other}", name)
        found.append(
            Candidate(
                place=of,
                family="sensor",
                physics="sensor_misalignment",
                edits=(Rebuild(edit=_Turned(of=name, other=other, name=mixed), said=f"{mixed} = Sum() of {name} and {other} at {of}"),),
                strengths=(f"{mixed}.k_2",),
                start={f"{mixed}.k_2": (0.0, -TURN, TURN)},
                named={"angle": f"{mixed}.k_2"},
            )
        )
    return found


class _Turned:
    """A sensor that reads a part of what another one reads."""

    def __init__(self, *, of: str, other: str, name: str) -> None:
        self.of, self.other, self.name = of, other, name

    def __call__(self, model: Model) -> Model:
        measured, other = model.measured[self.of], model.measured[self.other]
        grown = replace(
            model,
            components={**model.components, self.name: Sum(k_2=0.0)},
            outputs={**model.outputs, self.of: Output(f"{self.name}.y", measured.noise_std)},
        )
        more = ((measured.variable, f"{self.name}.u_1"), (other.variable, f"{self.name}.u_2"))
        return replace(grown, connections=(*grown.connections, *more))


def _times(interval: float, duration: float) -> tuple[float, ...]:
    return tuple(float(t) for t in np.geomspace(interval / 4, max(LONGEST * duration, interval), TIMES))


def _by(change: Callable[..., Array], t: float, held: bool = True) -> Callable[[Array, Array], Array]:
    return lambda time, values: change(time, values, t, held)


def _limited(limit: float) -> Callable[[Array, Array], Array]:
    return lambda _, values: np.clip(values, -limit, limit)


def _dead(width: float) -> Callable[[Array, Array], Array]:
    return lambda _, values: values - np.clip(values, -width, width)


def _name(model: Model, physics: str, signal: str) -> str:
    name = f"{physics}_{signal}"
    while name in model.components:
        name += "_"
    return name
