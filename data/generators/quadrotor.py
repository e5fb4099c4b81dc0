"""A quadrotor under attitude control that follows a joystick, by the equations of Newton and Euler and a quaternion.

    m v' = m g e_3 + R F         J omega' = M - omega x J omega            v velocity in the earth's axes, z down; omega in body axes
    x' = v                       Q' = 1/2 Q (0, omega)                     Q unit quaternion, R = R(Q) from body to earth
    F = sum (0, 0, -T_i) - (0, 0, d_w w) + f     M = sum r_i x (0, 0, -T_i) - s_i c T_i e_3 - D J omega + m
    T_i = n_i^2                  n_i' = (gain u_i - n_i)/tau               n_i root of the thrust, solved in closed form; w = (R^T v)_3

Rotors 1 .. 4 sit before left, before right, behind right, behind left at 45 degrees, r_i = arm (+-1, +-1, 0)/sqrt(2); 1 and 3 turn about
+z (s = 1), 2 and 4 against it. f and m are the forces and torques of PLACES. The accelerometer reads F/m, the gyro omega.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from .references import joystick
from .run import Conditions, Force, Run, Sensors, clock, disturbance
from .runge_kutta import advance

__all__ = ["CONDITIONS", "NAMES", "PLACES", "Pilot", "Quadrotor", "record", "simulate", "with_values"]

G = 9.81  # m/s2
SIDE = np.array([[1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]]) / np.sqrt(2)  # x, y of the rotors over the arm
SPIN = np.array([1.0, -1.0, 1.0, -1.0])
PLACES = ("body.f_x", "body.f_y", "body.f_z", "body.tau_x", "body.tau_y", "body.tau_z")
OUTPUTS = ("ax", "ay", "az", "p", "q", "r")
LONGEST_STEP = 0.005  # s, of the integration
CONDITIONS = Conditions(
    duration=30.0,
    step=0.02,
    noise={"ax": 0.05, "ay": 0.05, "az": 0.05, "p": 0.005, "q": 0.005, "r": 0.005},
    process={"body.tau_x": 5e-4, "body.tau_y": 5e-4, "body.tau_z": 2e-4},
)


@dataclass(frozen=True, kw_only=True)
class Quadrotor:
    """Mass m [kg], arm [m], moments of inertia [kg m2], drag_w [N s/m] of the vertical speed, drag_p, q, r [1/s] of the rates, lag tau [s]
    of the rotors' speed, gain [sqrt N] (a rotor settles at the thrust (gain u)^2), torque_ratio [m] of reaction torque over thrust."""

    m: float = 1.5
    arm: float = 0.30
    I_x: float = 0.015
    I_y: float = 0.015
    I_z: float = 0.028
    drag_w: float = 0.3
    drag_p: float = 0.5
    drag_q: float = 0.5
    drag_r: float = 0.2
    tau: float = 0.05
    gain: float = 2.74
    torque_ratio: float = 0.016

    @property
    def hover(self) -> float:
        """The command at which it hovers."""
        return float(np.sqrt(self.m * G / 4) / self.gain)


NAMES = {
    "body.m": "m",
    "arm": "arm",
    "body.Ixx": "I_x",
    "body.Iyy": "I_y",
    "body.Izz": "I_z",
    "body.drag_w": "drag_w",
    "body.drag_p": "drag_p",
    "body.drag_q": "drag_q",
    "body.drag_r": "drag_r",
    "rotor.tau": "tau",
    "rotor.gain": "gain",
    "rotor.torque_ratio": "torque_ratio",
}


