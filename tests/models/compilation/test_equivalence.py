"""The compiled equations say what the flat ones say: at random points, with random parameters, inputs and residuals."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from chains import gear_train

from backsight.models import Dae, Model, compile_model
from backsight.models.compilation.flatten import flatten
from backsight.models.mechanics.planar import Body, FixedTranslation, FrameFixed, Prismatic, Revolute, World
from backsight.models.mechanics.rotational import RotationalFriction
from backsight.models.mechanics.translational import Force, SpringDamper
from backsight.models.plants import PLANTS, actuator, drillstring, five_bar
from backsight.models.signals import Lag

Values = Mapping[str, float]


def drawn(dae: Dae, generator: np.random.Generator) -> tuple[np.ndarray, ...]:
    """States, inputs, parameters, residuals around their typical values; smoothing widths wide enough to be seen."""
    x = np.array([q.start for q in dae.states]) + generator.uniform(-0.1, 0.1, len(dae.states))
    p = np.array([q.value or 0.3 * min(q.nominal, q.maximum) for q in dae.parameters]) * generator.uniform(0.98, 1.02, len(dae.parameters))
    p = np.where([q.smoothing for q in dae.parameters], 0.3, p)
    return x, generator.uniform(-1, 1, dae.u.shape[0]), p, generator.uniform(-1, 1, dae.w.shape[0])


def at_a_point(dae: Dae, seed: int) -> tuple[Values, Values, Values]:
    """Values and total time derivatives of the variables (x'' and z' by implicit differentiation), and residuals by place."""
    x, u, p, w = drawn(dae, np.random.default_rng(seed))
    y, rest = ca.vertcat(dae.dx, dae.z), ca.vertcat(dae.u, dae.p, dae.w)
    slope = ca.jacobian(dae.residual, y)
    newton = ca.Function("newton", [y, dae.x, dae.t, rest], [dae.residual, slope, ca.jacobian(dae.residual, dae.x)])
    drift = ca.Function("drift", [dae.z, dae.x, dae.t, rest], [dae.invariants, ca.jacobian(dae.invariants, dae.x)])
    known, t = np.concatenate([u, p, w]), 0.3
    unknown = np.array([0.0] * len(dae.states) + [q.start for q in dae.algebraics])
    for _ in range(60):
        if dae.invariants.shape[0]:
            off, by_x = drift(unknown[len(x) :], x, t, known)
            x = x - np.linalg.lstsq(by_x.full(), off.full()[:, 0])[0]
        off, by_y, _ = newton(unknown, x, t, known)
        unknown = unknown - np.linalg.solve(by_y.full(), off.full()[:, 0])
    off, by_y, by_x = (m.full() for m in newton(unknown, x, t, known))
    assert np.abs(off).max() < 1e-7 * (1 + np.abs(unknown).max())
    by_t = ca.Function("t", [y, dae.x, dae.t, rest], [ca.jacobian(dae.residual, dae.t)])(unknown, x, t, known).full()[:, 0]
    rates = np.linalg.solve(by_y, -by_x @ unknown[: len(x)] - by_t)
    every = ca.vertcat(*dae.variables.values())
    way = ca.vertcat(y, dae.x, dae.t)
    along = ca.SX.sym("along", way.shape[0])
    both = ca.Function("both", [y, dae.x, dae.t, rest, along], [every, ca.jtimes(every, way, along)])
    values, speeds = (m.full()[:, 0] for m in both(unknown, x, t, known, np.concatenate([rates, unknown[: len(x)], [1.0]])))
    names = list(dae.variables)
    parameters = dict(zip((q.name for q in dae.parameters), p.tolist(), strict=True))
    moving = {f"der({n})": v for n, v in zip(names, speeds.tolist(), strict=True)}
    moving |= {f"der({n[:-1]})": v for n, v in zip(names, values.tolist(), strict=True) if n.endswith("'")}
    return (
        dict(zip(names, values.tolist(), strict=True)) | parameters | {"time": t},
        moving,
        dict(zip((q.name for q in dae.places), w.tolist(), strict=True)),
    )


def misfits(model: Model, places: tuple[str, ...] = (), seed: int = 0) -> tuple[dict[str, float], int]:
    """Flat equations that do not hold, each by how much over its largest term; and how many were looked at.

    An equation with a place of its own must miss by w there, one that was merged by nothing. Coordinates that nothing depends on have no
    values: they are free, so the equations that hold them must have some solution (least squares).
    """
    dae = compile_model(model, places=places)
    values, speeds, residuals = at_a_point(dae, seed)
    known, bad, looked_at = {**values, **speeds}, {}, 0
    free: list[tuple[str, Any]] = []
    for e in flatten(model).equations:
        symbols = ca.symvar(e.residual)
        given = [s for s in symbols if s.name() in known]
        numbers = [known[s.name()] for s in given]
        value = ca.substitute(e.residual, ca.vertcat(*given), ca.DM(numbers)) if given else ca.SX(e.residual)
        value -= residuals.get(e.slot[0], 0.0) if e.slot else 0.0
        looked_at += 1
        if len(given) < len(symbols):
            free.append((e.origin, value))
        else:
            terms = ca.Function("terms", [ca.vertcat(*given)], [ca.jacobian(e.residual, ca.vertcat(*given))])(numbers).full()
            size = 1.0 + np.abs(terms * numbers).max(initial=0.0)
            if abs(float(value)) > 1e-7 * size:
                bad[e.origin] = float(value) / size
    if free:
        rows = ca.vertcat(*(value for _, value in free))
        unknown = ca.vertcat(*ca.symvar(rows))
        off, slope = (m.full() for m in ca.Function("free", [unknown], [rows, ca.jacobian(rows, unknown)])(0))
        left = off[:, 0] - slope @ np.linalg.lstsq(slope, off[:, 0])[0]
        bad |= {origin: float(r) for (origin, _), r in zip(free, left, strict=True) if abs(r) > 1e-7 * (1 + np.abs(off).max())}
    return bad, looked_at


def cart_pole() -> Model:
    return Model(
        name="cart_pole",
        components={
            "world": World(tilt=1.2),
            "ground": FrameFixed(),
            "slide": Prismatic(direction=0.3),
            "cart": Body(m=2.0),
            "hinge": Revolute(),
            "pole": Body(m=0.5, x_c=0.4, I=0.02),
            "motor": Force(),
        },
        connections=[
            ("ground.frame", "slide.frame_a"),
            ("slide.frame_b", "cart.frame"),
            ("motor.flange", "slide.axis"),
            ("cart.frame", "hinge.frame_a"),
            ("hinge.frame_b", "pole.frame"),
        ],
        inputs={"F": "motor.f"},
        outputs={"s": "slide.s"},
    )


def four_bar(states: tuple[str, ...]) -> Model:
    """A parallelogram, started at an angle of one radian, and a little off it."""
    return Model(
        name="four_bar",
        components={
            "world": World(tilt=math.pi / 2),
            "left": FrameFixed(),
            "right": FrameFixed(x_0=0.4),
            **{name: Revolute() for name in ("first", "second", "third", "fourth")},
            "crank": Body(m=0.8, x_c=0.1, I=0.01),
            "coupler": Body(m=0.6, x_c=0.2, y_c=0.03, I=0.02),
            "rocker": Body(m=0.7, x_c=0.1, I=0.01),
            "crank_tip": FixedTranslation(r_x=0.2),
            "coupler_tip": FixedTranslation(r_x=0.42),
            "rocker_tip": FixedTranslation(r_x=0.25),
        },
        connections=[
            ("left.frame", "first.frame_a"),
            ("first.frame_b", "crank.frame"),
            ("crank.frame", "crank_tip.frame_a"),
            ("crank_tip.frame_b", "second.frame_a"),
            ("second.frame_b", "coupler.frame"),
            ("coupler.frame", "coupler_tip.frame_a"),
            ("right.frame", "third.frame_a"),
            ("third.frame_b", "rocker.frame"),
            ("rocker.frame", "rocker_tip.frame_a"),
            ("coupler_tip.frame_b", "fourth.frame_a"),
            ("rocker_tip.frame_b", "fourth.frame_b"),
        ],
        states=states,
        start={"first.phi": 1.0, "second.phi": -0.8, "third.phi": 1.0},
    )


CASES: dict[str, tuple[Callable[[], Model], tuple[str, ...]]] = {
    **{name: (plant, ()) for name, plant in PLANTS.items()},
    "actuator with a residual in its friction": (actuator, ("friction",)),
    "actuator with a lag in its input": (lambda: actuator().insert("input:F", Lag(tau=0.1), "lag"), ("lag",)),
    "drillstring with two sections": (lambda: drillstring(2), ("string_1",)),
    "drillstring with a rectifier": (lambda: drillstring(drive="rectifier"), ()),
    "five_bar in a tilted plane": (lambda: five_bar().replace("world", World(tilt=0.7)), ()),
    "five_bar with friction in a joint of the loop": (lambda: five_bar().insert("joint_3", RotationalFriction(d=0.2)), ("joint_4",)),
    "xy_table with a compliant belt": (
        lambda: PLANTS["xy_table"]().replace("belt_1", SpringDamper(k=1e3, d=2.0)).with_values(slide_1={"m": 2.0}),
        ("spindle",),
    ),
    "gear train": (lambda: gear_train(4, 1.5), ()),
    "cart-pole": (cart_pole, ()),
    "cart-pole with a residual in its hinge": (cart_pole, ("hinge",)),
    "four-bar linkage": (lambda: four_bar(("first.phi",)), ()),
    "four-bar linkage with a residual in its coupler": (lambda: four_bar(("third.phi",)), ("second",)),
    "four-bar linkage with invariants": (lambda: four_bar(()), ()),
}


@pytest.mark.parametrize("case", CASES)
def test_every_flat_equation_holds_along_the_compiled_motion(case: str) -> None:
    model, places = CASES[case]
    bad, looked_at = misfits(model(), places)
    assert looked_at > 10
    assert bad == {}


def test_a_flat_equation_that_the_compiled_motion_breaks_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    model, honest = cart_pole(), compile_model(cart_pole())
    wrong = replace(honest, residual=ca.vertcat(honest.residual[:-1], honest.residual[-1] + 0.01))
    monkeypatch.setitem(globals(), "compile_model", lambda *_, **__: wrong)
    assert misfits(model)[0]
