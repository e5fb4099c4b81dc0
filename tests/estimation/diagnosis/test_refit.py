"""Candidates as full problems: what is free in them, where they start, and what their fits find."""

from __future__ import annotations

import pickle
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from concealed_axis import posed, run

from backsight.data.generators import actuator as machine
from backsight.data.generators.run import Conditions
from backsight.estimation import Free, Problem, Recording, Smoothing, Weights, smooth
from backsight.estimation.diagnosis.candidates.candidate import Candidate
from backsight.estimation.diagnosis.candidates.channels import of_input, of_sensor
from backsight.estimation.diagnosis.candidates.laws import AGAINST_GROUND, Motion, of_law
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.candidates.places import bodies
from backsight.estimation.diagnosis.scores.score import Columns
from backsight.estimation.diagnosis.scores.screen import Screened
from backsight.estimation.diagnosis.scores.supermodel import Look
from backsight.estimation.diagnosis.search import refit
from backsight.estimation.diagnosis.search.refit import HELD, ONWARD, QUICKLY, Fitted, begun, evidence, fitted, settled
from backsight.estimation.smoothing.begun import Begun
from backsight.estimation.smoothing.program import Settings
from backsight.estimation.smoothing.smoother import smoothing
from backsight.models.errors import OutOfTime, SolveError
from backsight.models.plants import actuator
from backsight.ocp import Options

MOTION = Motion(v_rms=0.2, low=-0.05, high=0.05)


def law(name: str) -> Candidate:
    model = actuator()
    (spot,) = bodies(model)
    return of_law(next(one for one in AGAINST_GROUND if (one.label or one.physics) == name), model, spot, MOTION)


def screened(c: Candidate, estimate: list[float], shape: dict[str, float] | None = None) -> Screened:
    nothing = Columns(squares=np.zeros((0, len(estimate))), multiplied=np.zeros((0, len(estimate))))
    a = np.array(estimate)
    return Screened(look=Look(candidate=c, shape=shape or {}, columns=nothing), gain=9.0, estimate=a, std=np.ones(len(a)), freedom=len(a))


@pytest.fixture(scope="module")
def lacking() -> tuple:
    """Coulomb friction that the model does not have."""
    problem = posed(run(1.0, 2e-3, f_c=20.0), W={"carriage": 0.5})
    return problem, smooth(problem)


def test_the_problem_of_a_candidate_has_its_parameters_free_within_their_ranges():
    problem = posed(run(0.1))
    c = law("stribeck_friction")
    now, edited = refit.posed(problem, problem.model, c, {"stribeck_friction_carriage.f_c": -3.0})
    name = "stribeck_friction_carriage"
    assert name in edited.components
    assert name not in problem.model.components
    assert now.parameters[f"{name}.f_c"] == Free(0.0, 0.0, np.inf)  # physics does not let it be negative
    assert isinstance(now.parameters[f"{name}.f_s"], Free)
    assert isinstance(now.parameters[f"{name}.v_s"], Free)
    assert now.parameters["friction.f_c"] == 0.0  # its part is taken over
    assert now.parameters["carriage.m"] == problem.parameters["carriage.m"]


def test_a_strength_that_is_not_nothing_without_effect_starts_from_what_it_is():
    model = actuator()
    gain = next(c for c in of_input(model, "F", [np.ones(9)], 0.01, 1.0) if c.physics == "input_gain")
    (path,) = gain.strengths
    assert begun(gain, screened(gain, [-0.12]), {})[path] == pytest.approx(0.88)
    assert begun(gain, screened(gain, [-0.12]), {path: 0.9})[path] == pytest.approx(0.78)  # it is there already
    slower = Candidate(place="p", family="actuator", physics="x", strengths=("tau_down",), without={"tau_down": 0.05})
    assert begun(slower, screened(slower, [0.04]), {})["tau_down"] == pytest.approx(0.09)


def test_two_quadratures_are_an_amplitude_and_a_phase():
    c = law("cogging")
    start = begun(c, screened(c, [3.0, 4.0], {"cogging_carriage.period": 0.01}), {})
    amplitude, phase = start["cogging_carriage.amplitude"], start["cogging_carriage.phase"]
    assert amplitude == pytest.approx(5.0)
    s = np.linspace(0, 1, 7)
    assert amplitude * np.sin(s + phase) == pytest.approx(3.0 * np.sin(s) + 4.0 * np.cos(s))
    assert start["cogging_carriage.period"] == 0.01


