"""The library of bodies that move in a plane or in space: a tilted plane, drag, masses off their line or centre, rotors, given forces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from backsight.models import Model
from backsight.models.language import Component
from backsight.models.mechanics import planar, spatial
from backsight.models.mechanics.spatial.rotation import Vector, velocities

from ...problem import Known, Problem
from ...supposed import left_out
from ..evidence.offsets import PREFIX
from .candidate import Candidate
from .edits import Alike, Exchange, Insert
from .places import free_name, grounds, neighbours, node, own_name

WIDEST = 3.0  # times the drag across, at most, that a body has along z
JOINTS, PIECES = (planar.Revolute, planar.Prismatic), (planar.FixedTranslation, planar.FixedRotation)
FORCES, TORQUES = ("f_x", "f_y", "f_z"), ("tau_x", "tau_y", "tau_z")


class StillAir(spatial.Drag):
    """Air that rests: no heading is needed to tell a drag, which no sensor of the body may show."""

    def air_velocity(self, c: Any) -> Vector:
        """Velocity of the body, in its axes."""
        return velocities(c.frame)[0]


class LinearDrag(StillAir, spatial.LinearDrag):
    """In air that rests."""


class QuadraticDrag(StillAir, spatial.QuadraticDrag):
    """In air that rests."""


class DragMoment(StillAir, spatial.DragMoment):
    """In air that rests."""


def with_heading(problem: Problem, model: Model) -> Problem:
    """The problem with the heading of a body that nothing shows, counted from its start: a wind is constant in the axes of the earth."""
    bodies = {f"{name}.psi" for name, component in model.components.items() if isinstance(component, spatial.RigidBody)}
    unseen = {problem.dae.states[one.state].name for one in left_out(problem)} & bodies
    return replace(problem, initial={**problem.initial, **dict.fromkeys(unseen, Known(0.0, always=True))})


def of_frames(model: Model, values: Mapping[str, float]) -> list[Candidate]:
    """All of them for a model. values: of its parameters."""
    found = list[Candidate]()
    for name, component in model.components.items():
        if isinstance(component, planar.World):
            tilt, direction = (own_name(model, f"{name}.{word}") for word in ("tilt", "direction"))
            leans = values.get(tilt, component.parameters["tilt"]) != 0.0
            found.append(_leaning(name, direction, values) if leans else _tilted(name, tilt, direction))
        if isinstance(component, planar.RigidBody):
            found += _beside(name, component, values)
        if isinstance(component, planar.Body) and _swings(model, f"{name}.frame"):
            found += _dragged(model, name, values) + _blown(model, name, values)
        if isinstance(component, spatial.RigidBody):
            found += _rigid_body(model, name, values)
    return found + [c for group in _propellers(model) for c in _rotors(model, group, values)]


def _tilted(world: str, tilt: str, direction: str) -> Candidate:
    """Gravity in a plane that was thought to be horizontal: linear in g tilt (cos, sin) of its direction, parameters of the model."""
    return Candidate(
        place=world,
        family="potential",
        physics="gravity",
        strengths=(tilt,),
        quadrature=direction,
        start={direction: (-np.pi / 2, -4 * np.pi, 4 * np.pi)},
        named={"tilt": tilt, "direction": direction},
    )


def _leaning(world: str, path: str, values: Mapping[str, float]) -> Candidate:
    """Gravity that points another way in a plane that is not horizontal: a rail that is not level pulls along itself."""
    direction = values.get(path, -np.pi / 2)
    return Candidate(
        place=world,
        family="potential",
        physics="gravity",
        strengths=(path,),
        start={path: (direction, direction - np.pi, direction + np.pi)},
        named={"direction": path},
    )


def _beside(link: str, component: planar.RigidBody, values: Mapping[str, float]) -> list[Candidate]:
    """A mass beside the line of a link that has none there: its moment across. What it adds along the line is in the link's own moments."""
    across = f"{link}.{'y_c' if isinstance(component, planar.Body) else 'm_y'}"
    if values.get(across) != 0.0:
        return []
    return [
        Candidate(
            place=link,
            family="inertia",
            physics="added_mass",
            strengths=(across,),
            start={across: (0.0, -np.inf, np.inf)},
            named={across.rpartition(".")[2]: across},
        )
    ]


