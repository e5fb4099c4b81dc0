"""The Radau IIA method: its tableau and its measured order."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from backsight.models.simulation.radau import STAGES, Step, Stepper, System, tableau


def test_the_three_stage_tableau_is_the_published_one() -> None:
    c, a, _ = tableau(3)  # Hairer and Wanner, table IV.5.6
    r = np.sqrt(6.0)
    assert c == pytest.approx([(4 - r) / 10, (4 + r) / 10, 1.0])
    assert a == pytest.approx(
        np.array(
            [
                [(88 - 7 * r) / 360, (296 - 169 * r) / 1800, (-2 + 3 * r) / 225],
                [(296 + 169 * r) / 1800, (88 + 7 * r) / 360, (-2 - 3 * r) / 225],
                [(16 - r) / 36, (16 + r) / 36, 1 / 9],
            ]
        )
    )


def test_the_quadrature_of_five_stages_is_exact_to_degree_eight() -> None:
    c, a, error = tableau(STAGES)
    for degree in range(2 * STAGES - 1):
        assert a[-1] @ c**degree == pytest.approx(1.0 / (degree + 1), rel=1e-12)
    for degree in range(STAGES):  # the error weights vanish on what both quadratures integrate
        assert error @ np.concatenate([[0.0**degree], c**degree]) == pytest.approx(0.0, abs=1e-13)


def oscillator(x: ca.SX, v: ca.SX, dx: ca.SX) -> list[ca.SX]:
    return [dx[0] - v, dx[1] + x]


def pendulum(x: ca.SX, v: ca.SX, dx: ca.SX) -> list[ca.SX]:
    return [dx[0] - v, dx[1] + ca.sin(x)]


def step(equations: Callable[..., list[ca.SX]], start: tuple[float, float], h: float) -> Step:
    dx, x, none = ca.SX.sym("dx", 2), ca.SX.sym("x", 2), ca.SX(0, 1)
    watched = ca.vertcat(x[0] + 10)
    rows = ca.vertcat(*equations(x[0], x[1], dx))
    system = System(residual=rows, dx=dx, x=x, z=none, u=none, t=ca.SX.sym("t"), m=none, positive=watched)
    stepper = Stepper(system, np.ones(2), rtol=1e-10)
    empty = np.zeros(0)
    found = stepper.rate(np.array(start), empty, empty, 0.0, empty)
    assert found is not None
    done = stepper.attempt(np.array(start), empty, found[0], 0.0, h, 0.0, empty, empty, empty, np.abs(start))
    assert done is not None
    return done


def test_one_step_is_of_order_nine() -> None:
    errors = [np.abs(step(oscillator, (1.0, 0.0), h).x - [np.cos(h), -np.sin(h)]).max() for h in (2.0, 1.0)]
    assert 9.0 < np.log2(errors[0] / errors[1]) < 11.0


def test_a_nonlinear_step_is_right_to_the_tolerance_that_it_reports() -> None:
    done = step(pendulum, (1.0, 0.5), 0.08)
    truth = solve_ivp(lambda _, q: [q[1], -np.sin(q[0])], (0.0, 0.08), [1.0, 0.5], method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    assert done.error < 1.0
    assert done.x == pytest.approx(truth, abs=1e-11)
    assert done.rate == pytest.approx([truth[1], -np.sin(truth[0])], abs=1e-10)


def test_the_functions_that_stay_positive_are_read_at_the_start_and_at_the_stages() -> None:
    done = step(oscillator, (1.0, 0.0), 0.5)
    nodes = np.concatenate([[0.0], tableau(STAGES)[0]])
    assert done.positive[0] == pytest.approx(10 + np.cos(0.5 * nodes), abs=1e-6)
    assert done.clear > 0.0
