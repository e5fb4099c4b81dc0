"""Stick and slip from voltage and current: the phases of an independent simulator, and the probabilities of a particle filter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import lfilter

from backsight.data import path
from backsight.data.generators import drillstring as rig
from backsight.data.generators.run import Conditions, disturbance
from backsight.estimation import Free, PhaseEstimator, Problem, Recording, Sample, Weights, follow_phases
from backsight.models import InputError
from backsight.models.plants import actuator, drillstring

STEP, TORQUE = 0.05, 2e-3
UNSURE = {"string.k": 0.0868, "bha.J": 0.0529, "bit.tau_sl": 0.4, "bit.tau_st": 0.6}


def drilled(seed: int, noise: float, rows: int = 400, mean: float = 15.0, skip: int = 0) -> tuple[Recording, np.ndarray]:
    """A recording at 20 Hz and whether the bit sticks, from modes solved by matrix exponentials, their ends found as roots."""
    rng, time = np.random.default_rng(seed), STEP * np.arange(rows)
    voltage = mean + lfilter([0.6], [1, -0.7], rng.normal(size=rows))
    conditions = Conditions(duration=rows * STEP, step=STEP, noise={"I_m": noise}, process={"bha": TORQUE})
    forces, states = disturbance(conditions, rig.PLACES, time, rng), np.zeros((rows, 4))
    plant, y, s = rig.Rig(rig.Drillstring()), np.zeros(4), 0
    for k in range(rows):
        states[k] = y
        for _ in range(10):
            y, s = plant.advance(y, s, float(voltage[k]), forces[k], STEP / 10)
    current = states[:, 0] + noise * rng.normal(size=rows)
    inputs, outputs = {"V": voltage[skip:]}, {"I_m": current[skip:]}
    recording = Recording(name="drill", time=time[: rows - skip], inputs=inputs, outputs=outputs, output_std={"I_m": noise})
    return recording, states[skip:, 3] == 0.0


def posed(recording: Recording, parameters: dict[str, Free | float] | None = None, **more: object) -> Problem:
    return Problem(model=drillstring(), recordings=[recording], parameters=parameters or {}, weights=Weights(W={"bha": TORQUE}), **more)


def off(told: np.ndarray, stuck: np.ndarray) -> list[int]:
    """Samples from every true change to the nearest one told."""
    true, found = (np.flatnonzero(np.diff(s.astype(int))) + 1 for s in (stuck, told))
    return [min((abs(int(q) - int(k)) for q in found if told[q] == stuck[k]), default=len(told)) for k in true]


@pytest.mark.slow
@pytest.mark.parametrize(("noise", "least"), [(1e-4, 0.975), (2e-3, 0.965)])
def test_the_phase_is_known_at_every_sample_and_changes_are_dated(noise: float, least: float) -> None:
    recording, stuck = drilled(1, noise)
    assert np.sum(np.diff(stuck.astype(int)) != 0) >= 4
    told = follow_phases(posed(recording))["drill"]["bit.stuck"].to_numpy() > 0.5
    assert np.mean(told == stuck) > least
    assert np.median(off(told, stuck)) <= 2


@pytest.mark.slow
def test_the_clock_may_count_from_1970() -> None:
    recording, _ = drilled(2, 2e-3, rows=200)
    late = replace(recording, time=recording.time + 1.7e9)
    told, then = (follow_phases(posed(r))["drill"] for r in (recording, late))
    assert np.mean((told["bit.stuck"] > 0.5) == (then["bit.stuck"] > 0.5)) > 0.98
    since = then["bit.since"].to_numpy()
    assert np.all(np.isinf(since) | (since >= 1.7e9))


@pytest.mark.slow
def test_string_and_bit_need_not_be_known() -> None:
    """15 % off each, with a prior as wide: the phases come out, and the parameters come home."""
    recording, stuck = drilled(2, 1e-3, rows=600)
    signs = dict(zip(UNSURE, (1, -1, -1, 1), strict=True))
    guesses = {name: Free(v * (1 + 0.15 * signs[name]), std=0.15 * v) for name, v in UNSURE.items()}
    table = follow_phases(posed(recording, guesses))["drill"]
    told = table["bit.stuck"].to_numpy() > 0.5
    assert np.mean(told == stuck) > 0.95
    assert np.median(off(told, stuck)) <= 2
    for name, value in UNSURE.items():
        assert table[name].iloc[-1] == pytest.approx(value, rel=0.06), name


def test_a_bit_that_never_stops_is_not_said_to() -> None:
    recording, stuck = drilled(3, 1e-3, rows=700, mean=110.0, skip=400)
    assert not stuck.any()
    table = follow_phases(posed(recording))["drill"]
    assert np.mean(table["bit.stuck"] > 0.5) < 0.02
    assert table["bit.forwards"].iloc[-1] > 0.99


@pytest.mark.slow
def test_an_axis_is_held_by_the_force_that_steps_and_its_friction_comes_home() -> None:
    """The bundled axis (20 N, offset -3 N) at 1 kHz: its force holds it or not from a sample on; the guess of 25 N is as good as none."""
    columns = {"time": "t_s", "inputs": {"F": "F_N"}, "outputs": {"x": "x_m"}, "std": {"x": 1e-6}}
    recording = Recording.read(path("axis_fit.csv.gz"), range=(0.0, 1.4), **columns)
    parameters = {"carriage.m": 95.0, "friction.d": 200.0, "friction.f_c": Free(25), "offset.f": Free(0, std=5)}
    problem = Problem(model=actuator(), recordings=[recording], parameters=parameters, weights=Weights(W={"carriage": 0.0126}))
    table = follow_phases(problem)["axis_fit.csv.gz"]
    for name, value in (("friction.f_c", 20.0), ("offset.f", -3.0)):
        assert table[name].iloc[-1] == pytest.approx(value, abs=0.1)
    told = np.sign(table["friction.forwards"] - table["friction.backwards"]).to_numpy()
    turns = recording.time[1:][np.diff(told) != 0]
    moving = np.gradient(recording.outputs["x"], recording.time)
    assert np.mean(told[50:-50] == np.sign(np.convolve(moving, np.ones(9) / 9, "same"))[50:-50]) > 0.99
    assert np.sum(turns > 0.05) <= 4


@pytest.mark.slow
def test_probabilities_are_those_of_a_particle_filter() -> None:
    """4000 particles with the simulator's modes, each with a torque of its own in every sample; a start that is known."""
    noise, count, rng = 5e-3, 4000, np.random.default_rng(5)
    recording, _ = drilled(4, noise, rows=360)
    start = dict.fromkeys(rig.STATES, 0.0)
    ours = follow_phases(posed(recording, initial=start))["drill"]["bit.stuck"].to_numpy()
    string, fine, substep = rig.Drillstring(), 10, STEP / 10
    maps = [expm(substep * np.block([[a, np.eye(4)], [np.zeros((4, 8))]]))[:4] for a in (string.sticking, string.sliding)]
    x, way, theirs = np.zeros((count, 4)), np.zeros(count, dtype=int), []
    for v, y in zip(recording.inputs["V"], recording.outputs["I_m"], strict=True):
        weights = np.exp(-0.5 * ((y - x[:, 0]) / noise) ** 2) + 1e-300
        theirs.append(float(np.sum(weights[way == 0]) / weights.sum()))
        kept = np.searchsorted(np.cumsum(weights) / weights.sum(), (np.arange(count) + rng.random()) / count)
        x, way = x[np.minimum(kept, count - 1)], way[np.minimum(kept, count - 1)]
        torque = TORQUE / np.sqrt(STEP) * rng.standard_normal(count)
        for _ in range(fine):
            pull = string.k * x[:, 2] + torque
            way = np.where((way == 0) & (np.abs(pull) > string.tau_st), np.sign(pull).astype(int), way)
            slides = way != 0
            drive = np.zeros((count, 4))
            drive[:, 0], drive[:, 3] = v / string.L, np.where(slides, (torque - string.tau_sl * way) / string.J_b, 0.0)
            both = np.hstack([x, drive])
            x = np.where(slides[:, None], both @ maps[1].T, both @ maps[0].T)
            stops = slides & (x[:, 3] * way <= 0)
            x[stops, 3], way = 0.0, np.where(stops, 0, way)
    apart = np.abs(ours - np.array(theirs))
    assert np.mean(apart[20:]) < 0.03
    assert np.mean((ours > 0.5) == (np.array(theirs) > 0.5)) > 0.97


