"""What is known of [x; p] at an instant, as a Gaussian, and how a model's stages, its samples and exact conditions change it.

Over a stage (`stage.py`) with unknowns [x | own], own = [interior | x'], linearised about its course without residual force,

    J_own d own = -J_(x, p) d[x; p] + [0; e],    e ~ N(0, I)        so   x' = Phi [x; p] + Gamma e,    L <- [Phi L, Gamma]

and samples J [x; p] + g = e ~ N(0, I) are told by one triangular factor (T. Kailath, A. H. Sayed & B. Hassibi, Linear Estimation, 2000,
section 12.3)

    | I   J L |         | S   0  |       P = L L',    S S' = J P J' + I
    | 0    L  |   Q  =  | K   L+ |

an extended Kalman filter in root covariance form. Unlike an information it takes what is known exactly, and what decays within a stage is
no trouble: of a state without noise the information grows without end.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..called import Called
from ..polynomials import Array
from .stage import Stage

STEPS, PRECISE = 20, 1e-9  # Newton steps in a stage or at an instant, and the relative size of the last one


def triangular_root(columns: Array) -> Array:
    """L (n, n), lower triangular, with L L' = A A' for columns A (n, m), m >= n."""
    return np.asarray(np.linalg.qr(columns.T, mode="r")).T


@dataclass(frozen=True, kw_only=True)
class Belief:
    """[x; p] ~ N(mean, root root'): mean (n,), root (n, n)."""

    mean: Array
    root: Array

    @property
    def std(self) -> Array:
        """Deviations (n,)."""
        return np.asarray(np.sqrt(np.sum(self.root**2, axis=1)))

    def told(self, J: Array, g: Array) -> tuple[Belief, float]:
        """After g + J ([x; p] - mean) = e ~ N(0, I) (m,), and the logarithm of how likely that was but for (2 pi)^(-m/2)."""
        m, n = J.shape
        before = np.block([[np.eye(m), J @ self.root], [np.zeros((n, m)), self.root]])
        after = triangular_root(before)
        S, K = after[:m, :m], after[m:, :m]
        e = np.linalg.solve(S, -g)
        likelihood = -0.5 * float(e @ e) - float(np.sum(np.log(np.abs(np.diag(S)))))
        return Belief(mean=self.mean + K @ e, root=after[m:, m:]), likelihood

    def reshaped(self, J: Array, move: float, ratio: float) -> Belief:
        """With J [x; p], (n,), moved by `move` and its deviation multiplied by `ratio`; all else goes with it by regression."""
        across = J @ self.root
        variance = float(across @ across)
        if variance == 0.0:
            return self
        K = self.root @ across / variance
        return Belief(mean=self.mean + K * move, root=self.root - (1.0 - ratio) * np.outer(K, across))

    def switched(self, jump: Array, J: Array, rate: float) -> Belief:
        """Carried over to other equations, in which x' (nx,) is larger by `jump`, since the instant at which J [x; p] was at its mean.

        It passed there at a rate, so that one that is off by d is off by d/rate in time, and for so long the other equations held
        (the saltation matrix: N. J. Kong, J. J. Payne, G. Council & A. M. Johnson, The Salted Kalman Filter, Automatica 131, 2021).
        """
        root = self.root.copy()
        root[: len(jump)] += np.outer(jump / rate, J @ self.root)
        return Belief(mean=self.mean, root=root)


@dataclass(frozen=True, kw_only=True)
class Instant:
    """Under an input and without residual force: margins g (m,), their derivatives J (m, n) in [x; p], and x' (nx,).

    std: deviations (m,) of the margins; noise: those that the residual forces add, which differ from one interval to the next.
    """

    g: Array
    J: Array
    std: Array
    noise: Array
    rate: Array


class Flow:
    """A model's way from one instant to another; margins: expressions in x', x, z, u, p, t.

    bounds (np, 2) of p; force_std (n_soft,): deviations of residual forces, as they act at an instant.
    """

    def __init__(self, stage: Stage, margins: Any, bounds: Array, force_std: Array) -> None:
        self.stage, self._bounds, self._force_std = stage, bounds, force_std
        self._balances, self._last, self._instant = Called(stage.balances), Called(stage.last), Called(_instant(stage, margins))
        self._v = np.concatenate([np.zeros(stage.interpolation.states), [q.start for q in stage.dae.algebraics]])

    def over(self, belief: Belief, d: Array) -> Belief:
        """At the end of a stage with the numbers d (nd,)."""
        ip, nx = self.stage.interpolation, self.stage.interpolation.states
        end, J = self._course(belief.mean[:nx], belief.mean[nx:], d)
        own = slice(nx, ip.local)
        noisy = self.stage.degree * len(self.stage.soft)
        right = np.column_stack([-J[:, :nx], -J[:, ip.local :], np.eye(len(J))[:, len(J) - noisy :]])
        moved = np.linalg.solve(J[:, own], right)[ip.interior :]
        n = len(belief.mean)
        root = np.zeros((n, n + noisy))
        root[:nx] = np.column_stack([moved[:, :n] @ belief.root, moved[:, n:]])
        root[nx:, :n] = belief.root[nx:]
        return Belief(mean=np.concatenate([end, belief.mean[nx:]]), root=triangular_root(root))

    def sampled(self, belief: Belief, newest: Array) -> tuple[Belief, float]:
        """After a sample with the numbers `newest`, and the logarithm of its likelihood but for a constant."""
        nx = self.stage.interpolation.states
        e, J = self._last(belief.mean[:nx], belief.mean[nx:], newest)
        there = np.abs(newest[len(newest) - len(e) :]) > 0
        after, likelihood = belief.told(J[there], e[there, 0])
        mean = after.mean.copy()
        mean[nx:] = np.clip(mean[nx:], *self._bounds.T)
        return Belief(mean=mean, root=after.root), likelihood

    def outputs(self, x: Array, p: Array, newest: Array) -> Array:
        """Outputs (ny,) that the state tells at once less the samples of `newest`, over their deviations."""
        return self._last(x, p, newest)[0][:, 0].copy()

    def end(self, x: Array, p: Array, d: Array) -> Array:
        """The state (nx,) at the end of a stage without residual force."""
        return self._course(x, p, d)[0]

    def at(self, belief: Belief, u: Array, time: float) -> Instant:
        """Where it stands at a time [s] under an input u (nu,)."""
        nx, v, t = self.stage.interpolation.states, self._v, np.array([time])
        x, p = belief.mean[:nx], belief.mean[nx:]
        for _ in range(STEPS):
            F, F_v, F_xp, F_w, g, g_v, g_xp = self._instant(v, x, u, p, t)
            move = np.linalg.solve(F_v, -F[:, 0])
            v = v + move
            if np.all(np.abs(move) <= PRECISE * (1.0 + np.abs(v))):
                break
        self._v = v if np.all(np.isfinite(v)) else self._v
        of_F = g_v @ np.linalg.inv(F_v)
        J, noise = g_xp - of_F @ F_xp, of_F @ F_w * self._force_std
        std, noise = (np.sqrt(np.sum(e**2, axis=1)) for e in (J @ belief.root, noise))
        return Instant(g=g[:, 0].copy(), J=J, std=std, noise=noise, rate=v[:nx])

    def _course(self, x: Array, p: Array, d: Array) -> tuple[Array, Array]:
        """The state at the end of a stage without residual force, and the derivatives of all balances there."""
        ip = self.stage.interpolation
        own, y = slice(ip.states, ip.local), np.concatenate([x, np.zeros(ip.interior), x, p])
        for _ in range(STEPS):
            e, J = self._balances(y, p, d)
            move = np.linalg.solve(J[:, own], -e[:, 0])
            if np.all(np.abs(move) <= PRECISE * (1.0 + np.abs(y[own]))) or not np.all(np.isfinite(move)):
                break
            y[own] += move
        return y[ip.states + ip.interior : ip.local], J


def _instant(stage: Stage, margins: Any) -> Any:
    """(v = [x'; z], x, u, p, t) -> F, F_v, F_xp, F_w, g, g_v, g_xp, all without residual forces."""
    dae = stage.dae
    p = ca.SX.sym("p", len(stage.free))
    values = ca.SX(ca.DM(stage.fixed))
    for k, i in enumerate(stage.free):
        values[i] = p[k]
    v, xp = ca.vertcat(dae.dx, dae.z), ca.vertcat(dae.x, p)
    F, g = (ca.substitute(dae.undisturbed(e), dae.p, values) for e in (dae.residual, margins))
    F_w = ca.substitute(dae.undisturbed(ca.jacobian(dae.residual, dae.w[list(stage.soft)])), dae.p, values)
    parts = [F, ca.jacobian(F, v), ca.jacobian(F, xp), F_w, g, ca.jacobian(g, v), ca.jacobian(g, xp)]
    return ca.Function("instant", [v, dae.x, dae.u, p, dae.t], [ca.densify(e) for e in parts], {"cse": True})
