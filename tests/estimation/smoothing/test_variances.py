"""Weights chosen from the data, on linear plants whose true deviations are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import truths
from examples import OFFSET, D, K, M, compiled, on_mass, oscillator, shaken
from scipy.optimize import minimize_scalar

from backsight.estimation import Free, Problem, Recording, Smoothing, Weights, smooth
from backsight.estimation.recordings.noise import noise
from backsight.estimation.smoothing import work
from backsight.estimation.smoothing.program import Settings
from backsight.models import Dae
from backsight.models.mechanics.translational import Force, Spring

PLANT, MODEL = truths.Plant(m=M, d=D, k=K, offset=OFFSET), compiled(oscillator())
STD = 1e-3


def fitted(
    seed: int, force_std: float, open_weights: str, n: int = 400, model: Dae = MODEL, loss: str = "square", outliers: int = 0
) -> Smoothing:
    """A record of 4 s; open_weights: "W", "V" or "WV" are left to the data. outliers: samples that are 50 of their deviations off."""
    rng = np.random.default_rng(seed)
    time, u = 0.01 * np.arange(n), 20 * np.sign(np.sin(np.arange(n) * 0.0483 + seed)) + 10 * np.repeat(rng.normal(size=n // 10 + 1), 10)[:n]
    y = truths.disturbed(PLANT, time, u, np.array([0.02, -0.1]), force_std, rng)[:, 0] + STD * rng.normal(size=n)
    y[rng.choice(n, outliers, replace=False)] += 50.0 * STD
    recording = Recording(
        name="run",
        time=time,
        inputs={"F": u},
        outputs={"x": y},
        output_std={} if "V" in open_weights else {"x": STD},
        output_loss={"x": loss},
    )
    weights = Weights(W={} if "W" in open_weights else {"mass": force_std})
    free = {"mass.m": Free(3.0), "spring.k": Free(30.0), "damper.d": Free(1.0), "offset.f": Free(0.0)}
    return smooth(Problem(model=model, recordings=[recording], parameters=free, weights=weights))


@pytest.mark.slow
@pytest.mark.parametrize("open_weights", ["W", "V", "WV"])
def test_the_chosen_deviations_are_the_true_ones_within_their_sampling_error(open_weights):
    """400 samples tell their own noise to 1/sqrt(800) = 3.5 %, and a force that moves the plant as far as the noise to about 8 %."""
    found = []
    for seed in range(6):
        s = fitted(seed, 0.3, open_weights)
        assert s.solver.converged
        assert "had not settled" not in " ".join(s.notes)
        found.append([s.weights.W["mass"] / 0.3, s.weights.V["x"] / STD])
    ratio = np.array(found)
    assert np.all(np.abs(ratio[:, 0] - 1) < 0.3), ratio[:, 0]
    assert np.all(np.abs(ratio[:, 1] - 1) < 0.15), ratio[:, 1]
    # the mean of six: the joint mode and the tolerance of the iteration are allowed a tenth
    assert np.all(np.abs(ratio.mean(axis=0) - 1) < [0.1, 0.06]), ratio.mean(axis=0)


def test_outliers_do_not_pass_for_noise_where_losses_are_no_squares():
    """5 % of the samples: the density of a loss has its best weights elsewhere, and they are not gone back to."""
    found = [fitted(seed, 3.0, "WV", loss="huber", outliers=20).weights for seed in range(2)]
    assert max(w.V["x"] for w in found) < 1.4 * STD
    assert min(w.W["mass"] for w in found) > 0.6 * 3.0


def most_likely(y: np.ndarray, step: float) -> float:
    """The standard deviation of the force at which y (n,), less what any start and any constant explain, is most probable: dense REML.

    y = free motion + sum of what the force of every step leaves behind + noise, all parameters known.
    """
    A, B, G = PLANT.matrices
    phi, gamma = truths.discrete(A, B, step)
    n, powers = len(y), [np.eye(2)]
    for _ in range(n):
        powers.append(phi @ powers[-1])
    response = np.array([p[0] for p in powers])  # of the position to a state k steps ago
    Q = truths.noise_covariance(A, G, 1.0, step)
    left = [np.concatenate([np.zeros((k + 1, 2)), response[: n - k - 1]]) for k in range(n - 1)]
    covariance = sum(r @ Q @ r.T for r in left)
    known = np.cumsum(np.concatenate([[0.0], (response[: n - 1] @ gamma)[:, 1]]))
    kept = np.linalg.qr(response[:n], mode="complete")[0][:, 2:]
    values, vectors = np.linalg.eigh(kept.T @ covariance @ kept)
    z = vectors.T @ kept.T @ (y - known)

    def unlikely(log_std: float) -> float:
        variance = np.exp(2 * log_std) * values + STD**2
        return float(np.sum(z**2 / variance + np.log(variance)))

    return float(np.exp(minimize_scalar(unlikely, bounds=(np.log(1e-4), np.log(1.0)), method="bounded").x))


@pytest.mark.parametrize("seed", [0, 2, 3, 4])  # with seed 1 no force at all is most likely
def test_a_force_of_which_the_record_tells_little_gets_the_weight_that_is_most_likely(seed):
    """Five or ten of eight hundred rows are told at all: a rule that counts more of them would end at no force."""
    rng, n = np.random.default_rng(seed), 400
    time = 0.01 * np.arange(n)
    y = truths.disturbed(PLANT, time, np.zeros(n), np.array([0.02, -0.1]), 0.008, rng)[:, 0] + STD * rng.normal(size=n)
    recording = Recording(name="run", time=time, inputs={"F": np.zeros(n)}, outputs={"x": y}, output_std={"x": STD})
    found = smooth(Problem(model=MODEL, recordings=[recording], parameters={"offset.f": OFFSET}), settings=Settings(step=0.01))
    best = most_likely(y, 0.01)
    assert best > 2e-3
    assert found.weights.W["mass"] == pytest.approx(best, rel=0.15)


@pytest.mark.slow
def test_beside_an_accelerometer_the_force_that_it_reads_gets_its_own_deviation():
    """A force held from row to row, 0.2 m/s2 in a reading whose noise is 0.1: told by the position and by the accelerometer."""
    found, force_std, step, n, plant = [], 0.2 * M * np.sqrt(0.01), 0.01, 400, compiled(shaken())
    for seed in range(4):
        rng = np.random.default_rng(seed)
        time, u = step * np.arange(n), 20 * np.sign(np.sin(np.arange(n) * 0.0483 + seed))
        force = u + force_std / np.sqrt(step) * rng.normal(size=n)
        x = truths.disturbed(PLANT, time, force, np.zeros(2), 0.0, rng)
        A, B, _ = PLANT.matrices
        a = (x @ A.T + np.column_stack([force, np.ones(n)]) @ B.T)[:, 1]
        y = {"x": x[:, 0] + STD * rng.normal(size=n), "a": a + 0.1 * rng.normal(size=n)}
        recording = Recording(name="run", time=time, inputs={"F": u}, outputs=y, output_std={"x": STD, "a": 0.1})
        free = {"mass.m": Free(3.0), "spring.k": Free(30.0), "damper.d": Free(1.0), "offset.f": Free(0.0)}
        found.append(smooth(Problem(model=plant, recordings=[recording], parameters=free)).weights.W["mass"] / force_std)
    assert np.all(np.abs(np.array(found) - 1) < 0.2), found


def test_a_force_is_as_strong_on_a_fine_mesh_as_on_a_coarse_one():
    """It is slow: the data tell some 35 numbers about it, of 400 rows or of 3 200."""
    rng = np.random.default_rng(1)
    time, u = 0.01 * np.arange(400), 20 * np.sign(np.sin(np.arange(400) * 0.0483 + 1))
    y = truths.disturbed(PLANT, time, u, np.array([0.02, -0.1]), 0.1, rng)[:, 0] + STD * rng.normal(size=400)
    recording = Recording(name="run", time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": STD})
    known = {"mass.m": M, "spring.k": K, "damper.d": D, "offset.f": OFFSET}
    problem = Problem(model=MODEL, recordings=[recording], parameters=known)
    coarse, fine = (smooth(problem, settings=Settings(step=step)).weights.W["mass"] for step in (0.02, 0.0025))
    assert fine == pytest.approx(coarse, rel=0.05)
    assert coarse == pytest.approx(0.1, rel=0.3)


def test_weights_that_are_given_are_left_alone():
    s = fitted(0, 0.3, "")
    assert s.weights.W == {"mass": 0.3}
    assert s.weights.V == {"x": STD}
    assert "W of mass: std 0.3 N.sqrt(s) as given." in s.notes
    assert "V of x: std 0.001 m as given." in s.notes


@pytest.mark.parametrize("open_weights", ["W", "WV"])
def test_a_force_that_is_not_there_ends_with_a_small_weight_and_the_right_parameters(open_weights):
    for seed in range(3):
        s = fitted(seed, 0.0, open_weights)
        assert s.solver.converged
        assert s.weights.W["mass"] < 0.01  # a force of that density moves the plant by much less than the noise
        assert s.weights.V["x"] == pytest.approx(STD, rel=0.15)
        for name, true in (("mass.m", M), ("spring.k", K), ("damper.d", D), ("offset.f", OFFSET)):
            p = s.parameters[name]
            assert p.std is not None
            assert abs(p.value - true) < 3.5 * p.std


def test_a_weight_open_for_two_recordings_does_not_touch_the_deviation_that_one_of_them_gave():
    def recording(name: str, seed: int, std: float, *, given: bool) -> Recording:
        rng, n = np.random.default_rng(seed), 300
        time, u = 0.01 * np.arange(n), 20 * np.sign(np.sin(np.arange(n) * 0.0483 + seed))
        y = truths.disturbed(PLANT, time, u, np.zeros(2), 0.1, rng)[:, 0] + STD * rng.normal(size=n)
        return Recording(name=name, time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": std} if given else {})

    # what the first recording says of its sensor is wrong on purpose: given is given
    problem = Problem(
        model=MODEL,
        recordings=[recording("a", 1, 3 * STD, given=True), recording("b", 2, STD, given=False)],
        parameters={"mass.m": Free(3.0)},
        weights=Weights(W={"mass": 0.1}),
    )
    assert smooth(problem).weights.V["x [a]"] == pytest.approx(3 * STD, rel=1e-12)


def test_what_one_recording_leaves_open_is_found_beside_another_that_gives_it():
    """Seen through the model: in a signal that jumps from sample to sample the differences would call the motion noise."""
    rng, n = np.random.default_rng(3), 300
    time, u = 0.02 * np.arange(n), 200 * np.repeat(rng.normal(size=n // 3 + 1), 3)[:n]
    y = truths.disturbed(PLANT, time, u, np.zeros(2), 0.1, rng)[:, 0] + STD * rng.normal(size=n)
    given = Recording(name="a", time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": 3 * STD})
    wide = truths.disturbed(PLANT, time, -u, np.zeros(2), 0.1, rng)[:, 0] + 2 * STD * rng.normal(size=n)
    left_open = Recording(name="b", time=time, inputs={"F": -u}, outputs={"x": wide})
    s = smooth(Problem(model=MODEL, recordings=[given, left_open], parameters={"mass.m": Free(3.0)}, weights=Weights(W={"mass": 0.1})))
    (note,) = [note for note in s.notes if note.startswith("V of x")]
    assert note.startswith("V of x: std 0.003 m as given (a); std ")
    found = float(note.split("; std ")[1].split()[0])
    assert found == pytest.approx(2 * STD, rel=0.15)
    assert s.weights.V["x [a]"] == pytest.approx(3 * STD, rel=1e-12)
    assert s.weights.V["x [b]"] == pytest.approx(found, rel=0.01)


@pytest.mark.parametrize(("own", "said"), [(STD, False), (STD / 2.5, False), (STD / 5, True), (5 * STD, True), (None, False)])
def test_a_noise_far_from_the_models_own_is_mentioned(own, said):
    model = replace(MODEL, outputs=tuple(replace(q, noise_std=own) for q in MODEL.outputs))
    s = fitted(0, 0.3, "V", model=model)
    assert s.weights.V["x"] == pytest.approx(STD, rel=0.15)
    assert any("the model itself supposes" in note for note in s.notes) == said
    assert not any("the model itself supposes" in note for note in fitted(0, 0.3, "", model=model).notes)


@pytest.mark.parametrize("given", [STD, None])
def test_the_answer_to_an_input_that_steps_at_every_sample_is_no_noise(given):
    """By themselves the samples show fifty times what the sensor has: with the model they do not."""
    rng, n = np.random.default_rng(0), 1000
    time, u = 0.01 * np.arange(n), 20 * np.sign(rng.standard_normal(n))
    y = truths.disturbed(PLANT, time, u, np.zeros(2), 0.02, rng)[:, 1] + STD * rng.normal(size=n)
    assert noise(time, y).least > 20 * STD
    recording = Recording(name="run", time=time, inputs={"F": u}, outputs={"v": y}, output_std={"v": given})
    free = {"mass.m": Free(2.2), "spring.k": Free(45.0), "damper.d": Free(1.2), "offset.f": OFFSET}
    model = compiled(on_mass("oscillator", Force(), Spring(k=K), {"v": "speed.v"}))
    s = smooth(Problem(model=model, recordings=[recording], parameters=free, weights=Weights(W={"mass": 0.02})))
    assert s.weights.V["v"] == pytest.approx(STD, rel=4 / np.sqrt(2 * n))
    assert s.fit["run"]["v"].prediction_rms == pytest.approx(1.0, abs=4 / np.sqrt(2 * n))
    assert not [note for note in s.notes if "samples have noise" in note]
    assert abs(s.parameters["mass.m"].value - M) < 4 * s.parameters["mass.m"].std


def test_weights_that_run_away_are_those_of_the_start_again(monkeypatch):
    """Of a model without an answer squares grow from round to round; here those of the second one are said to."""
    told, choose = [], work.choose_weights

    def kept(solve, *given, **named):
        solved = []

        def dear(*asked):
            solved.append(found := solve(*asked))
            return replace(found, solved=replace(found.solved, cost=1e9)) if len(solved) == 2 else found

        told.append(choose(dear, *given, **named))
        return told[-1]

    monkeypatch.setattr(work, "choose_weights", kept)
    fitted(0, 0.3, "V")
    first = told[0]
    assert (first.rounds, first.settled) == (2, False)
    assert np.all(first.output_factor == 1.0)
    assert first.solution.solved.status.converged
