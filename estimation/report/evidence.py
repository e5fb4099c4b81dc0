"""What the estimates say about themselves: which columns are what, autocorrelation, and what a residual force goes with."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

__all__ = ["Columns", "Companion", "autocorrelation", "companion", "correlation", "laws", "own_states"]

VELOCITY_UNITS, POSITION_UNITS = ("m/s", "rad/s"), ("m", "rad")
_FORCE_TO_MOTION = {"N": "m", "N.m": "rad", "N m": "rad", "N*m": "rad"}


@dataclass(frozen=True, kw_only=True)
class Columns:
    """The columns of a table of estimates by their role; a `.std` column belongs to the column before the dot."""

    outputs: tuple[str, ...]
    states: tuple[str, ...]
    residuals: tuple[str, ...]

    @classmethod
    def of(cls, frame: pd.DataFrame) -> "Columns":
        names = [str(c) for c in frame.columns]
        known = set(names)
        plain = [c for c in names if c not in {"t_s", "recording"} and not c.endswith((".std", ".measured"))]
        outputs = tuple(c for c in plain if f"{c}.measured" in known)
        residuals = tuple(c for c in plain if c.startswith("residual."))
        return cls(outputs=outputs, residuals=residuals, states=tuple(c for c in plain if c not in outputs and c not in residuals))


def autocorrelation(values: np.ndarray, lags: int) -> np.ndarray:
    """r_0 .. r_lags of a series whose missing samples are NaN: only pairs that were both measured count.

    r_k = mean(e_i e_(i+k)) / mean(e_i e_i), e without its mean; by FFT, so that long records cost nothing.
    """
    present = np.isfinite(values)
    if present.sum() < 2:
        return np.full(lags + 1, np.nan)
    e = np.where(present, values - values[present].mean(), 0.0)
    size = 1 << int(np.ceil(np.log2(e.size + lags + 1)))
    sums = np.fft.irfft(np.abs(np.fft.rfft(e, size)) ** 2, size)[: lags + 1]
    pairs = np.round(np.fft.irfft(np.abs(np.fft.rfft(present.astype(float), size)) ** 2, size)[: lags + 1])
    if not sums[0] > 0:
        return np.full(lags + 1, np.nan)
    means: np.ndarray = sums / np.maximum(pairs, 1.0)
    return np.where(pairs > 0, means / means[0], np.nan)


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


@dataclass(frozen=True, kw_only=True)
class Companion:
    """What a residual force goes with most: the words for it, the law that would look like it, and the correlation."""

    what: str
    law: str
    correlation: float


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


def laws(state: str, unit: str, values: np.ndarray, time: np.ndarray) -> list[tuple[str, str, np.ndarray]]:
    """Functions of a state that laws of mechanics are made of: (in words, what they would look like, their values)."""
    if unit in VELOCITY_UNITS and time.size > 2:
        # Below a thousandth of the usual speed the sign is noise, not motion.
        width = 1e-3 * float(np.sqrt(np.nanmean(values**2))) or 1.0
        return [
            (f"the sign of {state}", "dry friction", np.tanh(values / width)),
            (state, "viscous friction", values),
            (f"the size of {state}", "friction that differs between the two directions", np.abs(values)),
            (f"{state} squared, with its sign", "drag", values * np.abs(values)),
            (f"the rate of change of {state}", "a wrong or missing inertia", np.gradient(values, time)),
        ]
    if unit in POSITION_UNITS:
        return [(state, "a spring, or weight on a slope", values)]
    return [(state, f"a coupling to {state}", values)]


def companion(residual: np.ndarray, states: list[str], frame: pd.DataFrame, units: Mapping[str, str], rows: np.ndarray) -> Companion | None:
    """The function of the states that goes with the residual most, if that is plain: |r| > 0.3 and 4 standard deviations."""
    time, best = frame["t_s"].to_numpy(float), None
    for state in states:
        for what, law, values in laws(state, units.get(state, ""), frame[state].to_numpy(float), time):
            r, deviation = correlation(residual[rows], values[rows])
            if abs(r) > max(0.3, 4 * deviation) and (best is None or abs(r) > abs(best.correlation)):
                best = Companion(what=what, law=law, correlation=r)
    return best
