"""Switches: what is found in the graph of the equations, and how it is told apart."""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

from backsight.models import Component, Equation, Model, Parameter, Variable, balance, compile_model, equal
from backsight.models.simulation.switches import Switched, find_switches


def found(force: Callable[[Any], Any], given: tuple[str, ...] = ()) -> Switched:
    class Body(Component):
        s = Variable("m", state=True)
        v = Variable("m/s", state=True)
        k = Parameter("N/m", 1e4)
        zero = Parameter("N", 0.0)
        width = Parameter("m", 1e-3, min=1e-12, smoothing=True)

        def equations(self, c: Any) -> dict[str, Equation]:
            return {"rate": equal(c.der(c.s), c.v), "force balance": balance(2 * c.der(c.v), -force(c))}

    dae = compile_model(Model(name="m", components={"a": Body()}))
    return find_switches(dae, np.array(dae.parameter_values({"a.width": 1e-8})), given)


@pytest.mark.parametrize(
    ("force", "kind"),
    [
        (lambda c: c.k * ca.fmax(c.s - 1, 0), "kink"),
        (lambda c: ca.if_else(c.s > 1, c.k * (c.s - 1), 0), "kink"),
        (lambda c: ca.fabs(c.v) * c.v, "kink"),
        (lambda c: c.s * ca.tanh(c.s / c.width), "kink"),
        (lambda c: ca.sqrt(c.s**2 + c.width**2), "kink"),
        (lambda c: ca.sign(c.s), "jump"),
        (lambda c: ca.if_else(c.s > 1, 3.0, 0), "jump"),
        (lambda c: ca.sign(c.v), "hold"),
        (lambda c: 3 * ca.tanh(c.v / c.width), "hold"),
        (lambda c: (1 + c.s**2) * ca.tanh(c.v / c.width) + c.v, "hold"),
    ],
)
def test_a_law_is_a_kink_a_jump_or_one_that_can_hold(force: Callable[[Any], Any], kind: str) -> None:
    (switch,) = found(force).switches
    assert switch.kind == kind


@pytest.mark.parametrize(
    "force",
    [
        lambda c: c.k * ca.tanh(c.s),  # smooth
        lambda c: c.zero * ca.tanh(c.v / c.width),  # of no strength
        lambda c: c.width * ca.log(ca.cosh(c.v / c.width)),  # goes on growing
        lambda c: ca.sqrt(ca.sqrt(c.s**2 + c.width**2)),  # a root, whose rounding decides how it leaves zero
        lambda c: c.v / ca.sqrt(c.v**2 + c.width**2),  # a jump that is no function of v/width
    ],
)
def test_what_is_no_corner_in_the_limit_stays_as_it_is_written(force: Callable[[Any], Any]) -> None:
    assert found(force).switches == ()


def test_a_given_width_makes_a_law_smooth() -> None:
    assert found(lambda c: 3 * ca.tanh(c.v / c.width), given=("a.width",)).switches == ()


def test_the_bounds_at_rest_are_the_extremes_of_the_law() -> None:
    """2 forwards and 3 backwards while sliding, half as much more to break away at |s| = 1."""

    def law(c: Any) -> Any:
        s = c.v / c.width
        peak = 1 + s**2 * ca.exp(1 - s**2) / 2
        return peak * ca.tanh(20 * s) * ca.if_else(c.v / c.width > 0, 2.0, 3.0)

    def split(c: Any) -> Any:
        s = c.v / c.width
        return (2.5 - 0.5 * ca.tanh(20 * s)) * (1 + s**2 * ca.exp(1 - s**2) / 2) * ca.tanh(20 * s)

    (switch,) = found(split).switches
    (part,) = switch.parts
    assert (part.below, part.above) == pytest.approx((-3.0, 2.0))
    assert part.rest + part.span * switch.high == pytest.approx(3.0, abs=1e-9)
    assert part.rest + part.span * switch.low == pytest.approx(-4.5, abs=1e-9)
    assert all(switch.kind != "kink" for switch in found(law).switches)


def test_functions_that_are_multiples_of_each_other_make_one_switch() -> None:
    (switch,) = found(lambda c: 2 * ca.tanh(c.v / c.width) + ca.sign(-3 * c.v) + ca.tanh(-8 * c.v / c.width)).switches
    assert sum(part.above for part in switch.parts) == pytest.approx(2 - 1 - 1)


def test_each_branch_is_the_law_on_its_side() -> None:
    switched = found(lambda c: c.k * ca.fmax(c.s - 1, 0) + 5 * ca.tanh(c.v / c.width))
    symbols = [part for switch in switched.switches for part in switch.parts]
    moving = [s for s in ca.symvar(switched.residual) if s.name() in ("a.s", "a.v", "der(a.v)", "der(a.s)")]
    law = ca.Function("f", [ca.vertcat(*moving), ca.vertcat(*(p.symbol for p in symbols))], [switched.residual])
    names = [s.name() for s in moving]
    for s, v in ((1.5, 2.0), (0.5, -2.0)):
        at = [{"a.s": s, "a.v": v, "der(a.v)": 0.0, "der(a.s)": v}[name] for name in names]
        signs = {("a.s" if "a.s" in str(switch.function) else "a.v"): switch for switch in switched.switches}
        psi = [p.above if (s - 1 if switch is signs["a.s"] else v) > 0 else p.below for switch in switched.switches for p in switch.parts]
        assert float(law(at, psi)[1]) == pytest.approx(1e4 * max(s - 1, 0) + 5 * np.sign(v))
