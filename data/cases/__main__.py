"""Writes the suite of concealed cases: `python -m backsight.data.cases OUT --truth OUT_TRUTH [--seed N] [--only 3,17] [--core]`."""

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from .suite import make_case, numbered


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m backsight.data.cases", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=Path, help="folder of the cases")
    parser.add_argument("--truth", type=Path, required=True, help="folder of the truth, outside of the cases")
    parser.add_argument("--seed", type=int, default=1, help="of every random number")
    parser.add_argument("--only", default="", help="numbers of cases with commas, or names of plants; default: all")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--core", action="store_true", help="the small suite")
    arguments = parser.parse_args()
    words = [word for word in arguments.only.split(",") if word]
    chosen = [
        number
        for number, (bench, case) in enumerate(numbered(), start=1)
        if (not words or {str(number), bench.plant} & set(words)) and (case.core or not arguments.core)
    ]
    one = partial(line, folder=arguments.out, truth=arguments.truth, seed=arguments.seed)
    if arguments.jobs == 1:
        for number in chosen:
            print(one(number), file=sys.stderr)
        return
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for text in pool.map(one, chosen):
            print(text, file=sys.stderr)


def line(number: int, folder: Path, truth: Path, seed: int) -> str:
    """Write a case; what there is to say of it: name, plant, kind, strength, share of force, seconds."""
    begin = time.perf_counter()
    made = make_case(number, folder, truth, seed)
    told, seconds = made.truth, time.perf_counter() - begin
    return f"{made.name} {told['plant']:12s} {told['kind']:32s} {told['strength']:9s} {told['share_of_force']:7.3f} {seconds:5.1f} s"


if __name__ == "__main__":
    main()
