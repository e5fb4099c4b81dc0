"""Small models and horizons that several test files share; what is true of them is in `truths.py`."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from backsight.models import Component, Dae, Equation, Model, Parameter, Translational, Variable, compile_model, equal, law
from backsight.models.mechanics.planar import PlanarFixed, PointMass, Rod
from backsight.models.mechanics.rotational import AngleSensor, Inertia, RotationalDamper, RotationalFixed, RotationalSpringDamper, Torque
from backsight.models.mechanics.translational import (
    AccelerationSensor,
    ConstantForce,
    Damper,
    Fixed,
    Force,
    Mass,
    PositionSensor,
    Spring,
    VelocitySensor,
)
from backsight.ocp import Horizon, Mesh

M, D, K, OFFSET, LAG = 2.0, 1.5, 50.0, 0.7, 0.05
HARDENING, COULOMB, WIDTH = 0.3, 0.8, 0.2


class LaggedForce(Component):
    """An actuator of first order.   T f' = u - f, which holds exactly: it carries no residual."""

    u = Variable("N")
    f = Variable("N", state=True)
    flange = Translational()
    T = Parameter("s", LAG, min=1e-3)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"lag": equal(c.T * c.der(c.f), c.u - c.f), "push": equal(c.flange.f, -c.f)}


class StiffeningSpring(Component):
    """A spring whose deflection z is an implicit function of s.   z + a z^3 = s,  f = k z"""

    z = Variable("m")
    flange = Translational()
    k = Parameter("N/m", K, min=0.0)
    a = Parameter("1/m2", HARDENING, min=0.0)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"deflection": equal(c.z + c.a * c.z**3, c.flange.s), "stiffness": law(c.flange.f, c.k * c.z)}


class RoundedFriction(Component):
    """Coulomb friction, rounded so widely that every scheme can follow it.   f = f_c tanh(v / width)"""

    v = Variable("m/s")
    flange = Translational()
    f_c = Parameter("N", COULOMB, min=0.0)
    width = Parameter("m/s", WIDTH, min=1e-6)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"velocity": equal(c.v, c.der(c.flange.s)), "friction": law(c.flange.f, c.f_c * ca.tanh(c.v / c.width))}


def on_mass(name: str, drive: Component, spring: Component, outputs: dict[str, str], extra: dict[str, Component] | None = None) -> Model:
    """A mass with what is named, at the ground; the two-flanged elements are fixed there by flange_b."""
    parts = {
        "motor": drive,
        "mass": Mass(m=M),
        "spring": spring,
        "damper": Damper(d=D),
        "offset": ConstantForce(f=OFFSET),
        "sensor": PositionSensor(),
        "speed": VelocitySensor(),
        "ground": Fixed(),
        **(extra or {}),
    }
    connections = []
    for part, component in parts.items():
        if "flange_a" in component.declared_connectors:
            connections += [(f"{part}.flange_a", "mass.flange"), (f"{part}.flange_b", "ground.flange")]
        elif part not in ("mass", "ground"):
            connections.append((f"{part}.flange", "mass.flange"))
    drive_variable = "motor.u" if isinstance(drive, LaggedForce) else "motor.f"
    return Model(name=name, components=parts, connections=connections, inputs={"F": drive_variable}, outputs=outputs)


def oscillator() -> Model:
    """m v' = F - d v - k s - offset, position measured: linear, with places at the mass and nothing else."""
    return on_mass("oscillator", Force(), Spring(k=K), {"x": "sensor.s"})


def lagged() -> Model:
    """The oscillator behind an actuator of first order, position and velocity measured: one equation is exact whatever the weights."""
    return on_mass("lagged", LaggedForce(), Spring(k=K), {"x": "sensor.s", "v": "speed.v"})


def shaken() -> Model:
    """The oscillator with an accelerometer beside the position sensor: what acts on the mass enters its reading at once."""
    return on_mass("shaken", Force(), Spring(k=K), {"x": "sensor.s", "a": "shaker.a"}, {"shaker": AccelerationSensor()})


def shaken_hard() -> Model:
    """The same with a stiffening spring and friction: what its sensor reads at once is not linear."""
    extra = {"shaker": AccelerationSensor(), "friction": RoundedFriction()}
    return on_mass("shaken_hard", Force(), StiffeningSpring(), {"x": "sensor.s", "a": "shaker.a"}, extra)