@pytest.mark.slow
def test_with_a_lag_the_phase_is_surer_and_a_change_has_its_time() -> None:
    recording, stuck = drilled(6, 1e-3)
    estimator, time = PhaseEstimator(posed(recording)), recording.time.tolist()
    now, later = [], []
    for k, t in enumerate(time):
        sample = Sample(time=t, inputs={"V": recording.inputs["V"][k]}, outputs={"I_m": recording.outputs["I_m"][k]})
        now.append(estimator.update(sample).phases["bit"].sticks)
        if k >= 5:
            later.append(estimator.at("bit", time[k - 5]).sticks)
    assert np.mean(np.array(later) == stuck[:-5]) > max(0.98, np.mean(np.array(now[:-5]) == stuck[:-5]))
    last = int(np.flatnonzero(np.diff(stuck.astype(int)))[-1])
    assert estimator.at("bit", time[min(last + 4, len(time) - 1)]).since == pytest.approx(time[last], abs=0.1)
    with pytest.raises(InputError, match="has the laws bit"):
        estimator.at("string", 1.0)


@pytest.mark.slow
def test_missing_samples_late_ones_and_gaps() -> None:
    recording, stuck = drilled(7, 1e-3)
    estimator = PhaseEstimator(posed(recording, {"string.k": Free(0.08, std=0.01)}))
    told, before = [], None
    for k, t in enumerate(recording.time.tolist()):
        read = {} if k % 7 == 3 else {"I_m": float(recording.outputs["I_m"][k])}
        before = estimator.update(Sample(time=t, inputs={"V": float(recording.inputs["V"][k])}, outputs=read))
        told.append(before.phases["bit"].sticks)
    assert np.mean(np.array(told) == stuck) > 0.95
    assert estimator.update(Sample(time=t - 0.02, outputs={"I_m": 0.3})) is before
    assert before is not None
    learnt = before.std("string.k")
    after = estimator.update(Sample(time=t + 60.0, inputs={"V": 15.0}, outputs={"I_m": 0.3}))
    assert after.std("string.k") == pytest.approx(learnt, rel=1e-6)
    assert after.std("string.dphi") > 1.0
    assert after.phases["bit"].stuck == pytest.approx(1 / 3, abs=0.01)


def test_what_makes_no_sense_is_refused() -> None:
    recording, _ = drilled(8, 1e-3, rows=30)
    with pytest.raises(InputError, match="needs 2 at least"):
        PhaseEstimator(posed(recording), hypotheses=1)
    with pytest.raises(InputError, match=r"needs weights\.W"):
        PhaseEstimator(Problem(model=drillstring(), recordings=[recording]))
    estimator = PhaseEstimator(posed(recording))
    with pytest.raises(InputError, match="no input 'F'"):
        estimator.update(Sample(time=0.0, inputs={"F": 1.0}))
    with pytest.raises(InputError, match="finite time"):
        estimator.update(Sample(time=np.nan))
    without = posed(recording, {"bit.tau_sl": 0.0, "bit.tau_st": 0.0})
    with pytest.raises(InputError, match="no friction law that sticks"):
        PhaseEstimator(without)
