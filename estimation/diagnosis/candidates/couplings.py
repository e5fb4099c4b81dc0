"""The library of couplings that were thought to be rigid or without play: compliance, backlash, a second section of a string.

They bring states of their own, so no score tells of them: they are fitted, from a few stiffnesses. A coupling with a body on one side only
gets one on the other: a part of what was thought to be one mass. A sensor at a coupling may sit on either side of it. A gear or a pulley
between two bodies that stands in the model without any coupling gets one behind it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from backsight.models import Model
from backsight.models.connectors import Translational
from backsight.models.language import Component
from backsight.models.mechanics import rotational as turning
from backsight.models.mechanics import translational as sliding

from .candidate import Candidate
from .edits import Exchange, Rebuild
from .laws import Motion
from .places import RIGID, Spot, free_name, grounds, neighbours, node, own_name, sensors

IDEAL = (turning.Rack, turning.Gear, *RIGID)  # what passes a motion on as it is
SOFT = (sliding.SpringDamper, sliding.Spring, turning.RotationalSpringDamper, turning.RotationalSpring)
WORDS = {"translational": "m", "rotational": "J"}  # what the inertia of a body is called
SHARE = 0.3  # of the mass behind a coupling, that before it where the model has none there
RESONANCES = (8.0, 30.0)  # Hz, of the stiffnesses from which fits start
DAMPING, DAMPING_OF_PLAY = 0.05, 0.3  # ratios
PLAYS = (0.005, 0.0005)  # of the span of the positions, from which fits start
CORNER = 0.02  # of the play, over which it is rounded; while one is sought, of the largest that fits start from
LOOSE = (0.05, 0.3)  # of the span of the twist of a soft coupling
STIFFER = 10.0  # than a string as a whole, the section at one of its ends from which fits start
SECTION = 0.4, 0.1  # of the inertia behind a string, and before it: what turns where that section ends, at the start of a fit


@dataclass(frozen=True, kw_only=True)
class Soft:
    """An edit: a rigid coupling becomes `component`.

    mass: a body on its first side, where there is none. moved: a sensor, and the flange that it goes to.
    """

    coupling: str
    component: Component
    mass: tuple[str, Component] | None
    moved: tuple[str, str] | None

    def __call__(self, model: Model) -> Model:
        edited = model.replace(self.coupling, self.component)
        if self.mass is not None:
            name, body = self.mass
            flange = next(iter(body.declared_connectors))
            side = next(f for f in self.component.declared_connectors)
            edited = replace(
                edited,
                components={**edited.components, name: body},
                connections=(*edited.connections, (f"{name}.{flange}", f"{self.coupling}.{side}")),
            )
        if self.moved is not None:
            sensor, new = self.moved
            edited = replace(edited, connections=tuple(_moved(pair, sensor, new) for pair in edited.connections))
        return edited


def of_coupling(model: Model, spot: Spot, motion: Motion, masses: dict[str, float], values: dict[str, float]) -> list[Candidate]:
    """Compliance and play of a rigid coupling. masses: body -> its mass or inertia [kg or kg.m2]; values: of the model's parameters."""
    if not isinstance(model.components[spot.name], RIGID):
        return []
    slides = spot.kind == "translational"
    first, second = (f"{spot.name}.{f}" for f in spot.flanges)
    before = _sum(bodies_at(model, first, WORDS[spot.kind]), masses)
    behind = _borne(model, spot, second, masses, values)
    place = place_of(model, spot)
    if before is None and place != spot.name:  # a body drives it by way of ideal couplings
        before = _borne(model, spot, first, masses, values) or behind
    whole = before if behind is None else behind
    if whole is None:
        return []
    name = f"{spot.name}_mass"
    body: tuple[str, Component] | None = None
    if before is None:
        part = SHARE * whole
        body = name, (sliding.Mass(m=part) if slides else turning.Inertia(J=part))
    reduced = 1.0 / (1.0 / (before or SHARE * whole) + 1.0 / (behind or whole))
    reading = sorted(n for n in neighbours(model, first) & sensors(model) if len(model.components[n].declared_connectors) == 1)
    extra = {f"{name}.{'m' if slides else 'J'}": (SHARE * whole, 1e-4 * whole, whole)} if body else {}
    found = list[Candidate]()
    for moved in (None, *reading):
        rebuilt = partial(_rebuilt, spot.name, body, (moved, second) if moved else None)
        for f in RESONANCES:
            k, d = _tuned(reduced, f, DAMPING)
            soft = sliding.SpringDamper(k=k, d=d) if slides else turning.RotationalSpringDamper(k=k, d=d)
            start = {f"{spot.name}.k": (k, k * 1e-4, k * 1e4), f"{spot.name}.d": (d, 0.0, d * 1e4), **extra}
            found.append(_of_transmission(place, "compliance", rebuilt(soft), start, {"k": f"{spot.name}.k", "d": f"{spot.name}.d"}))
        k, d = _tuned(reduced, RESONANCES[-1], DAMPING_OF_PLAY)
        for share in PLAYS if motion.span > 0 else ():
            gap = share * motion.span
            start = {f"{spot.name}.gap": (gap, 0.0, gap * 100), f"{spot.name}.k": (k, k * 1e-2, k * 1e4), **extra}
            loose = rebuilt(_loose(slides, gap, k, d, CORNER * max(PLAYS) * motion.span))
            play = _of_transmission(place, "backlash", loose, start, {"gap": f"{spot.name}.gap", "k": f"{spot.name}.k"})
            found.append(replace(play, later={f"{spot.name}.d": (d, 0.0, d * 1e4)}, rounded=_corners(spot)))
    return found


