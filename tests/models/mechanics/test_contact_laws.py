"""The formulas of contact: spring and damper while they press, and nothing else, however the corners are rounded."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

from backsight.models.mechanics.contact_laws import contact, play

RNG = np.random.default_rng(3)
X, RATE = RNG.uniform(-1.0, 1.0, 400), RNG.uniform(-5.0, 5.0, 400)
K, D = 50.0, 7.0


def values(law: Callable[..., Any], x: np.ndarray, rate: np.ndarray, *numbers: float) -> np.ndarray:
    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    return np.asarray(ca.Function("law", [a, b], [law(a, b, *numbers)]).map(len(x))(x, rate)).ravel()


def textbook(x: np.ndarray, rate: np.ndarray) -> np.ndarray:
    return np.where(x > 0, np.maximum(0.0, K * x + D * rate), 0.0)


def test_a_contact_presses_with_spring_and_damper_and_never_pulls() -> None:
    expected = textbook(X, RATE)
    assert np.sum((X > 0) & (expected == 0)) > 10
    assert values(contact, X, RATE, K, D, 1e-9) == pytest.approx(expected, abs=1e-6)


def test_play_is_free_within_the_gap_and_a_contact_on_both_sides() -> None:
    expected = textbook(X - 0.3, RATE) - textbook(-X - 0.3, -RATE)
    assert values(play, X, RATE, 0.6, K, D, 1e-9) == pytest.approx(expected, abs=1e-6)


def test_play_without_a_gap_and_without_damping_is_a_spring() -> None:
    assert values(play, X, RATE, 0.0, K, 0.0, 1e-9) == pytest.approx(K * X, rel=1e-9)


def test_a_contact_ends_smoothly_over_its_width() -> None:
    near = np.linspace(-5.0, 5.0, 101)
    force = values(contact, near, 0 * near, K, D, 1.0)
    assert np.all(np.diff(force) > 0)
    assert force[0] < 0.01 * force[-1] * 3
    assert force[-1] == pytest.approx(K * 5.0, rel=0.02)


@pytest.mark.parametrize("width", [1e-9, 1e-2, 1.0])
def test_a_rounded_contact_never_pulls_and_its_damping_takes_power(width: float) -> None:
    damped, resting = values(contact, X, RATE, K, D, width), values(contact, X, 0 * RATE, K, D, width)
    assert np.all(damped >= 0.0)
    assert np.all((damped - resting) * RATE >= 0.0)
