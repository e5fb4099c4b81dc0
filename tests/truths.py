"""Independent solutions that tests compare with. Nothing here imports the package; only numpy and scipy.

    motion, disturbed, stiffening_motion      what a plant does: matrix exponentials, Van Loan, scipy's integrators
    smoothed                                  Kalman filter and Rauch-Tung-Striebel smoother on the exact discretisation
    splines, radau_collocation                the discretised estimation problem as one dense Gaussian, in a basis of its own
    differences                               derivatives by differences of sixth order
    orders                                    measured orders of convergence

The plant of most tests, x = (f, s, v) or (s, v):   T f' = u - f,   s' = v,   m v' = f - d v - k s - offset + w
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import BSpline
from scipy.linalg import expm, null_space
from scipy.special import eval_legendre, roots_jacobi

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Plant:
    """m v' = f - d v - k s - offset + w behind a lag T f' = u - f; T = 0: f = u, and the states are (s, v)."""

    m: float
    d: float
    k: float
    offset: float
    T: float = 0.0

    @property
    def matrices(self) -> tuple[Array, Array, Array]:
        """A, B, G of x' = A x + B (u, 1) + G w."""
        m, d, k = self.m, self.d, self.k
        if self.T == 0.0:
            return np.array([[0, 1], [-k / m, -d / m]]), np.array([[0, 0], [1 / m, -self.offset / m]]), np.array([[0], [1 / m]])
        A = np.array([[-1 / self.T, 0, 0], [0, 0, 1], [1 / m, -k / m, -d / m]])
        return A, np.array([[1 / self.T, 0], [0, 0], [0, -self.offset / m]]), np.array([[0], [0], [1 / m]])


# ---------------------------------------------------------------- motions


def discrete(A: Array, B: Array, h: float) -> tuple[Array, Array]:
    """Phi, Gamma of the step h with held input."""
    n, m = B.shape
    block = expm(h * np.block([[A, B], [np.zeros((m, n + m))]]))
    return block[:n, :n], block[:n, n:]


def noise_covariance(A: Array, G: Array, density: float, h: float) -> Array:
    """Covariance of what white noise of this density adds over the step h (Van Loan 1978)."""
    n = len(A)
    block = expm(h * np.block([[-A, density * G @ G.T], [np.zeros((n, n)), A.T]]))
    return block[n:, n:].T @ block[:n, n:]


def motion(plant: Plant, time: Array, u: Array, start: Array) -> Array:
    """States (n, nx) at `time` under held inputs u (n,), exact."""
    return disturbed(plant, time, u, start, 0.0, np.random.default_rng(0))


def disturbed(plant: Plant, time: Array, u: Array, start: Array, force_std: float, rng: np.random.Generator) -> Array:
    """The same with a white residual force of density force_std^2, exact in distribution."""
    A, B, G = plant.matrices
    x = [np.asarray(start, dtype=float)]
    for h, now in zip(np.diff(time), u[:-1], strict=True):
        phi, gamma = discrete(A, B, h)
        step = phi @ x[-1] + gamma @ np.array([now, 1.0])
        if force_std:
            size, vectors = np.linalg.eigh(noise_covariance(A, G, force_std**2, h))
            step = step + vectors @ (np.sqrt(np.maximum(size, 0.0)) * rng.standard_normal(len(step)))
        x.append(step)
    return np.array(x)


def linearly_driven(plant: Plant, time: Array, u: Array, start: Array) -> Array:
    """States (n, nx) under inputs that run straight from sample to sample: the slope is a state of its own; exact."""
    A, B, _ = plant.matrices
    n = len(A)
    wide = np.zeros((n + 3, n + 3))
    wide[:n, :n], wide[:n, n : n + 2], wide[n, n + 2] = A, B, 1.0
    x = [np.asarray(start, dtype=float)]
    for k, h in enumerate(np.diff(time)):
        x.append((expm(h * wide) @ np.concatenate([x[-1], [u[k], 1.0, (u[k + 1] - u[k]) / h]]))[:n])
    return np.array(x)


