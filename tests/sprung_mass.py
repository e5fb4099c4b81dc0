"""A load on a spring and a damper that a motor pushes and a scale sees: the machine of the tests that simulate it themselves."""

from __future__ import annotations

from backsight.models import Model
from backsight.models.mechanics.translational import Damper, Fixed, Force, Mass, PositionSensor, Spring


def machine() -> Model:
    return Model(
        name="machine",
        components={
            "load": Mass(),
            "spring": Spring(k=1.0),
            "damper": Damper(),
            "wall": Fixed(),
            "motor": Force(),
            "scale": PositionSensor(),
        },
        connections=[
            ("motor.flange", "load.flange"),
            ("spring.flange_a", "load.flange"),
            ("damper.flange_a", "load.flange"),
            ("spring.flange_b", "wall.flange"),
            ("damper.flange_b", "wall.flange"),
            ("scale.flange", "load.flange"),
        ],
        inputs={"F": "motor.f"},
        outputs={"x": "scale.s"},
    )
