"""A linear plant smoothed, and the same as one dense Gaussian: exact discretisation, nothing of the package."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import truths
from examples import OFFSET, D, K, M, compiled, oscillator

from backsight.estimation import Free, Problem, Recording, Smoothing, Weights, smooth
from backsight.estimation.smoothing.program import Settings
from backsight.ocp import Solution
from backsight.ocp.scaling import scaled

PLANT, MODEL = truths.Plant(m=M, d=D, k=K, offset=OFFSET), compiled(oscillator())
STD, FORCE_STD, STEP = 1e-3, 0.3, 0.01
ALL_FREE = {"mass.m": Free(3.0), "spring.k": Free(30.0), "damper.d": Free(1.0), "offset.f": Free(0.0)}


def drive(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Times and a held input with steps of many lengths."""
    rng = np.random.default_rng(99)
    return STEP * np.arange(n), 20 * np.sign(np.sin(np.arange(n) * 0.0483)) + 10 * np.repeat(rng.normal(size=n // 10 + 1), 10)[:n]


def many(n: int, count: int, rng: np.random.Generator, force: np.ndarray | None = None) -> np.ndarray:
    """Positions (count, n) of the plant from rest under `drive` and white forces; force (count, n): a further one, held."""
    A, B, G = PLANT.matrices
    (phi, gamma), u = truths.discrete(A, B, STEP), drive(n)[1]
    root = np.linalg.cholesky(truths.noise_covariance(A, G, FORCE_STD**2, STEP))
    x, out = np.zeros((count, 2)), np.empty((count, n))
    for k in range(n):
        out[:, k] = x[:, 0]
        push = u[k] + (0.0 if force is None else force[:, k])
        inputs = np.stack(np.broadcast_arrays(push, np.ones(count)), axis=1)
        x = x @ phi.T + inputs @ gamma.T + rng.standard_normal((count, 2)) @ root.T
    return out


def problem(*records: np.ndarray, settings: Settings | None = None, **given: object) -> tuple[Smoothing, Solution]:
    """One record, or several, smoothed with W and V as they are, and the solution behind it."""
    recordings = []
    for k, y in enumerate(records):
        time, u = drive(len(y))
        name = f"run {k}" if k else "run"
        recordings.append(Recording(name=name, time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": STD}))
    asked: dict = {"parameters": ALL_FREE, "weights": Weights(W={"mass": FORCE_STD})} | given
    result = smooth(Problem(model=MODEL, recordings=recordings, **asked), settings=settings)
    assert result.solver.converged
    assert result.solution is not None
    return result, result.solution


def again(solution: Solution, y: np.ndarray, lower: np.ndarray | float = -np.inf, upper: np.ndarray | float = np.inf) -> Solution:
    """The program of `problem` with another record of the same length, from where that one ended."""
    t, number = solution.transcription, solution.term("samples")
    # what the input's fine structure adds between the knots was taken from the first targets
    shift = t.horizons[0].target[:, 0] - solution.values.target[number][0]
    target = tuple((y - shift)[None] if i == number else old for i, old in enumerate(solution.values.target))
    values = scaled(solution.solver, solution.solved.decisions, replace(solution.values, target=target))
    low, high = (np.broadcast_to(bound, (t.nlp.size,)) for bound in (lower, upper))
    solved = solution.solver.solve(solution.solved.decisions, values, lower=low, upper=high)
    assert solved.status.converged
    here = t.nlp.about(values, solved.decisions)
    return Solution(transcription=t, solver=solution.solver, values=here, solved=solved)


def dense(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean (n,) from rest, covariance (n, n) and effect (n, 3) of s_0, v_0 and the offset on n noisy samples."""
    A, B, G = PLANT.matrices
    (phi, gamma), Q, u = truths.discrete(A, B, STEP), truths.noise_covariance(A, G, FORCE_STD**2, STEP), drive(n)[1]
    mean, effect, P = np.zeros(2), np.hstack([np.eye(2), np.zeros((2, 1))]), np.zeros((2, 2))
    means, effects, covariances, powers = [], [], [], [np.eye(2)]
    for k in range(n):
        means.append(mean[0])
        effects.append(effect[0])
        covariances.append(P)
        powers.append(phi @ powers[-1])
        mean = phi @ mean + gamma @ [u[k], 1.0]
        effect = phi @ effect
        effect[:, 2] += gamma[:, 1] / PLANT.offset
        P = phi @ P @ phi.T + Q
    C = np.empty((n, n))
    for i in range(n):
        for j in range(i, n):
            C[i, j] = C[j, i] = (powers[j - i] @ covariances[i])[0, 0]
    return np.array(means), C + STD**2 * np.eye(n), np.array(effects)
