"""From a model to its `Dae`: flatten, eliminate, reduce the index, and check that the result determines what it should."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from types import MappingProxyType
from typing import Any

import casadi as ca

from ..dae import Dae, EquationInfo, ParameterInfo, Place, Quantity
from ..errors import ModelError, suggestion
from ..model import Model
from .eliminate import Eliminator, Reduced
from .flat import FlatEquation, FlatModel
from .flatten import flatten
from .index_reduction import Semi, reduce_index
from .linear_blocks import solve_linear_blocks
from .residuals import heirs_of, keep_freedoms, refuse_dropped, standing
from .rows import steps
from .singularity import refuse_singular
from .start_values import carried_over
from .state_selection import select_states
from .structure import fault, incidence

SX = Any
_DRIVE = (
    "drive its rate, or what causes it (a force, a current), instead, or put what stores something between "
    "(a compliance, a resistance and a capacitor, a lag)"
)


def compile_model(model: Model, *, places: Collection[str] = ()) -> Dae:
    """The implicit equations of a model in as few coordinates as its couplings allow.

    places  laws of elements that carry a residual besides the balances of the bodies, e.g. ("screw",)

    Within a closed loop a law that is asked for may take the place of the balance of a body: `Dae.merged_places` says what stands for what.
    Where all balances of a degree of freedom were merged into the law of the joint that it moves in, that law carries a residual unasked.

    Raises ModelError for a model that is not connected, not determined, singular, and for a place that does not exist or has no meaning.
    """
    if not isinstance(model, Model):
        hint = "call it: compile_model(name())" if callable(model) else "give a Model"
        raise ModelError(f"compile_model({model!r:.60}): this is a {type(model).__name__}, not a Model; {hint}")
    if not model.components:
        raise ModelError(f"model '{model.name}' has no components; add some")
    flat = flatten(model)
    available = {
        e.slot[0]: Place(
            name=e.slot[0], unit=e.slot[1], kind="balance" if e.kind == "balance" else "law", enabled=e.kind == "balance", origin=e.origin
        )
        for e in flat.equations
        if e.slot
    }
    if isinstance(places, str):
        raise ModelError(f"compile_model(places={places!r}): a text is not a list; write places=[{places!r}]")
    asked = tuple(dict.fromkeys([*places, *model.residuals]))
    for name in asked:
        if name not in available:
            raise ModelError(f"model '{model.name}' has no place '{name}' for a residual; {suggestion(name, available)}")
    slots = {name: ca.SX.sym(f"w[{name}]") for name, place in available.items() if place.enabled or name in asked}
    system, reduced, slots = keep_freedoms(slots, available, lambda chosen: _reduced(model, flat, chosen))
    heirs = heirs_of(reduced.merged, system)
    for name in asked:
        if name in heirs:
            raise refuse_dropped(name, heirs[name], available)
    final = carried_over(model, reduced.flat, reduced.definitions, {s.name() for s in (*system.x, *system.z)})
    return _assemble(model, final, reduced, system, slots, available)


def _reduced(model: Model, flat: FlatModel, slots: Mapping[str, SX]) -> tuple[Semi, Reduced]:
    """What is left of the flat equations when these places carry a residual."""
    known = set(model.inputs.values())
    reduced = Eliminator(flat, known, dict(slots), kept={o.variable for o in model.measured.values()}, states=model.states).run()
    system = _semi(model, reduced.flat, reduced)
    if _deficient(system):
        system = reduce_index(system, flat.time)
        _refuse_differentiated(model, slots, system)
    refuse_singular(reduced.flat, system)
    if model.states:
        system = select_states(reduced.flat, system, model.states)
        if system.index > 1:
            system, reduced = solve_linear_blocks(reduced.flat, system, reduced, slots)
    return system, reduced


def _semi(model: Model, flat: FlatModel, reduced: Reduced) -> Semi:
    """Sort the surviving variables into states and algebraics, in order of declaration."""
    held = [set(e.held) for e in reduced.equations]
    present = set().union(*held)
    for name, variable in model.inputs.items():
        for equation, symbols in zip(reduced.equations, held, strict=True):
            if f"der({variable})" in symbols:
                raise ModelError(
                    f"model '{flat.name}': input '{name}' ('{variable}') would have to be differentiated in '{equation.origin}'; {_DRIVE}"
                )
    for equation, symbols in zip(reduced.equations, held, strict=True):
        if not symbols:
            raise ModelError(
                f"model '{flat.name}': '{equation.origin}' says what other equations already say, or contradicts them "
                f"(it became {equation.residual} = 0); remove one of the rigid couplings or fixed points in that loop"
            )
    survivors = [name for name in flat.variables if name not in reduced.definitions and name not in model.inputs.values()]
    states = {name: flat.symbols[name] for name in survivors if f"der({name})" in present}
    return Semi(
        x=list(states.values()),
        dx=[flat.derivatives[n] for n in states],
        z=[flat.symbols[n] for n in survivors if n not in states],
        equations=reduced.equations,
        invariants=[],
        index=0,
    )


def _deficient(system: Semi) -> bool:
    """Whether the highest derivatives are not structurally determined."""
    unknown = [*system.dx, *system.z]
    return any(fault(incidence(system.equations, {symbol.name(): i for i, symbol in enumerate(unknown)})))


def _refuse_differentiated(model: Model, slots: Mapping[str, SX], system: Semi) -> None:
    states = {x.name() for x in system.x}
    held = [row.held for row in system.invariants]
    for name, variable in model.inputs.items():
        fixed = dict.fromkeys(x for symbols in held if variable in symbols for x in symbols if x in states)
        if any(variable in symbols for symbols in held):
            raise ModelError(
                f"model '{model.name}': input '{name}' ('{variable}') fixes {', '.join(fixed)}, so it would have to be differentiated; "
                + _DRIVE
            )
    for place, symbol in slots.items():
        if any(symbol.name() in symbols for symbols in held):
            raise ModelError(
                f"place '{place}' can carry no residual: its equation is a constraint on the motion that has to be "
                "differentiated; choose the balance of a body, or put a compliance there"
            )


def _assemble(model: Model, flat: FlatModel, reduced: Reduced, system: Semi, slots: dict[str, SX], available: dict[str, Place]) -> Dae:
    order = {name: i for i, name in enumerate(flat.variables)}
    pairs = sorted(zip(system.x, system.dx, strict=True), key=lambda pair: order.get(pair[0].name(), len(order)))
    x_names, z_names = [x.name() for x, _ in pairs], [z.name() for z in system.z]
    kept = [name for name in slots if name not in reduced.merged]
    place_index = {name: i for i, name in enumerate(kept)}
    dx_symbols = [ca.SX.sym(f"der({name})") for name in x_names]
    rate_index = {dx.name(): i for i, dx in enumerate(dx_symbols)}
    inputs = {variable: ca.SX.sym(name) for name, variable in model.inputs.items()}
    old = _column([*(dx for _, dx in pairs), *(flat.symbols[v] for v in inputs)])
    new = _column([*dx_symbols, *inputs.values()])

    equations = sorted(system.equations, key=lambda e: _row_key(e, x_names, rate_index))
    residual = _renamed((e.residual for e in equations), old, new)
    residual = [_oriented(r, e, rate_index) for r, e in zip(residual, equations, strict=True)]
    infos = tuple(
        EquationInfo(name=e.name, component=e.component, origin=e.origin, place=place_index.get(e.slot[0]) if e.slot else None)
        for e in equations
    )
    variables = dict(flat.symbols) | reduced.definitions
    variables = dict(zip(variables, _renamed(variables.values(), old, new), strict=True))
    own = [new, *(x for x, _ in pairs), *system.z, *(s for _, _, s in flat.parameters.values()), *(slots[name] for name in kept), flat.time]
    variables = _expressible(model, variables, {s.name() for s in ca.symvar(ca.vertcat(*own))})
    x_index = {name: i for i, name in enumerate(x_names)}
    kinematics = tuple(found for row, r in enumerate(residual) if (found := _kinematic(r, row, x_index, rate_index)) is not None)
    return Dae(
        name=model.name,
        x=_column(x for x, _ in pairs),
        dx=_column(dx_symbols),
        z=_column(system.z),
        u=_column(inputs.values()),
        p=_column(s for _, _, s in flat.parameters.values()),
        w=_column(slots[name] for name in kept),
        t=flat.time,
        states=tuple(_quantity(flat, name) for name in x_names),
        algebraics=tuple(_quantity(flat, name) for name in z_names),
        inputs=tuple(_quantity(flat, variable, name) for name, variable in model.inputs.items()),
        outputs=tuple(_quantity(flat, o.variable, name, o.noise_std) for name, o in model.measured.items()),
        parameters=tuple(
            ParameterInfo(
                name=name,
                unit=d.unit,
                value=value,
                minimum=d.min,
                maximum=d.max,
                nominal=d.size(value),
                description=d.description,
                smoothing=d.smoothing,
            )
            for name, (d, value, _) in flat.parameters.items()
        ),
        places=tuple(Place(**{**vars(available[name]), "enabled": True}) for name in kept),
        dormant_places=tuple(Place(**{**vars(place), "enabled": False}) for name, place in available.items() if name not in slots),
        merged_places=MappingProxyType(standing(heirs_of(reduced.merged, system), kept)),
        residual=_column(residual),
        equations=infos,
        output=_column(variables[o.variable] for o in model.measured.values()),
        invariants=_column(_renamed((row.residual for row in system.invariants), old, new)),
        kinematics=kinematics,
        index=system.index if system.index else (1 if z_names else 0),
        variables=variables,
    )


def _column(parts: Iterable[SX]) -> SX:
    column = ca.vertcat(*parts)
    return ca.SX(column) if column.shape[0] else ca.SX(0, 1)


def _quantity(flat: FlatModel, variable: str, name: str | None = None, noise_std: float | None = None) -> Quantity:
    if variable not in flat.variables:  # a derivative that index reduction had to keep as a state
        return Quantity(name=name or variable, unit="", description="derivative kept by index reduction")
    v = flat.variables[variable]
    return Quantity(name=name or variable, unit=v.unit, nominal=v.nominal, description=v.description, start=v.start, noise_std=noise_std)


def _renamed(expressions: Iterable[SX], old: SX, new: SX) -> list[SX]:
    """The expressions with symbols replaced and common subexpressions shared, all in one pass."""
    column = _column(expressions)
    return list(ca.vertsplit(ca.cse(ca.substitute(column, old, new)))) if column.shape[0] else []


def _expressible(model: Model, variables: Mapping[str, SX], known: set[str]) -> dict[str, SX]:
    """Those that hold no other symbols: not a pruned coordinate, nor the derivative of an input or of what became no state."""
    foreign = {name: {s.name() for s in ca.symvar(value)} - known for name, value in variables.items()}
    for name, o in model.measured.items():
        for symbol in sorted(foreign[o.variable]):
            quantity = symbol.removeprefix("der(").removesuffix(")")
            raise ModelError(
                f"model '{model.name}': for output '{name}' ('{o.variable}') '{quantity}', which no state determines, would have to be "
                "differentiated; measure another variable, drive a force or the highest derivative, or give the part a mass or spring"
            )
    return {name: value for name, value in variables.items() if not foreign[name]}


def _row_key(equation: FlatEquation, x_names: list[str], rate_index: Mapping[str, int]) -> tuple[int, int]:
    """Rows in the order of the states whose derivative they hold; algebraic rows and differentiated constraints last."""
    rows = sorted(rate_index[name] for name in equation.held if name in rate_index)
    if not rows or (equation.kind == "equal" and len(rows) > 1):
        return len(x_names), 0
    own = [i for i in rows if x_names[i].startswith(f"{equation.component}.")] if equation.component else []
    return (own or rows)[0], 0 if equation.kind == "equal" else 1


def _oriented(residual: SX, equation: FlatEquation, rate_index: Mapping[str, int]) -> SX:
    """Kinematic rows as x' - v."""
    if equation.kind != "equal" or equation.slot:
        return residual
    held = [s for s in ca.symvar(residual) if s.name() in rate_index]
    if len(held) == 1:
        slope = ca.jacobian(residual, held[0])
        if slope.is_constant() and float(slope) == -1.0 and held[0].name() not in steps(residual):
            return held[0] + ca.substitute(residual, held[0], 0)
    return residual


def _kinematic(residual: SX, row: int, x_index: Mapping[str, int], rate_index: Mapping[str, int]) -> tuple[int, int, int] | None:
    """(i, j, row) when the row is exactly x'[i] - x[j]."""
    symbols = ca.symvar(residual)
    rates = [s for s in symbols if s.name() in rate_index]
    states = [s for s in symbols if s.name() in x_index]
    if len(symbols) != 2 or len(rates) != 1 or len(states) != 1:
        return None
    slopes = [ca.jacobian(residual, symbol) for symbol in (rates[0], states[0])]
    exact = all(s.is_constant() for s in slopes) and (float(slopes[0]), float(slopes[1])) == (1.0, -1.0) and not steps(residual)
    return (rate_index[rates[0].name()], x_index[states[0].name()], row) if exact else None