@dataclass(frozen=True, kw_only=True)
class Pilot:
    """The law that closes the loop: roll and pitch by angle and rate, yaw by rate, climb by speed; gains in command per rad, rad/s, m/s.

    It knows the attitude up to `attitude_std` [rad] and the speeds up to `speed_std` [m/s], which are not recorded, and the gyro's
    readings; `brake` [rad s/m] leans it against its horizontal speed. Stick: amplitudes of roll and pitch [rad], yaw [rad/s], climb [m/s].
    """

    angle: float = 0.06
    rate: float = 0.015
    yaw: float = 0.12
    climb: float = 0.08
    brake: float = 0.03
    attitude_std: float = 0.01
    speed_std: float = 0.05
    stick: tuple[float, float, float, float] = (0.35, 0.35, 1.2, 1.5)

    def command(self, hover: float, stick: np.ndarray, attitude: np.ndarray, speed: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """u (4,) in [0, 1] from the stick (4,), attitude (roll, pitch) [rad], speed in body axes (3,) and gyro (3,)."""
        roll = self.angle * (stick[0] - self.brake * speed[1] - attitude[0]) - self.rate * rates[0]
        pitch = self.angle * (stick[1] + self.brake * speed[0] - attitude[1]) - self.rate * rates[1]
        yaw = self.yaw * (stick[2] - rates[2])
        lift = hover + self.climb * (stick[3] + speed[2])
        # Rotor 1 (before left) lifts for a roll to the right and a pitch up, and turns the body against its own sense.
        mixed: np.ndarray = lift - np.sign(SIDE[:, 1]) * roll + np.sign(SIDE[:, 0]) * pitch - SPIN * yaw
        limited: np.ndarray = np.clip(mixed, 0.0, 1.0)
        return limited


def rotation(Q: np.ndarray) -> np.ndarray:
    """R (3, 3) of a quaternion Q (4,), scalar first, of any length."""
    a, b = Q[0], Q[1:]
    cross = np.array([[0.0, -b[2], b[1]], [b[2], 0.0, -b[0]], [-b[1], b[0], 0.0]])
    square = a * a + b @ b
    turned: np.ndarray = np.eye(3) + (2 * a * cross + 2 * cross @ cross) / square
    return turned


def angles(R: np.ndarray) -> np.ndarray:
    """Roll, pitch, yaw [rad] of R = R_z(yaw) R_y(pitch) R_x(roll)."""
    return np.array([np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(np.clip(R[2, 0], -1, 1)), np.arctan2(R[1, 0], R[0, 0])])


def wrench(craft: Quadrotor, n: np.ndarray, climb: float, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force F (3,) [N] without gravity and torque M (3,) [N m] in body axes, of root thrusts n (4,), speed w [m/s] and rates omega (3,)."""
    T = n * n
    force = np.array([0.0, 0.0, -T.sum() - craft.drag_w * climb])
    arms = craft.arm * SIDE
    torque = np.array([-arms[:, 1] @ T, arms[:, 0] @ T, -craft.torque_ratio * (SPIN @ T)])
    drag = np.array([craft.drag_p, craft.drag_q, craft.drag_r]) * np.array([craft.I_x, craft.I_y, craft.I_z])
    return force, torque - drag * omega


def fly(
    craft: Quadrotor, y: np.ndarray, n: np.ndarray, u: np.ndarray, t: float, h: float, held: np.ndarray, force: Force | None
) -> np.ndarray:
    """The state y (13,) of position, Q, velocity, omega a time h later under the command u (4,) and the forces held (6,)."""
    J = np.array([craft.I_x, craft.I_y, craft.I_z])

    def rates(now: float, y: np.ndarray) -> np.ndarray:
        Q, v, omega = y[3:7], y[7:10], y[10:]
        R = rotation(Q)
        body_v = R.T @ v
        F, M = wrench(craft, spun(craft, n, u, now - t), body_v[2], omega)
        more = held if force is None else held + force(now, y[:7], np.concatenate([body_v, omega]))
        dv = R @ (F + more[:3]) / craft.m
        dv[2] += G
        turn = np.concatenate([[-Q[1:] @ omega], Q[0] * omega + np.cross(Q[1:], omega)]) / 2
        return np.concatenate([v, turn, dv, (M + more[3:] - np.cross(omega, J * omega)) / J])

    y = advance(rates, t, y, h, max(1, int(np.ceil(h / LONGEST_STEP - 1e-9))))
    y[3:7] /= np.linalg.norm(y[3:7])
    return y


def spun(craft: Quadrotor, n: np.ndarray, u: np.ndarray, h: float) -> np.ndarray:
    """Root thrusts (4,) a time h after n under the held command u."""
    end = craft.gain * u
    after: np.ndarray = end + (n - end) * np.exp(-h / craft.tau)
    return after


def simulate(
    craft: Quadrotor,
    pilot: Pilot,
    time: np.ndarray,
    stick: np.ndarray,
    conditions: Conditions,
    rng: np.random.Generator,
    force: Force | None,
) -> Run:
    """Fly the stick (n, 4) from hover at rest; force(t, q, v) with q = (position, Q), v = (u, v, w, p, q, r) in body axes."""
    rows = time.size
    sensors, held = Sensors(conditions, rows, rng), disturbance(conditions, PLACES, time, rng)
    attitude_error, speed_error = pilot.attitude_std * rng.standard_normal((rows, 2)), pilot.speed_std * rng.standard_normal((rows, 3))
    y, n = np.concatenate([np.zeros(3), [1.0], np.zeros(9)]), np.full(4, np.sqrt(craft.m * G / 4))
    commands, states, sensed, clean = np.empty((rows, 4)), np.empty((rows, 16)), np.empty((rows, 6)), np.empty((rows, 6))
    for k in range(rows):
        R = rotation(y[3:7])
        speed, omega = R.T @ y[7:10], y[10:]
        more = held[k] if force is None else held[k] + force(time[k], y[:7], np.concatenate([speed, omega]))
        clean[k] = np.concatenate([(wrench(craft, n, speed[2], omega)[0] + more[:3]) / craft.m, omega])
        sensed[k] = [sensors.read(name, k, value) for name, value in zip(OUTPUTS, clean[k], strict=True)]
        euler = angles(R)
        states[k] = np.concatenate([y[:3], speed, euler, omega, n * n])
        commands[k] = pilot.command(craft.hover, stick[k], euler[:2] + attitude_error[k], speed + speed_error[k], sensed[k, 3:])
        h = time[k + 1] - time[k] if k + 1 < rows else 0.0
        if h > 0:
            y, n = fly(craft, y, n, commands[k], time[k], h, held[k], force), spun(craft, n, commands[k], h)
    names = [f"body.{s}" for s in ("x", "y", "z", "u", "v", "w", "phi", "theta", "psi", "p", "q", "r")] + [
        f"rotor_{i}.thrust" for i in (1, 2, 3, 4)
    ]
    return Run(
        time=time,
        inputs={f"u_{i + 1}": commands[:, i] for i in range(4)},
        outputs=sensors.recorded(OUTPUTS, sensed),
        truth=dict(zip(names, states.T, strict=True)) | {f"clean.{o}": c for o, c in zip(OUTPUTS, clean.T, strict=True)},
        noise=dict(conditions.noise),
    )


def record(
    craft: Quadrotor = Quadrotor(),
    *,
    seed: int = 0,
    conditions: Conditions = CONDITIONS,
    pilot: Pilot = Pilot(),
    force: Force | None = None,
) -> Run:
    """A flight with random stick movements; the same seed gives the same run."""
    rng = np.random.default_rng([seed, 4])
    time = clock(conditions, rng)
    stick = np.column_stack([joystick(time, amplitude, rng) for amplitude in pilot.stick])
    return simulate(craft, pilot, time, stick, conditions, rng, force)


def with_values(values: Mapping[str, float]) -> Quadrotor:
    """The craft with these parameters, by the names of the plant; the others keep their defaults."""
    return replace(Quadrotor(), **{NAMES[name]: value for name, value in values.items()})
