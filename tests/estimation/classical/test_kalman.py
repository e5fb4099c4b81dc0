"""Innovations of an affine plant against the dense Gaussian that they factor."""

from __future__ import annotations

import numpy as np
import pytest
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
