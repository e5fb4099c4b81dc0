"""Models of any size: what they cost to compile should grow as they do."""

from __future__ import annotations

from backsight.models import Component, Model
from backsight.models.mechanics.rotational import Gear, Inertia, Torque
from backsight.models.mechanics.translational import Damper, Force, Mass, PositionSensor, Spring


def mass_chain(size: int) -> Model:
    """Masses joined by springs and dampers, pushed at one end and measured at the other."""
    parts: dict[str, Component] = {"motor": Force(), "encoder": PositionSensor()}
    joints = [("motor.flange", "mass_1.flange"), ("encoder.flange", f"mass_{size}.flange")]
    for i in range(1, size + 1):
        parts[f"mass_{i}"] = Mass(m=1.0 + i / size)
    for i in range(1, size):
        parts[f"spring_{i}"], parts[f"damper_{i}"] = Spring(k=10.0), Damper(d=0.1)
        for element in ("spring", "damper"):
            joints += [(f"mass_{i}.flange", f"{element}_{i}.flange_a"), (f"{element}_{i}.flange_b", f"mass_{i + 1}.flange")]
    return Model(name=f"masses_{size}", components=parts, connections=joints, inputs={"F": "motor.f"}, outputs={"x": "encoder.s"})


def gear_train(size: int, ratio: float = 1.01) -> Model:
    """Inertias coupled rigidly by gears, each turning `ratio` times as fast as the next: one coordinate."""
    parts: dict[str, Component] = {"motor": Torque()}
    joints = [("motor.flange", "inertia_1.flange")]
    for i in range(1, size + 1):
        parts[f"inertia_{i}"] = Inertia(J=1.0 + i / size)
    for i in range(1, size):
        parts[f"gear_{i}"] = Gear(ratio=ratio)
        joints += [(f"inertia_{i}.flange", f"gear_{i}.flange_a"), (f"gear_{i}.flange_b", f"inertia_{i + 1}.flange")]
    outputs = {"phi": f"inertia_{size}.phi"}
    return Model(name=f"gears_{size}", components=parts, connections=joints, inputs={"T": "motor.tau"}, outputs=outputs)
