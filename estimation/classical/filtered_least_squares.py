"""Least squares on filtered derivatives: the equation error of balances that are linear in the parameters.

    F(x', x, z, u, p) = F_0(k) + F_p(k) (p - p_0) = e_k        min  sum_k |e_k / s|^2

x, x' and u pass through the same low-pass filter before that, in one of two ways:

    filtered_least_squares   a Butterworth filter run forward and back (no phase shift, twice the poles), then central differences of
                             second order (D. E. Schinstock, T. A. Haskew, Identification of continuous-time, linear, and nonlinear models
                             of an electromechanical actuator, J. Propulsion and Power 13, 1997: 12 poles, 25 Hz). With decimation the
                             inputs stay as they are, and every column passes one filter before it is thinned out: what the corners of a
                             friction law add is then low-passed on both sides (M. Gautier, Dynamic identification of robots with power
                             model, ICRA 1997)
    state_variable_filter    F(s) = (c/(s + c))^n, c = 2 pi cutoff, whose states are the filtered signal and its derivatives, discretised
                             exactly for the hold of the inputs and for straight lines between samples of the outputs; causal
                             (P. C. Young, Automatica 17, 1981)

s of every balance is the rms of its own equation error, by two passes. Both are consistent where the error is one of the recorded input.
Under noise in x, and under forces that act but are not recorded, the regressors are correlated with the error: the filtered noise must be
small beside the motion, and x'' beside the unknown force. What is beyond the cutoff is not seen. Standard deviations are those of
coloured residuals (`regression.py`), and know nothing of such a bias.
"""

from __future__ import annotations

from functools import partial
from typing import Literal

import numpy as np
import scipy.signal

from backsight.models.errors import InputError

from ..problem import Problem
from ..recordings.drive import Hold
from ..wording import listed
from .balances import linear_balances
from .measured_states import Filter, Filtered, Motion, motion
from .regression import Regression, solve
from .result import Baseline, bounds, estimates, known_start, prior, simulated_fits

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
EDGE = 0.8  # periods of the cutoff for every pole, at either end, that are left out
PASSES = 2
THINNED = 0.8  # of half the sampling frequency that is left after decimation: the band that is kept


def filtered_least_squares(problem: Problem, *, cutoff: float = 25.0, poles: int = 6, decimate: int = 1) -> Baseline:
    """Zero-phase low-pass, central differences, least squares in the free parameters.

    cutoff    [Hz] of the Butterworth filter
    poles     of one pass; the two passes have twice as many
    decimate  one instant in so many is kept, after a zero-phase filter on every column of the regression; 1: all, the inputs filtered as x

    Raises InputError for unequal steps, missing samples, states that no output shows, parameters that are not linear in the balances.
    """
    if isinstance(decimate, bool) or not isinstance(decimate, int) or decimate < 1:
        raise InputError(f"filtered_least_squares(decimate={decimate!r}): needs a whole number from 1 on; 1 keeps every instant.")
    _check(cutoff, poles, "filtered_least_squares", "poles")
    for recording in problem.fitted if decimate > 1 else ():
        band = THINNED * 0.5 / recording.sampling / decimate
        if band > cutoff / 2:
            raise InputError(
                f"filtered_least_squares(cutoff={cutoff:g}, decimate={decimate}): {band:.4g} Hz of {recording.name} are left, and must lie "
                f"below half the cutoff, whose filter only x passes; raise cutoff to {2 * band:.4g} Hz, or decimate."
            )
    return _estimate(
        problem, partial(zero_phase, cutoff=cutoff, poles=poles, inputs_too=decimate == 1), "filtered_least_squares", decimate, cutoff
    )


def state_variable_filter(problem: Problem, *, cutoff: float = 25.0, order: int = 3) -> Baseline:
    """State-variable filters (c/(s + c))^order on inputs and shown states, least squares in the free parameters.

    cutoff [Hz] of each of the `order` lags, three or more of them. Raises InputError as `filtered_least_squares`.
    """
    _check(cutoff, order, "state_variable_filter", "order")
    if order < 3:
        raise InputError(f"state_variable_filter(order={order}): two derivatives need three lags; give 3 or more.")
    return _estimate(problem, partial(_state_variable, cutoff=cutoff, order=order), "state_variable_filter", 1, cutoff)


def _check(cutoff: float, order: int, method: str, name: str) -> None:
    if not (np.isfinite(cutoff) and cutoff > 0):
        raise InputError(f"{method}(cutoff={cutoff!r}): needs a positive frequency [Hz].")
    if isinstance(order, bool) or not isinstance(order, int) or order < 1:
        raise InputError(f"{method}({name}={order!r}): needs a whole number from 1 on.")


