"""The formulas of friction: the textbook where the corner is sharp, dissipation at every rounding."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from backsight.models.mechanics import friction_laws as laws

V = np.concatenate([-np.geomspace(10.0, 1e-4, 40), np.geomspace(1e-4, 10.0, 40)])
SHARP = 1e-9
WIDTHS = (1e-8, 1e-3, 0.1, 10.0)


def values(law: Callable[..., Any], v: np.ndarray, *numbers: float) -> np.ndarray:
    x = ca.SX.sym("x")
    return np.asarray(ca.Function("law", [x], [law(x, *numbers)]).map(len(v))(v)).ravel()


def asymmetric(v: Any, plus: float, minus: float, width: float) -> Any:
    return laws.one_of_two(v, plus, minus, width) * v + laws.coulomb(v, laws.one_of_two(v, minus, plus, width), width)


def stribeck(v: Any, f_c: float, f_s: float, v_s: float, width: float) -> Any:
    return laws.coulomb(v, laws.stribeck_level(v, f_c, f_s, v_s), width)


def test_coulomb_friction_is_its_level_in_the_direction_of_motion() -> None:
    assert values(laws.coulomb, V, 3.0, SHARP) == pytest.approx(3.0 * np.sign(V))


def test_friction_of_stribeck_falls_from_rest_to_the_coulomb_level() -> None:
    expected = np.sign(V) * (2.0 + 1.5 * np.exp(-((V / 0.05) ** 2)))
    assert values(stribeck, V, 2.0, 3.5, 0.05, SHARP) == pytest.approx(expected)
    assert abs(expected).max() == pytest.approx(3.5, rel=1e-4)


def test_logarithmic_friction_is_as_measured_above_its_dead_velocity_and_nothing_below() -> None:
    b, c, v0, dead = 2.0, 15.0, 0.0254, 2.54e-3
    expected = np.where(np.abs(V) >= dead, np.sign(V) * (b * np.log(np.abs(V) / v0) + c), 0.0)
    assert values(laws.logarithmic, V, b, c, v0, dead, SHARP) == pytest.approx(expected, rel=1e-9)


def test_asymmetric_friction_takes_the_coefficients_of_its_direction() -> None:
    expected = np.where(V > 0, 2.0 * V + 5.0, 5.0 * V - 2.0)
    assert values(asymmetric, V, 2.0, 5.0, SHARP) == pytest.approx(expected)


def test_drag_is_linear_and_quadratic_against_the_motion() -> None:
    assert values(laws.drag, V, 2.0, 3.0) == pytest.approx(2.0 * V + 3.0 * V**2 * np.sign(V))


def test_the_size_of_a_load_is_rounded_from_below_and_zero_at_zero() -> None:
    found = values(laws.magnitude, V, 0.5)
    assert np.all(found >= 0)
    assert np.all(found <= np.abs(V))
    assert values(laws.magnitude, np.array([0.0]), 0.5).tolist() == [0.0]
    assert values(laws.magnitude, V, SHARP) == pytest.approx(np.abs(V), abs=2e-9)


def test_stick_slip_slides_at_one_level_and_breaks_away_at_the_other() -> None:
    assert values(laws.stick_slip, V, 0.4, 0.6, SHARP) == pytest.approx(0.4 * np.sign(V))
    v = ca.SX.sym("v")
    law = ca.Function("law", [v], [laws.stick_slip(v, 0.4, 0.6, 0.02)])
    peak = minimize_scalar(lambda x: -float(law(x)), bounds=(1e-4, 0.1), method="bounded", options={"xatol": 1e-10})
    assert -peak.fun == pytest.approx(0.6, rel=1e-6)
    assert peak.x == pytest.approx(0.02, rel=1e-3)
    rising = values(laws.stick_slip, np.linspace(-0.02, 0.02, 401), 0.4, 0.6, 0.02)
    assert np.all(np.diff(rising)[:-1] > 0)  # so that every torque below the peak holds a body at less than one width


def test_a_breakaway_below_the_sliding_level_holds_no_less_than_the_sliding_level() -> None:
    fast = np.linspace(0.0, 10 * 0.02, 2001)
    assert values(laws.stick_slip, fast, 0.4, 0.1, 0.02).max() == pytest.approx(0.4, rel=1e-3)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize(
    ("law", "numbers"),
    [
        (laws.coulomb, (3.0,)),
        (stribeck, (2.0, 3.5, 0.05)),
        (stribeck, (3.0, 0.0, 0.05)),
        (laws.logarithmic, (2.0, 2.0 * np.log(10.0), 0.0254, 2.54e-3)),
        (laws.logarithmic, (0.0, 2.0, 0.0254, 2.54e-3)),
        (asymmetric, (2.0, 0.0)),
        (laws.stick_slip, (0.4, 0.6)),
        (laws.stick_slip, (0.4, 0.0)),
        (laws.stick_slip, (0.0, 0.6)),
    ],
)
def test_a_law_takes_power_at_every_width_and_every_velocity(law: Callable[..., Any], numbers: tuple[float, ...], width: float) -> None:
    v = np.concatenate([V, width * np.linspace(-6.0, 6.0, 301)])
    assert np.all(values(law, v, *numbers, width) * v >= 0.0)


def test_bristles_bend_to_the_level_of_steady_sliding() -> None:
    rate = values(lambda v: laws.bristle_rate(v, 2e-5 * ca.sign(v), 1e5, 2.0, SHARP), V)
    assert rate == pytest.approx(np.zeros(len(V)), abs=1e-12)


def test_the_damping_of_bristles_is_as_given_at_rest_and_bounded_at_speed() -> None:
    assert values(laws.bristle_damping, np.array([0.0]), 300.0, 2.0, SHARP).tolist() == [300.0]
    damping = values(laws.bristle_damping, V, 300.0, 2.0, SHARP)
    assert np.all(damping * np.abs(V) <= 4 * 2.0)


def test_a_level_that_changes_along_the_way_never_gets_negative() -> None:
    s = np.linspace(-1.0, 1.0, 1001)
    level = values(laws.wavy_level, s, 2.0, 1.0, 0.3, 0.4)
    assert level == pytest.approx(2.0 + 2.0 * np.sin(2 * np.pi / 0.3 * s + 0.4))
    assert level.min() >= 0.0
