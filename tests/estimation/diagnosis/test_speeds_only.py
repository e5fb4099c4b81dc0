"""A drive of which speeds are measured and no angle: where it stands nobody can tell, and nobody needs to."""

from __future__ import annotations

from dataclasses import replace

import pytest
from two_inertias import J_2, B, posed, recorded

from backsight.estimation import Known, diagnose, smooth


def test_where_it_stands_is_given_and_said_and_moves_nothing():
    problem = replace(posed(), recordings=[recorded(1, "fit")])
    free, given = smooth(problem), smooth(replace(problem, initial={"motor.phi": Known(5.0, 1e-4)}))
    assert any("where the machine stands as a whole" in note for note in free.notes)
    assert not any("where the machine stands as a whole" in note for note in given.notes)
    for name, true in (("load.J", J_2), ("bearing.d", B)):
        p = free.parameters[name]
        assert abs(p.value - true) < 3 * p.std
        assert given.parameters[name].value == pytest.approx(p.value, rel=1e-6)
        assert given.parameters[name].std == pytest.approx(p.std, rel=1e-3)


def test_nothing_is_missing_and_models_were_compared():
    d = diagnose(posed(), jobs=1)
    assert d.verdict == "none"
    assert not any("No models were compared" in note for note in d.notes)


@pytest.mark.slow
def test_drag_at_the_load_is_found_with_its_number():
    d = diagnose(posed(drag=0.02), jobs=1)
    (finding,) = d.findings
    assert (finding.explanation.place, finding.explanation.physics) == ("load", "quadratic_drag")
    assert finding.explanation.parameters["c"].value == pytest.approx(0.02, rel=0.03)


def test_where_it_stands_is_within_the_bounds_of_what_tells_it():
    (name,) = posed().posed.initial
    bounded = replace(posed(), bounds={name: (10.0, 1e6)})
    assert bounded.posed.initial[name].value == 10.0
