"""How a solve ends, in words and numbers."""

from __future__ import annotations

import os
import signal
import threading
from dataclasses import replace

import numpy as np
import pytest
from examples import compiled, number, random_horizon, stiffening

from backsight.ocp import Options, ParameterPrior, Solved, Solver, Status, transcribe
from backsight.ocp.fixed_point import FixedPoint
from backsight.ocp.nlp import Values
from backsight.ocp.oracle import Oracle

DAE = compiled(stiffening())
PARAMETERS = np.array([p.value for p in DAE.parameters])


def solve(
    options: Options | None = None, *, newton: bool = True, upper_mass: float = np.inf, start: float = 0.1, progress=None
) -> tuple[Solver, Solved]:
    h = random_horizon(DAE, 0, intervals=3)
    prior = ParameterPrior(mean=np.array([2.0]), std=np.array([1.0]))
    t = transcribe(DAE, [h], free=number(DAE, "mass.m"), prior=prior, force_std={0: 2.0})
    solver, x = Solver(t.nlp, options or Options()), np.full(t.nlp.size, start)
    x[-1] = 1.0
    lower, upper = np.full(t.nlp.size, -np.inf), np.full(t.nlp.size, np.inf)
    lower[-1], upper[-1] = 0.1, upper_mass
    return solver, solver.solve(x, t.nlp.values(PARAMETERS), lower=lower, upper=upper, newton=newton, progress=progress)


def slope(solver: Solver, values: Values, decisions: np.ndarray) -> float:
    """Gradient of the Lagrangian over its largest part, with the multipliers that make it least."""
    evaluated, here = solver.nlp.evaluated, values.scaled(decisions)
    squares = [evaluated.linearised(k, here, values) for k, term in enumerate(solver.nlp.terms) if not term.equality]
    gradient, jacobian = evaluated.gradient(squares), solver.jacobian(decisions, values).toarray()
    multipliers = np.linalg.lstsq(jacobian.T, -gradient, rcond=None)[0]
    size = np.linalg.norm(jacobian) * np.linalg.norm(multipliers) + np.linalg.norm(gradient)
    return float(np.linalg.norm(gradient + jacobian.T @ multipliers) / size)


def test_a_solution_is_a_stationary_point_on_the_constraints():
    # the reference parameters must have come to rest as well
    solver, solved = solve(Options(drift=1e-8, max_passes=20))
    assert solved.status.converged
    values = solver.nlp.about(solver.nlp.values(PARAMETERS), solved.decisions)
    evaluated, here = solver.nlp.evaluated, np.zeros(solver.nlp.size)
    assert slope(solver, values, solved.decisions) < 1e-5
    assert np.abs(evaluated.constraints(here, values)).max() < 1e-6
    assert solved.cost == pytest.approx(evaluated.cost(here, values), rel=1e-6)


def test_exact_steps_go_on_with_the_terms_referred_to_what_was_sought():
    """Two passes: Gauss-Newton steps that do not arrive, and exact ones. The mass that was sought is that of the start."""
    solver, solved = solve(Options(gauss_newton_iterations=1, tolerance=1e-10, max_passes=2))
    assert solved.status.converged
    begun = np.full(solver.nlp.size, 0.1)
    begun[-1] = 1.0
    assert slope(solver, solver.nlp.about(solver.nlp.values(PARAMETERS), begun), solved.decisions) < 1e-6


@pytest.mark.parametrize(
    "options", [Options(gauss_newton_iterations=0, max_iterations=0), Options(gauss_newton_iterations=1, max_iterations=1, tolerance=1e-12)]
)
def test_the_limit_of_iterations_is_a_status_and_the_numbers_are_finite(options):
    _, solved = solve(options)
    assert solved.status is Status.ITERATIONS
    assert not solved.status.converged
    assert np.all(np.isfinite(solved.decisions))
    assert np.isfinite(solved.cost)
    assert solved.iterations <= 2


@pytest.mark.parametrize("start", [np.nan, 1e200])  # the latter where rows are beyond all numbers
def test_numbers_that_are_not_finite_are_a_status_and_no_exception_and_cost_more_than_any(start):
    with np.errstate(over="ignore", invalid="ignore"):
        _, solved = solve(start=start)
    assert solved.status is Status.NUMERICS
    assert not solved.status.converged
    assert not np.isfinite(solved.cost)


def test_a_bound_is_kept():
    _, free = solve()
    _, bound = solve(upper_mass=free.decisions[-1] * 0.9)
    assert bound.status.converged
    assert bound.decisions[-1] == pytest.approx(free.decisions[-1] * 0.9, rel=1e-4)
    assert bound.cost >= free.cost


