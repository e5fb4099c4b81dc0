"""A residual between a position and its velocity."""

from __future__ import annotations

import pytest
from examples import oscillator

from backsight.models import InputError, compile_model
from backsight.models.augmentation import relaxed_kinematics

PLANT = compile_model(oscillator())


def test_the_rate_of_the_position_is_the_velocity_plus_the_residual():
    dae = relaxed_kinematics(PLANT, "mass.s")
    residual, _ = dae.function()([0.9, 0.0], [0.0, 0.7], [], 0.0, dae.parameter_values(), [0.0, 0.2], 0.0)
    row = next(r for r, e in enumerate(dae.equations) if e.place == 1)
    assert float(residual[row]) == pytest.approx(0.0)
    assert [q.name for q in dae.states] == ["mass.s", "mass.v"]
    assert (dae.places[1].name, dae.places[1].unit) == ("kinematics:mass.s", "m/s")


def test_the_row_is_no_identity_any_more():
    assert len(PLANT.kinematics) == 1
    assert relaxed_kinematics(PLANT, "mass.s").kinematics == ()


@pytest.mark.parametrize("state", ["mass.v", "mass.x"])
def test_only_a_position_can_be_relaxed(state):
    with pytest.raises(InputError, match=r"has no position of that name with a velocity beside it; did you mean 'mass\.s'\?"):
        relaxed_kinematics(PLANT, state)


def test_once_is_enough():
    with pytest.raises(InputError, match="a residual already"):
        relaxed_kinematics(relaxed_kinematics(PLANT, "mass.s"), "mass.s")
