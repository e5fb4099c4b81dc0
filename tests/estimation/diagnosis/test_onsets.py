"""Effects that set in at a known time, and such as act all along."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from concealed_axis import posed, run

from backsight.estimation import Free, smooth
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.scores.onsets import ONSETS, clocks_notes, dated, late, onset
from backsight.estimation.diagnosis.scores.score import Linearised
from backsight.estimation.diagnosis.scores.screen import screen
from backsight.estimation.diagnosis.scores.supermodel import looked_at
from backsight.estimation.diagnosis.search.choice import SAME

DURATION = 1.5


def looks(physics: str, force, known=(), **carriage):
    problem = posed(run(DURATION, 2e-3, force=force, **carriage), **dict(known))
    result = smooth(problem)
    base = Linearised(result.solution)
    found = [c for c in library(problem, problem.model, result.solution) if c.key == ("carriage", physics)]
    return base, looked_at(problem, problem.model, base, found)


def judged(physics: str, force, known=(), **carriage):
    """The best of what sets in, dated; None where nothing does."""
    base, some = looks(physics, force, known, **carriage)
    found = [s for s in screen(base, some, late(base, some)).found if s.candidate.onset is not None]
    return dated(base, found[0]) if found else None


@pytest.mark.parametrize("at", [0.5, 1.0])
def test_a_force_that_sets_in_is_dated_and_measured(at):
    found = judged("constant_force", lambda t, *_: np.array([-8.0 if t > at else 0.0]))
    assert found.candidate.onset == pytest.approx(at, abs=DURATION / 200)
    assert found.estimate == pytest.approx([8.0], rel=0.05)
    assert found.candidate.edits[-1].words == f"constant_force_carriage.f from {found.candidate.onset:.7g} s on"


def test_what_sets_in_keeps_its_twin():
    """A force from some time on, and an input's offset from then on, are one to the recordings; dates that are refined change nothing."""
    problem = posed(run(DURATION, 2e-3, force=lambda t, *_: np.array([-8.0 if t > 0.5 else 0.0])))
    result = smooth(problem)
    base = Linearised(result.solution)
    some = looked_at(problem, problem.model, base, library(problem, problem.model, result.solution))
    found = screen(base, some, late(base, some), draws=0)
    one, twin = (
        next(s for s in found.found if s.candidate.physics == physics and s.candidate.onset is not None)
        for physics in ("constant_force", "input_offset")
    )
    assert dated(base, one) is not one
    assert found.alike(dated(base, one), twin) > SAME


def test_friction_that_sets_in_is_dated_too():
    found = judged("coulomb_friction", lambda t, _, v: -8.0 * np.tanh(v / 1e-3) * (t > 0.8))
    assert found.candidate.onset == pytest.approx(0.8, abs=DURATION / 100)
    assert found.estimate == pytest.approx([8.0], rel=0.1)


def test_so_is_friction_that_grows_where_the_model_estimates_friction():
    grows = {"friction__f_c": Free(10.0)}
    found = judged("coulomb_friction", lambda t, _, v: -8.0 * np.tanh(v / 1e-3) * (t > 0.8), grows, f_c=12.0)
    assert found.candidate.onset == pytest.approx(0.8, abs=DURATION / 50)
    assert found.estimate == pytest.approx([8.0], rel=0.2)


@pytest.mark.parametrize(("physics", "carriage"), [("constant_force", {"f_0": 8.0}), ("coulomb_friction", {"f_c": 8.0})])
def test_what_acts_all_along_has_no_date(physics, carriage):
    base, some = looks(physics, None, **carriage)
    found = screen(base, some, late(base, some)).found
    assert [s.candidate.onset for s in found] == [None]
    assert onset(base, found[0]) is None
    assert np.abs(found[0].estimate) == pytest.approx([8.0], rel=0.1)


def test_what_no_component_tells_is_dated_by_its_score():
    base, some = looks("asymmetric_friction", lambda t, _, v: -8.0 * np.tanh(v / 1e-3) * (t > 0.8))
    levels = [look for look in some if len(look.columns) == 2 and "plus" in look.candidate.strengths[0]]
    (found,) = screen(base, levels[-1:], late(base, levels)).found
    assert found.candidate.onset is None
    assert onset(base, found) == pytest.approx(0.8, abs=DURATION / 50)


def test_of_recordings_that_have_each_a_clock_it_sets_in_at_the_same_time_of_each():
    def steps_up(t, *_):
        return np.array([-8.0 if t > 0.4 else 0.0])

    one = posed(run(0.8, 2e-3, force=steps_up))
    (first,) = one.recordings
    both = replace(one, recordings=[first, replace(first, name="again")])
    base = Linearised(smooth(both).solution)
    some = looked_at(
        both, both.model, base, [c for c in library(both, both.model, base.solution) if c.key == ("carriage", "constant_force")]
    )
    assert len(list(late(base, some))) == ONSETS
    found = dated(base, screen(base, some, late(base, some)).found[0])
    assert found.candidate.onset == pytest.approx(0.4, abs=0.8 / 200)
    assert found.estimate == pytest.approx([8.0], rel=0.05)


def test_nobody_looks_into_a_pause_but_at_its_end():
    made = run(0.3, 2e-3)
    one = posed(made)
    both = replace(one, recordings=[one.recordings[0], replace(one.recordings[0], name="later", time=made.time + 3600.0)])
    base = Linearised(smooth(both).solution)
    some = looked_at(
        both, both.model, base, [c for c in library(both, both.model, base.solution) if c.key == ("carriage", "coulomb_friction")]
    )
    times = np.array([look.candidate.onset for look in late(base, some)])
    assert np.all((times < 0.3) | (times >= 3600.0))
    assert np.sum(times < 0.3) == ONSETS / 2
    assert np.sum(times == 3600.0) == 1
    assert times[-1] < 3600.3


def test_where_clocks_overlap_a_note_says_what_setting_in_means():
    (first,) = posed(run(0.2, 2e-3)).recordings
    later = replace(first, name="later", time=first.time + first.time[-1] + 1.0)
    assert clocks_notes([first]) == clocks_notes([later, first]) == []
    (said,) = clocks_notes([first, later, replace(first, name="again")])
    assert "at the same time of each" in said
