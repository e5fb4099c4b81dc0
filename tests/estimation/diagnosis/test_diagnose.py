"""The whole search on machines of which one thing was concealed, made by a simulator that shares nothing with this project's."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from concealed_axis import NOISE, posed, run

from backsight.data.generators.actuator import CONDITIONS, SERVO, Carriage, record
from backsight.estimation import Free, Problem, Recording, Weights
from backsight.estimation.diagnosis import Diagnosis, diagnose
from backsight.models import Model, compile_model
from backsight.models.errors import InputError
from backsight.models.mechanics.translational import Force, ForceSensor, Friction, Mass, SpringDamper
from backsight.models.simulation import simulate

LONG = [pytest.mark.slow, pytest.mark.long]
STEP = 2e-3


def case(duration: float = 2.0, seed: int = 1, **carriage: float) -> Problem:
    return posed(run(duration, STEP, seed, **carriage), W={})


def answer(d: Diagnosis) -> tuple:
    """All that is found, to the digits that another order of the same sums leaves."""

    def number(value: float | None) -> str:
        return f"{value:.6g}" if value is not None else ""

    found = [
        (f.explanation.words, *(f"{k}: {number(s.value)} {number(s.std)}" for k, s in f.explanation.parameters.items()), f.change, f.regime)
        for f in d.findings
    ]
    return d.verdict, tuple(found), tuple((t.explanation.words, number(t.fitted)) for t in d.tried)


@cache
def friction() -> Diagnosis:
    return diagnose(case(f_c=20.0), jobs=1)


@cache
def clean() -> Diagnosis:
    return diagnose(case(), jobs=1)


def test_concealed_coulomb_friction_is_named_placed_and_measured():
    d = friction()
    assert d.verdict == "missing_physics"
    found = d.findings[0]
    assert (found.explanation.place, found.explanation.physics) == ("carriage", "coulomb_friction")
    f_c = found.explanation.parameters["f_c"]
    assert f_c.unit == "N"
    assert f_c.value == pytest.approx(20.0, rel=0.02)
    assert abs(f_c.value - 20.0) < 3.5 * f_c.std
    assert found.p_value < 0.01
    assert found.gain > 50
    assert found.onset is None
    made = run(2.0, STEP, f_c=20.0)
    force = np.sqrt(np.mean(made.inputs["F"] ** 2))
    assert found.share == pytest.approx(20.0 / force, rel=0.4)
    assert "Friction() at carriage.flange" in found.change


def test_what_is_held_out_and_contradicts_a_repair_makes_it_undecided():
    first, other = case(4.0, f_c=20.0), posed(run(4.0, STEP, seed=5), W={})  # the friction was gone on the other day
    held_out = replace(other.recordings[0], name="other day", role="held_out")
    d = diagnose(replace(first, recordings=[*first.recordings, held_out]), jobs=1)
    assert [f.explanation.physics for f in d.findings][:1] == ["coulomb_friction"]
    assert d.held_out.improvement_percent < 0
    assert d.verdict == "undecided"
    assert any("contradicts" in note for note in d.notes)


def test_a_small_effect_that_what_is_held_out_contradicts_goes_out_of_the_repair():
    first, other = case(f_c=20.0, f_0=0.5), posed(run(2.0, STEP, seed=5, f_c=20.0), W={})  # the offset was gone on the other day
    held_out = replace(other.recordings[0], name="other day", role="held_out")
    d = diagnose(replace(first, recordings=[*first.recordings, held_out]), jobs=1)
    assert [f.explanation.physics for f in d.findings] == ["coulomb_friction"]
    assert d.verdict == "missing_physics"
    assert "constant" not in d.findings[0].change
    assert any("is not in the repaired model" in note for note in d.notes)
    assert not any(name.startswith("constant_force") for name in d.after.parameters)
    assert d.held_out.improvement_percent > 50
    assert d.held_out.p_value < 0.01


def test_the_repaired_model_has_the_parameters_of_the_machine_and_predicts_what_was_held_out():
    d = friction()
    assert d.after.parameters["carriage.m"].value == pytest.approx(95.109, rel=5e-3)
    assert d.after.parameters["friction.d"].value == pytest.approx(203.5, rel=0.03)
    assert abs(d.before.parameters["friction.d"].value - 203.5) > 5 * abs(d.after.parameters["friction.d"].value - 203.5)
    assert d.held_out is not None
    assert d.held_out.improvement_percent > 50
    assert d.held_out.role == "last third"
    assert any("last third" in note for note in d.notes)
    assert len(d.repaired.model.components) == len(case(0.1).model.components) + 1
    assert {m.recording for m in d.mismatch} == {"axis"}
    assert len(d.mismatch) == 2


def test_a_machine_that_lacks_nothing_is_told_so_with_what_could_not_have_been_seen():
    d = clean()
    assert d.verdict == "none"
    assert d.findings == ()
    assert d.held_out is not None
    assert not d.held_out.repaired
    assert d.held_out.after == d.held_out.before
    assert np.isnan(d.held_out.p_value)
    errors = d.held_out.before["x"].windows
    spread = float(np.std(case().recordings[0].outputs["x"]))
    assert all(rms < 0.1 * spread for rms in errors.values())
    floors = {(u.place, u.physics): u.strength for u in d.undetectable}
    assert {("carriage", "coulomb_friction"), ("carriage", "cogging"), ("input:F", "input_offset")} <= set(floors)
    assert all(np.isfinite(s) and s > 0 for s in floors.values())
    assert floors["carriage", "coulomb_friction"] < 5.0
    assert compile_model(d.repaired.model).name == "actuator"


def test_of_a_recording_that_is_too_short_nothing_is_held_out_and_nothing_is_said_of_it():
    d = diagnose(case(50 * STEP), jobs=1)
    assert d.held_out is None
    assert any("too short" in note for note in d.notes)
    assert not any("could not be predicted" in note for note in d.notes)


@pytest.mark.slow
def test_friction_of_twice_the_floor_is_seen():
    least = {(u.place, u.physics): u.strength for u in clean().undetectable}["carriage", "coulomb_friction"]
    d = diagnose(case(f_c=2.0 * least), jobs=1)
    assert d.verdict != "none"
    named = {(f.explanation.place, f.explanation.family) for f in d.findings}
    assert ("carriage", "friction") in named


@pytest.mark.slow
def test_a_mass_that_was_given_wrong_is_a_parameter():
    d = diagnose(posed(run(2.0, STEP), W={}, carriage__m=0.85 * 95.109), jobs=1)
    assert d.verdict == "parameter"
    found = d.findings[0].explanation
    assert (found.place, found.physics) == ("carriage", "wrong_parameter")
    assert found.parameters["carriage.m"].value == pytest.approx(95.109, rel=5e-3)
    assert {(r.place, r.physics) for r in d.findings[0].rivals} >= {("carriage", "added_mass")}
    assert d.findings[0].separates == ""  # of some of them scores say nothing


@pytest.mark.slow
def test_an_offset_may_be_that_of_the_input_and_a_sensor_of_that_would_tell():
    d = diagnose(case(f_0=15.0), jobs=1)
    assert d.verdict == "undecided"
    (found,) = d.findings
    both = {(e.place, e.physics) for e in (found.explanation, *found.rivals)}
    assert both == {("input:F", "input_offset"), ("carriage", "constant_force")}
    assert found.separates.startswith("a sensor of F as it acts")


@pytest.mark.slow
def test_friction_that_grows_in_a_model_that_estimates_friction_is_dated():
    def grows(t: float, _: np.ndarray, v: np.ndarray) -> np.ndarray:
        return -9.0 * np.tanh(v / 1e-4) * (t > 1.2)

    d = diagnose(posed(run(2.0, STEP, force=grows, f_c=12.0), W={}, friction__f_c=Free(10.0)), jobs=1)
    (found,) = d.findings
    assert (found.explanation.place, found.explanation.physics) == ("carriage", "coulomb_friction")
    assert found.onset == pytest.approx(1.2, abs=0.02)
    assert found.explanation.parameters["f_c"].value == pytest.approx(9.0, rel=0.02)
    assert d.after.parameters["friction.f_c"].value == pytest.approx(12.0, rel=0.02)
    assert d.repaired.model.onsets.keys() == {"coulomb_friction_carriage.f_c"}


@pytest.mark.slow
def test_an_amplifier_that_cuts_off_is_the_input():
    servo = replace(SERVO, limit=170.0)
    made = record(Carriage(f_c=0.0, f_0=0.0), seed=1, conditions=replace(CONDITIONS, duration=2.0, step=STEP), servo=servo)
    acted = made.inputs["F"]
    over = np.abs(acted) > 169.9
    assert 0.02 < np.mean(over) < 0.5
    asked = np.where(over, np.sign(acted) * (170.0 + 90.0 * np.abs(np.sin(40.0 * made.time))), acted)
    d = diagnose(posed(replace(made, inputs={"F": asked}), W={}), jobs=1)
    assert d.verdict == "input"
    found = d.findings[0].explanation
    assert (found.place, found.physics) == ("input:F", "input_saturation")
    limit = found.parameters["limit"]
    assert limit.value == pytest.approx(170.0, rel=0.02)


@pytest.mark.slow
def test_an_encoder_that_lags_is_the_sensor():
    made = run(2.0, STEP)
    x, a = made.truth["carriage.s"], float(np.exp(-STEP / 0.008))
    read = np.empty_like(x)
    read[0] = x[0]
    for k in range(1, len(x)):  # of a reading that is straight between its rows, to second order
        read[k] = a * read[k - 1] + (1 - a) * (x[k] + x[k - 1]) / 2
    noise = NOISE * np.random.default_rng(0).standard_normal(len(x))
    told = list[str]()
    d = diagnose(posed(replace(made, outputs={"x": read + noise}), W={}), jobs=1, progress=told.append)
    named = {(f.place, f.physics) for one in d.findings[:1] for f in (one.explanation, *one.rivals)}
    assert d.verdict in ("sensor", "input", "undecided")  # a lag of the sensor is one of the input where friction is viscous
    assert named & {("sensor:x", "sensor_lag"), ("sensor:x", "sensor_delay"), ("input:F", "input_lag"), ("input:F", "input_delay")}
    # a lag has a state of its own, and its mesh is looked at as soon as it is found; at the end, only if something was found since
    lags = [f.explanation.physics.endswith("_lag") for f in d.findings]
    assert told.count("the mesh, with what was found") == sum(lags) + (not lags[-1])


def test_what_was_found_ends_on_a_mesh_that_no_longer_moves_its_numbers():
    """A motion of few samples: the mesh on which candidates are compared is too coarse for it, and is looked at again after the last."""
    told = list[str]()
    d = diagnose(posed(run(4.0, 8e-3, f_c=20.0), W={"carriage": 0.02}), jobs=1, progress=told.append)
    (ends,) = (k for k, said in enumerate(told) if said == "the mesh, with what was found")
    assert ends > max(k for k, said in enumerate(told) if said.startswith("fit "))
    proof = told.index("proof on what was held out")
    assert any(said.startswith("looking again with") for said in told[ends:proof])
    f_c = d.findings[0].explanation.parameters["f_c"]
    assert abs(f_c.value - 20.0) < 4 * f_c.std


@pytest.mark.slow
def test_the_same_seed_gives_the_same_answer_with_one_process_and_with_two():
    problem = case(1.5, f_c=20.0)
    once, again, side_by_side = (answer(diagnose(problem, jobs=jobs, seed=3)) for jobs in (1, 1, 2))
    assert once == again
    assert once == side_by_side


@pytest.mark.slow
def test_a_diagnosis_that_was_kept_is_the_same_when_it_goes_on(tmp_path):
    problem = case(1.5, f_c=20.0)
    first = diagnose(problem, jobs=1, keep=tmp_path)
    made = {part.name: part.stat().st_mtime_ns for part in tmp_path.glob("*.part")}
    assert made
    again = diagnose(problem, jobs=1, keep=tmp_path)
    assert answer(first) == answer(again)
    assert {part.name: part.stat().st_mtime_ns for part in tmp_path.glob("*.part")} == made  # nothing was fitted once more


def test_two_parameters_that_nobody_can_tell_apart_do_not_hide_what_is_missing():
    """A second damper beside the axis's own, both free: the friction is found as without it, and the note says what was supposed."""
    plain = case(f_c=20.0)
    model = plain.model.insert("carriage", Friction(d=20.0, f_c=0.0), "seal")
    d = diagnose(replace(plain, model=model, parameters={**plain.parameters, "seal.d": Free(20.0)}), jobs=1)
    assert d.verdict == "missing_physics"
    assert d.findings[0].explanation.words == "coulomb friction at carriage"
    assert d.findings[0].explanation.parameters["f_c"].value == pytest.approx(20.0, rel=0.02)
    assert d.after.parameters["friction.d"].value + d.after.parameters["seal.d"].value == pytest.approx(203.5, rel=0.03)
    assert any("friction.d and seal.d apart" in note and "seal.d = 20 ± 20 N.s/m" in note for note in d.notes)


