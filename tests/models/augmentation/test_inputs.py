"""An input that acts as recorded plus noise."""

from __future__ import annotations

import numpy as np
import pytest
from examples import oscillator, shaken

from backsight.models import InputError, compile_model, simulate
from backsight.models.augmentation import measured_input

PLANT = compile_model(oscillator())
T = np.linspace(0.0, 1.0, 21)


def test_without_noise_the_input_acts_as_recorded():
    u = np.sin(7 * T)
    one, other = (simulate(dae, T, {"F": u}, initial={"mass.s": 0.1}) for dae in (PLANT, measured_input(PLANT, "F")))
    assert other.states["mass.s"] == pytest.approx(one.states["mass.s"], abs=1e-9)
    assert other.algebraics["F"] == pytest.approx(u, abs=1e-9)


@pytest.mark.parametrize("model", [oscillator, shaken])
def test_noise_acts_as_that_much_more_input(model):
    plant = compile_model(model())
    dae = measured_input(plant, "F")
    residual, output = dae.function()([0.3, 0.4], [0.1, 0.2], 5.0, 3.0, dae.parameter_values(), [0.0, 2.0], 0.0)
    before, output_before = plant.function()([0.3, 0.4], [0.1, 0.2], [], 5.0, plant.parameter_values(), [0.0], 0.0)
    assert residual.full()[:2] == pytest.approx(before.full())
    assert float(residual[2]) == pytest.approx(0.0)
    assert output.full() == pytest.approx(output_before.full())


def test_the_new_place_and_variable_have_the_name_and_unit_of_the_input():
    dae = measured_input(PLANT, "F")
    assert (dae.places[-1].name, dae.places[-1].unit) == ("input:F", "N")
    assert [q.name for q in dae.algebraics] == ["F"]
    assert dae.places[: len(PLANT.places)] == PLANT.places


def test_an_input_is_known_and_measured_once():
    with pytest.raises(InputError, match="no such input; known: F"):
        measured_input(PLANT, "u")
    with pytest.raises(InputError, match="noise already"):
        measured_input(measured_input(PLANT, "F"), "F")
