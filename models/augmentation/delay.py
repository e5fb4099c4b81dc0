"""A sensor that lags by an unknown time:  y(t) = h(x(t - d), p, t - d), with d [s] the parameter `delay:<output>`.

About a delay d_0 that the samples are rid of already, with the total derivatives of h along the trajectory,

    y(t + d_0) = sum_k (d_0 - d)^k/k! h^(k)(t),        h' = dh/dx x' + dh/dt,    h'' = ...

as far as they are functions of x' and x alone: to second order for a position, whose h' is the velocity, to first order for a velocity.
What is left out is of third order, (d - d_0)^3/6 h''', or of second, and vanishes as d_0 is moved to d.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import factorial, inf, isfinite
from typing import Any

import casadi as ca

from ..dae import Dae, ParameterInfo
from ..errors import InputError, suggestion
from .extension import extended, index_of

SX = Any

INPUTS = "inputs"  # what is delayed, if not an output
MOST_ORDERS = 3


def delay_name(of: str) -> str:
    """What the delay of an output, or of the INPUTS, is called."""
    return f"delay:{of}"


def delay_info(of: str) -> ParameterInfo:
    """The parameter that says how late an output is, or the INPUTS are."""
    what = "time by which all inputs act late" if of == INPUTS else f"time by which {of} lags"
    return ParameterInfo(name=delay_name(of), unit="s", value=0.0, minimum=-inf, maximum=inf, nominal=1e-3, description=what)


def delayed(dae: Dae, output: str) -> Dae:
    """The model with an output that lags by the parameter `delay:<output>` [s], zero by itself; d_0 = 0.

    Raises InputError for an unknown output, one that has a delay already, or one that depends on more than states, parameters and
    time: how an accelerometer's reading goes on in time is no function of these.
    """
    names = [q.name for q in dae.outputs]
    if output not in names:
        raise InputError(f"delayed({output!r}): {dae.name} has no such output; {suggestion(output, names)}")
    return _lagging(dae, [output], output)


def late_inputs(dae: Dae) -> Dae:
    """The model whose inputs act later than they were recorded by the parameter `delay:inputs` [s], all by the same time.

    That is the model whose outputs all lag: its states are those of a time that much later. Raises InputError as `delayed` does.
    """
    return _lagging(dae, [q.name for q in dae.outputs], INPUTS)


def with_samples_moved(dae: Dae, of: str, by: float) -> Dae:
    """The model of a delayed output, or of late INPUTS, whose samples were moved back by a further time [s].

    d_0 grows by it, d stays what it is.
    """
    k = index_of([p.name for p in dae.parameters], delay_name(of))
    if k is None:
        raise InputError(f"with_samples_moved({of!r}): {dae.name} has no such delay; make one by delayed() or late_inputs().")
    if not isfinite(by):
        raise InputError(f"with_samples_moved({of!r}, by={by}): a time in seconds is finite.")
    return replace(dae, output=ca.substitute(dae.output, dae.p[k], dae.p[k] - by))


def _lagging(dae: Dae, outputs: Sequence[str], of: str) -> Dae:
    """The outputs with one delay in common."""
    known = [p.name for p in dae.parameters]
    for name in outputs:
        if delay_name(name) in known or delay_name(INPUTS) in known:
            raise InputError(f"delay of {of}: the output {name} has a delay already; give it one only.")
    d = ca.SX.sym(delay_name(of))
    rows = [_about(dae, name, d) if name in outputs else dae.output[i] for i, name in enumerate(q.name for q in dae.outputs)]
    nothing = ca.SX(0, 1)
    return extended(replace(dae, output=ca.vertcat(*rows)), old=nothing, new=nothing, parameters=[(d, delay_info(of))])


def _about(dae: Dae, output: str, d: SX) -> SX:
    """The series of an output in its delay."""
    h = dae.output[[q.name for q in dae.outputs].index(output)]
    if any(ca.which_depends(h, ca.vertcat(dae.dx, dae.z, dae.u, dae.w), 1, True)):
        raise InputError(f"delay of {output}: this output depends on more than the states, so its rate is not known; give it as a number.")
    terms = [term * (-d) ** k / factorial(k) for k, term in enumerate(_derivatives(dae, h))]
    return sum(terms[1:], terms[0])


def _derivatives(dae: Dae, h: SX) -> list[SX]:
    """h and its total derivatives in time, as many as there are; the derivative of a position is its velocity."""
    rate = ca.SX(dae.dx)
    for i, j, _ in dae.kinematics:
        rate[i] = dae.x[j]
    found = [h]
    while len(found) <= MOST_ORDERS and not any(ca.which_depends(found[-1], dae.dx, 1, True)):
        found.append(ca.jacobian(found[-1], dae.x) @ rate + ca.jacobian(found[-1], dae.t))
    return found