@pytest.mark.parametrize(
    "supposed",
    [
        {"weights": Weights(V={"F": 0.5})},
        pytest.param({"parameters": {"offset.f": Free(0.0, per_recording=True)}}, marks=LONG),
        pytest.param({"parameters": {"offset.f": Free(0.0, drift=0.1)}}, marks=LONG),
        {"weights": Weights(W={"kinematics:carriage.s": 1e-5, "carriage": 0.1})},
        {"weights": Weights(W={"carriage": 1.0}, tau={"carriage": 0.05})},
    ],
    ids=["noise of the input", "an offset of every recording", "an offset that drifts", "kinematics that do not hold", "a coloured force"],
)
def test_what_a_problem_supposes_beyond_its_model_is_no_obstacle(supposed):
    """Two recordings of the axis with friction concealed; each supposition is one that the smoother has."""
    first, second = case(f_c=20.0), case(seed=2, f_c=20.0)
    both = [first.recordings[0], replace(second.recordings[0], name="second")]
    parameters = {**first.parameters, **supposed.get("parameters", {})}
    d = diagnose(replace(first, recordings=both, parameters=parameters, weights=supposed.get("weights", Weights())), jobs=1)
    assert d.verdict == "missing_physics"
    assert d.findings[0].explanation.words == "coulomb friction at carriage"
    assert d.findings[0].explanation.parameters["f_c"].value == pytest.approx(20.0, rel=0.03)


