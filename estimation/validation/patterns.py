"""What a residual force goes with: the laws of mechanics that a missing friction, spring or inertia would follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from ..results import Companion
from ..wording import listed
from .autocorrelation import autocorrelation

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

VELOCITY_UNITS, POSITION_UNITS = ("m/s", "rad/s"), ("m", "rad")
PLAIN, SURE = 0.3, 4.0  # correlation, and its size in standard deviations, from which on a pattern is plain
ONE_WAY = 0.02  # share of the time that a body which moves both ways moves the other one
CONSTANT = "a constant force"
OTHER = 0.5  # of the largest of the means of several recordings: where they differ by more each has its own
QUIET = 0.1  # of its deviations: a residual force that small is made of what was supposed of it, and follows nothing
_FORCE_TO_MOTION = {"N": "m", "N.m": "rad", "N m": "rad", "N*m": "rad"}


def correlation(w: np.ndarray, g: np.ndarray) -> tuple[float, float]:
    """The correlation r of a residual w with an explanation g, and the standard deviation that colour gives to r.

    var r = (1 - r^2)/n sum_k r_e(k) r_g(k), e = w - b g what the explanation leaves: Bartlett's formula, not 1/n, since both series
    remember their past (Box, Jenkins and Reinsel, Time Series Analysis, chapter 12). With e instead of w, an explanation that is right
    is not held against itself.
    """
    both = np.isfinite(w) & np.isfinite(g)
    w, g = w[both], g[both]
    if w.size < 20 or not (w.std() > 0 and g.std() > 0):
        return 0.0, 1.0
    w, g = (w - w.mean()) / w.std(), (g - g.mean()) / g.std()
    r, lags = float(np.mean(w * g)), w.size // 4
    left = w - r * g
    if not left.std() > 1e-9:
        return r, 0.0
    overlap = autocorrelation(left, lags) * autocorrelation(g, lags)
    return r, float(np.sqrt((1 - r * r) * max(1.0 + 2.0 * overlap[1:].sum(), 1.0) / w.size))


def constant_share(w: np.ndarray) -> tuple[float, float]:
    """Mean of a residual over its rms, and the standard deviation of that, by the same formula: a constant remembers everything."""
    w = w[np.isfinite(w)]
    rms = float(np.sqrt(np.mean(w**2))) if w.size else 0.0
    if w.size < 20 or not rms > 0:
        return 0.0, 1.0
    left = w - w.mean()
    memory = max(1.0 + 2.0 * autocorrelation(left, w.size // 4)[1:].sum(), 1.0) if left.std() > 1e-9 * rms else 0.0
    return float(w.mean() / rms), float(left.std() / rms * np.sqrt(memory / w.size))


def own_states(place: str, place_unit: str, states: tuple[str, ...], units: Mapping[str, str]) -> tuple[list[str], bool]:
    """The states to hold a residual of `place` against, velocities first, and whether they belong to that place.

    A place's states carry its component's name. A place without any (a spring, a joint, a friction law) is held against every state
    whose unit goes with the unit of its force: velocities and positions in m for N, in rad for N.m.
    """
    component = place.split(".")[0]
    own = [s for s in states if s.rsplit(".", 1)[0] == component or s.startswith(f"{component}.")]
    base = _FORCE_TO_MOTION.get(place_unit)
    if len(own) > 4 and base is not None:
        own = [s for s in own if units.get(s) in {base, f"{base}/s"}] or own
    chosen = own or [s for s in states if base is not None and units.get(s) in {base, f"{base}/s"}]
    return sorted(chosen, key=lambda s: (units.get(s) not in VELOCITY_UNITS, units.get(s) not in POSITION_UNITS)), bool(own)


def laws(state: str, unit: str, values: np.ndarray, time: np.ndarray, rate: np.ndarray | None = None) -> list[tuple[str, str, np.ndarray]]:
    """Functions of a state that laws of mechanics are made of: (in words, what they would look like, their values).

    rate: of the state, without what the residual itself adds to it (`rates.py`); by differences where it is not given.
    """
    if unit in VELOCITY_UNITS and time.size > 2:
        # Below a thousandth of the usual speed the sign is noise, not motion.
        width = 1e-3 * float(np.sqrt(np.nanmean(values**2))) or 1.0
        sides = np.sort([np.nanmean(values > width), np.nanmean(values < -width)])
        both = [(f"|{state}|", "friction that differs between the two directions", np.abs(values))] if sides[0] > ONE_WAY else []
        return [
            (f"the sign of {state}", "dry friction", np.tanh(values / width)),
            (state, "viscous friction", values),
            *both,
            (f"{state} squared, with its sign", "drag", values * np.abs(values)),
            (f"the rate of change of {state}", "a wrong or missing inertia", np.gradient(values, time) if rate is None else rate),
        ]
    if unit in POSITION_UNITS:
        return [(state, "a spring, or weight on a slope", values)]
    return [(state, f"a coupling to {state}", values)]


def companion(
    residual: np.ndarray,
    states: Sequence[str],
    frame: pd.DataFrame,
    units: Mapping[str, str],
    rows: np.ndarray,
    inputs: Mapping[str, np.ndarray] | None = None,
    unit: str = "",
    rates: pd.DataFrame | None = None,
) -> Companion | None:
    """What goes with a residual [unit] most, if that is plain: a function of the states, an input, or nothing but time.

    rows: which samples are looked at. rates: of the states, by time.
    """
    if rates is not None:
        rates = rates.reindex(frame["t_s"])
    time, best = frame["t_s"].to_numpy(float), None
    found = []
    for state in states:
        rate = rates[state].to_numpy(float) if rates is not None and state in rates else None
        found += laws(state, units.get(state, ""), frame[state].to_numpy(float), time, rate)
    for name, values in (inputs or {}).items():
        u = np.asarray(values, dtype=float)
        found.append((f"the input {name}", "an input whose gain is off", u))
        if u.size > 2:
            found.append((f"the rate of change of the input {name}", "a delay or a lag of it", np.gradient(u, time)))
    for what, law, values in found:
        r, deviation = correlation(residual[rows], values[rows])
        if abs(r) > max(PLAIN, SURE * deviation) and (best is None or abs(r) > abs(best.correlation)):
            best = Companion(what=what, law=law, correlation=r, std=deviation)
    share, deviation = constant_share(residual[rows])
    if abs(share) > max(PLAIN, SURE * deviation) and (best is None or abs(share) > abs(best.correlation)):
        mean = float(np.nanmean(residual[rows]))
        best = Companion(what=f"a constant, {mean:.3g} {unit}".rstrip(), law=CONSTANT, correlation=share, std=deviation)
    return best


def differing(constant: Companion, residuals: Mapping[str, Array], unit: str) -> Companion:
    """A residual that goes with a constant, where that is plainly another one in other recordings; residuals: recording -> (n,)."""
    means, variances = dict[str, float](), dict[str, float]()
    for name, residual in residuals.items():
        w = residual[np.isfinite(residual)]
        rms = float(np.sqrt(np.mean(w**2))) if w.size else 0.0
        if rms > 0:
            share, deviation = constant_share(w)
            means[name], variances[name] = share * rms, (deviation * rms) ** 2
    if len(means) < 2:
        return constant
    least, most = min(means, key=lambda name: means[name]), max(means, key=lambda name: means[name])
    apart = means[most] - means[least]
    if apart <= max(OTHER * max(map(abs, means.values())), SURE * float(np.sqrt(variances[most] + variances[least]))):
        return constant
    what = f"a constant of every recording, {listed([f'{mean:.3g} {unit} in {name}' for name, mean in means.items()])}"
    return replace(constant, what=what, law="a parameter that should be each recording's own (per_recording = true)")
