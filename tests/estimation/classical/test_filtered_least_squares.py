"""Least squares on filtered derivatives, against exact motions, many repetitions and the published axis."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import truths
from examples import OFFSET, D, K, M, compiled, oscillator

from backsight.estimation import Free, Problem, Recording
from backsight.estimation.classical import filtered_least_squares, state_variable_filter
from backsight.models.errors import InputError
from backsight.models.plants import actuator, drillstring, five_bar, xy_table

OSCILLATOR = compiled(oscillator())
TRUE = {"mass.m": M, "spring.k": K, "damper.d": D, "offset.f": OFFSET}
FREE = {"mass.m": Free(1.0), "spring.k": Free(10.0), "damper.d": Free(0.0), "offset.f": Free(0.0)}
DT = 0.002


def recorded(seed: int, *, n: int = 10_000, input_noise: float = 0.0, noise: float = 0.0) -> Recording:
    """An oscillator under random steps of 50 ms, exact; the recorded force and the recorded position with white noise."""
    rng = np.random.default_rng(seed)
    time, u = DT * np.arange(n), np.repeat(20 * rng.normal(size=n // 25), 25)
    x = truths.motion(truths.Plant(m=M, d=D, k=K, offset=OFFSET), time, u, np.array([0.02, -0.1]))
    recorded_u = u + input_noise * rng.normal(size=n)
    return Recording(name="run", time=time, inputs={"F": recorded_u}, outputs={"x": x[:, 0] + noise * rng.normal(size=n)})


@pytest.mark.slow
@pytest.mark.parametrize("method", [filtered_least_squares, state_variable_filter])
def test_exact_samples_give_the_parameters_to_the_error_of_differences(method):
    found = method(Problem(model=OSCILLATOR, recordings=[recorded(1)], parameters=FREE), cutoff=5.0)
    for name, true in TRUE.items():
        assert found.parameters[name].value == pytest.approx(true, rel=2e-3, abs=2e-3)
    assert found.fit["run"]["x"].fit_percent > 99


@pytest.mark.slow
@pytest.mark.parametrize("method", [filtered_least_squares, state_variable_filter])
def test_estimates_scatter_as_their_deviations_say(method):
    """8 repetitions of 4 parameters, noise in the recorded force: rms of the 32 scores within 0.5 .. 1.7 (fails by chance below 1e-3)."""
    scores = []
    for seed in range(8):
        run = recorded(seed, n=5000, input_noise=3.0)
        p = method(Problem(model=OSCILLATOR, recordings=[run], parameters=FREE), cutoff=5.0).parameters
        scores.append([(p[name].value - true) / p[name].std for name, true in TRUE.items()])
    assert 0.5 < np.sqrt(np.mean(np.square(scores))) < 1.7


@pytest.mark.slow
def test_noise_of_the_position_biases_it_when_the_filter_lets_it_pass():
    """What the docstring warns of: noise in the regressors shrinks the inertia."""
    noisy = Problem(model=OSCILLATOR, recordings=[recorded(4, noise=2e-3)], parameters=FREE)
    assert filtered_least_squares(noisy, cutoff=60.0).parameters["mass.m"].value < 0.7 * M
    assert filtered_least_squares(noisy, cutoff=4.0).parameters["mass.m"].value == pytest.approx(M, rel=0.05)


@pytest.mark.slow
def test_decimation_changes_little_where_nothing_lies_beyond_it():
    problem = Problem(model=OSCILLATOR, recordings=[recorded(5, input_noise=0.1)], parameters=FREE)
    all_, few = (filtered_least_squares(problem, cutoff=40.0, decimate=k).parameters for k in (1, 10))
    with pytest.raises(InputError, match="raise cutoff to 40 Hz"):
        filtered_least_squares(problem, cutoff=20.0, decimate=10)
    for name in TRUE:
        assert few[name].value == pytest.approx(all_[name].value, rel=0.02, abs=0.03)


@pytest.mark.slow
def test_several_recordings_are_fitted_together():
    one, two = (
        Recording(name=n, time=r.time, inputs=r.inputs, outputs=r.outputs) for n, r in zip("ab", (recorded(6), recorded(7)), strict=True)
    )
    found = filtered_least_squares(Problem(model=OSCILLATOR, recordings=[one, two], parameters=FREE), cutoff=5.0)
    assert set(found.fit) == {"a", "b"}
    assert found.parameters["mass.m"].value == pytest.approx(M, rel=2e-3)


@pytest.mark.slow
def test_nonlinear_outputs_are_inverted_for_the_states():
    """Two slides and a reflector of the gantry: its turn, which only the reflector shows, comes from x_r = x_1 + (x_2 - x_1) y/b."""
    r, b, n = 0.010, 1.0, 1200
    t = 1e-3 * np.arange(n)
    phi = np.array([2 * np.sin(3 * t), 2 * np.sin(3 * t) + 0.3 * np.sin(7 * t), 50 + 3 * np.sin(2 * t)])
    x1, x2, y = r * phi
    recording = Recording(
        name="gantry",
        time=t,
        inputs={"I_x": np.zeros(n), "I_y": np.zeros(n)},
        outputs={"x_r": x1 + (x2 - x1) * y / b, "x_m": x1, "y_m": y},
    )
    # no force but the spindle's can be told from an input of zero: J_1 phi_1'' + .. + k (phi_1 - phi_2); the pipeline runs through
    found = filtered_least_squares(Problem(model=xy_table(), recordings=[recording], parameters={"spindle.k": Free(0.1)}), cutoff=20.0)
    assert np.isfinite(found.parameters["spindle.k"].value)


@pytest.mark.parametrize(
    ("model", "outputs", "free", "message"),
    [
        (drillstring(), ["I_m"], {"bha.J": Free(0.05)}, "string.dphi and bha.omega of drillstring for bha.J, which no output shows"),
        (drillstring(), ["I_m", "Omega_r"], {"motor.L": Free(0.1), "gear.ratio": Free(1.1), "motor.Km": Free(10.0)}, "linear in the free"),
        (actuator(), ["x"], {"encoder.gain": Free(1.0)}, "free parameter"),
    ],
)
def test_a_plant_that_it_cannot_serve_is_refused_with_a_reason(model, outputs, free, message):
    n = 500
    inputs = {"V": np.zeros(n)} if "I_m" in outputs else {"F": np.zeros(n)}
    recording = Recording(
        name="run", time=1e-2 * np.arange(n), inputs=inputs, outputs={name: np.sin(0.1 * np.arange(n)) for name in outputs}
    )
    with pytest.raises(InputError, match=message):
        filtered_least_squares(Problem(model=model, recordings=[recording], parameters=free), cutoff=5.0)


@pytest.mark.slow
def test_balances_that_are_seen_are_used_though_others_are_not():
    """The motor of the drillstring alone:  L I' = V - R I - n Km Omega_r,  its bit unseen."""
    n, h = 6000, 1e-3
    t = h * np.arange(n)
    current, omega = 0.3 + 0.1 * np.sin(5 * t) + 0.05 * np.sin(17 * t), 7 + 0.5 * np.sin(3 * t)
    voltage = 0.116 * (0.5 * np.cos(5 * t) + 0.85 * np.cos(17 * t)) + 22 * current + 11 * omega
    recording = Recording(name="run", time=t, inputs={"V": voltage}, outputs={"I_m": current, "Omega_r": omega}, hold="linear")
    free = {"motor.L": Free(0.5), "motor.R": Free(10.0), "motor.Km": Free(1.0)}
    found = filtered_least_squares(Problem(model=drillstring(), recordings=[recording], parameters=free), cutoff=20.0)
    assert [found.parameters[name].value for name in free] == pytest.approx([0.116, 22.0, 11.0], rel=1e-3)