def test_friction_that_waves_starts_at_the_level_that_is_there():
    c = law("position_dependent_friction")
    name = "position_dependent_friction_carriage"
    start = begun(c, screened(c, [3.0, 4.0], {f"{name}.period": 0.02}), {"friction.f_c": 20.0})
    assert (start[f"{name}.f_c"], start[f"{name}.amplitude"]) == (20.0, pytest.approx(0.25))


def test_a_law_that_takes_over_starts_with_what_it_takes_over():
    c = law("asymmetric_friction")
    start = begun(c, screened(c, [3.0, -4.0]), {"friction.d": 200.0})
    assert list(start.values()) == [203.0, 196.0]


def test_a_start_without_a_score_is_the_guess_and_a_signal_brings_its_own():
    c = law("stribeck_friction")
    assert begun(c, None, {}) == {name: guess for name, (guess, _, _) in c.start.items()}


@pytest.mark.parametrize("name", ["coulomb_friction", "stribeck_friction"])
def test_a_fit_finds_what_was_concealed(lacking, name):
    problem, result = lacking
    c = law(name)
    found = fitted(settled(problem, result), problem.model, result, c, begun(c, None, {}))
    assert not found.failed
    f_c = found.result.parameters[f"{name}_carriage.f_c"]
    assert f_c.value == pytest.approx(20.0, abs=max(3.5 * f_c.std, 0.6))
    assert found.worth.nats > evidence(problem, result) + 50
    away = pickle.loads(pickle.dumps(found))
    assert away.whole.solution is not None
    assert away.whole.parameters[f"{name}_carriage.f_c"].value == f_c.value


def test_a_fit_from_the_guesses_goes_on_where_its_limit_of_iterations_left_it(lacking, monkeypatch):
    problem, result = lacking
    c, begins = law("coulomb_friction"), []

    def spied(posed: Problem, **how: object) -> Smoothing:
        begins.append((how["begin"], found := smoothing(posed, **how)))
        return found

    monkeypatch.setattr(refit, "smoothing", spied)
    short = replace(HELD, options=Options(tolerance=1e-6, gauss_newton_iterations=2, max_iterations=2))
    fitted(settled(problem, result), problem.model, result, c, begun(c, None, {}), short, anew=True)
    (none, first), (left, second) = begins
    assert none is None
    assert not first.solver.converged
    assert left is first.solution
    assert second.solution.solved.cost < first.solution.solved.cost


def test_a_fit_with_the_widths_that_it_asked_for_counts_only_where_it_comes_to_rest(lacking, monkeypatch):
    problem, result = lacking
    c, widths = law("coulomb_friction"), {"coulomb_friction_carriage.width": 1e-3}
    fit = partial(fitted, settled(problem, result), problem.model, result, c, begun(c, None, {}))
    plain = fit()
    assert plain.result.solver.converged
    monkeypatch.setattr(refit, "_other_widths", lambda *_: widths)
    other = fit()
    assert other.result.parameters["coulomb_friction_carriage.width"].value == 1e-3
    assert plain.result.parameters["coulomb_friction_carriage.width"].value != pytest.approx(1e-3)

    def stopped(posed: Problem, *, settings: Settings, **how: object) -> Smoothing:
        found = smoothing(posed, settings=settings, **how)
        return replace(found, solver=replace(found.solver, converged=False)) if settings.widths else found

    monkeypatch.setattr(refit, "smoothing", stopped)
    kept = fit()
    assert kept.worth.nats == plain.worth.nats


def test_a_coupling_is_fitted_on_a_mesh_as_fine_as_the_models_own(lacking):
    """Its guessed stiffness would ask for one of an interval a sample."""
    problem, result = lacking
    candidates = library(problem, problem.model, result.solution)
    c = max((c for c in candidates if c.physics == "compliance"), key=lambda c: c.start["screw.k"][0])
    (had,) = result.solution.transcription.horizons
    found = fitted(settled(problem, result), problem.model, result, c, begun(c, None, {}), QUICKLY)
    (horizon,) = found.worth.solution.transcription.horizons
    assert horizon.mesh.count < 1.2 * had.mesh.count < 0.8 * len(had.time)


