"""Commands beyond what an actuator can do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from friction_axis import FrictionAxis

from backsight.estimation import InputColumn, Recording, Weights, smooth
from backsight.estimation.tracking import Estimator, Sample
from backsight.models.errors import InputError


@pytest.fixture(scope="module")
def saturated():
    """An axis whose recorded command is up to three times what its amplifier gives, as a problem with limits and one that knows none."""
    axis = FrictionAxis(count=300)
    most = float(np.abs(axis.force).max())
    command = np.where(np.abs(axis.force) > 0.5 * most, 3.0 * axis.force, axis.force)
    acted = np.clip(command, -0.5 * most, 0.5 * most)
    log = replace(axis.problem.recordings[0], inputs={"F": command})
    weights = Weights(W={"carriage": axis.FORCE_STD})
    posed = replace(axis.problem, weights=weights)
    limited = replace(posed, recordings=[replace(log, limits={"F": (-0.5 * most, 0.5 * most)})])
    return limited, replace(posed, recordings=[replace(log, inputs={"F": acted})]), command, acted


def test_smoothing_sees_what_acted(saturated):
    limited, acting, *_ = saturated
    ours, theirs = smooth(limited), smooth(acting)
    for name in ("friction.f_c", "offset.f"):
        assert ours.parameters[name].value == pytest.approx(theirs.parameters[name].value, rel=1e-9)


def test_on_line_raw_commands_are_cut_off_too(saturated):
    limited, acting, command, acted = saturated
    log = limited.recordings[0]
    ours, theirs = Estimator(limited, samples=20), Estimator(acting, samples=20)
    for k in range(60):
        outputs = {"x": float(log.outputs["x"][k])}
        if k % 3 == 2:
            middle = float(log.time[k]) - 0.005
            ours.hold(middle, {"F": float(command[k])})
            theirs.hold(middle, {"F": float(acted[k])})
        found = ours.update(Sample(time=float(log.time[k]), inputs={"F": float(command[k])}, outputs=outputs))
        known = theirs.update(Sample(time=float(log.time[k]), inputs={"F": float(acted[k])}, outputs=outputs))
        np.testing.assert_array_equal([*found.states, *found.parameters], [*known.states, *known.parameters])


def test_limits_that_are_none_are_refused():
    axis = FrictionAxis(count=20)
    log = axis.problem.recordings[0]
    with pytest.raises(InputError, match="limits of input F are 5 and -5; the least comes first"):
        replace(log, limits={"F": (5.0, -5.0)})
    with pytest.raises(InputError, match="limits of G, which is no input; there are F"):
        replace(log, limits={"G": (-5.0, 5.0)})


def test_limits_of_a_column_are_si(tmp_path):
    (tmp_path / "r.csv").write_text("t_s,F_kN,x_m\n0,-4,0\n0.1,1.5,0\n0.2,9,0\n0.3,0,0\n")
    column = InputColumn("F_kN", "kN", limits=(-2000.0, 3000.0))
    log = Recording.read(tmp_path / "r.csv", time="t_s", inputs={"F": column}, outputs={"x": "x_m"}, units={"F": "N", "x": "m"})
    np.testing.assert_allclose(log.inputs["F"], [-2000.0, 1500.0, 3000.0, 0.0])
