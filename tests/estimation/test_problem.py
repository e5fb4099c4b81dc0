"""What a problem accepts and how it refuses the rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from examples import oscillator

from backsight.estimation import Free, Problem, Recording, Weights
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
        ({"weights": Weights(V={"y": 1.0})}, "weights.V: oscillator has no output 'y'; known: x"),
        ({"weights": Weights(tau={"mas": 1.0})}, "weights.tau: oscillator has no place 'mas'"),
        ({"weights": Weights(tau={"mass": 1.0})}, "weights: tau of mass: this version knows white residual forces only; leave tau out."),
        ({"initial": {"mass.x": 0.0}}, "initial: oscillator has no state 'mass.x'; did you mean 'mass."),
        ({"parameters": {"mass.m": -1.0}}, "parameters: mass.m = -1 lies outside its physical range 0 .. inf kg."),
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
