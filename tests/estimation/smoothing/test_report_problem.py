"""The report's own estimation problem of the xy-table: eleven augmented states, residuals on every equation, from its initial values.

Independent truth: the same integral written down for a grid of midpoints, by hand from Lagrange's equations, with phi'' and the currents as
the unknowns that the report has, solved by Gauss-Newton on complex-step derivatives; no part of it is shared with the smoother.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import splu
from studies import report_problem as report

from backsight.data.generators import xy_table as table
from backsight.estimation import smooth

NAMES = list(report.GUESSES)
SEEDS = (1, 2)
ACCELERATION = 1e-5  # weight of the rate of phi'
R, B, C, M_E, M_Y, M_X, K_X, K_Y = 0.010, 1.0, 1.25, 2.3, 8.5, 3.8, 0.258, 0.056


@cache
def solved(seed: int):
    recording, _ = report.recorded(table.Table(), report.INTERVALS[0], seed)
    return recording, smooth(report.posed(recording))


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_it_converges_from_the_reports_initial_values_to_parameters_within_their_deviations(seed):
    _, result = solved(seed)
    assert result.solver.converged
    off = np.array([(result.parameters[name].value - truth) / result.parameters[name].std for name, truth in report.TRUTH.items()])
    # five deviations, if independent: chi square beyond 25.7 once in ten thousand
    assert np.sum(off**2) < 25.7, dict(zip(NAMES, off.round(1), strict=True))
    for name, truth in report.TRUTH.items():
        assert result.parameters[name].std < 0.25 * truth


def mass(phi, J_1, J_3):
    """(3, 3, N)."""
    x = R * phi
    j = np.array([1 - x[2] / B, x[2] / B, (x[1] - x[0]) / B])
    u, a = np.array([0.5, 0.5, 0.0]), np.array([1.0, -1.0, 0.0])
    fixed = np.diag([M_X, M_X, M_E]) + M_Y * np.outer(u, u) + M_Y * C**2 / 12 / B**2 * np.outer(a, a)
    M = R**2 * (fixed[:, :, None] + M_E * j[:, None] * j[None, :])
    M[0, 0] += J_1
    M[2, 2] += J_3
    return M


def equations(phi, v, a, theta, current, sign):
    """Residuals of the equations of motion (3, N) [N m]."""
    k, J_1, J_3, W_1, W_3 = theta
    x, rate = R * phi, R * v
    j = np.array([1 - x[2] / B, x[2] / B, (x[1] - x[0]) / B])
    turning = 2 * (rate[1] - rate[0]) * rate[2] / B
    spindle = k * (phi[0] - phi[1])
    forces = np.array([K_X * current[0] - spindle - W_1 * sign[0], spindle, K_Y * current[1] - W_3 * sign[2]])
    return np.einsum("ijn,jn->in", mass(phi, J_1, J_3), a) + R * M_E * turning * j - forces


def discretised(recording, reference, start, points=2):
    """Least cost, and theta (5, n) on a grid of `points` steps a sample.

    reference: J_1 and J_3 by which the density of the forces is measured, so that it has no part in what is estimated (M_ref M^-1 in front
    of the equations). start: z (11, samples).
    """
    h = report.STEP / points
    n = points * (len(recording.time) - 1) + 1
    current = np.repeat(np.array([recording.inputs["I_x"], recording.inputs["I_y"]])[:, :-1], points, axis=1)
    y = np.array([recording.outputs[name] for name in report.MEASURED])
    std = report.SCALE / np.sqrt(np.array([report.KINEMATICS] * 3 + [ACCELERATION] * 3 + list(report.CASES[1].values())))
    z = np.array([np.interp(np.arange(n) / points, np.arange(start.shape[1]), row) for row in start])
    p = np.vstack([np.diff(z[3:6]) / h, current])
    sign = np.sign(np.median(z[3:6], axis=1))
    sensors = report.SCALE / np.sqrt(report.POSITIONS * report.STEP)

    def between(local):
        left, right, p = local[:11], local[11:22], local[22:]
        z, rate, a = (left + right) / 2, (right - left) / h, p[:3]
        xi = rate - np.vstack([z[3:6], a, np.zeros((5, rate.shape[1]))])
        e = equations(z[:3], z[3:6], a, z[6:], p[3:], sign)
        M, M_ref = (mass(z[:3], *J) for J in (z[7:9], reference))
        e = np.einsum("ijn,jn->in", M_ref, np.linalg.solve(np.moveaxis(M, 2, 0), e.T[:, :, None])[:, :, 0].T)
        inputs = (p[3:] - current) * np.sqrt(report.CURRENTS)
        return np.sqrt(h) * np.vstack([xi / std[:, None], e * np.sqrt(report.EQUATIONS) / report.SCALE, inputs / report.SCALE])

    def sensed(z):
        x = R * z[:3]
        return (np.array([x[0] + (x[1] - x[0]) * x[2] / B, x[2], x[0], x[2]]) - y) / sensors

    def derivative(f, x):
        columns = []
        for i in range(len(x)):
            moved = x.astype(complex)
            moved[i] += 1e-30j
            columns.append(f(moved).imag / 1e-30)
        return np.array(columns)  # (unknowns, rows, N)

    here, there = np.arange(n - 1), np.arange(0, n, points)
    unknowns = np.vstack([*(11 * here + i for i in range(22)), *(11 * n + 5 * here + i for i in range(5))])
    measured = np.vstack([11 * there + i for i in range(11)])
    cost = np.inf
    for _ in range(30):
        local = np.vstack([z[:, :-1], z[:, 1:], p])
        r, s = between(local), sensed(z[:, there])
        before, cost = cost, (np.sum(r**2) + np.sum(s**2)) / 2
        if abs(before - cost) < 1e-9 * cost:
            return cost, z[6:]
        entries = []
        for D, at, offset, rows in ((derivative(between, local), unknowns, 0, r), (derivative(sensed, z[:, there]), measured, r.size, s)):
            row = offset + np.arange(rows.size).reshape(rows.shape)
            shape = D.shape
            entries.append((D.ravel(), np.broadcast_to(row[None], shape).ravel(), np.broadcast_to(at[:, None], shape).ravel()))
        data, row, column = (np.concatenate(e) for e in zip(*entries, strict=True))
        size = 11 * n + 5 * (n - 1)
        J = sp.csc_matrix((data, (row, column)), shape=(r.size + s.size, size))
        unit = sp.diags(1.0 / np.sqrt(np.asarray(J.multiply(J).sum(axis=0)).ravel()))
        J = J @ unit
        step = -(unit @ splu(sp.csc_matrix(J.T @ J)).solve(J.T @ np.concatenate([r.ravel(), s.ravel()])))
        z, p = z + step[: 11 * n].reshape(n, 11).T, p + step[11 * n :].reshape(n - 1, 5).T
    raise AssertionError("the independent formulation did not converge")


@pytest.mark.slow
def test_its_cost_and_parameters_are_those_of_an_independent_formulation():
    recording, result = solved(SEEDS[0])
    solution, estimates = result.solution, result.estimates["line"]
    names = [q.name for q in solution.transcription.dae.parameters]
    reference = [solution.parameters[names.index(name)] for name in ("drive_1.J", "drive_3.J")]
    start = estimates[[f"drive_{i}.{q}" for q in ("phi", "omega") for i in (1, 2, 3)]].to_numpy().T
    guesses = np.repeat(np.array(list(report.GUESSES.values()))[:, None], start.shape[1], axis=1)
    cost, theta = discretised(recording, reference, np.vstack([start, guesses]))
    # each mesh has moments of the forces of its own, more of them on the finer one
    assert solution.solved.cost == pytest.approx(cost, rel=1e-2)
    for name, course in zip(NAMES, theta, strict=True):
        assert result.parameters[name].value == pytest.approx(float(np.mean(course)), abs=0.3 * result.parameters[name].std)
