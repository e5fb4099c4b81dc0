"""The drillstring of `../drillstring.py` in coordinates in which friction may stick anywhere and the string have two sections.

L I' = V - R I - n K Omega_r                             I is the velocity of a charge, with the mass L
J_c Omega_r' = n K I - B_r Omega_r - s_1 - friction      s = k dphi + d dphi' of a section
J_s Omega_s' = s_1 - s_2                                 between the sections, where there are two: k_1 above, k below
J_b Omega_b' = s - B_b Omega_b - friction of the bit
"""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ..drillstring import Drillstring, SpeedLoop
from ..run import Conditions
from ..stick_slip import Friction
from .motions import reference
from .rig import Machine

__all__ = ["CONDITIONS", "Rig", "Speed", "speed"]

CONDITIONS = Conditions(duration=40.0, step=1 / 150, noise={"I_m": 5e-3, "Omega_r": 0.01})


@dataclass(frozen=True, kw_only=True)
class Rig(Machine):
    """The drillstring; d [N m s/rad] of the string, tau_r [N m] friction of the table; k_1 [N m/rad] (0: one section), J_s [kg m2]."""

    string: Drillstring = field(default_factory=Drillstring)
    d: float = 0.0
    tau_r: float = 0.0
    k_1: float = 0.0
    J_s: float = 0.01

    places: ClassVar[tuple[str, ...]] = ("motor", "rotary_table", "bha")
    inputs: ClassVar[tuple[str, ...]] = ("V",)
    outputs: ClassVar[tuple[str, ...]] = ("I_m", "Omega_r")

    @property
    def substeps(self) -> int:
        """L/R is 5 ms; the error of the outputs is 2e-4 of their noise."""
        return 2

    @property
    def start(self) -> np.ndarray:
        """Charge, angle of the table, of the bit, of what is between."""
        return np.zeros(4 if self.k_1 else 3)

    @property
    def friction(self) -> Friction:
        """Of the table and of the bit."""
        rest = np.zeros(self.start.size - 3)
        return Friction(
            sliding=np.array([0.0, self.tau_r, self.string.tau_sl, *rest]), breakaway=np.array([0.0, self.tau_r, self.string.tau_st, *rest])
        )

    def equations(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """M and f."""
        s, K = self.string, self.string.n * self.string.Km
        below = s.k * ((q[3] if self.k_1 else q[1]) - q[2]) + self.d * ((v[3] if self.k_1 else v[1]) - v[2])
        above = self.k_1 * (q[1] - q[3]) if self.k_1 else below
        f = [-s.R * v[0] - K * v[1], K * v[0] - s.B_r * v[1] - above, below - s.B_b * v[2]]
        mass = [s.L, s.J_c, s.J_b]
        return np.eye(v.size) * (mass + [self.J_s] * (self.k_1 > 0)), np.array(f + [above - below] * (self.k_1 > 0))

    def drive(self, u: np.ndarray) -> np.ndarray:
        """The voltage."""
        return np.array([u[0], 0.0, 0.0] + [0.0] * (self.k_1 > 0))

    def read(self, _q: np.ndarray, v: np.ndarray, _a: np.ndarray, /) -> np.ndarray:
        """Current and speed of the table."""
        return v[:2]

    def load(self, q: np.ndarray, v: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Voltage, torque of the motor, torque of the string."""
        return np.array([u[0], self.string.n * self.string.Km * v[0], self.string.k * (q[1] - q[2])])


class Speed:
    """A `SpeedLoop` with its integral."""

    def __init__(self, loop: SpeedLoop, wanted: np.ndarray, step: float) -> None:
        self.loop, self.wanted, self.step, self.integral = loop, wanted, step, 0.0

    def command(self, k: int, readings: np.ndarray) -> np.ndarray:
        """The voltage, in steps of 0.1 mV."""
        voltage, self.integral = self.loop.command(self.integral, float(self.wanted[k] - readings[1]), self.step)
        return np.array([round(voltage, 4)])


def speed(kind: str, time: np.ndarray, step: float, size: float, rng: np.random.Generator, both: bool = False) -> Speed:
    """Control of the table's speed about 4.5 rad/s by up to 4 rad/s times `size`; `both`: about 0, in both directions."""
    x, _ = reference(kind, time, 4.0 * size, (0.04, 0.5), rng)
    ready = np.minimum((time - time[0]) / 1.0, 1.0)
    return Speed(SpeedLoop(), x if both else ready * 4.5 + x, step)
