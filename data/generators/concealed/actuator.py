"""The axis of `../actuator.py`, its screw rigid, elastic or loose, its friction with or without presliding.

    rigid     m x'' = F - d x' - f_0 - c                                       c Coulomb friction, f_c, that sticks
    elastic   m_m x_m'' = F - s,   (m - m_m) x'' = s - d x' - f_0 - c          s = k p(x_m - x) + d_s (x_m' - x')
    loose     the same with s = k p (1 + e (x_m' - x') sgn p)                  p what is left of x_m - x beyond +-gap/2
    bristles  c = sigma_0 z,   z' = x' - sigma_0 |x'| z/f_c                    (P. R. Dahl, 1968) instead of Coulomb friction

The encoder sits on the motor or on the carriage.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..run import Conditions
from ..servo import Servo, Tracking
from ..stick_slip import Friction
from .motions import reference
from .rig import Machine

__all__ = ["CONDITIONS", "Axis", "Position", "position"]

CONDITIONS = Conditions(duration=10.0, step=0.002, noise={"x": 5e-6})
REBOUND = 20.0  # s/m, e: how much of the energy a contact takes


@dataclass(frozen=True, kw_only=True)
class Axis(Machine):
    """m [kg], d [N s/m], f_c, f_0 [N]; screw k [N/m] (inf: rigid), d_s [N s/m], gap [m], m_m [kg]; sigma_0 [N/m] (inf: sticking)."""

    m: float
    d: float
    f_c: float
    f_0: float = 0.0
    k: float = np.inf
    d_s: float = 0.0
    gap: float = 0.0
    m_m: float = 20.0
    encoder: str = "motor"
    sigma_0: float = np.inf

    places: ClassVar[tuple[str, ...]] = ("carriage",)
    inputs: ClassVar[tuple[str, ...]] = ("F",)
    outputs: ClassVar[tuple[str, ...]] = ("x",)

    @property
    def elastic(self) -> bool:
        return bool(np.isfinite(self.k))

    @property
    def bristles(self) -> bool:
        return bool(np.isfinite(self.sigma_0))

    @property
    def substeps(self) -> int:
        """A screw swings at some 50 Hz, bristles follow within f_c/(sigma_0 |v|), and corners of a gap lie anywhere in a step.

        The error of the output is 0.01 of its noise or less.
        """
        return 8 if self.gap else 4 if self.elastic or self.bristles else 1

    @property
    def start(self) -> np.ndarray:
        """x_m or x, x where the screw is elastic, the bristles' state."""
        return np.zeros(1 + self.elastic + self.bristles)

    @property
    def friction(self) -> Friction:
        """Of the carriage."""
        level = np.zeros(self.start.size)
        level[int(self.elastic)] = 0.0 if self.bristles else self.f_c
        return Friction(sliding=level, breakaway=level)

    def equations(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """M and f; the last velocity is z where there are bristles."""
        own = int(self.elastic)
        M, f = np.eye(q.size), np.zeros(q.size)
        M[own, own] = self.m - self.m_m * own
        f[own] = -self.d * v[own] - self.f_0
        if self.elastic:
            M[0, 0], s = self.m_m, self.screw(float(q[0] - q[1]), float(v[0] - v[1]))
            f[0] -= s
            f[1] += s
        if self.bristles:
            f[own] -= self.sigma_0 * v[-1]
            f[-1] = v[own] - self.sigma_0 * abs(v[own]) * v[-1] / self.f_c
        return M, f

    def screw(self, twist: float, rate: float) -> float:
        """The force of the screw on the carriage [N]."""
        if self.gap == 0:
            return self.k * twist + self.d_s * rate
        pressed = twist - float(np.clip(twist, -self.gap / 2, self.gap / 2))
        return self.k * pressed * max(0.0, 1 + REBOUND * rate * float(np.sign(pressed)))

    def drive(self, u: np.ndarray) -> np.ndarray:
        """The motor acts on the first coordinate."""
        out = np.zeros(1 + self.elastic + self.bristles)
        out[0] = u[0]
        return out

    def read(self, q: np.ndarray, _v: np.ndarray, _a: np.ndarray, /) -> np.ndarray:
        """The encoder."""
        return self.plain(q)

    def plain(self, motion: np.ndarray) -> np.ndarray:
        """What the encoder moves with."""
        seen = int(self.elastic and self.encoder == "carriage")
        return motion[seen : seen + 1]


class Position:
    """Servo drives that follow references of their readings, whichever outputs these are."""

    def __init__(self, servos: tuple[Servo, ...], seen: tuple[int, ...], wanted: tuple[tuple[np.ndarray, np.ndarray], ...]) -> None:
        self.servos, self.seen, self.wanted = servos, seen, wanted
        self.tracking = [Tracking(reading=float(x[0])) for x, _ in wanted]

    def command(self, k: int, readings: np.ndarray) -> np.ndarray:
        """One command for every servo."""
        out = np.empty(len(self.servos))
        for i, (servo, (x, v)) in enumerate(zip(self.servos, self.wanted, strict=True)):
            out[i], self.tracking[i] = servo.command(self.tracking[i], float(readings[self.seen[i]]), float(x[k]), float(v[k]))
        return out


def position(kind: str, time: np.ndarray, step: float, size: float, rng: np.random.Generator, stiffness: float = 1.0) -> Position:
    """The control of the axis along a reference of up to 0.15 m times `size`: 40 rad/s and a damping ratio of 0.7 with the usual mass.

    stiffness: the gains' factor; behind a soft screw the full ones swing.
    """
    servo = Servo(k_p=152e3 * stiffness, k_d=5300.0 * stiffness, lag=0.004, limit=450.0, resolution=0.01, step=step)
    return Position((servo,), (0,), (reference(kind, time, 0.15 * size, (0.15, 2.0), rng),))
