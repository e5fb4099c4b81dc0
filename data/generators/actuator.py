"""A prismatic axis under position control, with Coulomb friction that sticks: the machine of `axis.py` with any parameters and any force.

m x'' = F - d x' - c - f_0 + force of PLACES        c = f_c sgn(x') while it slides; it sticks while |c| <= f_st     (`stick_slip.py`)
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from .references import Reference, smooth_random, strokes
from .run import Conditions, Force, Run, Sensors, clock, disturbance
from .servo import Servo, Tracking
from .stick_slip import Dynamics, Friction, advance

__all__ = ["CONDITIONS", "NAMES", "PLACES", "SERVO", "Carriage", "record", "simulate", "with_values"]

PLACES = ("carriage",)  # N
STEPS = 1  # of the integration from row to row
CONDITIONS = Conditions(duration=6.0, step=1e-3, noise={"x": 2e-6}, process={"carriage": 0.02})


@dataclass(frozen=True, kw_only=True)
class Carriage:
    """Mass m [kg], viscous d [N s/m] and Coulomb friction f_c [N], offset f_0 [N] against the motor; f_st [N] of sticking, None: f_c."""

    m: float = 95.109
    d: float = 203.50
    f_c: float = 20.394
    f_0: float = -3.165
    f_st: float | None = None

    @property
    def friction(self) -> Friction:
        """Sliding and sticking."""
        return Friction(sliding=np.array([self.f_c]), breakaway=np.array([self.f_c if self.f_st is None else self.f_st]))

    def dynamics(self, drive: float, force: Force | None) -> Dynamics:
        """M (1, 1) and f (1,) under a force of the motor and of the process together [N], held."""
        M = np.array([[self.m]])

        def equations(t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            f = drive - self.f_0 - self.d * v
            return M, f if force is None else f + force(t, q, v)

        return equations


NAMES = {"carriage.m": "m", "friction.d": "d", "friction.f_c": "f_c", "offset.f": "f_0"}
# Natural frequency 50 rad/s and damping ratio 0.7 with the default mass.
SERVO = Servo(k_p=240e3, k_d=6700.0, lag=0.004, limit=600.0, resolution=0.01, step=1e-3)


def simulate(
    carriage: Carriage,
    servo: Servo,
    time: np.ndarray,
    reference: Reference,
    conditions: Conditions,
    rng: np.random.Generator,
    force: Force | None,
) -> Run:
    """Follow the reference from rest at 0; force(t, q, v) with x (1,) and x' (1,)."""
    rows = time.size
    sensors, held = Sensors(conditions, rows, rng), disturbance(conditions, PLACES, time, rng)
    x, v, tracking = np.zeros(1), np.zeros(1), Tracking(reading=0.0)
    forces, states, sensed = np.empty(rows), np.empty((rows, 2)), np.empty((rows, 1))
    for k in range(rows):
        states[k], sensed[k] = (x[0], v[0]), sensors.read("x", k, float(x[0]))
        forces[k], tracking = servo.command(tracking, float(sensed[k, 0]), reference[0][k], reference[1][k])
        if k + 1 < rows:
            dynamics = carriage.dynamics(forces[k] + held[k, 0], force)
            x, v = advance(dynamics, carriage.friction, time[k], x, v, time[k + 1] - time[k], STEPS)
    return Run(
        time=time,
        inputs={"F": forces},
        outputs=sensors.recorded(("x",), sensed),
        truth={"carriage.s": states[:, 0], "carriage.v": states[:, 1], "clean.x": states[:, 0]},
        noise=dict(conditions.noise),
    )


def record(
    carriage: Carriage = Carriage(),
    *,
    seed: int = 0,
    conditions: Conditions = CONDITIONS,
    along: str = "random",
    servo: Servo = SERVO,
    force: Force | None = None,
) -> Run:
    """A run along "strokes" (ten pairs at 0.02 to 0.40 m/s in ten seconds) or "random" (smooth, up to 80 mm); a seed gives one run."""
    rng = np.random.default_rng([seed, 2])
    time = clock(conditions, rng)
    if along not in ("random", "strokes"):
        raise ValueError(f'along "{along}": it is "random" or "strokes"')
    reference = strokes(time, rng) if along == "strokes" else smooth_random(time, 0.080, (0.3, 3.0), rng)
    return simulate(carriage, servo, time, reference, conditions, rng, force)


def with_values(values: Mapping[str, float]) -> Carriage:
    """The axis with these parameters, by the names of the plant; the others keep their defaults."""
    return replace(Carriage(), **{NAMES[name]: value for name, value in values.items()})