def test_the_last_word_leaves_on_its_bound_what_plain_steps_have_found_there():
    h = random_horizon(DAE, 0, intervals=3)
    prior = ParameterPrior(mean=np.array([2.0]), std=np.array([1.0]))
    t = transcribe(DAE, [h], free=number(DAE, "mass.m"), prior=prior, force_std={0: 2.0})
    solver, x = Solver(t.nlp), np.full(t.nlp.size, 0.1)
    lower, upper = np.full(t.nlp.size, -np.inf), np.full(t.nlp.size, np.inf)
    lower[-1], upper[-1] = 0.1, 0.9 * solve()[1].decisions[-1]
    x[-1] = 1.0
    plain = solver.solve(x, t.nlp.values(PARAMETERS), lower=lower, upper=upper, last_word=False)
    assert plain.by_steps
    ended = solver.ended(plain, t.nlp.about(t.nlp.values(PARAMETERS), plain.decisions), lower=lower, upper=upper)
    assert ended.status.converged
    assert not ended.by_steps
    assert ended.decisions[-1] == plain.decisions[-1] == upper[-1]
    assert t.nlp.size - 1 in ended.on_bound
    np.testing.assert_allclose(ended.decisions, plain.decisions, rtol=1e-4, atol=1e-5)


def test_what_the_cost_did_not_see_where_a_solve_began_is_not_on_a_bound_that_it_is_far_from():
    """A unit of a hundred thousand, as that of a parameter without effect has: its bound is a tenth of the answer away."""
    h = random_horizon(DAE, 0, intervals=3)
    prior = ParameterPrior(mean=np.array([2.0]), std=np.array([1.0]))
    t = transcribe(DAE, [h], free=number(DAE, "mass.m"), prior=prior, force_std={0: 2.0})
    values = t.nlp.values(PARAMETERS)
    blind = replace(values, unit=np.where(np.arange(t.nlp.size) == t.nlp.size - 1, 1e5, values.unit))
    lower, upper = np.full(t.nlp.size, -np.inf), np.full(t.nlp.size, np.inf)
    answer = solve()[1].decisions[-1]
    for low, on_it in ((0.9 * answer, False), (1.1 * answer, True)):
        lower[-1], x = low, np.full(t.nlp.size, 0.1)
        x[-1] = 1.2 * answer
        found = Solver(t.nlp).solve(x, blind, lower=lower, upper=upper, newton=False)
        assert found.decisions[-1] == pytest.approx(max(answer, low), rel=0.02)
        assert (t.nlp.size - 1 in found.on_bound) is on_it


def test_progress_tells_each_stage():
    told: list[str] = []
    solve(Options(gauss_newton_iterations=1, tolerance=1e-10), progress=told.append)
    stages = [line.split(":")[0] for line in told]
    assert stages[0] == "Gauss-Newton"
    assert set(stages[1:]) == {"Newton"}
    told.clear()
    solve(Options(gauss_newton_iterations=1, tolerance=1e-10), newton=False, progress=told.append)
    assert [line.split(":")[0] for line in told] == ["Gauss-Newton"]


def test_every_status_is_a_sentence_and_two_of_them_are_good():
    assert all(s.value.endswith(".") and s.value[0].isupper() for s in Status)
    assert {s for s in Status if s.converged} == {Status.SOLVED, Status.ACCEPTABLE}


def test_the_same_program_gives_the_same_bits():
    one, two = solve()[1], solve()[1]
    assert np.array_equal(one.decisions, two.decisions)
    assert np.array_equal(one.multipliers, two.multipliers)


@pytest.mark.parametrize("slope", [-1.0, -3.0, 0.5, -0.2])  # of answers over what they are referred to: to and fro, away, on one side
def test_a_fixed_point_is_found_however_the_answers_go_about_it(slope):
    truth, p, sought = np.array([2.0, 0.05]), np.array([2.4, 0.06]), FixedPoint(1e-6)
    for count in range(40):  # noqa: B007
        answer = truth + slope * (p - truth)
        if sought.reached(p, answer, 1.0):
            break
        p = sought.next()
    assert np.allclose(answer, truth, rtol=1e-5)
    assert count <= (25 if slope > 0 else 10)


