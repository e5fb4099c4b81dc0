"""Start values of variables that others stand for."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from backsight.models import Component, Equation, Model, ModelError, Parameter, Variable, balance, compile_model, equal, simulate
from backsight.models.connectors import Rotational
from backsight.models.mechanics.rotational import AngleSensor, Gear, Inertia, Torque
from backsight.models.mechanics.translational import PositionSensor
from backsight.models.plants import actuator, drillstring
from backsight.models.signals import Lag


class Wound(Component):
    """A body whose declaration says where it starts: 0.7 rad, 2 rad/s."""

    phi = Variable("rad", start=0.7)
    omega = Variable("rad/s", start=2.0)
    flange = Rotational()
    J = Parameter("kg.m2", 1.0, min=0.0)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "angle": equal(c.phi, c.flange.phi),
            "velocity": equal(c.omega, c.der(c.phi)),
            "balance": balance(c.J * c.der(c.omega), c.flange.tau),
        }


def coupled(**changes: Any) -> Model:
    """A body, and another that is declared to start elsewhere, behind a gear of ratio 4: the second turns four times as far."""
    values: dict[str, Any] = {
        "name": "coupled",
        "components": {"motor": Torque(), "body": Inertia(), "gear": Gear(ratio=4.0), "load": Wound(), "encoder": AngleSensor()},
        "connections": [
            ("motor.flange", "body.flange"),
            ("load.flange", "gear.flange_a"),
            ("gear.flange_b", "body.flange"),
            ("encoder.flange", "load.flange"),
        ],
        "inputs": {"tau": "motor.tau"},
        "outputs": {"phi": "encoder.phi"},
    }
    return Model(**{**values, **changes})


def starts(model: Model) -> dict[str, float]:
    return {q.name: q.start for q in compile_model(model).states}


def test_declared_start_values_of_an_eliminated_body_reach_the_states() -> None:
    assert starts(coupled()) == pytest.approx({"body.phi": 0.175, "body.omega": 0.5})


def test_start_values_of_the_model_come_before_declared_ones() -> None:
    assert starts(coupled(start={"body.phi": 0.0, "load.omega": 1.0})) == pytest.approx({"body.phi": 0.0, "body.omega": 0.25})
    assert starts(coupled(start={"load.phi": 0.0})) == pytest.approx({"body.phi": 0.0, "body.omega": 0.5})


def test_of_contradictory_declared_values_the_first_counts() -> None:
    model = coupled().insert("gear.flange_b", Wound(), "third").insert("third", Inertia(), "fourth")
    assert starts(model) == pytest.approx({"body.phi": 0.175, "body.omega": 0.5})


@pytest.mark.parametrize(
    ("model", "name", "text"),
    [
        (actuator(), "motor.f", r"it is the input 'F', whose values are given from the first sample on; leave it out$"),
        (actuator(), "screw.f", r"'screw\.f' follows from motor\.f \(.*\), without a start value; leave it out$"),
        (drillstring(), "gear.flange_b.phi", r"only on its rate; leave it out, or measure it as an output to keep it$"),
        (drillstring(), "gear.flange_a.phi", r"follows from gear\.flange_b\.phi \(.*\).*leave it out, or measure it as an output"),
        (
            actuator().replace("encoder", PositionSensor(gain=0.0)),
            "encoder.s",
            r"with the parameter values in force no state tells 'encoder\.s' \(.*\); leave it out$",
        ),
    ],
)
def test_a_start_value_without_effect_is_refused_with_the_remedy(model: Model, name: str, text: str) -> None:
    with pytest.raises(ModelError, match=rf"start '{name}' = 5: .*{text}"):
        compile_model(replace(model, start={name: 5.0}))
    compile_model(model)


@pytest.mark.parametrize("name", ["gear.flange_a.phi", "gear.flange_b.phi"])
def test_a_pruned_coordinate_starts_where_told_once_it_is_measured(name: str) -> None:
    model = drillstring()
    kept = replace(model, start={name: 5.0}, outputs={**model.outputs, "angle": name})
    assert simulate(compile_model(kept), [0.0], {"V": 0.0}).outputs["angle"][0] == pytest.approx(5.0)


def test_a_simulation_starts_where_variables_that_others_stand_for_are_told_to() -> None:
    dae = compile_model(coupled())
    run = simulate(dae, [0.0], {"tau": 0.0}, initial={"load.phi": 0.5, "load.omega": 1.0})
    assert (run.states["body.phi"][0], run.states["body.omega"][0]) == pytest.approx((0.125, 0.25))
    stiff = simulate(dae, [0.0], {"tau": 0.0}, {"gear.ratio": 10.0}, {"load.phi": 0.5})
    assert stiff.states["body.phi"][0] == pytest.approx(0.05)
    lagged = compile_model(actuator().insert("input:F", Lag(tau=0.1), "lag"))
    assert simulate(lagged, [0.0], {"F": 0.0}, initial={"motor.f": 3.0}).states["lag.y"][0] == 3.0


def test_initial_values_that_contradict_each_other_are_refused() -> None:
    with pytest.raises(ModelError, match=r"initial\['load\.phi'\] = 1 makes body\.phi = 0\.25, and another makes it 1; keep one of them"):
        simulate(compile_model(coupled()), [0.0], {"tau": 0.0}, initial={"body.phi": 1.0, "load.phi": 1.0})
    with pytest.raises(ModelError, match=r"initial\['nowhere\.phi'\]: model 'coupled' has no such state"):
        simulate(compile_model(coupled()), [0.0], {"tau": 0.0}, initial={"nowhere.phi": 1.0})
