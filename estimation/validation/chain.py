"""A smoothed record as a linear chain driven by white noise: the program's rows, linearised at the solution, in the order of time.

With (dx, dp) the way from the solution to the truth, and every row r + (its derivative) d = e, e ~ N(0, 1), or 0 where it must hold:

    interval i        r_i + N_i dx_i + M_i dv_i + P_i dp = e_i,         dv_i = [interior, dx_(i+1)]
    sample k in it    r_k + S_k [dx_i; dv_i] + T_k dp = e_k

Unknowns and equations of an interval are equal in number, so M_i is square: dv_i = F_i dx_i + H_i dp + g_i + G_i e_i. What no noise
explains are the first states, as far as they are free, and the parameters that move.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from backsight.ocp import Solution

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@dataclass(frozen=True, kw_only=True)
class Chain:
    """N intervals, np moving parameters, k free directions of a horizon's first states.

    F (N, own, nx), H (N, own, np), g (N, own), G (N, own, q): as above, own = interior + nx, q noisy rows. rows (samples, ny): r_k, scaled,
    NaN where nothing was measured; S (samples, ny, nx + own), T (samples, ny, np). first: per horizon, directions (nx, k) of its first
    states; known: per horizon, rows (m, 1 + k) of what is known of them, [r | derivative]; known_parameters (m, 1 + np): the same.
    """

    F: Array
    H: Array
    g: Array
    G: Array
    rows: Array
    S: Array
    T: Array
    first: tuple[Array, ...]
    known: tuple[Array, ...]
    known_parameters: Array


def chain(solution: Solution, factors: Array | None = None) -> Chain | None:
    """The chain of a solution; None where its rows are not of this form. factors (n_soft,): on the deviations of its residual forces."""
    t, values = solution.transcription, solution.values
    nlp, ip = t.nlp, t.nlp.interpolation
    nx, n = ip.states, nlp.trajectory_size
    starts = list(t.offsets[:-1])
    if set(range(n)) & set(solution.solved.on_bound) - set(t.starts.ravel().tolist()):
        # a state that a bound holds is not driven by its noise
        return None
    moving = np.array([n + k not in solution.solved.on_bound for k in range(len(nlp.free))], dtype=bool)
    dynamics, noisy = [], []
    soft: list[list[Array]] = [[] for _ in starts]
    hard = [[np.eye(nx)[h.initial_std == 0]] for h in t.horizons]
    priors = [np.empty((0, 1 + int(moving.sum())))]
    samples = None
    for number, term in enumerate(nlp.terms):
        scale = values.scale[number].T
        r = solution.rows[number].T
        J = solution.jacobian_of_rows(number) * scale[:, :, None]
        there = scale > 0
        if term.name == "samples":
            samples = np.where(there, r, np.nan), J[:, :, : ip.local], J[:, :, ip.local :][:, :, moving]
        elif term.nodes is not None:
            if not np.array_equal(term.interval, np.arange(len(nlp.steps))):
                return None
            dynamics.append((r, J))
            size = np.zeros(J.shape[1]) if term.equality else np.ones(J.shape[1])
            if term.name == t.force_term and factors is not None:
                size = np.tile(factors, len(size) // len(factors))
            noisy.append(size)
        elif np.any(J[:, :, nx : ip.local]) or not (np.any(J[:, :, ip.local :]) or set(term.interval) <= set(starts)):
            return None
        elif np.any(J[:, :, ip.local :]):
            if term.equality or np.any(J[:, :, :nx]):
                return None
            priors.append(np.concatenate([r[there][:, None], J[there][:, ip.local :][:, moving]], axis=1))
        else:
            for column, interval in enumerate(term.interval):
                k, rows = starts.index(interval), there[column]
                if term.equality:
                    hard[k].append(J[column, :, :nx])
                else:
                    soft[k].append(np.concatenate([r[column, rows, None], J[column, rows, :nx]], axis=1))
    own = ip.interior + nx
    if samples is None or sum(len(sizes) for sizes in noisy) != own:
        return None
    sizes = np.concatenate(noisy)
    r, J = np.concatenate([r for r, _ in dynamics], axis=1), np.concatenate([J for _, J in dynamics], axis=1)
    parts = [J[:, :, :nx], J[:, :, ip.local :][:, :, moving], r[:, :, None], -np.diag(sizes)[:, sizes > 0]]
    right = np.concatenate([np.broadcast_to(part, (len(J), *part.shape[-2:])) for part in parts], axis=2)
    try:
        solved = -np.linalg.solve(J[:, :, nx : ip.local], right)
    except np.linalg.LinAlgError:
        return None
    F, H, g, G = np.split(solved, np.cumsum([part.shape[-1] for part in parts])[:-1], axis=2)
    first = tuple(null_space(np.concatenate(rows)) if any(len(row) for row in rows) else np.eye(nx) for rows in hard)
    known = [np.concatenate([np.empty((0, 1 + nx)), *rows]) for rows in soft]
    return Chain(
        F=F,
        H=H,
        g=g[:, :, 0],
        G=G,
        rows=samples[0],
        S=samples[1],
        T=samples[2],
        first=first,
        known=tuple(np.concatenate([rows[:, :1], rows[:, 1:] @ Z], axis=1) for rows, Z in zip(known, first, strict=True)),
        known_parameters=np.concatenate(priors),
    )
