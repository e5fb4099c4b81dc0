"""Which effects are asked of what was held out. That one goes: `test_diagnose.py`, on a machine that had it on one day alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backsight.estimation import Recording
from backsight.estimation.diagnosis.answer.verdict import Explanation, Finding, HeldOut
from backsight.estimation.diagnosis.answer.words import UNKNOWN
from backsight.estimation.diagnosis.candidates.candidate import Candidate
from backsight.estimation.diagnosis.candidates.edits import Insert
from backsight.estimation.diagnosis.proof.contradicted import minor
from backsight.estimation.diagnosis.search.standing import Standing
from backsight.models.mechanics.translational import ConstantForce

FORCE = "constant_force_body"


def found(*nats: float) -> list[Finding]:
    return [
        Finding(explanation=Explanation(place=f"place {k}", family="friction", physics="coulomb_friction"), p_value=0.0, gain=n, change="")
        for k, n in enumerate(nats)
    ]


def test_the_only_effect_and_the_largest_are_not_asked():
    assert minor([]) == []
    assert minor(found(7.0)) == []
    assert [f.gain for f in minor(found(7.0, 8.0))] == [7.0]


def test_what_gained_little_is_asked():
    assert [f.gain for f in minor(found(99.0, 900.0))] == [99.0]
    assert [f.gain for f in minor(found(5000.0, 400.0, 600.0))] == [400.0]


def test_what_gained_much_is_not():
    assert minor(found(5000.0, 600.0)) == []
    assert minor(found(101.0, 900.0)) == []


@pytest.mark.parametrize(("nats", "times", "passing"), [((20.0,), (4.0,), True), ((120.0,), (4.0,), False), ((20.0,), (None,), False)])
def test_little_that_sets_in_is_passing(nats, times, passing):
    strength = f"{FORCE}.f"
    edit = Insert(place="body", component=ConstantForce(), name=FORCE)
    whole = Candidate(place="body", family="external", physics="constant_force", strengths=(strength,), edits=(edit,))
    late = [whole if t is None else whole.since(t) for t in times]
    there = Standing(problem=None, model=None, result=None, findings=tuple(found(*nats)), accepted=tuple(late))
    assert there.passing([recorded(10.0)]) is passing
    assert not there.passing([recorded(3.0)])  # nothing sets in there


def recorded(seconds: float) -> Recording:
    time = np.linspace(0.0, seconds, 11)
    return Recording(name="held", time=time, inputs={}, outputs={"x": time}, role="held_out")


def test_beside_what_acts_all_along_or_has_no_name_or_where_nothing_is_nothing_is_passing():
    unknown = replace(found(20.0)[0], explanation=Explanation(place="body", family="unknown", physics=UNKNOWN))
    assert not Standing(problem=None, model=None, result=None).passing([recorded(10.0)])
    assert not Standing(problem=None, model=None, result=None, findings=(unknown,)).passing([recorded(10.0)])


def test_what_few_blocks_tell_of_or_what_is_predicted_plainly_better_is_not_untold():
    held = HeldOut(before={}, after={}, improvement_percent=20.0, p_value=0.01, blocks=8, recordings=("held",), role="held_out")
    assert not held.untold
    assert replace(held, improvement_percent=0.9).untold
    assert replace(held, p_value=0.2).untold
    assert replace(held, improvement_percent=-0.1, p_value=0.5).untold
    assert not replace(held, improvement_percent=-0.1, p_value=0.5, blocks=2).untold
