"""A model while its laws stick or slide: equations written out by hand, and no rounding left in them."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from backsight.models import compile_model
from backsight.models.dae import Dae
from backsight.models.mechanics.translational import AsymmetricFriction, Friction, StribeckFriction
from backsight.models.plants import actuator, drillstring
from backsight.models.simulation.phases import InPhase, Phases
from tests.one_dimensional import body_with


def phases_of(dae: Dae) -> Phases:
    return Phases(dae, np.array([p.value for p in dae.parameters]))


def solved(within: InPhase, x: list[float], u: float) -> tuple[np.ndarray, np.ndarray]:
    """x' and the margins at a state under an input, without residual force."""
    dae = within.dae
    v = ca.vertcat(dae.dx, dae.z)
    F = ca.Function("F", [v, dae.x, dae.u, dae.p, dae.t], [dae.undisturbed(dae.residual), ca.jacobian(dae.residual, v)])
    p = [q.value for q in dae.parameters]
    rest, J = F(0, x, u, p, 0)  # linear in v
    found = -np.linalg.solve(np.array(J), np.array(rest))[:, 0]
    g = ca.Function("g", [v, dae.x, dae.u, dae.p, dae.t], [within.margins])(found, x, u, p, 0)
    return found[: len(dae.states)], np.array(g)[:, 0]


def test_a_body_slides_against_its_friction_and_its_velocity_is_the_margin() -> None:
    dae = compile_model(body_with(Friction(f_c=6.0, d=0.5), mass=2.0))
    for way in (1, -1):
        rate, margin = solved(phases_of(dae).within([way]), [0.0, 0.3 * way], 10.0)
        assert rate == pytest.approx([0.3 * way, (10.0 - 0.5 * 0.3 * way - 6.0 * way) / 2.0], rel=1e-12)
        assert margin == pytest.approx([0.3], rel=1e-12)


def test_a_body_at_rest_holds_up_to_its_level() -> None:
    dae = compile_model(body_with(Friction(f_c=6.0), mass=2.0))
    within = phases_of(dae).within([0])
    rate, margins = solved(within, [0.4, 0.0], 4.5)
    assert rate == pytest.approx([0.0, 0.0], abs=1e-12)
    assert margins * 12.0 == pytest.approx([6.0 - 4.5, 6.0 + 4.5], rel=1e-9)
    assert within.of == (0, 0)
    assert within.beyond == (1, -1)


@pytest.mark.parametrize(
    ("law", "up", "down"),
    [
        (AsymmetricFriction(f_plus=5.0, f_minus=3.0), 5.0, 3.0),
        (StribeckFriction(f_c=4.0, f_s=7.0), 7.0, 7.0),
    ],
)
def test_breakaway_levels_are_those_of_the_law(law: AsymmetricFriction, up: float, down: float) -> None:
    dae = compile_model(body_with(law))
    _, margins = solved(phases_of(dae).within([0]), [0.0, 0.0], 1.0)
    assert margins * (up + down) == pytest.approx([up - 1.0, down + 1.0], rel=1e-6)


def test_the_bit_breaks_away_at_one_level_and_slides_at_another() -> None:
    dae = compile_model(drillstring())
    phases = phases_of(dae)
    assert phases.names == ("bit",)
    held, margins = solved(phases.within([0]), [0.1, 2.0, 5.0, 0.0], 15.0)
    assert held[3] == pytest.approx(0.0, abs=1e-12)
    assert margins * 1.2 == pytest.approx([0.6 - 0.0868 * 5.0, 0.6 + 0.0868 * 5.0], rel=1e-5)  # the law's own maximum is rounded
    slides, _ = solved(phases.within([1]), [0.1, 2.0, 5.0, 0.5], 15.0)
    assert slides[3] == pytest.approx((0.0868 * 5.0 - 0.001 * 0.5 - 0.4) / 0.0529, rel=1e-9)


def test_two_laws_of_one_velocity_hold_together() -> None:
    dae = compile_model(body_with(Friction(f_c=2.0)).insert("body", Friction(f_c=3.0), name="second"))
    phases = phases_of(dae)
    assert len(phases.names) == 1
    _, margins = solved(phases.within([0]), [0.0, 0.0], 4.0)
    assert margins * 10.0 == pytest.approx([1.0, 9.0], rel=1e-9)


def test_laws_of_different_bodies_change_on_their_own() -> None:
    within = phases_of(compile_model(actuator())).within([1])
    assert within.of == (0,)
    assert not any(q.name.endswith(".hold") for q in within.dae.algebraics)


def test_levels_stay_parameters() -> None:
    dae = compile_model(body_with(Friction(f_c=6.0)))
    within = phases_of(dae).within([1])
    k = [p.name for p in dae.parameters].index("element.f_c")
    slope = ca.Function("slope", [dae.dx, dae.x, dae.u, dae.p, dae.t], [ca.jacobian(dae.undisturbed(within.dae.residual), dae.p[k])])
    assert np.abs(np.array(slope(0, 0, 0, [p.value for p in dae.parameters], 0))).max() == pytest.approx(1.0)
