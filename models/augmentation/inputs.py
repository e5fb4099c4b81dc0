"""An input that acts otherwise than it was recorded:  u_acting - u = w."""

from __future__ import annotations

import casadi as ca

from ..dae import Dae, EquationInfo, Place, Quantity
from ..errors import InputError, suggestion
from .extension import Row, extended, index_of


def measured_input(dae: Dae, name: str) -> Dae:
    """The model in which the input acts as recorded plus white noise, with the place `input:<name>` [unit of the input].

    The input as it acts is the algebraic variable `<name>` in every equation. A recorded value that is off by sigma for as long as it is
    held, dt, brings the impulse sigma dt; white noise of spectral density sigma^2 dt brings impulses of the same variance.

    Raises InputError for an unknown input, or one that is measured already.
    """
    names = [q.name for q in dae.inputs]
    k = index_of(names, name)
    if k is None:
        raise InputError(f"measured_input({name!r}): {dae.name} has no such input; {suggestion(name, names)}")
    place = f"input:{name}"
    if place in [p.name for p in dae.places]:
        raise InputError(f"measured_input({name!r}): the input has noise already; give it one only.")
    q, z, w = dae.inputs[k], ca.SX.sym(f"acting({name})"), ca.SX.sym(f"w[{place}]")
    origin = f"{name}: input as it acts"
    info = EquationInfo(name="input", component=name, origin=origin, place=len(dae.places))
    return extended(
        dae,
        old=dae.u[k],
        new=z,
        algebraics=[(z, Quantity(name=name, unit=q.unit, nominal=q.nominal, description="input as it acts", start=q.start))],
        rows=[Row(residual=z - dae.u[k] - w, equation=info)],
        places=[(w, Place(name=place, unit=q.unit, kind="law", enabled=True, origin=origin))],
    )
