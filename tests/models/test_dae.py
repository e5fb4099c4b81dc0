"""The flat model answers what callers ask of its rows."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from examples import compiled, lagged, shaken

DAES = [compiled(lagged()), compiled(shaken())]


@pytest.mark.parametrize("dae", DAES, ids=[d.name for d in DAES])
def test_the_row_of_a_place_is_the_one_row_that_its_residual_force_enters_with_minus_one(dae):
    places = list(reversed(range(len(dae.places))))
    slope = np.array(ca.DM(ca.densify(ca.jacobian(dae.residual, dae.w))))
    expected = np.zeros((dae.residual.shape[0], len(places)))
    expected[dae.rows_of(places), places] = -1.0
    np.testing.assert_array_equal(slope, expected)


@pytest.mark.parametrize("dae", DAES, ids=[d.name for d in DAES])
def test_what_is_undisturbed_is_the_same_with_every_residual_force_at_zero(dae):
    rng, free = np.random.default_rng(0), [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.t]
    point = [rng.normal(size=s.shape[0]) for s in free]
    for expression in (dae.residual, dae.output):
        calm = dae.undisturbed(expression)
        assert not ca.depends_on(calm, dae.w)
        whole = ca.Function("whole", [*free, dae.w], [expression])(*point, np.zeros(dae.w.shape[0]))
        np.testing.assert_array_equal(np.array(ca.Function("calm", free, [calm])(*point)), np.array(whole))
