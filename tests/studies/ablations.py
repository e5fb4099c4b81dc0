"""What every stage of `diagnose` is worth: concealed cases diagnosed with one of them left out.

    python tests/studies/ablations.py --out ablations_out [--seed 1] [--plants actuator,five_bar] [--without rivals,rest] [--jobs 2]

draws     chances of gains from Bonferroni's bound instead
own       parameters held at what the model as it is makes of the recordings, instead of anew beside every candidate
rivals    a library of physics alone: neither parameters nor sensors nor inputs can be wrong
rest      no care where a body is near rest: a rounded sign is taken at its word there
mesh      one interval for five samples, and nobody looks whether that is enough

The cases are those of the small suite. Results stay in --out, and a rerun goes on with those that are not there.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from blind import answered, judge, limits

from backsight.data.cases import make_case, numbered

STAGES = ("nothing", "draws", "own", "rivals", "rest", "mesh")
COARSE = 5  # sampling intervals in one of the mesh
SUSPECTS = ("parameter", "sensor", "actuator")


@contextmanager
def without(stage: str, held: set[str]) -> Iterator[None]:
    """`diagnose` with a stage left out; held: parameters of which nobody doubts the values."""
    from backsight.estimation.diagnosis.candidates import library
    from backsight.estimation.diagnosis.scores import chance
    from backsight.estimation.diagnosis.search import round as of_search
    from backsight.estimation.smoothing import meshing, program, work
    from backsight.estimation.smoothing.mesh_error import Checked

    def physics(*given: Any, **named: Any) -> list[Any]:
        return [c for c in library.library(*given, **named) if c.family not in SUSPECTS]

    def unheld(problem: Any, *given: Any, **named: Any) -> list[Any]:
        found = library.library(problem, *given, **named)
        return [c for c in found if c.family != "parameter" or not held & {*c.strengths, *c.start}]

    def coarse(problem: Any, *given: Any) -> Any:
        *rest, _, finest = given
        step = min(float(np.median(np.diff(r.time))) for r in problem.fitted)
        return meshing.mesh(problem, *rest, COARSE * step, finest)

    def none(problem: Any, laws: Any, followed: Any, knots: Any, soft: Any, *_: Any) -> Any:
        return np.zeros((len(soft), sum(len(own) - 1 for own in knots)))

    with ExitStack() as stack:
        if stage == "draws":
            stack.enter_context(patch.object(chance.Chance, "share", 1.0))
        elif stage == "rivals":
            stack.enter_context(patch.object(of_search, "library", physics))
        elif stage == "own":
            stack.enter_context(patch.object(of_search, "library", unheld))
        elif stage == "rest":
            stack.enter_context(patch.object(program, "open_at_rest", none))
            stack.enter_context(patch.object(work, "wants_room", lambda *_: False))
        elif stage == "mesh":
            stack.enter_context(patch.object(work, "mesh", coarse))
            stack.enter_context(patch.object(work, "refine", lambda solution, *_, **__: Checked(solution=solution)))
        yield


def one(study: Path, out: Path, stage: str) -> None:
    """The answer to a study without a stage, in `out`; in a process of its own."""
    from backsight.estimation import Free, diagnose, smooth
    from backsight.estimation.command.diagnosis_json import result_of_diagnosis
    from backsight.estimation.study.study import Study

    read = Study.read(study)
    problem = replace(read.problem(), model=read.model)
    free = {n for n, p in problem.parameters.items() if isinstance(p, Free)}
    with without(stage, free):
        if stage == "own":
            fitted = smooth(replace(problem, recordings=[r for r in problem.recordings if r.role == "fit"])).parameters
            problem = replace(problem, parameters={n: fitted[n].value if n in free else p for n, p in problem.parameters.items()})
        answer = result_of_diagnosis(diagnose(problem))
    out.write_text(json.dumps(answer), encoding="utf-8")


def line(stage: str, rows: list[dict[str, Any]]) -> str:
    """A row of the table."""
    clean, faulty = ([r for r in rows if (r["truth"] == "none") is is_clean] for is_clean in (True, False))
    told = [r for r in faulty if r["truth"] not in ("parameter", "unknown_physics")]
    cells = [
        stage,
        limits(sum(r["alarm"] for r in clean), len(clean)),
        limits(sum(r["right"] for r in faulty), len(faulty)),
        *(limits(sum(r[key] == 1 for r in told), len(told)) for key in ("place", "member")),
        f"{np.median([r['seconds'] for r in rows]):.0f}, {max(r['seconds'] for r in rows):.0f}",
    ]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("ablations_out"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--plants", default="")
    parser.add_argument("--without", default=",".join(STAGES), help=f"of {', '.join(STAGES)}")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--limit", type=float, default=1200.0)
    parser.add_argument("--one", nargs=3, metavar=("STUDY", "OUT", "STAGE"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        one(Path(given.one[0]), Path(given.one[1]), given.one[2])
        return
    plants, stages = (text.split(",") if text else [] for text in (given.plants, given.without))
    if unknown := set(stages) - set(STAGES):
        parser.error(f"no stage is called {', '.join(sorted(unknown))}; there are {', '.join(STAGES)}")
    chosen = [n for n, (bench, case) in enumerate(numbered(), start=1) if case.core and (not plants or bench.plant in plants)]
    cases, truths = given.out / "cases", given.out / "truth"

    def run(entry: tuple[int, str]) -> dict[str, Any]:
        number, stage = entry
        name, kept = f"c{number:03d}", given.out / stage / f"c{number:03d}.json"
        if not kept.exists():
            kept.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory() as folder:
                found = Path(folder) / "answer.json"
                command = [sys.executable, __file__, "--one", str(cases / name / "study.toml"), str(found), stage]
                answered(command, found, kept, given.limit)
            sys.stderr.write(f"{name} without {stage}\n")
        truth = json.loads((truths / f"{name}.json").read_text(encoding="utf-8"))
        return judge(truth, json.loads(kept.read_text(encoding="utf-8"))) | {"stage": stage}

    for number in chosen:
        if not (truths / f"c{number:03d}.json").exists():
            make_case(number, cases, truths, given.seed)
    with ThreadPoolExecutor(given.jobs) as pool:
        rows = list(pool.map(run, [(number, stage) for stage in stages for number in chosen]))
    head = "| without | alarms, clean | verdict right | place first | member | seconds, median, most |\n|---|---|---|---|---|---|"
    text = "\n".join([head, *(line(stage, [r for r in rows if r["stage"] == stage]) for stage in stages)])
    (given.out / "ablations.txt").write_text(text + "\n", encoding="utf-8")
    sys.stdout.write(text + "\n")


if __name__ == "__main__":
    main()
