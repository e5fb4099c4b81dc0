"""The model linearised, and what follows from it, against hand-written matrices and exact integrals."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
import truths
from examples import LAG, OFFSET, D, K, M, compiled, lagged, oscillator, shaken, stiffening

from backsight.ocp import Horizon, Mesh
from backsight.ocp.linear import (
    Linear,
    averaging,
    bridge_variance,
    direct_share,
    driven_between_knots,
    driven_outputs,
    fastest_rate,
    left_out_of_outputs,
    linearise,
    without_followers,
)

PLANT = truths.Plant(m=M, d=D, k=K, offset=OFFSET, T=LAG)


def linear(places: int = 3) -> Linear:
    dae, rng = compiled(lagged()), np.random.default_rng(0)
    parameters = np.array([p.value for p in dae.parameters])
    x = rng.normal(size=(3, places))
    return linearise(dae, x, x, np.zeros((0, places)), np.ones((1, places)), np.zeros(places), parameters, (0,))


def test_a_linear_plant_has_its_own_matrices_everywhere():
    A, B, G = PLANT.matrices
    found = linear()
    for k in range(3):
        np.testing.assert_allclose(found.A[k], A, rtol=1e-12)
        np.testing.assert_allclose(found.B[k], B[:, :1], rtol=1e-12)
        np.testing.assert_allclose(found.G[k], G, rtol=1e-12)
        np.testing.assert_allclose(found.C[k], [[0, 1, 0], [0, 0, 1]], atol=1e-14)


def test_a_nonlinear_plant_has_the_slopes_of_its_right_hand_side():
    dae = compiled(stiffening())
    parameters = {p.name: p.value for p in dae.parameters}
    s, v = 0.7, -0.3
    z = float(np.roots([parameters["spring.a"], 0, 1, -s])[-1].real)
    dx = np.zeros((3, 1))
    found = linearise(
        dae, dx, np.array([[1.0], [s], [v]]), np.array([[z]]), np.ones((1, 1)), np.zeros(1), np.array(list(parameters.values())), (0,)
    )
    stiffness = parameters["spring.k"] / (1 + 3 * parameters["spring.a"] * z**2)
    rubbing = parameters["friction.f_c"] / parameters["friction.width"] / np.cosh(v / parameters["friction.width"]) ** 2
    np.testing.assert_allclose(found.A[0], [[-1 / LAG, 0, 0], [0, 0, 1], [1 / M, -stiffness / M, -(D + rubbing) / M]], rtol=1e-9)


def test_without_a_force_the_fastest_rate_is_the_plants_own():
    assert fastest_rate(linear(), np.array([1e-12]), np.array([1.0, 1.0])) == pytest.approx(1 / LAG, rel=1e-3)


def test_the_fastest_rate_of_a_tracked_mass_is_that_of_its_riccati_equation():
    dae = compiled(oscillator())
    parameters = np.array([p.value for p in dae.parameters])
    found = linearise(dae, np.zeros((2, 1)), np.zeros((2, 1)), np.zeros((0, 1)), np.zeros((1, 1)), np.zeros(1), parameters, (0,))
    q, r = 5.0, 1e-8
    A, G, C = found.A[0], found.G[0], found.C[0]
    P = scipy.linalg.solve_continuous_are(A.T, C.T, q**2 * G @ G.T, np.array([[r]]))
    rate = np.abs(np.linalg.eigvals(A - P @ C.T @ C / r)).max()
    assert fastest_rate(found, np.array([q]), np.array([r])) == pytest.approx(rate, rel=1e-6)


def chain(*lags: float, driven: bool = False) -> Linear:
    """A tracked mass, x = (s, v, ...), read behind lags in a row; driven: an input enters the last one too."""
    n = 2 + len(lags)
    A, B, G, C = np.zeros((n, n)), np.zeros((n, 1)), np.zeros((n, 1)), np.zeros((1, n))
    A[0, 1], A[1, 0], A[1, 1] = 1.0, -K / M, -D / M
    B[1, 0] = G[1, 0] = 1 / M
    for k, lag in enumerate(lags):
        A[2 + k, 2 + k], A[2 + k, 0 if k == 0 else 1 + k] = -1 / lag, 1 / lag
    B[-1, 0] += driven
    C[0, -1 if lags else 0] = 1.0
    no = np.zeros((1, 1, 1))
    return Linear(A=A[None], B=B[None], G=G[None], C=C[None], D=no, E=no)


def test_a_sensor_behind_fast_lags_asks_for_no_finer_mesh_than_one_without():
    q, r = np.array([5.0]), np.array([1e-8])
    plain = fastest_rate(chain(), q, r)
    behind = without_followers(chain(1e-7, 2e-7))
    np.testing.assert_allclose(behind.C, chain().C)
    assert fastest_rate(behind, q, r) == pytest.approx(plain, rel=1e-9)
    # as the whole system has it among its modes, and besides them those of the lags
    assert fastest_rate(chain(1e-7), q, r) == pytest.approx(1e7, rel=1e-3)


def test_a_lag_that_an_input_enters_and_a_position_that_nobody_needs_are_no_followers():
    assert without_followers(chain(1e-7, driven=True)).A.shape == (1, 3, 3)
    free = chain()
    free.A[0, 1, 0] = 0.0
    assert without_followers(free).A.shape == (1, 2, 2)


@pytest.mark.parametrize("duration", [0.01, 0.5, 5.0, 500.0])
def test_a_white_force_drives_the_outputs_as_the_integral_says(duration):
    A, _, G = PLANT.matrices
    size, vectors = np.linalg.eig(A)
    b = np.linalg.solve(vectors, G)
    # in modal coordinates every entry of the integral is elementary
    total = size[:, None] + size[None, :].conj()
    P = vectors @ ((np.exp(total * duration) - 1) / total * (b @ b.conj().T)) @ vectors.conj().T
    np.testing.assert_allclose(driven_outputs(linear(), duration)[:, 0], np.sqrt(np.diag(P.real)[1:]), rtol=1e-6)


def test_between_knots_the_input_moves_the_states_through_its_integrals():
    A, B, _ = PLANT.matrices
    first, second = np.array([[2e-3, 0.0, 1e-3]]), np.array([[1e-5, 2e-5, 0.0]])
    expected = B[:, :1] * first + A @ B[:, :1] * second
    np.testing.assert_allclose(driven_between_knots(linear(), first, second), expected, rtol=1e-12)


def accelerometer(places: int = 2) -> Linear:
    """x = (s, v), y = (s, v'):  v' = (u + w - d v - k s - offset)/m, read by hand."""
    dae = compiled(shaken())
    zero = np.zeros((2, places))
    parameters = np.array([p.value for p in dae.parameters])
    return linearise(dae, zero, zero, np.zeros((len(dae.algebraics), places)), np.ones((1, places)), np.zeros(places), parameters, (0,))


def test_what_acts_on_a_mass_enters_its_accelerometer_at_once():
    found = accelerometer()
    np.testing.assert_allclose(found.C[0], [[1, 0], [-K / M, -D / M]], atol=1e-14)
    np.testing.assert_allclose(found.D[0], [[0], [1 / M]], atol=1e-14)
    np.testing.assert_allclose(found.E[0], [[0], [1 / M]], atol=1e-14)
    assert not linear().D.any()


def test_the_mean_of_an_accelerometer_over_the_record_tells_a_white_force_to_its_root_density():
    """A mass alone: the mean of v' over T is (v(T) - v(0))/T, whose variance is q/(m^2 T); its reading is nothing else."""
    found = accelerometer()
    alone = Linear(A=0 * found.A, B=found.B, G=found.G, C=0 * found.C, D=found.D, E=found.E)
    np.testing.assert_allclose(driven_outputs(alone, 4.0)[:, 0], [0.0, 1 / (M * np.sqrt(4.0))], rtol=1e-9)


def test_with_an_accelerometer_the_modes_are_those_of_the_correlated_riccati_equation():
    found = accelerometer()
    q, r = 5.0, np.array([1e-6, 4e-2])
    A, G, C, F = found.A[0], found.G[0], found.C[0], found.D[0]
    P = scipy.linalg.solve_continuous_are(A.T, C.T, q**2 * G @ G.T, np.diag(r) + q**2 * F @ F.T, s=q**2 * G @ F.T)
    gain = (P @ C.T + q**2 * G @ F.T) @ np.linalg.inv(np.diag(r) + q**2 * F @ F.T)
    rate = np.abs(np.linalg.eigvals(A - gain @ C)).max()
    assert fastest_rate(found, np.array([q]), r) == pytest.approx(rate, rel=1e-6)
    without = Linear(A=found.A, B=found.B, G=found.G, C=found.C, D=0 * found.D, E=found.E)
    assert fastest_rate(without, np.array([q]), r) != pytest.approx(rate, rel=0.1)
    # an output without samples has no part in it
    alone = fastest_rate(found, np.array([q]), np.array([1e-6, np.inf]))
    assert alone == pytest.approx(fastest_rate(without, np.array([q]), np.array([1e-6, np.inf])), rel=1e-9)


def test_the_share_of_a_force_in_a_reading_is_its_density_over_the_samples():
    assert direct_share(accelerometer(), np.array([5.0]), np.array([1e-6, 4e-2])) == pytest.approx((5 / M) ** 2 / 4e-2)
    assert direct_share(linear(), np.array([5.0]), np.array([1e-6, 4e-2])) == 0.0


def test_a_step_of_the_input_inside_an_interval_moves_an_accelerometer_by_its_full_height():
    moved = left_out_of_outputs(accelerometer(), np.array([[3.0]]), np.zeros((1, 1)), np.array([0.1]))
    np.testing.assert_allclose(moved[:, 0], [0.0, 3.0 / M], atol=1e-14)


def horizon(knots: np.ndarray, time: np.ndarray, target: np.ndarray) -> Horizon:
    return Horizon(
        mesh=Mesh(knots),
        time=time,
        inputs=np.zeros((len(time), 0)),
        target=target,
        target_std=np.ones(target.shape),
        initial=np.zeros(2),
        initial_std=np.ones(2),
    )


def test_a_sensor_slower_than_the_rows_averages_over_its_own_interval():
    """Rows every 0.1 s, of one output every one has a sample, of the other every fourth: variances 1/0.1 and 1/0.4."""
    time = np.arange(9) * 0.1
    target = np.ones((9, 2))
    target[np.arange(9) % 4 > 0, 1] = np.nan
    c = averaging(horizon(time[::4], time, target), 3, [0, 1]).reshape(2, 3, 9)
    np.testing.assert_allclose(np.sum(c**2, axis=1) / 0.4, np.tile([[10.0], [2.5]], 9), rtol=1e-12)
    # the slow one's mean over a whole interval is its first moment
    np.testing.assert_allclose(c[1][:, ::4], np.tile([[1.0], [0.0], [0.0]], 3), atol=1e-12)


def test_a_sensor_that_a_force_enters_at_once_reads_its_mean_over_a_sampling_interval():
    time = np.arange(5) * 0.1
    for knots in (time, time[::2], np.arange(9) * 0.05):
        c = averaging(horizon(knots, time, np.ones((5, 1))), 3, [0])
        # moments of a white force of density one are independent with variance 1/h, its mean over 0.1 s has variance 1/0.1
        np.testing.assert_allclose(np.sum(c**2, axis=0) / np.diff(knots)[0], 10.0, rtol=1e-12)
        if len(knots) == 5:
            np.testing.assert_allclose(c, np.tile([[1.0], [0.0], [0.0]], 5), atol=1e-12)
        if len(knots) == 3:
            # L_1 = sqrt(3) (2 tau - 1) has the means -+ sqrt(3)/2 over the halves of the interval, L_2 none
            np.testing.assert_allclose(c[1] / c[0], np.sqrt(3) / 2 * np.array([-1, 1, -1, 1, 1]), rtol=1e-12)
            np.testing.assert_allclose(c[2], 0.0, atol=1e-12)


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_the_bridge_is_what_the_moments_leave_of_brownian_motion(degree):
    mesh, tau = Mesh(np.array([0.0, 0.5, 2.0])), np.linspace(0, 1, 21)
    for interval, h in ((0, 0.5), (1, 1.5)):
        found = bridge_variance(mesh, degree, np.full(21, interval), tau)
        np.testing.assert_allclose(found, h * np.maximum(truths.bridge(degree, tau), 0.0), atol=1e-12)
