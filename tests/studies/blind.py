"""Concealed cases, diagnosed blind: the command on a copy of a case, its answer against the truth, and how sure a rate is."""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from scipy.stats import beta

from backsight.data.cases import numbered

INTERRUPTED = 130  # what a command that was interrupted returns
DEFINITE = ("parameter", "sensor", "input", "missing_physics")


def run(case: Path, out: Path, limit: float) -> None:
    """The command on a copy of a case; what came of it in `out`."""
    with tempfile.TemporaryDirectory() as folder:
        copy, results = Path(folder) / "case", Path(folder) / "out"
        shutil.copytree(case, copy)
        command = [sys.executable, "-c", "import sys; from backsight.estimation.command.cli import main; sys.exit(main())"]
        command += ["diagnose", str(copy / "study.toml"), "--out", str(results), "--quiet", "--jobs", "1"]
        answered(command, results / "result.json", out, limit)


def answered(command: list[str], found: Path, out: Path, limit: float) -> None:
    """A command run for `limit` [s] at most, and what is kept of the answer that it writes to `found`, whole or not at all, in `out`.

    Raises KeyboardInterrupt where the command was interrupted: that is no answer.
    """
    began, status = time.perf_counter(), "ok"
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=limit, check=False)
        if done.returncode < 0 or done.returncode == INTERRUPTED:
            raise KeyboardInterrupt
        status = "ok" if done.returncode == 0 else f"status {done.returncode}: {done.stderr.strip()[-300:]}"
    except subprocess.TimeoutExpired:
        status = "too long"
    answer = json.loads(found.read_text(encoding="utf-8")) if found.exists() else {}
    kept = {key: answer.get(key) for key in ("verdict", "findings", "held_out", "not_detectable", "tried", "notes")}
    half = out.with_suffix(".half")
    half.write_text(json.dumps({"status": status, "seconds": time.perf_counter() - began, "answer": kept}), encoding="utf-8")
    half.replace(out)


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
        "alarm": verdict != "none" if clean else verdict not in (None, "none"),
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
            named_it = any(f.get("physics") == "wrong_parameter" and effect["physics"] in f["parameters"] for f in findings[:1])
            place, inside, member = place + named_it, inside + named_it, member + named_it
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


def asked(about: str | None) -> argparse.ArgumentParser:
    """The command line of a study of the suite's cases."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("prove_out"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--plants", default="")
    parser.add_argument("--cases", default="")
    return parser


def wanted(parser: argparse.ArgumentParser, given: argparse.Namespace) -> list[str]:
    """Names of the cases that were asked for; ends where the folder has cases of another seed."""
    given.out.mkdir(parents=True, exist_ok=True)
    drawn = given.out / "seed.txt"
    if drawn.exists() and drawn.read_text(encoding="utf-8") != str(given.seed):
        parser.error(f"{given.out} has cases of seed {drawn.read_text(encoding='utf-8')}; name another folder for seed {given.seed}")
    drawn.write_text(str(given.seed), encoding="utf-8")
    plants, ids = ([word for word in text.split(",") if word] for text in (given.plants, given.cases))
    named = {f"c{number:03d}": bench.plant for number, (bench, _) in enumerate(numbered(), start=1)}
    return [c for c, plant in named.items() if (not plants or plant in plants) and (not ids or c in ids)]


def limits(k: int, n: int) -> str:
    """A count, its share, and the limits of that."""
    if not n:
        return "-"
    low = beta.ppf(0.05, k, n - k + 1) if k else 0.0
    high = beta.ppf(0.95, k + 1, n - k) if k < n else 1.0
    return f"{k}/{n} = {100 * k / n:.0f} %  ({100 * low:.0f} .. {100 * high:.0f})"
