"""The arm of `../five_bar.py` with friction in its joints that sticks, on a plane that may be tilted, with a mass at some place of a link.

a point  p = sum_k c_k e(a_k) + d_k n(a_k),   p'' = P q'' + g,   P = sum_k (c_k n - d_k e) S_k
a mass there adds  P'P m  to M and  -P'(m g) + P' m g_0 sin(tilt) (cos, sin)(direction)  to f
"""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ..five_bar import OFFSET, Arm
from ..run import Conditions
from ..servo import Servo
from ..stick_slip import Friction
from .actuator import Position
from .motions import reference
from .rig import Machine

__all__ = ["CONDITIONS", "LINKS", "Joints", "position"]

CONDITIONS = Conditions(duration=10.0, step=0.002, noise={"theta_1": 1e-4, "theta_2": 1e-4})
LINKS = ("link_12", "link_4", "link_56", "link_3")
FIRST_MOMENT = 0.15  # kg m, of link 12 about its joint; it matters only while the plane is tilted
G = 9.81


@dataclass(frozen=True, kw_only=True)
class Joints(Machine):
    """The arm; tau_c [N m] of both joints, tilt and direction of the steepest descent [rad], added mass [kg] at (x, y) [m] of `link`."""

    arm: Arm = field(default_factory=Arm)
    tau_1: float = 0.0
    tau_2: float = 0.0
    tilt: float = 0.0
    direction: float = -np.pi / 2
    link: str = "link_56"
    mass: float = 0.0
    x: float = 0.0
    y: float = 0.0

    places: ClassVar[tuple[str, ...]] = ("joint_1", "joint_2")
    inputs: ClassVar[tuple[str, ...]] = ("tau_1", "tau_2")
    outputs: ClassVar[tuple[str, ...]] = ("theta_1", "theta_2")

    @property
    def start(self) -> np.ndarray:
        """theta_1, theta_2."""
        return np.array([0.0, OFFSET])

    @property
    def friction(self) -> Friction:
        """Of the joints."""
        level = np.array([self.tau_1, self.tau_2])
        return Friction(sliding=level, breakaway=level)

    def equations(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """M and f."""
        M, h = self.arm.equations(q, v)
        f = -h
        if self.mass or self.tilt:
            a, S, s = self.arm.links(q, v)
            e, n, rate = np.array([np.cos(a), np.sin(a)]), np.array([-np.sin(a), np.cos(a)]), S @ v
            if self.mass:
                c, d = self.place()
                P = (n * c - e * d) @ S
                g = (n * c - e * d) @ s - (e * c + n * d) @ rate**2
                M, f = M + self.mass * P.T @ P, f - self.mass * P.T @ g
            if self.tilt:
                weight = G * np.sin(self.tilt) * np.array([np.cos(self.direction), np.sin(self.direction)])
                moments = FIRST_MOMENT * np.array([1.0, 0, 0, 0]) + sum(m * c for m, c in self.arm.points)
                f = f + weight @ (n * moments) @ S
                if self.mass:
                    f = f + self.mass * weight @ P
        return M, f

    def place(self) -> tuple[np.ndarray, np.ndarray]:
        """c (4,), d (4,) of the added mass."""
        arm, i = self.arm, LINKS.index(self.link)
        c, d = np.array([(0.0, arm.l_1, arm.l_1, arm.l_1 + arm.l_2)[i], 0.0, 0.0, 0.0]), np.zeros(4)
        if self.link == "link_56":
            c[1] = arm.l_4
        c[i], d[i] = c[i] + self.x, self.y
        return c, d

    def drive(self, u: np.ndarray) -> np.ndarray:
        """The torques."""
        return u

    def read(self, q: np.ndarray, _v: np.ndarray, _a: np.ndarray, /) -> np.ndarray:
        """The angles."""
        return q


def position(kind: str, time: np.ndarray, step: float, size: float, rng: np.random.Generator) -> Position:
    """Control of both joints along references of up to 0.5 rad times `size`."""
    servos = (
        Servo(k_p=80.0, k_d=7.5, lag=0.008, limit=2.0, resolution=1e-4, step=step),
        Servo(k_p=11.0, k_d=0.75, lag=0.008, limit=1.0, resolution=1e-4, step=step),
    )
    first = reference(kind, time, 0.5 * size, (0.15, 1.0), rng)
    second = reference(kind, time, 0.4 * size, (0.3, 2.5), rng)
    return Position(servos, (0, 1), (first, (second[0] + OFFSET, second[1])))
