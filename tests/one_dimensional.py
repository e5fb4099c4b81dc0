"""One body with one element, sliding or turning; an element alone, moved as the test says; its twin in the other domain."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from backsight.models import Component, Dae, Model, Trajectory, compile_model, simulate
from backsight.models.mechanics import rotational, translational
from backsight.models.mechanics.rotational import AngularAcceleration, Inertia, Torque
from backsight.models.mechanics.translational import Acceleration, Force, Mass

Array = NDArray[np.float64]
T = np.linspace(0.0, 2.0, 81)
UNITS = {"N": "N.m", "m": "rad", "kg": "kg.m2", "m/s": "rad/s", "m/s2": "rad/s2", "N/m": "N.m/rad", "N/m3": "N.m/rad3", "1": "1", "W": "W"}
UNITS |= {"N.s/m": "N.m.s/rad", "N.s2/m2": "N.m.s2/rad2"}
WORDS = {"f_c": "tau_c", "f_s": "tau_s", "f_sl": "tau_sl", "f_st": "tau_st", "f_plus": "tau_plus", "f_minus": "tau_minus", "f": "tau"}
WORDS |= {"v_s": "omega_s", "v0": "omega0", "v_dead": "omega_dead", "s_rel0": "phi_rel0", "m": "J"}


def body_with(element: Component, mass: float = 2.0) -> Model:
    """A driven mass, with an element between it and ground."""
    return Model(
        name="body",
        components={"motor": Force(), "body": Mass(m=mass)},
        connections=[("motor.flange", "body.flange")],
        inputs={"F": "motor.f"},
    ).insert("body", element, name="element")


def wheel_with(element: Component, inertia: float = 0.5) -> Model:
    """A driven inertia, with an element between it and ground."""
    return Model(
        name="wheel",
        components={"motor": Torque(), "wheel": Inertia(J=inertia)},
        connections=[("motor.flange", "wheel.flange")],
        inputs={"T": "motor.tau"},
    ).insert("wheel", element, name="element")


def run_body(element: Component, force: float = 0.0, s: float = 0.0, v: float = 0.0, t: ArrayLike = T, **more: float) -> Trajectory:
    """The mass of 2 kg from a start; `more` are values of the element's parameters, else of its defaults with sharp corners."""
    values = {f"element.{name}": value for name, value in more.items()}
    return simulate(compile_model(body_with(element)), t, {"F": force}, values, {"body.s": s, "body.v": v})


def run_wheel(element: Component, torque: float = 0.0, phi: float = 0.0, omega: float = 0.0, t: ArrayLike = T, **more: float) -> Trajectory:
    """The inertia of 0.5 kg m2 from a start."""
    values = {f"element.{name}": value for name, value in more.items()}
    return simulate(compile_model(wheel_with(element)), t, {"T": torque}, values, {"wheel.phi": phi, "wheel.omega": omega})


class Alone:
    """An element between two flanges that are moved: its force and the rate of its own state, by position, velocity and that state.

    values       its parameters, in force unless a call says otherwise
    derivatives  (arguments, p) -> force and rate, their Jacobian, and the Hessian of each
    """

    def __init__(self, element: Component) -> None:
        turning = "tau" in element.declared_connectors["flange_a"].pairs[0].flow
        mover, words = (AngularAcceleration, ("phi", "omega", "alpha", "tau")) if turning else (Acceleration, ("s", "v", "a", "f"))
        s, v, a, f = words
        told = {name: f"element.{name}" for name in element.declared_signals}
        model = Model(
            name="alone",
            components={"a": mover(), "b": mover(), "element": element},
            connections=[("a.flange", "element.flange_a"), ("b.flange", "element.flange_b")],
            inputs={"a": f"a.{a}", "b": f"b.{a}"} | told,
        )
        self.dae: Dae = compile_model(model)
        self.values = {p.name.partition(".")[2]: p.value for p in self.dae.parameters}
        self.force = self.dae.variables[f"element.flange_a.{f}"]
        at = {q.name: self.dae.x[i] for i, q in enumerate(self.dae.states)}
        self.position, self.velocity = at.get(f"a.{s}"), at[f"a.{v}"]
        self.own = next((q.name for q in self.dae.states if q.name.startswith("element.")), None)
        self.state = at[self.own] if self.own else ca.SX.sym("none")
        self.load = self.dae.u[2] if told else ca.SX.sym("none")
        rate = ca.SX(0)
        if self.own:
            slope = self.dae.dx[[q.name for q in self.dae.states].index(self.own)]
            row = next(r for r in ca.vertsplit(self.dae.residual) if slope.name() in {x.name() for x in ca.symvar(r)})
            rate = ca.substitute(row, slope, 0) / -ca.jacobian(row, slope)
        motion = [self.position if self.position is not None else ca.SX.sym("none"), self.velocity, self.state, self.load]
        resting = [symbol for name, symbol in at.items() if name.startswith("b.")]
        expressions = ca.vertcat(self.force, rate)
        expressions = ca.substitute(expressions, ca.vertcat(*resting), ca.DM.zeros(len(resting))) if resting else expressions
        self.arguments = ca.vertcat(*motion)
        self.function = ca.Function("alone", [self.arguments, self.dae.p], [expressions])
        every = ca.vertcat(self.arguments, self.dae.p)
        parts = [expressions, ca.jacobian(expressions, every), ca.hessian(expressions[0], every)[0], ca.hessian(expressions[1], every)[0]]
        self.derivatives = ca.Function("derivatives", [self.arguments, self.dae.p], [ca.densify(part) for part in parts])

    def parameters(self, changes: Mapping[str, float]) -> list[float]:
        return list({**self.values, **changes}.values())

    def at(self, s: ArrayLike, v: ArrayLike, z: ArrayLike = 0.0, load: ArrayLike = 0.0, **changes: float) -> tuple[Array, Array]:
        """Force and rate of the own state, each (n,)."""
        rows = np.broadcast_arrays(np.atleast_1d(s), v, z, load)
        found = self.function.map(len(rows[0]))(np.vstack(rows), self.parameters(changes)).full()
        return found[0], found[1]


def sharp(element: Component, factor: float = 1e-5) -> Component:
    """The element with its smoothing widths shrunk, as a simulation does it."""
    widths = {name: getattr(element, name) * factor for name, p in element.declared_parameters.items() if p.smoothing}
    return element.with_values(**widths)


def twin(element: Component) -> Component:
    """The rotational component that has the name and the numbers of a translational one."""
    name = type(element).__name__
    kind: Any = getattr(rotational, {"AddedMass": "AddedInertia", "StickSlip": "StickSlip"}.get(name, f"Rotational{name}"))
    return kind(**{WORDS.get(word, word): value for word, value in element.parameters.items()})


def exported(module: Any) -> set[type[Component]]:
    return {getattr(module, name) for name in module.__all__}


SLIDING, TURNING = exported(translational), exported(rotational)
