"""Friction that grows with the load: which loads a body has, and a coefficient that comes back from a motion integrated step by step."""

from __future__ import annotations

import numpy as np
import pytest
from neutral import Point

from backsight.estimation import Free, Problem, Recording, smooth
from backsight.estimation.diagnosis.candidates.laws import Motion
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.candidates.loads import loads, of_loads
from backsight.estimation.diagnosis.candidates.places import bodies
from backsight.estimation.diagnosis.scores.score import Linearised
from backsight.estimation.diagnosis.scores.screen import screen
from backsight.estimation.diagnosis.scores.supermodel import looked_at
from backsight.estimation.diagnosis.search.refit import begun, evidence, fitted, settled
from backsight.models import Model, compile_model
from backsight.models.mechanics.translational import Force, LoadDependentFriction, Mass, PositionSensor
from backsight.models.plants import PLANTS, actuator

M, D, MU, NOISE = 80.0, 150.0, 0.12, 2e-6


@pytest.mark.parametrize(
    ("plant", "expected"),
    [
        ("actuator", {"carriage": ["motor.f"]}),
        ("drillstring", {"rotary_table": ["string.tau"], "bha": ["string.tau"]}),
        ("five_bar", {"joint_1": ["motor_1.tau"], "joint_2": ["motor_2.tau"]}),
        ("xy_table", {"drive_1": ["spindle.tau"], "drive_2": ["spindle.tau"]}),
    ],
)
def test_loads_are_of_what_drives_a_body_and_of_elements_at_it_but_of_no_friction(plant, expected):
    model = PLANTS[plant]()
    assert {spot.name: there for spot in bodies(model) if (there := loads(model, spot))} == expected


def test_behind_a_soft_screw_the_screw_loads_the_carriage():
    model = actuator("compliant")
    assert {spot.name: loads(model, spot) for spot in bodies(model)} == {"motor_mass": ["motor.f", "screw.f"], "carriage": ["screw.f"]}


def test_two_loads_of_one_element_are_two_candidates_that_can_be_together():
    """Friction between two masses that goes with a load of its own has two forces."""
    model = Model(
        name="pair",
        components={"motor": Force(), "a": Mass(m=1.0), "between": LoadDependentFriction(mu=0.1), "b": Mass(m=2.0),
            "press": Force(), "scale": PositionSensor()},
        connections=[
            ("motor.flange", "a.flange"), ("a.flange", "between.flange_a"), ("between.flange_b", "b.flange"), ("press.flange", "b.flange"),
            ("a.flange", "scale.flange"), ("press.f", "between.load"),
        ],
        inputs={"F": "motor.f", "P": "press.f"},
        outputs={"x": "scale.s"},
    )  # fmt: skip
    spot = next(spot for spot in bodies(model) if spot.name == "a")
    found = of_loads(model, spot, Motion(v_rms=1.0, low=0.0, high=1.0), lambda _: 1.0)
    names = [name for c in found for name in c.brought]
    assert len(names) >= 2
    assert len(set(names)) == len(names)


def test_what_is_no_load_has_no_friction_of_it():
    (spot,) = bodies(actuator())
    assert of_loads(actuator(), spot, Motion(v_rms=1.0, low=0.0, high=1.0), lambda _: 0.0) == []


@pytest.mark.parametrize("plant", ["actuator", "drillstring", "five_bar", "xy_table"])
def test_without_strength_it_changes_nothing(plant):
    model = PLANTS[plant]()
    base, grown = compile_model(model), model
    for spot in bodies(model):
        for c in of_loads(model, spot, Motion(v_rms=1.0, low=0.0, high=1.0), lambda _: 5e-3):
            # of a small drive, too, |load| is no less than the load
            assert c.edits[0].component.parameters["load_width"] == pytest.approx(5e-6)
            grown = c.edited(grown)
    whole = compile_model(grown)
    point = Point(base, 0)
    for a, b in zip(point.told(whole), point.told(), strict=True):
        assert a == pytest.approx(b, abs=1e-9)


@pytest.fixture(scope="module")
def loaded() -> tuple:
    """m v' = F - d v - mu |F| sgn(v) in steps of a fiftieth of a row; F never rests, so that nothing sticks."""
    rng, h, fine = np.random.default_rng(6), 1e-3, 50
    t = h * np.arange(1500)
    F = 60.0 * np.repeat(rng.standard_normal(150), 10)
    s, v, x = 0.0, 0.0, np.zeros(len(t))
    for k, force in enumerate(F):
        x[k] = s
        for _ in range(fine):
            v += (force - D * v - MU * abs(force) * np.sign(v)) / M * h / fine
            s += v * h / fine
    recording = Recording(
        name="axis", time=t, inputs={"F": F}, outputs={"x": x + NOISE * rng.standard_normal(len(t))}, output_std={"x": NOISE}
    )
    known = {"carriage.m": Free(100.0), "friction.d": Free(120.0), "friction.f_c": Free(1.0, min=0.0), "offset.f": 0.0}
    problem = Problem(model=actuator(), recordings=[recording], parameters=known)
    return problem, smooth(problem)


def test_it_is_the_best_friction_there_and_its_coefficient_comes_back(loaded):
    problem, result = loaded
    base = Linearised(result.solution)
    found = screen(base, looked_at(problem, problem.model, base, library(problem, problem.model, result.solution))).found
    first = next(s for s in found if s.candidate.family == "friction")
    assert first.candidate.physics == "load_dependent_friction"
    assert first.estimate == pytest.approx([MU], rel=0.2)
    start = begun(first.candidate, first, {p.name: p.value for p in result.parameters.values()})
    fit = fitted(settled(problem, result), problem.model, result, first.candidate, start)
    mu = fit.result.parameters[first.candidate.strengths[0]]
    assert abs(mu.value - MU) < 4 * mu.std
    assert mu.std < 0.02 * MU
    assert fit.worth.nats > evidence(problem, result) + 50
