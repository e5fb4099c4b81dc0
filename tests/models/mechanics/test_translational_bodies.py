"""Sliding bodies and the ground against solutions by hand."""

import numpy as np
import pytest
from one_dimensional import T, body_with

from backsight.models import Model, compile_model, simulate
from backsight.models.mechanics.translational import AddedMass, Fixed, Force, Mass, Spring


def test_a_mass_falls_with_constant_acceleration() -> None:
    model = Model(
        name="free",
        components={"motor": Force(), "body": Mass(m=4.0)},
        connections=[("motor.flange", "body.flange")],
        inputs={"F": "motor.f"},
    )
    result = simulate(compile_model(model), T, {"F": 6.0}, initial={"body.s": 1.0, "body.v": -2.0})
    assert result.states["body.s"] == pytest.approx(1.0 - 2.0 * T + 0.75 * T**2, rel=1e-10)
    assert result.states["body.v"] == pytest.approx(-2.0 + 1.5 * T, rel=1e-10, abs=1e-12)


def test_an_added_mass_makes_a_body_heavier_and_nothing_else() -> None:
    bare = compile_model(body_with(Spring(k=50.0)))
    dae = compile_model(body_with(Spring(k=50.0)).insert("body", AddedMass(m=6.0), name="extra"))
    assert [q.name for q in dae.states] == [q.name for q in bare.states]
    assert [p.name for p in dae.places] == ["body"]
    result = simulate(dae, T, {"F": 0.0}, initial={"body.s": 0.4})
    assert result.states["body.s"] == pytest.approx(0.4 * np.cos(2.5 * T), rel=1e-8, abs=1e-10)


def test_ground_takes_the_force_of_what_is_fixed_to_it() -> None:
    model = Model(
        name="held",
        components={"motor": Force(), "ground": Fixed()},
        connections=[("motor.flange", "ground.flange")],
        inputs={"F": "motor.f"},
        outputs={"reaction": "ground.flange.f"},
    )
    assert simulate(compile_model(model), [0.0, 1.0], {"F": [2.0, 3.0]}).outputs["reaction"].tolist() == [2.0, 3.0]
