"""Segments of recordings simulated from starts of their own, and how their errors depend on the parameters and on these starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backsight.models import SolveError, Trajectory
from backsight.models.errors import InputError

from ..problem import Problem
from ..recordings.recording import Recording
from ..results import OutputFit
from ..smoothing.horizons import output_stds
from ..validation.fit import output_fit
from .measured_states import instantaneous, invert_outputs
from .result import bounds, known_start, simulated

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
RTOL = 1e-9  # of a simulation, well below the step of the differences
STEP = 1e-4  # of a parameter's size
LEAST = 10  # rows of a segment
SLOPE_ROWS = 9  # samples that tell the velocity with which a segment starts


@dataclass(frozen=True, kw_only=True)
class Segment:
    """Rows of a piece of a recording that one initial state explains.

    target (rows, ny) in units of std (ny,), NaN where nothing is measured.
    """

    recording: Recording
    rows: slice
    std: Array
    target: Array
    names: tuple[str, ...]

    @property
    def begins(self) -> bool:
        """Whether the recording itself starts here, of which something may be known; after a gap nothing is."""
        return self.rows.start == 0 and self.recording.part == 0


def cut(problem: Problem, length: float | None) -> list[Segment]:
    """Every fitted recording in segments of about `length` seconds; raises InputError where one has less than LEAST rows.

    Of a recording with gaps, pieces that are shorter are left out.
    """
    if length is not None and not (np.isfinite(length) and length > 0):
        raise InputError(f"prediction_error(segment={length!r}): needs a positive time [s], or None for whole recordings.")
    out = []
    for recording, stds in zip(problem.fitted, output_stds(problem)[0], strict=True):
        n = len(recording.time)
        span = float(recording.time[-1] - recording.time[0])
        pieces = 1 if length is None else max(1, round(span / length))
        if n // pieces < LEAST:
            if pieces > 1:
                raise InputError(
                    f"prediction_error(segment={length:g}): leaves {n // pieces} samples of {recording.name} to each start; make it longer."
                )
            if np.isinf(recording.gap or 0.0):
                continue
            raise InputError(f"{recording.name}: prediction_error needs {LEAST} rows and there are {n}; use a longer recording.")
        edges = np.searchsorted(recording.time, recording.time[0] + span * np.arange(1, pieces) / pieces)
        names = tuple(q.name for q in problem.dae.outputs if q.name in recording.outputs)
        std = np.array([stds[name] for name in names])
        y = np.column_stack([recording.outputs[name] for name in names]) / std
        for a, b in zip([0, *edges], [*edges, n], strict=True):
            out.append(Segment(recording=recording, rows=slice(int(a), int(b)), std=std, target=y[a:b], names=names))
    if not out:
        raise InputError(f"{problem.fitted[0].name}: prediction_error needs {LEAST} rows between gaps; make gap longer.")
    return out


class Shooting:
    """Residuals and their derivatives of all segments; unknowns are [p (np_free), x_0 of segment 1 (nx), x_0 of segment 2, ..]."""

    def __init__(self, problem: Problem, segments: list[Segment]) -> None:
        self.problem, self.segments = problem, segments
        infos = [problem.dae.parameters[i] for i in problem.free]
        self.size = np.array([max(abs(problem.values[i]), abs(p.nominal)) for i, p in zip(problem.free, infos, strict=True)])
        self.states = [q.name for q in problem.dae.states]
        self.state_size = np.array([abs(q.nominal) or 1.0 for q in problem.dae.states])
        self.outputs = len({name for s in segments for name in s.names})
        self.weight = dict.fromkeys((name for s in segments for name in s.names), 1.0)
        self.last: tuple[Array, list[Array]] | None = None

    def simulated(self, theta: Array, starts: Array) -> list[Array]:
        """Outputs in units of their std, (rows, ny) of each segment; inf where the simulation fails."""
        out = []
        for s, start in zip(self.segments, starts, strict=True):
            try:
                run = simulated(self.problem, s.recording, s.rows, theta, self._named(s, start), RTOL)
                out.append(np.column_stack([run.outputs[name] for name in s.names]) / s.std)
            except (SolveError, ValueError):
                out.append(np.full(s.target.shape, np.inf))
        return out

    def _named(self, s: Segment, start: Array) -> dict[str, float]:
        known = self.problem.known_exactly if s.begins else {}
        return {name: float(v) for name, v in zip(self.states, start, strict=True)} | known

    def _split(self, unknown: Array) -> tuple[Array, Array]:
        count = len(self.size)
        return unknown[:count], unknown[count:].reshape(len(self.segments), -1)

    def _errors(self, unknown: Array) -> list[Array]:
        """(model - samples) in units of std, (rows, ny); zero where nothing is measured."""
        if self.last is None or not np.array_equal(self.last[0], unknown):
            outputs = self.simulated(*self._split(unknown))
            self.last = (
                unknown.copy(),
                [np.where(np.isnan(s.target), 0.0, y - s.target) for s, y in zip(self.segments, outputs, strict=True)],
            )
        return self.last[1]

    def _weights(self, s: Segment) -> Array:
        return np.array([self.weight[name] for name in s.names])

    def residuals(self, unknown: Array) -> Array:
        return np.concatenate([(e * self._weights(s)).ravel() for s, e in zip(self.segments, self._errors(unknown), strict=True)])

    def jacobian(self, unknown: Array) -> Array:
        blocks = self._blocks(unknown)
        count, nx = len(self.size), len(self.states)
        out = np.zeros((sum(p.shape[0] * p.shape[1] for p, _ in blocks), len(unknown)))
        row = 0
        for k, (p, x) in enumerate(blocks):
            n = p.shape[0] * p.shape[1]
            out[row : row + n, :count] = p.reshape(n, count)
            out[row : row + n, count + k * nx : count + (k + 1) * nx] = x.reshape(n, nx)
            row += n
        return out

    def _blocks(self, unknown: Array) -> list[tuple[Array, Array]]:
        """Derivatives of each segment's weighted errors by the parameters (rows, ny, np) and by its own start (rows, ny, nx)."""
        theta, starts = self._split(unknown)
        base = self._errors(unknown)
        low, high = bounds(self.problem)
        columns: list[list[Array]] = []
        for k in range(len(theta) + len(self.states)):
            moved_theta, moved_starts = theta.copy(), starts.copy()
            if k < len(theta):
                step = STEP * max(abs(theta[k]), 1e-3 * self.size[k])
                step = -step if theta[k] + step > high[k] and theta[k] - step >= low[k] else step
                moved_theta[k] += step
            else:
                i = k - len(theta)
                step = STEP * max(float(np.max(np.abs(starts[:, i]))), 1e-3 * self.state_size[i])
                moved_starts[:, i] += step
            outputs = self.simulated(moved_theta, moved_starts)
            columns.append(
                [
                    np.where(np.isnan(s.target) | ~np.isfinite(y), 0.0, (y - s.target - e) / step) * self._weights(s)
                    for s, y, e in zip(self.segments, outputs, base, strict=True)
                ]
            )
        count = len(theta)
        return [
            (np.stack([c[k] for c in columns[:count]], axis=2), np.stack([c[k] for c in columns[count:]], axis=2))
            for k in range(len(self.segments))
        ]

    def reweigh(self, unknown: Array) -> None:
        """Weights that make the rms of every output's error one."""
        square, number = dict.fromkeys(self.weight, 0.0), dict.fromkeys(self.weight, 0)
        for s, e in zip(self.segments, self._errors(unknown), strict=True):
            for i, name in enumerate(s.names):
                square[name] += float(np.sum(e[:, i] ** 2))
                number[name] += int(np.isfinite(s.target[:, i]).sum())
        self.weight = {name: float(1.0 / max(np.sqrt(square[name] / max(number[name], 1)), 1e-300)) for name in square}

    def profiled(self, unknown: Array) -> tuple[list[Array], list[Array]]:
        """Per piece of a recording J_p - J_x J_x^+ J_p (n, ny, np), and samples minus model (n, ny), both weighted."""
        pieces: dict[str, list[tuple[Array, Array]]] = {}
        for s, (p, x), e in zip(self.segments, self._blocks(unknown), self._errors(unknown), strict=True):
            flat, start = p.reshape(-1, p.shape[2]), x.reshape(-1, x.shape[2])
            unit = np.linalg.norm(start, axis=0)
            start = start[:, unit > 0] / unit[unit > 0]
            rest = flat - start @ np.linalg.lstsq(start, flat, rcond=1e-10)[0]
            pieces.setdefault(s.recording.title, []).append((rest.reshape(p.shape), -e * self._weights(s)))
        return [np.concatenate([p for p, _ in list_]) for list_ in pieces.values()], [
            np.concatenate([e for _, e in list_]) for list_ in pieces.values()
        ]

    def fits(self, unknown: Array) -> dict[str, dict[str, OutputFit]]:
        theta, starts = self._split(unknown)
        met: dict[str, dict[str, list[Array]]] = {}
        for s, y in zip(self.segments, self.simulated(theta, starts), strict=True):
            for name, column in zip(s.names, np.stack([s.target * s.std, y * s.std]).transpose(2, 0, 1), strict=True):
                met.setdefault(s.recording.name, {}).setdefault(name, []).append(column)
        return {r: {name: output_fit(*np.hstack(parts)) for name, parts in outputs.items()} for r, outputs in met.items()}

    def starts(self) -> Array:
        """First guesses of every segment's start, (segments, nx).

        What the outputs show is the value and the slope of a line through the first samples; the rest comes from one simulation of the
        whole recording at the guesses of the parameters, or from the model's start values where that fails.
        """
        dae = self.problem.dae
        out = np.empty((len(self.segments), len(self.states)))
        theta = self.problem.values[list(self.problem.free)]
        course: dict[str, Trajectory | None] = {}
        for k, s in enumerate(self.segments):
            seen = self._seen(s)
            name, known = s.recording.title, known_start(self.problem) if s.begins else {}
            if name not in course:
                first = {q.name: seen.get(q.name, q.start) for q in dae.states} | known
                course[name] = self._course(s.recording, theta, first)
            run = course[name]
            for i, q in enumerate(dae.states):
                unseen = float(run.states[q.name][s.rows.start]) if run is not None else q.start
                out[k, i] = known.get(q.name, seen.get(q.name, unseen))
        return out

    def _course(self, recording: Recording, theta: Array, first: dict[str, float]) -> Trajectory | None:
        try:
            return simulated(self.problem, recording, slice(0, len(recording.time)), theta, first, RTOL)
        except (SolveError, ValueError):
            return None

    def _seen(self, s: Segment) -> dict[str, float]:
        """Shown states and the velocities that belong to them, at the segment's first instant."""
        dae = self.problem.dae
        used = instantaneous(self.problem, s.recording)
        time = s.recording.time[s.rows] - s.recording.time[s.rows.start]
        lines = []
        for i in used:
            y = s.recording.outputs[dae.outputs[i].name][s.rows]
            there = np.flatnonzero(np.isfinite(y))[:SLOPE_ROWS]
            lines.append(np.polyfit(time[there], y[there], 1) if len(there) > 1 else np.full(2, np.nan))
        kept = [k for k, line in enumerate(lines) if np.all(np.isfinite(line))]
        if not kept:
            return {}
        used, slope, value = [used[k] for k in kept], *(np.array([lines[k][j] for k in kept]) for j in (0, 1))
        std = np.array([s.std[s.names.index(dae.outputs[i].name)] for i in used])
        shown = invert_outputs(self.problem, used, value[:, None], std, s.recording.time[s.rows.start : s.rows.start + 1])
        rate = np.linalg.pinv(shown.slopes[0], rcond=1e-10) @ (slope / std)
        found = {j: float(rate[i]) for i, j, _ in dae.kinematics if i in shown.chosen} | {i: float(shown.x[i, 0]) for i in shown.chosen}
        return {self.states[i]: v for i, v in found.items()}
