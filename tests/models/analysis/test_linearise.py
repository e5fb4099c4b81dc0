"""Linearisation, equilibria and exact discretisation against closed forms and printed transfer functions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

from backsight.models import Component, Dae, Equation, Model, ModelError, Parameter, SolveError, Variable, balance, compile_model, equal
from backsight.models.analysis.linearise import StateSpace, linearise
from backsight.models.analysis.operating_point import equilibrium, operating_point
from backsight.models.mechanics.translational import AccelerationSensor, Damper, Fixed, Force, Mass, PositionSensor, Spring
from backsight.models.plants import actuator

M, D, K = 2.0, 0.7, 5.0


def oscillator() -> Dae:
    """M s'' = F - D s' - K s, position and acceleration measured."""
    return compile_model(
        Model(
            name="oscillator",
            components={
                "motor": Force(),
                "body": Mass(m=M),
                "spring": Spring(k=K),
                "damper": Damper(d=D),
                "ground": Fixed(),
                "ruler": PositionSensor(),
                "shake": AccelerationSensor(),
            },
            connections=[
                ("motor.flange", "body.flange"),
                ("body.flange", "spring.flange_a"),
                ("body.flange", "damper.flange_a"),
                ("spring.flange_b", "ground.flange"),
                ("damper.flange_b", "ground.flange"),
                ("body.flange", "ruler.flange"),
                ("body.flange", "shake.flange"),
            ],
            inputs={"F": "motor.f"},
            outputs={"x": "ruler.s", "a": "shake.a"},
        )
    )


def free_mass() -> Dae:
    return compile_model(
        Model(
            name="free",
            components={"motor": Force(), "body": Mass(m=M), "ruler": PositionSensor()},
            connections=[("motor.flange", "body.flange"), ("ruler.flange", "body.flange")],
            inputs={"F": "motor.f"},
            outputs={"x": "ruler.s"},
        )
    )


class Drill(Component):
    """Motor, rotary table, string and bit of a scale model; the bit's friction -0.4 N.m sgn is constant while it slides."""

    i = Variable("A", state=True)
    table = Variable("rad/s", state=True)
    twist = Variable("rad", state=True)
    bit = Variable("rad/s", state=True)
    V = Variable("V")
    tau_c = Parameter("N.m", 0.4, min=0.0)
    width = Parameter("rad/s", 1e-2, min=1e-12, smoothing=True)

    def equations(self, c: Any) -> dict[str, Equation]:
        rubbing = c.tau_c * ca.tanh(c.bit / c.width)
        return {
            "circuit": equal(0.116 * c.der(c.i), c.V - 22.0 * c.i - 11.0 * c.table),
            "rotary table": balance(0.3 * c.der(c.table), 11.0 * c.i, -0.03 * c.table, -0.0868 * c.twist, place="table", unit="N.m"),
            "string": equal(c.der(c.twist), c.table - c.bit),
            "bit": balance(0.0529 * c.der(c.bit), 0.0868 * c.twist, -0.001 * c.bit, -rubbing, place="bit", unit="N.m"),
        }


def drill() -> Dae:
    return compile_model(Model(name="drill", components={"drill": Drill()}, inputs={"V": "drill.V"}, outputs={"I_m": "drill.i"}))


# ---------------------------------------------------------------- linearisation


def test_an_oscillator_has_the_matrices_of_the_textbook() -> None:
    found = linearise(oscillator())
    np.testing.assert_allclose(found.A, [[0, 1], [-K / M, -D / M]], rtol=1e-14)
    np.testing.assert_allclose(found.B, [[0], [1 / M]], rtol=1e-14)
    np.testing.assert_allclose(found.C, [[1, 0], [-K / M, -D / M]], rtol=1e-14)
    np.testing.assert_allclose(found.D, [[0], [1 / M]], rtol=1e-14)
    assert [q.name for q in (*found.states, *found.inputs, *found.outputs)] == ["body.s", "body.v", "F", "x", "a"]


