"""Consistency of the moving horizon on simulated machines: `python tests/studies/tracking.py [--plants a,b] [--seeds 20]`.

Recordings are simulated in closed loop by `backsight.data.generators`, which shares no code with the estimator; W and V are those of the
simulation. Every free parameter starts at a guess drawn about the truth with a deviation of 10 %, which is its stated prior. Of each plant:

  plain       the normalised estimation error squared of the states and of the parameters, (x - truth)' C^-1 (x - truth) / n with the n of
              them of which C is finite, every tenth row from a quarter of the recording on (Y. Bar-Shalom, X. R. Li & T. Kirubarajan,
              Estimation with Applications to Tracking and Navigation, 2001, 5.4); 1 where the stated covariance is the true one
  defective   the same with a tenth of the readings missing and one in a hundred off by 10 to 100 deviations
  jump        one parameter, which may drift, changes by 30 % half way; the rest is known

The band is that of 95 % for the mean over the seeds at one instant; the mean over time of samples that depend on each other scatters
less, by what nobody knows beforehand, so the standard error from seed to seed stands beside it. `--out FILE.json` keeps finished runs.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from scipy.stats import chi2

from backsight.data.generators import actuator, drillstring, five_bar, quadrotor, xy_table
from backsight.data.generators.run import Run
from backsight.estimation import Free, Known, Problem, Recording, Weights
from backsight.estimation.tracking import Estimator, Outcome, Sample
from backsight.models import compile_model
from backsight.models.plants import PLANTS

PRIOR, JUMP, MISSING, GROSS = 0.1, 0.3, 0.1, 0.01
EVERY = 10  # rows from one look at the error to the next
SEEN = 0.25  # of the recording: from where on


@dataclass(frozen=True, kw_only=True)
class Case:
    """How a plant is recorded and what is estimated on it.

    values: of its parameters, other than the plant's own. free: those that are estimated. duration [s]. exact: W of places that nothing
    disturbs, a small one. start: what is known of the states, std. cut [s] of the beginning left out. jumping: the parameter that jumps;
    pushed: the force (places,) of velocities v that stands for its jump by 1, None: the generator has a machine that changes.
    """

    generator: ModuleType
    free: tuple[str, ...]
    duration: float
    jumping: str
    pushed: Callable[[np.ndarray], np.ndarray] | None
    values: Mapping[str, float] = field(default_factory=dict)
    exact: float = 1e-6
    start: Mapping[str, float] = field(default_factory=dict)
    cut: float = 0.0


CASES = {
    "actuator": Case(
        generator=actuator,
        free=("carriage.m", "friction.d", "friction.f_c", "offset.f"),
        duration=1.5,
        jumping="friction.d",
        pushed=lambda v: -v,
    ),
    "five_bar": Case(generator=five_bar, free=tuple(f"P_{i}" for i in range(1, 7)), duration=1.5, jumping="P_6", pushed=None),
    "xy_table": Case(
        generator=xy_table,
        free=("spindle.k", "drive_1.J", "drive_3.J", "friction_1.tau_c", "friction_3.tau_c"),
        duration=0.8,
        jumping="friction_3.d",
        pushed=lambda v: np.array([0.0, 0.0, -v[2]]),
        values={"friction_3.d": 0.02},
    ),
    # a bit that slides all the time, once it does: sticking is for simulations and for `smooth`
    "drillstring": Case(
        generator=drillstring,
        free=("string.k", "bha.J", "bha.d", "bit.tau_sl"),
        duration=16.0,
        jumping="bit.tau_sl",
        pushed=lambda _: np.array([0.0, 0.0, -1.0]),
        values={"bit.tau_sl": 0.1, "bit.tau_st": 0.1, "bha.d": 0.02},
        cut=4.0,
    ),
    "quadrotor": Case(
        generator=quadrotor,
        free=(*(f"body.{n}" for n in ("Ixx", "Iyy", "Izz", "drag_w", "drag_p", "drag_q", "drag_r")), "rotor.tau", "rotor.gain"),
        duration=4.0,
        jumping="body.drag_p",
        pushed=lambda v: np.array([0.0, 0.0, 0.0, -0.015 * v[3], 0.0, 0.0]),
        values={"body.drag_p": 5.0},
        exact=1e-4,
        start={**{f"body.{n}": 0.1 for n in ("u", "v", "w", "phi", "theta")}},
    ),
}


class Changing:
    """A five bar arm with other parameters from a time on, told the time by the force that the simulator asks for in every stage."""

    def __init__(self, before: Any, after: Any, when: float) -> None:
        self.before, self.after, self.when, self.now = before, after, when, 0.0

    def equations(self, q: np.ndarray, v: np.ndarray) -> Any:
        """Of the one that is in force; the last stage of a step is at its end, before the change."""
        return (self.after if self.now >= self.when else self.before).equations(q, v)

    def force(self, t: float, *_: np.ndarray) -> np.ndarray:
        """None, and the time."""
        self.now = t + 1e-9
        return np.zeros(2)


def recorded(plant: str, seed: int, jump: float | None) -> Run:
    """A recording; jump [s]: when the parameter changes."""
    case = CASES[plant]
    conditions = replace(case.generator.CONDITIONS, duration=case.duration)
    machine, options = case.generator.with_values(case.values), dict[str, Any]()
    if jump is not None:
        size = JUMP * true_values(plant)[case.jumping]
        if case.pushed is None:
            after = case.generator.with_values({**case.values, case.jumping: true_values(plant)[case.jumping] + size})
            machine = Changing(machine, after, jump)
            options["force"] = machine.force
        else:
            pushed = case.pushed
            options["force"] = lambda t, _, v: size * pushed(v) if t >= jump - 1e-9 else 0.0 * pushed(v)
    run = case.generator.record(machine, seed=seed, conditions=conditions, **options)
    kept = run.time >= case.cut
    return replace(
        run,
        time=run.time[kept],
        **{what: {n: a[kept] for n, a in getattr(run, what).items()} for what in ("inputs", "outputs", "truth")},
    )


def true_values(plant: str) -> dict[str, float]:
    """Parameters of the machine that is simulated."""
    return {p.name: p.value for p in compile_model(PLANTS[plant]()).parameters} | dict(CASES[plant].values)


def pose(plant: str, seed: int, what: str) -> tuple[Problem, dict[str, np.ndarray]]:
    """The problem of a seed, and the truth (rows,) of states and parameters."""
    case, dae, values = CASES[plant], compile_model(PLANTS[plant]()), true_values(plant)
    info = {p.name: p for p in dae.parameters}
    rng = np.random.default_rng([seed, *plant.encode()])
    when = case.cut + (case.duration - case.cut) / 2 if what == "jump" else None
    run = recorded(plant, seed, when)
    outputs = {name: y.copy() for name, y in run.outputs.items()}
    if what == "defective":
        for name, y in outputs.items():
            gross = rng.uniform(size=y.size) < GROSS
            y[gross] += run.noise[name] * rng.choice([-1.0, 1.0], gross.sum()) * rng.uniform(10.0, 100.0, gross.sum())
            y[rng.uniform(size=y.size) < MISSING] = math.nan
    truth, parameters = dict(run.truth), dict[str, Any](case.values)
    for name in case.free if what != "jump" else ():
        guess = values[name] * (1 + PRIOR * np.clip(rng.standard_normal(), -2.5, 2.5))
        parameters[name] = Free(guess, std=PRIOR * abs(values[name]), min=info[name].minimum, max=info[name].maximum)
        truth[name] = np.full(run.time.size, values[name])
    if what == "jump" and when is not None:
        true = values[case.jumping]
        # a walk that comes as far as the jump in a quarter of the recording
        drift = JUMP * abs(true) / math.sqrt((case.duration - case.cut) / 4)
        parameters[case.jumping] = Free(true, std=PRIOR * abs(true), drift=drift)
        truth[case.jumping] = true * (1 + JUMP * (run.time >= when - 1e-9))
    places = {dae.places[e.place].name for e in dae.equations if e.place is not None}
    process = case.generator.CONDITIONS.process
    recording = Recording(name=f"{plant} {seed}", time=run.time, inputs=run.inputs, outputs=outputs, output_std=run.noise)
    problem = Problem(
        model=dae,
        recordings=[recording],
        parameters=parameters,
        initial={name: Known(float(run.truth[name][0]), std) for name, std in case.start.items()},
        weights=Weights(W={name: process.get(name, case.exact) for name in places}),
    )
    return problem, truth


def normalised(estimator: Estimator, truth: Mapping[str, np.ndarray], row: int, parameters: bool) -> tuple[float, int]:
    """The normalised error squared of states or parameters at a row, and how many they are."""
    posed = estimator.problem
    names = [*(q.name for q in posed.dae.states), *(posed.dae.parameters[i].name for i in posed.free)]
    here, C = estimator.window.here, estimator.window.covariance()
    value = np.concatenate([here.x[:, -1], here.p])
    free = {*estimator.tuning.asked.varying, *names[len(here.x) :]}
    chosen = [i for i, n in enumerate(names) if (n in free) == parameters and n in truth and np.isfinite(C[i, i])]
    if not chosen:
        return math.nan, 0
    e = np.array([value[i] - truth[names[i]][row] for i in chosen])
    size = np.sqrt(np.diag(C)[chosen])
    return float((e / size) @ np.linalg.solve(C[np.ix_(chosen, chosen)] / np.outer(size, size), e / size)), len(chosen)


def follow(plant: str, seed: int, what: str, samples: int, rows: int | None = None) -> dict[str, Any]:
    """The outcome of a run, as it is kept; rows: of it, all if not given."""
    problem, truth = pose(plant, seed, what)
    estimator, recording, began = Estimator(problem, samples=samples), problem.recordings[0], time.perf_counter()
    kept: dict[str, list[list[float]]] = {"states": [], "parameters": [], "jumping": []}
    jumping, rows = CASES[plant].jumping, rows or len(recording.time)
    for k, t in enumerate(recording.time[:rows].tolist()):
        inputs = {n: float(u[k]) for n, u in recording.inputs.items()}
        estimate = estimator.update(Sample(time=t, inputs=inputs, outputs={n: float(y[k]) for n, y in recording.outputs.items()}))
        if k % EVERY == 0 and k >= SEEN * rows:
            for key in ("states", "parameters"):
                kept[key].append([*normalised(estimator, truth, k, key == "parameters")])
        if what == "jump":
            kept["jumping"].append([t, (estimate[jumping] / truth[jumping][k] - 1), estimate.std(jumping) / truth[jumping][k]])
    counts = {outcome.word: n for outcome, n in estimator.counts.items()}
    seconds = time.perf_counter() - began
    return {**kept, "counts": counts, "rows": rows, "steps": estimator.steps / rows, "milliseconds": 1e3 * seconds / rows}


def line(plant: str, what: str, runs: list[dict[str, Any]]) -> str:
    """A row of the table."""
    parts = [f"{plant:12s}{what:10s}{len(runs):3d} x {runs[0]['rows']:5d}"]
    for key in ("states", "parameters"):
        error = np.array([np.nanmean([e / n for e, n in run[key] if n]) for run in runs])
        n = round(float(np.mean([n for run in runs for _, n in run[key]])))
        low, high = (chi2.ppf(q, n * len(runs)) / (n * len(runs)) for q in (0.025, 0.975))
        scatter = error.std(ddof=1) / math.sqrt(len(runs)) if len(runs) > 1 else math.nan
        parts.append(f"{n:3d}: {error.mean():5.2f} ± {scatter:4.2f} ({low:4.2f}..{high:4.2f}){' ' if low <= error.mean() <= high else '*'}")
    count = {o.word: sum(run["counts"].get(o.word, 0) for run in runs) for o in Outcome}
    parts.append(f"{count['failed']:5d} failed {count['doubted']:5d} doubted {np.mean([run['steps'] for run in runs]):5.2f} steps")
    if what == "jump":
        parts.append(jumped(plant, runs))
    return "  ".join(parts)


def jumped(plant: str, runs: list[dict[str, Any]]) -> str:
    """How the parameter that changed was followed."""
    case = CASES[plant]
    when, late, last = case.cut + (case.duration - case.cut) / 2, [], []
    for run in runs:
        t, error, std = np.array(run["jumping"]).T
        after = t >= when
        outside = np.flatnonzero(np.abs(error[after]) > 3 * std[after])
        late.append(t[after][outside[outside < after.sum() // 2].max(initial=0)] - when)
        last.append((error / std)[t >= t[-1] - (t[-1] - when) / 2])
    z = np.array(last)
    return (
        f"\n{'':24s}{case.jumping} within 3 std after {np.median(late):.2f} s (longest {max(late):.2f}); "
        f"in the last quarter z has rms {np.sqrt((z**2).mean()):.2f}, {100 * (np.abs(z) < 2).mean():.0f} % within 2, "
        f"error {100 * np.median([abs(run['jumping'][-1][1]) for run in runs]):.1f} % at the end"
    )


def main() -> None:
    """The table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", default=",".join(CASES))
    parser.add_argument("--what", default="plain,defective,jump")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--samples", type=int, default=50)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    done = json.loads(given.out.read_text()) if given.out and given.out.exists() else {}
    for plant in given.plants.split(","):
        for what in given.what.split(","):
            for seed in range(given.seeds):
                key = f"{plant} {what} {given.samples} {seed}"
                done[key] = done.get(key) or follow(plant, seed, what, given.samples)
                if given.out:
                    given.out.write_text(json.dumps(done))
            print(line(plant, what, [done[f"{plant} {what} {given.samples} {seed}"] for seed in range(given.seeds)]), flush=True)


if __name__ == "__main__":
    main()
