"""What outputs can tell, where the answer is known from the equations by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import pytest

from backsight.models import Component, Equation, InputError, Model, Output, Parameter, SolveError, Variable, balance, compile_model, equal
from backsight.models.analysis.identifiability import identifiability
from backsight.models.language import SignalInput
from backsight.models.mechanics.rotational import AngleSensor, Inertia, Rack, Torque
from backsight.models.mechanics.translational import (
    Damper,
    Fixed,
    Force,
    Friction,
    Mass,
    PositionSensor,
    Spring,
    SpringDamper,
    VelocitySensor,
)
from backsight.models.plants import actuator
from backsight.models.plants.drillstring import drillstring
from backsight.models.plants.five_bar import five_bar
from backsight.models.plants.xy_table import xy_table


def oscillator(*, driven: bool = True, spring: bool = True) -> Model:
    """2 kg on a spring and a damper, with or without a force; position and velocity measured."""
    components: dict[str, Component] = {
        "body": Mass(m=2.0),
        "damper": Damper(d=0.7),
        "ground": Fixed(),
        "ruler": PositionSensor(),
        "radar": VelocitySensor(),
    }
    connections = [("body.flange", "damper.flange_a"), ("damper.flange_b", "ground.flange")]
    connections += [("body.flange", "ruler.flange"), ("body.flange", "radar.flange")]
    if spring:
        components["spring"] = Spring(k=5.0)
        connections += [("body.flange", "spring.flange_a"), ("spring.flange_b", "ground.flange")]
    if driven:
        components["motor"] = Force()
        connections += [("motor.flange", "body.flange")]
    return Model(
        name="oscillator",
        components=components,
        connections=connections,
        inputs={"F": "motor.f"} if driven else {},
        outputs={"s": "ruler.s", "v": "radar.v"},
    )


def alone(component: Component, **signals: Any) -> Model:
    """A model of one component, `c`."""
    return Model(name="alone", components={"c": component}, **signals)


# ---------------------------------------------------------------- hand-made truths


def test_a_known_force_tells_mass_damping_and_stiffness() -> None:
    found = identifiability(oscillator(), outputs=["s"])
    assert found.identifiable == {"body.m": True, "damper.d": True, "spring.k": True}
    assert (found.directions, found.unobservable, found.entangled, found.clear) == ((), (), (), True)
    assert str(found) == "all 3 parameters can be told from s"


def test_a_free_response_tells_ratios_only() -> None:
    found = identifiability(oscillator(driven=False), outputs=["s"])
    assert found.unidentifiable == ("body.m", "damper.d", "spring.k")
    (direction,) = found.directions
    assert direction.kind == "factor"
    assert direction.changes == {"body.m": 1.0, "damper.d": 1.0, "spring.k": 1.0}
    assert "body.m, damper.d, spring.k (a common factor leaves the outputs as they are)" in str(found)


def test_of_a_free_response_two_are_told_when_the_third_is_known() -> None:
    found = identifiability(oscillator(driven=False), outputs=["s"], parameters=["spring.k", "damper.d"])
    assert found.unidentifiable == ()
    assert "body.m" in found.known


def test_velocity_alone_does_not_show_where_a_free_body_is() -> None:
    found = identifiability(oscillator(spring=False), outputs=["v"])
    assert found.identifiable == {"body.m": True, "damper.d": True}
    assert found.unobservable == ("body.s",)
    assert identifiability(oscillator(spring=False), outputs=["s", "v"]).unobservable == ()


def test_a_spring_shows_the_position_only_when_its_length_is_known() -> None:
    found = identifiability(oscillator(), outputs=["v"], parameters=["body.m", "spring.k", "spring.s_rel0"])
    assert found.unidentifiable == ("spring.s_rel0",)
    assert (found.unobservable, found.entangled) == ((), ("body.s",))
    assert "spring.s_rel0 cannot be told: other initial body.s make up for it" in str(found)


class Drive(Component):
    """m v' = gain F - d v - f_c sgn v, s' = v, y = scale s."""

    s = Variable("m")
    v = Variable("m/s")
    F = Variable("V")
    y = Variable("1")
    m = Parameter("kg", 3.0)
    gain = Parameter("N/V", 2.0)
    d = Parameter("N.s/m", 0.5)
    f_c = Parameter("N", 0.4)
    scale = Parameter("1/m", 1.5)
    idle = Parameter("N", 1.0)
    width = Parameter("m/s", 1e-2, smoothing=True)

    def equations(self, c: Any) -> dict[str, Equation]:
        rubbing = c.d * c.v + c.f_c * ca.tanh(c.v / c.width)
        return {
            "velocity": equal(c.der(c.s), c.v),
            "force": balance(c.m * c.der(c.v), c.gain * c.F, -rubbing, unit="N"),
            "reading": equal(c.y, c.scale * c.s),
        }


def drive() -> Model:
    return alone(Drive(), inputs={"F": "c.F"}, outputs={"y": "c.y"})


def test_of_a_gain_and_a_mass_only_the_ratio_shows() -> None:
    found = identifiability(drive(), parameters=["c.gain", "c.m"], values={"c.d": 0.0, "c.f_c": 0.0})
    assert [d.changes for d in found.directions] == [{"c.m": 1.0, "c.gain": 1.0}]
    assert found.directions[0].states == ()


def test_powers_are_found_and_a_rounded_corner_does_not_tell_a_velocity() -> None:
    # s, v -> s/c, v/c: scale c, m c and d c leave y as it is, f_c and sgn v as they are; rounding v over a known width would break it
    found = identifiability(drive(), parameters=["c.scale", "c.m", "c.d", "c.f_c"])
    assert found.identifiable["c.f_c"]
    (direction,) = found.directions
    assert direction.changes == {"c.m": 1.0, "c.d": 1.0, "c.scale": 1.0}
    assert direction.states == ("c.s", "c.v")
    assert found.entangled == ("c.s", "c.v")


def test_a_parameter_without_effect_is_named() -> None:
    found = identifiability(drive(), parameters=["c.idle", "c.m"])
    assert found.unidentifiable == ("c.idle",)
    assert found.sentences() == ["without effect on the outputs: c.idle"]


def test_bodies_that_move_together_show_their_sum() -> None:
    found = identifiability(oscillator().insert("body", Mass(m=1.0), name="load"), outputs=["s"])
    (direction,) = found.directions
    assert direction.kind == "summand"
    assert set(direction.changes) == {"body.m", "load.m"}
    assert direction.changes["body.m"] == -direction.changes["load.m"]


def test_sums_and_factors_are_told_apart_though_they_share_a_parameter() -> None:
    found = identifiability(oscillator(driven=False).insert("body", Mass(m=1.0), name="load"), outputs=["s"])
    assert sorted(d.kind for d in found.directions) == ["factor", "summand"]
    factor = next(d for d in found.directions if d.kind == "factor")
    assert set(factor.changes.values()) == {1.0}
    assert set(factor.changes) == {"body.m", "load.m", "damper.d", "spring.k"}


def test_a_strength_of_zero_is_known_unless_asked_for() -> None:
    rubbing = oscillator().insert("body", Friction(), name="friction")
    assert {"friction.f_c", "friction.d"} <= set(identifiability(rubbing).known)
    assert identifiability(rubbing, outputs=["s"], parameters=["body.m", "friction.f_c"]).unidentifiable == ()


class Twins(Component):
    """x' = -a x - b x (1 + 1e-8 x): a and b differ by a hundred-millionth of their effect."""

    x = Variable("1", start=1.0)
    a = Parameter("1/s", 1.0)
    b = Parameter("1/s", 1.0)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"decay": equal(c.der(c.x), -c.a * c.x - c.b * c.x * (1 + 1e-8 * c.x))}


