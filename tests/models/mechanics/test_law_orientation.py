"""The residual of a law has the sense of the force that the law is about: it adds to it."""

from __future__ import annotations

import casadi as ca
import pytest

from backsight.models import Component, Model, compile_model
from backsight.models.electrical import TorqueMotor
from backsight.models.language import SignalInput
from backsight.models.mechanics import rotational, translational
from backsight.models.mechanics.rotational import Inertia, RotationalFixed
from backsight.models.mechanics.translational import Fixed, Mass


def _pushing(package: object) -> list[type[Component]]:
    """The elements with two equal flanges whose law is about the force through them."""
    found = []
    for name in package.__all__:  # type: ignore[attr-defined]
        kind = getattr(package, name)
        rigid = "Rigid" in name or "Gear" in name or "Rack" in name or name.endswith("Element")  # no law about a force
        if isinstance(kind, type) and issubclass(kind, Component) and not rigid:
            inputs = [s for s in kind.declared_signals.values() if isinstance(s, SignalInput)]
            if {"flange_a", "flange_b"} == set(kind.declared_connectors) and not inputs and "Sensor" not in name:
                found.append(kind)
    return found


def _gain(model: Model) -> float:
    """d v'/d w of a body of one kilogram (or one kg.m2) and the residual at "element"."""
    dae = compile_model(model, places=("element",))
    w = next(dae.w[i] for i, place in enumerate(dae.places) if place.name == "element")
    wanted = "body.omega" if "body.omega" in dae.variables else "body.v"
    i = next(i for i, q in enumerate(dae.states) if q.name == wanted)
    unknown = ca.vertcat(dae.dx, dae.z)
    change = -ca.solve(ca.jacobian(dae.residual, unknown), ca.jacobian(dae.residual, w))
    known = [ca.vertcat(unknown, dae.x, dae.u, dae.w, dae.t), dae.p]
    return float(ca.Function("gain", known, [change[i]])(0.1, dae.parameter_values()))


@pytest.mark.parametrize("kind", _pushing(rotational), ids=lambda kind: kind.__name__)
def test_a_torque_through_an_element_turns_the_body_at_flange_b(kind: type[Component]) -> None:
    parts = {"body": Inertia(J=1.0), "element": kind(), "ground": RotationalFixed()}
    ends = [("ground.flange", "element.flange_a"), ("element.flange_b", "body.flange")]
    assert _gain(Model(name="m", components=parts, connections=ends)) == pytest.approx(1.0)


@pytest.mark.parametrize("kind", _pushing(translational), ids=lambda kind: kind.__name__)
def test_a_force_through_an_element_pushes_the_body_at_flange_b(kind: type[Component]) -> None:
    parts = {"body": Mass(m=1.0), "element": kind(), "ground": Fixed()}
    ends = [("ground.flange", "element.flange_a"), ("element.flange_b", "body.flange")]
    assert _gain(Model(name="m", components=parts, connections=ends)) == pytest.approx(1.0)


def test_the_residual_of_a_torque_motor_is_a_torque_that_it_gives() -> None:
    parts = {"body": Inertia(J=1.0), "element": TorqueMotor(K=0.2)}
    model = Model(name="m", components=parts, connections=[("element.flange", "body.flange")], inputs={"i": "element.i"})
    assert _gain(model) == pytest.approx(1.0)
