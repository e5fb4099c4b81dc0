"""What a machine does besides what its model says: forces by formula, friction that sticks, faults, changed values and structure.

A law is a force against the motion of one coordinate, f(t, q, v) with q and v of that coordinate; every law vanishes at strength zero.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import tau
from typing import Any

import numpy as np

from .acting import InputFault
from .sensing import SensorFault

__all__ = ["FAMILY", "Coulomb", "Effect", "Law", "Wrench", "family", "laws", "on"]

Law = Callable[[float, float, float], float]
Wrench = Callable[[float, np.ndarray, np.ndarray], np.ndarray]

FAMILY = {
    "friction": "viscous_friction coulomb_friction stribeck_friction logarithmic_friction asymmetric_friction position_dependent_friction "
    "load_dependent_friction presliding_friction stick_slip",
    "transmission": "compliance backlash damping kinematic_error",
    "periodic": "eccentricity cogging",
    "potential": "gravity spring cubic_spring end_stop",
    "fluid": "quadratic_drag linear_drag",
    "inertia": "added_mass rotor_inertia coupling",
    "actuator": "input_gain input_offset input_delay input_lag input_saturation input_dead_zone torque_ripple asymmetric_lag",
    "sensor": "sensor_bias sensor_gain sensor_delay sensor_lag sensor_misalignment sensor_drift",
    "external": "constant_force external_force",
    "unknown": "unknown_physics",
}


def family(physics: str) -> str:
    """The family of a word of the library; a parameter's name belongs to "parameter"."""
    return next((name for name, members in FAMILY.items() if physics in members.split()), "parameter")


@dataclass(frozen=True, kw_only=True)
class Coulomb:
    """More friction of coordinate i that sticks: its level while sliding; factor(q) of it in the position q_i, None: 1."""

    i: int
    level: float
    factor: Callable[[float], float] | None = None


@dataclass(frozen=True, kw_only=True)
class Effect:
    """One concealed effect: how it is called, and what it changes.

    place, physics  where and what, in the words of the library; parameters: name -> (value, unit)
    rivals          other answers that are right: pairs (place, physics)
    onset           [s] from this row on forces, friction and faults act; None: always
    force           generalised forces (n,) of t, q, v; smooth, or with corners at rest. friction: what sticks of it, on top
    values          true values of the machine by the names of its parameters, unknown to the study
    structure       fields of the concealed machine that its model does not have
    inputs, sensors faults by the names of inputs and outputs
    absent          parameters that are zero in the model, although the machine has them
    fixed           what the study takes for granted of parameters that are usually estimated
    """

    place: str
    physics: str
    parameters: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    rivals: tuple[tuple[str, str], ...] = ()
    onset: float | None = None
    force: Wrench | None = None
    friction: tuple[Coulomb, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict)
    structure: Mapping[str, Any] = field(default_factory=dict)
    inputs: Mapping[str, InputFault] = field(default_factory=dict)
    sensors: Mapping[str, SensorFault] = field(default_factory=dict)
    absent: tuple[str, ...] = ()
    fixed: Mapping[str, float] = field(default_factory=dict)

    @property
    def silent(self) -> "Effect":
        """The same with nothing concealed: a machine without what its model does not have either."""
        return Effect(place=self.place, physics=self.physics, values=dict.fromkeys(self.absent, 0.0), absent=self.absent)

    def acts(self, t: float) -> bool:
        """Whether it does in a row that begins at t [s]."""
        return self.onset is None or t >= self.onset


def on(i: int, n: int, law: Law) -> Wrench:
    """The law as a force on coordinate i of n."""

    def force(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        out = np.zeros(n)
        out[i] = -law(t, float(q[i]), float(v[i]))
        return out

    return force


class laws:
    """Formulas, each a function of its parameters that gives a `Law`."""

    @staticmethod
    def viscous(d: float) -> Law:
        """d v."""
        return lambda _t, _q, v: d * v

    @staticmethod
    def asymmetric_viscous(plus: float, minus: float) -> Law:
        """d_plus v forwards, d_minus v backwards."""
        return lambda _t, _q, v: (plus if v > 0 else minus) * v

    @staticmethod
    def quadratic_drag(c: float) -> Law:
        """c v |v|."""
        return lambda _t, _q, v: c * v * abs(v)

    @staticmethod
    def spring(k: float, k3: float = 0.0) -> Law:
        """k q + k_3 q^3."""
        return lambda _t, q, _v: k * q + k3 * q**3

    @staticmethod
    def end_stop(x: float, k: float) -> Law:
        """k (q - x) beyond x, elastic."""
        return lambda _t, q, _v: k * max(q - x, 0.0)

    @staticmethod
    def cogging(amplitude: float, period: float, phase: float = 0.0) -> Law:
        """amplitude sin(2 pi q/period + phase)."""
        return lambda _t, q, _v: amplitude * np.sin(tau * q / period + phase)

    @staticmethod
    def constant(f: float) -> Law:
        """f, whatever the motion."""
        return lambda _t, _q, _v: f

    @staticmethod
    def stribeck(more: float, v_s: float) -> Law:
        """more (exp(-(v/v_s)^2) - 1) sgn(v): what a level higher by `more` at rest loses with speed; the level itself is `friction`."""
        return lambda _t, _q, v: more * float(np.sign(v)) * np.expm1(-((v / v_s) ** 2))

    @staticmethod
    def logarithmic(b: float, v_dead: float) -> Law:
        """b ln(|v|/v_dead) sgn(v) beyond v_dead, on top of the level that it has there."""
        return lambda _t, _q, v: b * float(np.sign(v)) * np.log(abs(v) / v_dead) if abs(v) > v_dead else 0.0

    @staticmethod
    def whirl(strength: float, length: float) -> Law:
        """strength v sin(2 pi q/length): damped here, driven there; in no library."""
        return lambda _t, q, v: strength * v * np.sin(tau * q / length)

    @staticmethod
    def chirp(amplitude: float, first: float, rate: float) -> Law:
        """amplitude sin(2 pi (first + rate t/2) t): a disturbance whose frequency [Hz] rises."""
        return lambda t, _q, _v: amplitude * np.sin(tau * (first + rate * t / 2) * t)

    @staticmethod
    def bumps(amplitude: float, times: np.ndarray, width: float) -> Law:
        """Gaussian pushes at these times [s], up and down in turn."""
        signs = (-1.0) ** np.arange(times.size)
        return lambda t, _q, _v: amplitude * float(signs @ np.exp(-(((t - times) / width) ** 2) / 2))
