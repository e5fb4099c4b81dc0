"""A gantry table with a soft spindle under position control of its two motors, by Lagrange's equations in the positions of the slides.

    x = (x_1, x_2, y) = r (phi_1, phi_2, phi_3)      tool  x_r = x_1 + (x_2 - x_1) y/b,  y_r = y       alpha = (x_1 - x_2)/b
    x_r' = j x',  j = (1 - y/b, y/b, (x_2 - x_1)/b)  x_r'' = j x'' + 2 (x_2' - x_1') y'/b
    2 T = J_1 x_1'^2/r^2 + J_2 x_2'^2/r^2 + J_3 y'^2/r^2 + m_1 x_1'^2 + m_2 x_2'^2 + m_y (x_1' + x_2')^2/4 + m_y c^2/12 alpha'^2
          + m_e (x_r'^2 + y'^2)
    forces  x_1: K_x I_x/r - f_s + m_1/r   x_2: f_s + m_2/r   y: K_y I_y/r + m_3/r      f_s = (k (x_1 - x_2) + d (x_1' - x_2'))/r^2

and Coulomb friction tau_c/r with true sticking at every wheel (`stick_slip.py`). m_1 .. m_3 are the torques of PLACES.
The accelerometer sits on the tool, its axes turned by alpha.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .references import Reference, circle, smooth_random, there_and_back
from .run import Conditions, Force, Run, Sensors, clock, disturbance
from .servo import Servo, Tracking
from .stick_slip import Dynamics, Friction, accelerations, advance

__all__ = ["CONDITIONS", "NAMES", "PLACES", "SERVOS", "Table", "motion", "record", "simulate", "with_values"]

STATES = ("drive_1.phi", "drive_2.phi", "drive_3.phi", "drive_1.omega", "drive_2.omega", "drive_3.omega")
OUTPUTS = ("x_r", "y_r", "ax_r", "ay_r", "x_m", "y_m")
PLACES = ("drive_1", "drive_2", "drive_3")  # N m
STEPS = 1  # of the integration from row to row
START = 0.5  # m from slide 1, where the tool sees both slides alike
CONDITIONS = Conditions(
    duration=3.0,
    step=0.002,
    noise={"x_r": 5e-5, "y_r": 5e-5, "ax_r": 0.05, "ay_r": 0.05, "x_m": 5e-5, "y_m": 5e-5},
    process={"drive_1": 5e-4, "drive_2": 5e-4, "drive_3": 1e-4},
)


@dataclass(frozen=True, kw_only=True)
class Table:
    """r, b, c [m]; masses [kg] of the slides m_1, m_2, the slideway m_y, the tool m_e; K_x, K_y [N m/A]; wheels J [kg m2], tau [N m];
    spindle k [N m/rad], d [N m s/rad]; viscous friction of the wheels [N m s/rad]."""

    r: float = 0.010
    b: float = 1.0
    c: float = 1.25
    m_1: float = 3.8
    m_2: float = 3.8
    m_y: float = 8.5
    m_e: float = 2.3
    K_x: float = 0.258
    K_y: float = 0.056
    J_1: float = 2.33e-3
    J_2: float = 0.0
    J_3: float = 2.37e-4
    k: float = 0.275
    d: float = 0.0
    tau_1: float = 0.473
    tau_2: float = 0.0
    tau_3: float = 0.149
    d_1: float = 0.0
    d_2: float = 0.0
    d_3: float = 0.0

    @cached_property
    def fixed(self) -> np.ndarray:
        """Mass matrix (3, 3) [kg] without the tool."""
        turning = self.m_y * self.c**2 / (12 * self.b**2)
        same, other = self.m_y / 4 + turning, self.m_y / 4 - turning
        wheels = np.array([self.J_1, self.J_2, self.J_3]) / self.r**2
        slideway = np.array([[same, other, 0.0], [other, same, 0.0], [0.0, 0.0, 0.0]])
        matrix: np.ndarray = np.diag(wheels + np.array([self.m_1, self.m_2, self.m_e])) + slideway
        return matrix

    @cached_property
    def friction(self) -> Friction:
        """Coulomb friction of the wheels as forces (3,) [N] on the slides and the tool."""
        level = np.array([self.tau_1, self.tau_2, self.tau_3]) / self.r
        return Friction(sliding=level, breakaway=level)

    def lever(self, x: np.ndarray) -> np.ndarray:
        """j (3,): velocity of the tool along x per velocity of x_1, x_2, y."""
        return np.array([1 - x[2] / self.b, x[2] / self.b, (x[1] - x[0]) / self.b])

    def turning(self, v: np.ndarray) -> float:
        """The part of x_r'' that comes without accelerations [m/s2]."""
        return float(2 * (v[1] - v[0]) * v[2] / self.b)

    def dynamics(self, current: np.ndarray, held: np.ndarray, force: Force | None) -> Dynamics:
        """M and f [kg, N] under currents (2,) [A] and torques (3,) [N m] held, in x_1, x_2, y."""
        r, viscous = self.r, np.array([self.d_1, self.d_2, self.d_3])
        motor = np.array([self.K_x * current[0], 0.0, self.K_y * current[1]]) + held

        def equations(t: float, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            j = self.lever(x)
            spindle = (self.k * (x[0] - x[1]) + self.d * (v[0] - v[1])) / r
            torque = motor - viscous * v / r + np.array([-spindle, spindle, 0.0])
            if force is not None:
                torque = torque + force(t, x / r, v / r)
            return self.fixed + self.m_e * np.outer(j, j), torque / r - self.m_e * self.turning(v) * j

        return equations

    def outputs(self, x: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """What the sensors would read without noise (6,), of positions, velocities and accelerations (3,)."""
        alpha, j = (x[0] - x[1]) / self.b, self.lever(x)
        ax, ay = j @ a + self.turning(v), a[2]
        turned = np.cos(alpha) * ax + np.sin(alpha) * ay, np.cos(alpha) * ay - np.sin(alpha) * ax
        return np.array([x[0] + (x[1] - x[0]) * x[2] / self.b, x[2], *turned, x[0], x[2]])


NAMES = {
    "r": "r",
    "gantry.b": "b",
    "gantry.c": "c",
    "slide_1.m": "m_1",
    "slide_2.m": "m_2",
    "gantry.m_y": "m_y",
    "end_effector.m": "m_e",
    "motor_x.K": "K_x",
    "motor_y.K": "K_y",
    "drive_1.J": "J_1",
    "drive_2.J": "J_2",
    "drive_3.J": "J_3",
    "spindle.k": "k",
    "spindle.d": "d",
    "friction_1.tau_c": "tau_1",
    "friction_2.tau_c": "tau_2",
    "friction_3.tau_c": "tau_3",
    "friction_1.d": "d_1",
    "friction_2.d": "d_2",
    "friction_3.d": "d_3",
}
# k_p [A/m] and k_d [A s/m] for 40 rad/s and a damping ratio of 0.8 with the masses that the default motors move.
SERVOS = (
    Servo(k_p=2600.0, k_d=105.0, lag=0.002, limit=25.0, resolution=1e-3, step=0.002),
    Servo(k_p=1350.0, k_d=54.0, lag=0.002, limit=25.0, resolution=1e-3, step=0.002),
)


def simulate(
    table: Table,
    servos: tuple[Servo, Servo],
    time: np.ndarray,
    reference: tuple[Reference, Reference],
    conditions: Conditions,
    rng: np.random.Generator,
    force: Force | None,
) -> Run:
    """Follow the reference of x_1 and of y - START from rest; force(t, q, v) with the angles and angular velocities of the wheels (3,)."""
    rows = time.size
    sensors, held = Sensors(conditions, rows, rng), disturbance(conditions, PLACES, time, rng)
    x, v = np.array([0.0, 0.0, START]), np.zeros(3)
    tracking = [Tracking(reading=0.0), Tracking(reading=START)]
    currents, states, sensed, clean = np.empty((rows, 2)), np.empty((rows, 6)), np.empty((rows, 6)), np.empty((rows, 6))
    for k in range(rows):
        states[k] = np.concatenate([x, v]) / table.r
        for i, (name, place) in enumerate((("x_m", x[0]), ("y_m", x[2]))):
            wanted = reference[i][0][k] + (START if i else 0.0)
            currents[k, i], tracking[i] = servos[i].command(tracking[i], sensors.read(name, k, float(place)), wanted, reference[i][1][k])
        dynamics = table.dynamics(currents[k], held[k], force)
        clean[k] = table.outputs(x, v, accelerations(dynamics, table.friction, time[k], x, v))
        sensed[k] = [sensors.read(name, k, value) for name, value in zip(OUTPUTS, clean[k], strict=True)]
        if k + 1 < rows:
            x, v = advance(dynamics, table.friction, time[k], x, v, time[k + 1] - time[k], STEPS)
    return Run(
        time=time,
        inputs={"I_x": currents[:, 0], "I_y": currents[:, 1]},
        outputs=sensors.recorded(OUTPUTS, sensed),
        truth=dict(zip(STATES, states.T, strict=True)) | {f"clean.{o}": c for o, c in zip(OUTPUTS, clean.T, strict=True)},
        noise=dict(conditions.noise),
    )


def motion(name: str, time: np.ndarray, rng: np.random.Generator) -> tuple[Reference, Reference]:
    """References of x_1 and y: "line" (40 mm in both directions, away and back), "circle" (40 mm across) or "random" (up to 30 mm)."""
    if name == "line":
        return there_and_back(time, 0.040, 0.25), there_and_back(time, 0.040, 0.25)
    if name == "circle":
        return circle(time, 0.020, 2.0)
    if name == "random":
        return smooth_random(time, 0.030, (0.7, 5.0), rng), smooth_random(time, 0.030, (0.7, 5.0), rng)
    raise ValueError(f'motion "{name}": it is "line", "circle" or "random"')


def record(
    table: Table = Table(),
    *,
    seed: int = 0,
    conditions: Conditions = CONDITIONS,
    along: str = "random",
    servos: tuple[Servo, Servo] = SERVOS,
    force: Force | None = None,
) -> Run:
    """A run along a `motion`; the same seed gives the same run."""
    rng = np.random.default_rng([seed, 1])
    time = clock(conditions, rng)
    return simulate(table, servos, time, motion(along, time, rng), conditions, rng, force)


def with_values(values: Mapping[str, float]) -> Table:
    """The table with these parameters, by the names of the plant; the others keep their defaults."""
    return replace(Table(), **{NAMES[name]: value for name, value in values.items()})