def test_a_residual_force_enters_as_the_force_beside_it_does() -> None:
    found = linearise(oscillator())
    assert [p.name for p in found.places] == ["body"]
    np.testing.assert_allclose(found.G, found.B)
    np.testing.assert_allclose(found.H, found.D)


class Implicit(Component):
    """x' + x'^3 = u - x, and y from y + y^3 = x: neither can be solved for."""

    x = Variable("1", start=1.0)
    y = Variable("1")
    u = Variable("1")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"rate": equal(c.der(c.x) + c.der(c.x) ** 3, c.u - c.x), "loop": equal(c.y + c.y**3, c.x)}


def test_implicit_equations_are_differentiated_where_they_hold() -> None:
    dae = compile_model(Model(name="implicit", components={"a": Implicit()}, inputs={"u": "a.u"}, outputs={"y": "a.y"}))
    found = linearise(dae, x={"a.x": 2.0}, u={"u": 12.0})  # x' = 2 and y = 1 fulfil the equations
    np.testing.assert_allclose(found.A, [[-1 / 13]], rtol=1e-12)
    np.testing.assert_allclose(found.B, [[1 / 13]], rtol=1e-12)
    np.testing.assert_allclose(found.C, [[1 / 4]], rtol=1e-12)


def test_a_friction_law_sticks_at_rest_and_slips_in_motion() -> None:
    dae = compile_model(actuator())
    mass, viscous = 95.109, 203.5
    for speed in (0.1, -0.003):
        assert linearise(dae, x={"carriage.v": speed}).A[1, 1] == pytest.approx(-viscous / mass, rel=1e-12)
    stuck = linearise(dae).zoh(0.1)
    assert abs(stuck.A[1, 1]) < 1e-12
    assert abs(stuck.B[0, 0]) < 1e-8  # a force of 1 N moves it no further in 0.1 s
    assert linearise(dae, parameters={"friction.width": 0.5}).A[1, 1] == pytest.approx(-(viscous + 20.394 / 0.5) / mass, rel=1e-12)


# ---------------------------------------------------------------- discretisation


@pytest.mark.parametrize("step", [1e-4, 0.3, 7.0])
def test_the_held_oscillator_has_the_closed_form_of_its_damped_oscillation(step: float) -> None:
    decay, square = D / (2 * M), K / M
    rate = np.sqrt(square - decay**2)
    c, s, e = np.cos(rate * step), np.sin(rate * step) / rate, np.exp(-decay * step)
    A = e * np.array([[c + decay * s, s], [-square * s, c - decay * s]])
    B = np.array([(1 - A[0, 0]) / K, A[0, 1] / M])  # from rest under 1 N: s = (1 - A_11)/K, v = s'
    found = linearise(oscillator()).zoh(step)
    np.testing.assert_allclose(found.A, A, rtol=1e-11, atol=1e-15)
    np.testing.assert_allclose(found.B[:, 0], B, rtol=1e-7, atol=1e-15)
    assert found.step == step


def test_a_held_force_moves_a_free_mass_by_parabolas() -> None:
    h = 0.01
    found = linearise(free_mass()).zoh(h)
    np.testing.assert_allclose(found.A, [[1, h], [0, 1]], rtol=1e-14)
    np.testing.assert_allclose(found.B[:, 0], [h**2 / (2 * M), h / M], rtol=1e-14)
    np.testing.assert_allclose(found.G, found.B)
    numerator, denominator = found.transfer_function("F", "x")
    np.testing.assert_allclose(numerator, np.array([1, 1]) * h**2 / (2 * M), rtol=1e-9)
    np.testing.assert_allclose(denominator, [1, -2, 1], rtol=1e-7)


