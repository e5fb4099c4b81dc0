"""Blocks with memory against step responses in closed form, and the delay against the exact delay."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from backsight.models import (
    Component,
    Equation,
    Model,
    ModelError,
    Parameter,
    SignalInput,
    Trajectory,
    Translational,
    compile_model,
    equal,
    simulate,
)
from backsight.models.mechanics.translational import Mass, PositionSensor
from backsight.models.signals import AsymmetricLag, Delay, Gain, Lag, LimitedPIController, PIController, SecondOrderLag, Sum

T = np.linspace(0.0, 3.0, 61)


def alone(block: Component) -> Model:
    return Model(name="alone", components={"block": block}, inputs={"u": "block.u"}, outputs={"y": "block.y"})


def response(block: Component, u: object, **initial: float) -> Trajectory:
    return simulate(compile_model(alone(block)), T, {"u": u}, initial={f"block.{k}": v for k, v in initial.items()})


def frequency_response(block: Component, omega: np.ndarray) -> np.ndarray:
    """y/u at s = i omega, of the block's linear equations."""
    dae = compile_model(alone(block))
    p = dae.parameter_values()
    blocks = [ca.jacobian(f, v) for f in (dae.residual, dae.output) for v in (dae.dx, dae.x, dae.u)]
    e, a, b, _, c, d = (m.full() for m in ca.Function("m", [dae.p], blocks)(p))
    return np.array([(c @ np.linalg.solve(1j * w * e + a, -b) + d)[0, 0] for w in omega])


def test_a_lag_answers_a_step_exponentially() -> None:
    assert response(Lag(tau=0.4), 2.0).outputs["y"] == pytest.approx(2.0 * (1 - np.exp(-T / 0.4)), rel=1e-8, abs=1e-11)


def test_an_asymmetric_lag_rises_and_falls_with_its_own_time_constants() -> None:
    u = np.where(T < 1.5, 2.0, 0.5)
    u[T >= 1.5] = 0.5
    top = 2.0 * (1 - np.exp(-1.5 / 0.2))
    truth = np.where(T <= 1.5, 2.0 * (1 - np.exp(-T / 0.2)), 0.5 + (top - 0.5) * np.exp(-(T - 1.5) / 0.8))
    assert response(AsymmetricLag(tau_up=0.2, tau_down=0.8), u).outputs["y"] == pytest.approx(truth, abs=1e-6)


def test_an_asymmetric_lag_with_equal_time_constants_is_a_lag_whatever_its_rounding() -> None:
    model = compile_model(alone(AsymmetricLag(tau_up=0.4, tau_down=0.4)))
    wide = simulate(model, T, {"u": np.sin(3 * T)}, {"block.width": 5.0}).outputs["y"]
    assert wide == pytest.approx(response(Lag(tau=0.4), np.sin(3 * T)).outputs["y"], abs=1e-9)


def test_an_asymmetric_lag_rests_where_its_input_is_however_wide_its_rounding() -> None:
    model = compile_model(alone(AsymmetricLag(tau_up=0.2, tau_down=0.9)))
    resting = simulate(model, T, {"u": 1.5}, {"block.width": 0.5}, {"block.y": 1.5}).outputs["y"]
    assert resting == pytest.approx(np.full(len(T), 1.5), abs=1e-12)


def test_a_lag_of_second_order_overshoots_as_its_damping_says() -> None:
    w, z = 5.0, 0.3
    swing = w * np.sqrt(1 - z**2)
    truth = 1 - np.exp(-z * w * T) * (np.cos(swing * T) + z * w / swing * np.sin(swing * T))
    run = response(SecondOrderLag(omega_0=w, zeta=z), 1.0)
    assert run.outputs["y"] == pytest.approx(truth, rel=1e-7, abs=1e-9)
    assert set(run.states) == {"block.y", "block.rate"}


@pytest.mark.parametrize("delay", [0.01, 2.0])
def test_the_delay_has_the_phase_and_gain_of_a_delay_to_sixth_order(delay: float) -> None:
    x = np.array([0.1, 0.3, 1.0, 2.0])  # omega delay
    ratio = frequency_response(Delay(delay=delay), x / delay) / np.exp(-1j * x)
    assert np.all(np.abs(np.angle(ratio)) < 1.5 * x**7 / 7200 + 1e-12)
    assert np.abs(ratio - 1)[1:3] == pytest.approx(x[1:3] ** 6 / 7200, rel=0.15)
    assert np.abs(ratio - 1)[3] < 9e-3


def test_the_delay_returns_a_sine_later_once_it_has_seen_it() -> None:
    t = np.linspace(0.0, 3.0, 1501)
    u = 2.0 + np.sin(4.0 * t)
    y = simulate(compile_model(alone(Delay(delay=0.2))), t, {"u": u}, hold="linear").outputs["y"]
    late = t > 1.5
    assert y[late] == pytest.approx(2.0 + np.sin(4.0 * (t[late] - 0.2)), abs=1e-4)