def coupled(
    strength: float, *, dear: bool = True, begin: float | None = None, fails: int | None = None
) -> tuple[Fitted, list[Smoothing], float]:
    """A fit that its solver leaves at every turn, of friction in place of a coupling: its solves, and the base model's evidence.

    begin: friction where it begins [N], else where the scores put it. fails: the number of the solve that fails.
    """
    problem, solved = posed(run(1.0, 2e-3, f_c=strength), W={"carriage": 0.5}), list[Smoothing]()
    result, c = smooth(problem), replace(law("coulomb_friction"), dear=dear)
    options = replace(QUICKLY.options, gauss_newton_iterations=0 if begin else 1, max_iterations=1, tolerance=1e-12)

    def spied(posed: Problem, **how: object) -> Smoothing:
        if len(solved) + 1 == fails:
            raise SolveError("numbers gave out")
        solved.append(smoothing(posed, **how))
        return solved[-1]

    start = {c.strengths[0]: begin} if begin else begun(c, None, {})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(refit, "smoothing", spied)
        found = fitted(settled(problem, result), problem.model, result, c, start, replace(QUICKLY, options=options))
    assert not found.result.solver.converged
    return found, solved, evidence(problem, result)


@pytest.mark.parametrize(("dear", "strength", "counts"), [(True, 20.0, True), (False, 20.0, False), (True, 1.0, False)])
def test_what_has_no_score_counts_where_it_gains_plainly_though_it_did_not_come_to_rest(dear, strength, counts):
    """As contacts that are stiffer than a mesh can follow never do; friction stands in for them here, and its solver is stopped."""
    found, solved, least = coupled(strength, dear=dear)
    assert np.isfinite(found.worth.nats) is np.bool_(counts)
    assert len(solved) == (1 + ONWARD if dear else 1)
    assert not counts or found.worth.nats > least + 100.0


def test_what_is_plainly_worse_does_not_go_on():
    _, solved, least = coupled(1.0, begin=80.0)
    assert len(solved) == 1
    problem = posed(run(1.0, 2e-3, f_c=1.0), W={"carriage": 0.5})
    assert evidence(problem, solved[0], ended=False) < least - 100.0


def test_what_had_gained_plainly_stays_where_it_cannot_go_on():
    found, solved, least = coupled(20.0, fails=3)
    assert len(solved) == 2
    assert found.result is solved[-1]
    assert found.worth.nats > least + 100.0


def test_play_that_a_rigid_machine_cannot_have_is_given_up_at_the_first_solve():
    """Weights from the data would go to where it costs nothing. So far from anything single steps hang on the last digit: most are."""
    problem = replace(posed(run(1.0, 2e-3)), weights=Weights())
    result = smoothing(problem, settings=QUICKLY)
    c = next(c for c in library(problem, problem.model, result.solution) if c.physics == "backlash")

    def fit(gap: float) -> Fitted:
        return fitted(settled(problem, result), problem.model, result, c, begun(c, None, {}) | {"screw.gap": gap})

    wide, narrow = [fit(gap) for gap in np.geomspace(5e-4, 8e-3, 9)], fit(4e-5)
    given_up = [f for f in wide if f.failed.startswith("Given up: at the weights that it began with")]
    assert len(given_up) >= 5
    assert all(f.result is None for f in given_up)
    assert not any(np.isfinite(f.worth.nats) for f in wide)
    assert not narrow.failed.startswith("Given up: at the weights that it began with")
    assert narrow.result is not None


def test_what_is_not_there_explains_next_to_nothing(lacking):
    problem, _ = lacking
    known = replace(problem, parameters={**problem.parameters, "friction.f_c": Free(20.0, min=0.0)})
    full, c = smooth(known), law("cubic_spring")
    more = fitted(known, problem.model, full, c, begun(c, None, {}))
    assert abs(more.result.criteria.log_likelihood - full.criteria.log_likelihood) < 3
    k3 = more.result.parameters["cubic_spring_carriage.k3"]
    assert abs(k3.value) < 3 * k3.std