def test_two_half_steps_are_one_step_though_the_body_sticks() -> None:
    system = linearise(drill())  # poles from 0.1 to 1e8 rad/s
    half, whole = system.zoh(0.05), system.zoh(0.1)
    np.testing.assert_allclose(half.A @ half.A, whole.A, rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(half.A @ half.B + half.B, whole.B, rtol=1e-7, atol=1e-10)


@pytest.mark.parametrize("step", [0.0, -0.1, np.nan])
def test_a_step_must_be_positive(step: float) -> None:
    with pytest.raises(ModelError, match="a positive step"):
        linearise(oscillator()).zoh(step)


def test_a_discrete_system_is_not_discretised_again() -> None:
    with pytest.raises(ModelError, match=r"discrete already, with a step of 0\.1 s"):
        linearise(oscillator()).zoh(0.1).zoh(0.1)


# ---------------------------------------------------------------- transfer functions


def test_transfer_functions_of_the_oscillator() -> None:
    system = linearise(oscillator())
    for source in ("F", "body"):
        numerator, denominator = system.transfer_function(source, "x")
        np.testing.assert_allclose(numerator, [1 / M], rtol=1e-12)
        np.testing.assert_allclose(denominator, [1, D / M, K / M], rtol=1e-12)
        numerator, _ = system.transfer_function(source, "a")
        np.testing.assert_allclose(numerator, [1 / M, 0, 0], atol=1e-14)


@pytest.mark.parametrize("step", [None, 0.05])
def test_a_transfer_function_is_the_response_to_a_harmonic_input(step: float | None) -> None:
    system = linearise(drill(), x={"drill.bit": 4.0})
    system = system.zoh(step) if step else system
    numerator, denominator = system.transfer_function("V", "I_m")
    for omega in (0.05, 1.3, 40.0):
        s = 1j * omega if step is None else np.exp(1j * omega * step)
        response = system.C[0] @ np.linalg.solve(s * np.eye(4) - system.A, system.B[:, 0])
        assert np.polyval(numerator, s) / np.polyval(denominator, s) == pytest.approx(response, rel=1e-8)


def test_what_an_input_does_not_reach_has_a_numerator_of_zero() -> None:
    none = linearise(free_mass())
    still = StateSpace(**{**vars(none), "B": 0 * none.B})
    assert still.transfer_function("F", "x")[0].tolist() == [0.0]


@pytest.mark.parametrize(
    ("step", "a", "b"),
    [
        (0.05, [-2.3503, 1.7085, -0.3557, 0.0001], [0.0208, -0.0621, 0.0619, -0.0206]),
        (0.1, [-2.1069, 1.2474, -0.1262, 0.0000], [0.0076, -0.0223, 0.0220, -0.0073]),  # the last a is e^(h trace A), 6e-9
    ],
)
def test_the_sliding_drillstring_has_the_printed_transfer_functions(step: float, a: list[float], b: list[float]) -> None:
    numerator, denominator = linearise(drill(), x={"drill.bit": 4.0}).zoh(step).transfer_function("V", "I_m")
    np.testing.assert_allclose(denominator, [1, *a], atol=5.1e-5)
    np.testing.assert_allclose(numerator, b, atol=5.1e-5)


def test_the_stuck_drillstring_has_the_printed_transfer_function_with_one_pole_more_at_zero() -> None:
    numerator, denominator = linearise(drill()).zoh(0.1).transfer_function("V", "I_m")
    np.testing.assert_allclose(denominator, [1, -1.1251, 0.1265, 0.0, 0.0], atol=5.1e-5)
    np.testing.assert_allclose(100 * numerator, [0.7574, -1.4854, 0.7343, 0.0], atol=5.1e-5)


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda s: s.transfer_function("G", "x"), "input = 'G': the system has no such input or place; known: F, body"),
        (lambda s: s.transfer_function("F", "y"), "output = 'y': the system has no such output; known: x, a"),
    ],
)
def test_an_unknown_signal_is_refused_with_those_there_are(call: Callable[[StateSpace], Any], text: str) -> None:
    with pytest.raises(ModelError, match=text):
        call(linearise(oscillator()))


# ---------------------------------------------------------------- working points


