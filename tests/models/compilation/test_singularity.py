"""Models that are singular with the parameter values in force only."""

from dataclasses import replace

import pytest

from backsight.models import Model, ModelError, compile_model
from backsight.models.electrical import Capacitor
from backsight.models.mechanics.rotational import Gear, Inertia, Torque
from backsight.models.mechanics.translational import Backlash, SpringDamper
from backsight.models.plants import actuator, drillstring, xy_table


def parallel_gears(ratio: float) -> Model:
    return Model(
        name="parallel",
        components={"motor": Torque(), "a": Inertia(), "one": Gear(ratio=3.0), "other": Gear(ratio=ratio), "b": Inertia()},
        connections=[
            ("motor.flange", "a.flange"),
            ("a.flange", "one.flange_a"),
            ("a.flange", "other.flange_a"),
            ("one.flange_b", "b.flange"),
            ("other.flange_b", "b.flange"),
        ],
        inputs={"tau": "motor.tau"},
    )


def test_two_parallel_gears_of_one_ratio_share_their_torque_in_no_defined_way() -> None:
    with pytest.raises(
        ModelError,
        match=r"singular at its parameter values: with (one|other).ratio = 3 \[1\], (one|other).ratio = 3 \[1\], .*flange_a \(phi\)",
    ):
        compile_model(parallel_gears(3.0))


def test_two_parallel_gears_of_different_ratios_are_locked_and_leave_no_coordinate_to_name() -> None:
    assert compile_model(parallel_gears(2.0)).invariants.shape[0] == 2
    with pytest.raises(
        ModelError, match=r"states = \(b.phi\): the closed loops leave none of the coordinates b.phi free; remove a coupling"
    ):
        compile_model(replace(parallel_gears(2.0), states=("b.phi",)))


def test_a_part_that_lacks_an_inertia_is_named() -> None:
    soft = xy_table().replace("belt_2", SpringDamper())
    with pytest.raises(ModelError, match=r"with drive_2.J = 0 \[kg.m2\], .*'torque balance of drive_2' .*; give it another value"):
        compile_model(soft)
    assert compile_model(soft.with_values(drive_2={"J": 1e-4})).index == 0


def test_a_flange_that_lacks_an_inertia_is_named() -> None:
    loose = actuator().replace("screw", Backlash())
    with pytest.raises(
        ModelError, match=r"with screw.d = 0 \[N.s/m\], .*at the connection motor.flange = screw.flange_a.*add an inertia there"
    ):
        compile_model(loose)
    assert len(compile_model(actuator("compliant").replace("screw", Backlash())).states) == 4


def test_a_voltage_across_a_capacitor_is_told_what_it_fixes() -> None:
    with pytest.raises(ModelError, match=r"input 'V' \('source.v'\) fixes cap.v, so it would have to be differentiated; .*a resistance"):
        compile_model(drillstring().insert("source.p", Capacitor(), "cap"))
