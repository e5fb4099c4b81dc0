"""Stick and slip of a drillstring's bit, followed on-line from motor voltage and current alone; beside it the two classical schemes.

    .venv/bin/python tests/studies/stick_slip.py [--seeds 3] [--only "15 V"] [--noise 1e-4 2e-3]

The open problem of KSEPL (1992), section 6.1: recursive ARMAX did not follow the jumps, and of its multiple models both converged to slip
unless the current had 1e-4 A of noise (its R_e = 1e-8) and the coefficients were known before. Recordings of 50 s at 20 Hz come from
`data/generators/drillstring.py`, with the torque on the bit disturbed by 2e-3 N m sqrt(s) (under the speed loop also voltage and table, as
`CONDITIONS` has it), the bit stuck 0 to 60 % of the time, once without end.

    known       all parameters known
    priors      string.k, bha.J, bit.tau_sl, bit.tau_st guessed from N(truth, 15 %) with a prior of 15 %; motor and table known
    off, prior  friction levels guessed 20 % too low and a prior of 20 %, all else known
    off         the same levels, taken for granted: what a wrong law does

    phase       samples with the right phase, by what was known at each (mean of the seeds, and the worst), %
    lag 5       the same, asked five samples later, %
    date        median of how far from a true change the estimate changes, samples
    changes     told and true;    false stick: samples said to stick of those that slide, %

The classical schemes get what helps them. Multiple models: the interacting filter with the parameters of the case, not coefficients to be
estimated anew. Recursive ARMAX: the report's last resort, the difference equation of a stuck bit with its true coefficients, hardly to
be moved, and an offset that is: it sticks where the offset is small. Densities and limits are those that are best on the recording itself.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import cont2discrete, lfilter, ss2tf

from backsight.data.generators import drillstring as rig
from backsight.data.generators.references import levels
from backsight.data.generators.run import Conditions, disturbance
from backsight.estimation import Free, Orders, PhaseEstimator, Problem, Recording, Sample, Weights, multiple_models, recursive_armax
from backsight.models.plants import drillstring

Array = np.ndarray
STEP, ROWS, LAG, SUBSTEPS = 0.05, 1000, 5, 10
TORQUE = 2e-3  # N m sqrt(s)
UNSURE = {"string.k": 0.0868, "bha.J": 0.0529, "bit.tau_sl": 0.4, "bit.tau_st": 0.6}
LEVELS = ("bit.tau_sl", "bit.tau_st")


@dataclass(frozen=True)
class Drilled:
    """A recording and its truth: whether the bit sticks at every sample."""

    recording: Recording
    stuck: Array
    W: dict[str, float]


def driven(voltage: Array, noise: float, seed: int, skip: int = 0) -> Drilled:
    """From rest under a voltage that is held over every step; the first rows are left out."""
    rng, n, W = np.random.default_rng([seed, 1]), len(voltage), {"bha": TORQUE}
    time = STEP * np.arange(n)
    conditions = Conditions(duration=n * STEP, step=STEP, noise={"I_m": noise}, process=W)
    forces, states = disturbance(conditions, rig.PLACES, time, rng), np.zeros((n, 4))
    plant, y, s = rig.Rig(rig.Drillstring()), np.zeros(4), 0
    for k in range(n):
        states[k] = y
        for _ in range(SUBSTEPS):
            y, s = plant.advance(y, s, float(voltage[k]), forces[k], STEP / SUBSTEPS)
    current = states[:, 0] + noise * rng.normal(size=n)
    recorded = Recording(
        name="drill", time=time[: n - skip], inputs={"V": voltage[skip:]}, outputs={"I_m": current[skip:]}, output_std={"I_m": noise}
    )
    return Drilled(recorded, states[skip:, 3] == 0.0, W)


def wandering(seed: int, rows: int = ROWS) -> Array:
    """Low-pass filtered white noise of 0.84 V rms, as the report excites."""
    return lfilter([0.6], [1, -0.7], np.random.default_rng([seed, 2]).normal(size=rows))


def looped(noise: float, seed: int) -> Drilled:
    """Under the generator's speed loop."""
    rng = np.random.default_rng([seed, 3])
    time = STEP * np.arange(ROWS)
    conditions = replace(rig.CONDITIONS, duration=ROWS * STEP, step=STEP, noise={"I_m": noise, "Omega_r": 0.01})
    speed = levels(time, (0.5, 5.0), (4.0, 10.0), rng)
    run = rig.simulate(rig.Drillstring(), rig.SpeedLoop(), time, speed, conditions, rng, None)
    outputs = {"I_m": run.outputs["I_m"]}
    recorded = Recording(name="drill", time=time, inputs=run.inputs, outputs=outputs, output_std={"I_m": noise})
    return Drilled(recorded, run.truth["bha.omega"] == 0.0, dict(conditions.process))


