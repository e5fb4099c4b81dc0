"""A smoothing that goes on from another model's solution: a rigid axis, then one with a soft screw, simulated by its matrix exponential."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm

from backsight.estimation import Free, Problem, Recording, smooth
from backsight.estimation.smoothing.begun import Begun
from backsight.estimation.smoothing.smoother import Settings, smoothing
from backsight.models.plants import actuator
from backsight.ocp import Solution

M1, M2, K, D, B, STEP, N, NOISE = 15.0, 80.0, 6e4, 60.0, 200.0, 2e-3, 800, 2e-6


def recorded() -> Recording:
    """The encoder on the motor's side, the force held between the samples."""
    rng = np.random.default_rng(0)
    t = STEP * np.arange(N)
    force = 30 * np.sin(2 * np.pi * 1.2 * t) + 60 * np.repeat(rng.uniform(-1, 1, N // 20), 20)
    A = np.array(
        [[0, 0, 1, 0], [0, 0, 0, 1], [-K / M1, K / M1, -D / M1, D / M1], [K / M2, -K / M2, D / M2, -(D + B) / M2]], dtype=np.float64
    )
    both = expm(STEP * np.block([[A, np.array([[0], [0], [1 / M1], [0]])], [np.zeros((1, 5))]]))
    x, seen = np.zeros(4), np.empty(N)
    for k, f in enumerate(force):
        seen[k] = x[0]
        x = both[:4, :4] @ x + both[:4, 4] * f
    return Recording(name="run", time=t, inputs={"F": force}, outputs={"x": seen + NOISE * rng.standard_normal(N)}, output_std={"x": NOISE})


def posed(screw: str) -> Problem:
    known = {"friction.f_c": 0.0, "offset.f": 0.0}
    own = {"motor_mass.m": M1, "screw.d": D, "screw.k": Free(0.5 * K, min=0.0)} if screw == "compliant" else {}
    free = {"carriage.m": Free(M2 if own else M1 + M2), "friction.d": Free(B)}
    return Problem(model=actuator(screw=screw, encoder="motor"), recordings=[RECORDING], parameters=known | own | free)


RECORDING = recorded()


@cache
def rigid() -> Solution:
    return smooth(posed("rigid"), settings=Settings(check_mesh=False)).solution


def test_what_both_models_have_goes_on_as_it_was_and_the_rest_where_the_old_one_has_it_by_name():
    assert rigid() is not None
    soft = posed("compliant")
    begun = Begun.of(rigid(), soft)
    assert begun is not None
    times = rigid().transcription.horizons[0].mesh.knots[3:9]
    (_, was, _), (rates, now, _) = Begun.at(rigid()).followed.at(0, times), begun.followed.at(0, times)
    old, new = ([q.name for q in dae.states] for dae in (rigid().transcription.dae, soft.dae))
    for name in ("carriage.s", "carriage.v"):
        np.testing.assert_allclose(now[new.index(name)], was[old.index(name)], rtol=1e-9, atol=1e-12)
    # the rigid model has no motor mass, but something moves where it is; and a velocity is the slope of its position
    assert set(new) - set(old) == {"motor_mass.s", "motor_mass.v"}
    np.testing.assert_allclose(now[new.index("motor_mass.s")], was[old.index("carriage.s")], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(now[new.index("motor_mass.v")], rates[new.index("motor_mass.s")], atol=1e-12)
    assert set(begun.force_std) == {"carriage"}


def test_from_a_rigid_axis_a_soft_one_is_found():
    assert rigid() is not None
    soft = posed("compliant")
    warm = smooth(soft, settings=Settings(check_mesh=False), begin=Begun.of(rigid(), soft))
    assert warm.solver.converged
    for name, true in (("screw.k", K), ("carriage.m", M2), ("friction.d", B)):
        p = warm.parameters[name]
        assert p.value == pytest.approx(true, abs=4 * (p.std or 0.0)), name


def test_another_input_or_no_solution_is_no_beginning():
    assert rigid() is not None
    soft = posed("compliant")
    renamed = replace(actuator(screw="compliant", encoder="motor"), inputs={"G": "motor.f"})
    inputs = {"G": RECORDING.inputs["F"]}
    assert Begun.of(rigid(), Problem(model=renamed, recordings=[replace(RECORDING, inputs=inputs)], parameters=soft.parameters)) is None
    status = type(rigid().solved.status).ITERATIONS
    assert Begun.of(replace(rigid(), solved=replace(rigid().solved, status=status)), soft) is None


def test_a_fit_begins_with_the_noise_of_the_solution_where_nobody_gave_one():
    nobody = replace(posed("rigid"), recordings=[replace(RECORDING, output_std={})])
    result = smooth(nobody, settings=Settings(check_mesh=False))
    begun = Begun.at(result.solution)
    assert begun.noise == ({"x": pytest.approx(result.weights.V["x"], rel=1e-6)},)
    assert begun.with_noise([{"x": 1.0}], [{"x"}]) == list(begun.noise)
    assert begun.with_noise([{"x": 1.0}], [set()]) == [{"x": 1.0}]  # given
    assert begun.with_noise([{"x": 1.0}, {"x": 1.0}], [{"x"}, {"x"}]) == [{"x": 1.0}, {"x": 1.0}]  # of other recordings
    said: list[str] = []
    again = smoothing(nobody, settings=Settings(check_mesh=False, marginal=False), begin=begun, progress=said.append)
    assert again.weights.V["x"] == pytest.approx(result.weights.V["x"], rel=0.05)
    assert sum("weights from the data" in line for line in said) <= 2  # from the samples' differences, three times as large, it takes three
