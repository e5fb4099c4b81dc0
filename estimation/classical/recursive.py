"""Recursive maximum likelihood for ARMAX: coefficients that may wander, followed sample by sample.

    theta(k+1) = theta(k) + w(k),  cov w = R_w          y(k) = phi(k)' theta(k) + e(k),  var e = R_e

    phi = [-y(k-1) .. -y(k-na), u_i(k-nk) .., 1, r(k-1) .. r(k-nc)],    psi = phi / C^(q)            gradient of the prediction
    K = P psi / (lambda R_e + psi' P psi),    P <- (P - K psi' P)/lambda + R_w
    e = y - phi' theta,    theta <- theta + K e,    r = y - phi' theta                               residual after the update

The extended Kalman filter of the coefficients (KSEPL, 1992, eq. 76; L. Ljung, T. Soderstrom, Theory and Practice of Recursive
Identification, 1983, section 3.7): with R_w = 0 and lambda = 1 it converges to `armax`; with lambda < 1 it forgets exponentially. Where an
update would take a root of C out of the unit circle, the C that filters stays as it was.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from backsight.models.errors import InputError, suggestion

from ..recordings.recording import Recording
from ..results import ParameterEstimate
from ..validation.fit import output_fit
from .armax import MARGIN, Orders, series
from .result import Baseline

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
FIRST = 1e4  # variance of coefficients that nothing is known of, in units of the output's variance over the regressor's


@dataclass(frozen=True, kw_only=True)
class Tracked:
    """Coefficients over time: theta and std (n, p), after each sample; predicted (n,), before it; `names` of the coefficients."""

    recording: Recording
    output: str
    names: tuple[str, ...]
    theta: Array
    std: Array
    predicted: Array

    def baseline(self) -> Baseline:
        """The last coefficients, and the fit of the prediction one sample ahead over the second half of the recording."""
        y = self.recording.outputs[self.output]
        half = len(y) // 2
        found = zip(self.names, self.theta[-1], self.std[-1], strict=True)
        return Baseline(
            method="recursive_armax",
            model=f"difference equation of {self.output}",
            parameters={
                n: ParameterEstimate(name=n, value=float(v), std=float(s), unit="1", fixed=False, identifiable=True) for n, v, s in found
            },
            fit={self.recording.name: {self.output: output_fit(y[half:], self.predicted[half:])}},
            predicted="one step ahead",
            notes=("Coefficients after the last sample; the fit is that of the second half, after they have settled.",),
        )


def recursive_armax(
    recording: Recording,
    *,
    output: str,
    orders: Orders,
    inputs: Sequence[str] | None = None,
    drift: Mapping[str, float] | float = 0.0,
    forgetting: float = 1.0,
    noise_std: float | None = None,
    start: Mapping[str, float] | None = None,
    start_std: float | None = None,
) -> Tracked:
    """Follow the coefficients of `orders` over a recording.

    drift       std of the step of the coefficients from sample to sample, of all or by name (sqrt of R_w)
    forgetting  lambda, in (0.9, 1]; use it or drift
    noise_std   sqrt of R_e [unit of the output]; None: followed along, as the mean square of e so far
    start       first values by name, zero otherwise; start_std: their std (None: nothing is known)

    Raises InputError for unequal steps, missing samples, unknown names, values out of range.
    """
    y, u, used, _ = series(recording, output, inputs, orders, "recursive_armax")
    if not 0.9 < forgetting <= 1.0:
        raise InputError(f"recursive_armax(forgetting={forgetting}): must lie above 0.9 and not beyond 1, which forgets nothing.")
    names = orders.names(used)
    step = np.array([_of(drift, name) for name in names])
    for what, table in (("drift", drift if isinstance(drift, Mapping) else {}), ("start", start or {})):
        for name in table:
            if name not in names:
                raise InputError(f"recursive_armax({what}={{{name!r}: ..}}): there is no such coefficient; {suggestion(name, names)}")
    if np.any(step < 0) or not np.all(np.isfinite(step)):
        raise InputError("recursive_armax(drift=..): a standard deviation is zero or positive.")
    theta = np.array([(start or {}).get(name, 0.0) for name in names])
    nc, first, n = orders.nc, orders.lag, len(y)
    scale = np.concatenate([_sizes(y, u, orders), np.full(nc, float(np.std(y)) or 1.0)])
    P = np.diag(np.full(len(names), start_std**2) if start_std is not None else FIRST * (float(np.var(y)) or 1.0) / scale**2)
    residual, thetas, stds, predicted = np.zeros(n), np.zeros((n, len(names))), np.full((n, len(names)), np.inf), np.full(n, np.nan)
    filtered = np.zeros((nc, len(names)))  # psi(k-1) .. psi(k-nc)
    C = np.zeros(nc) if _stable(theta[len(theta) - nc :]) is None else theta[len(theta) - nc :].copy()
    power, weight = (noise_std**2 if noise_std else 0.1 * (float(np.var(np.diff(y))) or 1.0)), 1.0
    for k in range(n):
        if k < first:
            thetas[k] = theta
            continue
        phi = np.concatenate(
            [
                -y[k - orders.na : k][::-1],
                *(row[k - orders.nk - orders.nb + 1 : k - orders.nk + 1][::-1] for row in u),
                np.ones(int(orders.offset)),
                residual[k - nc : k][::-1],
            ]
        )
        psi = phi - C @ filtered
        predicted[k] = phi @ theta
        e = y[k] - predicted[k]
        gain = P @ psi / (forgetting * power + psi @ P @ psi)
        P = (P - np.outer(gain, psi @ P)) / forgetting + np.diag(step**2)
        P = (P + P.T) / 2
        theta = theta + gain * e
        stable = _stable(theta[len(theta) - nc :])
        C = C if stable is None else stable
        residual[k] = y[k] - phi @ theta
        if nc:
            filtered = np.vstack([psi, filtered[:-1]])
        if noise_std is None:
            weight += 1.0
            power += (max(residual[k] * e, 0.0) - power) / weight
        thetas[k], stds[k] = theta, np.sqrt(np.maximum(np.diag(P), 0.0))
    return Tracked(recording=recording, output=output, names=tuple(names), theta=thetas, std=stds, predicted=predicted)


def _of(drift: Mapping[str, float] | float, name: str) -> float:
    return float(drift.get(name, 0.0)) if isinstance(drift, Mapping) else float(drift)


def _sizes(y: Array, u: Array, orders: Orders) -> Array:
    rms = [np.full(orders.na, np.sqrt(np.mean(y**2)))] + [np.full(orders.nb, np.sqrt(np.mean(row**2))) for row in u]
    sizes = np.concatenate([*rms, np.ones(int(orders.offset))])
    return np.where(sizes > 0, sizes, 1.0)


def _stable(c: Array) -> Array | None:
    """C as it is, or None where a root lies outside."""
    return c.copy() if not len(c) or np.all(np.abs(np.roots(np.concatenate([[1.0], c]))) <= MARGIN) else None
