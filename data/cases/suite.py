"""The suite: all cases of all plants, numbered; one of them as a folder with a study and its recordings, and its truth beside."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..generators.bundle import packed
from ..generators.concealed.effects import Effect, family
from ..generators.concealed.rig import sensor_faults
from . import actuator, drillstring, five_bar, quadrotor, xy_table
from .case import Bench, Case, Drawn, Taken, conditions

__all__ = ["FLOOR", "Made", "benches", "make_case", "numbered", "suite", "write_case"]

FLOOR = 0.01  # of the rms force at a place: what is weaker does not matter
SPREAD, GUESS = 0.1, (0.15, 0.35)  # of the machines about the usual one, of the guesses about the machine
benches: tuple[Bench, ...] = (actuator.BENCH, xy_table.BENCH, drillstring.BENCH, quadrotor.BENCH, five_bar.BENCH)


@dataclass(frozen=True, kw_only=True)
class Made:
    """A case as it was written: its name, its folder and its truth as it stands in the file."""

    name: str
    folder: Path
    truth: Mapping[str, object]


def numbered() -> list[tuple[Bench, Case]]:
    """Every case with its plant; its number is its place in this list, from 1."""
    return [(bench, case) for bench in benches for case in bench.cases]


def make_case(number: int, folder: Path, truth: Path, seed: int = 1) -> Made:
    """Write case `number` into folder/cNNN and its truth to truth/cNNN.json, a folder of its own; the same seed writes the same bytes.

    Raises ValueError where the truth would lie in the case, or there is no such number.
    """
    entries = numbered()
    if not 1 <= number <= len(entries):
        raise ValueError(f"case {number}: there are cases 1 to {len(entries)}")
    return write_case(*entries[number - 1], f"c{number:03d}", folder, truth, [seed, number])


def write_case(bench: Bench, case: Case, name: str, folder: Path, truth: Path, seed: Sequence[int]) -> Made:
    """Write any case of a plant into folder/name and its truth to truth/name.json.

    Cases of the same plant and seed are of one machine, guessed alike, whatever is concealed in it. ValueError as above.
    """
    target = folder / name
    if truth.resolve() == folder.resolve() or folder.resolve() in truth.resolve().parents:
        raise ValueError(f"truth {truth}: it lies among the cases in {folder}; name another folder")
    rng = np.random.default_rng([*seed, 0])
    values, size = _machine(bench, case, rng), float(rng.uniform(0.9, 1.1))
    effects = case.effects(Drawn(values=values, size=size))
    true = {**values, **{name: value for e in effects for name, value in e.values.items()}}
    plain = {name: 0.0 if any(name in e.absent for e in effects) else value for name, value in values.items()}
    taken = [bench.take(true, plain, effects, case, motion, [*seed, 1 + i]) for i, motion in enumerate(case.motions)]
    guesses, lines = _parameters(bench, values, effects, rng)
    target.mkdir(parents=True, exist_ok=True)
    truth.mkdir(parents=True, exist_ok=True)
    for i, recording in enumerate(taken):
        (target / f"rec{i + 1}.csv.gz").write_bytes(_table(recording, _errors(bench, case)))
    (target / "study.toml").write_text(_study(bench, case, lines), encoding="utf-8")
    told = _truth(name, bench, case, effects, true, guesses, taken)
    (truth / f"{name}.json").write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    return Made(name=name, folder=target, truth=told)


def suite(folder: Path, truth: Path, seed: int = 1) -> list[Made]:
    """All cases."""
    return [make_case(number + 1, folder, truth, seed) for number in range(len(numbered()))]


def _machine(bench: Bench, case: Case, rng: np.random.Generator) -> dict[str, float]:
    """True values of this case's machine: those that a study estimates are its own."""
    own = {name: value * rng.uniform(1 - SPREAD, 1 + SPREAD) for name, value in bench.base.items()} | dict(case.base)
    return {name: bench.known[name] if name in bench.known else float(f"{own[name]:.4g}") for name in bench.order}


def _parameters(
    bench: Bench, values: Mapping[str, float], effects: tuple[Effect, ...], rng: np.random.Generator
) -> tuple[dict[str, float], list[str]]:
    """Guesses, and the lines of the study."""
    fixed = dict.fromkeys((*bench.absent, *(name for e in effects for name in e.absent)), 0.0)
    fixed |= dict(bench.known) | {name: value for e in effects for name, value in e.fixed.items()}
    guesses, lines = {}, []
    for name in bench.order:
        off = 1 + rng.choice([-1.0, 1.0]) * rng.uniform(*GUESS)
        if name in fixed:
            lines.append(f'"{name}" = {float(f"{fixed[name]:.6g}")!r}')
        else:
            guess = guesses[name] = float(f"{values[name] * off:.6g}")
            lines.append(f'"{name}" = {{ guess = {guess!r}, min = {guess / 1000:.6g} }}')
    return guesses, lines


