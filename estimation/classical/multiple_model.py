"""Several models of one plant in parallel, between which it jumps: interacting Kalman filters, and which of them is in force when.

Mode i is the plant linearised at a working point of its own (a bit that slides, a bit that sticks), with the same states:

    x(k+1) = F_i x(k) + E_i [u(k); 1] + noise Q_i,    y(k) = C_i x(k) + D_i [u(k); 1] + noise R,    P(j at k+1 | i at k) = p_ij

One sample of the interacting multiple-model filter (H. A. P. Blom, Y. Bar-Shalom, IEEE Trans. Automatic Control 33, 1988):

    mixing        m_ij = p_ij mu_i / c_j,  c_j = sum_i p_ij mu_i;   x0_j = sum_i m_ij x_i,  P0_j = sum_i m_ij (P_i + (x_i - x0_j)(..)')
    filtering     every filter j from (x0_j, P0_j); likelihood  l_j = N(e_j; 0, S_j)
    probability   mu_j = c_j l_j / sum
    afterwards    s_i(k) = mu_i(k) sum_j p_ij s_j(k+1) / c_j(k+1)        all samples used (C.-J. Kim, J. Econometrics 60, 1994)

The jumps of the drillstring between slip and stick (KSEPL, 1992, section 5.3, where parallel models estimate all coefficients anew and
cannot tell slip from stick) are found here because the physical parameters are known: only the mode is not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.special import logsumexp

from backsight.models import SolveError
from backsight.models.analysis import operating_point
from backsight.models.errors import InputError

from ..problem import Problem
from ..recordings.recording import Recording
from ..smoothing.horizons import output_stds
from ..validation.fit import output_fit
from ..wording import listed
from .linear_plant import AffineStep, affine
from .result import Baseline, estimates
from .sampling import held_inputs, uniform_step

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@dataclass(frozen=True, kw_only=True)
class Modes:
    """Which mode was in force, and the states.

    estimates: recording name -> one row per sample, of those with gaps one piece after the other: t_s; the probability of every mode,
    `<mode>` from the samples up to then and `<mode>.afterwards` from all of them, of the same piece; every state and `<state>.std` of the
    mixture; `<output>` predicted from the samples before.
    """

    problem: Problem
    names: tuple[str, ...]
    estimates: Mapping[str, pd.DataFrame]

    def most_probable(self, recording: str) -> list[str]:
        """The name of the most probable mode at every sample, all samples used."""
        table = self.estimates[recording][[f"{name}.afterwards" for name in self.names]].to_numpy()
        return [self.names[int(i)] for i in np.argmax(table, axis=1)]

    def baseline(self) -> Baseline:
        """The plant as it was given, and the fit of the mixture's prediction one sample ahead."""
        nothing = np.full(len(self.problem.free), np.nan)
        shares = []
        for name, table in self.estimates.items():
            parts = [f"{mode} {100 * float(table[f'{mode}.afterwards'].mean()):.0f} %" for mode in self.names]
            shares.append(f"{name}: {listed(parts)} of the time")
        met: dict[str, dict[str, list[Array]]] = {}
        for piece in self.problem.fitted:
            table = self.estimates[piece.name]
            rows = table[np.isin(table["t_s"], piece.time)]
            for name, y in piece.outputs.items():
                met.setdefault(piece.name, {}).setdefault(name, []).append(np.stack([y, rows[name]]))
        return Baseline(
            method="multiple_models",
            model=self.problem.dae.name,
            parameters=estimates(self.problem, self.problem.values[list(self.problem.free)], nothing),
            fit={r: {name: output_fit(*np.hstack(parts)) for name, parts in outputs.items()} for r, outputs in met.items()},
            predicted="one step ahead",
            notes=(f"{'; '.join(shares)}. The parameters are those that were given.",),
        )


