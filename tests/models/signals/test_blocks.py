"""Blocks without memory: what they say of given inputs, worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from backsight.models import Component, Model, ModelError, SignalInput, compile_model, simulate
from backsight.models.signals import Constant, DeadZone, Drift, Gain, Offset, PeriodicError, Rotation, Saturation, Sine, Sum

T = np.linspace(0.0, 2.0, 9)
U = np.array([-3.0, -1.2, -1.0, -0.4, 0.0, 0.4, 1.0, 1.2, 3.0])


def output(block: Component, parameters: dict[str, float] | None = None, **inputs: np.ndarray) -> np.ndarray:
    """The output of a block alone, at the samples T."""
    told = {word: f"block.{word}" for word, s in block.declared_signals.items() if isinstance(s, SignalInput)}
    model = Model(name="alone", components={"block": block}, inputs=told, outputs={"y": "block.y"})
    return simulate(compile_model(model), T, inputs, parameters).outputs["y"]


def test_a_constant_says_the_same_at_all_times() -> None:
    assert output(Constant(value=4.5)).tolist() == [4.5] * len(T)


def test_a_sine_has_its_amplitude_frequency_phase_and_mean() -> None:
    truth = 0.5 + 2.0 * np.sin(2 * np.pi * 0.7 * T + 0.3)
    assert output(Sine(amplitude=2.0, frequency=0.7, phase=0.3, offset=0.5)) == pytest.approx(truth, abs=1e-14)


def test_gain_offset_and_drift_are_the_errors_of_a_sensor() -> None:
    assert output(Gain(gain=0.98), u=U) == pytest.approx(0.98 * U, abs=1e-15)
    assert output(Offset(bias=-0.2), u=U) == pytest.approx(U - 0.2, abs=1e-15)
    assert output(Drift(rate=0.1), u=U) == pytest.approx(U + 0.1 * T, abs=1e-15)
    assert output(Drift(rate=0.1, t_0=0.3), u=U) == pytest.approx(U + 0.1 * (T - 0.3), abs=1e-15)


def test_a_disk_that_is_not_centred_reads_too_much_and_too_little_once_a_turn() -> None:
    assert output(PeriodicError(amplitude=0.05, phase=0.4), u=U) == pytest.approx(U + 0.05 * np.sin(U + 0.4), abs=1e-15)
    assert output(PeriodicError(amplitude=0.05, period=0.5), u=U) == pytest.approx(U + 0.05 * np.sin(4 * np.pi * U), abs=1e-14)
    assert output(PeriodicError(), u=U).tolist() == U.tolist()


def test_a_sum_with_a_weight_of_minus_one_is_a_difference() -> None:
    assert output(Sum(k_2=-1.0), u_1=U, u_2=T) == pytest.approx(U - T, abs=1e-15)


def test_axes_that_are_turned_read_one_vector() -> None:
    told, a = {"u_1": "block.u_1", "u_2": "block.u_2"}, 0.3
    read = {"y_1": "block.y_1", "y_2": "block.y_2"}
    model = Model(name="alone", components={"block": Rotation(angle=a)}, inputs=told, outputs=read)
    y = simulate(compile_model(model), T, {"u_1": U, "u_2": T}).outputs
    assert y["y_1"] + 1j * y["y_2"] == pytest.approx((U + 1j * T) * np.exp(-1j * a), abs=1e-14)


def test_a_saturation_clips_where_a_simulation_makes_its_corners_sharp() -> None:
    assert output(Saturation(limit=1.2), u=U) == pytest.approx(np.clip(U, -1.2, 1.2), abs=1e-6)


def test_a_dead_zone_has_no_effect_within_its_width_and_loses_it_beyond() -> None:
    truth = np.where(np.abs(U) <= 0.7, 0.0, U - 0.7 * np.sign(U))
    assert output(DeadZone(width=0.7), u=U) == pytest.approx(truth, abs=1e-6)


@pytest.mark.parametrize("rounding", [0.3, 0.01])
def test_a_rounded_corner_is_off_by_half_the_rounding_and_less_elsewhere(rounding: float) -> None:
    rounded = output(Saturation(limit=2.0), {"block.rounding": rounding}, u=U)
    error = np.abs(rounded - np.clip(U, -2.0, 2.0))
    assert error.max() <= rounding * 2.0 / 2
    [corner] = output(Saturation(limit=2.0), {"block.rounding": rounding}, u=np.full(len(T), 2.0))[:1]
    assert corner == pytest.approx(2.0 - rounding * 2.0 / 2, abs=rounding**2 / 2)
    assert np.abs(rounded).max() < 2.0
    assert rounded == pytest.approx(-rounded[::-1], abs=1e-15)


def test_a_limit_of_zero_is_refused() -> None:
    with pytest.raises(ModelError, match=r"Saturation\(limit=0.0\)"):
        Saturation(limit=0.0)