def _errors(bench: Bench, case: Case) -> dict[str, float]:
    """Output -> standard deviation of its error, noise and rounding together."""
    setting = conditions(case, bench.conditions, bench.force).conditions
    return {o: float(f"{np.hypot(std, setting.resolution.get(o, 0.0) / 12**0.5):.3g}") for o, std in setting.noise.items()}


def _study(bench: Bench, case: Case, lines: list[str]) -> str:
    inputs, errors = bench.inputs, _errors(bench, case)
    acting = ", ".join(f'{u} = "cmd_{u}"' for u in inputs)
    read = ", ".join(f'{y} = {{ column = "meas_{y}", std = {std:g} }}' for y, std in errors.items())
    text = [f'model = "{bench.plant}"', "", "[parameters]", *lines]
    for i in range(len(case.motions)):
        role = "held_out" if i + 1 == len(case.motions) else "fit"
        text += ["", "[[recording]]", f'file = "rec{i + 1}.csv.gz"', f'role = "{role}"', 'time = "t_s"']
        text += [f"inputs = {{ {acting} }}", f"outputs = {{ {read} }}"]
    return "\n".join(text) + "\n"


def _table(recording: Taken, errors: Mapping[str, float]) -> bytes:
    """A gzipped csv that carries neither a name nor a date; readings to a fiftieth of their error."""
    names = ["t_s", *(f"cmd_{u}" for u in recording.inputs), *(f"meas_{y}" for y in recording.outputs)]
    columns = [[f"{t:.10g}" for t in recording.time]]
    columns += [[f"{u + 0.0:.9g}" for u in column] for column in recording.inputs.values()]
    for y, column in recording.outputs.items():
        digits = int(np.ceil(-np.log10(errors[y] / 50)))
        columns.append([f"{round(float(x), digits) + 0.0:.9g}" for x in column])
    return packed([",".join(names), *(",".join(row) for row in zip(*columns, strict=True))], level=6)


def _truth(
    name: str,
    bench: Bench,
    case: Case,
    effects: tuple[Effect, ...],
    true: Mapping[str, float],
    guesses: Mapping[str, float],
    taken: list[Taken],
) -> dict[str, object]:
    share, shift = strength(bench, case, effects, taken[0])
    return {
        "id": name,
        "plant": bench.plant,
        "kind": case.kind,
        "verdict": case.verdict,
        "verdict_also": list(case.also),
        "effects": [_told(e) for e in effects],
        "strength": case.strength,
        "share_of_force": share,
        "output_shift_sigma": shift,
        "strength_ratio": share / FLOOR,
        "base_parameters_true": dict(true),
        "guesses": dict(guesses),
        "recordings": [
            {"excitation": motion, "role": "held_out" if i + 1 == len(case.motions) else "fit"} for i, motion in enumerate(case.motions)
        ],
        "two_effects": len(effects) > 1,
        "core": case.core,
    }


def _told(effect: Effect) -> dict[str, object]:
    return {
        "place": effect.place,
        "family": family(effect.physics),
        "physics": effect.physics,
        "parameters": {name: {"value": value, "unit": unit} for name, (value, unit) in effect.parameters.items()},
        "acceptable": [[effect.place, effect.physics], *([place, physics] for place, physics in effect.rivals)],
        "onset_s": effect.onset,
    }


def strength(bench: Bench, case: Case, effects: tuple[Effect, ...], taken: Taken) -> tuple[float, float]:
    """Of the first recording: the largest share of an effect, and the largest error of a sensor over its noise.

    Share of a force: at the effect's place, or wherever it shows most where that is no place of a force; of a sensor's error: its rms over
    that of the greatest motion that sensors of the same noise see. A wrong parameter has none, and what coloured forces there are in
    clean recordings does not count.
    """
    if case.strength not in ("strong", "weak"):
        return 0.0, 0.0
    share, sigmas, errors = 0.0, 0.0, _errors(bench, case)
    for output, fault in sensor_faults(effects).items():
        clean = taken.clean[output]
        shift = float(np.sqrt(((fault.read(output, taken.time, taken.clean) - clean) ** 2).mean()))
        alike = max(float(np.std(taken.clean[o])) for o in errors if errors[o] == errors[output])
        share, sigmas = max(share, shift / alike), max(sigmas, shift / errors[output])
    for effect in effects:
        if not effect.sensors:
            own = [s for place, s in taken.shares.items() if place == effect.place or place.startswith(f"{effect.place}.")]
            share = max([share, *(own if any(own) else taken.shares.values())])
    return share, sigmas
