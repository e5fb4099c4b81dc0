"""A residual force with a memory has the covariance that it is said to have, and acts where the white one did."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from examples import D, K, M, oscillator
from scipy.linalg import expm, solve_continuous_lyapunov

from backsight.models import Dae, InputError, compile_model
from backsight.models.augmentation import SHAPES, coloured, stationary_std
from backsight.models.plants import xy_table

TAU = 0.3
PLANT = compile_model(oscillator())


def driven(dae: Dae) -> tuple[np.ndarray, np.ndarray]:
    """A and G of x' = A x + G w at rest."""
    unknown = ca.vertcat(dae.dx, dae.z)
    parts = [ca.jacobian(dae.residual, part) for part in (unknown, dae.x, dae.w)]
    at = ca.Function("at", [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.w, dae.t], parts)
    E, A, G = (m.full() for m in at(0, 0, 0, 0, dae.parameter_values(), 0, 0))
    nx = dae.x.shape[0]
    return -np.linalg.solve(E, A)[:nx], -np.linalg.solve(E, G)[:nx]


@pytest.mark.parametrize("shape", SHAPES)
def test_a_noise_of_density_one_gives_a_force_of_rms_one_with_the_covariance_of_its_name(shape):
    dae = coloured(PLANT, "mass", TAU, shape)
    A, G = driven(dae)
    own = [i for i, q in enumerate(dae.states) if "residual.mass" in q.name]
    A, G = A[np.ix_(own, own)], G[own]
    P = solve_continuous_lyapunov(A, -G @ G.T)
    stds = stationary_std("mass", 1.0, TAU, shape)
    assert [q.name for q in dae.states][2:] == list(stds)
    assert np.allclose(P, np.diag([s**2 for s in stds.values()]), rtol=1e-12, atol=1e-12)
    for lag in (0.05, 0.4):
        said = np.exp(-lag / TAU) if shape == "ou" else (1 + np.sqrt(3) * lag / TAU) * np.exp(-np.sqrt(3) * lag / TAU)
        assert (expm(A * lag) @ P)[0, 0] == pytest.approx(said, rel=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_force_pushes_the_body_and_nothing_else_changes(shape):
    dae = coloured(PLANT, "mass", TAU, shape)
    A, G = driven(dae)
    assert A[:2, :2] == pytest.approx(np.array([[0, 1], [-K / M, -D / M]]))
    assert A[:2, 2] == pytest.approx([0, 1 / M])
    assert not A[2:, :2].any()
    assert not G[:2].any()
    assert [p.name for p in dae.places] == ["mass"]
    assert dae.places[0].unit == dae.states[2].unit == "N"
    assert dae.kinematics[: len(PLANT.kinematics)] == PLANT.kinematics


def test_the_row_of_the_balance_says_whose_force_is_in_it_and_the_shaping_row_carries_the_noise():
    dae = coloured(PLANT, "mass", TAU)
    (balance,) = (r for r, e in enumerate(PLANT.equations) if e.place == 0)
    assert (dae.equations[balance].place, dae.equations[balance].shaped) == (None, 0)
    assert [e.place for e in dae.equations].count(0) == 1
    assert dae.equations[-1].place == 0


def test_places_are_coloured_one_by_one():
    plant = compile_model(xy_table())
    first, second = (p.name for p in plant.places[:2])
    dae = coloured(coloured(plant, first, 0.1), second, 0.2, "matern")
    A, _ = driven(dae)
    nx = len(plant.states)
    assert np.sort(np.linalg.eigvals(A[nx:, nx:]).real) == pytest.approx(np.sort([-10.0, *[-np.sqrt(3) / 0.2] * 2]), rel=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"place": "mas"}, "no such place; did you mean 'mass'?"),
        ({"tau": 0.0}, "a correlation time is positive and finite"),
        ({"tau": np.inf}, "a correlation time is positive and finite"),
        ({"shape": "pink"}, "a coloured force is 'ou' or 'matern'"),
    ],
)
def test_it_says_what_cannot_be(change, message):
    with pytest.raises(InputError) as caught:
        coloured(**{"dae": PLANT, "place": "mass", "tau": TAU} | change)
    assert message in str(caught.value)


def test_a_force_has_one_colour():
    with pytest.raises(InputError, match="has a colour already"):
        coloured(coloured(PLANT, "mass", TAU), "mass", TAU)
