"""Where physics can be attached, on the five plants as their drawings show them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from backsight.estimation.diagnosis.candidates.places import at_hand, bodies, elements, neighbours, node, sensors
from backsight.models import Component, Model, Parameter, Variable, balance, equal
from backsight.models.connectors import Translational
from backsight.models.mechanics.planar import Body, FrameFixed, Revolute, World
from backsight.models.mechanics.rotational import Torque
from backsight.models.mechanics.translational import Damper, Fixed, Force, PositionSensor
from backsight.models.plants import PLANTS, actuator
from backsight.models.signals import Lag


def named(spots) -> dict[str, str]:
    return {spot.name: spot.kind for spot in spots}


@pytest.mark.parametrize(
    ("plant", "expected"),
    [
        ("actuator", {"carriage": "translational"}),
        ("xy_table", {f"drive_{i}": "rotational" for i in (1, 2, 3)} | {f"slide_{i}": "translational" for i in (1, 2)}),
        ("drillstring", {"motor": "rotational", "rotary_table": "rotational", "bha": "rotational"}),
        ("five_bar", {f"joint_{i}": "rotational" for i in range(1, 6)}),
        ("quadrotor", {}),
    ],
)
def test_bodies_are_what_slides_or_turns_and_the_axes_of_joints(plant, expected):
    assert named(bodies(PLANTS[plant]())) == expected


@pytest.mark.parametrize(
    ("plant", "expected"),
    [
        ("actuator", {"screw": "translational"}),
        ("xy_table", {"spindle": "rotational"} | {f"belt_{i}": "translational" for i in (1, 2, 3)}),
        ("drillstring", {"string": "rotational"}),
        ("five_bar", {}),
        ("quadrotor", {}),
    ],
)
def test_elements_are_between_two_bodies_and_not_between_one_and_the_ground(plant, expected):
    found = elements(PLANTS[plant]())
    assert named(found) == expected
    assert all(len(spot.flanges) == 2 for spot in found)


def test_a_compliant_screw_has_a_body_at_either_end():
    model = actuator(screw="compliant")
    assert named(bodies(model)) == {"motor_mass": "translational", "carriage": "translational"}
    assert named(elements(model)) == {"screw": "translational"}


class Slider(Component):
    """A body that is joined at either end."""

    s = Variable("m", state=True)
    v = Variable("m/s", state=True)
    flange_a = Translational()
    flange_b = Translational()
    m = Parameter("kg", 2.0, min=0.0)

    def equations(self, c):
        return {
            "position at a": equal(c.s, c.flange_a.s),
            "position at b": equal(c.s, c.flange_b.s),
            "velocity": equal(c.v, c.der(c.s)),
            "force balance": balance(c.m * c.der(c.v), c.flange_a.f, c.flange_b.f),
        }


def test_a_body_with_two_flanges_is_a_body_and_what_brakes_it_at_either_is_its_own():
    model = Model(
        name="slide",
        components={"motor": Force(), "car": Slider(), "brake": Damper(d=3.0), "rail": Fixed(), "eye": PositionSensor()},
        connections=(
            ("motor.flange", "car.flange_a"),
            ("brake.flange_a", "car.flange_b"),
            ("brake.flange_b", "rail.flange"),
            ("eye.flange", "car.flange_b"),
        ),
        inputs={"F": "motor.f"},
        outputs={"x": "eye.s"},
    )
    (spot,) = bodies(model)
    assert (spot.name, spot.flanges) == ("car", ("flange_a",))
    assert elements(model) == []
    assert at_hand(model, spot, ("d",)) == {"d": ["brake.d"]}


def test_a_sensor_is_found_behind_the_blocks_in_its_channel_and_a_body_that_is_read_directly_is_none():
    model = actuator()
    assert sensors(model) == {"encoder"}
    late = model.insert("sensor:x", Lag(tau=0.01), "filter")
    assert sensors(late) == {"encoder", "filter"}
    assert sensors(replace(model, outputs={"x": "carriage.s"})) == set()


def test_a_node_is_all_flanges_that_are_joined():
    model = actuator()
    expected = {"screw.flange_b", "carriage.flange", "friction.flange_a", "offset.flange_a"}
    for flange in expected:
        assert node(model, flange) == expected
    assert neighbours(model, "carriage.flange") == {"screw", "carriage", "friction", "offset"}


def test_what_a_body_has_already_is_what_stands_between_it_and_the_ground():
    model = actuator()
    (carriage,) = bodies(model)
    found = at_hand(model, carriage, ("d", "f_c", "m", "k"))
    assert found == {"d": ["friction.d"], "f_c": ["friction.f_c"], "m": ["carriage.m"]}
    soft = actuator(screw="compliant")
    end = next(spot for spot in bodies(soft) if spot.name == "carriage")
    assert at_hand(soft, end, ("d", "k"))["d"] == ["friction.d"]  # that of the screw is between two bodies
    assert "k" not in at_hand(soft, end, ("d", "k"))
    rotor = next(spot for spot in bodies(PLANTS["drillstring"]()) if spot.name == "rotary_table")
    assert at_hand(PLANTS["drillstring"](), rotor, ("d",)) == {"d": ["rotary_table.d"]}


def test_a_joint_whose_angle_is_an_output_by_itself_is_a_place_all_the_same():
    parts = {"world": World(), "base": FrameFixed(), "hinge": Revolute(), "rod": Body(m=0.8, y_c=-0.3, I=0.02), "motor": Torque()}
    joined = [("base.frame", "hinge.frame_a"), ("hinge.frame_b", "rod.frame"), ("motor.flange", "hinge.axis")]
    model = Model(name="pendulum", components=parts, connections=joined, inputs={"tau": "motor.tau"}, outputs={"phi": "hinge.phi"})
    assert named(bodies(model)) == {"hinge": "rotational"}
