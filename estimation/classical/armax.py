"""ARMAX by prediction errors: one output, any number of inputs.

    A(q) y(k) = sum_i B_i(q) u_i(k) + d + C(q) e(k)

    A = 1 + a_1 q^-1 + .. + a_na q^-na,   B_i = b_i1 q^-nk + .. + b_inb q^-(nk+nb-1),   C = 1 + c_1 q^-1 + .. + c_nc q^-nc

The innovations are e = C^-1 (A y - B u - d), and their derivatives are the same filter on the regressors:

    -de/da_j = -C^-1 q^-j y,   -de/db_ij = C^-1 q^-(nk+j-1) u_i,   -de/dd = C^-1 1,   -de/dc_j = C^-1 q^-j e

min 1/2 sum_k e(k)^2 by Gauss-Newton with halving; C keeps its roots inside the unit circle. It starts from two linear regressions: a long
ARX model for e, then y on its own past, u and that e (E. J. Hannan, J. Rissanen, Biometrika 69, 1982). Covariance s^2 (sum psi psi')^-1.
Orders by AIC = n log s^2 + 2 p or BIC = n log s^2 + p log n on the same samples (L. Ljung, System Identification, 2nd ed. 1999, sections
10.2 and 16.4; the drillstring's: KSEPL, 1992, section 5.1).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.signal import lfilter

from backsight.models.errors import InputError, suggestion

from ..recordings.recording import Recording
from ..results import ParameterEstimate
from ..validation.fit import output_fit
from ..wording import listed
from .result import Baseline
from .sampling import complete_output, row_inputs, uniform_step

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
ITERATIONS = 100
HALVINGS = 12
SETTLED = 1e-8  # relative decrease of the cost at which the search has arrived
MARGIN = 0.999  # largest modulus of a root of C


@dataclass(frozen=True, kw_only=True)
class Orders:
    """na, nb, nc: numbers of coefficients of A, of every B and of C; nk: samples from an input to its first effect; offset: with d."""

    na: int
    nb: int
    nc: int = 0
    nk: int = 1
    offset: bool = False

    def __post_init__(self) -> None:
        for name in ("na", "nb", "nc", "nk"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < 0:
                raise InputError(f"Orders({name}={value!r}): needs a whole number from 0 on.")
        if not (self.na or self.nb or self.nc or self.offset):
            raise InputError("Orders(na=0, nb=0, nc=0): has nothing to estimate; give at least one order.")

    @property
    def lag(self) -> int:
        """Samples of the past that a prediction looks back on."""
        return max(self.na, self.nc, self.nb + self.nk - 1 if self.nb else 0)

    def names(self, inputs: Sequence[str]) -> list[str]:
        """a_1 .., b_1 .. (of one input; b_F_1 .. of input F of several), d, c_1 .. in the order of theta."""
        of = [f"b_{name}_" if len(inputs) > 1 else "b_" for name in inputs]
        out = [f"a_{j + 1}" for j in range(self.na)] + [f"{prefix}{j + self.nk}" for prefix in of for j in range(self.nb)]
        return out + ["d"] * self.offset + [f"c_{j + 1}" for j in range(self.nc)]


@dataclass(frozen=True, kw_only=True)
class Armax:
    """An estimated difference equation.

    theta (p,) as in `Orders.names`, covariance (p, p); variance of the innovations [unit of y squared]; innovations (n,), NaN for the
    first `orders.lag`; step [s]; aic, bic.
    """

    recording: Recording
    output: str
    inputs: tuple[str, ...]
    orders: Orders
    theta: Array
    covariance: Array
    variance: float
    innovations: Array
    step: float
    aic: float
    bic: float

    @property
    def A(self) -> Array:
        """Coefficients of A, 1 first, (na + 1,)."""
        return np.concatenate([[1.0], self.theta[: self.orders.na]])

    @property
    def B(self) -> Array:
        """Coefficients of the B_i from q^0 on, (inputs, nk + nb)."""
        o = self.orders
        b = self.theta[o.na : o.na + len(self.inputs) * o.nb].reshape(len(self.inputs), o.nb)
        return np.hstack([np.zeros((len(self.inputs), o.nk)), b])

    @property
    def C(self) -> Array:
        """Coefficients of C, 1 first, (nc + 1,)."""
        return np.concatenate([[1.0], self.theta[len(self.theta) - self.orders.nc :]])

    @property
    def offset(self) -> float:
        """d [unit of y]; zero where the orders have none."""
        return float(self.theta[len(self.theta) - self.orders.nc - 1]) if self.orders.offset else 0.0

    def baseline(self) -> Baseline:
        """The coefficients, and the fit of the prediction one sample ahead."""
        std = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        found = zip(self.orders.names(self.inputs), self.theta, std, strict=True)
        y = self.recording.outputs[self.output]
        k = self.orders.lag
        return Baseline(
            method="armax",
            model=f"difference equation of {self.output} at {self.step:.6g} s",
            parameters={
                n: ParameterEstimate(name=n, value=float(v), std=float(s), unit="1", fixed=False, identifiable=True) for n, v, s in found
            },
            fit={self.recording.name: {self.output: output_fit(y[k:], (y - self.innovations)[k:])}},
            predicted="one step ahead",
            notes=(f"Innovations of {np.sqrt(self.variance):.4g} rms; AIC {self.aic:.6g}, BIC {self.bic:.6g}.",),
        )


def armax(recording: Recording, *, output: str, orders: Orders, inputs: Sequence[str] | None = None) -> Armax:
    """The difference equation of one output.

    inputs: those that enter it (None: all recorded). Raises InputError for unequal steps, missing samples, unknown names, or a recording
    that is too short for the orders.
    """
    y, u, names, step = series(recording, output, inputs, orders, "armax")
    return _fitted(recording, output, names, y, u, orders, step, orders.lag)


def select_orders(
    recording: Recording,
    *,
    output: str,
    candidates: Iterable[Orders],
    inputs: Sequence[str] | None = None,
    criterion: Literal["aic", "bic"] = "bic",
) -> tuple[Armax, ...]:
    """The models of all candidate orders, the best by `criterion` first; all are judged on the samples that the longest lag leaves."""
    if criterion not in ("aic", "bic"):
        raise InputError(f'select_orders(criterion={criterion!r}): the criterion is "aic" or "bic".')
    tried = list(candidates)
    if not tried:
        raise InputError("select_orders(candidates=[]): needs at least one Orders(...).")
    longest = max(tried, key=lambda o: o.lag)
    y, u, names, step = series(recording, output, inputs, longest, "select_orders")
    models = [_fitted(recording, output, names, y, u, o, step, longest.lag) for o in tried]
    return tuple(sorted(models, key=lambda m: m.aic if criterion == "aic" else m.bic))


def series(
    recording: Recording, output: str, inputs: Sequence[str] | None, orders: Orders, method: str
) -> tuple[Array, Array, tuple[str, ...], float]:
    """y (n,), u (nu, n), the inputs' names and the step [s] of a recording that a difference equation can be fitted to.

    Inputs that change between the rows count by their mean from row to row.
    """
    step = uniform_step(recording, method)
    y = complete_output(recording, output, method)
    names = tuple(recording.inputs) if inputs is None else tuple(inputs)
    unknown = [name for name in names if name not in recording.inputs]
    if unknown:
        raise InputError(f"{recording.name}: input {listed(unknown)} is not recorded; {suggestion(unknown[0], recording.inputs)}")
    count = len(orders.names(names))
    if len(y) < 3 * count + orders.lag:
        raise InputError(
            f"{recording.name}: {len(y)} samples are too few for {count} coefficients over {orders.lag} samples; lower the orders."
        )
    return y, row_inputs(recording, names)[0], names, step


def regressors(y: Array, u: Array, orders: Orders) -> Array:
    """[-q^-j y, q^-(nk+j-1) u_i, 1]: the columns of (a, b, d), (n, p - nc); zero before the first sample."""
    columns = [-_delayed(y, j + 1) for j in range(orders.na)]
    columns += [_delayed(row, orders.nk + j) for row in u for j in range(orders.nb)]
    columns += [np.ones_like(y)] * orders.offset
    return np.column_stack(columns) if columns else np.empty((len(y), 0))


def _delayed(values: Array, lag: int) -> Array:
    return np.concatenate([np.zeros(lag), values[: len(values) - lag]]) if lag else values


def _fitted(
    recording: Recording, output: str, names: tuple[str, ...], y: Array, u: Array, orders: Orders, step: float, first: int
) -> Armax:
    """Gauss-Newton; the samples before `first` are in the regressors only."""
    phi, target = regressors(y, u, orders)[first:], y[first:]
    linear, nc = phi.shape[1], orders.nc
    theta = _start(y, u, orders, first)
    e = _innovations(theta, phi, target, nc)
    for _ in range(ITERATIONS):
        psi = _gradient(theta, phi, e, nc)
        size = np.sqrt(np.sum(psi**2, axis=0))
        size[size == 0] = 1.0
        change = np.linalg.lstsq(psi / size, e, rcond=1e-12)[0] / size
        cost = float(e @ e)
        for halving in range(HALVINGS):
            trial = theta + change / 2**halving
            trial[linear:] = _inside(trial[linear:])
            after = _innovations(trial, phi, target, nc)
            if float(after @ after) < cost:
                break
        else:
            break
        theta, e = trial, after
        if cost - float(e @ e) < SETTLED * cost or nc == 0:
            break
    psi = _gradient(theta, phi, e, nc)
    n, p = len(e), len(theta)
    variance = float(e @ e) / max(1, n - p)
    logarithm = n * np.log(max(float(e @ e) / n, 1e-300))
    size = np.sqrt(np.sum(psi**2, axis=0))
    size[size == 0] = 1.0
    return Armax(
        recording=recording,
        output=output,
        inputs=names,
        orders=orders,
        theta=theta,
        covariance=variance * np.linalg.pinv((psi / size).T @ (psi / size), hermitian=True) / np.outer(size, size),
        variance=variance,
        innovations=np.concatenate([np.full(first, np.nan), e]),
        step=step,
        aic=float(logarithm + 2 * p),
        bic=float(logarithm + p * np.log(n)),
    )


def _start(y: Array, u: Array, orders: Orders, first: int) -> Array:
    if not orders.nc:
        return np.asarray(np.linalg.lstsq(regressors(y, u, orders)[first:], y[first:], rcond=None)[0])
    long = Orders(na=max(orders.na, 2 * orders.nc) + 10, nb=(orders.nb + 10) if orders.nb else 0, nk=orders.nk, offset=orders.offset)
    rows = min(long.lag, len(y) // 3)
    X = regressors(y, u, long)
    e = y - X @ np.linalg.lstsq(X[rows:], y[rows:], rcond=None)[0]
    e[:rows] = 0.0
    wide = np.hstack([regressors(y, u, orders), np.column_stack([_delayed(e, j + 1) for j in range(orders.nc)])])
    theta = np.asarray(np.linalg.lstsq(wide[first:], y[first:], rcond=None)[0], dtype=np.float64)
    theta[len(theta) - orders.nc :] = _inside(theta[len(theta) - orders.nc :])
    return theta


def _innovations(theta: Array, phi: Array, target: Array, nc: int) -> Array:
    linear = len(theta) - nc
    return np.asarray(lfilter([1.0], np.concatenate([[1.0], theta[linear:]]), target - phi @ theta[:linear]))


def _gradient(theta: Array, phi: Array, e: Array, nc: int) -> Array:
    columns = np.hstack([phi, *([_delayed(e, j + 1)[:, None] for j in range(nc)])])
    return np.asarray(lfilter([1.0], np.concatenate([[1.0], theta[len(theta) - nc :]]), columns, axis=0))


def _inside(c: Array) -> Array:
    """The coefficients of C with the roots outside the unit circle mirrored into it."""
    if not len(c):
        return c
    roots = np.roots(np.concatenate([[1.0], c]))
    size = np.abs(roots)
    if np.all(size <= MARGIN):
        return c
    mirrored = np.where(size > 1, roots / size**2, roots)
    mirrored = np.where(np.abs(mirrored) > MARGIN, MARGIN * mirrored / np.abs(mirrored), mirrored)
    padded = np.real(np.poly(mirrored))[1:]
    return np.concatenate([padded, np.zeros(len(c) - len(padded))])
