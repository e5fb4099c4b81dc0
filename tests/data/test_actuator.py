"""The simulated axis with any parameters: against the axis of the bundled recordings, which another program integrates, and by hand."""

from dataclasses import replace

import numpy as np
import pytest

from backsight.data.generators.actuator import CONDITIONS, Carriage, record
from backsight.data.generators.sliding import Body, Motion, respond

QUIET = replace(CONDITIONS, duration=1.0, process={})


@pytest.mark.parametrize("along", ["random", "strokes"])
def test_it_moves_like_the_axis_of_the_bundled_recordings_under_the_same_forces(along: str) -> None:
    carriage = Carriage(m=80.0, d=150.0, f_c=30.0, f_0=5.0)
    run = record(carriage, seed=1, along=along, conditions=QUIET)
    x, v = respond(Body(m=80.0, d=150.0, f_c=30.0), run.inputs["F"][:-1] - 5.0, QUIET.step, Motion())
    assert (v == 0).sum() > 1
    assert np.abs(run.truth["carriage.s"] - x).max() < 1e-12
    assert np.abs(run.truth["carriage.v"] - v).max() < 1e-12


def test_a_spring_of_the_caller_takes_up_energy() -> None:
    """F dx = d(m v^2/2 + k x^2/2) + d v^2 dt + f_c |dx| + f_0 dx."""
    carriage, k = Carriage(), 2000.0
    run = record(carriage, seed=2, conditions=QUIET, force=lambda _t, q, _v: -k * q)
    x, v, step = run.truth["carriage.s"], run.truth["carriage.v"], np.diff(run.truth["carriage.s"])
    work = run.inputs["F"][:-1] @ step
    heat = carriage.d * ((v[1:] ** 2 + v[1:] * v[:-1] + v[:-1] ** 2) / 3).sum() * QUIET.step + carriage.f_c * np.abs(step).sum()
    stored = carriage.m * v[-1] ** 2 / 2 + k * x[-1] ** 2 / 2 + carriage.f_0 * x[-1]
    assert k * (x**2).max() / 2 > 0.05 * abs(work)
    assert stored + heat == pytest.approx(work, rel=1e-4)


def test_breakaway_above_sliding_holds_it_longer() -> None:
    """Under a slowly growing force the start comes at f_st."""
    ramp = replace(QUIET, duration=0.5)

    def push(t: float, _q: np.ndarray, _v: np.ndarray) -> np.ndarray:
        return np.array([100.0 * t])

    from backsight.data.generators.servo import Servo

    idle = Servo(k_p=0.0, k_d=0.0, lag=0.004, limit=1.0, resolution=0.01, step=1e-3)
    for f_st, start in ((20.0, 0.2), (35.0, 0.35)):
        v = record(Carriage(f_c=20.0, f_0=0.0, f_st=f_st), conditions=ramp, servo=idle, force=push).truth["carriage.v"]
        assert abs(np.flatnonzero(v)[0] - start / 1e-3) <= 1.5


def test_a_motion_that_is_not_known_is_refused() -> None:
    with pytest.raises(ValueError, match='"random" or "strokes"'):
        record(along="circle", conditions=QUIET)
