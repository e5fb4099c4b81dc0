"""The gantry of `../xy_table.py` with its wheels and slides apart: an elastic belt between them, or a wheel that is not round.

    w = (w_1, w_2, w_3)  ways of the wheels, r phi        s = (s_1, s_2, s_y)  places of the slides and the tool
    rigid      s_i = w_i
    elastic    s_i is a coordinate of its own, and the belt pulls with k_b (w_i - s_i) + d_b (w_i' - s_i')
    eccentric  s_i = w_i + e (sin(w_i/r + psi) - sin psi)
    s' = S v, s'' = S a + g;   M = S' M_s(s) S + wheels,   f = S' (f_s - M_s g) + wheels

The motors' scales x_m, y_m read the wheels. The spindle between wheels 1 and 2: (k dphi + k_3 dphi^3 + d dphi')/r.
"""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ..run import Conditions
from ..servo import Servo
from ..stick_slip import Friction
from ..xy_table import Table
from .actuator import Position
from .motions import reference
from .rig import Machine

__all__ = ["CONDITIONS", "Gantry", "position"]

START = 0.5  # m from slide 1
CONDITIONS = Conditions(duration=8.0, step=0.002, noise={"x_r": 5e-5, "y_r": 5e-5, "ax_r": 0.05, "ay_r": 0.05, "x_m": 5e-5, "y_m": 5e-5})


@dataclass(frozen=True, kw_only=True)
class Gantry(Machine):
    """The table; k_3 [N m/rad3] of the spindle; `belt`: 0 or 2, the wheel with an elastic one, k_b [N/m], d_b [N s/m]; e [m], psi."""

    table: Table = field(default_factory=Table)
    k_3: float = 0.0
    belt: int = -1
    k_b: float = 0.0
    d_b: float = 0.0
    e: float = 0.0
    psi: float = 0.7

    places: ClassVar[tuple[str, ...]] = ("drive_1", "drive_2", "drive_3")
    inputs: ClassVar[tuple[str, ...]] = ("I_x", "I_y")
    outputs: ClassVar[tuple[str, ...]] = ("x_r", "y_r", "ax_r", "ay_r", "x_m", "y_m")

    @property
    def start(self) -> np.ndarray:
        """w_1, w_2, w_3, and the slide behind an elastic belt."""
        at = np.array([0.0, 0.0, START])
        return at if self.belt < 0 else np.append(at, at[self.belt])

    @property
    def friction(self) -> Friction:
        """At the wheels."""
        level = np.append(self.table.friction.sliding, np.zeros(self.start.size - 3))
        return Friction(sliding=level, breakaway=level)

    def slides(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """s (3,), S (3, n), g (3,)."""
        s, S, g = q[:3].copy(), np.eye(3, q.size), np.zeros(3)
        if self.belt >= 0:
            s[self.belt] = q[3]
            S[self.belt, self.belt], S[self.belt, 3] = 0.0, 1.0
        if self.e:
            angle, r = q[0] / self.table.r + self.psi, self.table.r
            s[0] += self.e * (np.sin(angle) - np.sin(self.psi))
            S[0, 0] += self.e / r * np.cos(angle)
            g[0] = -self.e / r**2 * np.sin(angle) * v[0] ** 2
        return s, S, g

    def equations(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """M and f [kg, N]."""
        table, (s, S, g) = self.table, self.slides(q, v)
        j, r = table.lever(s), table.r
        wheels = np.array([table.J_1, table.J_2, table.J_3]) / r**2
        slides = table.fixed - np.diag(wheels) + table.m_e * np.outer(j, j)
        M, f = S.T @ slides @ S, S.T @ (-table.m_e * table.turning(S @ v) * j - slides @ g)
        M[[0, 1, 2], [0, 1, 2]] += wheels
        twist, rate = (q[0] - q[1]) / r, (v[0] - v[1]) / r
        spindle = (table.k * twist + self.k_3 * twist**3 + table.d * rate) / r
        f[0] -= spindle
        f[1] += spindle
        f[:3] -= np.array([table.d_1, table.d_2, table.d_3]) * v[:3] / r**2
        if self.belt >= 0:
            pull = self.k_b * (q[self.belt] - q[3]) + self.d_b * (v[self.belt] - v[3])
            f[self.belt] -= pull
            f[3] += pull
        return M, f

    def drive(self, u: np.ndarray) -> np.ndarray:
        """Of the motors at wheels 1 and 3 [N]."""
        out = np.zeros(3 + (self.belt >= 0))
        out[0], out[2] = self.table.K_x * u[0] / self.table.r, self.table.K_y * u[1] / self.table.r
        return out

    def read(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Tool, its accelerometer, scales."""
        s, S, g = self.slides(q, v)
        out = self.table.outputs(s, S @ v, S @ a + g)
        out[4], out[5] = q[0], q[2]
        return out

    def load(self, q: np.ndarray, _v: np.ndarray, u: np.ndarray, /) -> np.ndarray:
        """The motors' forces, and that of the spindle at wheel 2 [N]."""
        out = self.drive(u)[:3]
        out[1] = self.table.k * (q[0] - q[1]) / self.table.r**2
        return out


def position(kind: str, time: np.ndarray, step: float, size: float, rng: np.random.Generator) -> Position:
    """Control of both motors along references of up to 60 mm times `size`; 30 rad/s and a damping ratio of 0.8."""
    servos = (
        Servo(k_p=1450.0, k_d=78.0, lag=0.003, limit=12.0, resolution=1e-3, step=step),
        Servo(k_p=760.0, k_d=40.0, lag=0.003, limit=12.0, resolution=1e-3, step=step),
    )
    x, y = (reference(kind, time, 0.060 * size, (0.3, 3.0), rng) for _ in range(2))
    return Position(servos, (4, 5), (x, (y[0] + START, y[1])))
