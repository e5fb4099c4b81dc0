"""What usual ways find in the same concealed cases: filter, differentiate, regress; and sparse regression of what is left (pysindy).

    pip install 'pysindy>=2.1'      # sparse regression by those who made it known; needed here alone
    python tests/studies/regressions.py --out prove_out [--seed 1] [--plants actuator,xy_table] [--cases c001,c002] [--cutoff 25]

Both get what `diagnose` gets: the study, its model, and which of its parameters are free. Outputs pass a low-pass forward and back and are
differentiated; with the balances of the model as F(x', x, z, u, p) = F_0 + F_p (p - p_0), r of them, and N independent instants,

    regress   one more column at a time, of a function of a body's own position and velocity at its own balance (`FUNCTIONS`):
              gain = N/2 sum over r of log(rms_r before / rms_r after)^2 - 1/2 log N; kept while more than 5 nats (that is 10 of BIC)
    sparse    F at the fitted parameters against all those functions, sequentially thresholded least squares (S. L. Brunton et al., PNAS
              113, 2016); both in units of the rms force there, with a threshold of 1 % of it

Where a state of the balances is not shown by the outputs neither can be used. Prints beside it what `prove.py` has of the same cases.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from blind import asked, judge, limits, wanted
from pysindy import STLSQ

from backsight.data.cases import make_case
from backsight.estimation import Problem
from backsight.estimation.classical.balances import Balances, linear_balances
from backsight.estimation.classical.filtered_least_squares import zero_phase
from backsight.estimation.classical.measured_states import Motion, motion
from backsight.estimation.study.study import Study
from backsight.models import Dae
from backsight.models.errors import InputError

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

FUNCTIONS: dict[str, Callable[[Array, Array], Array]] = {
    "constant_force": lambda _, v: np.ones_like(v),
    "viscous_friction": lambda _, v: v,
    "coulomb_friction": lambda _, v: np.sign(v),
    "quadratic_drag": lambda _, v: v * np.abs(v),
    "asymmetric_friction": lambda _, v: np.abs(v),
    "spring": lambda q, _: q,
    "cubic_spring": lambda q, _: q**3,
}
POLES = 6
SLOW = 0.05  # of the rms velocity of a body: instants near its rests and reversals are left out, as is usual
SURE = 5.0  # nats
EFFECTS = 4
FLOOR = 0.01  # of the rms force at a place


@dataclass(frozen=True, kw_only=True)
class Equations:
    """Balances along filtered recordings: F (M, r), slopes (M, r, p), and (place, physics) -> its number and a column (M,).

    count: of independent instants; forces (r,): rms of the largest term.
    """

    F: Array
    slopes: Array
    columns: dict[tuple[str, str], tuple[int, Array]]
    count: float
    forces: Array

    @classmethod
    def of(cls, problem: Problem, cutoff: float) -> Equations:
        """Raises InputError where the method cannot be used."""
        filtered = partial(zero_phase, cutoff=cutoff, poles=POLES, inputs_too=True)
        balances = linear_balances(problem, "regressions")
        motions = [motion(problem, r, filtered, "regressions") for r in problem.fitted]
        pieces = [balances.along(m) for m in motions]
        x, own = np.concatenate([m.x for m in motions], axis=1), _own(problem.dae, balances, motions)
        fast = np.ones(x.shape[1], dtype=bool)
        for j in {j for *_, j in own}:
            fast &= np.abs(x[j]) > SLOW * np.sqrt(np.mean(x[j] ** 2))
        q = x - x.mean(axis=1, keepdims=True)
        F, slopes = np.concatenate([F for F, _ in pieces])[fast], np.concatenate([s for _, s in pieces])[fast]
        columns = {(place, physics): (row, f(q[i], x[j])[fast]) for row, place, i, j in own for physics, f in FUNCTIONS.items()}
        seconds = fast.mean() * sum(float(m.t[-1] - m.t[0]) for m in motions)
        base = problem.values[list(problem.free)]
        terms = np.concatenate([slopes * base, (F - slopes @ base)[:, :, None]], axis=2)
        return cls(F=F, slopes=slopes, columns=columns, count=2 * cutoff * seconds, forces=np.sqrt(np.mean(terms**2, axis=0)).max(axis=1))

    def left(self, added: list[tuple[str, str]]) -> tuple[Array, Array]:
        """Rms (r,) and rows (M, r) that are left with these columns, balances weighed by their own rms, by two passes."""
        size, (M, r, n) = np.ones(self.F.shape[1]), self.slopes.shape
        A = np.zeros((M, r, n + len(added)))
        A[:, :, :n] = self.slopes
        for k, key in enumerate(added):
            row, column = self.columns[key]
            A[:, row, n + k] = column
        rest = self.F
        for _ in range(2):
            scaled = (A / size[:, None]).reshape(M * r, -1)
            unit = np.sqrt(np.mean(scaled**2, axis=0)) + 1e-300
            theta = np.linalg.lstsq(scaled / unit, -(self.F / size).ravel(), rcond=1e-9)[0] / unit
            rest = self.F + A @ theta
            size = np.sqrt(np.mean(rest**2, axis=0)) + 1e-300
        return size, rest


def _own(dae: Dae, balances: Balances, motions: list[Motion]) -> list[tuple[int, str, int, int]]:
    """Number of a balance, its place, and position and velocity of its own body, where they are seen."""
    found = []
    for number, row in enumerate(balances.rows):
        place = dae.equations[row].place
        if place is None:
            continue
        name = dae.places[place].name
        for i, j, _ in dae.kinematics:
            if dae.states[j].name.rpartition(".")[0] == name and any(np.any(m.x[j]) for m in motions):
                found.append((number, name, i, j))
    return found


def regress(equations: Equations) -> list[tuple[str, str]]:
    """Columns that are kept, the first one first."""
    kept = list[tuple[str, str]]()
    size, _ = equations.left(kept)
    while len(kept) < EFFECTS:
        sizes = {key: equations.left([*kept, key])[0] for key in equations.columns if key not in kept}
        gains = {key: equations.count * float(np.sum(np.log(size / s))) - 0.5 * np.log(equations.count) for key, s in sizes.items()}
        best = max(gains, key=lambda key: gains[key], default=None)
        if best is None or gains[best] < SURE:
            break
        kept, size = [*kept, best], sizes[best]
    return kept


def sparse(equations: Equations) -> list[tuple[str, str]]:
    """Functions that are left by thresholds, the largest share first."""
    _, rest = equations.left([])
    found = dict[tuple[str, str], float]()
    for number in range(rest.shape[1]):
        keys = [key for key, (row, _) in equations.columns.items() if row == number]
        if not keys:
            continue
        X = np.column_stack([equations.columns[key][1] for key in keys])
        unit = np.sqrt(np.mean(X**2, axis=0)) + 1e-300
        told = STLSQ(threshold=FLOOR, alpha=1e-6).fit(X / unit, -rest[:, [number]] / equations.forces[number]).coef_.ravel()
        found |= {key: abs(float(c)) for key, c in zip(keys, told, strict=True) if c}
    return sorted(found, key=lambda key: -found[key])


def answer(keys: list[tuple[str, str]] | None) -> dict[str, Any]:
    """What was found as a diagnosis says it; None: the method cannot be used."""
    findings = [{"place": place, "physics": physics, "parameters": {}} for place, physics in keys or []]
    verdict = None if keys is None else "missing_physics" if keys else "none"
    return {"status": "ok", "seconds": 0.0, "answer": {"verdict": verdict, "findings": findings}}


def table(rows: dict[str, list[dict[str, Any]]]) -> str:
    """Rates of every method, of the cases where it can be used."""
    lines = ["| | can be used | alarms, clean | found, faulty | place first | member | confident and wrong |", "|---" * 7 + "|"]
    for method, every in rows.items():
        own = [r for r in every if r["verdict"] is not None]
        clean, faulty = ([r for r in own if (r["truth"] == "none") is there] for there in (True, False))
        told = [r for r in faulty if r["truth"] not in ("parameter", "unknown_physics")]
        cells = [
            f"{len(own)} of {len(every)}",
            limits(sum(r["alarm"] for r in clean), len(clean)),
            limits(sum(r["alarm"] for r in faulty), len(faulty)),
            *(limits(sum(r[key] == 1 for r in told), len(told)) for key in ("place", "member")),
            limits(sum(r["confident_and_wrong"] for r in faulty), len(faulty)),
        ]
        lines.append("| " + " | ".join([method, *cells]) + " |")
    return "\n".join(lines)


def main() -> None:
    parser = asked(__doc__)
    parser.add_argument("--cutoff", type=float, default=25.0, help="Hz of the low-pass")
    given = parser.parse_args()
    rows: dict[str, list[dict[str, Any]]] = {"regress": [], "sparse": [], "backsight": []}
    for case in wanted(parser, given):
        if not (given.out / "truth" / f"{case}.json").exists():
            make_case(int(case[1:]), given.out / "cases", given.out / "truth", given.seed)
        truth = json.loads((given.out / "truth" / f"{case}.json").read_text(encoding="utf-8"))
        problem = Study.read(given.out / "cases" / case / "study.toml").problem()
        posed = replace(problem, recordings=[r for r in problem.recordings if r.role == "fit"])
        try:
            equations = Equations.of(posed, given.cutoff)
            found: dict[str, list[tuple[str, str]] | None] = {"regress": regress(equations), "sparse": sparse(equations)}
        except InputError as error:
            sys.stderr.write(f"{case}: {error}\n")
            found = {"regress": None, "sparse": None}
        for method, keys in found.items():
            rows[method].append(judge(truth, answer(keys)))
        own = given.out / "results" / f"{case}.json"
        if own.exists():
            rows["backsight"].append(judge(truth, json.loads(own.read_text(encoding="utf-8"))))
        sys.stderr.write(f"{case} {truth['kind']}: {found}\n")
    text = table(rows)
    (given.out / "regressions.txt").write_text(text + "\n", encoding="utf-8")
    sys.stdout.write(text + "\n")


if __name__ == "__main__":
    main()