REGIMES: dict[str, Callable[[float, int], Drilled]] = {
    "15 V": lambda noise, seed: driven(15 + wandering(seed), noise, seed),
    "50 V": lambda noise, seed: driven(50 + 3 * wandering(seed), noise, seed),
    "both ways": lambda noise, seed: driven(22.0 * (-1) ** (np.arange(ROWS) // 250) + wandering(seed), noise, seed),
    "speed loop": looped,
    "never sticks": lambda noise, seed: driven(110 + 8 * wandering(seed, ROWS + 400), noise, seed, skip=400),
}


def known(case: str, seed: int) -> dict[str, float | Free]:
    """Parameters of a case."""
    rng = np.random.default_rng([seed, 4])
    if case == "priors":
        off = 1 + 0.15 * np.clip(rng.normal(size=len(UNSURE)), -2, 2)
        return {name: Free(v * e, std=0.15 * v, min=0.2 * v) for (name, v), e in zip(UNSURE.items(), off, strict=True)}
    if case == "off, prior":
        return {name: Free(0.8 * UNSURE[name], std=0.2 * UNSURE[name], min=0.2 * UNSURE[name]) for name in LEVELS}
    return {name: 0.8 * UNSURE[name] for name in LEVELS} if case == "off" else {}


CASES = ("known", "priors", "off, prior", "off")


def online(problem: Problem) -> tuple[Array, Array, Array, PhaseEstimator]:
    """Whether the bit sticks at every sample, the same LAG samples later, and the milliseconds."""
    estimator, recording, law = PhaseEstimator(problem), problem.recordings[0], "bit"
    now, later, ms = [], [], []
    time = recording.time.tolist()
    for k, t in enumerate(time):
        estimate = estimator.update(Sample(time=t, inputs={"V": recording.inputs["V"][k]}, outputs={"I_m": recording.outputs["I_m"][k]}))
        now.append(estimate.phases[law].sticks)
        ms.append(1e3 * estimate.seconds)
        if k >= LAG:
            later.append(estimator.at(law, time[k - LAG]).sticks)
    return np.array(now), np.array(later + now[-LAG:]), np.array(ms), estimator


def interacting(problem: Problem, stuck: Array) -> Array:
    """The classical multiple models, from the samples up to each; W of the bit is the best of three, as the jumps themselves disturb it."""
    modes = {"slip": {"bha.omega": 3.0}, "back": {"bha.omega": -3.0}, "stick": {"bha.omega": 0.0}}
    fixed = {name: p.guess if isinstance(p, Free) else p for name, p in problem.parameters.items()}
    found = []
    for torque in (TORQUE, 0.03, 0.2):
        weights = Weights(W={"bha": torque, "motor": 1e-3, "rotary_table": 1e-3})
        table = multiple_models(replace(problem, parameters=fixed, weights=weights), modes=modes, dwell=2.0).estimates["drill"]
        found.append(table["stick"].to_numpy() > 0.5)
    return max(found, key=lambda told: float(np.mean(told == stuck)))


def recursive(recording: Recording, stuck: Array) -> Array:
    """The stuck bit's difference equation with an offset that moves, fast or slowly; the limit for it is the best there is."""
    s = rig.Drillstring()
    A, B = s.sticking[:3, :3], np.array([[1 / s.L], [0.0], [0.0]])
    F, G, C, D, _ = cont2discrete((A, B, np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 1))), STEP)
    b, a = ss2tf(F, G, C, D)
    start = {f"a_{k}": float(a[k]) for k in (1, 2, 3)} | {f"b_{k}": float(b[0, k]) for k in (1, 2, 3)}
    orders, noise = Orders(na=3, nb=3, offset=True), recording.output_std["I_m"]
    found = []
    for drift in (0.01, 0.1, 1.0):
        how = {"start": start, "start_std": 1e-6, "drift": {"d": drift * noise}, "noise_std": noise}
        course = recursive_armax(recording, output="I_m", orders=orders, **how)
        offset = np.abs(course.theta[:, course.names.index("d")])
        found += [offset <= limit for limit in np.quantile(offset, np.linspace(0, 1, 200))]
    return max(found, key=lambda told: float(np.mean(told == stuck)))


