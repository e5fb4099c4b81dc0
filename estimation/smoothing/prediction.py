"""What the fitted model says about recordings that it has not seen.

A smoother would bend its residual forces to any recording, so its residuals prove nothing. A prediction has parameters from the fit,
inputs, and a start:

    over the whole recording    simulated from the start that the smoothed first HEAD of it tells; the rows of the HEAD do not count
    over windows                simulated from the state that the HEAD before each window tells; no later sample is used

After a gap, over which nobody knows the inputs, both begin anew.

A parameter that is each recording's own, or drifts, takes none of the values that were found: every HEAD tells it beside the state, known
beforehand by their mean and spread (`of_one_more`), and what follows is simulated with that.

Where the model does not forget its state (a free integrator), an error of the start or of a constant force adds up over the whole
recording; the windows are then the better measure.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import scipy.linalg

from backsight.models import Dae, InputError, ModelError, Quantity, SolveError, Trajectory
from backsight.models.augmentation.parameters import case_name
from backsight.models.errors import OutOfTime
from backsight.ocp import Status
from backsight.ocp.linear import linearise

from ..problem import Free, Known, Problem
from ..recordings.drive import run as run_under_inputs
from ..recordings.recording import Recording
from ..results import Prediction, Smoothing
from ..supposed import noisy_inputs
from ..validation.fit import output_fit
from ..wording import listed

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Series = np.ndarray[tuple[int], np.dtype[np.float64]]

HEAD = 0.1  # of a recording
WINDOW = 0.05  # of a recording
WINDOWS = 10  # of a recording
LEAST_ROWS = 20  # of a head, or half of a piece that has less than twice as many
AFTER = "after"  # column that marks the rows which did not tell the start
REMEMBERED = 0.1  # of an output's first displacement, half a recording later: a model that keeps more does not forget


def predict(problem: Problem, result: Smoothing, smooth: Callable[[Problem], Smoothing]) -> tuple[dict[str, Prediction], tuple[str, ...]]:
    """Predictions of the held-out recordings with the parameters and weights of `result`, and notes on them.

    smooth: smooths the heads, with all parameters and weights fixed. A recording that cannot be predicted has a note and no prediction.
    """
    found, notes = {}, []
    for recording in problem.recordings:
        if recording.role != "held_out":
            continue
        try:
            prediction, (piece, run), lost, rough = _prediction(problem, result, recording, smooth)
            found[recording.name] = prediction
            if lost:
                notes.append(f"Held out: of {recording.name} the start of {lost} was not found; what follows it is not predicted.")
            if rough:
                notes.append(f"Held out: of {recording.name} the start of {rough} is where the solver stopped, short of its tolerance.")
            kept = remembering(problem.dae, result, piece, run)
            notes.append(_sentence(result, recording, prediction, kept, _own_ones(problem, result, prediction)))
        except (ModelError, SolveError) as error:
            notes.append(f"Held out: {recording.name} could not be predicted: {error}.")
    return found, tuple(notes)


@dataclass(frozen=True, kw_only=True)
class _Head:
    """Rows before and with row `last` of a piece, which tell the state there. rows: what is predicted from it; window: or is it all?"""

    piece: Recording
    first: int
    last: int
    rows: slice
    window: bool

    @property
    def name(self) -> str:
        return f"{self.piece.part}:{self.last}:{int(self.window)}"

    @property
    def told(self) -> slice:
        """The rows that tell the state."""
        return slice(self.first, self.last + 1)

    @property
    def outputs(self) -> dict[str, Series]:
        """The outputs that have a value in them, in all rows of the piece."""
        return {name: y for name, y in self.piece.outputs.items() if np.isfinite(y[self.told]).any()}


def _heads(recording: Recording) -> list[_Head]:
    """One for every piece that has rows after it, and one for every window: WINDOWS in all, by the pieces' lengths."""
    found, window = [], round(WINDOW * len(recording.time))
    for piece in recording.pieces:
        n = len(piece.time)
        head = min(n // 2, max(LEAST_ROWS, round(HEAD * n)))
        if head < 2:
            continue
        found.append(_Head(piece=piece, first=0, last=head - 1, rows=slice(0, n), window=False))
        last = n - 1 - window  # row from which the last window runs
        if window > 1 and last > head:
            count = max(1, round(WINDOWS * n / len(recording.time)))
            for k in sorted({int(k) for k in np.linspace(head - 1, last, count)}):
                found.append(_Head(piece=piece, first=k - head + 1, last=k, rows=slice(k, k + window + 1), window=True))
    seen = [head for head in found if head.outputs]
    if not found:
        raise ModelError("no piece of it has four rows, two to tell its start and two to be predicted")
    if all(head.window for head in seen):
        time = found[0].piece.time[found[0].told]
        raise ModelError(f"no output has a value in {time[0]:.9g} .. {time[-1]:.9g} s")
    return seen


def _prediction(
    problem: Problem, result: Smoothing, recording: Recording, smooth: Callable[[Problem], Smoothing]
) -> tuple[Prediction, tuple[Recording, Trajectory], str, str]:
    """The prediction, that of its longest piece, and in words of what no start was found, and of what it did not come to rest."""
    every = _heads(recording)
    states, own, rough = _states(problem, result, recording, every, smooth)
    heads = [head for head in every if head.name in states]
    whole, runs, errors = [], list[tuple[_Head, Trajectory]](), {name: [np.empty(0)] for name in recording.outputs}
    for head in heads:
        rows = head.piece.time[head.rows]
        start = {q.name: float(states[head.name][q.name].iloc[-1 if head.window else 0]) for q in problem.dae.states}
        run = _simulated(problem, result, head.piece, head.rows, start, own[head.name])
        if head.window:
            for name, y in head.piece.outputs.items():
                errors[name].append((y[head.rows] - run.outputs[name])[1:])
            continue
        columns: dict[str, Array] = {"t_s": rows} | {q.name: run.outputs[q.name] for q in problem.dae.outputs}
        columns |= {q.name: run.states[q.name] for q in problem.dae.states if q.name not in columns}
        whole.append(pd.DataFrame(columns).assign(**{AFTER: np.arange(len(rows)) > head.last}))
        runs.append((head, run))
    table = pd.concat(whole).set_index("t_s").reindex(recording.time).reset_index(names="t_s")
    after = table.pop(AFTER).eq(True).to_numpy()
    fit = {name: output_fit(np.where(after, y, np.nan), table[name].to_numpy()) for name, y in recording.outputs.items()}
    for name in recording.outputs:
        table.insert(list(table.columns).index(name) + 1, f"{name}.measured", recording.outputs[name])
    ahead = {name: np.concatenate(parts) for name, parts in errors.items()}
    (longest, run), window = max(runs, key=lambda pair: len(pair[1].t)), round(WINDOW * len(recording.time))
    prediction = Prediction(
        estimates=table,
        fit=fit,
        start_s=float(longest.piece.time[longest.last] - longest.piece.time[0]),
        window_s=window * recording.sampling if any(head.window for head in heads) else None,
        window_rms={name: float(np.sqrt(np.nanmean(e**2))) for name, e in ahead.items() if np.isfinite(e).any()},
        own=own[longest.name],
    )
    lost = _counted(head for head in every if head.name not in states)
    return prediction, (longest.piece, run), lost, _counted(head for head in every if head.name in rough)


def _counted(heads: Iterable[_Head]) -> str:
    """2 windows and 1 piece."""
    count = Counter("window" if head.window else "piece" for head in heads)
    return " and ".join(f"{n} {what}{'s' * (n > 1)}" for what in ("window", "piece") if (n := count[what]))


def _states(
    problem: Problem, result: Smoothing, recording: Recording, heads: Sequence[_Head], smooth: Callable[[Problem], Smoothing]
) -> tuple[dict[str, pd.DataFrame], dict[str, dict[str, float]], set[str]]:
    """The smoothed rows of every head, all in one problem; the parameters that vary as each head tells them, at its end; and rough ones.

    Where that does not converge each is smoothed by itself. One that stopped at the limit of iterations is taken as it is: its errors say
    what a prediction is worth. Those that came nowhere are left out. Only where the recording itself starts is anything known beforehand.
    """
    pieces = []
    for head in heads:
        part = 0 if head.piece.part == 0 and head.first == 0 else 1
        pieces.append(
            replace(
                head.piece,
                name=head.name,
                time=head.piece.time[head.told],
                inputs={name: u[head.told] for name, u in head.piece.inputs.items()},
                outputs={name: y[head.told] for name, y in head.outputs.items()},
                output_std={name: noise(problem, result, recording, name) for name in head.outputs},
                role="fit",
                gap=np.inf,
                part=part,
            )
        )
    fixed = as_found(problem, result, pieces, problem.initial)
    together = _found(smooth, fixed)
    if together is not None and together.solver.converged:
        smoothed = dict.fromkeys((piece.name for piece in pieces), together)
    else:
        alone = {piece.name: _found(smooth, replace(fixed, recordings=[piece])) if len(pieces) > 1 else together for piece in pieces}
        smoothed = {name: found for name, found in alone.items() if found is not None and _usable(found, name)}
        if not any(head.name in smoothed for head in heads if not head.window):
            status = "it cannot be smoothed" if together is None else together.solver.status.rstrip(".")
            raise SolveError(f"its start was not found: {status}")
    tables = {name: found.estimates[name] for name, found in smoothed.items()}
    own = {
        k: {
            name: float(table[name].iloc[-1]) if free.drift is not None else smoothed[k].parameters[case_name(name, k)].value
            for name, free in problem.varying.items()
        }
        for k, table in tables.items()
    }
    return tables, own, {name for name, found in smoothed.items() if not found.solver.converged}


def _found(smooth: Callable[[Problem], Smoothing], problem: Problem) -> Smoothing | None:
    """Heads smoothed; None where that cannot be. Raises OutOfTime: others would take as long."""
    try:
        return smooth(problem)
    except OutOfTime:
        raise
    except (ModelError, SolveError, InputError):
        return None


def _usable(found: Smoothing, name: str) -> bool:
    """Whether there is a start: come to rest, or stopped at the limit of iterations with numbers."""
    solution = found.solution
    stopped = solution is not None and solution.solved.status is Status.ITERATIONS and bool(np.isfinite(solution.solved.cost))
    return name in found.estimates and (found.solver.converged or stopped)


def noise(problem: Problem, result: Smoothing, recording: Recording, output: str) -> float | None:
    """Its deviation in a recording: as the problem gives it, else as the fitted recordings told it; None where none has that output."""
    given = problem.weights.noise(output, recording)
    return given if given is not None else result.weights.V.get(output)


def as_found(problem: Problem, result: Smoothing, recordings: Sequence[Recording], initial: Mapping[str, float | Known]) -> Problem:
    """The model with the parameters, W and V of a fit, on other recordings; what varies is one more of the values that were found."""
    varying = of_one_more(problem, result)
    parameters: dict[str, Free | float] = {p.name: varying.get(p.name, result.value(p.name)) for p in problem.dae.parameters}
    return Problem(
        model=problem.dae,
        recordings=recordings,
        parameters=parameters,
        weights=replace(result.weights, V=noisy_inputs(problem)),
        initial=initial,
        bounds=problem.bounds,
    )


def of_one_more(problem: Problem, result: Smoothing) -> dict[str, Free]:
    """What may be supposed elsewhere of a parameter that varies: one more of the values that were found, in time or of a recording."""
    found = {}
    for name, free in problem.varying.items():
        if free.drift is not None:
            value = np.concatenate([table[name].to_numpy() for table in result.estimates.values()])
            std = np.concatenate([table[f"{name}.std"].to_numpy() for table in result.estimates.values()])
        else:
            own = [p for n, p in result.parameters.items() if n.startswith(f"{name} [")]
            value, std = np.array([p.value for p in own]), np.array([p.std if p.std is not None else np.nan for p in own])
        spread = float(np.sqrt(np.nanvar(value) + np.nanmean(std) ** 2)) if np.isfinite(std).any() else np.nan
        known = spread if len(result.estimates) > 1 or free.drift is not None else np.nan
        guess = float(np.clip(np.nanmean(value), free.min, free.max))
        found[name] = replace(free, guess=guess, std=known if np.isfinite(known) and known > 0 else free.std)
    return found


def _simulated(
    problem: Problem, result: Smoothing, recording: Recording, rows: slice, start: dict[str, float], own: Mapping[str, float]
) -> Trajectory:
    rounded = {p.name for p in problem.dae.parameters if p.smoothing and p.name not in problem.parameters}
    outputs = {name: y[rows] for name, y in recording.outputs.items() if np.isfinite(y[rows]).any()}
    inputs = {name: u[rows] for name, u in recording.inputs.items()}
    return run_under_inputs(
        problem.dae,
        replace(recording, time=recording.time[rows], inputs=inputs, outputs=outputs, gap=None),
        {p.name: own.get(p.name, result.value(p.name)) for p in problem.dae.parameters if p.name not in rounded},
        start,
    )


def _own_ones(problem: Problem, result: Smoothing, prediction: Prediction) -> str:
    """What the recording was predicted with where that is not what was fitted."""
    said, units = [], {p.name: p.unit for p in problem.dae.parameters}
    for name, free in of_one_more(problem, result).items():
        known = "" if free.std is None else f" (beforehand {free.guess:.3g} ± {free.std:.2g})"
        said.append(f"{name} = {prediction.own[name]:.3g} {units[name]}".rstrip() + known)
    return f", with {listed(said)} of its own, told there too" if said else ""


def _sentence(result: Smoothing, recording: Recording, prediction: Prediction, kept: list[str], own: str = "") -> str:
    said = []
    for name, fit in prediction.fit.items():
        unit = result.units[name]
        percent = f" (fit {fit.fit_percent:.2f} %)" if fit.fit_percent is not None else ""
        ahead = f", {prediction.window_rms[name]:.3g} {unit} over {prediction.window_s:.3g} s" if name in prediction.window_rms else ""
        said.append(f"{name} to {fit.rms:.3g} {unit} rms{percent}{ahead}")
    what = f": {'; '.join(said)}" if said else ""
    drift = (
        f" {listed(kept)}: the model does not forget its state there, so errors of the start and what acts unknown add up over the whole "
        "recording; short windows say more."
        if kept
        else ""
    )
    start = f"simulated under its inputs from the start that its first {prediction.start_s:.3g} s tell"
    return f"Held out: {recording.name}, {start}{own}{what}.{drift}"


def remembering(dae: Dae, result: Smoothing, recording: Recording, run: Trajectory) -> list[str]:
    """Measured outputs in which a displacement of the state is still felt after half the recording: |C e^(A T/2)| against |C|.

    Linearised in the middle of the simulated recording, every state in units of its own variation there.
    """
    k = len(run.t) // 2

    def there(quantities: Sequence[Quantity], values: Mapping[str, Array]) -> Array:
        return np.array([float(values[q.name][k]) for q in quantities]).reshape(len(quantities), 1)

    linear = linearise(
        dae,
        there(dae.states, run.derivatives),
        there(dae.states, run.states),
        there(dae.algebraics, run.algebraics),
        there(dae.inputs, recording.inputs),
        run.t[k : k + 1],
        np.array([result.value(p.name) for p in dae.parameters]),
        (),
    )
    A, C = linear.A[0], linear.C[0]
    # what grows is felt anyhow, and must not overflow
    span = min(float(run.t[-1] - run.t[0]) / 2, 10.0 / max(float(np.linalg.eigvals(A).real.max()), 1e-12))
    unit = np.array([float(np.std(run.states[q.name])) or 1.0 for q in dae.states])
    size, kept = (np.linalg.norm(M * unit, axis=1) for M in (C, C @ scipy.linalg.expm(A * span)))
    return [
        q.name for q, now, then in zip(dae.outputs, size, kept, strict=True) if q.name in recording.outputs and then > REMEMBERED * now > 0
    ]