def test_two_names_of_one_effect_have_one_evidence_in_whatever_units():
    """A constant force, and an encoder that drifts: under viscous friction the one is the other, in N and in m/s."""
    problem = posed(run(1.0, 2e-3, f_0=1.0))
    base = smooth(problem)
    drift = next(c for c in of_sensor(problem.model, "x", [], 2e-3, 1.0) if c.physics == "sensor_drift")
    force, moved = (fitted(problem, problem.model, base, c, begun(c, None, {})) for c in (law("constant_force"), drift))
    assert force.result.criteria.log_likelihood == pytest.approx(moved.result.criteria.log_likelihood, abs=0.05)
    assert force.worth.nats == pytest.approx(moved.worth.nats, abs=0.1)
    assert force.worth.nats > evidence(problem, base) + 50


def test_a_sensors_gain_makes_another_motion_over_which_friction_is_rounded_as_far_as_before():
    """x -> g x is d -> d/g with mass and friction free: with a sharper sign for its motion the one would be likelier than the other."""
    problem = posed(run(2.0, 2e-3, f_c=20.0, d=200.0), W={}, friction__d=170.0, friction__f_c=Free(15.0, min=0.0))
    base = smooth(problem)
    gain = next(c for c in of_sensor(problem.model, "x", [], 2e-3, 1.0) if c.physics == "sensor_gain")
    damping = next(c for c in library(problem, problem.model, base.solution) if c.physics == "wrong_parameter" and c.place == "friction")
    starts = ((gain, 0.8), (damping, 205.0))
    read, damped = (fitted(problem, problem.model, base, c, {c.strengths[0]: start}) for c, start in starts)
    assert read.result.value(gain.strengths[0]) == pytest.approx(0.85, abs=2e-3)
    assert read.result.value("friction.width") == pytest.approx(damped.result.value("friction.width") / 0.85, rel=0.02)
    assert damped.result.value("friction.width") == pytest.approx(base.value("friction.width"), rel=0.02)
    assert read.worth.nats - evidence(problem, base) == pytest.approx(damped.worth.nats - evidence(problem, base), rel=0.05)


def test_what_is_not_there_has_evidence_against_it_in_whatever_units():
    problem = posed(run(1.0, 2e-3))
    base = smooth(problem)
    for name in ("cubic_spring", "spring", "constant_force"):
        c = law(name)
        assert fitted(problem, problem.model, base, c, begun(c, None, {})).worth.nats < evidence(problem, base)


def test_friction_that_hardly_stands_out_of_the_forces_is_borne_out():
    """4 N of friction under a white force of 1 N sqrt(s): the room that its law has near rest must not cost more than it explains."""
    conditions = Conditions(duration=8.0, step=4e-3, noise={"x": 2e-6}, process={"carriage": 1.0})
    driven = machine.record(machine.Carriage(f_c=4.0), seed=3, conditions=conditions)
    recording = Recording(name="fit", time=driven.time, inputs=driven.inputs, outputs=driven.outputs, output_std={"x": 2e-6})
    free = {"carriage.m": Free(90.0), "friction.d": Free(250.0), "offset.f": Free(0.0)}
    without = Problem(model=actuator(), recordings=[recording], parameters={**free, "friction.f_c": 0.0})
    with_it = replace(without, parameters={**free, "friction.f_c": Free(4.0, min=0.0)})
    found = smooth(with_it)
    f_c, gained = found.parameters["friction.f_c"], evidence(with_it, found) - evidence(without, smooth(without))
    assert abs(f_c.value - 4.0) < 3 * f_c.std
    # of a linear parameter with unit information: z^2/2 - log(n)/2
    assert gained == pytest.approx(((f_c.value / f_c.std) ** 2 - np.log(2 * len(driven.time))) / 2, abs=5.0)


def test_what_is_settled_starts_where_the_last_fit_ended(lacking):
    problem, result = lacking
    now = settled(problem, result)
    assert now.parameters["carriage.m"].guess == result.parameters["carriage.m"].value
    assert now.parameters["friction.f_c"] == 0.0


def test_what_was_known_beforehand_stays_and_counts_once():
    known = Free(80.0, std=1.0)  # 95.11 in truth: friction that is left out is no reason to believe in what the samples say instead
    problem = posed(run(1.0, 2e-3, f_c=20.0), W={"carriage": 0.5}, carriage__m=known)
    result, c = smooth(problem), law("coulomb_friction")
    assert result.parameters["carriage.m"].value - known.guess > known.std
    assert settled(problem, result).parameters["carriage.m"] == known
    assert Begun.at(result.solution).start(problem)[problem.free[0]] == result.parameters["carriage.m"].value
    start = begun(c, None, {})
    found = fitted(settled(problem, result), problem.model, result, c, start)
    anew = smooth(refit.posed(problem, problem.model, c, start)[0])
    mine, other = found.result.parameters["carriage.m"], anew.parameters["carriage.m"]
    assert mine.value == pytest.approx(other.value, abs=0.5 * other.std)  # rooms at rest differ