def stiffening_motion(plant: Plant, hardening: float, coulomb: float, width: float, time: Array, u: Array, start: Array) -> Array:
    """States (f, s, v) of the plant with z + a z^3 = s in place of s in the spring, and friction f_c tanh(v / width); held inputs."""

    def deflection(s: float) -> float:
        roots = np.roots([hardening, 0.0, 1.0, -s])
        return float(roots[np.argmin(np.abs(roots.imag))].real)

    def rate(_: float, x: Array, force: float) -> list[float]:
        f, s, v = x
        pull = plant.k * deflection(s) + plant.d * v + plant.offset + coulomb * np.tanh(v / width)
        return [(force - f) / plant.T, v, (f - pull) / plant.m]

    x = [np.asarray(start, dtype=float)]
    for a, b, now in zip(time[:-1], time[1:], u[:-1], strict=True):
        x.append(solve_ivp(rate, (a, b), x[-1], method="DOP853", rtol=1e-12, atol=1e-14, args=(now,)).y[:, -1])
    return np.array(x)


# ---------------------------------------------------------------- smoothers


def smoothed(
    A: Array, B: Array, G: Array, C: Array, *, time: Array, u: Array, y: Array, std: Array, density: float, vague: float
) -> tuple[Array, Array]:
    """Means (n, nx) and covariances (n, nx, nx) of the Rauch-Tung-Striebel smoother; u (n, nu) held, y and std (n, ny), NaN where missing.

    The start is known to be zero with standard deviation `vague` in every state.
    """
    n, nx = len(time), len(A)
    x, P = np.zeros(nx), np.eye(nx) * vague**2
    filtered, predicted, steps = [], [], []
    for k in range(n):
        if k:
            h = time[k] - time[k - 1]
            phi, gamma = discrete(A, B, h)
            x, P = phi @ x + gamma @ u[k - 1], phi @ P @ phi.T + noise_covariance(A, G, density, h)
            steps.append(phi)
        predicted.append((x, P))
        there = np.isfinite(y[k])
        H, R = C[there], np.diag(std[k, there] ** 2)
        gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        x = x + gain @ (y[k, there] - H @ x)
        keep = np.eye(nx) - gain @ H
        P = keep @ P @ keep.T + gain @ R @ gain.T
        filtered.append((x, P))
    means, covariances = [filtered[-1][0]], [filtered[-1][1]]
    for k in range(n - 2, -1, -1):
        x, P = filtered[k]
        gain = P @ steps[k].T @ np.linalg.inv(predicted[k + 1][1])
        means.append(x + gain @ (means[-1] - predicted[k + 1][0]))
        covariances.append(P + gain @ (covariances[-1] - predicted[k + 1][1]) @ gain.T)
    return np.array(means[::-1]), np.array(covariances[::-1])


@dataclass(frozen=True, kw_only=True)
class Gaussian:
    """Mean and covariance of the unknowns of a dense linear problem; the last unknown is the offset when it is free.

    rows(t): matrices (len(t), nx, unknowns) that give the states at times t.
    """

    mean: Array
    covariance: Array
    rows: Callable[[Array], Array]

    def states(self, times: Array) -> tuple[Array, Array]:
        """Means and variances of the states at any times, each (len(times), nx)."""
        rows = self.rows(times)
        return rows @ self.mean, np.einsum("nij,jk,nik->ni", rows, self.covariance, rows)


def least_squares(rows: Array, targets: Array, fixed: Array, values: Array) -> tuple[Array, Array]:
    """Mean and covariance of min |rows x - targets|^2 subject to fixed x = values, on the null space of the constraints."""
    if not len(fixed):
        fixed, values = np.zeros((0, rows.shape[1])), np.zeros(0)
    particular = np.linalg.lstsq(fixed, values, rcond=None)[0] if len(fixed) else np.zeros(rows.shape[1])
    Z = null_space(fixed) if len(fixed) else np.eye(rows.shape[1])
    q, r = np.linalg.qr(rows @ Z)
    inverse = np.linalg.inv(r)
    mean = particular + Z @ (inverse @ (q.T @ (targets - rows @ particular)))
    return mean, Z @ inverse @ inverse.T @ Z.T


