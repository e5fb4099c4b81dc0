"""Innovations of an affine plant against the dense Gaussian that they factor."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from truths import discrete, noise_covariance

from backsight.estimation.classical.kalman import innovations
from backsight.estimation.classical.linear_plant import AffineStep

A = np.array([[0.0, 1.0], [-4.0, -0.3]])
STEP = 0.1


def plant() -> AffineStep:
    F, E = discrete(A, np.array([[0.0, 0.0], [1.0, 0.5]]), STEP)
    return AffineStep(
        F=F, E=E, C=np.eye(2), D=np.zeros((2, 2)), unit_noise=noise_covariance(A, np.array([[0.0], [1.0]]), 1.0, STEP)[None],
        at=np.zeros(2), input=np.zeros(1),
    )  # fmt: skip


def dense(y: np.ndarray, u: np.ndarray, Q: np.ndarray, R: np.ndarray, start: np.ndarray) -> float:
    """log N(y; mean, covariance) of all samples that are there, from the joint distribution of all states."""
    p, n = plant(), len(y)
    mean, x = [], start
    for k in range(n):
        mean.append(x)
        x = p.F @ x + p.E @ [u[k], 1.0]
    S = np.zeros((2 * n, 2 * n))
    P = np.zeros((2, 2))
    for i in range(n):
        cross = P
        for j in range(i, n):
            S[2 * i : 2 * i + 2, 2 * j : 2 * j + 2] = cross.T if j > i else P
            S[2 * j : 2 * j + 2, 2 * i : 2 * i + 2] = cross
            cross = p.F @ cross
        P = p.F @ P @ p.F.T + Q
    S = S + np.kron(np.eye(n), R)
    there = np.isfinite(y.ravel())
    e, S = (y - np.array(mean)).ravel()[there], S[np.ix_(there, there)]
    return float(-0.5 * (e @ np.linalg.solve(S, e) + np.linalg.slogdet(2 * np.pi * S)[1]))


@pytest.mark.parametrize("missing", [False, True])
def test_the_innovations_factor_the_joint_likelihood(missing):
    rng = np.random.default_rng(1)
    y, u = rng.normal(size=(30, 2)), rng.normal(size=30)
    if missing:
        y[4:8, 0] = y[6, 1] = np.nan
    p, R, start = plant(), np.diag([0.1, 0.4]), np.array([0.3, -0.2])
    Q = p.noise(np.array([0.7]))
    found = innovations(p, y, u[None, :], Q, R, start)
    r = np.linalg.solve(found.L, found.e[:, :, None])
    count = np.isfinite(y).sum()
    likelihood = -0.5 * np.sum(r**2) - np.sum(np.log(np.diagonal(found.L, axis1=1, axis2=2))) - 0.5 * count * np.log(2 * np.pi)
    assert likelihood == pytest.approx(dense(y, u, Q, R, start), rel=1e-9)


def test_a_gain_that_has_settled_is_kept_without_a_difference():
    rng = np.random.default_rng(2)
    y, u, p = rng.normal(size=(3000, 2)), rng.normal(size=(1, 3000)), plant()
    Q, R = p.noise(np.array([0.7])), np.diag([0.1, 0.4])
    quick = innovations(p, y, u, Q, R, np.zeros(2))
    y[0, 0] = np.nan  # no complete record: every gain is computed
    slow = innovations(p, y, u, Q, R, np.zeros(2))
    assert quick.e[500:] == pytest.approx(slow.e[500:], abs=1e-6)
    assert quick.L[500:] == pytest.approx(slow.L[500:], rel=1e-6)


def seen_by_its_noise(A: np.ndarray, C: np.ndarray, force_std: float, h: float, n: int) -> tuple[AffineStep, np.ndarray, np.ndarray]:
    """A plant under a white force of this density on its last state, Q, and samples (n, 1) whose noise has the deviation one."""
    rng, G = np.random.default_rng(3), np.eye(len(A))[:, -1:]
    F, Q = discrete(A, G, h)[0], noise_covariance(A, G, force_std**2, h)
    size, vectors = np.linalg.eigh(Q)
    x, y = np.zeros(len(A)), np.empty((n, 1))
    for k in range(n):
        y[k] = C @ x + rng.normal()
        x = F @ x + vectors @ (np.sqrt(np.maximum(size, 0.0)) * rng.normal(size=len(x)))
    nothing = np.zeros((len(A), 1))
    p = AffineStep(F=F, E=nothing, C=C, D=np.zeros((1, 1)), unit_noise=Q[None], at=np.zeros(len(A)), input=np.zeros(0))
    return p, Q, y


@pytest.mark.parametrize(
    ("A", "force_std", "h", "n"),
    [
        pytest.param([[0.0, 1.0], [0.0, 0.0]], 1.0, 1e-3, 20000, id="a mass that a weak force moves slowly"),
        pytest.param([[0.0, 1.0], [-25.0, -0.75]], 0.05, 0.01, 20000, id="a weak force on an oscillator"),
        pytest.param([[0.0, 1.0], [1.0, -0.1]], 0.3, 0.01, 1500, id="an unstable plant"),
    ],
)
def test_a_gain_is_kept_only_where_it_is_the_stationary_one(A, force_std, h, n):
    """S ends on that of the Riccati equation, and the innovations are as large as their covariance says and white."""
    C = np.array([[1.0, 0.0]])
    p, Q, y = seen_by_its_noise(np.array(A), C, force_std, h, n)
    found = innovations(p, y, np.zeros((0, n)), Q, np.eye(1), np.zeros(2))
    variance = found.L[:, 0, 0] ** 2
    P = solve_discrete_are(p.F.T, C.T, Q, np.eye(1))
    assert variance[-1] == pytest.approx(1 + P[0, 0], abs=1e-8)
    r = found.e[:, 0] / found.L[:, 0, 0]
    assert np.mean(r**2) == pytest.approx(1.0, abs=5 * np.sqrt(2 / n))
    assert abs(np.mean(r[1:] * r[:-1])) < 5 / np.sqrt(n)
    assert len(np.unique(variance)) < 0.6 * n  # it is kept


def test_a_state_that_no_output_shows_does_not_keep_the_gain_from_settling():
    """A cart of which the speed alone is seen: its position is ever less sure, and the innovations are those of the speed by itself."""
    cart, n = np.array([[0.0, 1.0], [0.0, -0.75]]), 2000
    p, Q, y = seen_by_its_noise(cart, np.array([[0.0, 1.0]]), 0.5, 0.05, n)
    alone = AffineStep(
        F=p.F[1:, 1:], E=p.E[1:], C=np.eye(1), D=p.D, unit_noise=p.unit_noise[:, 1:, 1:], at=np.zeros(1), input=np.zeros(0)
    )  # fmt: skip
    both, speed = (
        innovations(plant, y, np.zeros((0, n)), noise, np.eye(1), np.zeros(len(noise))) for plant, noise in ((p, Q), (alone, Q[1:, 1:]))
    )
    assert both.e == pytest.approx(speed.e, abs=1e-8)
    assert len(np.unique(both.L)) < 200
