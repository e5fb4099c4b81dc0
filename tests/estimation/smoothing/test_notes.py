"""What a result says of its own errors and residual forces, in words."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import truths
from linear_runs import ALL_FREE, MODEL, PLANT, STD, STEP, many, problem

from backsight.data import path
from backsight.estimation import Free, Known, Problem, Recording, Settings, Weights, smooth
from backsight.estimation.recordings.gaps import rates_note, seconds_note
from backsight.estimation.results import Companion, Memory, OutputFit, ResidualSummary, doubted
from backsight.estimation.smoothing.marginal import UNMOVED
from backsight.estimation.smoothing.notes import _of_several, _on_nothing_settled, _on_rates, on_errors, on_residuals
from backsight.models import Dae
from backsight.models.plants import actuator
from backsight.ocp import Options

REMEDY = "acts there. Stated deviations take it for white and may be too small; with"


def fit(**given: float | None) -> OutputFit:
    common = {"whiteness_p": 0.4, "normality_p": 0.4, "effective_samples": 1000.0, "samples": 1000, "prediction_rms": 1.0}
    return OutputFit(**{"rms": 1.0, "fit_percent": 99.0, **common, **given})


def test_errors_that_are_as_they_should_be_are_not_mentioned():
    assert on_errors({"run": {"x": fit(), "y": fit(whiteness_p=None, normality_p=None, effective_samples=None, prediction_rms=None)}}) == []


def test_errors_that_are_not_white_say_what_the_samples_are_worth_and_the_deviations_lack():
    (note,) = on_errors({"run": {"x": fit(whiteness_p=1e-9, effective_samples=250.0)}})
    assert note.startswith("x: its prediction errors are not white (p = 1e-09, 250 effective of 1000 samples)")
    # a mean of errors with four times the memory has twice the deviation
    assert note.endswith("stated deviations are too small, for what is slow about 2 times, or more.")
    (note,) = on_errors({"run": {"x": fit(whiteness_p=0.0, effective_samples=950.0)}})
    assert "p < 1e-12" in note
    assert note.endswith("stated deviations hardly suffer, values may.")


def test_noise_that_is_supposed_too_large_outweighs_a_memory():
    notes = on_errors({"run": {"x": fit(whiteness_p=1e-9, effective_samples=250.0, prediction_rms=0.1)}})
    assert "stated deviations may be too large" in notes[0]
    assert notes[1] == "x: its prediction errors are 0.1 times what V and W promise: too much noise is supposed."


def test_several_recordings_are_told_apart():
    notes = on_errors({"a": {"x": fit(normality_p=1e-5)}, "b": {"x": fit()}})
    assert [note.split(":")[0] for note in notes] == ["x of a"]
    assert "not normal (p = 1e-05)" in notes[0]


def test_errors_that_are_not_normal_are_told_of_once():
    (note,) = on_errors({"a": {"x": fit(normality_p=1e-5), "y": fit(normality_p=1e-9)}, "b": {"x": fit(normality_p=1e-8), "y": fit()}})
    assert note.startswith("x of a, y of a and x of b: their prediction errors are not normal (p = 1e-05)")


@pytest.mark.parametrize(("p", "told"), [(0.005, False), (1e-4, True)])
def test_of_a_dozen_tests_one_may_have_the_p_of_one_in_a_hundred(p, told):
    """0.01/13 is the least that Holm's procedure asks of the smallest of thirteen."""
    axis = ResidualSummary(place="axis", unit="N", rms=1.0, origin="balance of axis", whiteness_p=0.3)
    for outputs, force in (({"whiteness_p": p}, axis), ({"normality_p": p}, axis), ({}, replace(axis, whiteness_p=p))):
        fits = {"run": {**{f"y_{k}": fit() for k in range(5)}, "x": fit(**outputs, effective_samples=250.0)}}
        level = doubted(fits, {"axis": force})
        assert bool([*on_errors(fits, (), level), *on_residuals({"axis": force}, (), level)]) == told
        assert [*on_errors(fits), *on_residuals({"axis": force})]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, []),
        ({"whiteness_p": 0.2}, []),
        (
            {"whiteness_p": 1e-4},
            [f"residual.axis is not white (p = 0.0001): a force with a memory {REMEDY} a W with a tau they do not."],
        ),
        (
            {"whiteness_p": 1e-4, "memory": Memory(tau=0.213, rms=0.81)},
            [
                f"residual.axis is not white (p = 0.0001): a force with a memory of about 0.21 s {REMEDY} "
                'W = { "axis" = { std = 0.81, tau = 0.21 } } they do not.'
            ],
        ),
        (
            {"whiteness_p": 1e-4, "follows": Companion(what="|axis.v|", law="friction that differs", correlation=0.634, std=0.05)},
            [
                "residual.axis follows |axis.v| (r = 0.63 ± 0.05), as friction that differs would make it: "
                "parameters may be off by more than their deviations."
            ],
        ),
    ],
)
def test_a_residual_force_is_named_after_what_it_follows(given, said):
    assert on_residuals({"axis": ResidualSummary(place="axis", unit="N", rms=1.0, origin="balance of axis", **given)}) == said


