"""A force without a name at the place that strains: where it is put, what is found with it, and what is fitted instead of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hidden_load import LOAD, MOTOR, STEP, STIFFNESS, posed

from backsight.estimation.diagnosis.candidates.candidate import Candidate
from backsight.estimation.diagnosis.evidence.latent import LASTING, Latent, held_there, straining, with_force, without_force
from backsight.estimation.diagnosis.scores.shares import left_over
from backsight.estimation.diagnosis.search.keep import Keep
from backsight.estimation.diagnosis.search.refit import HELD, bared, fitted, settled
from backsight.estimation.diagnosis.search.refit import posed as put_in
from backsight.estimation.diagnosis.start.as_it_is import as_it_is
from backsight.estimation.smoothing.begun import force_stds
from backsight.estimation.smoothing.smoother import smoothing
from backsight.models.errors import SolveError

OFFSET = 0.35  # N.m, of a torque of 0.65 rms


def offset():
    """The motor's torque is recorded with an offset that it does not have."""
    problem = posed(0.0)
    return replace(problem, recordings=[replace(r, inputs={"tau": r.inputs["tau"] - OFFSET}) for r in problem.recordings])


def test_it_remembers_for_some_samples_and_is_gone_without_a_trace():
    problem = posed(0.0)
    with_one = with_force(problem, "motor", 0.3, 0.01)
    assert with_one.weights.tau == {"motor": pytest.approx(LASTING * STEP)}
    assert with_one.weights.W == {"motor": 0.3}
    assert "residual.motor" in {q.name for q in with_one.posed.dae.states}
    assert without_force(with_one) == problem
    assert without_force(problem) is problem


def test_all_that_may_be_missing_is_put_in_instead_of_it():
    with_one = with_force(posed(0.0), "motor", 0.3, 0.01)
    brake = Candidate(place="load", family="inertia", physics="wrong_parameter", strengths=("motor.J",))
    now, _ = put_in(with_one, with_one.model, brake, {})
    assert not isinstance(now.weights, Latent)
    assert held_there(with_one, now) == {"motor": 0.01}
    assert held_there(with_one, with_one) == {}


def test_the_place_that_strains_is_the_one_where_much_is_left_over():
    problem = offset()
    near = smoothing(problem, settings=HELD)
    left = {"motor": 0.3, "load": 0.015, "shaft": np.inf}
    ((place, with_one),) = straining(problem, near, left)
    assert place == with_one.weights.place == "motor"
    assert with_one.weights.W["motor"] == near.residual_places["motor"].rms
    given = replace(problem, weights=replace(problem.weights, W={"motor": 0.1}))
    assert straining(given, near, left) == []
    assert straining(problem, replace(near, solution=None), left) == []


def test_a_model_that_comes_to_rest_only_with_it_has_its_numbers(tmp_path):
    """An offset of the torque, beside a load that nobody sees; that the model alone did not come to rest is told here."""
    problem = offset()
    kept = Keep(tmp_path, problem)
    near = smoothing(problem, settings=HELD)
    lost = replace(near, solver=replace(near.solver, converged=False))
    kept.put(kept.name("the model as it is, with weights from the forces' sizes"), (lost, near.solution))
    assert left_over(problem, near)["motor"] > 0.05
    found = as_it_is(problem, kept, lambda _: None)
    assert isinstance(found.problem.weights, Latent)
    assert found.settings.weigh is False
    then, now = force_stds(near.solution), force_stds(found.result.solution)
    assert found.problem.weights.held / then["motor"] == pytest.approx(now["load"] / then["load"])
    assert found.result.solver.converged
    force = found.result.estimates["run"]["residual.motor"].to_numpy()
    assert np.mean(force) == pytest.approx(OFFSET, rel=0.05)
    for name, true in (("motor.J", MOTOR), ("load.J", LOAD), ("shaft.k", STIFFNESS)):
        assert found.result.parameters[name].value == pytest.approx(true, rel=0.1)

    plain, there = bared(found.problem, found.result)
    assert plain.weights == problem.weights
    assert there.transcription.dae.states == problem.posed.dae.states
    assert there.parameters == pytest.approx(found.result.solution.parameters)

    torque = Candidate(place="motor", family="external", physics="constant_force", start={"motor.J": (MOTOR, 0.0, np.inf)})
    instead_of_it = fitted(settled(found.problem, found.result), problem.model, found.result, torque, {}, HELD)
    assert not isinstance(instead_of_it.problem.weights, Latent)
    assert "residual.motor" not in {q.name for q in instead_of_it.problem.posed.dae.states}


def test_a_model_that_weights_from_the_data_lead_beyond_all_measure_is_where_held_ones_left_it(tmp_path, monkeypatch):
    problem = offset()
    kept = Keep(tmp_path, problem)
    near = smoothing(problem, settings=HELD)
    lost = replace(near, solver=replace(near.solver, converged=False))
    kept.put(kept.name("the model as it is, with weights from the forces' sizes"), (lost, near.solution))
    monkeypatch.setattr("backsight.estimation.diagnosis.start.as_it_is.straining", lambda *_: [])

    def astray(*_, **__):
        raise SolveError("load.J grew beyond all measure")

    monkeypatch.setattr("backsight.estimation.diagnosis.start.as_it_is.smoothing", astray)
    found = as_it_is(problem, kept, lambda _: None)
    assert found.settings is HELD
    assert found.result.parameters["load.J"].value == near.parameters["load.J"].value