@pytest.mark.slow
@pytest.mark.long
def test_a_delay_that_is_to_be_estimated_is_one_of_the_things_looked_for():
    """Friction concealed, and an encoder that lags by a row and a half; the study asks for its delay."""
    made = case(f_c=20.0)
    (axis,) = made.recordings
    late = np.interp(axis.time - 1.5 * STEP, axis.time, axis.outputs["x"])
    asked = replace(axis, outputs={"x": late}, open_delays=("x",))
    d = diagnose(replace(made, recordings=[asked]), jobs=1)
    found = {f.explanation.physics: f.explanation.parameters for f in d.findings}
    assert found["coulomb_friction"]["f_c"].value == pytest.approx(20.0, rel=0.03)
    (delay,) = (p["delay"].value for physics, p in found.items() if physics.endswith("_delay"))
    assert delay == pytest.approx(1.5 * STEP, rel=0.02)
    assert any("delay of x was not estimated beforehand" in note for note in d.notes)


def test_a_delay_that_is_given_stays():
    made = case(f_c=20.0)
    (axis,) = made.recordings
    late = np.interp(axis.time - 2 * STEP, axis.time, axis.outputs["x"])
    asked = replace(
        made, recordings=[replace(axis, outputs={"x": late}, open_delays=("x",))], parameters={**made.parameters, "delay:x": 2 * STEP}
    )
    d = diagnose(asked, jobs=1)
    assert [f.explanation.words for f in d.findings] == ["coulomb friction at carriage"]
    assert not any("delay" in note for note in d.notes)


