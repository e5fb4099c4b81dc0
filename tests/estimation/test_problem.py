"""What a problem accepts and how it refuses the rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from examples import oscillator

from backsight.estimation import Free, Known, Problem, Recording, Weights, compare, smooth
from backsight.models import InputError, compile_model
from backsight.models.plants import actuator

RECORDING = Recording(name="run", time=np.arange(4.0), inputs={"F": np.zeros(4)}, outputs={"x": np.arange(4.0)})
DAE = compile_model(oscillator())


def problem(**changes) -> Problem:
    return Problem(**{"model": DAE, "recordings": [RECORDING], **changes})


@pytest.mark.parametrize(
    "bad",
    [
        {"guess": np.nan},
        {"guess": np.inf},
        {"guess": 2, "max": 1},
        {"guess": 0, "min": 1},
        {"guess": 1, "min": 1, "max": 1},
        {"guess": 1, "min": np.nan},
    ],
)
def test_a_free_parameter_needs_a_guess_between_its_bounds(bad):
    with pytest.raises(InputError, match=r"Free\(guess=.*: needs a finite guess with min <= guess <= max and min < max\."):
        Free(**bad)


@pytest.mark.parametrize("std", [0.0, -1.0, np.nan, np.inf])
def test_a_prior_deviation_is_positive_and_finite(std):
    with pytest.raises(
        InputError, match=r"Free\(std=.*\): a standard deviation is positive and finite; leave it out when nothing is known\."
    ):
        Free(1.0, std=std)


@pytest.mark.parametrize("drift", [0.0, -1.0, np.nan, np.inf])
def test_a_rate_of_drift_is_positive_and_finite(drift):
    with pytest.raises(InputError, match=r"Free\(drift=.*\): a rate of drift is positive and finite; leave it out for a constant\."):
        Free(1.0, drift=drift)


def test_a_parameter_drifts_or_is_every_recordings_own():
    with pytest.raises(InputError, match="leave per_recording out"):
        Free(1.0, drift=0.1, per_recording=True)


@pytest.mark.parametrize("known", [(np.nan, 0.0), (0.0, -1.0), (0.0, np.inf), (0.0, np.nan)])
def test_what_is_known_is_a_value_and_a_deviation(known):
    with pytest.raises(InputError, match=r"Known\(value=.*: needs a finite value and a finite std, 0 for exactly"):
        Known(*known)


@pytest.mark.parametrize(
    ("kind", "message"),
    [({"mass": "pink"}, "residual force is 'ou' or 'matern'"), ({"spring": "ou"}, "has a correlation time; give tau")],
)
def test_a_kind_is_one_of_two_and_belongs_to_a_correlation_time(kind, message):
    with pytest.raises(InputError, match=message):
        Weights(W={"mass": 1.0}, tau={"mass": 0.1}, kind=kind)


@pytest.mark.parametrize("table", ["W", "V", "tau"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_weights_are_positive_and_finite(table, value):
    with pytest.raises(InputError, match=rf"Weights\({table}={{'a': .*}}\): needs a positive, finite number\."):
        Weights(**{table: {"a": value}})


def test_weights_keep_their_own_copy():
    table = {"mass": 1.0}
    weights = Weights(W=table)
    table["mass"] = 5.0
    assert weights.W == {"mass": 1.0}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"parameters": {"mass.n": Free(1.0)}}, "parameters: oscillator has no parameter 'mass.n'; did you mean 'mass.m'?"),
        ({"weights": Weights(W={"mas": 1.0})}, "weights.W: oscillator has no place 'mas'; did you mean 'mass'?"),
        ({"weights": Weights(V={"y": 1.0})}, "weights.V: oscillator has no output or input 'y'; known: x, F"),
        ({"weights": Weights(tau={"mas": 1.0})}, "weights.tau: oscillator has no place 'mas'"),
        ({"weights": Weights(tau={"mass": 1.0})}, "weights: tau of mass stands without its W, the rms of a coloured residual force"),
        ({"weights": Weights(W={"kinematics:mass.v": 1.0})}, "has no place 'kinematics:mass.v'; did you mean 'kinematics:mass.s'?"),
        ({"bounds": {"mass.x": (0.0, 1.0)}}, "bounds: oscillator has no state 'mass.x'; did you mean 'mass."),
        ({"bounds": {"mass.s": (1.0, 1.0)}}, "bounds: mass.s = (1.0, 1.0): needs two numbers, the lower one first."),
        ({"bounds": {"mass.s": (0.0, 1.0)}, "initial": {"mass.s": Known(2.0, 0.1)}}, "its initial value 2 lies outside"),
        ({"initial": {"mass.x": 0.0}}, "initial: oscillator has no state 'mass.x'; did you mean 'mass."),
        ({"parameters": {"mass.m": -1.0}}, "parameters: mass.m = -1 lies outside its physical range 0 .. inf kg."),
        ({"parameters": {"mass.m": Free(0.0, min=-5.0, max=0.0)}}, "mass.m is free between -5 and 0, which leaves one value of its"),
        ({"parameters": {"mass.m": Free(-1.0)}}, "parameters: mass.m = -1 lies outside its physical range 0 .. inf kg."),
        ({"recordings": []}, 'Problem(recordings=...) needs at least one recording with role="fit".'),
        ({"recordings": [replace(RECORDING, role="held_out")]}, 'Problem(recordings=...) needs at least one recording with role="fit".'),
        ({"recordings": [replace(RECORDING, inputs={})]}, "run: input F of oscillator is not recorded; name its column under inputs."),
        ({"recordings": [replace(RECORDING, outputs={"z": np.arange(4.0)})]}, "run: outputs: oscillator has no output 'z'; known: x"),
        ({"recordings": [replace(RECORDING, outputs={})]}, "run: no output has a value; nothing can be estimated from it."),
    ],
)  # fmt: skip
def test_it_says_which_argument_is_wrong_and_what_would_be_right(changes, message):
    with pytest.raises(InputError) as caught:
        problem(**changes)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("bounds", "gain", "message"),
    [
        ((10.0, 20.0), 1.0, "carriage.s = (10, 20): all samples of output x of run, which shows it, lie below: 0 .. 3 m"),
        ((-20.0, -1.0), 1.0, "lie above: 0 .. 3 m"),
        ((0.0, 2.0), 0.01, None),  # the axis goes a hundred times as far as is read, and is within its bounds at first
        ((10.0, 20.0), 0.01, None),
        ((1.0, 2.0), 0.01, None),
        ((0.5, 0.9), 0.01, None),
        ((-9.0, -1.0), -1.0, None),
        ((10.0, 20.0), Free(1.0), None),  # nobody knows what is read
    ],
)
def test_bounds_within_which_no_sample_lies_that_reads_a_state_are_refused(bounds, gain, message):
    given = {"model": actuator(), "parameters": {"encoder.gain": gain}, "bounds": {"carriage.s": bounds}}
    if message is None:
        problem(**given)
        return
    with pytest.raises(InputError) as caught:
        problem(**given)
    assert message in str(caught.value)


@pytest.mark.parametrize(("low", "allowed"), [(1.0 + 4e-3, True), (1.0 + 6e-3, False)])
def test_a_machine_may_rest_on_its_bound_as_far_as_the_noise_of_its_sensor_goes(low, allowed):
    resting = replace(RECORDING, outputs={"x": np.full(4, 1.0)}, output_std={"x": 1e-3})
    given = {"recordings": [resting], "bounds": {"mass.s": (low, 2.0)}}
    if allowed:
        problem(**given)
    else:
        with pytest.raises(InputError, match="all samples of output x of run"):
            problem(**given)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_known_start_must_be_a_number(value):
    with pytest.raises(InputError, match="initial"):
        problem(initial={"mass.s": value})


def test_values_are_guesses_fixed_values_and_the_models_own():
    p = problem(parameters={"mass.m": Free(3.0), "spring.k": 9.0})
    names = [q.name for q in DAE.parameters]
    values = dict(zip(names, p.values, strict=True))
    assert (values["mass.m"], values["spring.k"], values["damper.d"]) == (3.0, 9.0, 1.5)
    assert [names[i] for i in p.free] == ["mass.m"]


def test_a_place_that_sleeps_is_woken_by_its_weight():
    model = actuator()
    recording = replace(RECORDING, inputs={"F": np.zeros(4)})
    asleep = Problem(model=model, recordings=[recording])
    awake = Problem(model=model, recordings=[recording], weights=Weights(W={"screw": 1e-6}))
    assert {p.name for p in asleep.dae.places} == {"carriage"}
    assert {p.name for p in awake.dae.places} == {"carriage", "screw"}


def test_recordings_held_out_are_not_fitted():
    p = problem(recordings=[RECORDING, replace(RECORDING, name="other", role="held_out")])
    assert [r.name for r in p.fitted] == ["run"]


# ---------------------------------------------------------------- what is supposed beyond the model


def test_a_problem_without_suppositions_is_solved_as_it_stands():
    p = problem(parameters={"mass.m": Free(3.0)}, weights=Weights(W={"mass": 1.0}), initial={"mass.s": Known(0.0, 0.1)})
    assert p.posed is p.plain is p.split is p
    assert p.start == {"mass.s": Known(0.0, 0.1)}
    assert p.known_exactly == {}


def test_a_coloured_force_starts_from_its_stationary_distribution_even_after_a_gap():
    posed = problem(weights=Weights(W={"mass": 2.0}, tau={"mass": 0.1}, kind={"mass": "matern"})).posed
    force, rate = posed.start["residual.mass"], posed.start["der(residual.mass)"]
    assert force == Known(0.0, 2.0, always=True)
    assert (rate.value, rate.std, rate.always) == (0.0, pytest.approx(2.0 * np.sqrt(3) / 0.1), True)
    assert posed.weights.W == {"mass": 2.0}
    assert posed.weights.tau == {}


@pytest.mark.parametrize("kind", ["ou", "matern"])
def test_the_white_force_to_start_with_has_the_coloured_ones_density_at_frequency_zero(kind):
    plain = problem(weights=Weights(W={"mass": 2.0}, tau={"mass": 0.1}, kind={"mass": kind})).plain
    lag = np.linspace(0.0, 5.0, 200_001)
    s = lag / 0.1 * (1.0 if kind == "ou" else np.sqrt(3))
    covariance = 4.0 * np.exp(-s) * (1.0 if kind == "ou" else 1 + s)
    assert plain.weights.W["mass"] ** 2 == pytest.approx(2 * np.trapezoid(covariance, lag), rel=1e-6)
    assert plain.weights.tau == {}
    assert plain.dae is DAE


def test_noise_of_an_input_is_white_with_the_impulse_of_a_held_value():
    quick = replace(RECORDING, time=0.01 * np.arange(4.0))
    posed = problem(recordings=[quick], weights=Weights(V={"F": 3.0, "x": 0.1})).posed
    assert posed.weights.W["input:F"] == pytest.approx(3.0 * np.sqrt(0.01))
    assert posed.weights.V == {"x": 0.1}


def test_guess_prior_and_bounds_of_what_drifts_are_those_of_a_state():
    free = {"mass.m": Free(3.0, max=5.0, std=0.5, drift=0.1), "spring.k": Free(30.0)}
    p = problem(parameters=free)
    assert p.posed.bounds == {"mass.m": (0.0, 5.0)}
    assert p.posed.start == {"mass.m": Known(3.0, 0.5)}
    assert p.posed.weights.W == {"parameter:mass.m": 0.1}
    assert [p.posed.dae.parameters[i].name for i in p.posed.free] == ["spring.k"]
    assert p.plain.parameters["mass.m"] == Free(3.0, max=5.0, std=0.5)


def test_every_recording_has_its_own_parameter_with_the_same_guess_and_prior():
    free = Free(3.0, std=0.5, per_recording=True)
    p = problem(recordings=[RECORDING, replace(RECORDING, name="other")], parameters={"mass.m": free})
    own = {name: value for name, value in p.posed.parameters.items() if isinstance(value, Free)}
    assert own == {"mass.m [run]": Free(3.0, std=0.5), "mass.m [other]": Free(3.0, std=0.5)}
    assert [(r.inputs["case:run"][0], r.inputs["case:other"][0]) for r in p.posed.fitted] == [(1.0, 0.0), (0.0, 1.0)]


def test_a_name_that_is_an_outputs_and_an_inputs_means_the_output():
    model = replace(oscillator(), outputs={"F": "sensor.s"})
    recording = replace(RECORDING, outputs={"F": np.arange(4.0)}, output_std={}, output_loss={})
    p = Problem(model=model, recordings=[recording], weights=Weights(V={"F": 0.1}))
    assert p.posed is p


KINDS = [
    ({"recordings": RECORDING}, r"recordings is a Recording; give a list, \[recording\]"),
    ({"recordings": ["run.csv"]}, "one of the recordings is a str, not a Recording"),
    ({"weights": {"W": {"mass": 1.0}}}, "weights is a dict, not a Weights"),
    ({"parameters": [Free(3.0)]}, "parameters is a list; give names and values"),
    ({"parameters": {"mass.m": {"guess": 3.0}}}, r"mass\.m = \{'guess': 3\.0\} is a dict; give a number, or Free\(guess\)"),
    ({"parameters": {"mass.m": "3"}}, r"mass\.m = '3' is a str"),
    ({"initial": {"mass.s": "rest"}}, r"initial: mass\.s = 'rest' is a str; give a number, or Known"),
    ({"bounds": {"mass.s": 3.0}}, r"bounds: mass\.s = 3\.0: needs two numbers"),
    ({"bounds": {"mass.s": (0.0, "far")}}, r"bounds: mass\.s = 'far' is a str"),
]


@pytest.mark.parametrize(("change", "said"), KINDS, ids=[f"{next(iter(c))} {k}" for k, (c, _) in enumerate(KINDS)])
def test_an_argument_of_another_kind_is_named_with_what_it_should_be(change, said):
    with pytest.raises(InputError, match=said):
        problem(**change)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Free("3"), "Free: guess = '3' is a str"),
        (lambda: Free(3.0, std="wide"), "Free: std = 'wide' is a str; give a number, or leave it out"),
        (lambda: Known(None), "Known: value = None is None"),
        (lambda: Weights(W={"mass": "1 N"}), "Weights: W of mass = '1 N' is a str"),
        (lambda: Weights(V=[1.0]), "Weights: V is a list; give names and numbers"),
        (lambda: Recording(name="run", time=np.arange(3.0), inputs={"F": ["on"] * 3}, outputs={}), "run: input F is no array of numbers"),
        (lambda: smooth(RECORDING), "the problem is a Recording, not a Problem"),
        (lambda: compare([RECORDING], []), "the problem is a list, not a Problem"),
        (lambda: compare(problem(), ["armax"]), "the method 'armax' is no function of a problem"),
    ],
)
def test_so_are_those_of_what_a_problem_is_made_of_and_goes_into(make, said):
    with pytest.raises(InputError, match=said):
        make()


def test_an_output_that_never_changes_says_nothing_of_its_noise():
    still = replace(RECORDING, outputs={"x": np.zeros(4)})
    with pytest.raises(InputError, match="run: output x is 0 in all its samples, which say nothing of its noise; give its std"):
        smooth(problem(recordings=[still]))


@pytest.mark.parametrize("number", [np.float32(2.0), np.int64(2), np.array(2.0), 2])
def test_numbers_of_numpy_and_pairs_and_series_are_as_good(number):
    one = problem(
        parameters={"mass.m": Free(number), "spring.k": number},
        weights=Weights(W=pd.Series({"mass": 1.0})),
        bounds={"mass.s": np.array([0.0, 9.0])},
        recordings={"a": RECORDING}.values(),
    )
    assert one.values[[p.name for p in one.dae.parameters].index("mass.m")] == 2.0
