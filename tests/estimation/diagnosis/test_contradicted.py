"""Which effects are asked of what was held out. That one goes: `test_diagnose.py`, on a machine that had it on one day alone."""

from __future__ import annotations

from backsight.estimation.diagnosis.answer.verdict import Explanation, Finding
from backsight.estimation.diagnosis.proof.contradicted import minor


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
