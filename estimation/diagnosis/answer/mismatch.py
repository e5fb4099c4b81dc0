"""The residual forces of a smoothed problem as the page draws them: against time, position, velocity and the inputs."""

from __future__ import annotations

from collections.abc import Container, Iterator

import numpy as np

from ...results import Smoothing
from .verdict import Mismatch

MOTIONS = (("position", ("s", "phi", "s_rel", "phi_rel", "dphi")), ("velocity", ("v", "omega", "v_rel", "omega_rel")))
OF_BALANCES = {
    "x": (("position", "x"), ("velocity", "v_x")),
    "y": (("position", "y"), ("velocity", "v_y")),
    "phi": (("angle", "phi"), ("angular velocity", "omega")),
    "f_x": (("velocity", "u"),),
    "f_y": (("velocity", "v"),),
    "f_z": (("velocity", "w"),),
    "tau_x": (("angle", "phi"), ("angular velocity", "p")),
    "tau_y": (("angle", "theta"), ("angular velocity", "q")),
    "tau_z": (("angle", "psi"), ("angular velocity", "r")),
}  # of a body in the plane or in space: what each of its balances is drawn against; its forces are those in its own axes


def mismatches(result: Smoothing) -> tuple[Mismatch, ...]:
    """Of every place in every recording that was fitted."""
    found = list[Mismatch]()
    for name, table in result.estimates.items():
        for place, summary in result.residual_places.items():
            column = f"residual.{place}"
            if column not in table:
                continue
            against = {word: (table[own].to_numpy(), result.units.get(own, "")) for word, own in _motions(place, table)}
            for signal, values in result.inputs.get(name, {}).items():
                if len(values) == len(table):
                    against[signal] = (np.asarray(values), result.units.get(signal, ""))
            found.append(
                Mismatch(
                    place=place,
                    unit=summary.unit,
                    recording=name,
                    time=table["t_s"].to_numpy(),
                    force=table[column].to_numpy(),
                    std=table[f"{column}.std"].to_numpy(),
                    against=against,
                )
            )
    return tuple(found)


def _motions(place: str, columns: Container[str]) -> Iterator[tuple[str, str]]:
    """The columns of a place's own motion, with what they are."""
    for word, variables in MOTIONS:
        own = next((f"{place}.{v}" for v in variables if f"{place}.{v}" in columns), None)
        if own is not None:
            yield word, own
    body, _, balance = place.rpartition(".")
    for word, variable in OF_BALANCES.get(balance, ()):
        if f"{body}.{variable}" in columns:
            yield word, f"{body}.{variable}"
