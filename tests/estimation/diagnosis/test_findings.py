"""What is said of a force that no member of the library explains."""

from __future__ import annotations

import numpy as np
import pytest

from backsight.estimation import Problem, Recording
from backsight.estimation.diagnosis.findings import nameless, verdict
from backsight.estimation.results import ResidualSummary
from backsight.models.plants import PLANTS


def drilled(*outputs: str) -> Problem:
    time = np.arange(50) * 1e-2
    read = {name: np.zeros(50) for name in outputs}
    recording = Recording(name="run", time=time, inputs={"V": np.ones(50)}, outputs=read, output_std=dict.fromkeys(outputs, 1e-3))
    return Problem(model=PLANTS["drillstring"](), recordings=[recording])


@pytest.mark.parametrize(
    ("place", "outputs", "others", "separates"),
    [
        ("bha", ("I_m", "Omega_r"), ["rotary_table"], "a sensor of string.dphi or bha.omega"),
        ("motor", ("I_m", "Omega_r"), [], ""),
        ("motor", ("Omega_r",), ["rotary_table", "bha"], "a sensor of motor.i"),
    ],
)
def test_an_unknown_force_may_be_wherever_the_outputs_cannot_tell_it_from(place, outputs, others, separates):
    left = ResidualSummary(place=place, unit="N.m", rms=0.4, origin="")
    found = nameless(place, 0.2, left, [], drilled(*outputs))
    assert found.explanation.place == place
    assert [(r.place, r.physics) for r in found.rivals] == [(other, "unknown_physics") for other in others]
    assert found.separates == separates
    assert verdict([found]) == "unknown_physics"
