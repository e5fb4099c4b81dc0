"""Where in a model physics can be attached, what kind of connector is there, and what the model has there already."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from backsight.models import Model
from backsight.models.connectors import Rotational, Translational
from backsight.models.language import Component, Connector, SignalInput, SignalOutput
from backsight.models.mechanics.rotational import Gear, RotationalRigid
from backsight.models.mechanics.translational import Rigid
from backsight.models.model import GROUNDS

RIGID = (Rigid, RotationalRigid)
KINDS: dict[type[Connector], str] = {Translational: "translational", Rotational: "rotational"}
RATES = {"translational": "v", "rotational": "omega"}  # of a body, as a state


@dataclass(frozen=True, kw_only=True)
class Spot:
    """A body or a joint (with its one flange of that kind, or the first of two), or an element between two flanges (both)."""

    name: str
    kind: str
    flanges: tuple[str, ...]


def bodies(model: Model) -> list[Spot]:
    """Components with one flange that carry a balance, and the axes of joints."""
    return [spot for spot in _spots(model) if len(spot.flanges) == 1]


def elements(model: Model) -> list[Spot]:
    """Components between two flanges of one kind, neither held by the ground; not a gear, whose sides turn at rates of their own."""
    held = {end for ground in grounds(model) for end in node(model, f"{ground}.{_first(model, ground)}")}
    found = [spot for spot in _spots(model) if len(spot.flanges) == 2 and not isinstance(model.components[spot.name], Gear)]
    return [spot for spot in found if not held & {f"{spot.name}.{f}" for f in spot.flanges}]


def node(model: Model, flange: str) -> set[str]:
    """All flanges that are joined to this one, itself among them."""
    found, new = {flange}, {flange}
    while new:
        new = {b for pair in model.connections for a, b in (pair, pair[::-1]) if a in new} - found
        found |= new
    return found


def neighbours(model: Model, flange: str) -> set[str]:
    """Components with a flange there."""
    return {end.partition(".")[0] for end in node(model, flange)}


def joined_to(model: Model, name: str) -> set[str]:
    """Components at any flange of one."""
    return {n for port in model.components[name].declared_connectors for n in neighbours(model, f"{name}.{port}")} - {name}


def grounded(model: Model, flange: str) -> bool:
    """Whether the ground holds a flange."""
    return bool(neighbours(model, flange) & set(grounds(model)))


def grounds(model: Model) -> list[str]:
    """Components that stand still."""
    kinds = tuple(GROUNDS.values())
    return [name for name, c in model.components.items() if isinstance(c, kinds)]


def at_hand(model: Model, spot: Spot, words: tuple[str, ...]) -> dict[str, list[str]]:
    """Word -> parameters of that name of components at a body, or of the body itself: its viscous friction `d`, its level `tau_c`.

    Of an element between two bodies, of those side by side with it and its own.
    """
    found: dict[str, list[str]] = {}
    if len(spot.flanges) == 2:
        for name in side_by_side(model, spot):
            for word in words:
                if word in model.components[name].declared_parameters:
                    found.setdefault(word, []).append(f"{name}.{word}")
        return found
    held, here = set(grounds(model)), _at(model, spot)
    for owner in sorted({end.partition(".")[0] for end in here}):
        component = model.components[owner]
        others = [f"{owner}.{f}" for f in component.declared_connectors if f"{owner}.{f}" not in here]
        if owner != spot.name and not all(neighbours(model, end) & held for end in others):
            continue  # between this body and another
        for word in words:
            if word in component.declared_parameters:
                found.setdefault(word, []).append(f"{owner}.{word}")
    return found


def side_by_side(model: Model, spot: Spot) -> list[str]:
    """Elements between the same two bodies as one, itself among them, in the order of the model."""
    ends = {frozenset(node(model, f"{spot.name}.{f}")) for f in spot.flanges}
    return [s.name for s in elements(model) if {frozenset(node(model, f"{s.name}.{f}")) for f in s.flanges} == ends]


def _at(model: Model, spot: Spot) -> set[str]:
    """All flanges that are joined to a body's own; of one with two, to either."""
    declared = model.components[spot.name].declared_connectors
    kind = type(declared[spot.flanges[0]])
    return {end for f, c in declared.items() if type(c) is kind for end in node(model, f"{spot.name}.{f}")}


def own_name(model: Model, path: str) -> str:
    """What a parameter of a component is called in the compiled model: a parameter of the model may stand for it."""
    return model.bindings.get(path, path)


def of_machine(name: str, model: Model) -> bool:
    """Whether a parameter that the study does not name is a property of the machine: not a constant of nature, nor of a neutral block."""
    owner, _, word = name.partition(".")
    return word != "g" and not (owner in model.components and model.components[owner].parameters.get(word) == 1.0)


def lent(model: Model, path: str) -> bool:
    """Whether a parameter of the model stands for that of another component too."""
    called = own_name(model, path)
    return called != path and list(model.bindings.values()).count(called) > 1


def free_name(model: Model, name: str) -> str:
    """The name, with underscores behind it as long as a component, or a parameter of the model, has it already."""
    while name in model.components or name in model.parameters:
        name += "_"
    return name


def sensors(model: Model) -> set[str]:
    """Components that only tell outputs, with the blocks between; not a body or an element of which an output reads a variable directly."""
    found, new = set[str](), {output.variable.partition(".")[0] for output in model.measured.values()}
    while new:
        name = new.pop()
        component = model.components[name]
        if name in found or _has_state(component) or not any(isinstance(s, SignalOutput) for s in component.declared_signals.values()):
            continue
        found.add(name)
        ends = {f"{name}.{word}" for word, s in component.declared_signals.items() if isinstance(s, SignalInput)}
        new |= {b.partition(".")[0] for pair in model.connections for a, b in (pair, pair[::-1]) if a in ends}
    return found


def source(model: Model, signal: str) -> str:
    """The component that a signal comes of, behind the blocks that it goes through."""
    owner, _, port = signal.partition(".")
    into = next((name for name in (port.replace("y", "u", 1), "u_1") if _is_read(model, f"{owner}.{name}")), None)
    before = (end for end in sorted(node(model, f"{owner}.{into}")) if into and not _is_read(model, end))
    return next((source(model, end) for end in before), owner)


def _is_read(model: Model, end: str) -> bool:
    """Whether it is the input of a block."""
    owner, _, port = end.partition(".")
    return owner in model.components and isinstance(model.components[owner].declared_signals.get(port), SignalInput)


def _spots(model: Model) -> Iterator[Spot]:
    held, reading = set(grounds(model)), sensors(model)
    for name, component in model.components.items():
        if name in held:
            continue
        for kind, word in KINDS.items():
            own = tuple(port for port, c in component.declared_connectors.items() if type(c) is kind)
            if len(own) == 2 and len(component.declared_connectors) == 2 and name not in reading:
                rate = component.declared_variables.get(RATES[word])  # what moves as a whole is a body, wherever it is joined
                yield Spot(name=name, kind=word, flanges=own[:1] if rate is not None and rate.state else own)
            if len(own) == 1 and (_has_state(component) or own == ("axis",)):
                yield Spot(name=name, kind=word, flanges=own)


def _has_state(component: Component) -> bool:
    return any(v.state for v in component.declared_variables.values())


def _first(model: Model, name: str) -> str:
    return next(iter(model.components[name].declared_connectors), "")