@dataclass(frozen=True, kw_only=True)
class Task:
    """A linear smoothing task on a mesh: y (n, 2) positions and velocities with deviations std (n, 2), NaN where there are none.

    initial, initial_std: of the states at the start; inf = nothing known, 0 = exactly. free_offset: the plant's offset is unknown.
    """

    plant: Plant
    knots: Array
    degree: int
    time: Array
    u: Array
    y: Array
    std: Array
    force_std: float
    initial: Array
    initial_std: Array
    free_offset: bool = True

    def cells(self, points: int) -> tuple[Array, Array, Array]:
        """Interval, time and weight of Gauss points on all cells between knots and changes of the input."""
        inside = self.time[(self.time > self.knots[0]) & (self.time < self.knots[-1])]
        edges = np.union1d(self.knots, inside)
        x, weight = np.polynomial.legendre.leggauss(points)
        time = (edges[:-1, None] + np.diff(edges)[:, None] * (x + 1) / 2).ravel()
        return np.searchsorted(self.knots, time) - 1, time, (np.diff(edges)[:, None] * weight / 2).ravel()

    def held(self, times: Array) -> Array:
        """The held input."""
        return self.u[np.clip(np.searchsorted(self.time, times, side="right") - 1, 0, len(self.u) - 1)]


def _measured(task: Task, states: Callable[[Array], Array], size: int) -> tuple[list[Array], list[float], list[Array], list[float]]:
    """Rows and targets of the samples and of the start; rows and values of what is known exactly."""
    at, start = states(task.time), states(task.knots[:1])[0]
    first = at.shape[1] - 2
    rows, targets, fixed, values = [], [], [], []
    for k, i in zip(*np.nonzero(np.isfinite(task.y)), strict=True):
        rows.append(at[k, first + i] / task.std[k, i])
        targets.append(task.y[k, i] / task.std[k, i])
    for i, std in enumerate(task.initial_std):
        if std == 0:
            fixed.append(start[i])
            values.append(task.initial[i])
        elif np.isfinite(std):
            rows.append(start[i] / std)
            targets.append(task.initial[i] / std)
    return rows, targets, fixed, values


def splines(task: Task) -> Gaussian:
    """The soft problem over C1 positions of degree K + 1 and C0 forces of degree K, in the basis of B-splines.

    Rows: 1/(std sqrt h) int L_j w dt for the balance, the same integrals of T f' - u + f exactly zero; inputs integrated as they are.
    """
    K, N, knots, plant = task.degree, len(task.knots) - 1, task.knots, task.plant
    lag = plant.T > 0

    def basis(degree: int) -> BSpline:
        # every inner knot K times: of degree K + 1 it is C1 there, of degree K it is C0
        ends = np.repeat(knots[[0, -1]], degree + 1)
        t = np.concatenate([ends[: degree + 1], np.repeat(knots[1:-1], K), ends[degree + 1 :]])
        count = len(t) - degree - 1
        return BSpline(t, np.eye(count), degree)

    s, f = basis(K + 1), basis(K)
    ns, nf = s.c.shape[0], f.c.shape[0] if lag else 0
    size = ns + nf + task.free_offset

    def columns(values: Array, start: int) -> Array:
        out = np.zeros((len(values), size))
        out[:, start : start + values.shape[1]] = values
        return out

    def states(times: Array) -> Array:
        parts = [columns(s(times), 0), columns(s(times, 1), 0)]
        return np.stack(([columns(f(times), ns)] if lag else []) + parts, axis=1)

    interval, time, weight = task.cells(10)
    h = np.diff(knots)[interval]
    tau = (time - knots[interval]) / h
    balance = columns(plant.m * s(time, 2) + plant.d * s(time, 1) + plant.k * s(time), 0)
    u = task.held(time)
    if lag:
        balance -= columns(f(time), ns)
        law, drive = columns(plant.T * f(time, 1) + f(time), ns), u
    known = np.zeros(len(time)) if lag else u
    if task.free_offset:
        balance[:, -1] += 1.0
    else:
        known = known - plant.offset
    rows, targets, fixed, values = _measured(task, states, size)
    for i in range(N):
        here = interval == i
        for j in range(K):
            moment = np.sqrt(2 * j + 1) * eval_legendre(j, 2 * tau[here] - 1) * weight[here] / np.sqrt(h[here])
            rows.append(moment @ balance[here] / task.force_std)
            targets.append(moment @ known[here] / task.force_std)
            if lag:
                fixed.append(moment @ law[here])
                values.append(moment @ drive[here])
    mean, covariance = least_squares(np.array(rows), np.array(targets), np.array(fixed), np.array(values))
    return Gaussian(mean=mean, covariance=covariance, rows=states)


