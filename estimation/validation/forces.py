"""Are the residual forces white? They are what the smoother makes of white ones, so they are held against what it makes of white ones.

A smoothed force is E[w | all samples]: smooth, and never white. It is a fixed linear map of the prediction errors, which are N(0, I) when
the model is right (`innovations.py`): backwards over the intervals, v the innovations over their roots (de Jong, J. Amer. Statist.
Assoc. 84, 1989, with the notation of `Step`),

    a_i = L^-T (v_i - K' l_i),      e_i = noise_y' a_i + noise_x' l_i,      l_(i-1) = D' a_i + A' l_i

with e_i the smoothed noises of interval i. The same map of random v gives the autocorrelations, in bands, that a right model would show;
those found are held against their mean and covariance by Hotelling's T^2. Those of several horizons are added, lag by lag: a memory is in
all of them. Intervals where a place has more room than elsewhere are left out.
"""

from __future__ import annotations

import numpy as np
from scipy import stats
from scipy.linalg import blas

from backsight.ocp import Solution
from backsight.ocp.polynomials import radau_weights

from ..smoothing.rest import near_rest
from .autocorrelation import products
from .innovations import Filtered, Innovations
from .whiteness import LEAST, bands, longest_lag

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

DRAWS = 120


def smoothed_noises(run: Innovations, v: Array) -> Array:
    """The smoothed noises (N, q, M) of one horizon from innovations over their roots, v (m, M)."""
    steps = run.steps
    out = np.empty((len(steps), steps[0].noise_x.shape[1], v.shape[1]))
    ahead = np.zeros((steps[0].A.shape[0], v.shape[1]))
    for i in range(len(steps) - 1, -1, -1):
        s = steps[i]
        a = v[s.samples] - s.K.T @ ahead
        if a.size:
            a = blas.dtrsm(1.0, s.L, a, lower=1, trans_a=1)
        out[i] = s.noise_y.T @ a + s.noise_x.T @ ahead
        ahead = s.D.T @ a + s.A.T @ ahead
    return out


def impulses(solution: Solution, noises: Array) -> Array:
    """The mean residual force of every interval over its deviation, (n_soft, N, M), from noises (N, q, M)."""
    t = solution.transcription
    moments = noises.reshape(len(noises), t.degree, len(t.soft), -1)
    if t.method == "spline":
        return np.asarray(moments[:, 0].transpose(1, 0, 2))
    return np.asarray(np.einsum("nksm,k->snm", moments, np.sqrt(radau_weights(t.degree))))


def force_whiteness(solution: Solution, filtered: Filtered) -> dict[int, float]:
    """Place -> p-value of the hypothesis that its residual force is white, over all horizons; places that have none are left out."""
    t, rng, std = solution.transcription, np.random.default_rng(0), solution.transcription.force_std_at(solution.values)
    runs = [(n, run) for n, run in enumerate(filtered.horizons) if min(len(run.steps), len(run.u)) >= LEAST]
    reach = {n: longest_lag(t.horizons[n].mesh.count) for n, _ in runs}
    if not (t.soft and runs):
        return {}
    sums = np.zeros((len(t.soft), 1 + DRAWS, len(bands(max(reach.values()))) - 1))
    for number, run in runs:
        # the first column is what was found; what beta could follow is taken from all of them
        v = np.column_stack([run.u, rng.standard_normal((len(run.u), DRAWS))])
        basis = np.linalg.svd(run.E, full_matrices=False)[0]
        w = impulses(solution, smoothed_noises(run, v - basis @ (basis.T @ v)))
        edges = bands(reach[number])
        w[near_rest(std[:, t.offsets[number] : t.offsets[number + 1]])] = np.nan
        for own, force in zip(sums, w, strict=True):
            own[:, : len(edges) - 1] += np.add.reduceat(products(force.T)[0][:, : edges[-1]], edges[:-1], axis=1)
    return {place: _hotelling(own) for place, own in zip(t.soft, sums, strict=True)}


def _hotelling(values: Array) -> float:
    """p-value of the first row's coming from the same normal distribution as the others, (1 + M, B)."""
    M, B = len(values) - 1, values.shape[1]
    drawn = values[1:]
    away = values[0] - drawn.mean(axis=0)
    T2 = M / (M + 1) * float(away @ np.linalg.lstsq(np.atleast_2d(np.cov(drawn.T)), away, rcond=None)[0])
    return float(stats.f.sf(T2 * (M - B) / (B * (M - 1)), B, M - B))