def test_a_friction_that_the_model_lacks_is_named_in_the_notes():
    """Dry friction of 3 N on the plant, held against the velocity that it has without it; 2000 samples."""
    rng = np.random.default_rng(0)
    velocity = np.gradient(many(2000, 1, np.random.default_rng(1))[0], STEP)
    y = many(2000, 1, rng, -3.0 * np.sign(velocity)[None])[0] + STD * rng.normal(size=2000)
    # the damper is given: else it takes what it can of the friction
    result, _ = problem(y, parameters={**ALL_FREE, "damper.d": 1.5}, weights=Weights(W={"mass": 1.0}))
    follows = result.residual_places["mass"].follows
    assert follows is not None
    assert follows.what in ("the sign of mass.v", "mass.v")
    assert any(note.startswith("residual.mass follows") for note in result.notes)
    assert any("not white" in note for note in result.notes)


def test_a_right_model_has_nothing_to_say_of_its_errors():
    rng = np.random.default_rng(2)
    result, _ = problem(many(800, 1, rng)[0] + STD * rng.normal(size=800))
    words = ("not white", "not normal", "follows", "promise")
    assert not [note for note in result.notes if any(word in note for word in words)]
    assert result.fit["run"]["x"].prediction_rms == pytest.approx(1.0, abs=4 / np.sqrt(2 * 800))


def axis_run(seed: int, force: float, std: float = 1e-4, sign: float = 1.0) -> Recording:
    rng, n = np.random.default_rng(seed), 600
    time, u = 0.01 * np.arange(n), np.repeat(5 * rng.choice([-1.0, 1.0], size=61), 10)[:n]
    x = truths.disturbed(PLANT, time, u, np.zeros(2), force, rng) if force else truths.motion(PLANT, time, u, np.zeros(2))
    y = x[:, 0] + std * rng.standard_normal(n)
    return Recording(name="run", time=time, inputs={"F": sign * u}, outputs={"x": y}, output_std={"x": std})


@pytest.mark.slow
@pytest.mark.parametrize("std", [1e-4, 1e-6])
@pytest.mark.parametrize("force", [0.0, 0.02])
def test_where_no_force_acts_the_floor_is_named_and_no_memory_and_where_one_acts_its_size(std, force):
    free = {"mass.m": Free(2.2), "spring.k": Free(45.0), "damper.d": PLANT.d, "offset.f": PLANT.offset}
    for seed in range(3):
        notes = smooth(Problem(model=MODEL, recordings=[axis_run(seed, force, std)], parameters=free)).notes
        (note,) = [n for n in notes if n.startswith("W of mass")]
        assert ("no force can be told from none" in note) == (force == 0.0), note
        assert ("from what the fit leaves over" in note) == (force > 0.0)
        assert force or not any("a force with a memory" in n for n in notes)


def test_a_sign_that_is_wrong_is_suspected_where_bounds_hold_and_nothing_is_explained():
    free = {"mass.m": Free(2.2, 0.1, 1e3), "spring.k": Free(45.0, 1.0, 1e3), "damper.d": Free(1.0, 0.0, 1e2), "offset.f": Free(0.0)}
    wrong = smooth(Problem(model=MODEL, recordings=[axis_run(0, 0.02, sign=-1.0)], parameters=free)).notes
    (note,) = [n for n in wrong if "explains next to nothing" in n]
    assert "Check units and signs of inputs and outputs." in note
    # a bound that holds while the rest is right is no reason
    tight = {**free, "damper.d": Free(1.8, 1.6, 1e2)}
    right = smooth(Problem(model=MODEL, recordings=[axis_run(0, 0.02)], parameters=tight)).notes
    assert any("damper.d ended on its bound, 1.6" in n for n in right)
    assert not any("explains next to nothing" in n for n in right)


def test_terms_that_all_grew_where_nothing_is_explained_are_named():
    free = {"mass.m": Free(2.2), "spring.k": Free(45.0), "damper.d": Free(1.0), "offset.f": Free(0.0)}
    wrong = smooth(Problem(model=MODEL, recordings=[axis_run(0, 5.0, sign=-1.0)], parameters=free))
    assert wrong.value("mass.m") > 1e7
    (note,) = [n for n in wrong.notes if "explains next to nothing" in n]
    assert "mass.m and spring.k grew beyond all measure" in note
    assert "and fix one of mass.m and spring.k, or W there. Where these are right a force" in note
    right = smooth(Problem(model=MODEL, recordings=[axis_run(0, 0.02)], parameters=free))
    assert right.value("mass.m") == pytest.approx(2.0, rel=0.02)
    assert not any("explains next to nothing" in n for n in right.notes)