def _estimate(problem: Problem, filtered: Filter, method: str, decimate: int, cutoff: float) -> Baseline:
    balances = linear_balances(problem, method)
    motions = [motion(problem, r, filtered, method) for r in problem.fitted]
    pieces = [_decimated(*balances.along(m), decimate) for m in motions]
    base, (mean, information) = problem.values[list(problem.free)], prior(problem)
    slopes, targets = [s for _, s in pieces], [np.einsum("krp,p->kr", s, base) - F for F, s in pieces]
    size = np.ones(len(balances.rows))
    for _ in range(PASSES if len(size) > 1 or information.any() else 1):
        found = solve([s / size[:, None] for s in slopes], [d / size for d in targets], mean, information)
        left = np.concatenate([d - s @ found.theta for s, d in zip(slopes, targets, strict=True)])
        size = np.sqrt(np.mean(left**2, axis=0)) + 1e-300
    starts = {r.title: (m.rows.start, _start(problem, m)) for r, m in zip(problem.fitted, motions, strict=True)}
    fits, failed = simulated_fits(problem, found.theta, starts)
    rms = "; ".join(f"{problem.dae.equations[r].origin} {s:.3g}" for r, s in zip(balances.rows, size, strict=True))
    notes = (
        f"Equation error after a low-pass of {cutoff:g} Hz, rms: {rms}. Noise that passes the filter is in the regressors and biases them.",
        *_on_bounds(problem, found),
        *failed,
    )
    return Baseline(
        method=method,
        model=problem.dae.name,
        parameters=estimates(problem, found.theta, found.std, list(found.determined)),
        fit=fits,
        predicted="simulated",
        notes=notes,
    )


def _on_bounds(problem: Problem, found: Regression) -> tuple[str, ...]:
    low, high = bounds(problem)
    outside = [problem.dae.parameters[i].name for k, i in enumerate(problem.free) if not low[k] <= found.theta[k] <= high[k]]
    return (f"Least squares knows no bounds: {listed(outside)} came out beyond its own.",) if outside else ()


def _start(problem: Problem, m: Motion) -> dict[str, float]:
    """The first states of a motion; those that no output shows as the problem or the model has them."""
    known = {q.name: float(m.x[i, 0]) for i, q in enumerate(problem.dae.states) if np.any(m.x[i]) or np.any(m.dx[i])}
    return known_start(problem) | known


def _decimated(F: Array, slope: Array, factor: int) -> tuple[Array, Array]:
    if factor == 1:
        return F, slope
    columns = np.concatenate([F[:, :, None], slope], axis=2)
    sections = scipy.signal.cheby1(8, 0.05, THINNED / factor, output="sos")
    edge = 2 * factor
    kept = scipy.signal.sosfiltfilt(sections, columns, axis=0)[edge : len(columns) - edge : factor]
    return kept[:, :, 0], kept[:, :, 1:]


def zero_phase(signals: Array, inputs: Array, hold: Hold, step: float, *, cutoff: float, poles: int, inputs_too: bool) -> Filtered:
    """Forward and back; an input that is held acts, seen around a sample, as the mean of the values before and after it."""
    rows = _inner(signals.shape[1], step, cutoff, poles)
    sections = scipy.signal.butter(poles, cutoff, fs=1 / step, output="sos")

    def low(values: Array) -> Array:
        return np.asarray(scipy.signal.sosfiltfilt(sections, values, axis=1), dtype=np.float64)

    f = low(signals)
    acting = inputs if hold == "linear" else (inputs + np.column_stack([inputs[:, :1], inputs[:, :-1]])) / 2
    first = np.gradient(f, step, axis=1)
    second = np.zeros_like(f)
    second[:, 1:-1] = (f[:, 2:] - 2 * f[:, 1:-1] + f[:, :-2]) / step**2
    u = low(acting) if inputs_too and len(acting) else acting
    return Filtered(signals=f[:, rows], first=first[:, rows], second=second[:, rows], inputs=u[:, rows], rows=rows)


def _state_variable(signals: Array, inputs: Array, hold: Hold, step: float, *, cutoff: float, order: int) -> Filtered:
    """A chain of lags from rest at the first sample, its transient left out; derivatives from the lags' own equations s F = c (F_- - F)."""
    c = 2 * np.pi * cutoff
    rows = slice(2 * _inner(signals.shape[1], step, cutoff, order).start, signals.shape[1])
    if signals.shape[1] - rows.start < 10:
        raise InputError(f"cutoff = {cutoff:g} Hz: the filter's transient takes the whole recording; raise it or record for longer.")
    chain = -c * np.eye(order) + c * np.eye(order, k=-1)
    entry = np.zeros((order, 1))
    entry[0, 0] = c
    last = np.eye(order)[-1:]
    readings = [last, last @ chain, last @ chain @ chain]  # s^k F, k = 0, 1, 2, in terms of the chain's states

    def through(values: Array, rule: Literal["foh", "zoh"], reading: Array) -> Array:
        A, b, c, d = scipy.signal.cont2discrete((chain, entry, reading, np.zeros((1, 1))), step, method=rule)[:4]
        num, den = scipy.signal.ss2tf(A, b, c, d)
        return np.asarray(scipy.signal.lfilter(num[0], den, values - values[:, :1], axis=1), dtype=np.float64)

    f, first, second = (through(signals, "foh", reading) for reading in readings)
    u = through(inputs, "foh" if hold == "linear" else "zoh", readings[0]) if len(inputs) else inputs
    f, u = f + signals[:, :1], u + inputs[:, :1]
    return Filtered(signals=f[:, rows], first=first[:, rows], second=second[:, rows], inputs=u[:, rows], rows=rows)


def _inner(n: int, step: float, cutoff: float, poles: int) -> slice:
    if cutoff >= 0.5 / step:
        raise InputError(f"cutoff = {cutoff:g} Hz: must lie below half the sampling frequency, {0.5 / step:g} Hz.")
    edge = int(np.ceil(EDGE * poles / cutoff / step))
    if n - 2 * edge < 10:
        raise InputError(
            f"cutoff = {cutoff:g} Hz: leaves nothing of {n} samples but the filter's transients; raise it or record for longer."
        )
    return slice(edge, n - edge)
