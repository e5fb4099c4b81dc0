"""Trajectory-pattern method: periodic motion, and the harmonics of the effort that the model does not explain.

A motion of fundamental frequency w turns balances that are linear in the parameters into algebra between harmonics,

    e(t) = F(q, q', q'', u, p_0) = e_0 + sum_i (e_ci cos i w t + e_si sin i w t),        E = M dp,      E = (e_0, e_c1, e_s1, ..)

where the columns of M are the harmonics of -dF/dp. With a feedforward computed by the model with p_0, e is the effort of the feedback
that its parameter errors make necessary; with the recorded effort for u it is found for any controller. Harmonics below `smallest` of
the largest one of their balance are left out, and dp is the least-squares answer; p_0 + dp is the next p_0 (J. Rastegar et al.;
Experimental Verification of Nonlinear System Model Parameter Identification Based on Trajectory Pattern Method, thesis, eq. 1.9 to 1.10 and
3.9 to 3.14).

q, q', q'' are those of a Fourier series fitted to the samples: no filter, no differences, exact derivatives, noise averaged over the
periods. A held input has the harmonics of its staircase, on its own clock where it changes between the rows. The deviations come from the
scatter of the estimate between periods, whatever the colour of the noise; with fewer than three periods there are none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from backsight.models.errors import InputError

from ..problem import Problem
from ..recordings.drive import Hold, drive_of
from ..recordings.recording import Recording
from .balances import Balances, linear_balances
from .measured_states import Filtered, motion
from .result import Baseline, estimates, known_start, prior, simulated_fits
from .sampling import uniform_step

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
FINER = 8  # points of a period for every harmonic that is kept
ENOUGH = 3  # periods that tell a scatter


@dataclass(frozen=True, kw_only=True)
class _Equations:
    """E = M p of one recording, (rows,) and (rows, np), and its states at the first instant by name."""

    M: Array
    E: Array
    first: int
    start: dict[str, float]


def harmonic(
    problem: Problem,
    *,
    frequency: Mapping[str, float] | float,
    harmonics: int = 12,
    motion_harmonics: int = 5,
    smallest: float = 0.01,
) -> Baseline:
    """Free parameters from recordings of periodic motions.

    frequency         fundamental [rad/s] of all recordings or by name; the last whole number of periods of each is used
    harmonics         of the balances that are compared
    motion_harmonics  of the shown states; the pattern cos(w t) - cos(3 w t)/9 has three, and a loop that follows it poorly more
    smallest          share of a balance's largest harmonic below which one is left out

    Raises InputError for less than one period, too few samples in one, and as `filtered_least_squares` for the plant.
    """
    for name, value in (("harmonics", harmonics), ("motion_harmonics", motion_harmonics)):
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise InputError(f"harmonic({name}={value!r}): needs a whole number from 1 on.")
    balances = linear_balances(problem, "harmonic")
    count = max(harmonics, motion_harmonics)
    whole = [
        _equations(problem, r, balances, _period(r, frequency, count), None, harmonics, motion_harmonics, smallest) for r in problem.fitted
    ]
    mean, information = prior(problem)
    size, theta, determined = _solved(whole, mean, information, None)
    parts = [
        [
            _equations(problem, r, balances, _period(r, frequency, count), k, harmonics, motion_harmonics, smallest)
            for k in range(_periods(r, _period(r, frequency, count)))
        ]
        for r in problem.fitted
    ]
    variance, scattered = np.zeros(len(theta)), all(len(p) >= ENOUGH for p in parts)
    if scattered:
        for i, pieces in enumerate(parts):  # of each recording in turn, the others as they are
            alone = [_solved([*whole[:i], piece, *whole[i + 1 :]], mean, information, size)[1] for piece in pieces]
            variance += np.var(alone, axis=0, ddof=1) / len(pieces)
    kept = sum(len(e.E) for e in whole)
    notes = [f"{kept} harmonics of {len(balances.rows)} balances for {len(theta)} parameters; condition number {_condition(whole):.3g}."]
    if not scattered:
        notes.append(f"Fewer than {ENOUGH} periods in a recording: no standard deviations.")
    fits, failed = simulated_fits(problem, theta, {r.title: (e.first, e.start) for r, e in zip(problem.fitted, whole, strict=True)})
    return Baseline(
        method="harmonic",
        model=problem.dae.name,
        parameters=estimates(problem, theta, np.sqrt(variance) if scattered else np.full(len(theta), np.nan), list(determined)),
        fit=fits,
        predicted="simulated",
        notes=(*notes, *failed),
    )


def _solved(
    equations: list[_Equations], mean: Array, information: Array, size: float | None
) -> tuple[float, Array, np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    """rms of what is left of the harmonics, the parameters, and which of them are determined."""
    M, E = np.concatenate([e.M for e in equations]), np.concatenate([e.E for e in equations])
    unit = np.linalg.norm(M, axis=0)
    unit[unit == 0] = 1.0
    left = 0.0 if size is None else size
    for _ in range(2):
        weight = np.sqrt(information) * left
        A, b = np.vstack([M, np.diag(weight)]) / unit, np.concatenate([E, weight * mean])
        U, s, V = np.linalg.svd(A, full_matrices=False)
        kept = s > 1e-10 * s[0]
        theta = (V[kept].T @ ((U[:, kept].T @ b) / s[kept])) / unit
        left = float(np.sqrt(np.sum((E - M @ theta) ** 2) / max(1, len(E) - len(theta)))) if size is None else size
        if not information.any():
            break
    silent = np.sqrt(np.sum(V[~kept] ** 2, axis=0))
    return left, theta, silent < 1e-3


def _condition(equations: list[_Equations]) -> float:
    M = np.concatenate([e.M for e in equations])
    return float(np.linalg.cond(M / np.maximum(np.linalg.norm(M, axis=0), 1e-300)))


def _period(recording: Recording, frequency: Mapping[str, float] | float, count: int) -> float:
    """The period [s]; raises InputError where the recording holds none, or too few samples of one for `count` harmonics."""
    given = frequency.get(recording.name) if isinstance(frequency, Mapping) else frequency
    if given is None:
        raise InputError(f"harmonic(frequency=..): {recording.name} has none; give one for every recording, or one number for all.")
    if not (np.isfinite(given) and given > 0):
        raise InputError(f"harmonic(frequency={given!r}): needs a positive angular frequency [rad/s].")
    period = 2 * np.pi / given
    span, step = float(recording.time[-1] - recording.time[0]) + recording.sampling, recording.sampling
    if span < period * (1 - 1e-6):
        raise InputError(
            f"{recording.name}: {span:.4g} s hold no whole period of {period:.4g} s; record for longer, or check the frequency."
        )
    if period / step < 2 * count + 2:
        raise InputError(
            f"{recording.name}: {period / step:.0f} samples in a period are too few for {count} harmonics; lower their number."
        )
    return period


def _periods(recording: Recording, period: float) -> int:
    return int((recording.time[-1] - recording.time[0] + recording.sampling) / period * (1 + 1e-6))


def _equations(
    problem: Problem, recording: Recording, balances: Balances, period: float, part: int | None, kept: int, of_motion: int, smallest: float
) -> _Equations:
    """Harmonics of the balances over the whole periods of a recording, or over one of them (`part`)."""
    number = _periods(recording, period)
    begin = recording.time[-1] + recording.sampling - number * period + (0 if part is None else part * period)
    end = begin + period * (number if part is None else 1)
    slack = 1e-6 * period
    rows = np.flatnonzero((recording.time >= begin - slack) & (recording.time < end - slack))
    w = 2 * np.pi / period
    grid = np.arange(FINER * max(kept, of_motion)) * period / (FINER * max(kept, of_motion))
    t = recording.time[rows] - begin

    def series(signals: Array, _inputs: Array, _hold: Hold, _step: float) -> Filtered:
        q = _coefficients(signals[:, rows], t, w, of_motion)
        place, rate, twice = (_rows(grid, w, of_motion, order) for order in (0, 1, 2))
        u = _driving(problem, recording, begin, end, slack, w, kept)
        return Filtered(
            signals=q @ place.T,
            first=q @ rate.T,
            second=q @ twice.T,
            inputs=u @ _rows(grid, w, kept).T,
            rows=slice(int(rows[0]), int(rows[-1]) + 1),
        )

    m = motion(problem, recording, series, "harmonic", begin + grid)
    F, slope = balances.along(m)
    columns = np.concatenate([F[:, :, None], slope], axis=2)
    content = np.linalg.pinv(_rows(grid, w, kept)) @ columns.reshape(len(grid), -1)
    content = content.reshape(-1, len(balances.rows), columns.shape[2])
    base = problem.values[list(problem.free)]
    M, E = content[:, :, 1:], np.einsum("hrp,p->hr", content[:, :, 1:], base) - content[:, :, 0]
    size = np.abs(np.concatenate([content[:, :, 1:] * base, E[:, :, None]], axis=2)).max(axis=2)
    large = size >= smallest * size.max(axis=0)
    start = {q.name: float(m.x[i, 0]) for i, q in enumerate(problem.dae.states) if np.any(m.x[i]) or np.any(m.dx[i])}
    return _Equations(M=M[large], E=E[large], first=int(rows[0]), start=known_start(problem) | start)


def _driving(problem: Problem, recording: Recording, begin: float, end: float, slack: float, w: float, kept: int) -> Array:
    """Fourier coefficients of the inputs, (nu, 2 kept + 1), from their values on their own clock, which may be faster than the rows."""
    drive = drive_of(recording)
    step = uniform_step(recording, "harmonic", drive.time)
    there = (drive.time >= begin - slack) & (drive.time < end - slack)
    values = np.array([drive.inputs[q.name][there] for q in problem.dae.inputs]).reshape(-1, int(there.sum()))
    t = drive.time[there] - begin
    return _staircase(values, t, step, w, kept) if recording.hold == "zero" else _coefficients(values, t, w, kept)


def _rows(t: Array, w: float, number: int, order: int = 0) -> Array:
    """1, cos w t, sin w t, cos 2 w t, .. or their derivative of that order at the times t, (n, 2 number + 1)."""
    i = np.arange(1, number + 1) * w
    phase = t[:, None] * i + order * np.pi / 2
    pairs = np.stack([np.cos(phase), np.sin(phase)], axis=2) * (i**order)[:, None]
    return np.hstack([np.full((len(t), 1), 1.0 if order == 0 else 0.0), pairs.reshape(len(t), -1)])


def _coefficients(values: Array, t: Array, w: float, number: int) -> Array:
    """Fourier coefficients of signals (m, n) sampled at t, by least squares: (m, 2 number + 1)."""
    return np.asarray(np.linalg.lstsq(_rows(t, w, number), values.T, rcond=None)[0].T)


def _staircase(values: Array, t: Array, step: float, w: float, number: int) -> Array:
    """Fourier coefficients of held inputs: those of the samples, turned and shrunk as a step of that length does.

    A hold over h multiplies e^(i w t) by (1 - e^(-i w h))/(i w h) = sinc(w h/2) e^(-i w h/2): a delay of h/2.
    """
    c = _coefficients(values, t, w, number)
    i = np.arange(1, number + 1) * w * step / 2
    z = (c[:, 1::2] - 1j * c[:, 2::2]) * np.sinc(i / np.pi) * np.exp(-1j * i)
    out = c.copy()
    out[:, 1::2], out[:, 2::2] = z.real, -z.imag
    return out