def test_rows_a_thousand_times_as_far_apart_are_told_with_the_remedy_and_other_rates_are_not():
    near, far = axis_run(0, 0.02), axis_run(1, 0.02)
    thousand = replace(far, name="logged", time=1e3 * far.time)
    note = rates_note([near, thousand])
    assert note is not None
    assert 'time = { column = "...", unit = "ms" }' in note
    assert "logged" in note
    assert rates_note([near, replace(far, time=990.0 * 2 * far.time)]) is None
    assert rates_note([near, far]) is None


def test_rows_that_are_seconds_apart_ask_whether_these_are_seconds():
    run = axis_run(0, 0.02)
    slow = replace(run, name="logged", time=1e3 * run.time)
    assert seconds_note([run]) is None
    note = seconds_note([run, slow])
    assert note is not None
    assert note.startswith("logged has its rows 10 s apart and is 5990 s long: is its time in seconds?")
    assert 'time = { column = "...", unit = "ms" }' in note
    assert _on_rates(Problem(model=MODEL, recordings=[run, slow], parameters=ALL_FREE)) == [rates_note([run, slow])]
    assert _on_rates(Problem(model=MODEL, recordings=[slow], parameters=ALL_FREE)) == [seconds_note([slow])]


def notes_of(recording: Recording, **damper: float) -> list[str]:
    free = {"mass.m": PLANT.m, "spring.k": Free(45.0), "damper.d": Free(PLANT.d, **damper), "offset.f": PLANT.offset}
    return list(smooth(Problem(model=MODEL, recordings=[recording], parameters=free)).notes)


def test_an_input_that_is_nothing_in_every_row_is_named():
    driven = axis_run(0, 0.02)
    dead = replace(driven, inputs={"F": np.zeros(len(driven.time))})
    assert [note for note in notes_of(dead) if note.startswith("Input F is 0 in every row")]
    assert not [note for note in notes_of(driven) if "in every row" in note]


@pytest.mark.parametrize("arrives", [True, False])
def test_an_output_that_is_the_same_in_all_samples_is_named(arrives):
    driven = axis_run(0, 0.02)
    stuck = replace(driven, name="stuck", outputs={"x": np.full(len(driven.time), 0.25)})
    free = {"mass.m": Free(PLANT.m), "spring.k": PLANT.k, "damper.d": PLANT.d, "offset.f": PLANT.offset}
    settings = None if arrives else Settings(options=Options(gauss_newton_iterations=1, max_iterations=0))
    s = smooth(Problem(model=MODEL, recordings=[driven, stuck], parameters=free), settings=settings)
    assert s.solver.converged is arrives
    (told,) = (note for note in s.notes if "in all" in note)
    assert told.startswith(f"Output x is 0.25 m in all {len(driven.time)} samples of stuck: it tells nothing of its own noise")


def test_bounds_that_the_physics_does_not_allow_are_named_once():
    (told,) = (note for note in notes_of(axis_run(0, 0.02), min=-50.0, max=90.0) if "damper.d" in note)
    assert told == "damper.d: min = -50 is beyond its physical 0 N.s/m, which holds."


def test_parameters_of_another_size_than_their_guesses_ask_for_the_units():
    """The bundled axis with its force in kN where N are meant; in N the guesses, three times off, are not worth a word."""
    given = Recording.read(path("axis_fit.csv.gz"), time="t_s", inputs={"F": "F_N"}, outputs={"x": "x_m"}, std={"x": 1e-6}, range=(0, 1.5))
    free = {"carriage.m": Free(40), "friction.d": Free(500), "friction.f_c": Free(50), "offset.f": Free(-3)}
    said = []
    for factor in (1.0, 1e-3):
        scaled = replace(given, inputs={"F": factor * given.inputs["F"]})
        notes = smooth(Problem(model=actuator(), recordings=[scaled], parameters=free)).notes
        said.append([note for note in notes if "are time, inputs, outputs and guesses in the units" in note])
    assert said[0] == []
    assert len(said[1]) == 1
    assert all(f"{name} " in said[1][0] for name in ("carriage.m", "friction.d", "friction.f_c"))
    assert "times below its guess, 40 kg" in said[1][0]
    assert "offset.f" not in said[1][0]


