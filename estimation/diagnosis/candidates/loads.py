"""Friction that grows with the load: with a force that drives a body, or with what an element at it passes on.

    f = mu |load| sgn(v_rel)

The load is a variable of the model, of the body's own kind of force: of a source, or of an element joined to the body, also by way of
couplings that pass a motion on as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from backsight.models import Model
from backsight.models.language import Signal, SignalInput, Variable
from backsight.models.mechanics import rotational as turning
from backsight.models.mechanics import translational as sliding

from .candidate import Candidate
from .edits import Insert
from .laws import Motion, flange_of, rounded
from .places import RIGID, Spot, free_name, grounded, neighbours

ROUNDED = 1e-3  # of the rms load: the width over which its sign is rounded
UNITS = {"translational": "N", "rotational": "N.m"}


def of_loads(model: Model, spot: Spot, motion: Motion, size: Callable[[str], float]) -> list[Candidate]:
    """Load-dependent friction of a body against the ground, of every load there. size: variable -> its rms along the trajectories."""
    found = []
    for load in loads(model, spot):
        rms = size(load)
        if not rms > 0:
            continue
        name = free_name(model, f"load_dependent_friction_{spot.name}_{load.replace('.', '_')}")
        kind = sliding.LoadDependentFriction if spot.kind == "translational" else turning.RotationalLoadDependentFriction
        law = kind(load_width=max(ROUNDED * rms, kind.declared_parameters["load_width"].min))
        edit = Insert(place=flange_of(spot), component=rounded(law, motion), name=name, joined=((load, f"{name}.load"),))
        found.append(
            Candidate(
                place=spot.name,
                family="friction",
                physics="load_dependent_friction",
                edits=(edit,),
                strengths=(f"{name}.mu",),
                one_sided=True,
                named={"mu": f"{name}.mu"},
            )
        )
    return found


def loads(model: Model, spot: Spot) -> list[str]:
    """Forces of sources and elements at a body, as variables of the model; of those in a row through a rigid coupling the first one."""
    return sorted(set(_there(model, spot, f"{spot.name}.{spot.flanges[0]}", {spot.name})))


def _there(model: Model, spot: Spot, flange: str, seen: set[str]) -> Iterator[str]:
    for name in sorted(neighbours(model, flange) - seen):
        component = model.components[name]
        seen.add(name)
        ends = [f"{name}.{f}" for f in component.declared_connectors]
        if any(grounded(model, end) for end in ends):
            continue
        if isinstance(component, RIGID):
            for end in ends:
                yield from _there(model, spot, end, seen)
            continue
        told: dict[str, Variable | Signal] = {**component.declared_variables, **component.declared_signals}
        words = [word for word, v in told.items() if v.unit == UNITS[spot.kind]]
        if any(isinstance(told[word], SignalInput) for word in words) or len(ends) == 2:
            yield from (f"{name}.{word}" for word in words)
