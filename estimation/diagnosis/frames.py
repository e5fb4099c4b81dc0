"""The library of bodies that move in a plane or in space: a tilted plane, drag, masses off their centre, rotors, given forces."""

from __future__ import annotations

from typing import Any

import numpy as np

from backsight.models import Model
from backsight.models.mechanics import planar, spatial
from backsight.models.mechanics.spatial.rotation import Vector, velocities

from .candidates import Candidate, Exchange, Insert
from .places import free_name

FORCES = ("f_x", "f_y", "f_z")


class LinearDrag(spatial.LinearDrag):
    """In air that rests: no heading is needed to tell it, which no sensor of the body may show."""

    def air_velocity(self, c: Any) -> Vector:
        """Velocity of the body, in its axes."""
        return velocities(c.frame)[0]


class QuadraticDrag(spatial.QuadraticDrag):
    """In air that rests."""

    def air_velocity(self, c: Any) -> Vector:
        """Velocity of the body, in its axes."""
        return velocities(c.frame)[0]


def of_frames(model: Model) -> list[Candidate]:
    """All of them for a model."""
    found = list[Candidate]()
    for name, component in model.components.items():
        if isinstance(component, planar.World) and not component.parameters["tilt"]:
            found.append(_tilted(name))
        if isinstance(component, spatial.RigidBody):
            found += _rigid_body(model, name, component)
        if type(component) is spatial.Propeller:
            found += _propeller(model, name, component)
    return found


def _tilted(world: str) -> Candidate:
    """Gravity in a plane that was thought to be horizontal: linear in g tilt (cos, sin) of its direction."""
    return Candidate(
        place=world,
        family="potential",
        physics="gravity",
        strengths=(f"{world}.tilt",),
        quadrature=f"{world}.direction",
        start={f"{world}.direction": (-np.pi / 2, -4 * np.pi, 4 * np.pi)},
        named={"tilt": f"{world}.tilt", "direction": f"{world}.direction"},
    )


def _rigid_body(model: Model, body: str, component: spatial.RigidBody) -> list[Candidate]:
    words = ("linear_drag", "quadratic_drag", "constant_force", "coupling")
    drag, square, wind, off = (free_name(model, f"{word}_{body}") for word in words)
    mass = max(component.parameters["m"], 1e-9)
    return [
        Candidate(
            place=body,
            family="fluid",
            physics="linear_drag",
            edits=(Insert(place=body, component=LinearDrag(), name=drag),),
            strengths=(f"{drag}.d",),
            one_sided=True,
            named={"d": f"{drag}.d"},
        ),
        Candidate(
            place=body,
            family="fluid",
            physics="quadratic_drag",
            edits=(Insert(place=body, component=QuadraticDrag(), name=square),),
            strengths=(f"{square}.c",),
            one_sided=True,
            named={"c": f"{square}.c"},
        ),
        Candidate(
            place=body,
            family="external",
            physics="constant_force",
            edits=(Insert(place=body, component=spatial.ConstantBodyForce(), name=wind),),
            strengths=tuple(f"{wind}.{f}" for f in FORCES),
            named={f: f"{wind}.{f}" for f in FORCES},
        ),
        Candidate(
            place=body,
            family="inertia",
            physics="coupling",
            edits=(Insert(place=body, component=spatial.MassOffset(m=mass), name=off),),
            strengths=(f"{off}.x", f"{off}.y"),
            named={"x": f"{off}.x", "y": f"{off}.y"},
        ),
    ]


def _propeller(model: Model, name: str, component: spatial.Propeller) -> list[Candidate]:
    values = {w: component.parameters[w] for w in component.declared_parameters if f"{name}.{w}" not in model.bindings}
    tau = component.parameters["tau"]
    return [
        Candidate(
            place=name,
            family="actuator",
            physics="asymmetric_lag",
            edits=(Exchange(name=name, component=spatial.AsymmetricPropeller(**values, tau_down=tau)),),
            start={f"{name}.tau_down": (tau, tau / 100, tau * 100)},
            named={"tau_down": f"{name}.tau_down"},
            dear=True,
        )
    ]
