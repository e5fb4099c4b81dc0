"""The quadrotor of `../quadrotor.py` with what its model leaves out: its own equations of motion, for rotors and body that are not alike.

    m v' = m g e_3 + R F,   J omega' = M - omega x J omega - h,      F = sum (0, 0, -T_i) - (0, 0, d_w w) + f
    M = sum (r_i - c) x (0, 0, -T_i) - s_i c_t T_i e_3 - D J omega + m        c = (x, y, 0) the centre of mass in the frame
    n_i' = (gain u_i - n_i)/tau   up, /tau_down down                         T_i = n_i^2
    h = J_r (sum s_i W_i' e_3 + omega x sum s_i W_i e_3),  W_i = SPEED n_i    of the rotors' own inertia J_r, where there is any

The accelerometer sits at the frame's centre and reads F/m + omega' x (-c) + omega x (omega x (-c)).
"""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ..quadrotor import SIDE, SPIN, G, Pilot, Quadrotor, angles, rotation
from ..run import Conditions, Sensors, clock
from ..runge_kutta import Rates, advance
from .acting import Actuation
from .effects import Effect, Wrench
from .motions import reference
from .rig import Setting, Trace, disturbance, input_faults

__all__ = ["CONDITIONS", "Craft", "fly", "shares", "stick"]

SPEED = 250.0  # rad/s of a rotor per root thrust
LONGEST_STEP = 0.01  # s, of the integration
CONDITIONS = Conditions(duration=40.0, step=0.01, noise={"ax": 0.05, "ay": 0.05, "az": 0.05, "p": 0.005, "q": 0.005, "r": 0.005})


