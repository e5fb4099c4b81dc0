"""The same window by other solvers: `python tests/benchmarks/tracking_solvers.py [axis] [xy_table]`.

Every counted sample's window, with the same arrival cost, the same scales and from the same start, is also solved as a nonlinear program
with exact derivatives: by Ipopt, warm (its multipliers too are those of the window before), and by fatrop (L. Vanroye, A. Sathya, J. De
Schutter & W. Decre, IROS 2023). Milliseconds of the processor for a solve alone (median, p99), the median over ours, iterations, solves
that failed, and how far the newest state and the parameters are from ours, in their deviations (median, p95 and most). All are evaluated by
CasADi's virtual machine.
"""

from __future__ import annotations

import os
import sys
import time
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import casadi as ca
import numpy as np
from tracking import SETTLED, Ours
from tracking_cases import CASES, WINDOW, Case

from backsight.ocp.moving.window import Window

OPTIONS: dict[str, dict[str, Any]] = {
    "ipopt": {
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.warm_start_init_point": "yes",
        "ipopt.nlp_scaling_method": "none",
        "ipopt.tol": 1e-6,
    },
    "fatrop": {"structure_detection": "manual", "fatrop": {"print_level": 0, "tol": 1e-6}},
}


class Program:
    """A full window as a nonlinear program in the order that fatrop wants.

    Stage k has the state s_k = [x_k; p_k] and the controls [interior_k; x_(k+1)]: [s_0 | c_0 | s_1 | .. | s_N], all over `scale`. Its rows
    are s_(k+1) - [x_(k+1); p_k] and the equations without residual force.
    """

    def __init__(self, window: Window, solver: str, scale: np.ndarray) -> None:
        stage, ip = window.stage, window.stage.interpolation
        self.nx, self.np, self.inner, self.name = ip.states, len(stage.free), ip.interior, solver
        n, nd, nlast = stage.size, stage.numbers, len(window.newest)
        states = [ca.MX.sym(f"s{k}", n) for k in range(WINDOW + 1)]
        controls = [ca.MX.sym(f"c{k}", self.inner + self.nx) for k in range(WINDOW)]
        D, newest, p_ref = ca.MX.sym("D", nd, WINDOW), ca.MX.sym("newest", nlast), ca.MX.sym("p_ref", self.np)
        R, d = ca.MX.sym("R", n, n), ca.MX.sym("d", n)
        self.scale_state = scale
        self.scale_control = np.concatenate([np.ones(self.inner), scale[: self.nx]])
        y, pr, dd = ca.SX.sym("y", ip.local + self.np), ca.SX.sym("p_ref", self.np), ca.SX.sym("d", nd)
        e, _, h, _ = stage.rows(y, pr, dd)
        cost, exact = ca.Function("cost", [y, pr, dd], [ca.sumsqr(e) / 2]), ca.Function("exact", [y, pr, dd], [h])
        arrival = R @ (states[0] * scale) + d
        f, rows, order = ca.sumsqr(arrival) / 2, [], []
        for k in range(WINDOW):
            s, c = states[k] * scale, controls[k] * self.scale_control
            at = ca.vertcat(s[: self.nx], c, s[self.nx :])
            f += cost(at, p_ref, D[:, k])
            rows += [states[k + 1] - ca.vertcat(controls[k][self.inner :], states[k][self.nx :])]
            if h.shape[0]:
                rows += [exact(at, p_ref, D[:, k])]
            order += [states[k], controls[k]]
        end = states[-1] * scale
        f += ca.sumsqr(stage.last(end[: self.nx], end[self.nx :], newest)[0]) / 2
        program = {
            "x": ca.vertcat(*order, states[-1]),
            "p": ca.vertcat(ca.vec(D), newest, p_ref, ca.vec(R), d),
            "f": f,
            "g": ca.vertcat(*rows),
        }
        options = dict(OPTIONS[solver])
        if solver == "fatrop":
            many = [h.shape[0]] * WINDOW + [0]
            options |= {"nx": [n] * (WINDOW + 1), "nu": [self.inner + self.nx] * WINDOW + [0], "ng": many, "N": WINDOW}
            options["equality"] = [True] * program["g"].shape[0]
        self.solver = ca.nlpsol("window", solver, program, {"print_time": False, "expand": True, **options})
        self.multipliers = np.zeros(program["g"].shape[0])
        self.each = program["g"].shape[0] // WINDOW

    def solve(self, window: Window, at: Any, known: np.ndarray, p_ref: np.ndarray) -> tuple[np.ndarray, int, bool]:
        """[x; p] of the newest sample, iterations, and whether it converged; known: Rd of the first knot about zero."""
        w = np.ones((len(window.corner), WINDOW))
        given = np.concatenate([window._weighed(window.d, w).ravel("F"), window.newest, p_ref, known[:, :-1].ravel("F"), known[:, -1]])
        states = np.vstack([at.x, np.tile(at.p[:, None], WINDOW + 1)]) / self.scale_state[:, None]
        controls = np.vstack([at.inner, at.x[:, 1:]]) / self.scale_control[:, None]
        start = np.concatenate([np.vstack([states[:, :-1], controls]).ravel("F"), states[:, -1]])
        lam = np.concatenate([self.multipliers[self.each :], self.multipliers[-self.each :]])
        found = self.solver(x0=start, p=given, lam_g0=lam, lbg=0, ubg=0)
        stats = self.solver.stats()
        self.multipliers = np.array(found["lam_g"]).ravel()
        return np.array(found["x"]).ravel()[-len(self.scale_state) :] * self.scale_state, int(stats["iter_count"]), bool(stats["success"])


