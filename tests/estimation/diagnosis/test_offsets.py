"""Torques that a flight bears on the mean, against what a simulator with a mass off its centre was given."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from backsight.data.generators.concealed.quadrotor import CONDITIONS, Craft, fly, stick
from backsight.data.generators.concealed.rig import Setting
from backsight.data.generators.quadrotor import G, Pilot
from backsight.data.generators.run import clock
from backsight.estimation import Free, Problem, Recording, smooth
from backsight.estimation.diagnosis.evidence.offsets import (
    PREFIX,
    at_nothing,
    counted_out,
    own_of,
    with_offsets,
    without_idle,
    without_offsets,
)
from backsight.estimation.diagnosis.search.refit import HELD, PATIENT, evidence, settled, with_weights_of
from backsight.estimation.smoothing.begun import Begun
from backsight.models.plants import PLANTS

AXES = ("body.tau_x", "body.tau_y", "body.tau_z")
TRUE = {"body.Ixx": "I_x", "body.Iyy": "I_y", "rotor.tau": "tau", "rotor.gain": "gain"}


@cache
def flown(x: float, y: float) -> tuple[Problem, Craft]:
    """Ten seconds with the centre of mass at (x, y), and guesses a quarter off."""
    craft, pilot, rng = Craft(x=x, y=y), Pilot(), np.random.default_rng(3)
    setting = Setting(conditions=replace(CONDITIONS, duration=10.0), coloured={})
    moves = stick("multisine", clock(setting.conditions, rng), 1.0, pilot, rng)
    trace = fly(craft, pilot, moves, setting, (), rng)
    recording = Recording(
        name="flight",
        time=trace.time,
        inputs=dict(zip(craft.inputs, trace.commands.T, strict=True)),
        outputs=trace.recorded(craft.outputs, ()),
        output_std=CONDITIONS.noise,
    )
    words = {name: getattr(craft.craft, word) for name, word in TRUE.items()}
    known = {"body.m": craft.craft.m, "body.Izz": craft.craft.I_z, "rotor.torque_ratio": craft.craft.torque_ratio, "arm": craft.craft.arm}
    drags = {f"body.drag_{axis}": getattr(craft.craft, f"drag_{axis}") for axis in "wpqr"}
    free = {name: Free(value * factor, min=0.0) for (name, value), factor in zip(words.items(), (1.25, 0.8, 0.8, 1.25), strict=True)}
    return Problem(model=PLANTS["quadrotor"](), recordings=[recording], parameters={**known, **drags, **free}), craft


@cache
def smoothed(x: float, y: float):
    problem, _ = flown(x, y)
    posed = with_offsets(problem)
    return posed, smooth(posed, settings=replace(HELD, options=PATIENT))


@pytest.mark.parametrize("plant", sorted(PLANTS))
def test_only_attitudes_that_nobody_sees_need_them(plant):
    model = PLANTS[plant]()
    t = np.arange(5) * 0.01
    zeros = np.zeros(5)
    recording = Recording(name="still", time=t, inputs=dict.fromkeys(model.inputs, zeros), outputs=dict.fromkeys(model.outputs, zeros))
    problem = Problem(model=model, recordings=[recording])
    given = [p.name.removeprefix(PREFIX) for p in with_offsets(problem).dae.parameters if p.name.startswith(PREFIX)]
    assert given == (list(AXES) if plant == "quadrotor" else [])


@pytest.mark.slow
def test_a_mass_off_its_centre_is_borne_as_a_mean_torque_and_leads_no_parameter_astray():
    """Thrust m g at the frame's centre, (-x, -y) from the mass: torque (0, 0, -m g) x (..) = m g (y, -x) on the mean."""
    x, y = 0.01, -0.006
    posed, result = smoothed(x, y)
    _, craft = flown(x, y)
    assert result.solver.converged
    weight = craft.craft.m * G
    told = [result.parameters[PREFIX + axis].value for axis in AXES]
    assert told[:2] == pytest.approx([weight * y, -weight * x], rel=0.1)
    for name, word in TRUE.items():
        assert result.parameters[name].value == pytest.approx(getattr(craft.craft, word), rel=0.4), name
    _, stay = counted_out(result)
    assert {PREFIX + "body.tau_x", PREFIX + "body.tau_y"} <= set(stay)
    assert counted_out(result, all_of_them=True)[0] < -100.0
    kept = without_idle(posed, result)
    assert all(isinstance(kept.parameters[name], Free) for name in stay)


@pytest.mark.slow
def test_on_a_clean_flight_they_are_counted_out_to_the_evidence_of_the_model_without_them():
    """Evidence of the model alone, of a smoothing without offsets at the same weights."""
    posed, result = smoothed(0.0, 0.0)
    gained, stay = counted_out(result)
    assert gained > 0.0
    assert stay == ()
    plain = settled(flown(0.0, 0.0)[0], without_offsets(result))
    alone = with_weights_of(result.solution, plain)
    other = smooth(alone, settings=HELD, begin=Begun.of(result.solution, alone))
    assert other.solver.converged
    assert evidence(posed, result) == pytest.approx(evidence(alone, other), abs=1.0)
    idle = without_idle(posed, result)
    assert [idle.parameters[PREFIX + axis] for axis in AXES] == [0.0, 0.0, 0.0]
    assert set(own_of(posed)) == set(flown(0.0, 0.0)[0].parameters)
    assert all(p.value == 0.0 for name, p in at_nothing(result).parameters.items() if name.startswith(PREFIX))
