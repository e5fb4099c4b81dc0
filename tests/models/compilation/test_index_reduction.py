"""Index reduction: what has to be differentiated, and what must not be."""

from typing import Any

import casadi as ca
import pytest

from backsight.models import Component, Equation, Model, ModelError, Variable, balance, compile_model, equal, law, simulate
from backsight.models.mechanics.planar import PlanarFixed, PointMass, Rod
from backsight.models.mechanics.translational import Force, Mass, Rigid


class Circle(Component):
    """A point driven along x^2 + y^2 = r^2 with r an input."""

    x = Variable("m", state=True)
    y = Variable("m", state=True)
    v = Variable("m/s", state=True)
    w = Variable("m/s", state=True)
    f = Variable("N")
    r = Variable("m")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "velocity x": equal(c.v, c.der(c.x)),
            "velocity y": equal(c.w, c.der(c.y)),
            "balance x": balance(c.der(c.v), -c.f * c.x, place="x", unit="N"),
            "balance y": balance(c.der(c.w), -c.f * c.y, place="y", unit="N"),
            "circle": law(c.x**2 + c.y**2, c.r**2, unit="m2"),
        }


def test_an_input_that_would_have_to_be_differentiated_is_named() -> None:
    with pytest.raises(ModelError, match=r"input 'R' \('a.r'\) fixes a.x, a.y, so it would have to be differentiated"):
        compile_model(Model(name="m", components={"a": Circle()}, inputs={"R": "a.r"}))


class Radius(Circle):
    """The same with a constant radius."""

    def equations(self, c: Any) -> dict[str, Equation]:
        return {**super().equations(c), "radius": equal(c.r, 1.0)}


def test_a_constraint_that_is_differentiated_carries_no_residual() -> None:
    model = Model(name="m", components={"a": Radius()})
    assert compile_model(model).index == 3
    with pytest.raises(ModelError, match=r"place 'a' can carry no residual: its equation is a constraint on the motion"):
        compile_model(model, places=["a"])


def test_a_residual_in_a_rigid_coupling_between_two_bodies_is_refused() -> None:
    model = Model(
        name="m",
        components={"motor": Force(), "a": Mass(), "joint": Rigid(), "b": Mass()},
        inputs={"F": "motor.f"},
        connections=[("motor.flange", "a.flange"), ("a.flange", "joint.flange_a"), ("joint.flange_b", "b.flange")],
    )
    with pytest.raises(ModelError, match=r"place 'joint' can carry no residual"):
        compile_model(model, places=["joint"])


def test_two_rigid_couplings_in_parallel_share_their_force_in_no_defined_way() -> None:
    model = Model(
        name="m",
        components={"motor": Force(), "one": Rigid(), "two": Rigid(), "b": Mass()},
        inputs={"F": "motor.f"},
        connections=[
            ("motor.flange", "one.flange_a"),
            ("motor.flange", "two.flange_a"),
            ("one.flange_b", "b.flange"),
            ("two.flange_b", "b.flange"),
        ],
    )
    with pytest.raises(ModelError, match=r"'.*' says what other equations already say, or contradicts them"):
        compile_model(model)


def test_a_rod_stated_twice_is_refused() -> None:
    model = Model(
        name="m",
        components={"bob": PointMass(), "one": Rod(), "two": Rod(), "pivot": PlanarFixed()},
        connections=[
            ("bob.point", "one.point_a"),
            ("bob.point", "two.point_a"),
            ("one.point_b", "pivot.point"),
            ("two.point_b", "pivot.point"),
        ],
    )
    with pytest.raises(ModelError, match=r"rod length of (one|two)"):
        compile_model(model)


def test_a_prescribed_motion_of_a_body_is_refused_by_input() -> None:
    model = Model(
        name="m", components={"a": Mass(), "drive": Position()}, connections=[("a.flange", "drive.flange")], inputs={"s": "drive.s"}
    )
    with pytest.raises(ModelError, match=r"would have to be differentiated"):
        compile_model(model)


class Position(Component):
    """Prescribes the position of its flange."""

    s = Variable("m")
    flange = Mass.declared_connectors["flange"]

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"drive": equal(c.flange.s, c.s)}


class Follower(Component):
    """A mass pushed by a force so that it keeps to a curve through an algebraic variable.   z + z^3 = 2 x,  z = constant y"""

    x = Variable("m", state=True)
    v = Variable("m/s", state=True)
    y = Variable("m", state=True)
    u = Variable("m/s", state=True)
    z = Variable("m")
    f = Variable("N")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "velocity x": equal(c.v, c.der(c.x)),
            "velocity y": equal(c.u, c.der(c.y)),
            "balance x": balance(c.der(c.v), c.f * (1 + 3 * c.z**2), place="x", unit="N"),
            "balance y": balance(c.der(c.u), -2 * c.f, 1.0, place="y", unit="N"),
            "curve": equal(c.z + c.z**3, 2 * c.x),
            "link": equal(ca.sin(c.z), ca.sin(c.y)),
        }


def test_an_algebraic_variable_in_a_constraint_is_differentiated_with_it() -> None:
    dae = compile_model(Model(name="m", components={"a": Follower()}))
    assert dae.index == 3
    assert "a.z" in [q.name for q in dae.states]
    assert dae.invariants.shape[0] == 4
    x, y, speed = 0.5 * (0.4 + 0.4**3), 0.4, 0.3
    v = 0.5 * (1 + 3 * 0.4**2) * speed
    initial = {"a.x": x, "a.y": y, "a.z": 0.4, "a.u": speed, "a.v": v}
    rates = simulate(dae, [0.0], initial={n: value for n, value in initial.items() if n in [q.name for q in dae.states]}).derivatives
    slope, bend = 0.5 * (1 + 3 * y**2), 3 * y  # dx/dy, d2x/dy2
    turn = (slope - bend * speed**2) / (2 * slope)  # from v' = slope u' + bend u^2 = 2 slope f and u' = 1 - 2 f
    assert rates["a.u"][0] == pytest.approx(turn)
    assert rates["a.v"][0] == pytest.approx(slope * turn + bend * speed**2)


class Contradiction(Component):
    """Two laws for the same sum of forces, and a motion that is given by another."""

    x = Variable("m", state=True)
    f = Variable("N")
    g = Variable("N")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "motion": equal(c.der(c.x), ca.sin(c.x)),
            "first": equal(c.f + c.g, c.x),
            "second": equal(c.f + c.g, ca.cos(c.x)),
        }


def test_equations_without_a_finite_index_are_named() -> None:
    with pytest.raises(ModelError, match=r"have no finite index: '(first|second) of a' and its derivatives determine nothing"):
        compile_model(Model(name="m", components={"a": Contradiction()}))
