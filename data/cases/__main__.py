"""Writes the suite of concealed cases: `python -m backsight.data.cases OUT --truth OUT_TRUTH [--seed N] [--only 3,17] [--core]`."""

import argparse
import sys
import time
from pathlib import Path

from .suite import make_case, numbered


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m backsight.data.cases", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=Path, help="folder of the cases")
    parser.add_argument("--truth", type=Path, required=True, help="folder of the truth, outside of the cases")
    parser.add_argument("--seed", type=int, default=1, help="of every random number")
    parser.add_argument("--only", default="", help="numbers of cases with commas, or names of plants; default: all")
    parser.add_argument("--core", action="store_true", help="the small suite")
    arguments = parser.parse_args()
    words = [word for word in arguments.only.split(",") if word]
    for number, (bench, case) in enumerate(numbered(), start=1):
        if (words and not {str(number), bench.plant} & set(words)) or (arguments.core and not case.core):
            continue
        begin = time.perf_counter()
        made = make_case(number, arguments.out, arguments.truth, arguments.seed)
        seconds, share = time.perf_counter() - begin, float(str(made.truth["share_of_force"]))
        print(f"{made.name} {bench.plant:12s} {case.kind:32s} {case.strength:9s} {share:7.3f} {seconds:5.1f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
