"""A load behind a soft shaft, with an encoder on the motor alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import truths
from examples import soft_drive

from backsight.estimation import Free, Problem, Recording, Weights, smooth
from backsight.estimation.smoothing.horizons import output_stds
from backsight.estimation.smoothing.meshing import follow_closely
from backsight.estimation.smoothing.telling import telling_places
from backsight.estimation.smoothing.unseen import of_the_right_size, unseen_states
from backsight.models import compile_model
from backsight.models.mechanics.rotational import RotationalDamper
from backsight.models.plants import drillstring

TRUE = {"motor.J": 2e-3, "load.J": 8e-3, "shaft.k": 40.0, "shaft.d": 0.01, "bearing.d": 0.05}
STEP, NOISE = 0.002, 1e-3


def recorded(seed: int) -> tuple[Recording, np.ndarray]:
    """Under a torque that is commanded."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 3.0, STEP)
    torque = 0.6 * np.sin(2 * np.pi * 0.7 * t) + 0.8 * np.repeat(rng.uniform(-1, 1, 31), 50)[: len(t)]
    return moved(t, torque, {**TRUE, "brake.d": 0.0}, NOISE, rng)


def moved(
    t: np.ndarray,
    torque: np.ndarray,
    true: dict[str, float],
    noise: float,
    rng: np.random.Generator,
    servo: tuple[float, float] = (0.0, 0.0),
    disturbed: tuple[float, float] = (0.0, 0.0),
) -> tuple[Recording, np.ndarray]:
    """The exact motion under a held torque, by the matrix exponential; angle of the motor with noise, angle of the load.

    servo: gains that hold angle and speed of the motor. disturbed: standard deviations of white torques at motor and load.
    """
    J1, J2, k, c, d, b = true.values()
    A = np.array([[0, 1, 0, 0], [-k / J1, -(c + b) / J1, k / J1, c / J1], [0, 0, 0, 1], [k / J2, c / J2, -k / J2, -(c + d) / J2]])
    phi, gamma = truths.discrete(A, np.array([[0.0], [1 / J1], [0.0], [0.0]]), STEP)
    G = np.array([[0, 0], [disturbed[0] / J1, 0], [0, 0], [0, disturbed[1] / J2]])
    size, vectors = np.linalg.eigh(truths.noise_covariance(A, G, 1.0, STEP))
    spread = vectors * np.sqrt(np.maximum(size, 0.0))
    x, torque = np.zeros((len(t), 4)), torque.copy()
    for i in range(len(t)):
        torque[i] -= servo[0] * x[i, 0] + servo[1] * x[i, 1]
        if i + 1 < len(t):
            x[i + 1] = phi @ x[i] + gamma[:, 0] * torque[i] + (spread @ rng.standard_normal(4) if any(disturbed) else 0.0)
    noisy = x[:, 0] + noise * rng.standard_normal(len(t))
    return Recording(name="run", time=t, inputs={"tau": torque}, outputs={"phi": noisy}, output_std={"phi": noise}), x[:, 2]


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "unit"), [(0, 1e-3), (1, 1e-3), (3, 1e-3), pytest.param(2, 1e3, marks=pytest.mark.long)])
def test_a_torque_in_another_unit_scales_the_parameters_and_no_force_takes_over_the_noise(seed, unit):
    """Guesses of a machine a thousand times as strong, or as weak: what they call no force at all would explain every sample."""
    recording, _ = recorded(seed)
    free = {name: Free(1.7 * true) for name, true in TRUE.items()}
    weak = replace(recording, inputs={"tau": unit * recording.inputs["tau"]}, output_std={})
    s = smooth(Problem(model=soft_drive(), recordings=[weak], parameters=free))
    assert s.solver.converged
    for name, true in TRUE.items():
        p = s.parameters[name]
        assert abs(p.value - unit * true) < 4 * p.std < 0.3 * unit * true, name
    assert s.weights.V["phi"] == pytest.approx(NOISE, rel=0.1)
    assert s.fit["run"]["phi"].prediction_rms == pytest.approx(1.0, abs=0.1)


