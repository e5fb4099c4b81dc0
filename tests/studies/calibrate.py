"""False alarms on clean recordings, and power against strength, of `diagnose` on every plant.

    python tests/studies/calibrate.py --out calibrate_out [--seed 1] [--seeds 2] [--plants actuator,five_bar] [--kinds clean,wrong,coulomb]
                                      [--jobs 2] [--limit 1200]

clean    recordings of machines that are as their models say: quantised, coloured forces below the floor, clocks that jitter, ...
wrong    every parameter that a study may estimate in turn, given 15 % too large or too small
others   for every effect of the suite that has a strength of which the answer for the machine without it says how large it had to be: as
         much of it is concealed, and three and ten times as much. Couplings have none

Machines are simulated by what shares no equations with the estimator (`backsight.data.cases`). Results stay in --out, and a rerun goes on
with those that are not there. Rates come with their Clopper-Pearson limits (95 %, one-sided).
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from blind import judge, limits, run

from backsight.data.cases.case import Bench, Case, Drawn, wrong
from backsight.data.cases.suite import benches, write_case
from backsight.data.generators.concealed.effects import Effect
from backsight.models import compile_model
from backsight.models.analysis.isolability import isolability
from backsight.models.plants import PLANTS

WORDS = {"bias": "offset"}  # of an input, where the suite has another one
LEVELS = (1, 3, 10)  # times the least strength that would have been shown
LARGEST = 20.0  # times the size that an effect has in the suite: more is no machine
OFF = 0.15  # of a parameter that is given, too large or too small


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A group of cases that are made one after another: what is concealed of one plant's machine, and a seed for it."""

    bench: Bench
    case: Case
    seed: tuple[int, int]

    @property
    def name(self) -> str:
        return f"{self.bench.plant}.{self.case.kind.replace(':', '-')}.{self.seed[0]}"


@dataclass(frozen=True)
class Shop:
    """Where cases are made, and their results kept."""

    out: Path
    limit: float

    def row(self, kind: Kind, case: Case, level: str) -> dict[str, Any]:
        """What was right of one case's answer; it is made and diagnosed where that has not been done."""
        name = f"{kind.name}.{level}"
        cases, truths, results = (self.out / folder for folder in ("cases", "truth", "results"))
        results.mkdir(parents=True, exist_ok=True)
        kept, told = results / f"{name}.json", truths / f"{name}.json"
        if not kept.exists():
            if not told.exists():
                write_case(kind.bench, case, name, cases, truths, kind.seed)
            run(cases / name, kept, self.limit)
            sys.stderr.write(f"{name}\n")
        truth, answer = (json.loads(path.read_text(encoding="utf-8")) for path in (told, kept))
        more = {"name": name, "level": level, "answer": answer["answer"], "apart": separable(truth), "shown": True}
        return judge(truth, answer) | more | {"truth_values": truth["base_parameters_true"]}

    def rows(self, kind: Kind) -> list[dict[str, Any]]:
        """All cases of a group: a clean one, or the machine with nothing concealed, and what is concealed as far as that would show it."""
        if kind.case.strength == "none":
            return [self.row(kind, kind.case, "none")]
        silent = replace(kind.case, effects=lambda d: tuple(e.silent for e in kind.case.effects(d)), strength="none")
        first = self.row(kind, replace(silent, verdict="none", also=()), "none")
        table = first["answer"].get("not_detectable") or []
        if kind.case.strength == "parameter":
            row = self.row(kind, kind.case, "parameter")
            return [first, row | {"shown": shown(kind.case.kind.partition(":")[2], first["truth_values"], table)}]
        size = unit_size(kind, table)
        levels = [(f"{m}x", size * m) for m in LEVELS if size * m < LARGEST]
        if len(levels) < len(LEVELS):
            sys.stderr.write(f"{kind.name}: no strength, or none that a machine can have, for {len(LEVELS) - len(levels)} levels\n")
        return [first, *(self.row(kind, sized(kind.case, s), name) for name, s in levels)]


def sized(case: Case, size: float) -> Case:
    """The case with its effects at a size."""
    return replace(case, effects=lambda d: case.effects(replace(d, size=size)), strength="strong")


def at_sizes(bench: Bench, case: Case) -> tuple[tuple[Effect, ...], ...]:
    """The effects of a case in the usual machine at size 1, and at next to none."""
    values = {**bench.base, **bench.known, **case.base}
    return tuple(case.effects(Drawn(values=values, size=size)) for size in (1.0, 1e-9))


def unit_size(kind: Kind, table: list[dict[str, Any]]) -> float:
    """The size at which the effect has the least strength that would have been shown; NaN where the table does not have it."""
    (effect,), (nothing,) = at_sizes(kind.bench, kind.case)
    for row in table:
        if [row["place"], row["physics"]] not in ([effect.place, effect.physics], *map(list, effect.rivals)):
            continue
        word = WORDS.get(row["parameter"], row["parameter"])
        if row["physics"] == effect.physics and word in effect.parameters and row["minimum_strength"] is not None:
            there = abs(effect.parameters[word][0] - nothing.parameters[word][0])
            return float(row["minimum_strength"]) / there
    return float("nan")


def shown(name: str, values: Mapping[str, float], table: list[dict[str, Any]]) -> bool:
    """Whether recordings would show a wrong parameter of a machine with these values, by what was said of it when nothing was wrong.

    It was free then: of what cannot be estimated at all nothing is said.
    """
    least = [row["minimum_strength"] for row in table if row["physics"] == "wrong_parameter" and row["parameter"] == name]
    return all(size is not None and OFF * abs(values[name]) > size for size in least)


