"""Events: where a switching function crosses zero within a step, and what has happened there.

The values g of a function at the start and the stages of a step lie on a polynomial of degree s. A crossing is its first zero after
it was positive; a function that starts at zero and falls at once has its event at the start.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from ..dae import Dae
from .radau import STAGES, tableau
from .switches import Switch

Array = NDArray[np.float64]
NOISE = 1e-13  # of a switching function, relative to its largest value so far
_GRID = np.linspace(0.0, 1.0, 33)
_NODES = np.concatenate([[0.0], tableau(STAGES)[0]])
_TO_POWERS = np.linalg.inv(_NODES[:, None] ** np.arange(STAGES + 1))
_TO_GRID = (_GRID[:, None] ** np.arange(STAGES + 1)) @ _TO_POWERS


@dataclass(frozen=True, kw_only=True)
class Event:
    """What happened at a time during a simulation.

    time       [s]
    kind       "stick": held at rest from here on; "slip": breaks away; "reverse": passes rest; "switch": a law enters another branch
    component  whose law it is, "" where none can be told
    function   the switching function, as an expression of the model's variables
    sign       of the switching function after the event; 0 while it is held at zero
    """

    time: float
    kind: Literal["stick", "slip", "reverse", "switch"]
    component: str
    function: str
    sign: int


def first_crossing(values: Array, size: Array) -> tuple[float, int] | None:
    """(theta, row) of the first of the functions (n, 1 + s) that falls through zero in a step, theta in [0, 1]; None without.

    size  largest value of each function so far, whose rounding error is not taken for a crossing
    """
    found: tuple[float, int] | None = None
    for row in range(len(values)):
        theta = _crossing(values[row], NOISE * float(size[row]))
        if theta is not None and (found is None or theta < found[0]):
            found = theta, row
    return found


def _crossing(values: Array, noise: float) -> float | None:
    if not np.all(np.isfinite(values)):
        return None
    line = _TO_GRID @ values
    below = np.flatnonzero(line < -noise)
    below = below[below > 0]
    if not len(below):
        return None
    j = int(below[0])
    above = np.flatnonzero(line[:j] > noise)
    if len(above):
        return float(brentq(lambda theta: _at(values, theta), _GRID[above[-1]], _GRID[j], xtol=1e-16, rtol=1e-15))
    return 0.0 if line[1] < line[0] else None


def _at(values: Array, theta: float) -> float:
    return float(np.polynomial.polynomial.polyval(theta, _TO_POWERS @ values))


def slope_at(values: Array, theta: float) -> float:
    """d g/d theta of one function (1 + s,) at theta."""
    powers = _TO_POWERS @ values
    return float(np.polynomial.polynomial.polyval(theta, np.polynomial.polynomial.polyder(powers)))


def component_of(dae: Dae, switch: Switch) -> str:
    """Whose law switches: the owner of the width, of parameters in the switching function, or of a variable that is this function."""
    names = {q.name for q in dae.parameters}
    owners = [name for name in (switch.width, *(s.name() for s in ca.symvar(switch.declared) if s.name() in names)) if "." in name]
    if owners:
        return owners[0].rpartition(".")[0]
    for name, value in dae.variables.items():
        if ca.SX(value).is_scalar() and ca.is_equal(ca.SX(value), switch.declared, 20):
            return name.rpartition(".")[0]
    held = [s.name() for s in ca.symvar(switch.declared) if "." in s.name()]
    return held[0].rpartition(".")[0] if held else ""