def _centre(model: Model, body: str, values: Mapping[str, float]) -> dict[str, float]:
    """The centre of mass of a body in its frame [m]."""
    return {word: values.get(own_name(model, f"{body}.{word}"), model.components[body].parameters[word]) for word in ("x_c", "y_c")}


def _blown(model: Model, body: str, values: Mapping[str, float]) -> list[Candidate]:
    """A constant force at the centre of mass of a body that swings at what moves itself, along either axis of the world, or a torque."""
    centre = _centre(model, body, values)
    return [
        Candidate(
            place=body,
            family="external",
            physics="constant_force",
            edits=(Insert(place=body, component=planar.ConstantWorldForce(**centre), name=name),),
            strengths=(f"{name}.{word}",),
            named={word: f"{name}.{word}"},
            rounded={f"{name}.{at}": (own_name(model, f"{body}.{at}"), 1.0) for at in centre} if word in FORCES else {},
        )
        for word in ("f_x", "f_y", "tau")
        if (name := free_name(model, f"constant_{word}_{body}"))
    ]


def _dragged(model: Model, body: str, values: Mapping[str, float]) -> list[Candidate]:
    """Drag at the centre of mass of a body that swings at what moves itself: behind one joint alone, or slides, it is drag at these."""
    centre = _centre(model, body, values)
    kinds: tuple[tuple[str, str, planar.Drag], ...] = (
        ("linear_drag", "d", planar.LinearDrag(**centre)),
        ("quadratic_drag", "c", planar.QuadraticDrag(**centre)),
    )
    return [
        Candidate(
            place=body,
            family="fluid",
            physics=physics,
            edits=(Insert(place=body, component=drag, name=name),),
            strengths=(f"{name}.{word}",),
            one_sided=True,
            named={word: f"{name}.{word}"},
            rounded={f"{name}.{place}": (own_name(model, f"{body}.{place}"), 1.0) for place in centre},
        )
        for physics, word, drag in kinds
        if (name := free_name(model, f"{physics}_{body}"))
    ]


def _swings(model: Model, frame: str) -> bool:
    """Whether several joints, one of them a hinge, or none are between a frame and the ground, and nothing else."""
    held = {f"{name}.frame" for name in grounds(model)}
    count, hinged, ends = 0, False, _rigid_with(model, {frame})
    while not ends & held:
        hinged |= _across(model, ends, (planar.Revolute,)) != ends
        beyond = _rigid_with(model, _across(model, ends, JOINTS))
        if beyond == ends:
            there = [model.components[end.partition(".")[0]] for end in ends]
            return all(len(c.declared_connectors) == 1 or isinstance(c, (*JOINTS, *PIECES)) for c in there)
        count, ends = count + 1, beyond
    return count > 1 and hinged


def _rigid_with(model: Model, ends: set[str]) -> set[str]:
    """All frames that stand still against one of these."""
    while (beyond := _across(model, ends, PIECES)) != ends:
        ends = beyond
    return ends


def _across(model: Model, ends: set[str], kinds: tuple[type[Component], ...]) -> set[str]:
    """These frames, what is joined to them, and what is on the other side of components of these kinds."""
    there = {end for e in ends for end in node(model, e)}
    passed = {end.partition(".")[0] for end in there}
    other = {f"{name}.{side}" for name in passed if isinstance(model.components[name], kinds) for side in ("frame_a", "frame_b")}
    return {end for e in there | other for end in node(model, e)}