def multiple_models(problem: Problem, *, modes: Mapping[str, Mapping[str, float]], dwell: Mapping[str, float] | float) -> Modes:
    """Follow a plant that jumps between modes, with the parameters of the problem as they are (guesses and fixed values).

    modes  name -> states of its working point; inputs at their mean. At zero velocity a friction law sticks, at any other it slips
    dwell  mean time [s] that it stays in a mode, of all or by name

    The pieces of a recording with gaps are followed each by itself, from modes that are equally probable.

    Noise: densities W of the problem's weights (none elsewhere), deviations of the outputs as given or from the samples. Raises InputError
    for unequal steps, unknown states, fewer than two modes, a dwell shorter than a step.
    """
    if len(modes) < 2:
        raise InputError(f"multiple_models(modes={list(modes)}): needs two modes or more; of one, zoh_prediction_error says more.")
    names = tuple(modes)
    known = [q.name for q in problem.dae.states]
    for name in names:
        wrong = [state for state in modes[name] if state not in known]
        if wrong:
            raise InputError(
                f"multiple_models(modes={{{name!r}: ..}}): {problem.dae.name} has no state {listed(wrong)}; known: {listed(known)}"
            )
        if isinstance(dwell, Mapping) and name not in dwell:
            raise InputError(f"multiple_models(dwell=..): {name} has no mean time; give one for every mode, or one number for all.")
    stays = np.array([float(dwell[name] if isinstance(dwell, Mapping) else dwell) for name in names])
    tables: dict[str, list[pd.DataFrame]] = {}
    for recording, stds in zip(problem.fitted, output_stds(problem)[0], strict=True):
        step = uniform_step(recording, "multiple_models")
        if np.any(~(stays > step)):
            raise InputError(
                f"multiple_models(dwell={dwell}): every mean time must be longer than the step of {recording.name}, {step:.4g} s."
            )
        jump = np.array([[1 - step / s if i == j else step / s / (len(names) - 1) for j in range(len(names))] for i, s in enumerate(stays)])
        found = _followed(problem, recording, stds, names, [modes[name] for name in names], jump, step)
        tables.setdefault(recording.name, []).append(found)
    return Modes(problem=problem, names=names, estimates={name: pd.concat(pieces, ignore_index=True) for name, pieces in tables.items()})


def _followed(
    problem: Problem,
    recording: Recording,
    stds: Mapping[str, float],
    names: tuple[str, ...],
    points: list[Mapping[str, float]],
    jump: Array,
    step: float,
) -> pd.DataFrame:
    dae = problem.dae
    outputs = [i for i, q in enumerate(dae.outputs) if q.name in recording.outputs]
    labels = [dae.outputs[i].name for i in outputs]
    y = np.column_stack([recording.outputs[name] for name in labels])
    u = held_inputs(dae, recording, "multiple_models")
    values = {
        p.name: float(v) for p, v in zip(dae.parameters, problem.values, strict=True) if not p.smoothing or p.name in problem.parameters
    }
    mean = {q.name: float(row.mean()) for q, row in zip(dae.inputs, u, strict=True)}
    plants = []
    for name, x in zip(names, points, strict=True):
        try:
            plants.append(affine(dae, operating_point(dae, x, mean, values), values, step, outputs))
        except SolveError as error:
            raise InputError(f"multiple_models(modes={{{name!r}: ..}}): {error}") from error
    density = np.array([problem.weights.W.get(p.name, 0.0) for p in dae.places])
    R = np.diag([stds[name] ** 2 for name in labels])
    spread = np.array([(abs(q.nominal) + max(abs(float(p.get(q.name, 0.0))) for p in points)) ** 2 for q in dae.states])
    # after a gap only what always holds is known
    known = {name: k.value for name, k in problem.known_at(recording).items() if k.std == 0}
    start = np.array([known.get(q.name, np.nan) for q in dae.states])
    x0 = [np.where(np.isnan(start), p.at, start) for p in plants]
    P0 = np.diag(np.where(np.isnan(start), spread, 0.0))
    run = _Filters(plants, [p.noise(density) for p in plants], R, jump, x0, P0)
    for k in range(len(y)):
        run.sample(y[k], u[:, k])
    filtered = np.array(run.filtered)
    columns = {"t_s": recording.time} | dict(zip(names, filtered.T, strict=True))
    columns |= dict(zip([f"{name}.afterwards" for name in names], run.afterwards().T, strict=True))
    means, stdev = np.array(run.means), np.sqrt(np.maximum(np.array(run.variances), 0.0))
    for i, q in enumerate(dae.states):
        columns |= {q.name: means[:, i], f"{q.name}.std": stdev[:, i]}
    columns |= {name: np.array(run.predicted)[:, i] for i, name in enumerate(labels)}
    return pd.DataFrame(columns)