def test_what_is_identifiable_on_paper_only_is_said_to_be_hard_to_tell() -> None:
    found = identifiability(alone(Twins(), outputs={"x": "c.x"}))
    assert found.identifiable == {"c.a": True, "c.b": True}
    assert found.weak == ("c.a", "c.b")
    assert "practically hard to tell: c.a, c.b" in str(found)


class Cancelling(Twins):
    """A reading that is one whatever x is, but for rounding."""

    y = Variable("1")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "reading": equal(c.y, ca.sin(c.x) ** 2 + ca.cos(c.x) ** 2)}


def test_what_is_left_of_terms_that_cancel_is_no_information() -> None:
    found = identifiability(alone(Cancelling(), outputs={"y": "c.y"}))
    assert found.unidentifiable == ("c.a", "c.b")
    assert found.unobservable == ("c.x",)


class Bob(Component):
    """A pendulum in Cartesian coordinates: m x'' = f x, m y'' = f y - m g, x^2 + y^2 = l^2."""

    x = Variable("m", start=0.6)
    y = Variable("m", start=-0.8)
    v_x = Variable("m/s")
    v_y = Variable("m/s")
    f = Variable("N/m")
    m = Parameter("kg", 2.0, min=0.1)
    g = Parameter("m/s2", 9.81)
    l = Parameter("m", 1.0, min=0.1)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "velocity x": equal(c.v_x, c.der(c.x)),
            "velocity y": equal(c.v_y, c.der(c.y)),
            "force x": balance(c.m * c.der(c.v_x), c.f * c.x, place="x", unit="N"),
            "force y": balance(c.m * c.der(c.v_y), c.f * c.y, -c.m * c.g, place="y", unit="N"),
            "rod": equal(c.x**2 + c.y**2, c.l**2),
        }


