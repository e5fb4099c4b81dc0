"""Outputs that lag, against the Taylor series and the motion itself."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from examples import compiled, lagged, shaken

from backsight.models import Dae, InputError
from backsight.models.augmentation.delay import delayed, late_inputs, with_samples_moved

S, V, A = 0.3, -1.2, 7.0  # position, velocity and acceleration at an instant


def read(dae: Dae, output: str, **delays: float) -> float:
    """An output at that instant, by name of the parameter's output."""
    names = [q.name for q in dae.states]
    x, dx = np.zeros(len(names)), np.zeros(len(names))
    x[names.index("mass.s")], x[names.index("mass.v")] = S, V
    dx[names.index("mass.s")], dx[names.index("mass.v")] = V, A
    p = dae.parameter_values({f"delay:{name}": d for name, d in delays.items()})
    value = dae.function()(dx, x, np.zeros(dae.z.shape[0]), np.zeros(dae.u.shape[0]), p, np.zeros(dae.w.shape[0]), 0.0)[1]
    return float(value[[q.name for q in dae.outputs].index(output)])


def test_a_position_lags_to_second_order_and_a_velocity_to_first():
    dae, d = delayed(delayed(compiled(lagged()), "x"), "v"), 0.01
    assert read(dae, "x", x=d) == pytest.approx(S - d * V + d**2 / 2 * A, rel=1e-12)
    assert read(dae, "v", v=d) == pytest.approx(V - d * A, rel=1e-12)
    assert (read(dae, "x"), read(dae, "v")) == pytest.approx((S, V), rel=1e-12)


def test_the_rest_of_the_model_is_as_it_was_and_the_parameter_comes_last():
    dae = compiled(lagged())
    more = delayed(dae, "x")
    assert more.parameters[:-1] == dae.parameters
    assert (more.parameters[-1].name, more.parameters[-1].unit, more.parameters[-1].value) == ("delay:x", "s", 0.0)
    assert more.p.shape[0] == dae.p.shape[0] + 1
    assert ca.is_equal(more.residual, dae.residual)


def test_moving_the_samples_moves_where_it_is_expanded_and_not_the_delay():
    dae = with_samples_moved(with_samples_moved(delayed(compiled(lagged()), "x"), "x", 0.03), "x", 0.01)
    d = 0.042
    assert read(dae, "x", x=0.04) == pytest.approx(S, rel=1e-12)
    assert read(dae, "x", x=d) == pytest.approx(S - (d - 0.04) * V + (d - 0.04) ** 2 / 2 * A, rel=1e-12)


def test_late_inputs_are_outputs_that_all_lag_alike():
    dae, d = late_inputs(compiled(lagged())), 0.01
    assert read(dae, "x", inputs=d) == pytest.approx(S - d * V + d**2 / 2 * A, rel=1e-12)
    assert read(dae, "v", inputs=d) == pytest.approx(V - d * A, rel=1e-12)
    assert read(with_samples_moved(dae, "inputs", d), "v", inputs=d) == pytest.approx(V, rel=1e-12)
    with pytest.raises(InputError, match="the output x has a delay already"):
        delayed(dae, "x")


def test_what_cannot_lag_is_refused():
    with pytest.raises(InputError, match="has no such output"):
        delayed(compiled(lagged()), "y")
    with pytest.raises(InputError, match="has a delay already"):
        delayed(delayed(compiled(lagged()), "x"), "x")
    with pytest.raises(InputError, match="depends on more than the states"):
        delayed(compiled(shaken()), "a")
    with pytest.raises(InputError, match="no such delay"):
        with_samples_moved(compiled(lagged()), "x", 0.1)
    with pytest.raises(InputError, match="is finite"):
        with_samples_moved(delayed(compiled(lagged()), "x"), "x", float("nan"))