@dataclass(frozen=True, kw_only=True)
class Behind:
    """An edit: a coupling behind a flange of what passes a motion on as it is, a gear or a pulley, where the model has none.

    turned: with its second flange there, and not its first.
    """

    flange: str
    coupling: str
    component: Component
    turned: bool = False

    def __call__(self, model: Model) -> Model:
        first, second = (f"{self.coupling}.{f}" for f in self.component.declared_connectors)
        first, second = (second, first) if self.turned else (first, second)
        moved = _rejoined(model, {self.flange: second})
        parts = {**model.components, self.coupling: self.component}
        return replace(model, components=parts, connections=(*moved, (self.flange, first)))


def of_ideal(
    model: Model, name: str, motion: Callable[[str], Motion | None], masses: dict[str, float], values: dict[str, float]
) -> list[Candidate]:
    """Compliance and play behind a gear or a pulley between two bodies, where the model has no coupling.

    motion: of a body, by its name; others as of a coupling.
    """
    component = model.components[name]
    (first, _), (second, behind_it) = ((f"{name}.{f}", c) for f, c in component.declared_connectors.items())
    slides = isinstance(behind_it, Translational)
    kind = "translational" if slides else "rotational"
    word = WORDS[kind]
    there = [n for n in neighbours(model, second) if isinstance(model.components[n], (*RIGID, *SOFT, turning.TorsionString))]
    behind = bodies_behind(model, name, second, word)
    if there or not behind or not bodies_behind(model, name, first, "J") or (moved := motion(behind[0])) is None:
        return []
    own = free_name(model, f"{name}_coupling")
    rigid: Component = sliding.Rigid() if slides else turning.RotationalRigid()
    edit = Behind(flange=second, coupling=own, component=rigid)
    put = Rebuild(edit=edit, said=f"{own} = {type(rigid).__name__}() behind {name}")
    spot = Spot(name=own, kind=kind, flanges=tuple(rigid.declared_connectors))
    return [replace(c, place=name, edits=(put, *c.edits)) for c in of_coupling(edit(model), spot, moved, masses, values)]


def of_soft(model: Model, spot: Spot, motion: Motion, masses: dict[str, float], values: dict[str, float]) -> list[Candidate]:
    """Play of a coupling that is soft already, and a body of its own in its middle."""
    component = model.components[spot.name]
    k = values.get(own_name(model, f"{spot.name}.k"), 0.0)
    if not isinstance(component, (*SOFT, turning.TorsionString)) or not k > 0:
        return []
    slides, found = spot.kind == "translational", list[Candidate]()
    d = max(values.get(own_name(model, f"{spot.name}.d"), 0.0), 0.0)
    if isinstance(component, (sliding.SpringDamper, turning.RotationalSpringDamper)) and motion.span > 0:
        for share in LOOSE:
            gap = share * motion.span
            loose = Exchange(name=spot.name, component=_loose(slides, gap, k, d, CORNER * gap))
            start = {f"{spot.name}.gap": (gap, 0.0, gap * 20)}
            found.append(
                replace(_of_transmission(spot.name, "backlash", loose, start, {"gap": f"{spot.name}.gap"}), rounded=_corners(spot))
            )
    for flange, share in zip(reversed(spot.flanges), SECTION, strict=True):
        whole = _sum(bodies_at(model, f"{spot.name}.{flange}", WORDS[spot.kind]), masses)
        if whole:
            found.append(_in_two(model, spot, flange, k, whole, share))
    return found


