"""A machine that a stiff servo moves slowly against dry friction, which is nearly all of the force there is.

While it slides the force of the drive has the sign of the velocity, so a dead zone of the drive takes as much of it as friction does, and
while it sticks either may hold it. Signs that are rounded tell them apart all the same, which is no physics.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from math import inf

import numpy as np
import pytest
from concealed_axis import LEFT, posed
from diagnoses import found

from backsight.data.generators import actuator as machine
from backsight.data.generators.run import Run
from backsight.estimation import Free, Problem
from backsight.estimation.diagnosis import diagnose
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.search.amended import stood_in
from backsight.estimation.diagnosis.search.elimination import alone
from backsight.estimation.diagnosis.search.fits import Fits
from backsight.estimation.diagnosis.search.keep import Keep
from backsight.estimation.diagnosis.search.refit import QUICKLY, settled
from backsight.estimation.diagnosis.search.refit import posed as having
from backsight.estimation.diagnosis.search.search import Search
from backsight.estimation.diagnosis.search.standing import Standing
from backsight.estimation.smoothing.smoother import smoothing

POOL = ProcessPoolExecutor(1)  # no fit of a candidate is asked of it
FREQUENCIES, AMPLITUDES = np.array([0.15, 0.27, 0.4]), np.array([0.06, 0.03, 0.015])  # Hz, m


def slow(f_c: float, duration: float, dead: float = 0.0, faster: float = 1.0) -> Run:
    """Sines under friction of f_c [N], event by event; dead: what of the recorded force does not arrive [N]. faster: times these sines."""
    conditions = replace(machine.CONDITIONS, duration=duration, step=2e-3)
    time, rng = np.arange(round(duration / conditions.step)) * conditions.step, np.random.default_rng(1)
    angle = 2 * np.pi * faster * FREQUENCIES * time[:, None] + rng.uniform(0, 2 * np.pi, 3)
    x, v = np.sin(angle) @ AMPLITUDES, np.cos(angle) @ (2 * np.pi * faster * FREQUENCIES * AMPLITUDES)
    made = machine.simulate(machine.Carriage(f_c=f_c, f_0=0.0, d=100.0), machine.SERVO, time, (x - x[0], v), conditions, rng, None)
    F = made.inputs["F"]
    return replace(made, inputs={"F": F + dead * np.sign(F)})


@pytest.mark.slow
@pytest.mark.parametrize(("duration", "guess"), [(6.0, 150.0), (3.0, 60.0)])
def test_dry_friction_of_a_slow_machine_is_no_dead_zone_beside_less_of_it(duration, guess):
    """From the model without friction, whose residual forces do everything, no fit of it comes to rest where they do nothing."""
    d = diagnose(posed(slow(300.0, duration), W={}, carriage__m=Free(guess)), jobs=1)
    (found,) = d.findings
    assert found.explanation.words == "coulomb friction at carriage"
    (level,) = found.explanation.parameters.values()
    assert level.value == pytest.approx(300.0, rel=1e-3)
    assert d.after.parameters["carriage.m"].value == pytest.approx(95.1, rel=0.01)
    assert d.before.parameters["carriage.m"].value > 1000.0


def shared(problem: Problem, *order: tuple[str, float, float]) -> Search:
    """A search that has found these in this order: physics, where its strength begins in a fit of all, and what it gained [nats]."""
    base = smoothing(problem, settings=QUICKLY)
    there = library(problem, problem.model, base.solution)
    accepted = [next(c for c in there if c.physics == name) for name, _, _ in order]
    now, model = problem, problem.model
    for c, (_, begin, _) in zip(accepted, order, strict=True):
        (path,) = (c.named[word] for word in ("width", "f_c", "k") if word in c.named)
        now, model = having(now, model, c, {path: begin})
    result = smoothing(now, settings=QUICKLY)
    assert result.solver.converged
    search = Search(
        standing=Standing(problem=problem, model=problem.model, result=base),
        fits=Fits(pool=POOL, ahead=1, kept=Keep(None, problem), say=lambda _: None, end=inf),
    )
    findings = tuple(found(c, gain) for c, (_, _, gain) in zip(accepted, order, strict=True))
    search.standing = Standing(problem=settled(now, result), model=model, result=result, findings=findings, accepted=tuple(accepted))
    return search


def dead_zone_and_friction(problem: Problem, width: float, f_c: float) -> Search:
    return shared(problem, ("input_dead_zone", width, 500.0), ("coulomb_friction", f_c, 90.0))


def test_what_stood_for_a_part_of_what_was_found_later_goes():
    search = dead_zone_and_friction(posed(slow(300.0, 6.0), W={}), 150.0, 150.0)
    width = search.result.parameters["input_dead_zone_F.width"]
    assert width.value > 50.0 * width.std > 100.0  # what rounded signs make of rests
    stood_in(search)
    (rest,) = search.standing.findings
    assert rest.explanation.physics == "coulomb_friction"
    assert [a.physics for a in rest.alternatives] == ["input_dead_zone"]
    assert "input_dead_zone_F" not in search.standing.model.components
    assert search.result.parameters["coulomb_friction_carriage.f_c"].value == pytest.approx(300.0, rel=1e-3)


def test_a_dead_zone_beside_friction_stays():
    """60 N of the drive do not arrive, and the carriage is slowed down against it."""
    search = dead_zone_and_friction(posed(slow(100.0, 3.0, dead=60.0, faster=3.0)), 60.0, 100.0)
    stood_in(search)
    assert [f.explanation.physics for f in search.standing.findings] == ["input_dead_zone", "coulomb_friction"]
    found = [search.result.parameters[name].value for name in ("input_dead_zone_F.width", "coulomb_friction_carriage.f_c")]
    assert found == pytest.approx([60.0, 100.0], rel=2e-3)


def test_where_only_their_sum_is_told_friction_is_all_of_it():
    search = dead_zone_and_friction(posed(slow(100.0, 3.0, dead=60.0, faster=2.0)), 60.0, 100.0)
    stood_in(search)
    assert [f.explanation.physics for f in search.standing.findings] == ["coulomb_friction"]
    assert search.result.parameters["coulomb_friction_carriage.f_c"].value == pytest.approx(160.0, rel=1e-3)


def test_one_of_which_few_samples_tell_is_no_less_there():
    """Rows so far apart that nobody can say how sure the difference is; they go together all the same."""
    made = slow(100.0, 3.0, dead=60.0, faster=3.0)
    few = replace(made, time=made.time[::31], inputs={"F": made.inputs["F"][::31]}, outputs={"x": made.outputs["x"][::31]})
    search = dead_zone_and_friction(posed(few), 60.0, 100.0)
    first, later = search.standing.accepted
    assert alone(first, [later], search.problem, search.result) is not None
    stood_in(search)
    assert len(search.standing.findings) == 2


def test_what_goes_belongs_to_the_one_that_it_stood_for():
    problem = posed(slow(100.0, 3.0, dead=60.0, faster=2.0))
    search = shared(problem, ("input_dead_zone", 60.0, 500.0), ("coulomb_friction", 100.0, 9000.0), ("spring", 1.0, 20.0))
    stood_in(search)
    friction, spring = search.standing.findings
    assert (friction.explanation.physics, spring.explanation.physics) == ("coulomb_friction", "spring")
    assert friction.gain > 9400.0
    assert [a.physics for a in friction.alternatives] == ["input_dead_zone"]
    assert (spring.gain, spring.alternatives) == (20.0, ())


def test_two_of_which_one_went_are_not_asked_again():
    search = dead_zone_and_friction(posed(slow(100.0, 3.0, dead=60.0, faster=2.0)), 60.0, 100.0)
    again = search.standing
    stood_in(search)
    assert len(search.standing.findings) == 1
    search.standing = again
    stood_in(search)
    assert len(search.standing.findings) == 2


def test_weights_from_the_data_do_not_leave_where_they_are_best():
    """By the fixed point's own steps they end where residual forces do everything, with 800 nats less."""
    search = dead_zone_and_friction(posed(slow(300.0, 3.0), W={}), 150.0, 150.0)
    first, later = search.standing.accepted
    _, begin = alone(first, [later], search.problem, search.result)
    rest = search.without(0, begin=begin)
    assert rest is not None
    assert rest.result.weights.W["carriage"] < 5 * LEFT
    assert rest.result.parameters["carriage.m"].value == pytest.approx(95.1, rel=0.03)
    assert rest.result.parameters["coulomb_friction_carriage.f_c"].value == pytest.approx(300.0, rel=1e-3)