def test_constraints_between_states_count_as_known() -> None:
    model = alone(Bob(), outputs={"x": "c.x"})
    assert compile_model(model).invariants.shape[0] == 2
    found = identifiability(model, parameters=["c.m", "c.g", "c.l"])
    assert found.unidentifiable == ("c.m",)
    assert found.unobservable == ()


# ---------------------------------------------------------------- a rigid body with four rotors


class Quadrotor(Component):
    """A rigid body with four rotors in X configuration, ZYX Euler angles, z down: 16 states, 12 parameters."""

    x, y, z = (Variable("m", state=True) for _ in range(3))
    u, v, w = Variable("m/s"), Variable("m/s"), Variable("m/s")
    phi, theta, psi = (Variable("rad", state=True) for _ in range(3))
    p, q, r = Variable("rad/s"), Variable("rad/s"), Variable("rad/s")
    T_1, T_2, T_3, T_4 = (Variable("N", start=3.68) for _ in range(4))
    u_1, u_2, u_3, u_4 = (Variable("1") for _ in range(4))
    ax, ay, az = Variable("m/s2"), Variable("m/s2"), Variable("m/s2")
    m = Parameter("kg", 1.5)
    Ixx, Iyy, Izz = Parameter("kg.m2", 0.015), Parameter("kg.m2", 0.016), Parameter("kg.m2", 0.028)
    drag_w = Parameter("N.s/m", 0.3)
    drag_p, drag_q, drag_r = Parameter("1/s", 0.5), Parameter("1/s", 0.6), Parameter("1/s", 0.2)
    tau = Parameter("s", 0.05)
    gain = Parameter("N0.5", 2.74)
    torque_ratio = Parameter("m", 0.016)
    arm = Parameter("m", 0.3)

    def equations(self, c: Any) -> dict[str, Equation]:
        phi, theta, psi, g = c.phi, c.theta, c.psi, 9.81
        T, u = [c.T_1, c.T_2, c.T_3, c.T_4], [c.u_1, c.u_2, c.u_3, c.u_4]
        lift = T[0] + T[1] + T[2] + T[3]
        L = c.arm / 2**0.5 * (T[0] - T[1] - T[2] + T[3]) - c.Ixx * c.drag_p * c.p
        M = c.arm / 2**0.5 * (T[0] + T[1] - T[2] - T[3]) - c.Iyy * c.drag_q * c.q
        N = c.torque_ratio * (-T[0] + T[1] - T[2] + T[3]) - c.Izz * c.drag_r * c.r
        cf, sf, ct, st, cp, sp = ca.cos(phi), ca.sin(phi), ca.cos(theta), ca.sin(theta), ca.cos(psi), ca.sin(psi)
        return {
            "north": equal(c.der(c.x), ct * cp * c.u + (sf * st * cp - cf * sp) * c.v + (cf * st * cp + sf * sp) * c.w),
            "east": equal(c.der(c.y), ct * sp * c.u + (sf * st * sp + cf * cp) * c.v + (cf * st * sp - sf * cp) * c.w),
            "down": equal(c.der(c.z), -st * c.u + sf * ct * c.v + cf * ct * c.w),
            "surge": equal(c.der(c.u), -g * st + c.ax - c.q * c.w + c.r * c.v),
            "sway": equal(c.der(c.v), g * sf * ct + c.ay - c.r * c.u + c.p * c.w),
            "heave": equal(c.der(c.w), g * cf * ct + c.az - c.p * c.v + c.q * c.u),
            "specific force x": equal(c.ax, 0),
            "specific force y": equal(c.ay, 0),
            "specific force z": equal(c.m * c.az, -lift - c.drag_w * c.w),
            "roll": equal(c.der(phi), c.p + sf * st / ct * c.q + cf * st / ct * c.r),
            "pitch": equal(c.der(theta), cf * c.q - sf * c.r),
            "yaw": equal(c.der(psi), (sf * c.q + cf * c.r) / ct),
            "roll torque": balance(c.Ixx * c.der(c.p), L, (c.Iyy - c.Izz) * c.q * c.r, place="p", unit="N.m"),
            "pitch torque": balance(c.Iyy * c.der(c.q), M, (c.Izz - c.Ixx) * c.r * c.p, place="q", unit="N.m"),
            "yaw torque": balance(c.Izz * c.der(c.r), N, (c.Ixx - c.Iyy) * c.p * c.q, place="r", unit="N.m"),
            **{f"rotor {i + 1}": equal(c.tau * c.der(T[i]), -2 * T[i] + 2 * c.gain * ca.sqrt(T[i]) * u[i]) for i in range(4)},
        }


