"""A moving-horizon estimator: samples in as they come, an estimate out for each.

    estimator = Estimator(problem, samples=50)
    estimate = estimator.update(Sample(time=t, inputs={"F": 12.0}, outputs={"x": 0.103}))
    estimate["friction.f_c"], estimate.std("friction.f_c")

sample -> stages from the last one -> room near rest -> Gauss-Newton steps through the window -> estimate

Parameters are constants of the machine; one that is `Free(drift=...)` walks. The window is a means of relinearisation: what left it is kept
in the arrival cost (`ocp/moving/window.py`), so no estimate forgets anything unless a drift says so.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from backsight.models.errors import InputError
from backsight.ocp.moving.roots import root
from backsight.ocp.moving.stage import Stage
from backsight.ocp.moving.trajectory import Known, Solve
from backsight.ocp.moving.window import DOUBTED, Update, Window

from ..problem import Free, Problem
from ..recordings.columns import cut
from ..supposed import PARAMETER
from .driven import Driven
from .estimate import Estimate, Outcome, Sample
from .latency import Latency
from .layout import Found, Layout
from .readings import Readings
from .room import Room
from .settled import settled
from .tuning import Tuning, tuned

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

SAMPLES = 50  # of a window that nobody gave
ITERATIONS = 10  # Gauss-Newton steps for a sample, at most
TOLERANCE = 0.02  # standard deviations: what the last one may still move
USABLE = 0.3  # standard deviations: where all steps are used up and the last one moved no more than this, the estimate serves
WIDE = 2.0  # prior of a parameter of which only a guess is given, over that guess: few samples do not carry it away
EXACT = 1e-9  # of a state's nominal size: what is known exactly
WILD = 100.0  # times the largest value recorded: an input without limits is no input, but an error of the line
ABSURD = 1e100  # deviations: a mark that there is no sample, and none
SAME = 1e-6  # of the sampling interval: times that are one
MOVING = (Outcome.ESTIMATED, Outcome.PREDICTED, Outcome.DOUBTED, Outcome.FAILED)  # outcomes of a sample that follows the last one
GATE = 5.0  # standard deviations of a prediction beyond which a sample waits for others like it
RUN = 5  # gross errors of one sign in a row are none


class Estimator:
    """Estimates of states, residual forces and parameters from a stream of samples.

    problem: its fitted recordings tell the weights that it leaves open (`tuning.py`). samples: in the window. iterations: Gauss-Newton
    steps for a sample at most; 1 is the real-time iteration (M. Diehl, H. G. Bock & J. P. Schloeder, SIAM J. Control Optim. 43, 2005).
    update: how the arrival cost is carried on, "smoothing" or "filtering". degree: of the polynomials in a stage.
    jit: compile the stages' equations with the C compiler, once (`ocp/moving/native.py`); without one, or where it fails, they are
    evaluated by CasADi, to the same estimates, and `notes` says so.
    """

    def __init__(
        self,
        problem: Problem,
        *,
        samples: int = SAMPLES,
        iterations: int = ITERATIONS,
        update: Update = "smoothing",
        degree: int = 2,
        tuning: Tuning | None = None,
        jit: bool = True,
        progress: Callable[[str], None] | None = None,
    ) -> None:
        if samples < 2 or iterations < 1:
            raise InputError(f"Estimator(samples={samples}, iterations={iterations}): needs 2 samples and 1 iteration at least.")
        say = progress or (lambda _: None)
        self.tuning = t = tuning or tuned(problem, say)
        if jit:
            say("compiling the stages")
        self.problem, self.iterations = t.problem, iterations
        # of the problem as asked: as posed they are states
        self._drifting = {name: free for name, free in t.asked.varying.items() if free.drift is not None}
        dae, posed = self.problem.dae, self.problem
        soft = tuple(sorted(t.force_std))
        self._force_std = np.array([t.force_std[k] for k in soft])
        stage = Stage(dae, posed.free, posed.values, soft, degree)
        self._outputs, self._inputs = tuple(q.name for q in dae.outputs), tuple(q.name for q in dae.inputs)
        self._states = tuple(q.name for q in dae.states)
        self.layout = Layout(t.asked, stage)
        self.names = self.layout.names
        scales = np.where(np.isfinite(t.noise), 1.0 / t.noise, 0.0)
        typical = np.concatenate(
            [[t.sampling / t.stages, 0.0], np.ones(2 * len(self._inputs)), np.zeros(len(scales)), 1 / self._force_std, scales]
        )
        length = samples * t.stages
        self.window = Window(stage, length, self._begun(), typical, self._bounds(), t.corner, update, self._reach(), jit=jit)
        self.notes = (f"The stages are evaluated without C code, more slowly: {self.window.slow}.",) if self.window.slow else ()
        self.room, self.readings = Room(stage, t.laws, self._force_std, t.noise, length, jit=jit and not self.notes), Readings(stage)
        self.samples = samples
        self._scales, self.driven = scales, Driven(len(self._inputs), posed.fitted[0].hold)
        self._absurd = ABSURD / np.maximum(scales, 1.0)
        self.newest: float | None = None
        # the clock's own start would cost digits; only a model that knows the time needs it
        self._timed = ca.depends_on(ca.vertcat(dae.residual, dae.output), dae.t)
        self.origin, self._anew = 0.0, False
        largest = [max(float(np.max(np.abs(r.inputs[name]), initial=0.0)) for r in posed.fitted) for name in self._inputs]
        self._largest = np.array(
            [
                WILD * most if most > 0 and name not in posed.fitted[0].limits else np.inf
                for name, most in zip(self._inputs, largest, strict=True)
            ]
        )
        self.wild = 0  # values of inputs that were left out
        self.latency, self.counts = Latency(), dict.fromkeys(Outcome, 0)
        self.estimate: Estimate | None = None
        self.steps = 0
        self.rows = 0  # of a stream so far, of which `every` takes some
        self._predicted = self.window.here, self.window.ahead

    # ---- what comes in

    def hold(self, time: float, inputs: Mapping[str, float]) -> None:
        """The inputs changed at a time [s] after the newest sample; those left out or NaN stay what they are. Too late it is no matter."""
        if self.newest is None or self._anew or time > self.newest + SAME * self.tuning.sampling:
            self.driven.add(time - self.origin, self._acting(inputs))

    def update(self, sample: Sample) -> Estimate:
        """The estimate at the sample's time, or, if that has passed, the newest one with what a late sample adds to it.

        Raises InputError for a time that is no number and names that the model does not have.
        """
        began = clock.perf_counter()
        if not np.isfinite(sample.time):
            raise InputError(f"update: time is {sample.time}; a sample has a finite time in seconds.")
        inputs = self._acting(sample.inputs)
        read = self._vector(sample.outputs, self._outputs, "output")
        read[~(np.abs(read) < self._absurd)] = np.nan
        late = self.newest is not None and not self._anew and sample.time <= self.newest + SAME * self.tuning.sampling
        outcome, done, surprise = self._filled(sample.time, read) if late else self._moved(sample.time, inputs, read)
        if outcome is Outcome.LATE and self.estimate is not None:
            estimate = replace(self.estimate, outcome=outcome, iterations=0, seconds=clock.perf_counter() - began)
        else:
            estimate = self._read(outcome, done, surprise, began, moved=not late)
        self.estimate = estimate
        self.latency.add(estimate.seconds)
        self.steps += estimate.iterations
        self.counts[outcome] += 1
        return estimate

    def restart(self) -> None:
        """The next sample may be at any time and the states start anew with it: another recording of the same machine."""
        self._anew = self.newest is not None
        self.driven.clear()

    def _moved(self, time: float, inputs: Array, read: Array) -> tuple[Outcome, Solve, Array]:
        """A sample at a new time."""
        first = self.newest is None
        gap = self._anew or (self.newest is not None and time - self.newest > self.tuning.gap)
        self._anew = False
        if first or gap:
            self.origin = 0.0 if self._timed else time
            self.driven.clear()
        self.driven.put(time - self.origin, inputs)
        if first:
            self._settle(time)
        if gap:
            self._restarted(time - (self.newest or time))
        elif not first:
            self._pushed(time)
        self.newest = time
        there = np.isfinite(read) & (self._scales > 0)
        self._put_newest(np.where(there, read, 0.0), np.where(there, self._scales, 0.0))
        self.room.given(self.window)
        self.window.look_ahead()
        surprise = self.window.surprise()
        self.window.doubt(surprise, GATE)
        done = self._solved()
        if not done.converged:
            return Outcome.FAILED, done, surprise
        if gap:
            return Outcome.RESTARTED, done, surprise
        if not there.any():
            return Outcome.PREDICTED, done, surprise
        doubted = np.all(self.window.faith_newest[there] == DOUBTED)
        return Outcome.DOUBTED if doubted else Outcome.ESTIMATED, done, surprise

    def _pushed(self, time: float) -> None:
        """Stages from the newest sample to a time."""
        window, t = self.window, self.tuning
        start, end = (self.newest or 0.0) - self.origin, time - self.origin
        count = t.stages * max(1, round((end - start) / t.sampling))
        edges = np.linspace(start, end, count + 1)
        forces = 1 / self._force_std
        for a, b in pairwise(edges.tolist()):
            sample = window.newest[1 + len(self._inputs) :]
            window.push(
                np.concatenate([[b - a, a], self.driven.over(a, b), sample[: len(self._scales)], forces, sample[len(self._scales) :]])
            )
        self.driven.forget(end)

    def _put_newest(self, read: Array, scales: Array) -> None:
        time = (self.newest or 0.0) - self.origin
        self.window.newest[:] = np.concatenate([[time], self.driven.last, read, scales])

    def _restarted(self, gap: float) -> None:
        """A new start of the states after a gap [s], with what is known of them always and of the parameters by now."""
        posed = self.problem
        always = {name: known for name, known in posed.start.items() if known.always}
        drifting = [i for i, name in enumerate(self._states) if name in self._drifting]
        Rd, x = self._known_states(always), self.window.here.x[:, -1].copy()
        if drifting:  # a walk goes on through a gap
            half, unknown = self.window.spread()
            for i in drifting:
                walked = posed.weights.W[f"{PARAMETER}{self._states[i]}"] ** 2 * max(gap, 0.0)
                Rd[i, i] = 0.0 if unknown[i] else 1.0 / float(np.sqrt(np.sum(half[i] ** 2) + walked))
        for i, name in enumerate(self._states):
            if name in always:
                x[i] = always[name].value
        self.window.restart(Rd, x)

    def _filled(self, time: float, read: Array) -> tuple[Outcome, Solve, Array]:
        """A late sample: it counts where its row is still in the window and has none of that output."""
        window, nothing = self.window, np.full(len(read), np.nan)
        unsolved = Solve(iterations=0, converged=True, size=0.0, missed=0.0)
        near = SAME * self.tuning.sampling
        ny, filled = len(read), False
        at = time - self.origin
        if abs(at - window.newest[0]) <= near:
            row, scale_row, stage = window.newest[1 + len(self._inputs) :][:ny], window.newest[-ny:], window.count
        else:
            found = np.flatnonzero(np.abs(window.d[1] - at) <= near)
            if not len(found):
                return Outcome.LATE, unsolved, nothing
            column, stage = window.d[:, found[0]], int(found[0])
            first = 2 + 2 * len(self._inputs)
            row, scale_row = column[first : first + ny], column[-ny:]
        for i in np.flatnonzero(np.isfinite(read) & (self._scales > 0) & (scale_row == 0)):
            row[i], scale_row[i], filled = read[i], self._scales[i], True
        if not filled:
            return Outcome.LATE, unsolved, nothing
        window.reopen(stage)
        done = self._solved()
        return (Outcome.FILLED if done.converged else Outcome.FAILED), done, nothing

    # ---- solving

    def _solved(self) -> Solve:
        """Steps through the window. Where they do not converge what they reached is where the next ones start, if it is sound.

        An estimate that one more step would hardly move counts as converged, and so does the one of a real-time iteration.
        """
        window, predicted = self.window, self.window.here
        self._predicted = predicted, window.ahead
        try:
            done = window.solve(self.iterations, TOLERANCE)
            if window.review(RUN, GATE):
                again = window.solve(self.iterations, TOLERANCE)
                done = replace(again, iterations=done.iterations + again.iterations)
            sound = bool(np.all(np.isfinite(window.here.x[:, -1])) and np.all(np.isfinite(window.told.Rd)))
        except np.linalg.LinAlgError:
            done, sound = Solve(iterations=0, converged=False, size=np.inf, missed=np.inf), False
        if not sound:
            window.give_up(predicted)
            return replace(done, converged=False)
        found = bool(np.isfinite(done.missed))  # a step along which the cost falls
        return replace(done, converged=done.converged or done.size <= USABLE or (found and self.iterations == 1))

    # ---- what goes out

    def _read(self, outcome: Outcome, done: Solve, surprise: Array, began: float, *, moved: bool) -> Estimate:
        window, t, ns = self.window, self.tuning, len(self._force_std)
        nx, ny, at = len(self._states), len(self._outputs), window.here
        half, unknown = window.spread()
        if outcome is Outcome.FAILED:
            at, ahead = self._predicted
            half, unknown = root(ahead.Rd[:, :-1])
        std = np.sqrt(np.sum(half**2, axis=1))
        std[unknown] = np.inf
        x, p = at.x[:, -1], at.p
        outputs, outputs_std = self.readings.at(x, self.driven.last, p, float(window.newest[0]), half, self._force_std, t.sampling)
        w, w_std = window.forces() if window.count else (np.zeros(ns), np.full(ns, np.inf))
        sample, scale = window.newest[1 + len(self._inputs) :][:ny], window.newest[-ny:]
        acted = window.d[2 : 2 + 2 * len(self._inputs), -1].reshape(2, -1).mean(axis=0) if window.count else self.driven.last
        if moved and outcome in MOVING and window.count >= t.stages:
            for j in range(window.count - t.stages, window.count):
                self.layout.move(at.stages[:, j], p, window.d[:, j], at.x[:, j], at.x[:, j + 1])
        read = self.layout.read(Found(x=x, x_std=std[:nx], p=p, p_std=std[nx:], w=w, w_std=w_std, u=acted))
        return Estimate(
            time=self.newest or 0.0,
            names=self.names,
            outputs=outputs,
            outputs_std=outputs_std,
            measured=np.where(scale > 0, sample, np.nan),
            surprise=surprise,
            outcome=outcome,
            iterations=done.iterations,
            step=done.size,
            seconds=clock.perf_counter() - began,
            **{name: value for name, (value, _) in read.items()},
            **{f"{name}_std": deviation for name, (_, deviation) in read.items()},
        )

    def read_again(self) -> None:
        """The newest estimate, of an estimator that was saved."""
        if self.newest is not None:
            nothing = np.full(len(self._outputs), np.nan)
            done = Solve(iterations=0, converged=True, size=0.0, missed=0.0)
            self.estimate = self._read(Outcome.ESTIMATED, done, nothing, clock.perf_counter(), moved=False)

    # ---- the start

    def _settle(self, time: float) -> None:
        """Where the first steps start from for lags of which nothing is known."""
        posed = self.problem
        for name, value in settled(posed, self.driven.last, time - self.origin, self.window.length * self.tuning.sampling).items():
            if name not in posed.start:
                i = [q.name for q in posed.dae.states].index(name)
                self.window.here.x[i, -1] = np.clip(value, self.window.bounds[0][i], self.window.bounds[1][i])

    def _begun(self) -> Known:
        """What is known before the first sample, of [x; p]."""
        posed, dae = self.problem, self.problem.dae
        nx, free = dae.x.shape[0], posed.free
        n = nx + len(free)
        Rd, reference = np.zeros((n, n + 1)), np.zeros(n)
        Rd[:nx, :nx] = self._known_states(posed.start)[:, :nx]
        for i, q in enumerate(dae.states):
            known = posed.start.get(q.name)
            guess = self._drifting[q.name].guess if q.name in self._drifting else q.start
            reference[i] = guess if known is None else known.value
        for k, i in enumerate(free):
            info = dae.parameters[i]
            given = posed.parameters[info.name]
            if not isinstance(given, Free):
                raise TypeError(f"{info.name} is free and has no guess")
            reference[nx + k] = given.guess
            Rd[nx + k, nx + k] = 1.0 / (given.std or WIDE * (abs(given.guess) or info.nominal))
        return Known(Rd=Rd, reference=reference)

    def _known_states(self, known: Mapping[str, Any]) -> Array:
        """Information on the states about their values, (nx, nx + 1)."""
        states = self.problem.dae.states
        Rd = np.zeros((len(states), len(states) + 1))
        for i, q in enumerate(states):
            if q.name in known:
                Rd[i, i] = 1.0 / max(known[q.name].std, EXACT * q.nominal)
            elif q.name in self._drifting:
                free = self._drifting[q.name]
                Rd[i, i] = 1.0 / (free.std or WIDE * (abs(free.guess) or q.nominal))
        return Rd

    def _reach(self) -> Array:
        """How far a step may go that no sample tells: a state as far as its usual size, a parameter as its prior lets it."""
        return np.array([*(q.nominal for q in self.problem.dae.states), *(np.inf for _ in self.problem.free)])

    def _bounds(self) -> tuple[Array, Array]:
        posed = self.problem
        states = [posed.bounds.get(q.name, (-np.inf, np.inf)) for q in posed.dae.states]
        both = np.array([*states, *(posed.parameter_range(i) for i in posed.free)]).reshape(-1, 2)
        return both[:, 0].copy(), both[:, 1].copy()

    def _acting(self, commands: Mapping[str, float]) -> Array:
        """The inputs (nu,) as the actuators can do them; one beyond all reason is missing."""
        limits = self.problem.fitted[0].limits
        u = self._vector(commands, self._inputs, "input")
        wild = np.abs(u) > self._largest
        self.wild += int(np.count_nonzero(wild))
        u[wild] = np.nan
        return np.array([cut(value, limits.get(name)) for name, value in zip(self._inputs, u.tolist(), strict=True)])

    @staticmethod
    def _vector(given: Mapping[str, float], names: tuple[str, ...], what: str) -> Array:
        out = np.full(len(names), np.nan)
        for name, value in given.items():
            if name not in names:
                raise InputError(f"update: the model has no {what} {name!r}; it has {', '.join(names) or 'none'}.")
            if np.isfinite(value):
                out[names.index(name)] = value
        return out
