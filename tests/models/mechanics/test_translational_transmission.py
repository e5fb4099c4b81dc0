"""Couplings of sliding parts against solutions by hand."""

import numpy as np
import pytest
from one_dimensional import T, run_body

from backsight.models import Model, compile_model, simulate
from backsight.models.mechanics.translational import Backlash, Force, Mass, Rigid


def test_a_rigid_coupling_adds_the_masses() -> None:
    model = Model(
        name="pair",
        components={"motor": Force(), "a": Mass(m=2.0), "joint": Rigid(), "b": Mass(m=3.0)},
        connections=[("motor.flange", "a.flange"), ("a.flange", "joint.flange_a"), ("joint.flange_b", "b.flange")],
        inputs={"F": "motor.f"},
        outputs={"v": "b.v", "f": "joint.f"},
    )
    dae = compile_model(model)
    assert (dae.x.shape[0], dae.z.shape[0]) == (2, 0)
    result = simulate(dae, T, {"F": 10.0})
    assert result.outputs["v"] == pytest.approx(2.0 * T, rel=1e-10, abs=1e-13)
    assert result.outputs["f"] == pytest.approx(np.full(len(T), 6.0))


def test_a_body_in_play_flies_freely_from_one_side_to_the_other() -> None:
    gap, speed, rate = 0.2, 0.5, 100.0
    result = run_body(Backlash(gap=gap, k=2.0 * rate**2), v=speed)
    flight, contact = gap / speed, np.pi / rate
    phase = (T + flight / 2) % (2 * (flight + contact))  # since it left the lower side
    way = np.where(phase < flight + contact, phase, phase - flight - contact)
    up = np.where(way < flight, -gap / 2 + speed * way, gap / 2 + speed / rate * np.sin(rate * (way - flight)))
    assert result.states["body.s"] == pytest.approx(np.where(phase < flight + contact, up, -up), abs=1e-6)


def test_a_body_pushed_through_play_rests_on_its_stiffness() -> None:
    result = run_body(Backlash(gap=0.2, k=5000.0, d=300.0), force=-40.0)
    assert result.states["body.s"][-1] == pytest.approx(-0.1 - 40.0 / 5000.0, rel=1e-6)


def test_play_of_no_gap_is_a_spring() -> None:
    assert run_body(Backlash(gap=0.0, k=50.0), s=0.4).states["body.s"] == pytest.approx(0.4 * np.cos(5.0 * T), rel=1e-7, abs=1e-8)