@pytest.mark.slow
def test_inertial_sensors_do_not_show_where_a_quadrotor_is_nor_how_heavy() -> None:
    sensed = {name: f"c.{name}" for name in ("ax", "ay", "az", "p", "q", "r")}
    model = alone(Quadrotor(), inputs={f"u_{i}": f"c.u_{i}" for i in range(1, 5)}, outputs=sensed)
    every = list(Quadrotor.declared_parameters)
    found = identifiability(model, parameters=[f"c.{name}" for name in every])
    assert found.unobservable == ("c.x", "c.y", "c.z", "c.psi")
    assert {name[2:] for name in found.unidentifiable} == {"m", "Ixx", "Iyy", "Izz", "drag_w", "gain", "torque_ratio", "arm"}
    # thrust, mass and inertia scale together (gain with their root), and so do arm, torque ratio and inertia
    first, second = (d.changes for d in found.directions)
    assert {d.kind for d in found.directions} == {"factor"}
    for change in (first, second):
        e = {name: change.get(f"c.{name}", 0.0) for name in every}
        assert e["Ixx"] == e["Iyy"] == e["Izz"] == pytest.approx(2 * e["gain"] + e["arm"])
        assert e["m"] == e["drag_w"] == pytest.approx(2 * e["gain"])
        assert e["arm"] == e["torque_ratio"]
    assert found.seconds < 10.0


# ---------------------------------------------------------------- the plants


def test_the_axis_shows_its_four_parameters() -> None:
    found = identifiability(actuator())
    assert found.identifiable == dict.fromkeys(("carriage.m", "friction.d", "friction.f_c", "offset.f"), True)


@pytest.mark.slow
def test_the_closed_loop_shows_its_six_combinations_and_nothing_more() -> None:
    six = [f"P_{i}" for i in range(1, 7)]
    assert identifiability(five_bar(), parameters=six).unidentifiable == ()
    more = identifiability(five_bar(), parameters=[*six, "link_3.m", "link_4.m"])
    # l1 = l2 = 0.25, l3 = 0.2, r3 = 0.1, r4 = 0.05: what the mass of link 4 does, P_1, P_3 and P_4 do as well
    change = next(d.changes for d in more.directions if "link_4.m" in d.changes)
    assert len(more.directions) == 2
    assert set(change) == {"P_1", "P_3", "P_4", "link_4.m"}


def test_the_drillstring_shows_all_to_current_and_speed_but_not_to_the_current_alone() -> None:
    assert identifiability(drillstring()).unidentifiable == ()
    five = ["string.k", "bha.J", "bha.d", "bit.tau_sl", "bit.tau_st"]
    assert identifiability(drillstring(), ["I_m"], five).unidentifiable == ()
    # with all speeds over c: Km c; inertias, dampings and stiffness c^2; the bit's torques c
    (direction,) = identifiability(drillstring(), ["I_m"]).directions
    once, twice = ["motor.Km", "bit.tau_sl", "bit.tau_st"], ["rotary_table.J", "rotary_table.d", "string.k", "bha.J", "bha.d"]
    assert direction.changes == dict.fromkeys(once, 1.0) | dict.fromkeys(twice, 2.0)
    assert direction.kind == "factor"


@pytest.mark.slow
def test_the_table_shows_what_its_report_estimated() -> None:
    five = ["spindle.k", "drive_1.J", "drive_3.J", "friction_1.tau_c", "friction_3.tau_c"]
    for outputs in (None, ["x_r", "y_r", "x_m", "y_m"]):
        assert identifiability(xy_table(), outputs, five).unidentifiable == ()
    hidden = identifiability(xy_table(), ["x_m", "y_m"], [*five, "slide_1.m"])
    assert hidden.unidentifiable == ("drive_1.J", "slide_1.m")  # they move together


