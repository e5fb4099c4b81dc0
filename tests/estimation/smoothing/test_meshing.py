"""Fine enough for the smoother's own speed and for the input's steps."""

from __future__ import annotations

import numpy as np
import pytest
import truths
from examples import OFFSET, D, K, M, compiled, oscillator

from backsight.estimation import Free, Problem, Recording, Weights
from backsight.estimation.smoothing.families import UNDECIDED
from backsight.estimation.smoothing.horizons import make_horizon, output_stds
from backsight.estimation.smoothing.meshing import FINEST, LONGEST, Meshed, _felt_as_noise, follow_closely, mesh
from backsight.ocp.follow import follow
from backsight.ocp.linear import Linear

PLANT, MODEL = truths.Plant(m=M, d=D, k=K, offset=OFFSET), compiled(oscillator())


def meshed(force_std: float, *, std: float = 1e-3, step: float | None = None, dt: float = 0.01, jumps: float = 10.0) -> Meshed:
    rng, n = np.random.default_rng(0), 300
    time, u = dt * np.arange(n), jumps * rng.normal(size=n)
    y = truths.motion(PLANT, time, u, np.zeros(2))[:, 0] + std * rng.normal(size=n)
    recording = Recording(name="run", time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": std})
    problem = Problem(model=MODEL, recordings=[recording], parameters={"mass.m": Free(2.0)}, weights=Weights(W={"mass": force_std}))
    stds, _ = output_stds(problem)
    followed = follow(MODEL, [make_horizon(MODEL, recording, stds[0], {}, 2 * LONGEST * dt)], problem.values)
    return mesh(problem, followed, stds, {0: force_std}, problem.values, 2, step, 0.5)


def test_a_step_that_is_given_is_taken():
    (h,) = meshed(0.3, step=0.023).horizons
    assert h.mesh.count == round(2.99 / 0.023)


def test_a_stronger_force_asks_for_a_finer_mesh_within_the_limits():
    counts = [meshed(w, jumps=0.0).horizons[0].mesh.count for w in (1e-2, 1.0, 1e2, 1e6)]
    assert counts == sorted(counts)
    assert counts[0] >= 2.99 / (LONGEST * 0.01) - 1
    assert counts[-1] <= 2.99 / (FINEST * 0.01) + 1
    assert counts[-1] > 4 * counts[0]


def test_steps_of_the_input_that_an_output_could_notice_get_a_knot():
    loud, quiet = meshed(1e-2, jumps=300.0).horizons[0], meshed(1e-2, jumps=1e-3).horizons[0]
    assert loud.mesh.count > 1.5 * quiet.mesh.count
    assert np.isin(loud.mesh.knots, loud.time).all()


@pytest.mark.parametrize(("jump", "noticed"), [(100.0, True), (1e-3, False)])
def test_samples_are_followed_on_a_coarse_mesh_with_knots_where_the_input_steps_noticeably(jump, noticed):
    time, at = 0.01 * np.arange(300), 102  # between two knots of a mesh of five samples
    u = np.where(np.arange(300) < at, 0.0, jump)
    y = truths.motion(PLANT, time, u, np.zeros(2))[:, 0] + 1e-3 * np.random.default_rng(0).normal(size=300)
    recording = Recording(name="run", time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": 1e-3})
    problem = Problem(model=MODEL, recordings=[recording], parameters={"mass.m": Free(2.0)})
    (horizon,) = follow_closely(problem, output_stds(problem)[0], None).horizons
    assert (time[at] in horizon.mesh.knots) is noticed
    assert horizon.mesh.count <= 62


def test_weights_that_leave_no_room_are_called_rigid():
    assert meshed(1e-9).rigid
    assert not meshed(0.3).rigid


def test_the_least_force_that_can_be_felt_scales_with_the_noise():
    one, ten = (meshed(0.3, std=s, jumps=100.0).least_std[0] for s in (1e-4, 1e-3))
    assert ten / one == pytest.approx(10.0, rel=0.05)


def test_a_force_that_a_reading_takes_at_once_is_felt_as_noise():
    """Drawn a thousand times: at the least std that is felt, the readings' mean square is above the noise's by UNDECIDED deviations."""
    rng, n, dt, noise, D = np.random.default_rng(2), 500, 0.02, 0.05, np.array([[0.7], [0.0]])
    zero = np.zeros((3, 1, 1))
    places = Linear(A=zero, B=zero, G=zero, C=np.zeros((3, 2, 1)), D=np.broadcast_to(D, (3, 2, 1)), E=np.zeros((3, 2, 1)))
    (felt,) = _felt_as_noise(places, np.array([noise**2 * dt, np.inf]), n)
    force = rng.normal(size=(4000, n)) / felt / np.sqrt(dt)  # white, held over a sampling interval
    mean_square = np.mean((D[0, 0] * force + noise * rng.normal(size=force.shape)) ** 2, axis=1) / noise**2
    assert np.mean(mean_square - 1) / np.sqrt(2 / n) == pytest.approx(UNDECIDED, abs=0.06)