def _in_two(model: Model, spot: Spot, flange: str, k: float, whole: float, share: float) -> Candidate:
    """A stiff section at a flange of a soft coupling, with a body where it ends.

    That begins with a share of the mass `whole` that the model has at the flange, and the sections together as soft as the coupling was:
    a motion that hangs on when a bit sticks is lost where all of it turns with another inertia.
    """
    body, second = f"{spot.name}_section", f"{spot.name}_2"
    word, section = WORDS[spot.kind], share * whole
    edit = Sectioned(coupling=spot.name, flange=flange, body=body, second=second, inertia=section)
    stiffness, inertia = f"{second}.k", f"{body}.{word}"
    start = {stiffness: (STIFFER * k, k / 10, k * 1e3), inertia: (section, section / 1e3, whole * 10)}
    said = f"{second}, {body} {'before' if flange == spot.flanges[0] else 'behind'} {spot.name}"
    bodies = bodies_at(model, f"{spot.name}.{flange}", word)
    beside = {f"{spot.name}.k": STIFFER / (STIFFER - 1.0), **{f"{n}.{word}": 1.0 - share for n in bodies}}
    c = _of_transmission(spot.name, "compliance", Rebuild(edit=edit, said=said), start, {"k": stiffness, "m": inertia})
    return replace(c, beside={own_name(model, name): factor for name, factor in beside.items()})


def _rebuilt(coupling: str, mass: tuple[str, Component] | None, moved: tuple[str, str] | None, component: Component) -> Rebuild:
    said = f"{coupling} = {type(component).__name__}()" + (f" and {moved[0]} at {moved[1]}" if moved else "")
    return Rebuild(edit=Soft(coupling=coupling, component=component, mass=mass, moved=moved), said=said)


def _of_transmission(
    place: str, physics: str, edit: Exchange | Rebuild, start: dict[str, tuple[float, float, float]], named: dict[str, str]
) -> Candidate:
    return Candidate(place=place, family="transmission", physics=physics, edits=(edit,), start=start, named=named, dear=True)


def _tuned(inertia: float, frequency: float, ratio: float) -> tuple[float, float]:
    """Stiffness and damping of a coupling that lets an inertia [kg or kg.m2] swing at a frequency [Hz] with a damping ratio."""
    k = float(inertia * (2 * np.pi * frequency) ** 2)
    return k, float(2 * ratio * np.sqrt(k * inertia))


def _loose(slides: bool, gap: float, k: float, d: float, width: float) -> Component:
    kind = sliding.Backlash if slides else turning.RotationalBacklash
    return kind(gap=gap, k=k, d=d, width=width)


def _corners(spot: Spot) -> dict[str, tuple[str, float]]:
    """The way over which play that was found is rounded: with that of a guess five times too large it would be a tenth too large itself."""
    return {f"{spot.name}.width": (f"{spot.name}.gap", CORNER)}


@dataclass(frozen=True, kw_only=True)
class Sectioned:
    """An edit: a soft coupling in two, the second one at a flange, with a body between them."""

    coupling: str
    flange: str
    body: str
    second: str
    inertia: float

    def __call__(self, model: Model) -> Model:
        old = model.components[self.coupling]
        slides = isinstance(old, SOFT[:2])
        mass = sliding.Mass(m=self.inertia) if slides else self._turning(old)
        (inner,) = (f for f in old.declared_connectors if f != self.flange)
        end, own = f"{self.coupling}.{self.flange}", f"{self.body}.{next(iter(mass.declared_connectors))}"
        moved = _rejoined(model, {end: f"{self.second}.{self.flange}"})
        return replace(
            model,
            components={**model.components, self.body: mass, self.second: old},
            connections=(*moved, (end, own), (own, f"{self.second}.{inner}")),
        )

    def _turning(self, old: Component) -> Component:
        """A body whose angle is a state only where that of the coupling's ends is."""
        return turning.Rotor(J=self.inertia) if isinstance(old, turning.TorsionString) else turning.Inertia(J=self.inertia)


