"""A drillstring under speed control: linear between the bit's stops and starts, and solved there by matrix exponentials.

    L I' = V - R I - n Km Omega_r                             y = (I, Omega_r, dphi, Omega_b)
    J_c Omega_r' = n Km I - B_r Omega_r - k dphi              y' = A y + b         s = +1, -1: the bit slides that way
    dphi' = Omega_r - Omega_b                                                      s = 0: it sticks, Omega_b = 0
    J_b Omega_b' = k dphi - B_b Omega_b - tau_sl s            it sticks while |k dphi + m| <= tau_st, m the force on the bit

b holds the voltage, the friction of the mode and the forces of PLACES. The flow of a mode is exact for any length of time, so that the
instants of stopping and starting are found as roots of it; they are looked for every SUBSTEP. White forces are drawn as often: held over a
whole step they would not be white to a current that settles within it (held over h, L/R = T: its variance is 2 T/h (1 - a)/(1 + a) of that
under a white voltage, a = exp(-h/T), for the 0.02 s of a step and 5 ms a half).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from .references import levels
from .run import Conditions, Force, Run, Sensors, clock, disturbance

__all__ = ["CONDITIONS", "NAMES", "PLACES", "Drillstring", "SpeedLoop", "record", "simulate", "with_values"]

STATES = ("motor.i", "rotary_table.omega", "string.dphi", "bha.omega")
OUTPUTS = ("I_m", "Omega_r")
PLACES = ("motor", "rotary_table", "bha")  # V, N m, N m
SUBSTEP = 0.0025  # s; a bit that stops and turns back within it is not seen to stop
CONDITIONS = Conditions(
    duration=40.0,
    step=0.02,
    noise={"I_m": 2e-3, "Omega_r": 0.01},
    process={"motor": 0.02, "rotary_table": 2e-3, "bha": 2e-3},
)


@dataclass(frozen=True, kw_only=True)
class Drillstring:
    """L [H], R [ohm], n, Km [V s/rad], J_c, J_b [kg m2], B_r, B_b [N m s/rad], k [N m/rad], tau_sl, tau_st [N m] sliding and breakaway."""

    L: float = 0.116
    R: float = 22.0
    n: float = 1.0
    Km: float = 11.0
    J_c: float = 0.3
    B_r: float = 0.03
    k: float = 0.0868
    J_b: float = 0.0529
    B_b: float = 0.001
    tau_sl: float = 0.4
    tau_st: float = 0.6

    def __post_init__(self) -> None:
        if not 0 <= self.tau_sl <= self.tau_st:
            raise ValueError(f"tau_sl {self.tau_sl}, tau_st {self.tau_st} N m: needs 0 <= tau_sl <= tau_st, or the bit could not rest")

    @cached_property
    def sliding(self) -> np.ndarray:
        """A (4, 4) of a bit that slides."""
        K = self.n * self.Km
        return np.array(
            [
                [-self.R / self.L, -K / self.L, 0.0, 0.0],
                [K / self.J_c, -self.B_r / self.J_c, -self.k / self.J_c, 0.0],
                [0.0, 1.0, 0.0, -1.0],
                [0.0, 0.0, self.k / self.J_b, -self.B_b / self.J_b],
            ]
        )

    @cached_property
    def sticking(self) -> np.ndarray:
        """A (4, 4) of a bit that sticks."""
        A = self.sliding.copy()
        A[3] = 0.0
        return A

    def drive(self, s: int, voltage: float, forces: np.ndarray) -> np.ndarray:
        """b (4,) of mode s under the voltage and the forces (3,) of PLACES."""
        bit = (forces[2] - self.tau_sl * s) / self.J_b if s else 0.0
        return np.array([(voltage + forces[0]) / self.L, forces[1] / self.J_c, 0.0, bit])

    def mode(self, y: np.ndarray, more: float) -> int:
        """The mode of a bit at rest under the string and the force `more` [N m]."""
        torque = self.k * y[2] + more
        return 0 if abs(torque) <= self.tau_st else int(np.sign(torque))


NAMES = {
    "motor.L": "L",
    "motor.R": "R",
    "motor.Km": "Km",
    "gear.ratio": "n",
    "rotary_table.J": "J_c",
    "rotary_table.d": "B_r",
    "string.k": "k",
    "bha.J": "J_b",
    "bha.d": "B_b",
    "bit.tau_sl": "tau_sl",
    "bit.tau_st": "tau_st",
}


@dataclass(frozen=True, kw_only=True)
class SpeedLoop:
    """V = k_p e + k_i int e dt, e the error of the measured speed of the table; limited to +-limit [V], and then it does not integrate."""

    k_p: float = 20.0
    k_i: float = 30.0
    limit: float = 200.0

    def command(self, integral: float, error: float, h: float) -> tuple[float, float]:
        """The voltage and the integral [rad] after a step of length h [s]."""
        wanted = self.k_p * error + self.k_i * integral
        voltage = min(max(wanted, -self.limit), self.limit)
        return voltage, integral + h * error if voltage == wanted else integral


class Rig:
    """The drillstring from one instant to the next, with the exponentials of the common step kept."""

    def __init__(self, string: Drillstring) -> None:
        self.string = string
        self.kept: dict[tuple[bool, float], tuple[np.ndarray, np.ndarray]] = {}

    def flow(self, s: int, b: np.ndarray, y: np.ndarray, h: float) -> np.ndarray:
        """y (4,) a time h later in mode s under b."""
        key = (s != 0, h)
        if key not in self.kept:
            if len(self.kept) > 1000:
                self.kept.clear()
            A = self.string.sliding if s else self.string.sticking
            both = expm(h * np.block([[A, np.eye(4)], [np.zeros((4, 8))]]))
            self.kept[key] = both[:4, :4], both[:4, 4:]
        transition, response = self.kept[key]
        after: np.ndarray = transition @ y + response @ b
        return after

    def advance(self, y: np.ndarray, s: int, voltage: float, forces: np.ndarray, h: float) -> tuple[np.ndarray, int]:
        """State and mode a time h later, the forces held; a bit at rest chooses its mode first."""
        string, left = self.string, h
        while True:
            if y[3] == 0.0:
                s = string.mode(y, forces[2])
            b = string.drive(s, voltage, forces)

            def margin(t: float, y: np.ndarray = y, s: int = s, b: np.ndarray = b) -> float:
                """Positive until the mode ends."""
                after = self.flow(s, b, y, t)
                return float(s * after[3]) if s else float(string.tau_st - abs(string.k * after[2] + forces[2]))

            if margin(left) >= 0:
                return self.flow(s, b, y, left), s
            # A bit that has just started is at rest at the beginning, and the root sought is not that one.
            low = 1e-6 * left if s and y[3] == 0.0 else 0.0
            end = brentq(margin, low, left, xtol=1e-13) if margin(low) > 0 else low
            y, left = self.flow(s, b, y, end), left - end
            if s:
                y[3] = 0.0
            else:
                s = int(np.sign(string.k * y[2] + forces[2]))
                y[3] = s * 1e-15  # on its way: at breakaway itself both modes would do
            if left <= 1e-13:
                return y, s


def simulate(
    string: Drillstring,
    loop: SpeedLoop,
    time: np.ndarray,
    speed: np.ndarray,
    conditions: Conditions,
    rng: np.random.Generator,
    force: Force | None,
) -> Run:
    """Follow the speed (n,) [rad/s] from rest; force(t, q, v) with q = (dphi), v = (Omega_r, Omega_b, I).

    Such a force is held over each substep at its value for the middle, as predicted from that of the beginning: of second order in SUBSTEP.
    """
    rows, rig = time.size, Rig(string)
    sensors, steps = Sensors(conditions, rows, rng), np.diff(time, append=time[-1] + conditions.step)
    counts = np.ceil(steps / SUBSTEP - 1e-9).astype(int)
    instants = np.concatenate([time[k] + steps[k] * np.arange(n) / n for k, n in enumerate(counts)])
    drawn = disturbance(replace(conditions, step=SUBSTEP), PLACES, instants, rng)
    held = np.split(drawn, np.cumsum(counts)[:-1])
    y, s, integral = np.zeros(4), 0, 0.0
    voltages, states, sensed = np.empty(rows), np.empty((rows, 4)), np.empty((rows, 2))
    for k in range(rows):
        states[k], sensed[k] = y, [sensors.read("I_m", k, y[0]), sensors.read("Omega_r", k, y[1])]
        h, count = steps[k], counts[k]
        voltages[k], integral = loop.command(integral, speed[k] - sensed[k, 1], h)
        for i, forces in enumerate(held[k]):
            if force is not None:
                forces = _middle(rig, y, s, voltages[k], held[k][i], time[k] + i * h / count, h / count, force)
            y, s = rig.advance(y, s, voltages[k], forces, h / count)
    return Run(
        time=time,
        inputs={"V": voltages},
        outputs=sensors.recorded(OUTPUTS, sensed),
        truth=dict(zip(STATES, states.T, strict=True)) | {"clean.I_m": states[:, 0], "clean.Omega_r": states[:, 1]},
        noise=dict(conditions.noise),
    )


def _middle(rig: Rig, y: np.ndarray, s: int, voltage: float, held: np.ndarray, t: float, h: float, force: Force) -> np.ndarray:
    def at(t: float, y: np.ndarray) -> np.ndarray:
        more: np.ndarray = held + force(t, y[2:3], y[[1, 3, 0]])
        return more

    middle, _ = rig.advance(y.copy(), s, voltage, at(t, y), h / 2)
    return at(t + h / 2, middle)


def record(
    string: Drillstring = Drillstring(),
    *,
    seed: int = 0,
    conditions: Conditions = CONDITIONS,
    loop: SpeedLoop = SpeedLoop(),
    force: Force | None = None,
) -> Run:
    """The table at random speeds between 0.5 and 9 rad/s, 2 to 5 s each; the same seed gives the same run."""
    rng = np.random.default_rng([seed, 3])
    time = clock(conditions, rng)
    return simulate(string, loop, time, levels(time, (0.5, 9.0), (2.0, 5.0), rng), conditions, rng, force)


def with_values(values: Mapping[str, float]) -> Drillstring:
    """The drillstring with these parameters, by the names of the plant; the others keep their defaults."""
    return replace(Drillstring(), **{NAMES[name]: value for name, value in values.items()})