class Beside:
    """Wraps `Window.solve`: what it is given is also given to the programs."""

    def __init__(self, window: Window, scale: np.ndarray) -> None:
        self.window, self.own, self.scale, self.counting = window, window.solve, scale, False
        self.times: dict[str, list[float]] = {"ours": [], "ipopt": [], "fatrop": []}
        self.away: dict[str, list[float]] = {"ipopt": [], "fatrop": []}
        self.iterations: dict[str, list[int]] = {name: [] for name in self.times}
        self.failed = dict.fromkeys(self.times, 0)
        self.programs: list[Program] = []

    def solve(self, limit: int, tolerance: float) -> Any:
        """As the window does, and the programs' solves on record."""
        window, start = self.window, self.window.here
        if window.count < window.length or not self.counting:
            return self.own(limit, tolerance)
        self.programs = self.programs or [Program(window, name, self.scale) for name in self.away]
        first = window.known[0]
        known = first.about(np.zeros(window.stage.size))
        began = time.process_time()
        done = self.own(limit, tolerance)
        self._record("ours", began, done.iterations, done.converged)
        mine, half = np.concatenate([window.here.x[:, -1], window.here.p]), window.spread()[0]
        std = np.sqrt(np.sum(half**2, axis=1))
        for program in self.programs:
            began = time.process_time()
            found, iterations, converged = program.solve(window, start, known, window.here.p)
            self._record(program.name, began, iterations, converged)
            if converged and done.converged:
                self.away[program.name].append(float(np.max(np.abs(found - mine) / std)))
        return done

    def _record(self, name: str, began: float, iterations: int, converged: bool) -> None:
        self.times[name].append(1e3 * (time.process_time() - began))
        self.iterations[name].append(iterations)
        self.failed[name] += not converged


def table(case: Case, rows: int) -> None:
    """Print the lines of a case."""
    ours = Ours(case, "ours", jit=False)
    window = ours.estimator.window
    scale = {**dict(zip(case.states, case.arrival_x, strict=True)), **dict(zip(case.guesses, case.arrival_p, strict=True))}
    names = ours.estimator.names
    beside = Beside(window, np.array([scale[name] for name in (*names.states, *names.parameters)]))
    window.solve = beside.solve  # type: ignore[method-assign]
    for k in range(min(rows, len(case.run.time))):
        beside.counting = k >= SETTLED
        ours.step(k)
    print(f"\n{case.name}: window of {WINDOW}, the solves of {len(beside.times['ours'])} samples")
    print(f"{'':8s} {'median':>8s} {'p99':>8s} {'ratio':>6s} {'steps':>6s} failed  away from ours: median, p95, most")
    for name, times in beside.times.items():
        ratio = np.median(times) / np.median(beside.times["ours"])
        quantiles = " ".join(f"{t:8.2f}" for t in np.quantile(times, [0.5, 0.99]))
        away = "  ".join(f"{q:.1e}" for q in np.quantile(beside.away[name], [0.5, 0.95, 1.0])) if beside.away.get(name) else ""
        print(f"{name:8s} {quantiles} {ratio:6.1f} {np.mean(beside.iterations[name]):6.2f} {beside.failed[name]:6d}  {away}")


def main() -> None:
    """Print a table for every case that is named, or the axis: exact second derivatives of the table's stages take minutes to build."""
    for name in sys.argv[1:] or ["axis"]:
        table(CASES[name](), 300)


if __name__ == "__main__":
    main()
