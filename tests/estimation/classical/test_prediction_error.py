"""Output error by simulation, on motions from matrix exponentials and on a hand-written stick-slip."""

from __future__ import annotations

import numpy as np
import pytest
import truths
from examples import OFFSET, D, K, M, compiled, oscillator

from backsight.estimation import Free, Problem, Recording
from backsight.estimation.classical import prediction_error
from backsight.models.errors import InputError
from backsight.models.plants import actuator

OSCILLATOR = compiled(oscillator())
TRUE = {"mass.m": M, "spring.k": K, "damper.d": D, "offset.f": OFFSET}
FREE = {"mass.m": Free(2.6), "spring.k": Free(65.0), "damper.d": Free(1.0), "offset.f": Free(0.0)}


def recorded(seed: int, *, n: int = 500, noise: float = 5e-3, force_std: float = 0.0, uneven: bool = False) -> Recording:
    rng = np.random.default_rng(seed)
    time = np.cumsum(0.02 * (rng.uniform(0.6, 1.4, n) if uneven else np.ones(n)))
    u = 20 * np.repeat(rng.normal(size=n // 5), 5)
    x = truths.disturbed(truths.Plant(m=M, d=D, k=K, offset=OFFSET), time, u, np.array([0.02, -0.1]), force_std, rng)
    return Recording(name="run", time=time, inputs={"F": u}, outputs={"x": x[:, 0] + noise * rng.normal(size=n)})


@pytest.mark.slow
def test_estimates_scatter_as_their_deviations_say():
    """6 repetitions of 4 parameters with white noise: rms of the 24 scores within 0.55 .. 1.6 (chance of failing below 1e-3)."""
    scores = []
    for seed in range(6):
        p = prediction_error(Problem(model=OSCILLATOR, recordings=[recorded(seed)], parameters=FREE)).parameters
        scores.append([(p[name].value - true) / p[name].std for name, true in TRUE.items()])
    assert 0.55 < np.sqrt(np.mean(np.square(scores))) < 1.6


def test_uneven_steps_and_missing_samples_are_taken_as_they_are():
    run = recorded(1, uneven=True, noise=0.0)
    y = np.where(np.random.default_rng(2).uniform(size=500) < 0.4, np.nan, run.outputs["x"])
    thin = Recording(name="thin", time=run.time, inputs=run.inputs, outputs={"x": y})
    found = prediction_error(Problem(model=OSCILLATOR, recordings=[thin], parameters=FREE))
    assert [found.parameters[name].value for name in TRUE] == pytest.approx(list(TRUE.values()), rel=1e-4)
    assert found.fit["thin"]["x"].rms < 1e-6


@pytest.mark.slow
def test_segments_take_up_what_drives_the_plant_unseen():
    """Under a random force a whole simulation strays; from several starts it does not, and the parameters are nearer."""
    problem = Problem(model=OSCILLATOR, recordings=[recorded(3, force_std=1.0, noise=1e-3)], parameters=FREE)
    whole, short = prediction_error(problem), prediction_error(problem, segment=1.0)
    assert short.fit["run"]["x"].rms < 0.6 * whole.fit["run"]["x"].rms
    assert "10 starts" in short.notes[0]
    assert short.parameters["spring.k"].value == pytest.approx(K, rel=0.1)


@pytest.mark.slow
def test_a_known_start_is_kept_and_several_recordings_share_the_parameters():
    runs = [recorded(seed) for seed in (4, 5)]
    named = [Recording(name=n, time=r.time, inputs=r.inputs, outputs=r.outputs) for n, r in zip("ab", runs, strict=True)]
    free = {"mass.m": Free(2.4), "spring.k": K, "damper.d": D, "offset.f": OFFSET}
    problem = Problem(model=OSCILLATOR, recordings=named, parameters=free, initial={"mass.s": 0.02, "mass.v": -0.1})
    found = prediction_error(problem)
    assert set(found.fit) == {"a", "b"}
    assert abs(found.parameters["mass.m"].value - M) < 4 * found.parameters["mass.m"].std
    assert found.parameters["mass.m"].std < 2e-3


@pytest.mark.slow
def test_a_gap_begins_a_new_segment_and_what_is_known_of_the_start_is_not_known_there():
    """Another force acts in the gap; both pieces count in the fit, and the motion before and after has its own exact solution."""
    plant, n = truths.Plant(m=M, d=D, k=K, offset=OFFSET), 500
    rng = np.random.default_rng(12)
    time, u = 0.02 * np.arange(n), 20 * np.repeat(rng.normal(size=n // 5), 5)
    gone = (np.arange(n) > 200) & (np.arange(n) < 260)
    x = truths.motion(plant, time, np.where(gone, 50.0, u), np.array([0.02, -0.1]))[:, 0] + 1e-4 * rng.normal(size=n)
    run = Recording(name="run", time=time[~gone], inputs={"F": u[~gone]}, outputs={"x": x[~gone]})
    start = {"mass.s": 0.02, "mass.v": -0.1}
    found = prediction_error(Problem(model=OSCILLATOR, recordings=[run], parameters=FREE, initial=start))
    for name, true in TRUE.items():
        assert abs(found.parameters[name].value - true) < 4 * found.parameters[name].std < 0.02
    assert found.fit["run"]["x"].samples == n - gone.sum()
    assert found.fit["run"]["x"].rms == pytest.approx(1e-4, rel=0.1)


def test_a_recording_of_a_few_rows_is_refused():
    few = recorded(1, n=10)
    short = Recording(name="few", time=few.time[:8], inputs={"F": few.inputs["F"][:8]}, outputs={"x": few.outputs["x"][:8]})
    with pytest.raises(InputError, match="few: prediction_error needs 10 rows and there are 8"):
        prediction_error(Problem(model=OSCILLATOR, recordings=[short], parameters=FREE))


@pytest.mark.slow
def test_friction_that_sticks_is_found_from_a_motion_that_sticks():
    """m v' = F - f_c sgn(v), every step solved in closed form until it stops: true rest, no rounding."""
    rng, n, h, mass, f_c = np.random.default_rng(6), 600, 0.01, 95.0, 20.0
    u, s, v, x = 60 * np.sin(4 * h * np.arange(n)), 0.0, 0.0, np.zeros(n)
    for k in range(n):
        x[k] = s
        left = h
        while left > 0:
            if v == 0.0 and abs(u[k]) <= f_c:
                break
            a = (u[k] - f_c * np.sign(v if v else u[k])) / mass
            stop = -v / a if v * a < 0 else np.inf
            span = min(left, stop)
            s, v, left = s + v * span + a * span**2 / 2, 0.0 if stop <= left else v + a * span, left - span
    y = x + 1e-5 * rng.normal(size=n)
    run = Recording(name="run", time=h * np.arange(n), inputs={"F": u}, outputs={"x": y})
    given = {"carriage.m": Free(80.0), "friction.f_c": Free(15.0), "friction.d": 0.0, "offset.f": 0.0}
    p = prediction_error(Problem(model=actuator(), recordings=[run], parameters=given)).parameters
    assert p["carriage.m"].value == pytest.approx(mass, abs=max(5 * p["carriage.m"].std, 0.05))
    assert p["friction.f_c"].value == pytest.approx(f_c, abs=max(5 * p["friction.f_c"].std, 0.02))


@pytest.mark.slow
def test_a_bound_that_holds_has_no_deviation_and_is_named():
    free = {**FREE, "damper.d": Free(2.0, min=1.8)}
    found = prediction_error(Problem(model=OSCILLATOR, recordings=[recorded(7, noise=1e-4)], parameters=free))
    assert found.parameters["damper.d"].value == pytest.approx(1.8, abs=1e-3)
    assert found.parameters["damper.d"].std is None
    assert "damper.d ends on its bound." in found.notes


@pytest.mark.slow
def test_a_prior_is_one_more_measurement():
    tight = {**FREE, "mass.m": Free(2.2, std=1e-5)}
    found = prediction_error(Problem(model=OSCILLATOR, recordings=[recorded(8)], parameters=tight)).parameters["mass.m"]
    assert found.value == pytest.approx(2.2, abs=1e-3)
    assert found.std < 2e-5


@pytest.mark.parametrize(("segment", "message"), [(-1.0, "positive time"), (0.05, "samples of run to each start")])
def test_segments_need_samples(segment, message):
    with pytest.raises(InputError, match=message):
        prediction_error(Problem(model=OSCILLATOR, recordings=[recorded(9)], parameters=FREE), segment=segment)