class _Filters:
    """The bank, sample by sample; states are absolute, so that modes with different working points can be mixed."""

    def __init__(self, plants: list[AffineStep], Q: list[Array], R: Array, jump: Array, x: list[Array], P: Array) -> None:
        self.plants, self.Q, self.R, self.jump = plants, Q, R, jump
        self.x, self.P = x, [P.copy() for _ in plants]
        self.mu = np.full(len(plants), 1.0 / len(plants))
        self.before = self.mu.copy()
        self.filtered: list[Array] = []
        self.foreseen: list[Array] = []
        self.means: list[Array] = []
        self.variances: list[Array] = []
        self.predicted: list[Array] = []

    def sample(self, y: Array, u: Array) -> None:
        """Update with y (ny,), NaN where missing, and go on with the input u (nu,) that holds from here."""
        there = np.isfinite(y)
        logs, ahead = [], np.zeros(len(y))
        drives: list[Array] = [np.append(u - p.input, 1.0) for p in self.plants]
        for j, (p, drive) in enumerate(zip(self.plants, drives, strict=True)):
            expected = p.C @ (self.x[j] - p.at) + p.D @ drive
            ahead += self.before[j] * expected
            C, e = p.C[there], (y - expected)[there]
            S = C @ self.P[j] @ C.T + self.R[np.ix_(there, there)]
            gain = np.linalg.solve(S, C @ self.P[j]).T
            logs.append(-0.5 * (e @ np.linalg.solve(S, e) + np.linalg.slogdet(2 * np.pi * S)[1]) if there.any() else 0.0)
            self.x[j] = self.x[j] + gain @ e
            keep = np.eye(len(self.x[j])) - gain @ C
            self.P[j] = keep @ self.P[j] @ keep.T + gain @ self.R[np.ix_(there, there)] @ gain.T
        weight = np.log(np.maximum(self.before, 1e-300)) + np.array(logs)
        self.mu = np.exp(weight - logsumexp(weight))
        mean = sum(m * x for m, x in zip(self.mu, self.x, strict=True))
        variance = sum(m * (np.diag(P) + (x - mean) ** 2) for m, x, P in zip(self.mu, self.x, self.P, strict=True))
        self.filtered.append(self.mu)
        self.foreseen.append(self.before)
        self.means.append(np.asarray(mean))
        self.variances.append(np.asarray(variance))
        self.predicted.append(ahead)
        self._mix_and_move(drives)

    def _mix_and_move(self, drives: list[Array]) -> None:
        c = self.jump.T @ self.mu
        moved_x, moved_P = [], []
        for j, p in enumerate(self.plants):
            m = self.jump[:, j] * self.mu / max(float(c[j]), 1e-300)
            x = np.asarray(sum(w * xi for w, xi in zip(m, self.x, strict=True)))
            P = np.asarray(sum(w * (Pi + np.outer(xi - x, xi - x)) for w, xi, Pi in zip(m, self.x, self.P, strict=True)))
            moved_x.append(p.at + p.F @ (x - p.at) + p.E @ drives[j])
            moved_P.append(p.F @ P @ p.F.T + self.Q[j])
        self.x, self.P, self.before = moved_x, moved_P, c

    def afterwards(self) -> Array:
        """Probabilities of the modes from all samples, (n, modes)."""
        out = np.array(self.filtered)
        for k in range(len(out) - 2, -1, -1):
            out[k] = self.filtered[k] * (self.jump @ (out[k + 1] / np.maximum(self.foreseen[k + 1], 1e-300)))
            out[k] /= out[k].sum()
        return out