def test_a_model_whose_states_nobody_can_tell_is_left_undecided():
    """Two masses on a line of which only the force between them is measured: nothing says where they are, or how fast."""
    parts = {"motor": Force(), "one": Mass(m=2.0), "gauge": ForceSensor(), "spring": SpringDamper(k=800.0, d=4.0), "two": Mass(m=3.0)}
    line = (("motor.flange", "one.flange"), ("one.flange", "gauge.flange_a"), ("gauge.flange_b", "spring.flange_a"))
    model = Model(
        name="train",
        components=parts,
        connections=(*line, ("spring.flange_b", "two.flange")),
        inputs={"F": "motor.f"},
        outputs={"f": "gauge.f"},
    )
    time, rng = np.arange(0.0, 3.0, 5e-3), np.random.default_rng(4)
    F = 10.0 * np.sign(np.sin(5.0 * time))
    truth = simulate(compile_model(model), time, {"F": F}).outputs["f"]
    run = Recording(
        name="run", time=time, inputs={"F": F}, outputs={"f": truth + 0.05 * rng.normal(size=time.size)}, output_std={"f": 0.05}
    )
    d = diagnose(Problem(model=model, recordings=[run], parameters={"one.m": Free(1.5)}), jobs=1)
    assert d.verdict == "undecided"
    assert any(note.startswith("No models were compared") for note in d.notes)


def test_a_compiled_model_has_no_places_and_is_refused_in_words():
    problem = case(0.2)
    with pytest.raises(InputError, match=r"compiled Dae, which has no places.*give the Model itself"):
        diagnose(replace(problem, model=compile_model(problem.model)), jobs=1)


def test_a_search_without_time_names_nothing_and_says_why():
    d = diagnose(case(f_c=20.0), jobs=1, seconds=0.0)
    assert d.verdict == "unknown_physics"  # the place needs no fit
    assert d.findings[0].explanation.place == "carriage"
    assert d.tried == ()
    assert any("limit of time" in note for note in d.notes)


@pytest.mark.parametrize(("level", "verdict"), [(1.4, "undecided"), (0.0, "none")])
def test_a_search_without_time_does_not_say_that_nothing_is_missing_where_something_stands_out(level, verdict):
    d = diagnose(case(f_c=level), jobs=1, seconds=0.0)
    assert d.findings == ()
    assert d.verdict == verdict