def test_a_step_makes_no_step_of_the_delayed_signal() -> None:
    y = simulate(compile_model(alone(Delay(delay=1.0))), [0.0, 1e-6], {"u": 1.0}).outputs["y"]
    assert np.abs(y).max() < 1e-5


def test_a_delay_of_zero_is_refused() -> None:
    with pytest.raises(ModelError, match=r"Delay\(delay=0.0\)"):
        Delay(delay=0.0)


def test_a_delay_behind_a_sensor_shows_where_the_body_was() -> None:
    model = Model(
        name="late",
        components={"body": Mass(m=1.0), "encoder": PositionSensor()},
        connections=[("body.flange", "encoder.flange")],
        outputs={"x": "encoder.s"},
        start={"body.v": 3.0},
    ).insert("sensor:x", Delay(delay=0.1), name="late")
    dae = compile_model(model)
    run = simulate(dae, T)
    assert run.outputs["x"][T > 1.0] == pytest.approx(3.0 * (T[T > 1.0] - 0.1), abs=1e-6)
    assert dae.outputs[0].unit == "m"


def test_a_pi_controller_adds_the_integral_of_the_error() -> None:
    assert response(PIController(k=3.0, T_i=0.5), 0.2).outputs["y"] == pytest.approx(3.0 * 0.2 * (1 + T / 0.5), rel=1e-10)


def closed_loop(controller: Component) -> Model:
    """A controller around a lag of 1 s: the error is reference minus output."""
    return Model(
        name="loop",
        components={"error": Sum(k_2=-1.0), "controller": controller, "plant": Lag(tau=1.0)},
        connections=[("error.y", "controller.u"), ("controller.y", "plant.u"), ("plant.y", "error.u_2")],
        inputs={"r": "error.u_1"},
        outputs={"y": "plant.y", "command": "controller.y"},
    )


def test_a_pi_controller_that_cancels_the_pole_leaves_a_loop_of_first_order() -> None:
    run = simulate(compile_model(closed_loop(PIController(k=4.0, T_i=1.0))), T, {"r": 1.0})
    assert run.outputs["y"] == pytest.approx(1 - np.exp(-4.0 * T), rel=1e-8, abs=1e-10)


def test_a_limited_pi_controller_stays_in_its_limit_and_does_not_wind_up() -> None:
    def textbook(_: float, x: np.ndarray) -> list[float]:
        error = 1.0 - x[1]
        v = 4.0 * error + x[0]
        y = np.clip(v, -1.3, 1.3)
        return [4.0 * error / 0.5 + (y - v) / 0.2, y - x[1]]

    truth = solve_ivp(textbook, (0.0, 3.0), [0.0, 0.0], t_eval=T, rtol=1e-10, atol=1e-12, max_step=0.01).y[1]
    run = simulate(compile_model(closed_loop(LimitedPIController(k=4.0, T_i=0.5, T_t=0.2, limit=1.3))), T, {"r": 1.0})
    assert run.outputs["y"] == pytest.approx(truth, abs=1e-5)
    assert run.outputs["command"].max() <= 1.3 + 1e-12
    wound_up = simulate(compile_model(closed_loop(PIController(k=4.0, T_i=0.5))), T, {"r": 1.0}).outputs["y"].max()
    assert run.outputs["y"].max() < wound_up


class Push(Component):
    """A force told by a signal.   flange.f = -f"""

    f = SignalInput("N")
    flange = Translational()

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"drive": equal(c.flange.f, -c.f)}


def held(block: Component) -> Model:
    """A body of 2 kg held by a command that a block makes of its position."""
    return Model(
        name="held",
        components={"body": Mass(m=2.0), "encoder": PositionSensor(), "block": block, "motor": Push()},
        connections=[("body.flange", "encoder.flange"), ("motor.flange", "body.flange"), ("encoder.s", "block.u"), ("block.y", "motor.f")],
        outputs={"x": "encoder.s", "F": "block.y"},
        start={"body.s": 0.1},
    )


def test_a_controller_joins_signals_of_different_units_which_a_gain_of_one_unit_does_not() -> None:
    with pytest.raises(ModelError, match=r"units of block\.u \[m\], block\.y \[N\] differ"):
        compile_model(held(Gain(gain=-1.0)))


def test_a_pi_controller_of_position_is_a_spring_and_an_integral() -> None:
    class Against(PIController):
        k = Parameter("N/m", -18.0)

    run = simulate(compile_model(held(Against(T_i=1e9))), T)
    assert run.outputs["x"] == pytest.approx(0.1 * np.cos(3.0 * T), abs=1e-8)
