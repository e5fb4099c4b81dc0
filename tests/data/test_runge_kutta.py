"""The formula of fifth order against closed forms."""

import numpy as np
import pytest

from backsight.data.generators.runge_kutta import A, B, C, advance, step


def test_the_coefficients_fulfil_the_conditions_of_order_one_to_five_for_quadrature() -> None:
    assert [float(B @ np.array(C) ** k) for k in range(5)] == pytest.approx([1, 1 / 2, 1 / 3, 1 / 4, 1 / 5], abs=1e-15)
    assert [float(a.sum()) for a in A] == pytest.approx(C, abs=1e-14)


def test_the_error_falls_with_the_fifth_power_of_the_step() -> None:
    """x'' = -x, the harmonic oscillator, after a turn and a half."""
    errors = []
    for steps in (20, 40, 80):
        y = advance(lambda _, y: np.array([y[1], -y[0]]), 0.0, np.array([1.0, 0.0]), 3 * np.pi, steps)
        errors.append(float(np.linalg.norm(y - [-1.0, 0.0])))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx([5, 5], abs=0.3)


def test_one_step_is_exact_for_polynomials_of_time_of_the_fifth_degree() -> None:
    y = step(lambda t, _: np.array([5 * t**4, 2 * t]), 1.0, np.array([1.0, 1.0]), 0.7)
    assert y == pytest.approx([1.7**5, 1.7**2], rel=1e-14)