def radau_collocation(task: Task) -> Gaussian:
    """The soft problem by Radau collocation: unknown states at the start and at all Radau points, unknown residual force at these."""
    K, N, knots, plant = task.degree, len(task.knots) - 1, task.knots, task.plant
    A, B, G = plant.matrices
    nx = len(A)
    inner = (roots_jacobi(K - 1, 1, 0)[0] + 1) / 2 if K > 1 else np.empty(0)
    places = np.concatenate([inner, [1.0]])
    nodes = np.concatenate([[0.0], places])
    to_power = np.linalg.inv(np.vander(nodes, increasing=True))  # values at the nodes -> powers of tau
    slope = np.array([[p * t ** max(p - 1, 0) for p in range(K + 1)] for t in places]) @ to_power
    b = np.linalg.solve(np.vander(places, increasing=True).T, 1 / np.arange(1, K + 1))
    size = nx * (N * K + 1) + N * K + task.free_offset
    x0, w0 = (lambda i: nx * K * i), (lambda i: nx * (N * K + 1) + K * i)

    def states(times: Array) -> Array:
        i = np.clip(np.searchsorted(knots, times, side="right") - 1, 0, N - 1)
        out = np.zeros((len(times), nx, size))
        for n, (k, t) in enumerate(zip(i, times, strict=True)):
            tau = (t - knots[k]) / (knots[k + 1] - knots[k])
            for j, value in enumerate(tau ** np.arange(K + 1) @ to_power):
                out[n, np.arange(nx), x0(k) + nx * j + np.arange(nx)] = value
        return out

    interval, time, weight = task.cells(10)
    rows, targets, fixed, values = _measured(task, states, size)
    for i in range(N):
        h, here = knots[i + 1] - knots[i], interval == i
        tau = (time[here] - knots[i]) / h
        projected = np.zeros(K)
        for j in range(K):
            moment = (2 * j + 1) / h * np.sum(weight[here] * eval_legendre(j, 2 * tau - 1) * task.held(time[here]))
            projected += moment * eval_legendre(j, 2 * places - 1)
        for c in range(K):
            row = np.zeros((nx, size))
            for j in range(K + 1):
                row[:, x0(i) + nx * j : x0(i) + nx * (j + 1)] += slope[c, j] / h * np.eye(nx)
            row[:, x0(i) + nx * (c + 1) : x0(i) + nx * (c + 2)] -= A
            row[:, w0(i) + c] = -G[:, 0]
            right = B[:, 0] * projected[c]
            if task.free_offset:
                row[-1, -1] = 1 / plant.m
            else:
                right = right + B[:, 1]
            fixed += list(row)
            values += list(right)
            rows.append(np.eye(size)[w0(i) + c] * np.sqrt(b[c] * h) / task.force_std)
            targets.append(0.0)
    mean, covariance = least_squares(np.array(rows), np.array(targets), np.array(fixed), np.array(values))
    return Gaussian(mean=mean, covariance=covariance, rows=states)


def bridge(K: int, tau: Array) -> Array:
    """Variance of Brownian motion B(tau) on [0, 1] once K Legendre moments are known: tau - sum_j (int_0^tau L_j)^2."""
    x, weight = np.polynomial.legendre.leggauss(20)
    out = np.array(tau, dtype=float)
    for j in range(K):
        inner = np.sqrt(2 * j + 1) * eval_legendre(j, 2 * (np.outer(tau, (x + 1) / 2)) - 1)
        out = out - (tau * (inner @ weight) / 2) ** 2
    return out


# ---------------------------------------------------------------- numbers about numbers


def differences(f: Callable[[Array], Array], x: Array, step: float = 1e-4) -> Array:
    """Jacobian of f at x by central differences of sixth order, shape (m, n)."""
    columns = []
    for i in range(len(x)):
        e = np.zeros(len(x))
        e[i] = step
        pairs = [np.asarray(f(x + k * e), dtype=float).ravel() - np.asarray(f(x - k * e), dtype=float).ravel() for k in (1, 2, 3)]
        columns.append((45 * pairs[0] - 9 * pairs[1] + pairs[2]) / (60 * step))
    return np.array(columns).T


def orders(errors: list[float]) -> Array:
    """log2 of the ratios of errors on meshes that are halved from one to the next."""
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
