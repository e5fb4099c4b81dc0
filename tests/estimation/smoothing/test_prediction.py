"""Held-out recordings, against simulations that know nothing of the smoother."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import truths
from examples import OFFSET, D, K, M, compiled, oscillator

from backsight.estimation import Free, Known, Problem, Recording, Smoothing, Weights, smooth
from backsight.estimation.command.result_json import result_of_smoothing
from backsight.estimation.smoothing.prediction import _heads, predict
from backsight.models import InputError, SolveError
from backsight.models.plants import actuator
from backsight.ocp import Status

PLANT, MODEL, STD = truths.Plant(m=M, d=D, k=K, offset=OFFSET), compiled(oscillator()), 1e-3


def record(name: str, seed: int, *, role: str = "held_out", n: int = 400, start=(0.02, -0.1), plant: truths.Plant = PLANT) -> Recording:
    rng = np.random.default_rng(seed)
    time, u = 0.01 * np.arange(n), 20 * np.repeat(rng.normal(size=n // 10 + 1), 10)[:n]
    y = truths.motion(plant, time, u, np.array(start))[:, 0] + STD * rng.normal(size=n)
    return Recording(name=name, time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": STD}, role=role)


def fitted(*held_out: Recording, parameters: dict | None = None, **more) -> Smoothing:
    recordings = [record("fit", 1, role="fit"), *held_out]
    given = {"mass.m": Free(3.0), "spring.k": Free(30.0)} if parameters is None else parameters
    return smooth(Problem(model=MODEL, recordings=recordings, parameters=given, weights=Weights(W={"mass": 0.02}), **more))


def test_a_held_out_recording_is_predicted_to_its_noise_by_the_right_model():
    s = fitted(record("other", 2, start=(-0.1, 0.4)))
    p = s.held_out["other"]
    assert p.fit["x"].rms == pytest.approx(STD, rel=0.1)
    assert p.window_rms["x"] == pytest.approx(STD, rel=0.15)
    assert p.window_s == pytest.approx(0.2)
    assert p.start_s == pytest.approx(0.39)
    assert list(p.estimates) == ["t_s", "x", "x.measured", "mass.s", "mass.v"]
    assert p.estimates["mass.v"].iloc[0] == pytest.approx(0.4, abs=0.02)
    assert "other" not in s.fit
    assert "other" not in s.estimates


def test_a_prediction_uses_no_later_sample_and_no_residual_force():
    """What is wrong with the recording after its start must show in full, where a smoother would bend to it."""
    other = record("other", 2)
    y = other.outputs["x"] + np.where(other.time > 1.0, 0.05, 0.0)
    s = fitted(replace(other, outputs={"x": y}))
    error = y - s.held_out["other"].estimates["x"].to_numpy()
    assert np.mean(error[other.time > 1.0]) == pytest.approx(0.05, rel=0.05)
    assert np.sqrt(np.mean(error[other.time < 1.0] ** 2)) == pytest.approx(STD, rel=0.2)


def test_a_wrong_model_predicts_worse_than_a_right_one_by_what_it_lacks():
    other, wrong = record("other", 2), {"mass.m": M, "spring.k": 1.1 * K}
    free = fitted(other, parameters=wrong).held_out["other"]
    rows = truths.motion(replace(PLANT, k=1.1 * K), other.time, other.inputs["F"], np.array([0.02, -0.1]))[:, 0] - other.outputs["x"]
    assert free.fit["x"].rms == pytest.approx(np.sqrt(np.mean(rows**2)), rel=0.1)
    assert free.window_rms["x"] < 0.5 * free.fit["x"].rms


def test_a_start_that_is_known_is_kept():
    s = fitted(record("other", 2), initial={"mass.s": 0.02, "mass.v": -0.1})
    first = s.held_out["other"].estimates.iloc[0]
    assert (first["mass.s"], first["mass.v"]) == pytest.approx((0.02, -0.1), abs=1e-12)


@pytest.mark.slow
def test_the_notes_say_which_outputs_drift_and_which_do_not():
    stays = " ".join(fitted(record("other", 2, n=2000)).notes)
    assert "Held out: other, simulated under its inputs" in stays
    assert "does not forget" not in stays
    loose = replace(PLANT, k=0.0)
    recordings = [record("fit", 1, role="fit", plant=loose), record("other", 2, plant=loose)]
    given = {"spring.k": 0.0, "mass.m": Free(3.0)}
    drifts = " ".join(smooth(Problem(model=MODEL, recordings=recordings, parameters=given, weights=Weights(W={"mass": 0.02}))).notes)
    assert "x: the model does not forget its state there" in drifts


def test_result_json_marks_what_was_held_out():
    fit = result_of_smoothing(fitted(record("other", 2)), command="smooth")["fit"]
    assert fit["fit"]["x"]["role"] == "fit"
    assert fit["other"]["x"]["role"] == "held_out"
    assert set(fit["other"]["x"]) - set(fit["fit"]["x"]) == {"window_s", "window_rms"}


def test_a_recording_too_short_for_windows_is_predicted_without_them():
    p = fitted(record("other", 2, n=25)).held_out["other"]
    assert p.window_s is None
    assert p.window_rms == {}
    assert p.fit["x"].rms < 3 * STD


def test_a_recording_without_samples_at_its_start_is_not_predicted_and_a_note_says_so():
    other = record("other", 2)
    y = np.where(other.time < 2.0, np.nan, other.outputs["x"])
    s = fitted(replace(other, outputs={"x": y}))
    assert s.held_out == {}
    assert any(note.startswith("Held out: other could not be predicted: no output has a value") for note in s.notes)


def test_a_held_out_recording_needs_the_models_inputs_too():
    with pytest.raises(InputError, match="other: input F of oscillator is not recorded"):
        fitted(replace(record("other", 2), inputs={}))


def test_friction_is_predicted_with_the_sharp_law_of_a_simulation():
    """A stuck carriage stays where it is, however long: a rounded law would creep."""
    rng, n = np.random.default_rng(0), 400
    time = 0.01 * np.arange(n)
    recordings = []
    for name, push, role in (("fit", 60.0, "fit"), ("other", 10.0, "held_out")):
        x = np.zeros(n)
        v = 0.0
        u = push * np.sign(np.sin(3 * time))
        for k in range(n - 1):
            for _ in range(20):
                rest = v == 0.0 and abs(u[k]) <= 20.0
                a = 0.0 if rest else (u[k] - 20.0 * np.sign(v if v else u[k])) / 95.0
                after = v + a * 5e-4
                v = 0.0 if v * after < 0 and abs(u[k]) <= 20.0 else after
                x[k + 1] = (x[k + 1] or x[k]) + v * 5e-4
        y = x + 1e-5 * rng.normal(size=n)
        recordings.append(Recording(name=name, time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": 1e-5}, role=role))
    parameters = {"carriage.m": 95.0, "friction.d": 0.0, "friction.f_c": 20.0, "offset.f": 0.0}
    s = smooth(Problem(model=actuator(), recordings=recordings, parameters=parameters, weights=Weights(W={"carriage": 0.5})))
    creep = np.ptp(s.held_out["other"].estimates["carriage.v"].iloc[5:])
    assert creep < 1e-5


def start_deviation(recording: Recording, rows: int, std: float) -> np.ndarray:
    """What least squares on the first rows knows of the start (s, v), by differences of simulations."""
    time, u = recording.time[:rows], recording.inputs["F"][:rows]
    J = np.column_stack([truths.motion(PLANT, time, u, e)[:, 0] - truths.motion(PLANT, time, u, -e)[:, 0] for e in np.eye(2)]) / 2
    return std * np.sqrt(np.diag(np.linalg.inv(J.T @ J)))


@pytest.mark.parametrize("given", ["by the recording", "by V", "by nobody"])
def test_the_start_is_weighed_by_the_recordings_own_noise_and_not_by_that_of_the_fitted_one(given):
    """A held-out sensor 1000 times as noisy: as precise as the fitted one, it would shake the force and the start."""
    noisy, rng = 5e-3, np.random.default_rng(3)
    other = record("other", 2, start=(0.05, 0.0), n=1500)
    y = truths.motion(PLANT, other.time, other.inputs["F"], np.array([0.05, 0.0]))[:, 0] + noisy * rng.normal(size=1500)
    own = {"by the recording": {"x": noisy}}.get(given, {"x": None})
    fit = record("fit", 1, role="fit")
    time = fit.time
    exact = truths.motion(PLANT, time, fit.inputs["F"], np.array([0.02, -0.1]))[:, 0] + 5e-6 * rng.normal(size=len(time))
    V = {"by V": {"x [other]": noisy}}.get(given, {})
    sensor = noisy if given == "by nobody" else 5e-6  # what nobody gave is as the fitted recording told it
    fit = replace(fit, outputs={"x": exact if sensor < noisy else exact + noisy * rng.normal(size=len(time))}, output_std={"x": sensor})
    recordings = [fit, replace(other, outputs={"x": y}, output_std=own)]
    known = {"mass.m": M, "spring.k": K}
    s = smooth(Problem(model=MODEL, recordings=recordings, parameters=known, weights=Weights(W={"mass": 0.02}, V=V)))
    start = s.held_out["other"].estimates[["mass.s", "mass.v"]].iloc[0].to_numpy()
    assert np.all(np.abs(start - [0.05, 0.0]) < 4 * start_deviation(other, 150, noisy))


def test_weights_of_a_result_serve_again_with_a_noise_for_every_recording():
    rng, recordings = np.random.default_rng(0), []
    for name, std in (("a", 1e-4), ("b", 2e-3)):
        r = record(name, 1, role="fit")
        y = truths.motion(PLANT, r.time, r.inputs["F"], np.array([0.02, -0.1]))[:, 0] + std * rng.normal(size=len(r.time))
        recordings.append(replace(r, outputs={"x": y}, output_std={"x": std}))
    given = {"mass.m": Free(3.0), "spring.k": Free(30.0)}
    once = smooth(Problem(model=MODEL, recordings=recordings, parameters=given, weights=Weights(W={"mass": 0.02})))
    assert pytest.approx({"x": np.sqrt((1e-4**2 + 2e-3**2) / 2), "x [a]": 1e-4, "x [b]": 2e-3}) == once.weights.V
    again = smooth(Problem(model=MODEL, recordings=recordings, parameters=given, weights=once.weights))
    for name in given:
        assert again.parameters[name].value == pytest.approx(once.parameters[name].value, abs=0.01 * once.parameters[name].std)
        assert again.parameters[name].std == pytest.approx(once.parameters[name].std, rel=1e-3)
    assert again.fit["b"]["x"].prediction_rms == pytest.approx(1.0, abs=0.15)


def interrupted(rows: np.ndarray) -> tuple[Recording, np.ndarray]:
    """A recording of which these rows are missing, and its positions without noise; the force in between goes unrecorded."""
    other = record("other", 2, n=1200)
    truth = truths.motion(PLANT, other.time, other.inputs["F"] + np.where(rows, 60.0, 0.0), np.array([0.02, -0.1]))[:, 0]
    noise = other.outputs["x"] - truths.motion(PLANT, other.time, other.inputs["F"], np.array([0.02, -0.1]))[:, 0]
    kept = ~rows
    inputs, outputs = {"F": other.inputs["F"][kept]}, {"x": (truth + noise)[kept]}
    return replace(other, time=other.time[kept], inputs=inputs, outputs=outputs), truth[kept]


@pytest.mark.parametrize(("a", "b"), [(1, 60), (20, 80), (600, 660)])
def test_after_a_gap_the_prediction_begins_anew(a, b):
    """Whatever acted in the gap; a row alone before it belongs to no piece."""
    k = np.arange(1200)
    other, _ = interrupted((k >= a) & (k < b))
    p = fitted(other, parameters={"mass.m": M, "spring.k": K}).held_out["other"]
    assert p.fit["x"].rms == pytest.approx(STD, rel=0.2)
    assert p.window_rms["x"] == pytest.approx(STD, rel=0.2)
    assert len(p.estimates) == len(other.time)
    assert np.isnan(p.estimates["x"].iloc[0]) == (a == 1)
    assert np.array_equal(p.estimates["x.measured"], other.outputs["x"])


def test_rows_that_told_the_start_do_not_count_in_the_fit():
    other = record("other", 2)
    p = fitted(other, parameters={"mass.m": M, "spring.k": 5 * K}).held_out["other"]
    after = other.time > p.start_s + 1e-9
    error = (other.outputs["x"] - p.estimates["x"].to_numpy())[after]
    assert p.fit["x"].samples == after.sum() == 360
    assert p.fit["x"].rms == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-12)


def test_what_is_known_of_a_start_is_known_of_that_of_a_held_out_recording():
    s = fitted(record("other", 2, start=(-0.1, -0.1)), initial={"mass.v": Known(-0.1, 1e-5)})
    assert s.held_out["other"].estimates["mass.v"].iloc[0] == pytest.approx(-0.1, abs=1e-4)


@pytest.mark.parametrize("offset", [OFFSET, Free(0.0, per_recording=True)], ids=["fixed", "of its own"])
def test_starts_that_are_not_found_together_are_found_one_by_one_and_those_that_are_not_are_left_out(offset):
    given = {"mass.m": Free(3.0), "spring.k": Free(30.0), "offset.f": offset}
    recordings = [record("fit", 1, role="fit"), record("fit too", 3, role="fit"), record("other", 2)]
    problem = Problem(model=MODEL, recordings=recordings, parameters=given, weights=Weights(W={"mass": 0.02}))
    result = smooth(problem)
    stopped = replace(result, solver=replace(result.solver, converged=False, status="Stopped."))
    hopeless: list[str] = []

    def one_by_one(posed: Problem) -> Smoothing:
        names = [r.name for r in posed.recordings]
        if names == hopeless[:1]:
            raise SolveError("one window has no start")
        return smooth(posed) if len(names) == 1 and names[0] not in hopeless else stopped

    usual, _ = predict(problem, result, smooth)
    found, notes = predict(problem, result, one_by_one)
    assert found["other"].window_rms["x"] == pytest.approx(usual["other"].window_rms["x"], rel=1e-2)
    np.testing.assert_allclose(found["other"].estimates["x"], usual["other"].estimates["x"], atol=1e-3 * STD)
    assert "not found" not in " ".join(notes)
    windows = [head.name for head in _heads(recordings[2]) if head.window]
    hopeless += windows[:2]
    fewer, notes = predict(problem, result, one_by_one)
    assert "Held out: of other the start of 2 windows was not found; what follows it is not predicted." in notes
    assert fewer["other"].window_rms["x"] != found["other"].window_rms["x"]
    hopeless += [head.name for head in _heads(recordings[2]) if not head.window]
    none, notes = predict(problem, result, one_by_one)
    assert not none
    assert notes == ("Held out: other could not be predicted: its start was not found: Stopped.",)


@pytest.mark.parametrize(("rows", "said"), [(400, "10 windows and 1 piece"), (25, "1 piece")])
def test_a_start_at_which_the_solver_stopped_is_taken_as_it_is_and_a_note_says_so(rows, said):
    recordings = [record("fit", 1, role="fit"), record("other", 2, n=rows)]
    given = {"mass.m": Free(3.0), "spring.k": Free(30.0)}
    problem = Problem(model=MODEL, recordings=recordings, parameters=given, weights=Weights(W={"mass": 0.02}))
    result = smooth(problem)

    def stopped(posed: Problem) -> Smoothing:
        found = smooth(posed)
        assert found.solution is not None
        there = replace(found.solution, solved=replace(found.solution.solved, status=Status.ITERATIONS))
        return replace(found, solver=replace(found.solver, converged=False, status="Stopped."), solution=there)

    usual, _ = predict(problem, result, smooth)
    found, notes = predict(problem, result, stopped)
    assert found["other"].fit["x"].rms == pytest.approx(usual["other"].fit["x"].rms, rel=1e-2)
    assert f"Held out: of other the start of {said} is where the solver stopped, short of its tolerance." in notes