def _rigid_body(model: Model, body: str, values: Mapping[str, float]) -> list[Candidate]:
    words = ("linear_drag", "quadratic_drag", "drag_moment", "wind", "constant_force", "constant_torque", "coupling")
    drag, square, moment, wind, force, torque, off = (free_name(model, f"{word}_{body}") for word in words)
    whole = own_name(model, f"{body}.m")  # of all that is off the centre, or x and y would be those of another mass
    mass = max(values.get(whole, model.components[body].parameters["m"]), 1e-9)
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
            shapes={f"{square}.share_z": (0.0, 1.0)},
            start={f"{square}.share_z": (0.0, 0.0, WIDEST)},
            named={"c": f"{square}.c", "share_z": f"{square}.share_z"},
        ),
        Candidate(
            place=body,
            family="fluid",
            physics="drag_moment",
            edits=(Insert(place=body, component=DragMoment(), name=moment),),
            strengths=(f"{moment}.c_x", f"{moment}.c_y"),
            named={"c_x": f"{moment}.c_x", "c_y": f"{moment}.c_y"},
        ),
        Candidate(
            place=body,
            family="external",
            physics="constant_force",
            edits=(Insert(place=body, component=spatial.ConstantBodyForce(), name=force),),
            strengths=tuple(f"{force}.{f}" for f in FORCES),
            named={f: f"{force}.{f}" for f in FORCES},
        ),
        Candidate(
            place=body,
            family="external",
            physics="constant_force",
            edits=(Insert(place=body, component=spatial.ConstantBodyForce(), name=torque),),
            strengths=tuple(f"{torque}.{tau}" for tau in TORQUES),
            absorbs={f"{PREFIX}{body}.{tau}": f"{torque}.{tau}" for tau in TORQUES},
            named={tau: f"{torque}.{tau}" for tau in TORQUES},
        ),
        Candidate(
            place=body,
            family="external",
            physics="constant_force",
            edits=(Insert(place=body, component=spatial.ConstantForce(), name=wind),),
            strengths=(f"{wind}.f",),
            quadrature=f"{wind}.direction",
            start={f"{wind}.direction": (0.0, -4 * np.pi, 4 * np.pi)},
            named={"f": f"{wind}.f", "direction": f"{wind}.direction"},
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


def _propellers(model: Model) -> list[list[str]]:
    """Propellers, those together whose time constant is one parameter."""
    groups: dict[str, list[str]] = {}
    for name, component in model.components.items():
        if type(component) is spatial.Propeller:
            groups.setdefault(model.bindings.get(f"{name}.tau", name), []).append(name)
    return list(groups.values())


def _rotors(model: Model, names: list[str], values: Mapping[str, float]) -> list[Candidate]:
    """What rotors of one kind may do: spin down more slowly than up, having no brake, and turn the body against themselves."""
    first, spins = names[0], [model.components[name].parameters["spin"] for name in names]
    time = own_name(model, f"{first}.tau")
    tau = values.get(time, model.components[first].parameters["tau"])
    slower = f"{time}_down" if time in model.parameters else f"{free_name(model, f'spin_down_{first}')}.tau"
    inertia = f"{time.rpartition('.')[0]}.J"
    exchanged = tuple(Exchange(name=name, component=_spun_down(model, name)) for name in names)
    there = [n for n in sorted(neighbours(model, f"{first}.frame")) if isinstance(model.components[n], spatial.RigidBody)]
    body = there[0] if len(there) == 1 else ""
    parts = tuple(
        Insert(place=body, component=spatial.PropellerInertia(spin=spin), name=own, joined=((f"{name}.thrust", f"{own}.thrust"),))
        for name, spin in zip(names, spins, strict=True)
        if (own := free_name(model, f"inertia_{name}"))
    )
    lag = Candidate(
        place=first,
        family="actuator",
        physics="asymmetric_lag",
        edits=(Alike(parts=exchanged, parameter=slower, word="tau_down", value=tau),),
        strengths=(slower,),
        without={slower: tau},
        start={slower: (tau, tau / 100, tau * 100)},
        named={"tau_down": slower},
    )
    if inertia in model.parameters or not body:
        return [lag]  # it is there already, or nobody knows whose torques they would be
    return [
        lag,
        Candidate(
            place=body,
            family="inertia",
            physics="rotor_inertia",
            edits=(Alike(parts=parts, parameter=inertia, word="J", value=0.0),),
            strengths=(inertia,),
            one_sided=True,
            named={},  # the momentum goes with J/sqrt(k_r), and no model of thrusts tells the speeds
        ),
    ]


def _spun_down(model: Model, name: str) -> spatial.AsymmetricPropeller:
    """The propeller with the values that are its own."""
    values = model.components[name].parameters
    return spatial.AsymmetricPropeller(**{word: value for word, value in values.items() if f"{name}.{word}" not in model.bindings})
