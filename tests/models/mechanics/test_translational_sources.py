"""Sources of force and motion against solutions by hand."""

import numpy as np
import pytest
from one_dimensional import T, run_body

from backsight.models import Component, Model, ModelError, compile_model, simulate
from backsight.models.mechanics.translational import (
    Acceleration,
    ConstantForce,
    Fixed,
    ForceSensor,
    Mass,
    Position,
    Speed,
    Spring,
    SpringDamper,
)


def test_a_constant_force_at_a_body_is_a_load() -> None:
    assert run_body(ConstantForce(f=3.0), force=5.0).states["body.v"] == pytest.approx(1.0 * T, rel=1e-10, abs=1e-13)


def moved(source: Component, word: str, element: Component, body: Component | None = None) -> Model:
    """A source, a load cell, an element, and at its end a body, or the ground."""
    end = Fixed() if body is None else body
    return Model(
        name="moved",
        components={"source": source, "cell": ForceSensor(), "element": element, "end": end},
        connections=[("source.flange", "cell.flange_a"), ("cell.flange_b", "element.flange_a"), ("element.flange_b", "end.flange")],
        inputs={"u": f"source.{word}"},
        outputs={"f": "cell.f"},
    )


def test_a_position_source_stretches_a_spring() -> None:
    u = np.sin(3.0 * T)
    assert simulate(compile_model(moved(Position(), "s", Spring(k=20.0))), T, {"u": u}).outputs["f"] == pytest.approx(20.0 * u)


def test_a_body_hangs_on_a_spring_whose_end_is_placed() -> None:
    result = simulate(compile_model(moved(Position(), "s", Spring(k=50.0), Mass(m=2.0))), T, {"u": 0.1})
    assert result.states["end.s"] == pytest.approx(0.1 * (1 - np.cos(5.0 * T)), rel=1e-7, abs=1e-10)


def test_a_speed_source_pulls_a_spring_and_a_damper() -> None:
    result = simulate(compile_model(moved(Speed(), "v", SpringDamper(k=20.0, d=3.0))), T, {"u": 0.5})
    assert result.outputs["f"] == pytest.approx(20.0 * 0.5 * T + 3.0 * 0.5, rel=1e-9)


def test_an_acceleration_source_moves_a_body_with_the_force_that_it_needs() -> None:
    model = Model(
        name="carried",
        components={"source": Acceleration(), "cell": ForceSensor(), "body": Mass(m=4.0)},
        connections=[("source.flange", "cell.flange_a"), ("cell.flange_b", "body.flange")],
        inputs={"u": "source.a"},
        outputs={"f": "cell.f", "s": "body.s"},
    )
    result = simulate(compile_model(model), T, {"u": 1.5}, initial={"source.v": 1.0})
    assert result.outputs["s"] == pytest.approx(T + 0.75 * T**2, rel=1e-9, abs=1e-12)
    assert result.outputs["f"] == pytest.approx(np.full(len(T), 6.0))


@pytest.mark.parametrize(("source", "word"), [(Position(), "s"), (Speed(), "v")])
def test_a_source_of_motion_refuses_what_would_need_the_derivative_of_its_signal(source: Component, word: str) -> None:
    model = Model(
        name="moved",
        components={"source": source, "body": Mass()},
        connections=[("source.flange", "body.flange")],
        inputs={"u": f"source.{word}"},
    )
    with pytest.raises(ModelError, match="would have to be differentiated"):
        compile_model(model)