@dataclass(frozen=True, kw_only=True)
class Craft:
    """The craft; x, y [m] of its centre of mass, tau_down [s] (0: as up), J_r [kg m2] of a rotor."""

    craft: Quadrotor = field(default_factory=Quadrotor)
    x: float = 0.0
    y: float = 0.0
    tau_down: float = 0.0
    J_r: float = 0.0

    places: ClassVar[tuple[str, ...]] = ("body.f_x", "body.f_y", "body.f_z", "body.tau_x", "body.tau_y", "body.tau_z")
    inputs: ClassVar[tuple[str, ...]] = ("u_1", "u_2", "u_3", "u_4")
    outputs: ClassVar[tuple[str, ...]] = ("ax", "ay", "az", "p", "q", "r")

    @property
    def J(self) -> np.ndarray:
        """Moments of inertia (3,)."""
        return np.array([self.craft.I_x, self.craft.I_y, self.craft.I_z])

    def spun(self, n: np.ndarray, u: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
        """Root thrusts (4,) and their rates, a time h after n under the held u: each goes one way until then."""
        end = self.craft.gain * u
        tau = np.where(end < n, self.tau_down or self.craft.tau, self.craft.tau)
        gap = (n - end) * np.exp(-h / tau)
        return end + gap, -gap / tau

    def wrench(self, n: np.ndarray, rate: np.ndarray, w: float, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """F, M - h (3,) in body axes, of root thrusts and their rates, the vertical speed and the rates of turn."""
        c, T = self.craft, n * n
        arms = c.arm * SIDE - np.array([self.x, self.y])
        force = np.array([0.0, 0.0, -T.sum() - c.drag_w * w])
        torque = np.array([-arms[:, 1] @ T, arms[:, 0] @ T, -c.torque_ratio * (SPIN @ T)])
        torque -= np.array([c.drag_p, c.drag_q, c.drag_r]) * self.J * omega
        if self.J_r:
            h, dh = self.J_r * SPEED * float(SPIN @ n), self.J_r * SPEED * float(SPIN @ rate)
            torque -= np.array([omega[1] * h, -omega[0] * h, dh])
        return force, torque

    def accelerometer(self, F: np.ndarray, omega: np.ndarray, alpha: np.ndarray) -> np.ndarray:
        """Its reading (3,)."""
        lever = -np.array([self.x, self.y, 0.0])
        return F / self.craft.m + np.cross(alpha, lever) + np.cross(omega, np.cross(omega, lever))


def fly(craft: Craft, pilot: Pilot, moves: np.ndarray, setting: Setting, effects: tuple[Effect, ...], rng: np.random.Generator) -> Trace:
    """Fly the stick (rows, 4) from hover; q = (position, Q), v = (u, v, w, p, q, r), a = (F, M) of the trace at every row."""
    time = clock(setting.conditions, rng)
    rows, base = time.size, craft.craft
    sensors, held = Sensors(setting.conditions, rows, rng), disturbance(setting, craft.places, 6, time, rng)
    told = rng.standard_normal((rows, 5)) * np.array([*[pilot.attitude_std] * 2, *[pilot.speed_std] * 3])
    actuation = Actuation(input_faults(effects, craft.inputs), np.full(4, base.hover))
    y, n = np.concatenate([np.zeros(3), [1.0], np.zeros(9)]), np.full(4, np.sqrt(base.m * G / 4))
    commands, acted, qs, vs, forces, clean = (np.empty((rows, k)) for k in (4, 4, 7, 6, 6, 6))
    jumps = np.zeros_like(clean)
    for k in range(rows):
        R, omega = rotation(y[3:7]), y[10:]
        speed, euler = R.T @ y[7:10], angles(R)
        gyro = np.array([sensors.read(o, k, float(w)) for o, w in zip(("p", "q", "r"), omega, strict=True)])
        commands[k] = np.round(pilot.command(base.hover, moves[k], euler[:2] + told[k, :2], speed + told[k, 2:], gyro), 6)
        acting = [e.force for e in effects if e.force is not None and e.acts(time[k])]
        end = time[k + 1] if k + 1 < rows else time[k] + setting.conditions.step
        for piece, (t, until, u) in enumerate(actuation.pieces(time[k], end, commands[k])):
            # A lagging command is held over each piece at its value in the middle; without a lag it is held anyway.
            now = u((t + until) / 2)
            if piece == 0:
                F, M = _total(craft, *craft.spun(n, now, 0.0), t, y, held[k], acting)
                qs[k], vs[k], forces[k] = y[:7], np.concatenate([speed, omega]), np.concatenate([F, M])
                clean[k], acted[k] = _felt(craft, F, M, omega), u(t)
            if k + 1 < rows:
                rates = motion(craft, n, now, t, held[k], acting)
                y = advance(rates, t, y, until - t, max(1, int(np.ceil((until - t) / LONGEST_STEP - 1e-9))))
                n = craft.spun(n, now, until - t)[0]
        if k + 1 < rows:
            jumps[k + 1] = -_felt(craft, *_total(craft, *craft.spun(n, now, 0.0), end, y, held[k], acting), y[10:])
        y[3:7] /= np.linalg.norm(y[3:7])
    jumps[1:] += clean[1:]
    return Trace(time=time, commands=commands, acted=acted, q=qs, v=vs, a=forces, clean=clean, jumps=jumps, sensors=sensors)


def _felt(craft: Craft, F: np.ndarray, M: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Accelerometer and gyro (6,)."""
    alpha = (M - np.cross(omega, craft.J * omega)) / craft.J
    return np.concatenate([craft.accelerometer(F, omega, alpha), omega])


def motion(craft: Craft, n: np.ndarray, u: np.ndarray, begin: float, held: np.ndarray, forces: list[Wrench]) -> Rates:
    """y' (13,) of t and y while u is held, from the root thrusts n at the beginning."""

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        F, M = _total(craft, *craft.spun(n, u, t - begin), t, y, held, forces)
        dv = rotation(y[3:7]) @ F / craft.craft.m
        dv[2] += G
        Q, omega = y[3:7], y[10:]
        turn = np.concatenate([[-Q[1:] @ omega], Q[0] * omega + np.cross(Q[1:], omega)]) / 2
        return np.concatenate([y[7:10], turn, dv, (M - np.cross(omega, craft.J * omega)) / craft.J])

    return rates


def _total(
    craft: Craft, n: np.ndarray, rate: np.ndarray, t: float, y: np.ndarray, held: np.ndarray, forces: list[Wrench]
) -> tuple[np.ndarray, np.ndarray]:
    """F, M (3,) with what is concealed."""
    omega, speed = y[10:], rotation(y[3:7]).T @ y[7:10]
    F, M = craft.wrench(n, rate, float(speed[2]), omega)
    both = np.concatenate([F, M]) + held
    for force in forces:
        both = both + force(t, y[:7], np.concatenate([speed, omega]))
    return both[:3], both[3:]


def shares(plain: Craft, trace: Trace) -> dict[str, float]:
    """Place -> rms of what the plain craft lacks under the commands over the rms of what its rotors give there; forces: over the thrust."""
    n, lacking, load = np.full(4, np.sqrt(plain.craft.m * G / 4)), np.empty_like(trace.a), np.empty_like(trace.a)
    steps = np.diff(trace.time, append=2 * trace.time[-1] - trace.time[-2])
    for k in range(trace.time.size):
        rate = plain.spun(n, trace.commands[k], 0.0)[1]
        F, M = plain.wrench(n, rate, float(trace.v[k, 2]), trace.v[k, 3:])
        lacking[k] = trace.a[k] - np.concatenate([F, M])
        T = n * n
        arms = plain.craft.arm * SIDE
        load[k] = [T.sum(), T.sum(), T.sum(), arms[:, 1] @ T, arms[:, 0] @ T, plain.craft.torque_ratio * (SPIN @ T)]
        n = plain.spun(n, trace.commands[k], float(steps[k]))[0]
    rms = np.sqrt((lacking**2).mean(axis=0)) / np.sqrt((load**2).mean(axis=0))
    return dict(zip(plain.places, rms.tolist(), strict=True))


def stick(kind: str, time: np.ndarray, size: float, pilot: Pilot, rng: np.random.Generator) -> np.ndarray:
    """Movements (rows, 4) of the stick along references of the pilot's sizes, each in a band of its own."""
    bands = ((0.15, 1.3), (0.15, 1.3), (0.1, 0.9), (0.08, 0.7))
    return np.column_stack([reference(kind, time, size * a, band, rng)[0] for a, band in zip(pilot.stick, bands, strict=True)])
