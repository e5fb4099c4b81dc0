"""A study of the weights as a whole: what it recommends, in one process and in several, interrupted and gone on with."""

from __future__ import annotations

import json
import os
import signal
import warnings
from dataclasses import replace
from html import escape

import numpy as np
import pytest
from shaken import FORCE_STD, PLANT, STD, TRUE, driven, simulated

from backsight.estimation import Free, Problem, Recording, Weighing, Weights, weigh
from backsight.estimation.command.output import json_text
from backsight.estimation.command.result_json import result_of_weighing
from backsight.estimation.report import parameter_chart, write_weighing_report
from backsight.estimation.weighing.estimated import estimated, with_weights
from backsight.estimation.weighing.held_out import judging
from backsight.estimation.weighing.setting import Stand
from backsight.estimation.weighing.store import Store
from backsight.estimation.weighing.tightening import stages, tightened
from backsight.estimation.weighing.words import words


def problem(weights: Weights | None = None, stds: float | None = None) -> Problem:
    """Two runs of the oscillator, one held out, its spring and damper to be found."""
    runs = []
    for seed, role in ((11, "fit"), (12, "held_out")):
        time, u = driven(300)
        y = simulated(seed, n=300)
        runs.append(Recording(name=role, time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": stds}, role=role))
    parameters = TRUE | {"spring.k": Free(30.0), "damper.d": Free(1.0)}
    return Problem(model=PLANT, recordings=runs, parameters=parameters, weights=weights or Weights())


@pytest.fixture(scope="module")
def found() -> Weighing:
    return weigh(problem())


def test_the_weights_of_the_simulation_are_recommended(found):
    for label, true in (("W of mass", FORCE_STD), ("V of x", STD)):
        component = found.components[label]
        low, high = component.interval
        assert low < true < high
        assert component.std == pytest.approx(true, rel=0.25)
    assert found.components["W of mass"].p_zero < 1e-3
    assert found.recommended.solver.converged
    assert found.recommended.weights.W["mass"] == pytest.approx(FORCE_STD, rel=0.3)
    assert abs(found.recommended.parameters["spring.k"].value - TRUE["spring.k"]) < 4 * found.recommended.parameters["spring.k"].std


def test_every_setting_is_there_and_the_likeliest_leads(found):
    names = [o.setting.name for o in found.outcomes]
    assert len(set(names)) == len(names) >= 18
    assert all(o.converged for o in found.outcomes)
    best = next(o for o in found.outcomes if o.setting.name == "greatest likelihood")
    assert all(o.log_likelihood <= best.log_likelihood + 0.01 for o in found.outcomes)
    assert best.misfit["x"][1] == pytest.approx(1.0, abs=0.02)
    assert best.force["mass"][1] == pytest.approx(1.0, abs=0.02)
    path = sorted((o for o in found.outcomes if o.setting.group == "trade-off"), key=lambda o: o.setting.factor)
    assert np.all(np.diff([o.misfit["x"][0] for o in path]) < 0)  # more room for forces, less misfit
    assert np.all(np.diff([o.force["mass"][0] for o in path]) > 0)
    assert min(o.held_out for o in (path[0], path[-1])) < best.held_out - 10


def test_to_first_order_a_weight_of_forces_moves_every_state_as_far_as_that_of_the_only_sensor(found):
    assert set(found.state_slopes) == {"W of mass", "V of x"}
    for of in found.state_slopes.values():
        assert set(of) == {"mass.s", "mass.v"}
        assert all(0.01 < slope < 10.0 for slope in of.values())
    # forces and noise only count by their ratio, so that one moves everything as the other does back
    for state, slope in found.state_slopes["W of mass"].items():
        assert slope == pytest.approx(found.state_slopes["V of x"][state], rel=0.05)


def test_with_one_balance_all_forces_together_are_that_one_and_both_names_have_its_outcome(found):
    by_name = {o.setting.name: o for o in found.outcomes}
    for times in ("0.1", "10"):
        together, alone = by_name[f"W x {times}"], by_name[f"W of mass x {times}"]
        assert (together.setting.group, alone.setting.group) == ("trade-off", "weight")
        assert replace(alone, setting=together.setting) == together  # the seconds too: it was solved once
    (moved, _) = found.moves["W of mass"]["spring.k"]
    value, std = by_name["greatest likelihood"].parameters["spring.k"]
    assert moved == pytest.approx((by_name["W x 0.1"].parameters["spring.k"][0] - value) / std)


def test_of_a_force_whose_p_is_not_known_nothing_is_said_that_takes_it(found):
    """Neither that its balance holds as it stands, nor that it is more than none; and result.json has null for it."""
    component = replace(found.components["W of mass"], p_zero=float("nan"))
    unknown = replace(found, components={**found.components, "W of mass": component}, forces={"mass": 1e6})
    (said,) = (line for line in words(unknown) if line.startswith("mass: its balance"))
    assert said.endswith("little, and whether more than none is not known.")
    assert json.loads(json_text(result_of_weighing(unknown)))["recommended"]["W"]["mass"]["p_zero"] is None


@pytest.mark.slow
def test_weights_that_are_a_hundred_times_off_end_where_the_others_do(found):
    off = weigh(problem(Weights(W={"mass": 0.01 * FORCE_STD}), stds=100 * STD))
    assert off.recommended.weights.W["mass"] == pytest.approx(found.recommended.weights.W["mass"], rel=0.01)
    given = next(o for o in off.outcomes if o.setting.name == "as given")
    assert given.weights["V of x"] == pytest.approx(100 * STD)
    assert given.weights["W of mass"] == pytest.approx(0.01 * FORCE_STD)
    ahead = [p.held_out["held_out"].window_rms["x"] for p in (off.recommended, found.recommended)]
    assert ahead[0] == pytest.approx(ahead[1], rel=0.02)


@pytest.mark.slow
def test_two_processes_give_the_same_and_what_is_kept_is_not_solved_again(found, tmp_path):
    keep = tmp_path / "kept"
    side_by_side = weigh(problem(), jobs=2, keep=keep)
    for one, other in zip(found.outcomes, side_by_side.outcomes, strict=True):
        assert one.setting == other.setting
        assert one.log_likelihood == pytest.approx(other.log_likelihood, abs=1e-6)
    for name, p in found.recommended.parameters.items():
        assert side_by_side.recommended.parameters[name].value == pytest.approx(p.value, rel=1e-6)
    settings = sorted(p for p in keep.iterdir() if "setting" in p.read_text(encoding="utf-8"))
    answers = sorted(set(keep.iterdir()) - set(settings))
    assert len(settings) == len({o.setting.theta for o in found.outcomes}) < len(found.outcomes)
    assert len(answers) == 1  # whether W of mass may be none
    settings[0].write_text("{ torn", encoding="utf-8")
    for path in (*settings[1:], *answers):
        os.utime(path, (1, 1))
    said = list[str]()
    again = weigh(problem(), keep=keep, progress=said.append)
    assert settings[0] in (solved := [p for p in (*settings, *answers) if p.stat().st_mtime > 10])
    assert len(solved) <= 4  # a chain
    assert not any(line.startswith("without") for line in said)
    assert {k: c.p_zero for k, c in again.components.items()} == {k: c.p_zero for k, c in side_by_side.components.items()}
    assert [replace(o, seconds=0.0) for o in again.outcomes] == [replace(o, seconds=0.0) for o in side_by_side.outcomes]


def test_a_store_tells_studies_apart(found, tmp_path):
    outcome = found.outcomes[0]
    Store(tmp_path, "one").put(outcome)
    assert Store(tmp_path, "one").get(outcome.setting) == outcome
    assert Store(tmp_path, "other").get(outcome.setting) is None
    assert Store(None, "one").get(outcome.setting) is None
    Store(tmp_path, "one").put_answer("W of mass", (0.3, float("nan")))
    assert Store(tmp_path, "one").answer("W of mass") == pytest.approx((0.3, np.nan), nan_ok=True)
    assert Store(tmp_path, "other").answer("W of mass") is None


def test_what_cannot_be_kept_is_said_and_the_study_goes_on(found, tmp_path):
    (tmp_path / "taken").write_text("no folder", encoding="utf-8")
    store = Store(tmp_path / "taken", "one")
    with pytest.warns(RuntimeWarning, match=r"taken: a finished part is not kept .*; a second run would do it again"):
        store.put(found.outcomes[0])
    assert store.get(found.outcomes[0].setting) is None


@pytest.mark.slow
def test_without_anything_held_out_a_third_is_and_that_is_said():
    whole = problem()
    alone = replace(whole, recordings=[whole.recordings[0]])
    study = weigh(alone)
    assert any("last third of fit" in note for note in study.notes)
    assert list(study.recommended.held_out) == [name for name in study.recommended.held_out if name.startswith("fit from t = ")] != []


@pytest.mark.checkout
@pytest.mark.slow
def test_on_a_cluster_that_loses_a_worker_the_study_is_finished(found):
    distributed = pytest.importorskip("distributed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        cluster = distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None)
        try:
            killed = list[int]()

            def say(text: str) -> None:
                if text.startswith("setting 3") and not killed:
                    pid = next(iter(cluster.workers.values())).pid
                    os.kill(pid, signal.SIGKILL)
                    killed.append(pid)

            there = weigh(problem(), scheduler=cluster.scheduler_address, progress=say)
        finally:
            cluster.close()
    assert killed
    for one, other in zip(found.outcomes, there.outcomes, strict=True):
        assert one.log_likelihood == pytest.approx(other.log_likelihood, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    "asked",
    [
        {"weights": Weights(W={"mass": 5.0}, tau={"mass": 0.2})},
        {"weights": Weights(V={"F": 1.0})},
        {"parameters": TRUE | {"offset.f": Free(0.5, drift=0.3, std=1.0)}},
    ],
    ids=["a force with a memory", "a measured input", "a parameter that drifts"],
)
def test_problems_that_are_posed_with_more_states_are_studied_too(asked):
    study = weigh(replace(problem(), **asked))
    recommended = study.recommended
    assert recommended.solver.converged
    assert all(o.converged for o in study.outcomes)
    assert study.arrived
    in_force = {f"{kind} of {name}": std for kind in ("W", "V") for name, std in getattr(recommended.weights, kind).items()}
    drifts = result_of_weighing(study)["recommended"].get("drift", {})
    in_force |= {f"drift of {name}": drift["std"] for name, drift in drifts.items()}
    for label in study.components:
        assert in_force[label] == pytest.approx(study.best.weights[label], rel=1e-6)
    for name, drift in drifts.items():
        assert any(f"{name} drifts by {drift['std']:.3g} " in note for note in recommended.notes)
        assert drift["interval"][0] <= drift["from_data"] <= drift["interval"][1]


@pytest.mark.slow
def test_noise_that_each_recording_has_of_its_own_stays_so():
    """A sensor is ten times as coarse in one of two fitted recordings, as given: one factor turns both, and none gets the other's."""
    rough, runs = 10.0, []
    for name, seed, role, times in (("fine", 11, "fit", 1.0), ("rough", 13, "fit", rough), ("later", 12, "held_out", 1.0)):
        time, u = driven(300)
        y = simulated(seed, n=300) + STD * np.sqrt(times**2 - 1) * np.random.default_rng(seed).standard_normal(300)
        given = 3 * times * STD  # three times too much
        runs.append(Recording(name=name, time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": given}, role=role))
    study = weigh(replace(problem(), recordings=runs))
    V = study.recommended.weights.V
    assert study.chosen == "greatest likelihood"
    assert V["x [fine]"] == pytest.approx(STD, rel=0.2)
    assert V["x [rough]"] == pytest.approx(rough * V["x [fine]"])
    given = next(o for o in study.outcomes if o.setting.name == "as given")
    best = study.best
    assert given.weights["V of x"] == pytest.approx(best.weights["V of x"] * 3 * STD / V["x [fine]"], rel=1e-6)
    assert given.held_out < best.held_out


def test_what_holds_the_parameters_is_tightened_in_words_and_as_a_path(tmp_path):
    """A prior far off, with room or without: between the two the spring goes from where the data have it to where the prior has."""
    study = weigh(replace(problem(), parameters=TRUE | {"spring.k": Free(60.0, std=1.0), "damper.d": Free(1.0)}))
    weak, *_, tight = path = stages(study)
    assert [o.setting.factor for o in path] == [100.0, 10.0, 0.1, 0.01]
    assert weak.parameters["spring.k"][0] == pytest.approx(TRUE["spring.k"], rel=0.05)
    assert tight.parameters["spring.k"][0] == pytest.approx(60.0, abs=0.1)
    assert tight.parameters["spring.k"][1] == pytest.approx(0.01, rel=0.1)
    (said,) = [note for note in study.notes if note.startswith("prior of the parameters, tightened from 100 to 0.01 times the std:")]
    moved = (60.0 - weak.parameters["spring.k"][0]) / study.best.parameters["spring.k"][1]
    assert f"spring.k moves by {moved:.2g} of its deviations" in said or f"spring.k by {moved:.2g}" in said
    still = replace(study, outcomes=tuple(replace(o, parameters=weak.parameters) if o in path else o for o in study.outcomes))
    assert tightened(still)[0].endswith("no parameter moves by 0.1 of its deviation.")
    chart = parameter_chart(study, "stage")
    assert chart is not None
    spring = chart.figure().data[1]
    assert spring.x == pytest.approx([-2.0, -1.0, 0.0, 1.0, 2.0])
    assert spring.y[0] == pytest.approx(tight.parameters["spring.k"][0], rel=1e-6)
    assert spring.y[2] == pytest.approx(study.best.parameters["spring.k"][0], rel=1e-6)
    write_weighing_report(study, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert all(f'data-chart="{label}"' in page for label in ("parameter_paths", "parameter_paths_stage"))
    assert escape(said) in page


def test_where_nothing_holds_the_parameters_nothing_is_said_of_it(found):
    assert tightened(found) == []
    assert parameter_chart(found, "stage") is None
    assert not any("tightened" in note for note in found.notes)


@pytest.mark.parametrize("times", [0.2, 5.0])
def test_a_judge_tells_a_noise_that_the_search_got_wrong_from_its_own(times):
    """Where the search says another noise than what was held out has, and the given one is right, the judge is as it was."""
    whole = problem(Weights(W={"mass": FORCE_STD}), stds=STD)
    told = estimated(whole, lambda _: None)
    right, labels = told.best.theta, [w.label for w in told.knobs.weights]
    wrong = right + np.log(times) * (np.array(labels) == "V of x")
    lost = replace(told, best=replace(told.best, theta=wrong, settled=False))
    best = with_weights(told.whole, told.knobs, wrong)
    scores = {}
    for name, others in (("given", [told.given]), ("alone", [])):
        judge = judging(lost, best, others, None)
        assert judge.knobs is not None
        assert (sorted(w.label for w in judge.knobs.weights) == sorted(labels)) is (name == "given")
        assert any("does not judge V of x" in note for note in judge.notes) is (name == "alone")
        stand = Stand(fitted=told.knobs, held_out=judge.knobs, start=told.best.solution.solved.decisions)
        scores[name] = [stand.score(theta, told.best.solution) for theta in (right, wrong)]
    assert scores["given"][0] > scores["given"][1] + 50
    assert scores["alone"][0] == pytest.approx(scores["alone"][1], abs=1e-6)  # of V it says nothing


@pytest.mark.slow
def test_a_judge_with_another_noise_or_with_outliers_speaks_for_the_same_weights(found):
    """What was held out has twenty times the noise, or a few gross outliers: weights twenty times as large would suit it alone."""
    whole = problem()
    fit, held_out = whole.recordings
    y, rng = held_out.outputs["x"], np.random.default_rng(3)
    gross = np.where(np.arange(len(y)) % 61 == 30, 0.5, 0.0)
    for worse in (y + 20 * STD * rng.standard_normal(len(y)), y + gross):
        study = weigh(replace(whole, recordings=[fit, replace(held_out, outputs={"x": worse})]))
        assert study.chosen == "greatest likelihood"
        assert study.components["V of x"].std == pytest.approx(found.components["V of x"].std, rel=1e-6)
        assert any("What was held out has" in note or "of what was held out lie far off" in note for note in study.notes)
