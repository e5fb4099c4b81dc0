"""The library of laws for bodies that slide or turn, against the ground and between two flanges, as data.

A law is a component of `models.mechanics` whose force is linear in its strengths; what is not linear is a shape, looked at on a grid that
hangs on how the machine moved: v_rms its velocity, span and middle of its positions.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from math import inf, pi

import numpy as np

from backsight.models import Model
from backsight.models.language import Component
from backsight.models.mechanics import rotational as turning
from backsight.models.mechanics import translational as sliding

from ...smoothing.rest import ROUNDING, VELOCITY_UNITS
from .candidate import Candidate
from .edits import Insert
from .places import RIGID, Spot, at_hand, free_name, lent, own_name, side_by_side

FINEST = 60.0  # periods in the span of the positions up to which all are looked at
SLOWEST, FASTEST = 0.01, 1.0  # velocities at which friction may change, over the rms
SHAPES = 7
STOPS = (0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4)  # of the way: where a stop begins
RESTS = 9  # positions at which a spring may rest
SWUNG = 1.0  # rad: of less a weight beside the axis is a constant and a spring; over a turn and more it is what comes with every turn
SOFT = 1e-14  # N/m or N.m/rad: a stop that is none


@dataclass(frozen=True, kw_only=True)
class Motion:
    """How a place moved: rms velocity, least and largest position [SI]; fine: periods [m or rad] at which what is left over waves most.

    sharp: velocity over which signs are rounded there, None: as where nothing rests.
    """

    v_rms: float
    low: float
    high: float
    fine: tuple[float, ...] = ()
    sharp: float | None = None

    @property
    def width(self) -> float:
        """Velocity over which signs are rounded."""
        return ROUNDING * self.v_rms if self.sharp is None else self.sharp

    @property
    def span(self) -> float:
        """Largest less least position."""
        return self.high - self.low


@dataclass(frozen=True, kw_only=True)
class Law:
    """A member of the library.

    make: kind -> component without effect. strengths, shapes, ...: as in `Candidate`, by the component's own words: "f_c" stands
    for the level, which is tau_c where something turns. absorbs: word of a base law -> own strengths; instead: class of a component that
    was a candidate itself -> its word, and the own strength. carrier: (physics, word) of the law whose force waves. larger: which of two
    strengths is the larger one. later: what comes free, from nothing, once it is in the model. there: (kind of place, motion) -> whether
    there may be such a thing. beside: word of a parameter; of elements side by side, one that has it is the place.
    """

    family: str
    physics: str
    make: Callable[[str], Component]
    strengths: tuple[str, ...]
    one_sided: bool = True
    shapes: Callable[[Motion], Mapping[str, tuple[float, ...]]] = field(default=lambda _: {})
    quadrature: str | None = None
    absorbs: Mapping[str, str] = field(default_factory=dict)
    instead: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    ratio: str | None = None
    carrier: tuple[str, str] | None = None
    larger: tuple[str, str] | None = None
    later: tuple[str, ...] = ()
    label: str = ""
    there: Callable[[str, Motion], bool] = field(default=lambda _kind, _motion: True)
    beside: str = ""


def _velocities(motion: Motion) -> tuple[float, ...]:
    return tuple(float(v) for v in motion.v_rms * np.geomspace(SLOWEST, FASTEST, SHAPES))


def _periods(motion: Motion) -> tuple[float, ...]:
    """Evenly spaced in their inverse, so closely that two neighbours differ by half a period over the span."""
    if not motion.span > 0:
        return ()
    waves = np.arange(1.0, FINEST, 0.5)
    return tuple(float(p) for p in motion.span / waves)


def _stops(motion: Motion, end: float, other: float) -> tuple[float, ...]:
    """Places where a stop may begin, from one end of the way towards the other."""
    return tuple(float(end + share * (other - end)) for share in STOPS) if motion.span > 0 else ()


def _rests(motion: Motion) -> tuple[float, ...]:
    """Positions at which a spring may rest, on the way and beyond: evenly spaced in what is constant of its force over what varies."""
    if not motion.span > 0:
        return ()
    angles = (np.arange(RESTS) + 0.5) * pi / RESTS - pi / 2
    return tuple(float(p) for p in (motion.low + motion.high) / 2 + motion.span / 2 * np.tan(angles))


def _component(slide: str, turn: str, **values: float) -> Callable[[str], Component]:
    def make(kind: str) -> Component:
        made: Component = getattr(sliding, slide)(**values) if kind == "translational" else getattr(turning, turn)(**values)
        return made

    return make


# word of a sliding law -> that of a turning one
TURNED = {"f_c": "tau_c", "f_s": "tau_s", "v_s": "omega_s", "f_plus": "tau_plus", "f_minus": "tau_minus"}
TURNED |= {"f": "tau", "m": "J", "s_rel0": "phi_rel0"}

SPRING = Law(family="potential", physics="spring", make=_component("Spring", "RotationalSpring", k=0.0), strengths=("k",), one_sided=False)

AGAINST_GROUND: tuple[Law, ...] = (
    Law(family="friction", physics="viscous_friction", make=_component("Friction", "RotationalFriction"), strengths=("d",)),
    Law(family="friction", physics="coulomb_friction", make=_component("Friction", "RotationalFriction"), strengths=("f_c",)),
    Law(
        family="friction",
        physics="stribeck_friction",
        make=_component("StribeckFriction", "RotationalStribeckFriction"),
        strengths=("f_c", "f_s"),
        shapes=lambda m: {"v_s": _velocities(m)},
        absorbs={"f_c": "f_c f_s"},
        larger=("f_s", "f_c"),
    ),
    Law(
        family="friction",
        physics="logarithmic_friction",
        make=_component("LogarithmicFriction", "RotationalLogarithmicFriction"),
        strengths=("b", "c"),
        one_sided=False,
        absorbs={"f_c": "c"},
    ),
    Law(
        family="friction",
        physics="asymmetric_friction",
        make=_component("AsymmetricFriction", "RotationalAsymmetricFriction"),
        strengths=("d_plus", "d_minus"),
        absorbs={"d": "d_plus d_minus"},
    ),
    Law(
        family="friction",
        physics="asymmetric_friction",
        make=_component("AsymmetricFriction", "RotationalAsymmetricFriction"),
        strengths=("f_plus", "f_minus"),
        label="asymmetric_level",
        absorbs={"f_c": "f_plus f_minus"},
    ),
    Law(
        family="friction",
        physics="position_dependent_friction",
        make=_component("PositionDependentFriction", "RotationalPositionDependentFriction", amplitude=1.0),
        strengths=("f_c",),
        one_sided=False,
        absorbs={"f_c": "f_c"},
        ratio="amplitude",
        shapes=lambda m: {"period": tuple(p for p in _periods(m) if p > m.span / 12)},
        quadrature="phase",
        carrier=("coulomb_friction", "f_c"),
    ),
    Law(
        family="periodic",
        physics="cogging",
        make=_component("Cogging", "RotationalCogging"),
        strengths=("amplitude",),
        one_sided=False,
        shapes=lambda m: {"period": (*_periods(m), *m.fine)},
        quadrature="phase",
        carrier=("constant_force", "f"),
    ),
    Law(
        family="potential",
        physics="gravity",
        make=_component("", "EccentricWeight"),
        strengths=("tau_sin", "tau_cos"),
        one_sided=False,
        instead={"RotationalSpring": ("k", "tau_sin")},
        label="weight",
        there=lambda kind, m: kind == "rotational" and SWUNG < m.span < 2 * pi,
    ),
    SPRING,
    replace(
        SPRING,
        shapes=lambda m: {"s_rel0": _rests(m)},
        instead={"Spring": ("k", "k"), "RotationalSpring": ("k", "k")},
        label="spring_at_rest",
    ),
    Law(
        family="potential",
        physics="cubic_spring",
        make=_component("CubicSpring", "RotationalCubicSpring"),
        strengths=("k3",),
        one_sided=False,
    ),
    Law(
        family="potential",
        physics="end_stop",
        make=_component("EndStop", "RotationalEndStop", k=SOFT),
        strengths=("k",),
        shapes=lambda m: {"x": _stops(m, m.high, m.low)},
        later=("d",),
    ),
    Law(
        family="potential",
        physics="end_stop",
        make=_component("LowerEndStop", "RotationalLowerEndStop", k=SOFT),
        strengths=("k",),
        shapes=lambda m: {"x": _stops(m, m.low, m.high)},
        later=("d",),
        label="lower_end_stop",
    ),
    Law(family="fluid", physics="quadratic_drag", make=_component("Drag", "RotationalDrag"), strengths=("c",)),
    Law(family="external", physics="constant_force", make=_component("ConstantForce", "ConstantTorque"), strengths=("f",), one_sided=False),
    Law(family="inertia", physics="added_mass", make=_component("AddedMass", "AddedInertia"), strengths=("m",)),
)

# physics, first strength -> the parameter by which one of elements side by side is the place of such a law
_BESIDE = {
    ("coulomb_friction", "f_c"): "d",
    ("asymmetric_friction", "d_plus"): "d",
    ("quadratic_drag", "c"): "d",
    ("cubic_spring", "k3"): "k",
    ("end_stop", "k"): "k",
}
BETWEEN: tuple[Law, ...] = (
    Law(family="transmission", physics="damping", make=_component("Damper", "RotationalDamper", d=0.0), strengths=("d",), beside="d"),
    *(replace(law, beside=word) for what, word in _BESIDE.items() for law in AGAINST_GROUND if (law.physics, law.strengths[0]) == what),
)

OF_STRUTS = ("asymmetric_friction", "quadratic_drag", "end_stop")  # what a long string has not
NAMES = {"f": "f", "tau": "f", "omega_s": "v_s", "J": "m"}  # words of components -> those of findings, where they differ


def of_law(law: Law, model: Model, spot: Spot, motion: Motion, brought: Collection[str] = ()) -> Candidate:
    """The law at a place. brought: components of the model that were candidates themselves."""
    component = rounded(law.make(spot.kind), motion)
    name = free_name(model, f"{law.label or law.physics}_{spot.name}")
    words = (*law.strengths, "v_s", "period", "amplitude", "s_rel0")
    own = {w: TURNED.get(w, w) if spot.kind == "rotational" else w for w in words}
    here = tuple({"d", own.get("f_c", "f_c"), "f_c", "tau_c", *(word for word, _ in law.instead.values())})
    there = at_hand(model, spot, here)
    absorbed = dict[str, str]()
    for kind, (word, strength) in law.instead.items():
        found = [path for path in there.get(word, ()) if path.partition(".")[0] in brought]
        same = [path for path in found if type(model.components[path.partition(".")[0]]).__name__ == kind]
        absorbed |= {own_name(model, path): f"{name}.{strength}" for path in same}
    for word, instead in law.absorbs.items():
        for base in (*there.get(word, ()), *there.get(TURNED.get(word, ""), ())):
            owner, _, parameter = base.rpartition(".")
            if model.components[owner].declared_parameters[parameter].min > 0:
                continue  # a law that cannot be nothing stays
            if lent(model, base):
                continue
            absorbed[own_name(model, base)] = " ".join(f"{name}.{own.get(w, w)}" for w in instead.split())
    shapes = {f"{name}.{own.get(word, word)}": grid for word, grid in law.shapes(motion).items()}
    declared = component.declared_parameters
    strengths = tuple(f"{name}.{own[w]}" for w in law.strengths)
    said = [own[w] for w in law.strengths] + [own.get(w, w) for w in law.shapes(motion)] + [w for w in (law.ratio, law.quadrature) if w]
    return Candidate(
        place=spot.name,
        family=law.family,
        physics=law.physics,
        edits=(Insert(place=flange_of(spot), component=component, name=name),),
        strengths=strengths,
        one_sided=law.one_sided,
        shapes=shapes,
        quadrature=f"{name}.{law.quadrature}" if law.quadrature else None,
        start={path: (grid[0] if grid else 1.0, declared[path.rpartition(".")[2]].min, inf) for path, grid in shapes.items()}
        | ({f"{name}.{law.quadrature}": (0.0, -3 * pi, 3 * pi)} if law.quadrature else {})
        | ({f"{name}.{law.ratio}": (0.5, 0.0, 1.0)} if law.ratio else {}),
        absorbs=absorbed,
        ratio=f"{name}.{law.ratio}" if law.ratio else None,
        wave=_wave(law, spot),
        larger=(f"{name}.{own[law.larger[0]]}", f"{name}.{own[law.larger[1]]}") if law.larger else None,
        later={f"{name}.{w}": (0.0, 0.0, inf) for w in law.later},
        named={NAMES.get(w, w): f"{name}.{w}" for w in said},
    )


def between(law: Law, model: Model, spot: Spot) -> str:
    """The element that a law between two bodies is looked for at, of those side by side with one; "" where there is no such thing."""
    there = side_by_side(model, spot)
    if any(isinstance(model.components[name], RIGID) for name in there):
        return ""  # nothing moves there
    if law.physics in OF_STRUTS and any(isinstance(model.components[name], turning.TorsionString) for name in there):
        return ""
    return next((name for name in there if law.beside in model.components[name].declared_parameters), there[0])


def _wave(law: Law, spot: Spot) -> tuple[str, str] | None:
    """Strength and position of a force that waves along the way."""
    if law.carrier is None:
        return None
    physics, word = law.carrier
    turns = spot.kind == "rotational"
    return f"{physics}_{spot.name}.{TURNED.get(word, word) if turns else word}", f"{spot.name}.{'phi' if turns else 's'}"


def rounded(component: Component, motion: Motion) -> Component:
    """Its sign rounded as smoothing rounds those of the model, so that two laws of one kind are one."""
    declared = component.declared_parameters.get("width")
    if declared is None or not declared.smoothing or declared.unit not in VELOCITY_UNITS:
        return component
    return component.with_values(width=max(motion.width, declared.min))


def flange_of(spot: Spot) -> str:
    """Where a component is inserted there."""
    return spot.name if len(spot.flanges) == 2 else f"{spot.name}.{spot.flanges[0]}"