def test_a_fit_that_cannot_be_posed_says_why():
    problem = posed(run(0.1))
    base = smooth(problem)
    friction = law("coulomb_friction")
    c = replace(friction, edits=(replace(friction.edits[0], place="cariage.flange"),))
    found = fitted(problem, problem.model, base, c, {})
    assert "no component 'cariage'" in found.failed
    assert found.worth.nats == -np.inf
    assert found.whole is None
    assert Fitted(candidate=c).worth.nats == -np.inf


def test_friction_that_is_higher_at_rest_starts_at_the_level_that_is_there_at_rest_too():
    """20 sgn v + [3 (1 - e) + 9 e] sgn v, with e = exp(-(v/v_s)^2): levels of 23 in motion and 29 at rest."""
    c = law("stribeck_friction")
    name = "stribeck_friction_carriage"
    start = begun(c, screened(c, [3.0, 9.0], {f"{name}.v_s": 0.05}), {"friction.f_c": 20.0})
    assert (start[f"{name}.f_c"], start[f"{name}.f_s"]) == (23.0, 29.0)


def test_a_place_whose_forces_no_output_feels_stays_soft_where_nobody_gave_its_weight():
    problem = posed(run(1.0), W={})
    deaf = replace(problem.recordings[0], output_std={"x": 10.0})
    solution = smooth(replace(problem, recordings=[deaf]), settings=HELD).solution
    assert solution is not None
    assert [solution.transcription.dae.places[k].name for k in solution.transcription.soft] == ["carriage"]


def test_a_fit_that_has_a_result_keeps_it_where_its_time_ends(lacking, monkeypatch):
    """All that a fit does shares one limit of time, and what does not end within it takes nothing back."""
    problem, result = lacking
    c, given = law("coulomb_friction"), list[float]()

    def late(posed: Problem, *, settings: Settings, **how: object) -> Smoothing:
        given.append(settings.seconds)
        if len(given) > 1:
            raise OutOfTime("Stopped at its limit of time.")
        return smoothing(posed, settings=settings, **how)

    monkeypatch.setattr(refit, "smoothing", late)
    short = replace(HELD, seconds=1e3, options=Options(tolerance=1e-6, gauss_newton_iterations=2, max_iterations=2))
    fit = fitted(settled(problem, result), problem.model, result, c, begun(c, None, {}), short, anew=True)
    assert (fit.failed, fit.late) == ("", True)
    assert fit.result is not None
    assert not fit.result.solver.converged
    first, second = given
    assert second < first == 1e3


@pytest.mark.parametrize("late", [2e-5, 5e-4])
def test_first_states_that_hardly_anything_tells_are_no_evidence_in_whatever_units(late: float):
    """An input [N] or a sensor [m] that is late by next to nothing changes nothing; by .5 ms, each is as wrong as the other."""
    made = run(1.0)
    bare = posed(made, W={"carriage": 0.02})
    either = of_input(actuator(), "F", [made.inputs["F"]], 1e-3, 1.0) + of_sensor(actuator(), "x", [], 1e-3, 1.0, scaled=False, span=None)
    found = {}
    for c in either:
        if c.physics in ("input_delay", "sensor_delay"):
            (name,) = c.named.values()
            problem, _ = refit.posed(bare, bare.model, c, {name: late})
            held = replace(problem, parameters={**problem.parameters, name: late})
            found[c.physics] = evidence(held, smooth(held, settings=QUICKLY))
    before = evidence(bare, smooth(bare, settings=QUICKLY))
    # what was in a late input before is of its size, and in a late sensor nobody knows any better
    assert found["input_delay"] - found["sensor_delay"] == pytest.approx(0.0, abs=1.0 + 0.015 * abs(found["sensor_delay"] - before))
    assert (found["input_delay"] - before == pytest.approx(0.0, abs=3.0)) is (late < 1e-4)
