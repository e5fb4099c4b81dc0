"""Positions of which only differences matter are found, and no others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backsight.models import Model, compile_model
from backsight.models.gauges import Gauges
from backsight.models.mechanics.rotational import (
    AngleSensor,
    AngularVelocitySensor,
    Gear,
    Inertia,
    Rack,
    RotationalSpring,
    RotationalSpringDamper,
    Torque,
)
from backsight.models.mechanics.translational import Cogging, EndStop, Fixed, Mass, Spring
from backsight.models.plants import drillstring, five_bar, xy_table

RATIO = 9.0


def train(*, angle: bool = False, held: bool = False) -> Model:
    """A motor, a gear, a soft shaft, a wheel and what it moves; angle: of the wheel, is read; held: a spring to the ground at the end."""
    components = {
        "source": Torque(), "motor": Inertia(J=0.01), "gear": Gear(ratio=RATIO), "shaft": RotationalSpringDamper(k=50.0, d=0.1),
        "wheel": Inertia(J=0.3), "tyre": Rack(r=0.25), "load": Mass(m=4.0), "speed": AngularVelocitySensor(),
        "encoder": AngleSensor() if angle else AngularVelocitySensor(),
    }  # fmt: skip
    connections = [
        ("source.flange", "motor.flange"), ("motor.flange", "gear.flange_a"), ("gear.flange_b", "shaft.flange_a"),
        ("shaft.flange_b", "wheel.flange"), ("wheel.flange", "tyre.wheel"), ("tyre.rack", "load.flange"),
        ("speed.flange", "motor.flange"), ("encoder.flange", "wheel.flange"),
    ]  # fmt: skip
    if held:
        components |= {"band": Spring(k=10.0), "bed": Fixed()}
        connections += [("load.flange", "band.flange_a"), ("band.flange_b", "bed.flange")]
    return Model(
        name="train",
        components=components,
        connections=connections,
        inputs={"tau": "source.tau"},
        outputs={"n": "speed.omega", "y": "encoder.phi" if angle else "encoder.omega"},
    )


def of(model: Model, outputs=None, kept=()) -> list[str]:
    dae = compile_model(model)
    read = [q.name for q in dae.outputs] if outputs is None else outputs
    return [dae.states[i].name for i in Gauges(dae, np.array([p.value for p in dae.parameters])).open(read, kept)]


def test_speeds_do_not_tell_where_a_machine_stands():
    (one,) = of(train())
    assert one in {"motor.phi", "wheel.phi", "load.s"}


def test_one_that_is_held_tells_where_all_of_it_stands():
    held = "motor.phi" if "motor.phi" in {q.name for q in compile_model(train()).states} else "wheel.phi"
    assert of(train(), kept=[held]) == []


@pytest.mark.parametrize("model", [train(angle=True), train(held=True)])
def test_an_angle_that_is_read_and_a_spring_to_the_ground_tell_it(model):
    assert of(model) == []


def test_of_outputs_only_those_that_are_read_count():
    assert of(train(angle=True), outputs=["n"])


def test_a_spring_that_is_fixed_at_nothing_is_one_all_the_same():
    soft = train(held=True)
    assert of(replace(soft, components={**soft.components, "band": Spring(k=0.0)})) == []


def test_two_machines_stand_each_somewhere():
    parts = {"a": Inertia(J=1.0), "b": Inertia(J=2.0), "c": Inertia(J=3.0), "one": RotationalSpring(k=4.0), "n": AngularVelocitySensor()}
    two = Model(
        name="two",
        components={**parts, "drive": Torque(), "other": AngularVelocitySensor()},
        connections=[("a.flange", "one.flange_a"), ("one.flange_b", "b.flange"), ("drive.flange", "c.flange"), ("n.flange", "c.flange"),
                     ("other.flange", "a.flange")],
        inputs={"tau": "drive.tau"},
        outputs={"n": "n.omega", "m": "other.omega"},
    )  # fmt: skip
    found = of(two)
    assert len(found) == 2
    assert "c.phi" in found


@pytest.mark.parametrize("plant", [xy_table, drillstring, five_bar])
def test_plants_whose_outputs_tell_have_none(plant):
    assert of(plant()) == []


@pytest.mark.parametrize("far", [0.3, 2.0, 40.0, 400.0])
def test_a_stop_tells_it_however_far_away(far):
    stop = train(held=True)
    parts = {**stop.components, "band": EndStop(x=far, k=1e4, d=10.0)}
    assert of(replace(stop, components=parts)) == []


def along(model: Model, *names: str) -> list[str]:
    dae = compile_model(model)
    indices = [i for i, q in enumerate(dae.parameters) if q.name in names]
    found = Gauges(dae, np.array([q.value for q in dae.parameters]), indices).taken_along([q.name for q in dae.outputs])
    return [dae.parameters[indices[k]].name for k in found]


def test_a_shift_takes_the_phase_of_a_wave_along_and_not_its_size():
    waves = train(held=True)
    waves = replace(waves, components={**waves.components, "band": Cogging(amplitude=3.0, period=0.05)})
    assert of(waves) == []
    assert along(waves, "band.amplitude", "band.period", "band.phase") == ["band.phase"]
    assert along(waves, "band.amplitude", "band.period") == []
    read = {**waves.components, "encoder": AngleSensor()}
    assert along(replace(waves, components=read, outputs={"y": "encoder.phi"}), "band.phase") == []


def test_it_takes_the_place_of_a_stop_along():
    stop = train(held=True)
    stop = replace(stop, components={**stop.components, "band": EndStop(x=0.3, k=1e4)})
    assert along(stop, "band.x", "band.k") == ["band.x"]


def test_what_is_no_number_anywhere_tells_what_it_depends_on():
    dae = compile_model(train(held=True))
    lost = np.array([np.nan if p.name == "band.k" else p.value for p in dae.parameters])
    assert Gauges(dae, lost).open([q.name for q in dae.outputs]) == []
