"""Ipopt on a program: options that suit it, Gauss-Newton before Newton, and what came of it in words."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from .constrained import descend_on_constraints, supported
from .feasible import start_on_constraints
from .fixed_point import FixedPoint
from .gauss_newton import FINE, descend
from .nlp import Nlp, Values
from .oracle import Oracle, no_check
from .polynomials import Array
from .solved import Options, Solved, Status

_STATUS = {
    "Solve_Succeeded": Status.SOLVED,
    "Solved_To_Acceptable_Level": Status.ACCEPTABLE,
    "Feasible_Point_Found": Status.ACCEPTABLE,
    "Maximum_Iterations_Exceeded": Status.ITERATIONS,
    "Maximum_WallTime_Exceeded": Status.ITERATIONS,
    "Infeasible_Problem_Detected": Status.INFEASIBLE,
    "User_Requested_Stop": Status.INTERRUPTED,
}


WORSE = 1e-6  # of the cost: what Ipopt's answer may cost more than that of plain steps
SENSELESS = 1e20  # per row, that a first stage has left: ten billion deviations off, where the second may stay for minutes
ON_BOUND = 1e-3  # units from a bound: what ends there ended on it


@dataclass(frozen=True)
class Solver:
    """One program made ready for Ipopt; it can be solved again and again with other numbers."""

    nlp: Nlp
    options: Options = field(default_factory=Options)

    def __getstate__(self) -> dict[str, Any]:
        """The program and the options; Ipopt is set up anew where it arrives."""
        return {"nlp": self.nlp, "options": self.options}

    def _make(self, hessian: Any, max_iterations: int, arrived: bool = False) -> Any:
        """Ipopt with this Hessian. arrived: whether it begins where plain steps ended, with nothing on a bound that is not held there."""
        ipopt: dict[str, Any] = {
            "print_level": 0,
            "sb": "yes",
            "tol": self.options.tolerance,
            # where rounding of the cost stops the line search, the answer is as good as it gets
            "acceptable_tol": 1e3 * self.options.tolerance,
            "acceptable_obj_change_tol": 1e-8,
            "acceptable_iter": 2,
            "constr_viol_tol": 1e-8,
            "max_iter": max_iterations,
            "max_wall_time": self.options.seconds,
            # the program is scaled by its own units, and the starts are good: Ipopt's rescaling and large first barrier only cost steps
            "nlp_scaling_method": "none",
            "mu_init": 1e-4,
            "bound_push": 1e-8,
            "bound_frac": 1e-8,
            "mumps_pivot_order": 5 if self.nlp.constraint_count else 7,
        }
        if arrived:  # a barrier would only lead away from there and back
            ipopt |= {"warm_start_init_point": "yes", "mu_init": 1e-9, "warm_start_mult_bound_push": 1e-12}
            ipopt |= {f"warm_start_{name}": ipopt[name] for name in ("bound_push", "bound_frac")}
        options = {
            "ipopt": ipopt,
            "print_time": False,
            "show_eval_warnings": False,
            "grad_f": self._oracle.gradient(),
            "jac_g": self._oracle.jacobian(),
            "hess_lag": hessian,
            "error_on_fail": False,
            # the sensitivity of the cost to p is asked by no one, and its gradient in X is given
            "calc_lam_p": False,
            "no_nlp_grad": True,
        }
        return ca.nlpsol("solver", "ipopt", self._oracle.program(), options)

    @cached_property
    def _oracle(self) -> Oracle:
        return Oracle(self.nlp)

    @cached_property
    def _gauss_newton(self) -> Any:
        return self._make(self._oracle.hessian(exact=False), self.options.gauss_newton_iterations)

    @cached_property
    def _last_word(self) -> Any:
        return self._make(self._oracle.hessian(exact=False), self.options.gauss_newton_iterations, arrived=True)

    @cached_property
    def _newton(self) -> Any:
        return self._make(self._oracle.hessian(exact=True), self.options.max_iterations)

    def solve(
        self,
        start: Array,
        values: Values,
        *,
        lower: Array,
        upper: Array,
        newton: bool = True,
        last_word: bool = True,
        progress: Callable[[str], None] | None = None,
        check: Callable[[], None] = no_check,
    ) -> Solved:
        """Gauss-Newton steps first; the exact Hessian takes over where they do not arrive.

        Both look for the same stationary point. Plain steps (`gauss_newton.py`, `constrained.py`) need nothing built and cost a fraction
        of Ipopt's, which ends what they began where the tolerance is fine, and goes on with exact second derivatives where they do not
        arrive. start, lower, upper (n + np,): decisions in the units of the model. newton=False: a solve on the way, Gauss-Newton steps
        only. last_word=False: Ipopt does not end what plain steps have found, and is asked where they do not arrive. check: called whenever
        Ipopt asks for something; what it raises ends the solve, and is raised again.
        """
        began, decisions = time.perf_counter(), start
        multipliers, iterations, status, cost = np.zeros(self.nlp.constraint_count), 0, Status.NUMERICS, np.inf
        if not np.all(np.isfinite(start)):
            return Solved(decisions=start, cost=np.nan, multipliers=multipliers, status=status, iterations=0, seconds=0.0)
        hopeless = min(self.options.hopeless, SENSELESS * sum(term.target.size for term in self.nlp.terms))
        at, exact, sought = self.nlp.trajectory_size + self.nlp.referred, False, FixedPoint(self.options.drift)
        near: Solved | None = None
        by_steps, kept = False, (decisions, multipliers, cost)
        for _ in range(self.options.max_passes):
            here = self.nlp.about(values, start)
            near = near if exact else self._by_steps(here, lower, upper)
            by_steps = near is not None and not exact and self._enough(near, newton, last_word)
            if by_steps and near is not None:
                answer = near
            else:
                near = near if near is None or near.status is not Status.NUMERICS else None
                lam = multipliers if near is None else near.multipliers
                answer = self._by_ipopt(self._newton if exact else self._gauss_newton, here, lower, upper, lam, near, check)
            iterations, status = iterations + answer.iterations, answer.status
            if np.all(np.isfinite(answer.decisions)):
                decisions, cost, multipliers = answer.decisions, answer.cost, answer.multipliers
            if progress is not None:
                progress(f"{'Newton' if exact else 'Gauss-Newton'}: cost {cost:.6g} after {iterations} iterations")
            start, near = decisions.copy(), None
            if status.converged and sought.dearer(cost):
                decisions, multipliers, cost = kept
                start = decisions.copy()
                start[at] = np.clip(sought.back(here.reference[at]), lower[at], upper[at])
            elif status.converged:
                kept = decisions, multipliers, cost
                if sought.reached(here.reference[at], decisions[at], cost):
                    break
                start[at] = np.clip(sought.next(), lower[at], upper[at])
            elif status is Status.INTERRUPTED or exact or not newton or cost > hopeless:
                break
            else:
                # on from where the steps ended, the terms referred to what was sought and not to that
                exact, near, start[at] = True, replace(answer, iterations=0), here.reference[at]
        return Solved(
            decisions=decisions,
            cost=cost,
            multipliers=multipliers,
            status=status,
            iterations=iterations,
            seconds=time.perf_counter() - began,
            on_bound=self._on_bound(decisions, lower, upper, values),
            by_steps=by_steps,
        )

    def ended(
        self,
        solved: Solved,
        values: Values,
        *,
        lower: Array,
        upper: Array,
        progress: Callable[[str], None] | None = None,
        check: Callable[[], None] = no_check,
    ) -> Solved:
        """What plain steps have found, with the last word from Ipopt; with exact second derivatives where it does not agree.

        What is on a bound stays there: an interior point would be next to it, and had a deviation. Where Ipopt arrives nowhere, or at what
        costs more, the answer is that of the plain steps, which had converged.
        """
        began, held, answer = time.perf_counter(), list(solved.on_bound), solved
        free = lower, upper
        lower, upper = lower.copy(), upper.copy()
        lower[held] = upper[held] = solved.decisions[held]
        for exact in (False, True):
            found = self._by_ipopt(self._newton if exact else self._last_word, values, lower, upper, solved.multipliers, solved, check)
            if progress is not None:
                progress(f"Ipopt: cost {found.cost:.6g} after {found.iterations} iterations")
            if found.status is Status.INTERRUPTED:
                return found
            # a point that costs more than rounding is another one
            if found.status.converged and found.cost <= solved.cost + WORSE * max(abs(solved.cost), 1.0):
                answer = found
                break
        seconds = solved.seconds + time.perf_counter() - began
        there = tuple(sorted({*held, *self._on_bound(answer.decisions, *free, values)}))
        return replace(answer, seconds=seconds, on_bound=there)

    def _on_bound(self, decisions: Array, lower: Array, upper: Array, values: Values) -> tuple[int, ...]:
        """Decisions within a thousandth of their unit from one of their bounds, of the smaller of what it was and of what it is here.

        Where a solve began the cost may not have seen a parameter at all, of a state that did not move yet: its unit is huge there.
        """
        apart = np.minimum(decisions - lower, upper - decisions)
        near = np.flatnonzero(apart < ON_BOUND * values.unit)
        if np.any(apart[near] > 0):  # what lies on a bound exactly needs no unit, as first states that are known
            diagonal = self.weights(decisions, replace(values, unit=np.ones_like(values.unit)))[near]
            near = near[diagonal * np.maximum(apart[near], 0.0) ** 2 < ON_BOUND**2]
        return tuple(near.tolist())

    def _enough(self, near: Solved, newton: bool, last_word: bool) -> bool:
        """Whether plain steps are all that is asked for: on the way, to a rough tolerance, or where only exact ones can lead on."""
        if near.status is Status.NUMERICS:
            return False
        if not newton:
            return True
        if near.status.converged:
            return not last_word or self.options.tolerance > FINE
        return self.nlp.constraint_count > 0

    def _by_ipopt(
        self, solver: Any, here: Values, lower: Array, upper: Array, multipliers: Array, near: Solved | None, check: Callable[[], None]
    ) -> Solved:
        """near: where plain steps arrived, which cost a fraction of Ipopt's."""
        low, high = here.scaled(lower), here.scaled(upper)
        with self._oracle.answering(here, check):
            answer = solver(
                x0=start_on_constraints(self.nlp, here, low, high) if near is None else here.scaled(near.decisions),
                lbx=low,
                ubx=high,
                lbg=0.0,
                ubg=0.0,
                lam_g0=multipliers,
            )
        stats, X = solver.stats(), np.asarray(answer["x"], dtype=np.float64).ravel()
        status = Status.INTERRUPTED if self._oracle.interrupted else _STATUS.get(stats["return_status"], Status.NUMERICS)
        failed = status in (Status.NUMERICS, Status.INTERRUPTED)  # Ipopt's own cost is 0 where the start is no number
        return Solved(
            decisions=here.decisions(X),
            cost=self.nlp.evaluated.cost(X, here) if failed else float(answer["f"]),
            multipliers=np.asarray(answer["lam_g"], dtype=np.float64).ravel(),
            status=status,
            iterations=int(stats["iter_count"]) + (near.iterations if near is not None else 0),
            seconds=0.0,
        )

    def _by_steps(self, here: Values, lower: Array, upper: Array) -> Solved | None:
        """Plain steps need no barriers and nothing built; None where bounds of trajectories ask for these."""
        low, high, options = here.scaled(lower), here.scaled(upper), self.options
        if not self.nlp.constraint_count:
            found = descend(self.nlp, here, low, high, options.tolerance, options.gauss_newton_iterations, options.seconds)
        elif supported(self.nlp, low, high):
            found = descend_on_constraints(self.nlp, here, low, high, options.tolerance, options.gauss_newton_iterations, options.seconds)
        else:
            return None
        usual = Status.SOLVED if found.solved else Status.ACCEPTABLE if found.acceptable else Status.ITERATIONS
        return Solved(
            decisions=here.decisions(found.X),
            cost=found.cost,
            multipliers=found.multipliers,
            status=usual if found.finite else Status.NUMERICS,
            iterations=found.iterations,
            seconds=0.0,
        )

    def hessian(self, decisions: Array, values: Values) -> tuple[sp.csc_matrix, sp.csc_matrix]:
        """Upper triangle of the Gauss-Newton Hessian and the Jacobian of the constraints, in the program's units."""
        evaluated, X = self.nlp.evaluated, values.scaled(decisions)
        parts = [evaluated.linearised(k, X, values) for k, term in enumerate(self.nlp.terms) if not term.equality]
        return evaluated.upper(evaluated.squares(parts)), self.jacobian(decisions, values)

    def exact_hessian(self, solved: Solved, values: Values) -> sp.csc_matrix:
        """Upper triangle of the Hessian of the Lagrangian at what a solve gave, in the program's units."""
        evaluated, X = self.nlp.evaluated, values.scaled(solved.decisions)
        parts = [evaluated.linearised(k, X, values) for k in range(len(self.nlp.terms))]
        entries = evaluated.upper_entries(parts, X, values, 1.0, solved.multipliers, exact=True)
        return sp.csc_matrix((entries, evaluated.upper_places(exact=True)), shape=(self.nlp.size,) * 2)

    def weights(self, decisions: Array, values: Values) -> Array:
        """Diagonal of the Gauss-Newton Hessian, (n + np,)."""
        evaluated, X = self.nlp.evaluated, values.scaled(decisions)
        return evaluated.diagonal([evaluated.linearised(k, X, values) for k, term in enumerate(self.nlp.terms) if not term.equality])

    def kkt(self, decisions: Array, values: Values, without: Collection[int] = ()) -> tuple[sp.csc_matrix, sp.csc_matrix, Array]:
        """H (upper triangle), J and d (rows of J,) of the Gauss-Newton KKT matrix [H J'; J -diag(d)], in the program's units.

        Constraints have d = 0. A heavy term has its rows r among those of J, with multipliers of their own, r = J dX = d lambda: squares
        of numbers that differ by ten decades would leave nothing of the small ones. without: numbers of terms that H does not have.
        """
        evaluated, X, terms = self.nlp.evaluated, values.scaled(decisions), self.nlp.terms
        parts = [evaluated.linearised(k, X, values) for k in range(len(terms)) if k not in without]
        apart = [terms[part.number].equality or terms[part.number].heavy for part in parts]
        H = evaluated.upper(evaluated.squares([part for part, own in zip(parts, apart, strict=True) if not own]))
        J = evaluated.jacobian([part for part, own in zip(parts, apart, strict=True) if own])
        heavy = np.concatenate(
            [np.full(t.target.size, t.heavy) for t in self.nlp.terms if t.equality or t.heavy] or [np.empty(0, dtype=bool)]
        )
        size = abs(J).max(axis=1).toarray().ravel() if J.shape[0] else np.empty(0)
        size = np.where(heavy & (size > 0), size, 1.0)
        return H, sp.csc_matrix(sp.diags(1.0 / size) @ J), np.where(heavy, size**-2.0, 0.0)

    def jacobian(self, decisions: Array, values: Values) -> sp.csc_matrix:
        """The Jacobian of the constraints, in the program's units."""
        evaluated, X = self.nlp.evaluated, values.scaled(decisions)
        return evaluated.jacobian([evaluated.linearised(k, X, values) for k, term in enumerate(self.nlp.terms) if term.equality])

    def rows(self, decisions: Array, values: Values) -> list[Array]:
        """The rows r = (m - target) * scale of every term, each (K m, C)."""
        return self.nlp.evaluated.rows(values.scaled(decisions), values)

    def jacobian_of_rows(self, number: int, decisions: Array, values: Values) -> Array:
        """Derivative of term `number`'s values m (not scaled) in the local unknowns and parameters, (C, K m, local + np)."""
        return self.nlp.evaluated.derivative(number, values.scaled(decisions), values)
