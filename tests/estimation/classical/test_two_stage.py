"""The two-stage method in a closed loop where the direct one is biased; the loop is a hand-written difference equation."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from backsight.estimation import Free, Problem, Recording
from backsight.estimation.classical import prediction_error, two_stage, zoh_prediction_error
from backsight.models import Dae, Model, compile_model
from backsight.models.errors import InputError
from backsight.models.mechanics.translational import Damper, Fixed, Force, Mass, VelocitySensor

M, D, GAIN, STEP = 2.0, 1.5, 8.0, 0.05
FREE = {"mass.m": Free(1.5), "damper.d": Free(1.0)}
OUTPUT_ERROR = partial(zoh_prediction_error, noise="none", point={"mass.v": 0.1, "F": 0.0})


def plant() -> Dae:
    return compile_model(
        Model(
            name="cart",
            components={"motor": Force(), "mass": Mass(m=M), "damper": Damper(d=D), "ground": Fixed(), "speed": VelocitySensor()},
            connections=[
                ("motor.flange", "mass.flange"),
                ("damper.flange_a", "mass.flange"),
                ("damper.flange_b", "ground.flange"),
                ("speed.flange", "mass.flange"),
            ],
            inputs={"F": "motor.f"},
            outputs={"v": "speed.v"},
        )
    )


CART = plant()


def looped(seed: int, n: int = 4000) -> Recording:
    """v(k+1) = a v(k) + (1 - a)/d F(k), F = GAIN (r - y), y = v + n, n(k) = 0.9 n(k-1) + e(k): noise comes back through the force."""
    rng, a = np.random.default_rng(seed), np.exp(-D / M * STEP)
    r = np.repeat(rng.normal(size=n // 4 + 1), 4)[:n]
    v, noise, F, y = 0.0, 0.0, np.zeros(n), np.zeros(n)
    for k in range(n):
        noise = 0.9 * noise + 0.15 * rng.normal()
        y[k] = v + noise
        F[k] = GAIN * (r[k] - y[k])
        v = a * v + (1 - a) / D * F[k]
    return Recording(name="loop", time=STEP * np.arange(n), inputs={"F": F, "r": r}, outputs={"v": y})


@pytest.mark.slow
def test_it_is_unbiased_where_the_direct_method_is_not():
    """5 loops: the mean of the two-stage estimates within 5 of its deviations (and 6 %); the direct mass is wrong by over 10 %."""
    found, direct = [], []
    for seed in range(5):
        problem = Problem(model=CART, recordings=[looped(seed)], parameters=FREE)
        unbiased = two_stage(problem, references=["r"], order=30, second=OUTPUT_ERROR)
        found.append([unbiased.parameters[name].value for name in FREE])
        direct.append([OUTPUT_ERROR(problem).parameters[name].value for name in FREE])
    mean, scatter = np.mean(found, axis=0), np.std(found, axis=0, ddof=1) / np.sqrt(len(found))
    assert np.all(np.abs(mean - [M, D]) < 5 * scatter)
    assert mean == pytest.approx([M, D], rel=0.06)
    assert np.abs(np.mean(direct, axis=0)[0] / M - 1) > 0.1


@pytest.mark.slow
@pytest.mark.long
def test_by_simulation_its_deviations_hold_for_coloured_noise():
    """The second stage by itself: prediction_error, whose deviations know of the colour; 2 loops of 2 parameters, none beyond 4.5."""
    scores = []
    for seed in range(2):
        found = two_stage(Problem(model=CART, recordings=[looped(seed)], parameters=FREE), references=["r"], order=25)
        assert found.method == "two_stage, prediction_error"
        scores.append([(found.parameters[n].value - t) / found.parameters[n].std for n, t in (("mass.m", M), ("damper.d", D))])
    assert np.max(np.abs(scores)) < 4.5


def test_a_short_autoregression_stands_for_a_long_impulse_response():
    problem = Problem(model=CART, recordings=[looped(7)], parameters=FREE)
    fir, arx = (two_stage(problem, references=["r"], order=o, first=f, second=OUTPUT_ERROR) for o, f in ((60, "fir"), (8, "arx")))
    assert arx.parameters["mass.m"].value == pytest.approx(fir.parameters["mass.m"].value, rel=0.1)
    assert "First stage (fir, 60 coefficients)" in fir.notes[0]


@pytest.mark.slow
def test_without_noise_it_is_the_direct_method():
    rng, n = np.random.default_rng(1), 700
    a, F = np.exp(-D / M * STEP), np.repeat(rng.normal(size=n // 5), 5)
    v = np.zeros(n)
    for k in range(n - 1):
        v[k + 1] = a * v[k] + (1 - a) / D * F[k]
    run = Recording(name="open", time=STEP * np.arange(n), inputs={"F": F, "r": F}, outputs={"v": v})
    problem = Problem(model=CART, recordings=[run], parameters=FREE)
    assert two_stage(problem, references=["r"], order=20).parameters["mass.m"].value == pytest.approx(M, rel=1e-4)
    assert prediction_error(problem).parameters["mass.m"].value == pytest.approx(M, rel=1e-4)


def without(run: Recording, gone: np.ndarray) -> Recording:
    inputs, outputs = ({name: values[~gone] for name, values in of.items()} for of in (run.inputs, run.outputs))
    return Recording(name=run.name, time=run.time[~gone], inputs=inputs, outputs=outputs)


def test_pieces_between_gaps_have_first_stages_of_their_own():
    """A short one is left out; both long ones count in the fit, and the estimates are those of all the rows to what the lost ones tell."""
    run, k = looped(3), np.arange(4000)
    cut = without(run, (k >= 1500) & (k < 1600) | (k >= 1660) & (k < 1800))
    found, whole = (
        two_stage(Problem(model=CART, recordings=[r], parameters=FREE), references=["r"], order=20, second=OUTPUT_ERROR) for r in (cut, run)
    )
    assert found.fit["loop"]["v"].samples == 1500 + 2200 - 2 * 20
    assert "F of loop from t = 90 s" in found.notes[0]
    assert found.notes[1] == "Too short for a first stage, and left out: loop from t = 80 s."
    for name in FREE:
        assert found.parameters[name].value == pytest.approx(whole.parameters[name].value, rel=0.06)


def test_where_every_piece_is_too_short_the_message_says_between_what():
    run, k = looped(3, 600), np.arange(600)
    with pytest.raises(InputError, match="loop: 200 samples of the inputs between gaps are too few for a first stage of 30 coefficients"):
        two_stage(Problem(model=CART, recordings=[without(run, (k >= 200) & (k < 400))], parameters=FREE), references=["r"], order=30)


def test_what_is_known_of_the_start_is_not_imposed_where_the_second_stage_begins():
    """The cart starts from rest, and moves by the time that the first stage has its whole past."""
    run = looped(5, 1000)
    known, unknown = (
        two_stage(Problem(model=CART, recordings=[run], parameters=FREE, initial=initial), references=["r"], order=20, second=OUTPUT_ERROR)
        for initial in ({"mass.v": 0.0}, {})
    )
    assert known.fit["loop"]["v"].rms == pytest.approx(unknown.fit["loop"]["v"].rms, rel=1e-6)
    for name in FREE:
        assert known.parameters[name].value == pytest.approx(unknown.parameters[name].value, rel=1e-6)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"references": []}, "at least one recorded reference"),
        ({"references": ["q"]}, "no reference 'q'"),
        ({"references": ["F"]}, "no reference 'F'"),
        ({"references": ["r"], "order": 900}, "too few for a first stage of 900 coefficients"),
        ({"references": ["r"], "first": "ar"}, '"fir" or "arx"'),
    ],
)
def test_a_first_stage_that_cannot_be_is_refused(how, message):
    with pytest.raises(InputError, match=message):
        two_stage(Problem(model=CART, recordings=[looped(9, 600)], parameters=FREE), **how)
