"""A machine that a stiff servo moves against a force that its model lacks, as large as all others together."""

from __future__ import annotations

from dataclasses import replace

import pytest
from concealed_axis import posed, run

from backsight.estimation import Weights, smooth
from backsight.estimation.diagnosis import diagnose
from backsight.estimation.diagnosis.start.inflated import with_inertias_bounded

STEP = 2e-3
STIFF = 8e3  # N/m


def sprung(_, x, __):
    """Force of a spring [N]."""
    return -STIFF * x


def test_an_inertia_that_would_answer_for_what_is_missing_is_bounded():
    made = posed(run(2.0, STEP, force=lambda _, x, __: 4e4 * x), W={})
    found = smooth(made)
    assert found.parameters["carriage.m"].value > 300.0
    held, said = with_inertias_bounded(made, found)
    assert held.parameters["carriage.m"].max == 270.0
    assert held.parameters["friction.d"] == made.parameters["friction.d"]
    assert "With nothing put right carriage.m would be" in said
    given = replace(made, weights=Weights(V={"F": 1.0}))
    assert with_inertias_bounded(given, found) == (given, "")


def test_a_mass_near_its_guess_is_not():
    made = posed(run(2.0, STEP, f_c=20.0), W={})
    assert with_inertias_bounded(made, smooth(made)) == (made, "")


@pytest.mark.slow
def test_a_spring_as_strong_as_all_other_forces_is_found():
    """Without a bound the mass ends beyond 1e20 kg, and so does all that is fitted beside it."""
    d = diagnose(posed(run(3.0, STEP, force=sprung), W={}), jobs=1)
    (found,) = d.findings
    assert found.explanation.words == "spring at carriage"
    k = found.explanation.parameters["k"]
    assert k.std is not None
    assert abs(k.value - STIFF) < 4 * k.std
    assert k.value == pytest.approx(STIFF, rel=1e-3)
    assert d.after.parameters["carriage.m"].value == pytest.approx(95.1, rel=2e-3)
    assert any("carriage.m would be" in note for note in d.notes)