def test_a_spring_yields_until_it_balances_the_force() -> None:
    point = equilibrium(oscillator(), inputs={"F": 3.0})
    assert point.x == pytest.approx({"body.s": 3.0 / K, "body.v": 0.0}, abs=1e-12)
    assert point.dx == {"body.s": 0.0, "body.v": 0.0}


def test_an_input_left_out_is_found_for_the_state_that_is_held() -> None:
    assert equilibrium(oscillator(), held={"body.s": 0.2}).u == pytest.approx({"F": 0.2 * K}, rel=1e-12)


def test_a_body_may_slide_steadily_where_its_position_does_not_matter() -> None:
    force = 60.0
    point = equilibrium(compile_model(actuator()), inputs={"F": force})
    assert point.x["carriage.v"] == pytest.approx((force - 20.394 + 3.165) / 203.5, rel=1e-9)
    driven = equilibrium(compile_model(actuator()), held={"carriage.v": -0.1})
    assert driven.u["F"] == pytest.approx(-20.35 - 20.394 - 3.165, rel=1e-12)


def test_below_its_friction_a_body_stands_still_but_for_the_rounding() -> None:
    point = equilibrium(compile_model(actuator()), inputs={"F": 10.0})
    width = 1e-8
    assert point.x["carriage.v"] == pytest.approx(width * np.arctanh(13.165 / 20.394), rel=1e-5)


class Pendulum(Component):
    """phi'' = -sin phi + u."""

    phi = Variable("rad", state=True)
    omega = Variable("rad/s", state=True)
    u = Variable("1")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"rate": equal(c.der(c.phi), c.omega), "torque": balance(c.der(c.omega), -ca.sin(c.phi), c.u, unit="1")}


def pendulum() -> Dae:
    return compile_model(Model(name="pendulum", components={"p": Pendulum()}, inputs={"u": "p.u"}))


def test_the_guess_chooses_among_equilibria() -> None:
    dae = pendulum()
    below, above = (equilibrium(dae, {"u": 0.5}, guess={"p.phi": guess}) for guess in (0.0, 2.9))
    assert below.x["p.phi"] == pytest.approx(np.arcsin(0.5), rel=1e-12)
    assert above.x["p.phi"] == pytest.approx(np.pi - np.arcsin(0.5), rel=1e-12)
    poles = linearise(dae, x=above.x, u=above.u).poles.real
    assert sorted(poles) == pytest.approx([-np.sqrt(np.cos(np.arcsin(0.5))), np.sqrt(np.cos(np.arcsin(0.5)))])


def test_where_there_is_no_equilibrium_the_equation_that_fails_is_named() -> None:
    with pytest.raises(SolveError, match="'free' has no equilibrium near the guess with F = 3: 'force balance of body'"):
        equilibrium(free_mass(), {"F": 3.0})
    with pytest.raises(SolveError, match="no equilibrium"):
        equilibrium(pendulum(), {"u": 1.5})


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda d: linearise(d, x={"body.x": 1.0}), "'body.x': model 'oscillator' has no such state or algebraic variable; did you mean"),
        (lambda d: linearise(d, u={"G": 1.0}), "'G': model 'oscillator' has no such input; known: F"),
        (lambda d: linearise(d, x={"body.s": np.nan}), "'body.s' = nan: a finite number is needed"),
        (lambda d: equilibrium(d, held={"body.x": 1.0}), "'body.x': model 'oscillator' has no such state"),
        (lambda d: linearise(d, parameters={"body.m": -1.0}), r"parameters\['body.m'\] = -1: the value must lie between"),
    ],
)
def test_a_wrong_argument_is_refused_by_name(call: Callable[[Dae], Any], text: str) -> None:
    with pytest.raises(ModelError, match=text):
        call(oscillator())


def test_a_point_without_accelerations_is_refused() -> None:
    with pytest.raises(SolveError, match="no x' and z of 'oscillator' fulfil 'force balance of body' at this point"):
        operating_point(oscillator(), u={"F": 1.0}, parameters={"body.m": 0.0})