def place_of(model: Model, spot: Spot) -> str:
    """The body that drives an element by way of ideal couplings, or the element itself where no body does."""
    bodies = {name for name, c in model.components.items() if any(v.state for v in c.declared_variables.values())}
    found = _nearest(model, spot.name, f"{spot.name}.{spot.flanges[0]}", bodies, lambda c: isinstance(c, IDEAL))
    return found[0] if found else spot.name


def bodies_at(model: Model, end: str, word: str) -> list[str]:
    """Components with an inertia of that name (`m` or `J`) at a flange."""
    return sorted(n for n in neighbours(model, end) if word in model.components[n].declared_parameters)


def bodies_behind(model: Model, element: str, end: str, word: str) -> list[str]:
    """The nearest ones that a flange of an element moves, at it or by way of joints; not through the element itself."""
    bodies = {name for name, c in model.components.items() if word in c.declared_parameters}
    return _nearest(model, element, end, bodies, lambda c: not isinstance(c, (*SOFT, turning.Rack, turning.Gear)))


def _nearest(model: Model, element: str, end: str, wanted: set[str], passes: Callable[[Component], bool]) -> list[str]:
    """Of those wanted the ones that the fewest components lie between and a flange of an element, through what passes a motion on."""
    seen, ends = {element, *grounds(model)}, {end}
    while ends:
        here = {n for e in ends for n in neighbours(model, e)} - seen
        if found := sorted(here & wanted):
            return found
        seen |= here
        ends = {f"{n}.{port}" for n in here if passes(model.components[n]) for port in model.components[n].declared_connectors}
    return []


def _borne(model: Model, spot: Spot, end: str, masses: dict[str, float], values: dict[str, float]) -> float | None:
    """What the nearest bodies that a flange of a coupling moves come to there, by way of joints, gears and racks [kg or kg.m2]."""
    seen, ends = {spot.name, *grounds(model)}, {end: (WORDS[spot.kind], 1.0)}
    while ends:
        whole, further = 0.0, dict[str, tuple[str, float]]()
        there = {other: (*other.partition(".")[::2], *at) for e, at in ends.items() for other in node(model, e)}
        for name, port, word, factor in there.values():
            component = model.components[name]
            if name in seen or isinstance(component, SOFT):
                continue
            if word in component.declared_parameters:
                whole += factor * masses.get(name, 0.0)
            for other in component.declared_connectors:
                if other != port:
                    further[f"{name}.{other}"] = _beyond(component, name, port, model, values, word, factor)
        if whole:
            return whole
        seen |= {name for name, *_ in there.values()}
        ends = further
    return None


def _beyond(
    component: Component, name: str, port: str, model: Model, values: dict[str, float], word: str, factor: float
) -> tuple[str, float]:
    """What an inertia is called on the other side of a component, and what it counts for on this one, at a port."""
    if isinstance(component, turning.Gear):
        ratio = values.get(own_name(model, f"{name}.ratio"), component.parameters["ratio"])
        return word, factor * (ratio**-2 if port == "flange_a" else ratio**2)
    if isinstance(component, turning.Rack):
        r = values.get(own_name(model, f"{name}.r"), component.parameters["r"])
        return ("m", factor * r**2) if port == "wheel" else ("J", factor / r**2)
    return word, factor


def _sum(bodies: list[str], masses: dict[str, float]) -> float | None:
    """What their masses or inertias come to [kg or kg.m2]; None where that is nothing."""
    return sum(masses.get(n, 0.0) for n in bodies) or None


def _rejoined(model: Model, others: Mapping[str, str]) -> tuple[tuple[str, str], ...]:
    """The connections with other ends in the place of some."""
    return tuple((others.get(a, a), others.get(b, b)) for a, b in model.connections)


def _moved(pair: tuple[str, str], sensor: str, flange: str) -> tuple[str, str]:
    """A connection, that of the sensor to this flange."""
    own = [end for end in pair if end.partition(".")[0] == sensor]
    return (own[0], flange) if own else pair
