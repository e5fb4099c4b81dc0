"""The closed loop of concealed machines: accuracy, onsets, and how strong it says that an effect is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backsight.data.generators.concealed.acting import InputFault
from backsight.data.generators.concealed.actuator import CONDITIONS, Axis, position
from backsight.data.generators.concealed.effects import Coulomb, Effect, laws, on
from backsight.data.generators.concealed.rig import Setting, Trace, disturbance, operate, shares
from backsight.data.generators.concealed.sensing import SensorFault
from backsight.data.generators.run import clock
from backsight.data.generators.sliding import Body, Motion, respond

AXIS = Axis(m=90.0, d=200.0, f_c=20.0)
SETTING = Setting(conditions=replace(CONDITIONS, duration=1.5), coloured={})


def run(*effects: Effect, axis: Axis = AXIS, setting: Setting = SETTING) -> Trace:
    time = clock(setting.conditions, np.random.default_rng(0))
    control = position("steps", time, setting.conditions.step, 0.5, np.random.default_rng(1))
    return operate(axis, control, setting, effects, np.random.default_rng(0))


def test_it_sticks_and_slides_like_another_programs_axis_under_the_same_forces() -> None:
    trace = run()
    x, v = respond(Body(m=90.0, d=200.0, f_c=20.0), trace.commands[:-1, 0], CONDITIONS.step, Motion())
    assert (v == 0).sum() > 5
    assert np.abs(trace.q[:, 0] - x).max() < 1e-11


def test_coulomb_friction_of_an_effect_sticks_like_that_of_the_machine() -> None:
    """The commands follow the readings, so that both loops are the same as long as they agree to the last step of the drive."""
    hidden = run(Effect(place="", physics="", friction=(Coulomb(i=0, level=8.0),)))
    open_ = run(axis=replace(AXIS, f_c=28.0))
    assert np.array_equal(hidden.v == 0, open_.v == 0)
    assert np.array_equal(hidden.q, open_.q)


def test_until_its_onset_nothing_is_different() -> None:
    before = run().q[:, 0]
    for effect in (
        Effect(place="", physics="", friction=(Coulomb(i=0, level=8.0),), onset=0.8),
        Effect(place="", physics="", force=on(0, 1, laws.constant(9.0)), onset=0.8),
        Effect(place="", physics="", inputs={"F": InputFault(gain=0.8)}, onset=0.8),
    ):
        after = run(effect).q[:, 0]
        row = round(0.8 / CONDITIONS.step)
        assert np.array_equal(after[: row + 1], before[: row + 1])
        assert np.abs(after[row + 1 :] - before[row + 1 :]).max() > 1e-6


@pytest.mark.slow
def test_half_the_step_gives_the_same_motion_of_an_elastic_screw(monkeypatch: pytest.MonkeyPatch) -> None:
    """Under the same forces, without noise in the loop; the error of the usual step is a fiftieth of the noise of 5e-6 m."""
    quiet = replace(SETTING, conditions=replace(SETTING.conditions, duration=0.7, noise={"x": 1e-12}))
    for screw in (replace(AXIS, k=1e6, d_s=300.0), replace(AXIS, k=1e6, gap=2e-4), replace(AXIS, sigma_0=9e4)):
        trace = run(axis=screw, setting=quiet)

        class Again:
            def command(self, k: int, _readings: np.ndarray, trace: Trace = trace) -> np.ndarray:
                return trace.commands[k]

        with monkeypatch.context() as patch:
            patch.setattr(Axis, "substeps", 24)
            finer = operate(screw, Again(), quiet, (), np.random.default_rng(0))
        assert np.abs(trace.clean - finer.clean).max() < 1e-7


def test_a_machine_without_effects_lacks_nothing() -> None:
    assert shares(AXIS, AXIS, run())["carriage"] < 1e-12


def test_the_share_of_a_damper_is_its_rms_force_over_that_of_the_motor() -> None:
    trace = run(Effect(place="", physics="", force=on(0, 1, laws.viscous(30.0))))
    moves = trace.v[:, 0] != 0
    expected = 30 * np.sqrt((trace.v**2).mean() / (trace.commands**2).mean())
    assert moves.mean() > 0.5
    assert shares(AXIS, AXIS, trace)["carriage"] == pytest.approx(expected, rel=1e-6)


def test_the_share_of_an_input_fault_is_what_the_motor_does_not_do() -> None:
    trace = run(Effect(place="", physics="", inputs={"F": InputFault(gain=0.9)}))
    assert trace.acted == pytest.approx(0.9 * trace.commands)
    assert shares(AXIS, AXIS, trace)["carriage"] == pytest.approx(0.1, rel=0.05)


def test_sensors_err_in_the_recording_alone() -> None:
    effect = Effect(place="", physics="", sensors={"x": SensorFault(gain=1.1)})
    with_fault, without = run(effect), run()
    assert np.array_equal(with_fault.q, without.q)
    difference = with_fault.recorded(("x",), (effect,))["x"] - without.recorded(("x",), ())["x"]
    assert difference == pytest.approx(0.1 * without.q[:, 0], abs=1e-15)


def test_a_coloured_force_has_its_rms_and_its_memory() -> None:
    setting = Setting(conditions=replace(CONDITIONS, duration=400.0), coloured={"carriage": 2.0}, tau=0.05)
    time = clock(setting.conditions, np.random.default_rng(0))
    force = disturbance(setting, ("carriage",), 1, time, np.random.default_rng(2))[:, 0]
    lag = round(0.05 / CONDITIONS.step)
    assert force.std() == pytest.approx(2.0, rel=0.03)
    assert (force[lag:] * force[:-lag]).mean() / force.var() == pytest.approx(np.exp(-1), abs=0.05)
