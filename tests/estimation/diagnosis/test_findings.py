"""What is said of a force that no member of the library explains."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from backsight.estimation import Problem, Recording
from backsight.estimation.diagnosis.findings import nameless, verdict
from backsight.estimation.results import ResidualSummary
from backsight.models.plants import PLANTS


def drilled(*recorded: tuple[str, ...]) -> Problem:
    """Recordings with these outputs."""
    time, V = np.arange(50) * 1e-2, {"V": np.ones(50)}
    recordings = [
        Recording(name=str(n), time=time, inputs=V, outputs={y: np.zeros(50) for y in outputs}, output_std=dict.fromkeys(outputs, 1e-3))
        for n, outputs in enumerate(recorded)
    ]
    return Problem(model=PLANTS["drillstring"](), recordings=recordings)


BOTH, SPEED, CURRENT = ("I_m", "Omega_r"), ("Omega_r",), ("I_m",)


@pytest.mark.parametrize(
    ("place", "recorded", "others", "separates"),
    [
        ("bha", [BOTH], ["rotary_table"], "a sensor of bha.omega"),
        ("bha", [BOTH, BOTH], ["rotary_table"], "a sensor of bha.omega"),
        ("motor", [BOTH], ["input:V"], ""),
        ("motor", [SPEED], ["rotary_table", "bha", "input:V", "sensor:Omega_r"], "a sensor of motor.i"),
        ("rotary_table", [SPEED], ["motor", "bha", "input:V", "sensor:Omega_r"], "more than one sensor more"),
        ("motor", [CURRENT, SPEED], ["rotary_table", "bha", "input:V"], "a sensor of motor.i or rotary_table.omega or bha.omega"),
        ("motor", [CURRENT, BOTH], ["input:V"], ""),
    ],
)
def test_an_unknown_force_may_be_wherever_the_outputs_cannot_tell_it_from(place, recorded, others, separates):
    left = ResidualSummary(place=place, unit="N.m", rms=0.4, origin="")
    result = SimpleNamespace(residual_places={place: left}, estimates={})
    found = nameless(place, 0.2, result, [], drilled(*recorded))
    assert found.explanation.place == place
    assert {(r.place, r.physics) for r in found.rivals} == {(other, "unknown_physics") for other in others}
    assert found.separates == separates
    assert verdict([found]) == "unknown_physics"