def test_guesses_off_by_decades_are_brought_near_but_what_is_known_of_a_parameter_stays():
    recording, _ = recorded(0)
    unit = 1e-3
    free = {name: Free(1.7 * true) for name, true in TRUE.items()} | {"motor.J": Free(unit * TRUE["motor.J"], std=1e-7)}
    weak = replace(recording, inputs={"tau": unit * recording.inputs["tau"]})
    posed = Problem(model=compile_model(soft_drive()), recordings=[weak], parameters=free)
    followed = follow_closely(posed, output_stds(posed)[0], None)
    near, start = of_the_right_size(posed, followed, (), posed.values)
    index = {posed.dae.parameters[i].name: i for i in posed.free}
    assert near.parameters["motor.J"] == free["motor.J"]
    assert start[index.pop("motor.J")] == unit * TRUE["motor.J"]
    for name, i in index.items():
        assert start[i] == near.parameters[name].guess == pytest.approx(1e-3 * free[name].guess)


@pytest.mark.parametrize("unit", [1e-3, 1e-2, 1e3])
def test_one_inertia_that_is_known_does_not_hide_how_far_off_the_other_guesses_are(unit):
    """Behind a shaft a thousand times too soft the known load swings so far that the forces look right."""
    recording, _ = recorded(0)
    free: dict[str, Free | float] = {name: Free(unit * true) for name, true in TRUE.items()}
    posed = Problem(model=compile_model(soft_drive()), recordings=[recording], parameters=free | {"load.J": TRUE["load.J"]})
    near, _ = of_the_right_size(posed, follow_closely(posed, output_stds(posed)[0], None), (), posed.values)
    for name in free:
        given = near.parameters[name]
        assert (given.guess if isinstance(given, Free) else given) == pytest.approx(TRUE[name])


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 1])
def test_a_load_that_its_own_noise_moves_as_much_as_the_shaft_does_is_told_from_that(seed):
    """The most probable parameters together with a trajectory are in another valley, where the load is twice as large."""
    true = {"motor.J": 2.16e-3, "load.J": 7.15e-3, "shaft.k": 1.724, "shaft.d": 0.0203, "bearing.d": 0.0254, "brake.d": 0.0437}
    rng, n, total = np.random.default_rng([8, seed]), 3000, 9.3e-3
    t = STEP * np.arange(n)
    swept = np.sin(2 * np.pi * (0.3 * t + 1.5 * 5.1 / t[-1] * t**2 / 2))
    torque = total * (30.0 * np.repeat(rng.normal(size=n // 20), 20) + 40.0 * swept)
    recording, _ = moved(t, torque, true, 2e-5, rng, servo=(30.0 * total, 5.0 * total), disturbed=(4.2e-4, 8.8e-3))
    model = soft_drive().insert("motor", RotationalDamper(), name="brake")
    free = {name: Free(value * 3.0 ** rng.choice([-1, 1])) for name, value in true.items()}
    s = smooth(Problem(model=model, recordings=[recording], parameters=free))
    assert s.solver.converged
    for name, value in true.items():
        p = s.parameters[name]
        assert p.std is not None
        assert abs(p.value - value) < 4 * p.std, name
    assert s.weights.W["load"] == pytest.approx(8.8e-3, rel=0.25)


def problem(factor: float) -> tuple[Problem, np.ndarray]:
    recording, load = recorded(4)
    free = {name: Free(value * factor) for name, value in TRUE.items()}
    return Problem(model=compile_model(soft_drive()), recordings=[recording], parameters=free), load


def test_what_no_output_shows_is_named():
    assert unseen_states(problem(1.0)[0]) == ["load.phi", "load.omega"]


def drilling(*free: str) -> Problem:
    time = np.linspace(0.0, 1.0, 11)
    nothing = np.zeros(11)
    recording = Recording(name="run", time=time, inputs={"V": nothing}, outputs={"I_m": nothing, "Omega_r": nothing})
    return Problem(model=compile_model(drillstring()), recordings=[recording], parameters={name: Free(0.1) for name in free})


@pytest.mark.parametrize(
    ("free", "telling"),
    [
        (("string.k", "bha.J", "bha.d", "bit.tau_sl"), {"motor", "rotary_table"}),  # J_c Omega_r' = n Km I - B_r Omega_r - k dphi
        (("bha.J", "rotary_table.J"), set()),  # a guess of J_c matters to that torque, however small the twist
        ((), set()),
    ],
)
def test_the_torque_of_the_string_is_told_by_balances_of_what_is_seen_if_no_guess_matters_there(free, telling):
    posed = drilling(*free)
    assert {posed.dae.places[k].name for k in telling_places(posed)} == telling


def test_where_a_guess_says_how_the_unseen_is_seen_no_balance_tells_it():
    assert telling_places(problem(1.0)[0]) == frozenset()  # J phi'' = tau - k (phi - phi_load): phi_load is not told without k


@pytest.mark.parametrize("factor", [1 / 3, 3.0])
def test_a_load_that_nobody_measured_is_found_from_guesses_three_times_off(factor):
    posed, load = problem(factor)
    result = smooth(posed)
    assert result.solver.converged
    for name, true in TRUE.items():
        estimate = result.parameters[name]
        assert abs(estimate.value - true) < 4 * estimate.std, f"{name}: {estimate}"
    angle = result.estimates["run"]["load.phi"].to_numpy()
    assert np.sqrt(np.mean((angle - load) ** 2)) < 0.5 * NOISE


# their resonance at 5 and 14 Hz, damped by 1 and 4 %
RINGING = [
    {"motor.J": 0.0037, "load.J": 0.0052, "shaft.k": 2.16, "shaft.d": 0.00175, "bearing.d": 0.0042, "brake.d": 0.0013},
    {"motor.J": 0.0388, "load.J": 0.0102, "shaft.k": 60.4, "shaft.d": 0.0533, "bearing.d": 0.0125, "brake.d": 0.0796},
]


@pytest.mark.slow
@pytest.mark.parametrize(("number", "disturbed"), [(0, (1.6e-4, 8.8e-4)), (1, (0.026, 0.025))])
def test_a_load_that_rings_is_found_from_guesses_three_times_off_in_either_direction(number, disturbed):
    """A sweep through the resonance, which the guesses miss by a factor, under a servo; weights from the data."""
    true, rng = RINGING[number], np.random.default_rng(11)
    t, size = np.arange(0.0, 6.0, STEP), true["motor.J"] + true["load.J"]
    f = np.sqrt(true["shaft.k"] * size / (true["motor.J"] * true["load.J"])) / (2 * np.pi)
    sweep = 40 * np.sin(2 * np.pi * (0.3 * t + 1.5 * f / t[-1] * t**2 / 2)) + np.repeat(rng.normal(0, 30, 150), 20)
    recording, _ = moved(t, size * sweep, true, 5e-5, rng, (30 * size, 5 * size), disturbed)
    signs = {"motor.J": -1, "load.J": -1, "shaft.k": 1, "shaft.d": -1, "brake.d": 1, "bearing.d": 1 - 2 * number}
    model = soft_drive().insert("motor", RotationalDamper(), name="brake")
    result = smooth(Problem(model=model, recordings=[recording], parameters={n: Free(v * 3.0 ** signs[n]) for n, v in true.items()}))
    assert result.solver.converged
    for name, value in true.items():
        estimate = result.parameters[name]
        assert abs(estimate.value - value) < 4 * estimate.std, f"{name}: {estimate}"
    assert result.parameters["shaft.k"].std < 0.05 * true["shaft.k"]


@pytest.mark.parametrize("seed", [0, pytest.param(2, marks=[pytest.mark.slow, pytest.mark.long])])
def test_where_no_force_acts_deviations_are_those_of_no_force_whatever_the_guesses(seed):
    """Weights are chosen with parameters held where the way begins; what these are off by is no force once they have moved."""
    recording, _ = recorded(seed)
    stds = []
    for times, weights in ((3.0, Weights()), (1 / 3, Weights()), (1.0, Weights(W={"motor": 1e-7, "load": 1e-7}))):
        free = {name: Free(times * true) for name, true in TRUE.items()}
        s = smooth(Problem(model=soft_drive(), recordings=[recording], parameters=free, weights=weights))
        assert s.solver.converged
        assert all(abs(s.parameters[name].value - true) < 3 * s.parameters[name].std for name, true in TRUE.items())
        stds.append([s.parameters[name].std for name in TRUE])
    np.testing.assert_allclose(stds[0], stds[1], rtol=0.02)
    np.testing.assert_array_less(stds[2], 1.01 * np.array(stds[0]))
    np.testing.assert_array_less(stds[0], 2 * np.array(stds[2]))


def test_a_parameter_that_runs_onto_a_bound_of_its_own_has_moved_too():
    """Weights are chosen again beside it, and no deviation of zero is divided by."""
    recording, _ = recorded(0)
    free = {name: Free(2 * true) for name, true in TRUE.items()} | {"shaft.k": Free(80.0, min=48.0)}
    s = smooth(Problem(model=soft_drive(), recordings=[recording], parameters=free))
    assert s.solver.converged
    assert s.parameters["shaft.k"].on_bound
    assert any(note.startswith("shaft.k ended on its bound, 48 N.m/rad: the data pull it") for note in s.notes)