def dated(told: Array, stuck: Array) -> list[int]:
    """Samples between every true change and the nearest one told of the same kind."""
    true, found = (np.flatnonzero(np.diff(s.astype(int))) + 1 for s in (stuck, told))
    return [min((abs(int(q) - int(k)) for q in found if told[q] == stuck[k]), default=len(told)) for k in true]


def changes(told: Array) -> int:
    """How often it changes."""
    return int(np.sum(np.diff(told.astype(int)) != 0))


def line(label: str, told: list[Array], truth: list[Array], more: str = "") -> None:
    """A row of the table over the seeds."""
    right = [100 * np.mean(a == b) for a, b in zip(told, truth, strict=True)]
    dates = [d for a, b in zip(told, truth, strict=True) for d in dated(a, b)]
    false = 100 * np.sum([np.sum(a & ~b) for a, b in zip(told, truth, strict=True)]) / max(1, np.sum([np.sum(~b) for b in truth]))
    count = f"{sum(map(changes, told)):4d}/{sum(map(changes, truth)):<4d}"
    date = f"{np.median(dates):5.1f}" if dates else "    -"
    print(f"{label:46} {np.mean(right):6.1f} {min(right):6.1f}   {date}   {count} {false:7.1f}   {more}", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--only", choices=REGIMES)
    parser.add_argument("--noise", type=float, nargs="+", default=[1e-4, 2e-3], help="of the current [A]")
    given = parser.parse_args()
    print(f"{'':46}  phase  worst    date  told/true  false stick %")
    for regime in [given.only] if given.only else list(REGIMES):
        for noise in given.noise:
            drilled = [REGIMES[regime](noise, seed) for seed in range(given.seeds)]
            truth = [d.stuck for d in drilled]
            share = 100 * np.mean(np.concatenate(truth))
            print(f"{regime}, {1e3 * noise:g} mA, stuck {share:.0f} % of the time")
            for case in CASES:
                problems = [
                    Problem(model=drillstring(), recordings=[d.recording], parameters=known(case, seed), weights=Weights(W=d.W))
                    for seed, d in enumerate(drilled)
                ]
                runs = [online(p) for p in problems]
                lag = np.mean([100 * np.mean(r[1] == b) for r, b in zip(runs, truth, strict=True)])
                ms = np.concatenate([r[2] for r in runs])
                more = f"lag {LAG}: {lag:.1f} %   {np.median(ms):.1f} ms, p99 {np.quantile(ms, 0.99):.0f} ms"
                line(f"  {case}: phases", [r[0] for r in runs], truth, more)
                if case != "off":  # they take the parameters for granted in any case
                    line(f"  {case}: multiple models", [interacting(p, b) for p, b in zip(problems, truth, strict=True)], truth)
            line("  recursive ARMAX with an offset, best limit", [recursive(d.recording, d.stuck) for d in drilled], truth)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
