"""Comparisons of models on an axis that stands still for a part of its record; the truth sticks by events, not by a smooth law."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from backsight.data.generators.sliding import Body, Motion, respond
from backsight.estimation import Free, Problem, Recording
from backsight.estimation.diagnosis.evidence.worth import NONE, Worth, gains
from backsight.estimation.diagnosis.search.refit import evidence
from backsight.estimation.smoothing.begun import Begun
from backsight.estimation.smoothing.program import Settings
from backsight.estimation.smoothing.smoother import smoothing
from backsight.models import compile_model
from backsight.models.plants import actuator

STEP, DAE = 0.002, compile_model(actuator())
FREE = {"carriage.m": Free(60.0), "friction.d": Free(100.0), "friction.f_c": Free(10.0), "offset.f": Free(0.0)}


def record() -> tuple[Recording, np.ndarray]:
    """Strokes with rests of half a second between them, in which the motor pulls less than friction holds; and which rows stand still."""
    t = np.arange(0.0, 6.0, STEP)
    stroke = 90.0 * np.sin(2 * np.pi * 1.3 * t) + 60.0 * np.sin(2 * np.pi * 3.1 * t)
    force = np.where((t % 2.0) < 1.5, stroke, 5.0 * np.sin(2 * np.pi * 2.0 * t))
    x, v = (a[:-1] for a in respond(Body(m=95.0, d=203.0, f_c=20.0), force, STEP, Motion()))
    noise = 2e-6 * np.random.default_rng(0).standard_normal(len(t))
    return Recording(name="axis", time=t, inputs={"F": force}, outputs={"x": x + noise}, output_std={"x": 2e-6}), v == 0.0


RECORDING, STILL = record()


def worth(beside: Worth | None = None, **given: float) -> Worth:
    """Of the axis with these parameters held; beside another model with the room near rest that this one has."""
    problem = Problem(model=DAE, recordings=[RECORDING], parameters={**FREE, **{k.replace("_", ".", 1): v for k, v in given.items()}})
    begin = None if beside is None or beside.solution is None else Begun.of(beside.solution, problem)
    result = smoothing(problem, settings=Settings(check_mesh=False), begin=begin)
    assert result.solver.converged
    return Worth(nats=evidence(problem, result), solution=result.solution)


@cache
def sharp() -> Worth:
    return worth(friction_width=5e-4)


def test_a_sign_that_is_rounder_says_nothing_of_the_machine():
    """The same law with four times the width: evidence takes its creep at every rest for worse, and nothing but that."""
    round_one = worth(friction_width=2e-3)
    assert round_one.nats - sharp().nats < -80.0
    assert -20.0 < round_one.over(sharp()) < 5.0
    assert sharp().over(round_one) == pytest.approx(-round_one.over(sharp()))


def test_rests_are_where_the_axis_stands_still():
    (rows,) = sharp().rests.values()
    assert np.mean(rows[STILL]) > 0.9
    assert 0.1 < np.mean(rows) < 0.4


def test_strengths_are_compared_by_what_they_are_in_motion():
    """A level a tenth too low is less likely in motion by more than it is at rest, where it holds the axis as well."""
    weak = worth(friction_f_c=18.0)
    assert weak.over(sharp()) < weak.nats - sharp().nats < -100.0


def test_a_strength_that_is_found_gains_in_motion_alone_as_a_law_beside_the_known_one_would():
    """One and the same machine, told as another strength of the law that the model has or as a law of another width."""
    known = worth(friction_f_c=17.0)
    found, other = worth(known), worth(known, friction_width=6e-4)
    assert found.over(known) == pytest.approx(other.over(known), abs=2.0)
    assert found.nats - known.nats > other.over(known) + 20.0


def test_against_a_model_without_friction_rests_count():
    free = worth(friction_f_c=0.0)
    assert not free.rests
    assert free.over(sharp()) == free.nats - sharp().nats < -500.0


def test_doubt_is_that_of_stretches_about_those_beside():
    assert sharp().doubt(sharp()) == 0.0
    assert sharp().doubt(NONE) == np.inf
    less = worth(friction_f_c=18.0)
    assert 10.0 < less.doubt(sharp()) < abs(less.over(sharp())) / 2


def test_a_gain_that_is_all_of_one_part_is_no_doubt(monkeypatch):
    rng, n = np.random.default_rng(0), 4000
    noise, here = 0.3 * rng.standard_normal(n), np.arange(n) < n // 20
    monkeypatch.setattr(Worth, "rests", {})
    monkeypatch.setattr(Worth, "_densities", property(lambda self: noise + self.nats * here if self.nats else np.zeros(n)))
    one, none = Worth(nats=1.0, solution=None), Worth(nats=0.0, solution=None)
    assert one.doubt(none) == pytest.approx(0.3 * np.sqrt(n), rel=0.2)


def told(monkeypatch: pytest.MonkeyPatch, room: float) -> tuple[float, float]:
    """What counts of a gain of 60 nats all along 3000 of 4000 samples that rest, beside 200 in 40 of them; and all of it.

    room: of the other model, over that of the one.
    """
    rng, n = np.random.default_rng(0), 4000
    rests, steady = np.arange(n) < 3000, np.where(np.arange(n) < 3000, 0.02, 0.0) + 0.02 * rng.standard_normal(n)
    burst = steady + np.where((np.arange(n) >= 1000) & (np.arange(n) < 1040), 5.0, 0.0)
    monkeypatch.setattr(Worth, "rests", {"bit": rests})
    monkeypatch.setattr(Worth, "_densities", property(lambda self: burst if self.nats else np.zeros(n)))
    monkeypatch.setattr(Worth, "_at_rest", lambda self, _: ({"bit.width": 0.01}, 1.0 if self.nats else room))
    one, none = Worth(nats=float(np.sum(burst)), solution=None), Worth(nats=0.0, solution=None)
    return one.over(none), one.nats


def test_a_rest_by_the_same_law_tells_what_acts_elsewhere_all_along_and_little_of_how_a_body_breaks_away(monkeypatch):
    counts, whole = told(monkeypatch, room=1.0)
    assert whole > 250.0
    assert counts == pytest.approx(60.0, abs=10.0)


def test_a_rest_by_another_law_tells_nothing(monkeypatch):
    counts, _ = told(monkeypatch, room=2.0)
    assert counts == pytest.approx(0.0, abs=3.0)


def test_what_a_rest_tells_of_a_parameter_that_is_none_stays_its_price():
    """The record starts at rest, where a constant force beside friction is told already."""
    more = worth()
    free = Worth(nats=more.nats, solution=more.solution)
    held = worth(offset_f=0.0)
    assert -6.0 < free.nats - held.nats < 0.0
    assert free.over(held) == pytest.approx(free.nats - held.nats, abs=2.0)


def test_a_model_without_evidence_is_no_match():
    assert NONE.over(sharp()) == NONE.over(NONE) == -np.inf
    assert sharp().over(NONE) == np.inf


def test_a_richer_law_counts_against_the_plainest_one_of_its_place():
    """Both laws are new to the base: what tells them apart is how they move, and what tells them from the base is the plain one's whole."""
    base, plain, rich = worth(friction_f_c=0.0), sharp(), worth(friction_width=2e-3)
    found = gains([("carriage", (2, 7), rich), ("carriage", (1, 9), plain), ("motor", (1, 0), base)], base)
    assert found == pytest.approx([plain.over(base) + rich.over(plain), plain.over(base), 0.0])
    assert found[0] > rich.over(base) + 50.0
    # a plain one that has not arrived is none to count against
    assert gains([("carriage", (2, 7), rich), ("carriage", (1, 9), NONE)], base) == [rich.over(base), -np.inf]