# ---------------------------------------------------------------- the interface


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_verdict_does_not_depend_on_the_draw(seed: int) -> None:
    found = identifiability(drive(), parameters=["c.scale", "c.m", "c.d", "c.f_c", "c.gain"], seed=seed)
    assert (found.unidentifiable, len(found.directions)) == (("c.m", "c.gain", "c.d", "c.f_c", "c.scale"), 2)


def test_a_model_and_its_equations_have_the_same_verdict_and_values_may_differ() -> None:
    dae = compile_model(drive())
    assert identifiability(dae, values={"c.f_c": 0.0}).known == ("c.f_c",)
    assert identifiability(dae).identifiable == identifiability(drive()).identifiable


def test_a_model_without_outputs_tells_nothing() -> None:
    found = identifiability(Model(name="m", components={"c": Twins()}))
    assert found.unidentifiable == ("c.a", "c.b")
    assert found.unobservable == ("c.x",)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"outputs": ["S"]}, r"outputs: model 'oscillator' has no 'S'; known: s, v|did you mean"),
        ({"parameters": ["body.mass"]}, r"parameters: model 'oscillator' has no 'body.mass'; did you mean 'body.m'\?"),
        ({"values": {"body.M": 1.0}}, r"values: model 'oscillator' has no 'body.M'; did you mean 'body.m'\?"),
    ],
)
def test_an_unknown_name_is_refused(arguments: dict[str, Any], text: str) -> None:
    with pytest.raises(InputError, match=text):
        identifiability(oscillator(), **arguments)


class Nowhere(Component):
    """x' = log(-1 - x^2): defined for no x."""

    x = Variable("1")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"rate": equal(c.der(c.x), ca.log(-1 - c.x**2))}


def test_a_model_that_cannot_run_is_refused() -> None:
    dae = compile_model(alone(Nowhere(), outputs={"x": Output("c.x")}))
    with pytest.raises(SolveError, match="no experiment with 'alone' near its start values could be integrated"):
        identifiability(dae)


class Exponential(Component):
    """x' = a exp(b) u"""

    x = Variable("m", state=True)
    a = Parameter("m/s", 3.0)
    b = Parameter("", 0.0, nominal=2.0)
    u = SignalInput("1")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"rate": equal(c.der(c.x), c.a * ca.exp(c.b) * c.u)}


def test_the_change_of_a_parameter_that_is_zero_is_told_in_its_unit() -> None:
    found = identifiability(alone(Exponential(), inputs={"u": "c.u"}, outputs={"x": "c.x"}), parameters=["c.a", "c.b"])
    (direction,) = found.directions
    assert direction.kind == "local"
    percent, step = direction.changes["c.a"], direction.changes["c.b"] / 100 * 2.0
    assert step == pytest.approx(-percent / 100, rel=1e-6)  # a exp(b) stays
    assert f"c.a {percent:+.3g} %, c.b {step:+.3g} (" in str(found)


def test_a_verdict_on_no_parameter_says_so() -> None:
    found = identifiability(oscillator(), parameters=[])
    (line,) = found.sentences()
    assert line.startswith("no parameter was asked about; name some of body.m, damper.d, ")


def test_without_outputs_no_state_is_observable() -> None:
    lines = identifiability(replace(oscillator(), outputs={})).sentences()
    assert "unobservable without an output: body.s, body.v" in lines


def test_a_slide_behind_a_stiff_belt_is_judged_though_few_starts_are_near_enough():
    """A third of a metre of stretch would throw a mass of 5 kg at 60 m/s: an experiment begins nearer to where the belt is slack."""
    model = Model(
        name="belt_slide",
        components={
            "source": Torque(), "motor": Inertia(J=1e-3), "pulley": Rack(r=0.016), "belt": SpringDamper(k=2e5, d=150.0),
            "slide": Mass(m=5.0), "guide": Damper(d=20.0), "bed": Fixed(), "encoder": AngleSensor(), "scale": PositionSensor(),
        },
        connections=[
            ("source.flange", "motor.flange"), ("motor.flange", "pulley.wheel"), ("pulley.rack", "belt.flange_a"),
            ("belt.flange_b", "slide.flange"), ("slide.flange", "guide.flange_a"), ("guide.flange_b", "bed.flange"),
            ("encoder.flange", "motor.flange"), ("scale.flange", "slide.flange"),
        ],
        inputs={"tau": "source.tau"},
        outputs={"phi": "encoder.phi", "s": "scale.s"},
    )  # fmt: skip
    free = ["motor.J", "belt.k", "belt.d", "slide.m", "guide.d"]
    found = identifiability(model, parameters=free)
    assert found.identifiable == dict.fromkeys(free, True)
    assert found.clear