def test_missing_samples_uneven_steps_and_wrong_numbers_are_refused():
    run = recorded(8, n=1000)
    gap = np.where(np.arange(1000) == 400, np.nan, run.outputs["x"])

    def problem(**changes):
        signals = {"time": run.time, "inputs": run.inputs, "outputs": run.outputs} | changes
        return Problem(model=OSCILLATOR, recordings=[Recording(name="run", **signals)], parameters=FREE)

    with pytest.raises(InputError, match=r"the one at 0\.8 s is missing"):
        filtered_least_squares(problem(outputs={"x": gap}))
    with pytest.raises(InputError, match="needs equal steps"):
        filtered_least_squares(problem(time=run.time * (1 + 0.1 * run.time)))
    with pytest.raises(InputError, match="half the sampling frequency, 250 Hz"):
        filtered_least_squares(problem(), cutoff=300.0)
    with pytest.raises(InputError, match="two derivatives need three lags"):
        state_variable_filter(problem(), order=2)
    with pytest.raises(InputError, match="nothing to estimate"):
        filtered_least_squares(Problem(model=OSCILLATOR, recordings=[run]))
    with pytest.raises(InputError, match="constants only"):
        filtered_least_squares(Problem(model=OSCILLATOR, recordings=[run], parameters={"mass.m": Free(1.0, drift=0.1)}))


def test_a_closed_loop_of_links_is_linear_in_its_base_parameters():
    """Gravity off and at rest the torques are zero whatever the inertias are: nothing is determined, and that is said."""
    n = 800
    still = Recording(
        name="rest", time=0.01 * np.arange(n), inputs={"tau_1": np.zeros(n), "tau_2": np.zeros(n)},
        outputs={"theta_1": np.zeros(n), "theta_2": np.zeros(n)},
    )  # fmt: skip
    found = filtered_least_squares(Problem(model=five_bar(), recordings=[still], parameters={"P_1": Free(1.0)}), cutoff=10.0)
    assert found.parameters["P_1"].identifiable is False
    assert found.parameters["P_1"].std is None


def emps(name: str = "emps_estimation.csv") -> Path:
    folder = os.environ.get("BACKSIGHT_DATA")
    if not folder or not (Path(folder) / "emps" / name).is_file():
        pytest.skip(f"needs emps/{name} in the folder that BACKSIGHT_DATA names")
    return Path(folder) / "emps" / name


def test_the_recorded_axis_gives_its_published_parameters():
    """A. Janot, M. Gautier, M. Brunot 2019, by the same method: 95.11 kg, 203.5 N.s/m, 20.39 N, -3.165 N, each within 0.5 %.

    They take the force for a sampled signal and not for a staircase, hence hold = "linear".
    """
    recording = Recording.read(emps(), time="t_s", inputs={"F": "u_force_N"}, outputs={"x": "q_m"}, hold="linear")
    free = {"carriage.m": Free(80.0), "friction.d": Free(100.0), "friction.f_c": Free(10.0), "offset.f": Free(0.0)}
    found = filtered_least_squares(Problem(model=actuator(), recordings=[recording], parameters=free), cutoff=100.0, poles=2, decimate=10)
    assert [found.parameters[name].value for name in free] == pytest.approx([95.11, 203.5, 20.39, -3.165], rel=5e-3)
