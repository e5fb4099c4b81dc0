"""Ignorable coordinates: a position of which only the velocity matters is no state."""

from typing import Any

import numpy as np
import pytest

from backsight.models import (
    Component,
    Equation,
    Model,
    ModelError,
    Parameter,
    Rotational,
    Variable,
    balance,
    compile_model,
    equal,
    law,
    simulate,
)
from backsight.models.mechanics.rotational import Inertia
from backsight.models.mechanics.translational import Fixed, Force, Spring, VelocitySensor

J_A, J_B, K = 0.4, 0.1, 3.0


class Disc(Component):
    """A body that declares its speed and no angle.   J omega' = tau"""

    omega = Variable("rad/s", state=True)
    flange = Rotational()
    J = Parameter("kg.m2", 1.0, min=1e-9)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"speed": equal(c.omega, c.der(c.flange.phi)), "torque balance": balance(c.J * c.der(c.omega), c.flange.tau)}


class Twist(Component):
    """A shaft that declares its twist.   tau = k dphi"""

    dphi = Variable("rad", state=True)
    angle = Variable("rad")
    flange_a = Rotational()
    flange_b = Rotational()
    k = Parameter("N.m/rad", K, min=0.0)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "twist": equal(c.dphi, c.flange_a.phi - c.flange_b.phi),
            "angle": equal(c.angle, c.flange_b.phi),
            "shaft": law(c.flange_a.tau, c.k * c.dphi),
            "torque at flange_b": equal(c.flange_b.tau, -c.flange_a.tau),
        }


def drill(outputs: dict[str, str], body: type[Component] = Disc) -> Model:
    return Model(
        name="drill",
        components={"top": body(J=J_A), "shaft": Twist(), "bit": body(J=J_B)},
        connections=[("top.flange", "shaft.flange_a"), ("shaft.flange_b", "bit.flange")],
        outputs=outputs,
    )


def test_two_bodies_on_a_shaft_are_two_speeds_and_a_twist() -> None:
    dae = compile_model(drill({"omega": "bit.omega"}))
    assert [q.name for q in dae.states] == ["top.omega", "shaft.dphi", "bit.omega"]
    assert (dae.algebraics, dae.index) == ((), 0)
    run = simulate(dae, t := np.linspace(0, 2, 81), initial={"top.omega": 1.0})
    mean, swing = J_A / (J_A + J_B), np.sqrt(K * (1 / J_A + 1 / J_B))
    assert run.outputs["omega"] == pytest.approx(mean * (1 - np.cos(swing * t)), abs=1e-8)
    assert run.states["shaft.dphi"] == pytest.approx(np.sin(swing * t) / swing, abs=1e-8)
    assert run.derivatives["shaft.dphi"] == pytest.approx(run.states["top.omega"] - run.states["bit.omega"], abs=1e-9)


def test_a_variable_that_needs_the_pruned_coordinate_is_left_out() -> None:
    known = compile_model(drill({"omega": "bit.omega"})).variables
    assert {"shaft.dphi", "bit.flange.tau", "top.omega"} <= known.keys()
    assert not {"shaft.angle", "bit.flange.phi", "top.flange.phi"} & known.keys()


def test_a_coordinate_that_is_measured_is_kept() -> None:
    dae = compile_model(drill({"phi": "shaft.angle"}))
    assert dae.x.shape[0] == 4
    run = simulate(dae, t := np.linspace(0, 2, 81), initial={"top.omega": 1.0})
    mean, swing = J_A / (J_A + J_B), np.sqrt(K * (1 / J_A + 1 / J_B))
    turned = mean * (t - np.sin(swing * t) / swing)
    assert run.outputs["phi"] - run.outputs["phi"][0] == pytest.approx(turned, abs=1e-8)


def test_a_difference_that_is_measured_needs_no_coordinate() -> None:
    class Reader(Component):
        """The difference of two angles."""

        difference = Variable("rad")
        flange_a = Rotational()
        flange_b = Rotational()

        def equations(self, c: Any) -> dict[str, Equation]:
            a, b = c.flange_a, c.flange_b
            return {"reading": equal(c.difference, a.phi - b.phi), "free a": equal(a.tau, 0), "free b": equal(b.tau, 0)}

    bare = drill({})
    joints = [*bare.connections, ("reader.flange_a", "top.flange"), ("reader.flange_b", "bit.flange")]
    model = Model(
        name="read", components={**bare.components, "reader": Reader()}, connections=joints, outputs={"difference": "reader.difference"}
    )
    dae = compile_model(model)
    assert [q.name for q in dae.states] == ["top.omega", "shaft.dphi", "bit.omega"]


def test_bodies_that_declare_their_angle_keep_it() -> None:
    dae = compile_model(drill({"omega": "bit.omega"}, body=Inertia))
    assert {q.name for q in dae.states} == {"top.phi", "top.omega", "shaft.dphi", "bit.omega"}
    assert {"bit.phi", "shaft.angle"} <= dae.variables.keys()  # = top.phi - shaft.dphi


def test_a_velocity_that_two_laws_share_becomes_an_algebraic() -> None:
    class Drag(Component):
        """A point without mass against linear and cubic drag.   f = d s' + c s'^3"""

        s = Variable("m")
        v = Variable("m/s")
        f = Variable("N")
        d = Parameter("N.s/m", 2.0, min=0.0)
        c3 = Parameter("N.s3/m3", 0.5, min=0.0)

        def equations(self, c: Any) -> dict[str, Equation]:
            return {"velocity": equal(c.v, c.der(c.s)), "drag": equal(c.f, c.d * c.der(c.s) + c.c3 * c.der(c.s) ** 3)}

    dae = compile_model(Model(name="m", components={"a": Drag()}, inputs={"F": "a.f"}, outputs={"v": "a.v"}))
    assert (dae.x.shape[0], dae.z.shape[0]) == (0, 1)
    run = simulate(dae, [0.0, 1.0], {"F": 5.0})
    v = run.outputs["v"][0]
    assert 2.0 * v + 0.5 * v**3 == pytest.approx(5.0)


def test_the_velocity_of_a_point_that_has_no_state_cannot_be_measured() -> None:
    model = Model(
        name="light",
        components={"motor": Force(), "spring": Spring(k=2.0), "ground": Fixed(), "speed": VelocitySensor()},
        connections=[("motor.flange", "spring.flange_a"), ("spring.flange_b", "ground.flange"), ("speed.flange", "motor.flange")],
        inputs={"F": "motor.f"},
        outputs={"v": "speed.v"},
    )
    with pytest.raises(ModelError, match=r"output 'v' \('speed.v'\) 'spring.s_rel', which no state determines, would have to be"):
        compile_model(model)
