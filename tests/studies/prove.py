"""The proof suite: `diagnose`, blind, on concealed cases of every plant, against the truth that lies elsewhere.

    python tests/studies/prove.py --out prove_out [--seed 1] [--plants actuator,five_bar] [--cases c001,c002] [--jobs 2] [--limit 1200]

Cases are made by simulators that share no equations with the estimator (`backsight.data.cases`). Each is copied to a folder of its own and
diagnosed by the command, as a user would; results stay in --out, and a rerun goes on with those that are not there. Rates come with
their Clopper-Pearson limits (95 %, one-sided).
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from blind import asked, judge, limits, run, wanted

from backsight.data.cases import make_case

VERDICTS = ("none", "parameter", "sensor", "input", "missing_physics", "unknown_physics", "undecided")


def quantile(values: list[float], share: float) -> float:
    """Of values, NaN where there are none."""
    return float(np.quantile(values, share)) if values else float("nan")


def board(rows: list[dict[str, Any]]) -> str:
    """The scorecard."""
    clean = [r for r in rows if r["truth"] == "none"]
    faulty = [r for r in rows if r["truth"] != "none"]
    told = [r for r in faulty if r["truth"] not in ("parameter", "unknown_physics")]
    errors = [e for r in faulty for e in r["errors"]]
    covers = [c for r in faulty for c in r["covers"]]
    seconds = [r["seconds"] for r in rows]
    gains = [r["gain"] for r in told if r["gain"] is not None]

    def count(some: list[dict[str, Any]], key: str) -> str:
        return limits(sum(bool(r[key]) for r in some), len(some))

    lines = [
        f"cases                              {len(clean)} clean, {len(faulty)} faulty",
        f"alarms on clean ones               {count(clean, 'alarm')}",
        *(f"detected, {s:24s} {count([r for r in faulty if r['strength'] == s], 'alarm')}" for s in ("strong", "weak", "parameter")),
        *(f"verdict right, {v:19s} {count([r for r in faulty if r['truth'] == v], 'right')}" for v in VERDICTS[1:]),
        f"place first                        {np.mean([r['place'] for r in told]) if told else float('nan'):.3f}",
        f"place in the set                   {np.mean([r['inside'] for r in told]) if told else float('nan'):.3f}",
        f"member                             {np.mean([r['member'] for r in told]) if told else float('nan'):.3f}",
        f"confident and wrong                {count(faulty, 'confident_and_wrong')}",
        f"parameter error, median, 90 %      {quantile(errors, 0.5):.4f}, {quantile(errors, 0.9):.4f}",
        f"within two deviations              {limits(sum(covers), len(covers))}",
        f"held-out gain, median              {quantile(gains, 0.5):.1f} %",
        f"seconds, median, most              {np.median(seconds):.0f}, {max(seconds):.0f}",
    ]
    table = Counter((r["truth"], str(r["verdict"])) for r in rows)
    lines += ["", "truth -> answers"]
    lines += [
        f"  {t:16s} " + ", ".join(f"{v} {n}" for (a, v), n in sorted(table.items()) if a == t)
        for t in VERDICTS
        if any(a == t for a, _ in table)
    ]
    lines += ["", "not right:"]
    lines += [
        f"  {r['case']} {r['plant']} {r['kind']} ({r['truth']}): {r['verdict']} {r['said']} {r['status']}"
        for r in rows
        if not r["right"] or r.get("member", 1) < 1
    ]
    return "\n".join(lines)


def main() -> None:
    """Make the suite, run what is not there yet, print the scorecard."""
    parser = asked(__doc__)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--limit", type=float, default=1200.0)
    given = parser.parse_args()
    names = wanted(parser, given)
    cases, truths, results = (given.out / name for name in ("cases", "truth", "results"))
    results.mkdir(parents=True, exist_ok=True)
    left = [c for c in names if not (results / f"{c}.json").exists()]

    def one(case: str) -> None:
        if not (truths / f"{case}.json").exists():
            make_case(int(case[1:]), cases, truths, given.seed)
        run(cases / case, results / f"{case}.json", given.limit)

    with ThreadPoolExecutor(given.jobs) as pool:
        for number, _ in enumerate(pool.map(one, left)):
            sys.stderr.write(f"{number + 1} of {len(left)}: {left[number]}\n")
    rows = []
    for case in names:
        kept = json.loads((results / f"{case}.json").read_text(encoding="utf-8"))
        said = [f"{f.get('physics')} at {f.get('place')}" for f in kept["answer"].get("findings") or []]
        truth = json.loads((truths / f"{case}.json").read_text(encoding="utf-8"))
        rows.append(judge(truth, kept) | {"case": case, "said": said})
    text = board(rows)
    (given.out / "scorecard.txt").write_text(text + "\n", encoding="utf-8")
    sys.stdout.write(text + "\n")


if __name__ == "__main__":
    main()