def test_a_step_to_where_the_answers_are_no_good_is_taken_back():
    truth, p, sought = np.array([2.0]), np.array([2.4]), FixedPoint(1e-6)
    costs = []
    for _ in range(40):
        good = p > 1.9  # below, the program falls into another basin, far off and dear
        answer, cost = (truth - 2.0 * (p - truth), 100.0) if good else (np.array([50.0]), 1e8)
        costs.append(cost)
        if sought.dearer(cost):
            p = sought.back(p)
            continue
        if sought.reached(p, answer, cost):
            break
        p = sought.next()
    assert np.allclose(answer, truth, rtol=1e-5)
    assert costs.count(1e8) == 1  # the first whole step


def test_a_solve_that_may_take_no_time_stops_at_a_limit_and_its_numbers_are_finite():
    _, solved = solve(Options(seconds=1e-9))
    assert solved.status is Status.ITERATIONS
    assert np.all(np.isfinite(solved.decisions))


def test_an_interrupt_inside_a_function_that_ipopt_calls_ends_the_solve_and_the_next_one_begins_anew(monkeypatch):
    h = random_horizon(DAE, 0, intervals=20)
    prior = ParameterPrior(mean=np.array([2.0]), std=np.array([1.0]))
    t = transcribe(DAE, [h], free=number(DAE, "mass.m"), prior=prior, force_std={0: 2.0})
    solver, x = Solver(t.nlp, Options()), np.full(t.nlp.size, 0.1)
    x[-1] = 1.0
    wide = np.full(t.nlp.size, np.inf)
    calls, own = iter(range(1000)), Oracle._at

    def interrupted(self, X):
        if next(calls) == 2:
            raise KeyboardInterrupt
        return own(self, X)

    monkeypatch.setattr(Oracle, "_at", interrupted)
    solved = solver.solve(x, t.nlp.values(PARAMETERS), lower=-wide, upper=wide)
    assert solved.status is Status.INTERRUPTED
    assert next(calls) < 10
    again = solver.solve(x, t.nlp.values(PARAMETERS), lower=-wide, upper=wide)
    assert again.status is not Status.INTERRUPTED
    assert again.iterations > 3


def test_a_check_ends_a_solve_at_an_evaluation_and_what_it_raised_is_raised():
    """Ipopt's own limit of time is one of every call, and asked between iterations."""
    h = random_horizon(DAE, 0, intervals=20)
    prior = ParameterPrior(mean=np.array([2.0]), std=np.array([1.0]))
    t = transcribe(DAE, [h], free=number(DAE, "mass.m"), prior=prior, force_std={0: 2.0})
    solver, x = Solver(t.nlp, Options()), np.full(t.nlp.size, 0.1)
    x[-1] = 1.0
    wide, calls = np.full(t.nlp.size, np.inf), list[int]()

    def check() -> None:
        calls.append(len(calls))
        if len(calls) > 3:
            raise TimeoutError("late")

    with pytest.raises(TimeoutError, match="late"):
        solver.solve(x, t.nlp.values(PARAMETERS), lower=-wide, upper=wide, check=check)
    assert len(calls) == 4
    solver._oracle.check()  # it is gone with its solve: what is asked later is not late
    assert len(calls) == 4
    assert solver.solve(x, t.nlp.values(PARAMETERS), lower=-wide, upper=wide).status.converged


def test_a_signal_while_ipopt_works_interrupts_the_solve_wherever_it_comes():
    h = random_horizon(DAE, 0, intervals=400)
    prior = ParameterPrior(mean=np.array([2.0]), std=np.array([1.0]))
    t = transcribe(DAE, [h], free=number(DAE, "mass.m"), prior=prior, force_std={0: 2.0})
    solver, x = Solver(t.nlp, Options(gauss_newton_iterations=0, tolerance=1e-300, max_iterations=3000)), np.full(t.nlp.size, 0.1)
    x[-1] = 1.0
    wide = np.full(t.nlp.size, np.inf)
    late = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # in the background of a shell it is ignored
    late.start()
    try:
        solved = solver.solve(x, t.nlp.values(PARAMETERS), lower=-wide, upper=wide)
    except KeyboardInterrupt:
        return  # it came between two calls
    finally:
        late.join()
        after = signal.signal(signal.SIGINT, before)
    assert solved.status is Status.INTERRUPTED
    assert after is signal.default_int_handler


def test_an_error_inside_a_function_that_ipopt_calls_is_raised_and_no_status(monkeypatch):
    solver, _ = solve()

    def wrong(self, X):
        raise ValueError("a bug")

    monkeypatch.setattr(Oracle, "_at", wrong)
    values, x, wide = solver.nlp.values(PARAMETERS), np.full(solver.nlp.size, 0.1), np.full(solver.nlp.size, np.inf)
    with pytest.raises(ValueError, match="a bug"):
        solver.solve(x, values, lower=-wide, upper=wide)