def stiffening() -> Model:
    """Actuator lag, an algebraic deflection, rounded friction: nonlinear, position and velocity measured."""
    return on_mass("stiffening", LaggedForce(), StiffeningSpring(), {"x": "sensor.s", "v": "speed.v"}, {"friction": RoundedFriction()})


def soft_drive() -> Model:
    """Motor, soft shaft, load and a viscous bearing, with an encoder on the motor alone."""
    return Model(
        name="drive",
        components={
            "source": Torque(),
            "motor": Inertia(J=2e-3),
            "shaft": RotationalSpringDamper(k=40.0, d=0.01),
            "load": Inertia(J=8e-3),
            "bearing": RotationalDamper(d=0.05),
            "ground": RotationalFixed(),
            "encoder": AngleSensor(),
        },
        connections=[
            ("source.flange", "motor.flange"),
            ("encoder.flange", "motor.flange"),
            ("motor.flange", "shaft.flange_a"),
            ("shaft.flange_b", "load.flange"),
            ("load.flange", "bearing.flange_a"),
            ("bearing.flange_b", "ground.flange"),
        ],
        inputs={"tau": "source.tau"},
        outputs={"phi": "encoder.phi"},
    )


def pendulum(bob: PointMass | None = None, rod: Rod | None = None) -> Model:
    """A point mass on a rod in Cartesian coordinates: index three, two invariants."""
    return Model(
        name="pendulum",
        components={"bob": bob or PointMass(), "rod": rod or Rod(), "pivot": PlanarFixed()},
        connections=[("bob.point", "rod.point_a"), ("rod.point_b", "pivot.point")],
        outputs={"x": "bob.x", "y": "bob.y"},
    )


def swung(dae: Dae, noise: float = 0.0) -> Horizon:
    """The pendulum of length 1 m as it was seen for 0.2 s, with normal noise [m]; nobody knows where it started."""
    time = np.linspace(0.0, 0.2, 9)
    angle = 0.5 + 0.1 * np.sin(6 * time)
    y = np.column_stack([np.sin(angle), -np.cos(angle)]) + noise * np.random.default_rng(0).normal(size=(9, 2))
    return Horizon(
        mesh=Mesh(time[::2]),
        time=time,
        inputs=np.empty((9, 0)),
        target=y,
        target_std=np.full(y.shape, 1e-2),
        initial=np.zeros(len(dae.states)),
        initial_std=np.full(len(dae.states), np.inf),
    )


def near_the_swing(dae: Dae, index: np.ndarray, size: int) -> np.ndarray:
    """Decisions (size,) from which `swung` is solved: the bob where it is about; index (local, N) of the intervals' unknowns."""
    start = np.zeros(size)
    for i, q in enumerate(dae.states):
        start[index[i]] = {"bob.x": 0.48, "bob.y": -0.87}.get(q.name, 0.1)
    return start


def compiled(model: Model) -> Dae:
    return compile_model(model)


def number(dae: Dae, *names: str) -> tuple[int, ...]:
    """Indices of parameters by name."""
    return tuple([p.name for p in dae.parameters].index(name) for name in names)


def random_horizon(dae: Dae, seed: int, *, intervals: int = 4, samples: int = 11, known: bool = False, hold: str = "zero") -> Horizon:
    """Jittered samples with some of them missing, random held inputs, knots that fall where they like."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.01, 0.03, samples))
    inner = np.sort(rng.uniform(time[0] + 0.005, time[-1] - 0.005, intervals - 1))
    knots = np.concatenate([[time[0]], inner, [time[-1]]])
    target = rng.normal(size=(samples, len(dae.outputs)))
    target[rng.uniform(size=target.shape) < 0.2] = np.nan
    nx = len(dae.states)
    return Horizon(
        mesh=Mesh(knots),
        time=time,
        inputs=rng.normal(size=(samples, len(dae.inputs))),
        target=target,
        target_std=rng.uniform(0.5, 2.0, target.shape),
        initial=rng.normal(size=nx),
        initial_std=np.where(np.arange(nx) == 0, 0.0, 0.5) if known else np.full(nx, np.inf),
        hold=hold,  # type: ignore[arg-type]
    )
