"""What is said of a force that no member of the library explains."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from backsight.estimation import Problem, Recording
from backsight.estimation.diagnosis.candidates import Candidate
from backsight.estimation.diagnosis.findings import finding, nameless, verdict
from backsight.estimation.diagnosis.refit import Fitted
from backsight.estimation.results import ParameterEstimate, ResidualSummary
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


@pytest.mark.parametrize(("lacks", "told"), [(1.0, False), (40.0, True)])
def test_two_parameters_of_one_component_may_be_wrong_and_each_is_named(lacks, told):
    """A gear's ratio and its inertia stand in one component: what is said of one of them does not go for the other."""

    def judged(path: str, gain: float) -> tuple:
        value = ParameterEstimate(name=path, value=2.0, std=0.01, unit="1", fixed=False)
        c = Candidate(place="gear", family="parameter", physics="wrong_parameter", strengths=(path,), start={path: (1.0, 0.1, 9.0)})
        result = SimpleNamespace(parameters={path: value}, units={})
        return replace(c, named={path: path}), None, Fitted(candidate=c, result=result, gain=gain)

    best, other = judged("gear.ratio", 100.0), judged("gear.J", 100.0 - lacks)
    found = finding(None, best, [best, other], None, None)
    assert found.explanation.words == "wrong parameter gear.ratio"
    assert [e.words for e in found.rivals] == ["wrong parameter gear.J"] * (not told)
    assert [e.words for e in found.alternatives] == ["wrong parameter gear.J"] * told
