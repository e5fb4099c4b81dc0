"""From a model to its `Dae`: flatten, eliminate, reduce the index, and check that the result determines what it should."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np

from .dae import Dae, EquationInfo, ParameterInfo, Place, Quantity
from .eliminate import Eliminator, Reduced, refuse_dropped
from .errors import ModelError, suggestion
from .flatten import FlatEquation, FlatModel, flatten
from .index_reduction import Semi, reduce_index
from .model import Model
from .structure import fault

SX = Any


def compile_model(model: Model, *, places: Collection[str] = ()) -> Dae:
    """The implicit equations of a model in as few coordinates as its couplings allow.

    places  laws of elements that carry a residual besides the balances of the bodies, e.g. ("screw",)

    Raises ModelError for a model that is not connected, not determined, singular, and for a place that does not exist or has no meaning.
    """
    if not model.components:
        raise ModelError(f"model '{model.name}' has no components; add some")
    places = tuple(dict.fromkeys([*model.residuals, *places]))
    flat = flatten(model)
    available = {
        e.slot[0]: Place(
            name=e.slot[0], unit=e.slot[1], kind="balance" if e.kind == "balance" else "law", enabled=e.kind == "balance", origin=e.origin
        )
        for e in flat.equations
        if e.slot
    }
    for name in places:
        if name not in available:
            raise ModelError(f"model '{model.name}' has no place '{name}' for a residual; {suggestion(name, available)}")
    slots = {name: ca.SX.sym(f"w[{name}]") for name, place in available.items() if place.enabled or name in places}
    reduced = Eliminator(flat, set(model.inputs.values()), slots).run()
    for name in places:
        if name in reduced.merged:
            raise refuse_dropped(name, reduced.merged)
    system = _semi(flat, reduced, set(model.inputs.values()))
    if _deficient(system):
        known = ca.vertcat(*(s for _, _, s in flat.parameters.values()), *(flat.symbols[v] for v in model.inputs.values()), *slots.values())
        system = reduce_index(system, known, flat.time)
        _refuse_differentiated(model, slots, system)
    _refuse_singular(model, flat, system)
    return _assemble(model, flat, reduced, system, slots, available)


def _semi(flat: FlatModel, reduced: Reduced, known: set[str]) -> Semi:
    """Sort the surviving variables into states and algebraics, in order of declaration."""
    present = {s.name() for e in reduced.equations for s in ca.symvar(e.residual)}
    for name in known:
        if f"der({name})" in present:
            raise ModelError(
                f"model '{flat.name}': the input that drives '{name}' would have to be differentiated; drive a force or the "
                "highest derivative instead"
            )
    for equation in reduced.equations:
        if not present & {s.name() for s in ca.symvar(equation.residual)} or not ca.symvar(equation.residual):
            raise ModelError(
                f"model '{flat.name}': '{equation.origin}' says what other equations already say, or contradicts them "
                f"(it became {equation.residual} = 0); remove one of the rigid couplings or fixed points in that loop"
            )
    survivors = [name for name in flat.variables if name not in reduced.definitions and name not in known]
    states = [name for name in survivors if f"der({name})" in present]
    return Semi(
        x=[flat.symbols[n] for n in states],
        dx=[flat.derivatives[n] for n in states],
        z=[flat.symbols[n] for n in survivors if n not in states],
        equations=reduced.equations,
        invariants=[],
        index=0,
    )


def _incidence(system: Semi) -> np.ndarray[Any, np.dtype[np.bool_]]:
    unknown = {s.name(): i for i, s in enumerate([*system.dx, *system.z])}
    incidence = np.zeros((len(system.equations), len(unknown)), dtype=bool)
    for row, equation in enumerate(system.equations):
        for symbol in ca.symvar(equation.residual):
            if symbol.name() in unknown:
                incidence[row, unknown[symbol.name()]] = True
    return incidence


def _deficient(system: Semi) -> bool:
    """Whether the highest derivatives are not structurally determined."""
    return any(fault(_incidence(system)))


def _refuse_differentiated(model: Model, slots: dict[str, SX], system: Semi) -> None:
    present = {s.name() for s in ca.symvar(ca.vertcat(*system.invariants, 0))}
    for name, variable in model.inputs.items():
        if variable in present:
            raise ModelError(
                f"model '{model.name}': input '{name}' ('{variable}') fixes a motion, so it would have to be differentiated; "
                "drive a force or the highest derivative instead"
            )
    for place, symbol in slots.items():
        if symbol.name() in present:
            raise ModelError(
                f"place '{place}' can carry no residual: its equation is a constraint on the motion that has to be "
                "differentiated; choose the balance of a body, or put a compliance there"
            )


def _refuse_singular(model: Model, flat: FlatModel, system: Semi) -> None:
    """Equations that depend on each other have a singular Jacobian at every point: look at random ones."""
    unknown = ca.vertcat(*system.dx, *system.z)
    rows = ca.vertcat(*(e.residual for e in system.equations))
    if rows.shape[0] != unknown.shape[0]:
        raise ModelError(
            f"model '{model.name}': {rows.shape[0]} equations are left for {unknown.shape[0]} unknowns; "
            "a coupling is stated twice or missing"
        )
    if unknown.shape[0] == 0:
        return
    symbols = ca.symvar(ca.vertcat(rows, unknown))
    jacobian = ca.Function("J", [ca.vertcat(*symbols)], [ca.jacobian(rows, unknown)])
    typical = np.array([_typical(flat, s.name()) for s in symbols])
    generator = np.random.default_rng(0)
    weakest = None
    for _ in range(4):
        matrix = np.array(jacobian(typical * generator.uniform(0.5, 1.5, len(typical))))
        if not np.all(np.isfinite(matrix)):
            continue
        matrix = matrix / np.maximum(np.abs(matrix).max(axis=1, keepdims=True), 1e-300)
        matrix = matrix / np.maximum(np.abs(matrix).max(axis=0, keepdims=True), 1e-300)
        left, sizes, _ = np.linalg.svd(matrix)
        if sizes[-1] > 1e-12 * sizes[0]:
            return
        weakest = left[:, -1]
    if weakest is not None:
        origins = ", ".join(f"'{system.equations[i].origin}'" for i in np.flatnonzero(np.abs(weakest) > 1e-6))
        raise ModelError(
            f"model '{model.name}' is singular: the equations {origins} depend on each other and leave a variable free; "
            "remove the coupling that says the same twice, or give the part without inertia a mass or damper"
        )


def _typical(flat: FlatModel, name: str) -> float:
    if name in flat.parameters:
        declared, value, _ = flat.parameters[name]
        return value or declared.size(value)
    return flat.variables[name].nominal if name in flat.variables else 1.0


def _assemble(model: Model, flat: FlatModel, reduced: Reduced, system: Semi, slots: dict[str, SX], available: dict[str, Place]) -> Dae:
    order = {name: i for i, name in enumerate(flat.variables)}
    pairs = sorted(zip(system.x, system.dx, strict=True), key=lambda pair: order.get(pair[0].name(), len(order)))
    x_names, z_names = [x.name() for x, _ in pairs], [z.name() for z in system.z]
    kept = [name for name in slots if name not in reduced.merged]
    place_index = {name: i for i, name in enumerate(kept)}
    dx_symbols = [ca.SX.sym(f"der({name})") for name in x_names]
    inputs = {variable: ca.SX.sym(name) for name, variable in model.inputs.items()}
    old = [*(dx for _, dx in pairs), *(flat.symbols[v] for v in inputs)]
    new = [*dx_symbols, *inputs.values()]

    equations = sorted(system.equations, key=lambda e: _row_key(e, x_names, dx_symbols))
    residual = [ca.substitute([e.residual], old, new)[0] for e in equations]
    residual = [_oriented(r, e, dx_symbols) for r, e in zip(residual, equations, strict=True)]
    infos = tuple(
        EquationInfo(name=e.name, component=e.component, origin=e.origin, place=place_index.get(e.slot[0]) if e.slot else None)
        for e in equations
    )
    variables = dict(flat.symbols) | reduced.definitions
    resolved = ca.substitute(list(variables.values()), old, new) if variables else []
    variables = dict(zip(variables, resolved, strict=True))
    kinematics = tuple(found for row, r in enumerate(residual) if (found := _kinematic(r, row, x_names, dx_symbols)) is not None)
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
        merged_places=MappingProxyType(dict(reduced.merged)),
        residual=_column(residual),
        equations=infos,
        output=_column(variables[o.variable] for o in model.measured.values()),
        invariants=_column(ca.substitute(system.invariants, old, new) if system.invariants else []),
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


def _row_key(equation: FlatEquation, x_names: list[str], dx_symbols: list[SX]) -> tuple[int, int]:
    """Rows in the order of the states whose derivative they hold; algebraic rows and differentiated constraints last."""
    held = {s.name() for s in ca.symvar(equation.residual)}
    rows = [i for i, dx in enumerate(dx_symbols) if dx.name() in held]
    if not rows or (equation.kind == "equal" and len(rows) > 1):
        return len(x_names), 0
    own = [i for i in rows if x_names[i].startswith(f"{equation.component}.")] if equation.component else []
    return (own or rows)[0], 0 if equation.kind == "equal" else 1


def _oriented(residual: SX, equation: FlatEquation, dx_symbols: list[SX]) -> SX:
    """Kinematic rows as x' - v."""
    if equation.kind != "equal" or equation.slot:
        return residual
    held = [s for s in ca.symvar(residual) if any(s.name() == dx.name() for dx in dx_symbols)]
    if len(held) == 1:
        slope = ca.jacobian(residual, held[0])
        if slope.is_constant() and float(slope) == -1.0:
            return held[0] + ca.substitute(residual, held[0], 0)
    return residual


def _kinematic(residual: SX, row: int, x_names: list[str], dx_symbols: list[SX]) -> tuple[int, int, int] | None:
    """(i, j, row) when the row is exactly x'[i] - x[j]."""
    symbols = {s.name(): s for s in ca.symvar(residual)}
    if len(symbols) != 2:
        return None
    rates = [i for i, dx in enumerate(dx_symbols) if dx.name() in symbols]
    states = [j for j, name in enumerate(x_names) if name in symbols]
    if len(rates) != 1 or len(states) != 1:
        return None
    slopes = [ca.jacobian(residual, symbols[name]) for name in (dx_symbols[rates[0]].name(), x_names[states[0]])]
    exact = all(s.is_constant() for s in slopes) and (float(slopes[0]), float(slopes[1])) == (1.0, -1.0)
    return (rates[0], states[0], row) if exact else None
