"""The proof suite: `diagnose`, blind, on concealed cases of every plant, against the truth that lies elsewhere.

    python tests/studies/prove.py --out prove_out [--seed 1] [--plants actuator,five_bar] [--cases c001,c002] [--jobs 2] [--limit 1200]

Cases are made by simulators that share no equations with the estimator (`backsight.data.cases`). Each is copied to a folder of its own and
diagnosed by the command, as a user would; results stay in --out, and a rerun goes on with those that are not there. Rates come with
their Clopper-Pearson limits (95 %, one-sided).
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta

VERDICTS = ("none", "parameter", "sensor", "input", "missing_physics", "unknown_physics", "undecided")
DEFINITE = ("parameter", "sensor", "input", "missing_physics")


def run(case: Path, out: Path, limit: float) -> None:
    """The command on a copy of a case; what came of it in `out`."""
    began, status = time.perf_counter(), "ok"
    with tempfile.TemporaryDirectory() as folder:
        copy, results = Path(folder) / "case", Path(folder) / "out"
        shutil.copytree(case, copy)
        command = [sys.executable, "-c", "import sys; from backsight.estimation.command.cli import main; sys.exit(main())"]
        command += ["diagnose", str(copy / "study.toml"), "--out", str(results), "--quiet", "--jobs", "1"]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=limit, check=False)
            status = "ok" if done.returncode == 0 else f"status {done.returncode}: {done.stderr.strip()[-300:]}"
        except subprocess.TimeoutExpired:
            status = "too long"
        found = results / "result.json"
        answer = json.loads(found.read_text(encoding="utf-8")) if found.exists() else {}
    kept = {key: answer.get(key) for key in ("verdict", "findings", "held_out", "not_detectable")}
    out.write_text(json.dumps({"status": status, "seconds": time.perf_counter() - began, "answer": kept}), encoding="utf-8")


def judge(truth: dict[str, Any], kept: dict[str, Any]) -> dict[str, Any]:
    """What was right in one answer."""
    answer = kept["answer"]
    verdict, findings = answer.get("verdict"), answer.get("findings") or []
    clean = truth["verdict"] == "none"
    right = verdict in (truth["verdict"], *truth.get("verdict_also", ()))
    row: dict[str, Any] = {
        "plant": truth["plant"],
        "kind": truth["kind"],
        "strength": truth["strength"],
        "truth": truth["verdict"],
        "verdict": verdict,
        "right": right,
        "seconds": kept["seconds"],
        "status": kept["status"],
        "alarm": verdict not in (None, "none"),
        "gain": (answer.get("held_out") or {}).get("improvement_percent"),
    }
    if clean:
        return row
    effects = truth["effects"]
    named = [(f.get("place"), f.get("physics")) for f in findings]
    also = [(r.get("place"), r.get("physics")) for f in findings for r in f.get("ambiguous_with") or []]
    place, inside, member, errors, covers = 0, 0, 0, [], []
    for effect in effects:
        good = [tuple(pair) for pair in effect["acceptable"]]
        places = {p for p, _ in good}
        first = named[: len(effects)]
        if truth["verdict"] == "parameter":
            text = json.dumps(findings[:1])
            place, inside, member = (
                place + (effect["physics"] in text),
                inside + (effect["physics"] in text),
                member + (effect["physics"] in text),
            )
            continue
        place += any(p in places for p, _ in first)
        inside += any(p in places for p, _ in named + also)
        hit = next((f for f, pair in zip(findings, named, strict=True) if pair in good), None)
        member += hit is not None or (truth["verdict"] == "unknown_physics" and verdict == "unknown_physics")
        for name, true in effect["parameters"].items() if hit and hit.get("physics") == effect["physics"] else ():
            value = (hit["parameters"].get(name) or {}).get("value")
            std = (hit["parameters"].get(name) or {}).get("std")
            if value is not None:
                errors.append(abs(abs(value) - abs(true["value"])) / abs(true["value"]))
                covers.append(std is not None and abs(abs(value) - abs(true["value"])) <= 2 * std)
    n = len(effects)
    row |= {"place": place / n, "inside": inside / n, "member": member / n, "errors": errors, "covers": covers}
    row["confident_and_wrong"] = verdict in DEFINITE and (not right or inside == 0)
    return row


def limits(k: int, n: int) -> str:
    """A count, its share, and the limits of that."""
    if not n:
        return "-"
    low = beta.ppf(0.05, k, n - k + 1) if k else 0.0
    high = beta.ppf(0.95, k + 1, n - k) if k < n else 1.0
    return f"{k}/{n} = {100 * k / n:.0f} %  ({100 * low:.0f} .. {100 * high:.0f})"


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
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("prove_out"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--plants", default="")
    parser.add_argument("--cases", default="")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--limit", type=float, default=1200.0)
    given = parser.parse_args()
    cases, truths, results = (given.out / name for name in ("cases", "truth", "results"))
    if not cases.exists():
        subprocess.run(
            [sys.executable, "-m", "backsight.data.cases", str(cases), "--seed", str(given.seed), "--truth", str(truths)], check=True
        )
    results.mkdir(parents=True, exist_ok=True)
    known = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in sorted(truths.glob("*.json"))}
    plants, ids = given.plants.split(",") if given.plants else [], given.cases.split(",") if given.cases else []
    wanted = [c for c, t in known.items() if (not plants or t["plant"] in plants) and (not ids or c in ids)]
    left = [c for c in wanted if not (results / f"{c}.json").exists()]
    with ThreadPoolExecutor(given.jobs) as pool:
        for number, _ in enumerate(pool.map(lambda c: run(cases / c, results / f"{c}.json", given.limit), left)):
            sys.stderr.write(f"{number + 1} of {len(left)}: {left[number]}\n")
    rows = []
    for case in wanted:
        kept = json.loads((results / f"{case}.json").read_text(encoding="utf-8"))
        said = [f"{f.get('physics')} at {f.get('place')}" for f in kept["answer"].get("findings") or []]
        rows.append(judge(known[case], kept) | {"case": case, "said": said})
    text = board(rows)
    (given.out / "scorecard.txt").write_text(text + "\n", encoding="utf-8")
    sys.stdout.write(text + "\n")


if __name__ == "__main__":
    main()
