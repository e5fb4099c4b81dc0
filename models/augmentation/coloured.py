"""A residual force with a memory: a state f of the model, shaped from white noise w of spectral density std^2 * 1 s.

    "ou"      Ornstein-Uhlenbeck, correlation time tau            E f(t) f(t + s) = std^2 e^(-|s|/tau)

        sqrt(tau/2) (f' + f/tau) = w

    "matern"  Matern 3/2, length tau, lambda = sqrt(3)/tau         E f(t) f(t + s) = std^2 (1 + lambda |s|) e^(-lambda |s|)

        f' = g,    (g' + 2 lambda g + lambda^2 f) / (2 lambda^(3/2)) = w

The factors in front are those that make the stationary rms of f the std of the place itself, in its own unit (Matern: w of density
4 lambda^3 std^2 behind f'', J. Hartikainen and S. Sarkka, Kalman filtering and smoothing solutions to temporal Gaussian process
regression models, MLSP 2010, eq. 12). f is continuous, and for Matern 3/2 so is its rate.
"""

from __future__ import annotations

from dataclasses import replace
from math import isfinite, sqrt
from typing import Literal

from ..dae import Dae, EquationInfo, Quantity
from ..errors import InputError, suggestion
from .extension import Row, extended, index_of, new_state

Shape = Literal["ou", "matern"]
SHAPES: tuple[Shape, ...] = ("ou", "matern")


def coloured(dae: Dae, place: str, tau: float, shape: Shape = "ou") -> Dae:
    """The model with a coloured residual force at a place, the state `residual.<place>` [unit of the place].

    tau: correlation time (length) [s]. The row that carried the white residual holds exactly, with the force in it; the place keeps its
    name, and its w is now the noise of the shaping row. Matern 3/2 has a second state, `der(residual.<place>)`.

    Raises InputError for an unknown place, one that is coloured already, or a tau that is no positive number.
    """
    names = [p.name for p in dae.places]
    k = index_of(names, place)
    if k is None:
        raise InputError(f"coloured(place={place!r}): {dae.name} has no such place; {suggestion(place, names)}")
    if not (isfinite(tau) and tau > 0):
        raise InputError(f"coloured({place!r}, tau={tau}): a correlation time is positive and finite; a white force needs none.")
    if shape not in SHAPES:
        raise InputError(f"coloured({place!r}, shape={shape!r}): a coloured force is 'ou' or 'matern'; choose one of them.")
    if any(e.shaped == k for e in dae.equations):
        raise InputError(f"coloured(place={place!r}): the residual force there has a colour already; give it one only.")
    unit, w = dae.places[k].unit, dae.w[k]
    f = new_state(Quantity(name=f"residual.{place}", unit=unit, description="coloured residual force"))
    origin = f"{place}: colour of the residual force"
    row = len(dae.equations)
    told = [replace(e, place=None, shaped=k) if e.place == k else e for e in dae.equations]
    before = replace(dae, equations=tuple(told))
    if shape == "ou":
        shaping = sqrt(tau / 2) * (f.dx + f.x / tau) - w
        rows = [Row(residual=shaping, equation=EquationInfo(name="Ornstein-Uhlenbeck", component=place, origin=origin, place=k))]
        return extended(before, old=w, new=f.x, states=[f], rows=rows)
    lam = sqrt(3.0) / tau
    g = new_state(Quantity(name=f"der(residual.{place})", unit=_rate(unit), nominal=lam, description="rate of the coloured residual force"))
    shaping = (g.dx + 2 * lam * g.x + lam**2 * f.x) / (2 * lam**1.5) - w
    rows = [
        Row(residual=f.dx - g.x, equation=EquationInfo(name="rate", component=place, origin=f"{place}: rate of the residual force")),
        Row(residual=shaping, equation=EquationInfo(name="Matern 3/2", component=place, origin=origin, place=k)),
    ]
    n = len(dae.states)
    return extended(before, old=w, new=f.x, states=[f, g], rows=rows, kinematics=[(n, n + 1, row)])


def stationary_std(place: str, std: float, tau: float, shape: Shape = "ou") -> dict[str, float]:
    """State -> its standard deviation in the stationary distribution, independent of each other, for a force of rms `std`."""
    force = {f"residual.{place}": std}
    return force if shape == "ou" else force | {f"der(residual.{place})": sqrt(3.0) / tau * std}


def white_std(std: float, tau: float, shape: Shape = "ou") -> float:
    """Std of the white force that acts alike on what is slow beside tau: root of the spectral density at frequency 0 [unit sqrt(s)]."""
    return std * sqrt(2 * tau if shape == "ou" else 4 * tau / sqrt(3.0))


def _rate(unit: str) -> str:
    return f"{unit}/s" if "/" not in unit else f"({unit})/s"
