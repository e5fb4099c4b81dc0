"""Slip and stick of a bit from voltage and current, on recordings from an integrator of its own."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import lfilter

from backsight.estimation import Known, Problem, Recording, Weights
from backsight.estimation.classical import Modes, multiple_models
from backsight.models.errors import InputError
from backsight.models.plants import drillstring

L, R, KM, J_C, B_R, K_S, J_B, B_B, SLIDES, STICKS = 0.116, 22.0, 11.0, 0.3, 0.03, 0.0868, 0.0529, 0.001, 0.4, 0.6
STEP, FINE = 0.05, 100
MODES = {"slip": {"bha.omega": 3.0}, "stick": {"bha.omega": 0.0}}
WEIGHTS = Weights(W={"bha": 0.03, "motor": 1e-3, "rotary_table": 1e-3})


def drilled(seed: int, std: float, n: int = 1200) -> tuple[Recording, np.ndarray, np.ndarray]:
    """Motor current with noise; whether the bit sticks, and its velocity. Matrix exponentials over 0.5 ms, the mode checked after each."""
    A = np.array([[-R / L, -KM / L, 0, 0], [KM / J_C, -B_R / J_C, -K_S / J_C, 0], [0, 1, 0, -1], [0, 0, K_S / J_B, -B_B / J_B]])
    stuck_A = A.copy()
    stuck_A[3] = 0.0
    B = np.array([[1 / L, 0], [0, 0], [0, 0], [0, -SLIDES / J_B]])
    stuck_B = np.array([[1 / L, 0], [0, 0], [0, 0], [0, 0]])
    steps = [expm(STEP / FINE * np.block([[a, b], [np.zeros((2, 6))]])) for a, b in ((A, B), (stuck_A, stuck_B))]
    rng = np.random.default_rng(seed)
    V = 15 + lfilter([0.6], [1, -0.7], rng.normal(size=n))
    x, stuck, current, state, omega = np.zeros(4), True, [], [], []
    for v in V:
        current.append(x[0])
        state.append(stuck)
        omega.append(x[3])
        for _ in range(FINE):
            x = (steps[int(stuck)] @ np.array([*x, v, 1.0]))[:4]
            if not stuck and x[3] <= 0:
                x[3], stuck = 0.0, True
            stuck = stuck and K_S * x[2] < STICKS
    y = np.array(current) + std * rng.normal(size=n)
    run = Recording(name="drill", time=STEP * np.arange(n), inputs={"V": V}, outputs={"I_m": y}, output_std={"I_m": std})
    return run, np.array(state), np.array(omega)


@pytest.mark.parametrize(("std", "least"), [(1e-4, 0.94), (1e-3, 0.92)])
def test_slip_and_stick_are_told_from_the_motor_current_alone(std, least):
    run, stuck, _ = drilled(1, std)
    assert 0.2 < stuck.mean() < 0.8
    modes = multiple_models(Problem(model=drillstring(), recordings=[run], weights=WEIGHTS), modes=MODES, dwell=3.0)
    found = np.array(modes.most_probable("drill")) == "stick"
    assert np.mean(found == stuck) > least
    online = modes.estimates["drill"]["stick"].to_numpy() > 0.5
    assert np.mean(online == stuck) > 0.75
    assert np.mean(found == stuck) > np.mean(online == stuck)


@pytest.mark.slow
def test_the_bit_velocity_that_nobody_measures_is_followed():
    run, _, omega = drilled(2, 1e-4)
    modes = multiple_models(Problem(model=drillstring(), recordings=[run], weights=WEIGHTS), modes=MODES, dwell=3.0)
    error = modes.estimates["drill"]["bha.omega"].to_numpy() - omega
    assert np.sqrt(np.mean(error[200:] ** 2)) < 0.25 * np.std(omega)


def test_where_nothing_jumps_the_right_mode_is_certain_and_the_fit_is_the_noise():
    run, stuck, _ = drilled(3, 1e-3, n=60)
    assert stuck.all()  # it takes a while to wind up
    modes = multiple_models(Problem(model=drillstring(), recordings=[run], weights=WEIGHTS), modes=MODES, dwell=3.0)
    assert modes.estimates["drill"]["stick.afterwards"].iloc[20:].min() > 0.5
    probabilities = modes.estimates["drill"][["slip", "stick"]].sum(axis=1)
    assert probabilities.to_numpy() == pytest.approx(np.ones(60))
    base = modes.baseline()
    assert base.predicted == "one step ahead"
    assert all(p.fixed for p in base.parameters.values())


def rows(run: Recording, chosen: np.ndarray, name: str) -> Recording:
    inputs, outputs = ({k: v[chosen] for k, v in of.items()} for of in (run.inputs, run.outputs))
    return Recording(name=name, time=run.time[chosen], inputs=inputs, outputs=outputs, output_std=run.output_std)


@pytest.mark.parametrize("always", [False, True])
def test_pieces_between_gaps_are_followed_as_recordings_of_their_own(always):
    """After the gap the state that is known at the start is known only if it always is."""
    run, stuck, _ = drilled(1, 1e-4, n=700)
    k = np.arange(700)
    before, after = k < 300, k >= 400
    start = {"bha.omega": Known(0.0, always=always)}

    def followed(recording: Recording, initial: dict[str, Known]) -> Modes:
        problem = Problem(model=drillstring(), recordings=[recording], weights=WEIGHTS, initial=initial)
        return multiple_models(problem, modes=MODES, dwell=3.0)

    whole = followed(rows(run, before | after, "drill"), start)
    first, second = (
        followed(rows(run, chosen, "part"), initial).estimates["part"]
        for chosen, initial in ((before, start), (after, start if always else {}))
    )
    np.testing.assert_allclose(whole.estimates["drill"].to_numpy(), np.vstack([first, second]), rtol=1e-9, atol=1e-9)
    assert list(whole.estimates["drill"].columns) == list(first.columns)
    assert np.mean((np.array(whole.most_probable("drill")) == "stick") == stuck[before | after]) > 0.9
    fit = whole.baseline().fit["drill"]["I_m"]
    error = np.concatenate([run.outputs["I_m"][c] - table["I_m"] for c, table in ((before, first), (after, second))])
    assert fit.samples == 600
    assert fit.rms == pytest.approx(np.sqrt(np.mean(error**2)))


@pytest.mark.parametrize(
    ("modes", "dwell", "message"),
    [
        ({"slip": {}}, 1.0, "two modes or more"),
        ({"slip": {"bha.speed": 1.0}, "stick": {}}, 1.0, r"no state bha\.speed"),
        (MODES, {"slip": 1.0}, "stick has no mean time"),
        (MODES, 0.01, "longer than the step"),
    ],
)
def test_modes_that_make_no_sense_are_refused(modes, dwell, message):
    run, _, _ = drilled(4, 1e-3, n=30)
    with pytest.raises(InputError, match=message):
        multiple_models(Problem(model=drillstring(), recordings=[run]), modes=modes, dwell=dwell)
