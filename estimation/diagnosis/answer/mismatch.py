"""The residual forces of a smoothed problem as the page draws them: against time, position, velocity and the inputs."""

from __future__ import annotations

import numpy as np

from ...results import Smoothing
from .verdict import Mismatch

MOTIONS = (("position", ("s", "phi", "s_rel", "phi_rel", "dphi")), ("velocity", ("v", "omega", "v_rel", "omega_rel")))


def mismatches(result: Smoothing) -> tuple[Mismatch, ...]:
    """Of every place in every recording that was fitted."""
    found = list[Mismatch]()
    for name, table in result.estimates.items():
        for place, summary in result.residual_places.items():
            column = f"residual.{place}"
            if column not in table:
                continue
            against = {}
            for word, variables in MOTIONS:
                own = next((f"{place}.{v}" for v in variables if f"{place}.{v}" in table), None)
                if own is not None:
                    against[word] = (table[own].to_numpy(), result.units.get(own, ""))
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
