"""How noisy is a signal? Answered from its samples alone, before any model.

The divided difference of order d of the samples y at times t, scaled to unit weights,

    r_k = sum_j c_j y_(k+j) / |c|,        c_j = 1 / prod_(i != j) (t_(k+j) - t_(k+i)),        j = 0 .. d,

is zero for a polynomial of degree d - 1, whatever the times, and has the noise's own variance for white noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = np.ndarray[tuple[int], np.dtype[np.float64]]

ORDERS = range(2, 7)
FEWEST = 8  # differences from which a deviation can be told
CONVERTER = 2.0**-20 / 12**0.5  # of the range: the rounding of 20 bits of it, about what the best converters tell from noise
DUST = 1e-14  # of the largest value: what unit conversion and differences of equal values leave
STILL = 0.3  # share of differences that are zero from which on their median tells nothing
ALTERNATING = 0.75  # of the changes of sign that white noise has; half of them are left where half of the deviation is a smooth signal's


@dataclass(frozen=True)
class Noise:
    """std: what to begin with. least: so much of it is noise beyond doubt, 0 where the samples cannot tell. In the signal's unit.

    white: what of that is no rounding, 0 where differences do not alternate as those of white noise do.
    """

    std: float
    least: float
    white: float = 0.0


def noise(time: Array, y: Array, supposed: float | None = None) -> Noise:
    """The white noise in y (n,), NaN where missing, sampled at time (n,) [s].

    std is the least over differences of order 2 to 6: too low an order sees the signal, and all see the noise. It is never below
    quantisation, step/sqrt(12). Where they do not look white it is not below the rounding of a fine converter either: a sensor that
    filters has differences far below its noise.
    Robust against jumps (median of absolute differences) unless many differences are zero.
    supposed: std where the samples do not tell, too few or all alike (by itself a thousandth of how they vary, else of their value).

    least is what differences that alternate as those of white noise do (sign changes of a Gaussian sequence with lag-one correlation
    -d/(d + 1): a share arccos(-d/(d + 1))/pi) have shown, or the quantisation.
    """
    there = np.isfinite(y)
    t, finite = time[there], y[there]
    alike = not varies(finite)
    found = [_of_order(order, t, finite) for order in ORDERS if len(finite) >= order + FEWEST and not alike]
    size = (float(np.max(np.abs(finite), initial=0.0)) or 1.0) if alike else float(np.std(finite))
    rounding = _step(finite) / np.sqrt(12.0)
    seen, alternating = min(found, default=(supposed or 1e-3 * size, False))
    resolution = CONVERTER * float(np.ptp(finite)) if len(finite) and not alternating else 0.0
    white = seen if alternating else 0.0
    return Noise(std=float(max(seen, rounding, resolution, 1e-9 * size)), least=float(max(white, rounding)), white=white)


def varies(y: Array) -> bool:
    """Whether y (n,), NaN where missing, has different values; by them, for the std of equal ones may be a rounding error."""
    finite = y[np.isfinite(y)]
    return finite.size > 0 and bool(np.ptp(finite) > 0.0)


def noise_std(time: Array, y: Array, supposed: float | None = None) -> float:
    """Standard deviation of the white noise in y, see `noise`."""
    return noise(time, y, supposed).std


def robust_std(values: NDArray[np.float64]) -> float:
    """Standard deviation of normal values (n,) by the median of their sizes, which single outliers leave alone."""
    return float(np.median(np.abs(values))) / 0.6745


def _of_order(order: int, t: Array, y: Array) -> tuple[float, bool]:
    """The deviation that differences of this order show, and whether they alternate like those of white noise."""
    d = _differences(order, t, y)
    rms, robust = float(np.sqrt(np.mean(d**2))), robust_std(d)
    still = np.abs(d) <= DUST * float(np.max(np.abs(y)))
    changes = float(np.mean((d[1:] * d[:-1] < 0.0) & ~(still[1:] | still[:-1])))
    white = np.arccos(-order / (order + 1.0)) / np.pi
    return robust if np.mean(still) < STILL else rms, changes > ALTERNATING * white


def _differences(order: int, t: Array, y: Array) -> Array:
    """Divided differences over neighbouring samples, scaled to unit weights; (n - order,)."""
    count = len(y) - order
    times = np.array([t[j : j + count] for j in range(order + 1)])
    times = (times - times[0]) / (times[-1] - times[0])
    apart = times[:, None] - times[None] + np.eye(order + 1)[:, :, None]
    weights = 1.0 / np.prod(apart, axis=1)
    values = np.array([y[j : j + count] for j in range(order + 1)])
    values = values - values[order // 2]  # a large mean would cost digits
    return np.asarray(np.sum(weights * values, axis=0) / np.sqrt(np.sum(weights**2, axis=0)))


def _step(y: Array) -> float:
    """The least significant step of a quantised signal; 0 when the values are not on a grid."""
    values = np.unique(y)
    values = values[np.append(True, np.diff(values) > DUST * float(np.max(np.abs(y), initial=0.0)))]
    if values.size < 3 or values.size > 0.5 * y.size:
        return 0.0
    return float(np.diff(values).min())