def test_fewer_numbers_than_deviations_mean_anything_for_are_counted():
    free = {"mass.m": Free(2.2), "spring.k": Free(45.0), "damper.d": PLANT.d, "offset.f": PLANT.offset}
    whole = axis_run(0, 0.02)
    short = replace(whole, time=whole.time[:9], inputs={"F": whole.inputs["F"][:9]}, outputs={"x": whole.outputs["x"][:9]})
    few = smooth(Problem(model=MODEL, recordings=[short], parameters=free, weights=Weights(W={"mass": 0.02}))).notes
    assert any(n.startswith("Only 9 numbers were measured for 4 unknowns, 2 parameters and 2 first values") for n in few)
    enough = smooth(Problem(model=MODEL, recordings=[whole], parameters=free, weights=Weights(W={"mass": 0.02}))).notes
    assert not any("numbers were measured for" in n for n in enough)


def test_first_values_of_states_are_unknown_after_a_gap_though_the_start_is_known():
    whole, kept = axis_run(0, 0.02), np.r_[0:6, 500:505]
    cut = replace(whole, time=whole.time[kept], inputs={"F": whole.inputs["F"][kept]}, outputs={"x": whole.outputs["x"][kept]}, gap=1.0)
    free = {"mass.m": Free(2.2), "spring.k": Free(45.0), "damper.d": PLANT.d, "offset.f": PLANT.offset}
    known = {"mass.s": Known(0.0), "mass.v": Known(0.0, always=True)}
    posed = Problem(model=MODEL, recordings=[cut], parameters=free, weights=Weights(W={"mass": 0.02}), initial=known)
    # both are known of the first piece; of the second the velocity
    few = smooth(posed, settings=Settings(check_mesh=False, marginal=False)).notes
    assert not any("numbers were measured for" in n for n in few)  # 11 for 3
    shorter = replace(posed, recordings=[replace(cut, outputs={"x": np.where(np.arange(11) % 3 == 1, np.nan, cut.outputs["x"])})])
    few = smooth(shorter, settings=Settings(check_mesh=False, marginal=False)).notes
    assert any(n.startswith("Only 7 numbers were measured for 3 unknowns, 2 parameters and 1 first values") for n in few)


def test_the_noise_of_an_output_that_is_constant_somewhere_is_said_to_be_given_only_where_it_is():
    moves = replace(axis_run(0, 0.02), output_std={})
    still = replace(moves, name="still", time=moves.time[:100], inputs={"F": np.zeros(100)}, outputs={"x": np.full(100, -0.014)})
    free = {"mass.m": PLANT.m, "spring.k": Free(45.0), "damper.d": PLANT.d, "offset.f": PLANT.offset}

    def said(*recordings: Recording, model: Dae = MODEL) -> str:
        posed = Problem(model=model, recordings=recordings, parameters=free, weights=Weights(W={"mass": 0.02}))
        (note,) = [n for n in smooth(posed, settings=Settings(check_mesh=False, marginal=False)).notes if n.startswith("V of x")]
        return note

    assert re.search(
        r"from the samples' differences, .* \(run\); std \S+ m as elsewhere, for it is constant here \(still\)", said(moves, still)
    )
    assert re.search(r"std 0\.002 m as given \(still\)", said(moves, replace(still, output_std={"x": 0.002})))
    sensor = replace(MODEL, outputs=tuple(replace(q, noise_std=1e-4) for q in MODEL.outputs))
    assert said(still, model=sensor) == "V of x: std 0.0001 m as the model supposes, for it is constant here."


@pytest.mark.parametrize("times", [5.0, 20.0])
def test_a_given_weight_that_is_too_large_is_named_and_no_memory_is_seen(times):
    free = {"mass.m": Free(2.2), "spring.k": Free(45.0), "damper.d": PLANT.d, "offset.f": PLANT.offset}
    notes = smooth(Problem(model=MODEL, recordings=[axis_run(1, 0.2)], parameters=free, weights=Weights(W={"mass": 0.2 * times}))).notes
    (note,) = [n for n in notes if n.startswith("W of mass allows")]
    # forces that may be larger follow the noise too: the factor is a lower bound
    assert 0.3 * times < float(note.split("at least ")[1].split()[0]) < 1.1 * times
    assert not any("memory" in n for n in notes)


@pytest.mark.parametrize(("settled", "said", "told"), [(False, (UNMOVED,), True), (True, (UNMOVED,), False), (False, (), False)])
def test_numbers_of_a_way_that_came_to_no_end_are_said_to_mislead(settled, said, told):
    run = SimpleNamespace(choice=SimpleNamespace(settled=settled), said=said)
    assert ["mislead" in note for note in _on_nothing_settled(run)] == ([True] if told else [])


def test_weights_of_which_the_same_can_be_said_have_one_sentence():
    alike = {"std {} as given.": [("a", "1 N"), ("b", "2 N"), ("c", "3 m")], "std {} from elsewhere.": [("d", "4 N")]}
    assert _of_several("W", alike) == ["W of a, b and c: std 1 N, 2 N and 3 m as given.", "W of d: std 4 N from elsewhere."]
