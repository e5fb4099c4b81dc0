"""The model linearised along a trajectory, and what follows from that: how fine a mesh must be, and what moves between its knots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from backsight.models import Dae

from .columnwise import Columnwise, matrices
from .horizon import Horizon
from .mesh import Mesh
from .polynomials import Array


@dataclass(frozen=True, kw_only=True)
class Linear:
    """x' = A x + B u + G w,  y = C x + E u + D w at M places; w are the soft places' residual forces.

    A (M, nx, nx), B (M, nx, nu), G (M, nx, n_soft), C (M, ny, nx). D (M, ny, n_soft) and E (M, ny, nu) are what inputs and forces do to
    the outputs at once, through x' and z: an accelerometer reads the force that acts. (Where an output names an input itself, its
    value is known, and E leaves it out.) Zero where the model does not determine x'.
    """

    A: Array
    B: Array
    G: Array
    C: Array
    D: Array
    E: Array

    def taken(self, places: NDArray[np.int64]) -> Linear:
        """The same at some of the places, repeated at will."""
        return Linear(**{name: getattr(self, name)[places] for name in "ABGCDE"})


def linearise(dae: Dae, dx: Array, x: Array, z: Array, u: Array, t: Array, parameters: Array, soft: Sequence[int]) -> Linear:
    """The model linearised at M places: dx, x (nx, M), z (nz, M), u (nu, M), t (M,); parameters (np_all,)."""
    unknown = ca.vertcat(dae.dx, dae.z)
    parts = [ca.jacobian(dae.residual, unknown), ca.jacobian(dae.residual, dae.x), ca.jacobian(dae.residual, dae.u)]
    parts += [ca.jacobian(dae.residual, dae.w)[:, list(soft)], ca.jacobian(dae.output, dae.x), ca.jacobian(dae.output, unknown)]
    parts += [ca.jacobian(dae.output, dae.w)[:, list(soft)]]
    answers = [ca.densify(ca.vec(dae.undisturbed(e))) for e in parts]
    function = Columnwise(ca.Function("linear", [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.t], answers), (4,))
    nx, nu = dae.x.shape[0], dae.u.shape[0]
    values = function(dx, x, z, u, parameters, t[None, :])
    F_e, F_x, F_u, F_w, H_x, H_e, H_w = (matrices(v, *e.shape) for v, e in zip(values, parts, strict=True))
    right = np.concatenate([F_x, F_u, F_w], axis=2)
    slopes = np.zeros_like(right)
    usable = np.flatnonzero(np.abs(np.linalg.det(F_e)) > 0)
    slopes[usable] = -np.linalg.solve(F_e[usable], right[usable])
    slopes[~np.isfinite(slopes)] = 0.0
    A, B, G = np.split(slopes, [nx, nx + nu], axis=2)
    return Linear(A=A[:, :nx], B=B[:, :nx], G=G[:, :nx], C=H_x + H_e @ A, D=H_w + H_e @ G, E=H_e @ B)


def fastest_rate(linear: Linear, force_std: Array, sample_density: Array) -> float:
    """Median over the places of the fastest mode of the smoother [rad/s]: how fast its answer can move.

    With residual forces of spectral density Q = force_std^2 (n_soft,) and samples of density R = sample_density = r^2 dt (ny,), inf for an
    output without samples, the smoother has the modes of

        | A - G S C           G (Q - S D Q) G'   |         S = Q D' (R + D Q D')^-1,
        | C' (R + D Q D')^-1 C    -(A - G S C)'  |

    half of them stable and half of them not (Bryson & Ho, Applied Optimal Control, section 13.3, D = 0; else the force is first estimated
    from the reading that it enters); with Q = 0 they are the plant's own.
    """
    R = np.diag(1.0 / sample_density)
    A, G, C, D, nx = linear.A, linear.G, linear.C, linear.D, linear.A.shape[1]
    # in a form for R = inf and Q = 0:  (R + D Q D')^-1 = R^-1 - R^-1 D P D' R^-1,  Q - S D Q = P = F (1 + F D' R^-1 D F)^-1 F,  F^2 = Q
    F = np.diag(np.abs(force_std))
    P = F @ np.linalg.inv(np.eye(len(force_std)) + F @ _t(D) @ R @ D @ F) @ F
    inverse, A = R - R @ D @ P @ _t(D) @ R, A - G @ P @ _t(D) @ R @ C
    noise = G @ P @ _t(G)
    information = _t(C) @ inverse @ C
    # the same modes with both halves of comparable size: noise densities span many decades
    upper, lower = np.abs(noise).max(axis=(1, 2), initial=0.0), np.abs(information).max(axis=(1, 2), initial=0.0)
    balance = np.sqrt(np.where((upper > 0) & (lower > 0), lower / np.where(upper > 0, upper, 1.0), 1.0))[:, None, None]
    hamiltonian = np.zeros((len(A), 2 * nx, 2 * nx))
    hamiltonian[:, :nx, :nx], hamiltonian[:, nx:, nx:] = A, -_t(A)
    hamiltonian[:, :nx, nx:], hamiltonian[:, nx:, :nx] = noise * balance, information / balance
    return float(np.median(np.abs(np.linalg.eigvals(hamiltonian)).max(axis=1))) if len(hamiltonian) else 0.0


def without_followers(linear: Linear) -> Linear:
    """The plant without states that only follow it, such as a sensor's lag, and the outputs with what is followed in their place.

    Nothing enters such a state from outside and no other one hangs on it, so it is as smooth as what it follows, however fast it is:

        x_f' = a_f x_f + A_f x,  a_f < 0:          x_f -> -A_f x / a_f

    for a fast one (singular perturbation); a slow one only tells less of the plant than that.
    """
    A, B, G, C = linear.A, linear.B, linear.G, linear.C
    while True:
        inside = np.einsum("mii->mi", A)
        alone = ~np.any(np.where(np.eye(A.shape[1], dtype=bool), 0.0, A), axis=(0, 1)) & np.all(inside < 0, axis=0)
        followers = np.flatnonzero(alone & ~B.any(axis=(0, 2)) & ~G.any(axis=(0, 2)))
        if not len(followers):
            return Linear(A=A, B=B, G=G, C=C, D=linear.D, E=linear.E)
        i, rest = followers[0], np.delete(np.arange(A.shape[1]), followers[0])
        followed = -A[:, i, rest] / inside[:, i, None]
        C = C[:, :, rest] + C[:, :, i, None] * followed[:, None, :]
        A, B, G = A[:, rest][:, :, rest], B[:, rest], G[:, rest]


def direct_share(linear: Linear, force_std: Array, sample_density: Array) -> float:
    """Largest share, over the outputs, of D Q D' in their sample density R: how much of the noise of a reading is the force itself.

    Such a force is estimated from sample to sample, however slow the plant. Median over the places.
    """
    entering = np.median(np.sum((linear.D * force_std) ** 2, axis=2), axis=0)
    return float(np.max(entering / sample_density, initial=0.0))


def driven_outputs(linear: Linear, duration: float, share: float = 0.5) -> Array:
    """Standard deviation of the outputs after `duration` [s] when one residual force of std one drives the plant from rest, (ny, n_soft).

    x' = A x + G w: P(T) = int_0^T e^(A s) G G' e^(A' s) ds, by Van Loan's exponential over a short span and doublings
    P(2 T) = P(T) + e^(A T) P(T) e^(A' T). What enters an output at once, D w, counts with its mean over the duration, of variance D D'/T.
    Of the places, what a share of them stays below: the median.
    """
    A, nx = linear.A, linear.A.shape[1]
    # an unstable place would overflow; what it does in ten of its time constants is enough to know
    growth = np.linalg.eigvals(A).real.max(axis=1, initial=0.0)
    span = np.minimum(duration, 10.0 / np.maximum(growth, 1e-12))
    doublings = max(0, int(np.ceil(np.log2(max(float((span * np.abs(A).sum(axis=2).max(axis=1, initial=0.0)).max(initial=0.0)), 1e-12)))))
    out = []
    for k in range(linear.G.shape[2]):
        g = linear.G[:, :, k]
        block = np.zeros((len(A), 2 * nx, 2 * nx))
        block[:, :nx, :nx], block[:, nx:, nx:], block[:, :nx, nx:] = -A, _t(A), g[:, :, None] * g[:, None, :]
        block = _exponential(block * (span / 2.0**doublings)[:, None, None])
        step = _t(block[:, nx:, nx:])
        P = step @ block[:, :nx, nx:]
        for _ in range(doublings):
            P, step = P + step @ P @ _t(step), step @ step
        variance = np.einsum("mij,mjk,mik->mi", linear.C, P, linear.C) + linear.D[:, :, k] ** 2 / duration
        out.append(np.quantile(np.sqrt(np.maximum(variance, 0.0)), share, axis=0))
    return np.array(out).reshape(linear.G.shape[2], linear.C.shape[1]).T


def left_out_of_outputs(linear: Linear, step: Array, impulse: Array, steps: Array) -> Array:
    """How far outputs move between the knots by what the mesh leaves out of an input, (ny, N).

    Its largest value, step (nu, N), enters an output at once by E * step; its largest impulse (nu, N) moves x by B * impulse, and what
    integrates x by A B * impulse * h/4.
    """
    direct = np.median(np.abs(linear.C @ linear.B), axis=0)
    integrated = np.median(np.abs(linear.C @ linear.A @ linear.B), axis=0)
    at_once = np.median(np.abs(linear.E), axis=0)
    return np.asarray(at_once @ step + direct @ impulse + integrated @ impulse * steps / 4, dtype=np.float64)


def driven_between_knots(linear: Linear, first: Array, second: Array) -> Array:
    """What the unresolved part of the input adds to the states at the samples, (nx, M).

    first, second (nu, M): its first and second integrals since the last knot (`Horizon.unresolved_integrals`):

        x += B first + A B second            (the next term is smaller by |A| h, and at the knots nothing is left but that of order h^3)
    """
    step = np.einsum("mij,jm->im", linear.B, first)
    return np.asarray(step + np.einsum("mij,mjk,km->im", linear.A, linear.B, second, optimize=True))


def bridge_variance(mesh: Mesh, degree: int, interval: Array, tau: Array) -> Array:
    """Variance per density of the Brownian motion that white forces drive between the knots beyond their `degree` moments, (M,) [s].

    h ( tau (1 - tau) - sum_(j=1)^(K-1) (int_0^tau L_j)^2 ),       zero at the knots
    """
    resolved = sum((np.sqrt(2.0 * j + 1.0) * _legendre_integral(j, tau)) ** 2 for j in range(1, degree))
    return np.asarray(np.maximum(tau * (1 - tau) - resolved, 0.0) * mesh.steps[interval], dtype=np.float64)


def averaging(horizon: Horizon, degree: int, outputs: Sequence[int]) -> Array:
    """Coefficients c (K outputs, n), those of an output together, of a force's moments in the force that its sensor averages.

    int over [t_k, t_k + dt] of L_j / dt, dt the output's own sampling interval, as far as the mesh interval reaches (at its end: the dt
    before), and all of them times what makes the variance of a white force, sum_j c_j^2 / h, that of the average, 1/dt: what is beyond the
    interval or its moments is as loud as the rest.
    """
    interval, tau = horizon.mesh.locate(horizon.time)
    h, parts = horizon.mesh.steps[interval], []
    for i in outputs:
        own = horizon.time[np.isfinite(horizon.target[:, i])]
        dt = float(np.median(np.diff(own if len(own) > 1 else horizon.time)))
        begin = np.where(tau < 1.0, tau, np.maximum(1.0 - dt / h, 0.0))
        end = np.minimum(begin + dt / h, 1.0)
        c = np.array([np.sqrt(2.0 * j + 1.0) * (_legendre_integral(j, end) - _legendre_integral(j, begin)) for j in range(degree)])
        parts.append(c * np.sqrt(h / dt / np.sum(c**2, axis=0)))
    return np.vstack(parts)


def _exponential(matrices: Array) -> Array:
    """e^M of many small matrices at once by Taylor's series, for norms of about one."""
    out = term = np.broadcast_to(np.eye(matrices.shape[1]), matrices.shape)
    for k in range(1, 19):
        term = term @ matrices / k
        out = out + term
    return out


def _legendre_integral(order: int, tau: Array) -> Array:
    """int_0^tau P_order(2 s - 1) ds = (P_(order+1) - P_(order-1)) / (2 (2 order + 1)), tau for order 0."""
    if order == 0:
        return np.asarray(tau, dtype=np.float64)
    P = np.polynomial.legendre.legvander(2.0 * tau - 1.0, order + 1).T
    return np.asarray((P[order + 1] - P[order - 1]) / (2.0 * (2.0 * order + 1.0)), dtype=np.float64)


def _t(matrices: Array) -> Array:
    return np.swapaxes(matrices, -1, -2)