def separable(truth: dict[str, Any]) -> bool:
    """Whether the equations let outputs tell the places of what is concealed from all others."""
    classes = _isolability(truth["plant"])
    return all(effect["place"] not in classes.faults or not classes.alike(effect["place"]) for effect in truth["effects"])


@cache
def _isolability(plant: str) -> Any:
    dae = compile_model(PLANTS[plant]())
    return isolability(dae, [y.name for y in dae.outputs])


def kinds(plants: list[str], wanted: list[str], seeds: range) -> Iterator[Kind]:
    """The groups, plant by plant within every seed."""
    for seed in seeds:
        for bench in benches:
            if plants and bench.plant not in plants:
                continue
            for number, case in enumerate(_cases(bench, seed), start=1000 * (1 + benches.index(bench))):
                if not wanted or case.kind in wanted or case.kind.partition(":")[0] in wanted:
                    yield Kind(bench=bench, case=case, seed=(seed, number))


def _cases(bench: Bench, seed: int) -> list[Case]:
    """Clean ones, wrong parameters, and the effects that have a strength, each kind once."""
    clean = [case for case in bench.cases if case.strength == "none"]
    given = {case.kind: case for case in bench.cases if case.strength == "parameter"}
    names = [name for name in bench.order if name not in bench.known and name not in bench.absent]
    plain = Case(kind="", strength="parameter", verdict="parameter", motions=("multisine", "trapezoids"))
    off = [
        replace(given.get(f"wrong:{n}", plain), kind=f"wrong:{n}", effects=wrong(n, 1 + OFF * (-1) ** (seed + i)))
        for i, n in enumerate(names)
    ]
    effects = {case.kind: case for case in reversed(bench.cases) if case.strength in ("strong", "weak") and _has_strength(bench, case)}
    return [*clean, *off, *reversed(effects.values())]


def _has_strength(bench: Bench, case: Case) -> bool:
    """Whether it is one effect, from the start, of a strength that is nothing where its size is."""
    here, none = at_sizes(bench, case)
    if len(here) != 1 or case.kind.startswith(("onset", "unknown")):
        return False
    parts = zip(here[0].parameters.values(), none[0].parameters.values(), strict=True)
    return any(abs(a - b) > 0 and abs(b) < 1e3 * max(abs(a), 1.0) for (a, _), (b, _) in parts)


def table(rows: list[dict[str, Any]]) -> str:
    """Rates, plant by plant and together."""
    levels = " | ".join(f"{m} x: found; of these apart, place first; in the set" for m in LEVELS)
    lines = [f"| | alarms, clean | {levels} | 15 % wrong, told | sensor at 10 x, told | seconds |"]
    lines.append("|---" * (len(LEVELS) + 5) + "|")
    for plant in [*dict.fromkeys(r["plant"] for r in rows), "all"]:
        own = [r for r in rows if plant in (r["plant"], "all")]
        clean, off = ([r for r in own if r["level"] == level and r["shown"]] for level in ("none", "parameter"))
        cells = [plant, limits(sum(r["alarm"] for r in clean), len(clean))]
        for m in LEVELS:
            there = [r for r in own if r["level"] == f"{m}x"]
            found = [r for r in there if r["alarm"]]
            apart = [r for r in found if r["apart"]]
            counts = (sum(r["alarm"] for r in there), len(there)), (sum(r["place"] == 1 for r in apart), len(apart))
            cells.append("; ".join(limits(*c) for c in (*counts, (sum(r["inside"] == 1 for r in found), len(found)))))
        cells.append(limits(sum(r["right"] for r in off), len(off)))
        sensors = [r for r in own if r["truth"] == "sensor" and r["level"] == "10x"]
        cells.append(limits(sum(r["verdict"] == "sensor" for r in sensors), len(sensors)))
        cells.append(f"{np.median([r['seconds'] for r in own]):.0f}, {max(r['seconds'] for r in own):.0f}")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def said(row: dict[str, Any]) -> str:
    """A line for an answer that is not right."""
    found = [f"{f.get('physics')} at {f.get('place')}" for f in row["answer"].get("findings") or []]
    return f"  {row['name']} ({row['truth']}): {row['verdict']} {found} {row['status']}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("calibrate_out"))
    parser.add_argument("--seed", type=int, default=1, help="the first one")
    parser.add_argument("--seeds", type=int, default=2, help="how many")
    parser.add_argument("--plants", default="")
    parser.add_argument("--kinds", default="", help="clean, wrong, or kinds of the suite; default: all")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--limit", type=float, default=1200.0)
    given = parser.parse_args()
    plants, wanted = ([word for word in text.split(",") if word] for text in (given.plants, given.kinds))
    shop = Shop(given.out, given.limit)
    if unknown := set(plants) - {bench.plant for bench in benches}:
        parser.error(f"no plant is called {', '.join(sorted(unknown))}; there are {', '.join(b.plant for b in benches)}")
    with ThreadPoolExecutor(given.jobs) as pool:
        found = pool.map(shop.rows, kinds(plants, wanted, range(given.seed, given.seed + given.seeds)))
        rows = [row for some in found for row in some]
    wrong_ones = [said(r) for r in rows if (not r["right"] or r.get("inside", 1) < 1) and r["level"] != "1x"]
    text = "\n".join([table(rows), "", "not right, or somewhere else:", *wrong_ones])
    (given.out / "calibration.txt").write_text(text + "\n", encoding="utf-8")
    sys.stdout.write(text + "\n")


if __name__ == "__main__":
    main()
