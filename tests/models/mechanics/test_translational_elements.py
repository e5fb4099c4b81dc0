"""Springs, dampers, drag, stops and cogging against solutions by hand."""

import numpy as np
import pytest
from one_dimensional import T, run_body
from scipy.special import ellipj, ellipk

from backsight.models import Model, compile_model, simulate
from backsight.models.mechanics.translational import Cogging, CubicSpring, Damper, Drag, EndStop, LowerEndStop, Mass, Spring, SpringDamper


def test_a_spring_swings_a_mass_harmonically_about_its_natural_length() -> None:
    result = run_body(Spring(k=50.0, s_rel0=0.3), s=0.5)
    assert result.states["body.s"] == pytest.approx(0.3 + 0.2 * np.cos(5.0 * T), rel=1e-8)


def test_a_spring_and_a_mass_keep_their_energy() -> None:
    result = run_body(Spring(k=50.0), s=0.5, v=-1.0)
    energy = 0.5 * 2.0 * result.states["body.v"] ** 2 + 0.5 * 50.0 * result.states["body.s"] ** 2
    assert energy == pytest.approx(np.full(len(T), 7.25), rel=1e-9)


def test_a_cubic_spring_swings_a_mass_as_an_elliptic_cosine() -> None:
    stiffness, cubic, swing = 8.0, 40.0, 0.5  # per kg: x'' + a x + b x^3 = 0, x = swing cn(w t, m) with w^2 = a + b swing^2
    result = run_body(CubicSpring(k=2.0 * stiffness, k3=2.0 * cubic, s_rel0=0.1), s=0.1 + swing)
    rate2 = stiffness + cubic * swing**2
    _, cn, _, _ = ellipj(np.sqrt(rate2) * T, cubic * swing**2 / (2 * rate2))
    assert result.states["body.s"] == pytest.approx(0.1 + swing * cn, rel=1e-7, abs=1e-9)


def test_a_damper_lets_the_velocity_decay_exponentially() -> None:
    result = run_body(Damper(d=6.0), v=3.0)
    assert result.states["body.v"] == pytest.approx(3.0 * np.exp(-3.0 * T), rel=1e-9)
    assert result.states["body.s"] == pytest.approx(1.0 - np.exp(-3.0 * T), abs=1e-10)


def test_a_spring_with_damping_gives_a_damped_swing() -> None:
    decay, swing = 1.5, np.sqrt(36.0 - 1.5**2)
    expected = 0.5 * np.exp(-decay * T) * (np.cos(swing * T) + decay / swing * np.sin(swing * T))
    assert run_body(SpringDamper(k=72.0, d=6.0), s=0.5).states["body.s"] == pytest.approx(expected, rel=1e-7, abs=1e-10)


def test_quadratic_drag_slows_a_body_hyperbolically() -> None:
    result = run_body(Drag(c=3.0), v=-4.0)
    assert result.states["body.v"] == pytest.approx(-4.0 / (1 + 3.0 * 4.0 / 2.0 * T), rel=1e-9)


def test_a_driven_body_settles_where_linear_and_quadratic_drag_take_its_force() -> None:
    assert run_body(Drag(d=4.0, c=3.0), force=55.0).states["body.v"][-1] == pytest.approx((-4.0 + np.sqrt(16.0 + 660.0)) / 6.0, rel=1e-7)


def test_two_masses_on_a_spring_beat_at_their_reduced_mass_and_keep_momentum() -> None:
    model = Model(
        name="pair",
        components={"a": Mass(m=2.0), "spring": Spring(k=60.0), "b": Mass(m=3.0)},
        connections=[("a.flange", "spring.flange_a"), ("spring.flange_b", "b.flange")],
        outputs={"gap": "spring.s_rel"},
    )
    result = simulate(compile_model(model), T, initial={"a.s": 0.2})
    assert result.outputs["gap"] == pytest.approx(0.2 * np.cos(np.sqrt(60.0 / 1.2) * T), rel=1e-8, abs=1e-12)
    assert 2.0 * result.states["a.v"] + 3.0 * result.states["b.v"] == pytest.approx(np.zeros(len(T)), abs=1e-11)


def test_an_end_stop_turns_a_body_back_after_half_a_swing() -> None:
    stiffness, speed, away = 2.0e4, 0.5, 0.2  # 100 rad/s in contact
    result = run_body(EndStop(x=0.3, k=stiffness), s=0.3 - away, v=speed)
    arrives, leaves = away / speed, away / speed + np.pi / 100.0
    expected = np.where(
        arrives >= T,
        0.3 - away + speed * T,
        np.where(leaves <= T, 0.3 - speed * (T - leaves), 0.3 + speed / 100.0 * np.sin(100.0 * (T - arrives))),
    )
    assert result.states["body.s"] == pytest.approx(expected, abs=1e-6)


def test_a_damped_stop_lets_go_when_it_would_have_to_pull() -> None:
    stiffness, damping, speed = 2.0e4, 80.0, 0.5  # x'' + 2 sigma x' + omega^2 x = 0 while it presses, that is until x'' = 0
    sigma, omega2 = damping / 4.0, stiffness / 2.0
    swing = np.sqrt(omega2 - sigma**2)
    until = (np.pi - np.arctan2(2 * sigma * swing, swing**2 - sigma**2)) / swing
    left = speed * np.exp(-sigma * until) * (np.cos(swing * until) - sigma / swing * np.sin(swing * until))
    for stop, sign in ((EndStop(x=0.3, k=stiffness, d=damping), 1.0), (LowerEndStop(x=-0.3, k=stiffness, d=damping), -1.0)):
        result = run_body(stop, s=0.25 * sign, v=speed * sign)
        assert result.states["body.v"][-1] == pytest.approx(left * sign, rel=1e-5)


def test_cogging_swings_a_body_about_its_rest_as_a_pendulum() -> None:
    amplitude, period, start = 3.0, 0.4, 0.12  # theta = 2 pi s/period:  theta'' = -w^2 sin(theta)
    rate, m = np.sqrt(2 * np.pi * amplitude / (period * 2.0)), np.sin(np.pi * start / period) ** 2
    sn, _, _, _ = ellipj(rate * T + ellipk(m), m)
    expected = period / np.pi * np.arcsin(np.sqrt(m) * sn)
    assert run_body(Cogging(amplitude=amplitude, period=period), s=start).states["body.s"] == pytest.approx(expected, rel=1e-7, abs=1e-9)


def test_cogging_has_the_phase_that_is_given() -> None:
    rest = -0.7 * 0.4 / (2 * np.pi)
    assert run_body(Cogging(amplitude=3.0, period=0.4, phase=0.7), s=rest).states["body.s"] == pytest.approx(np.full(len(T), rest))
