"""The soft rows carry no determinant of the inertia, wherever in the model it stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from examples import M, compiled, number, oscillator, random_horizon, shaken

from backsight.models import Dae
from backsight.models.augmentation import coloured, drifting, measured_input
from backsight.ocp import Horizon
from backsight.ocp.pieces import Pieces
from backsight.ocp.spline import interpolation

PLANT = compiled(oscillator())
CHANGED = 3.0


def rows(dae: Dae, mass: float, **states: float) -> tuple[np.ndarray, np.ndarray]:
    """The soft rows at a random point as they stand and without the determinant, for a mass other than that of reference, M."""
    soft = tuple(range(len(dae.places)))
    horizon = random_horizon(dae, 1)
    pieces = Pieces(dae, interpolation(dae, 2, len(soft)), (horizon,), (0, horizon.mesh.count), soft)
    rng = np.random.default_rng(2)
    v = rng.normal(size=pieces.interpolation.rows)
    for name, value in states.items():
        v[len(dae.states) + [q.name for q in dae.states].index(name.replace("_", "."))] = value
    reference = np.array(dae.parameter_values())
    p = reference.copy()
    p[list(number(dae, "mass.m"))] = mass
    d = rng.normal(size=len(dae.inputs) + 1)
    nx = len(dae.states)
    plain = dae.function()(v[:nx], v[nx : 2 * nx], v[2 * nx :], d[:-1], p, np.zeros(len(soft)), d[-1])[0].full().ravel()
    scaled = pieces.function("scaled", pieces.balances())(v, p, reference, d).full().ravel()
    return plain[pieces.rows_of(soft)], scaled


@pytest.mark.parametrize("kind", ["ou", "matern"])
def test_the_noise_of_a_coloured_force_is_measured_by_the_inertia_that_the_force_moves(kind):
    plain, scaled = rows(coloured(PLANT, "mass", 0.1, kind), CHANGED)
    assert scaled == pytest.approx(M / CHANGED * plain)


def test_rows_without_an_inertia_stay_as_they_are_beside_one_with():
    plain, scaled = rows(measured_input(drifting(PLANT, "spring.k"), "F"), CHANGED)
    assert scaled == pytest.approx(plain * [M / CHANGED, 1.0, 1.0])


def test_an_inertia_that_drifts_is_measured_by_its_entry_among_the_parameters():
    plain, scaled = rows(drifting(PLANT, "mass.m"), M, mass_m=CHANGED)
    assert scaled == pytest.approx(plain * [M / CHANGED, 1.0])


def test_at_the_reference_the_rows_are_the_balances_themselves():
    plain, scaled = rows(measured_input(coloured(PLANT, "mass", 0.1), "F"), M)
    assert scaled == pytest.approx(plain)


def test_a_force_is_read_at_once_by_an_accelerometer_that_is_sampled_and_by_no_encoder():
    dae = compiled(shaken())
    horizon = random_horizon(dae, 1)

    def told(horizon: Horizon) -> list[bool]:
        return list(Pieces(dae, interpolation(dae, 2, 1), (horizon,), (0, horizon.mesh.count), (0,)).read_at_once())

    assert told(horizon) == [True]
    accelerometer = [q.name for q in dae.outputs].index("a")
    without = horizon.target.copy()
    without[:, accelerometer] = np.nan
    assert told(replace(horizon, target=without)) == [False]
