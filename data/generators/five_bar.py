"""A planar manipulator with a closed loop under position control: velocities of the links by the loop's closure, forces by virtual work.

    link angles a = (theta_1, theta_1 + theta_2, theta_1 + theta_3, theta_1 + theta_4) of links 12, 4, 56, 3;   e(a) = (cos a, sin a)
    loop, in the frame of link 12:  l_4 e(theta_2) + l_5 e(theta_3) = (l_2, 0) + l_3 e(theta_4)        solved by Newton's method
    a' = S q',   a'' = S q'' + s,   q = (theta_1, theta_2)
    a point  p = sum_k c_k e(a_k):     p'' = P q'' + g,   P = sum_k c_k n(a_k) S_k,   g = sum_k c_k (n(a_k) s_k - e(a_k) a_k'^2)
    sum_links [ P^T m (P q'' + g) + S_k^T I (S_k q'' + s_k) ] = tau + the torques of PLACES          n(a) = (-sin a, cos a)

In base parameters: P_1 = second moment of link 12 about its joint, P_2, P_3 = central moments of links 3 and 4; P_4, P_5, P_6 = mass, first
and second moment of link 56 about its joint.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import cos, sin

import numpy as np

from .references import Reference, smooth_random
from .run import Conditions, Force, Run, Sensors, clock, disturbance
from .runge_kutta import advance
from .servo import Servo, Tracking

__all__ = ["CONDITIONS", "NAMES", "PLACES", "SERVOS", "Arm", "record", "simulate", "with_values"]

STATES = ("joint_1.phi", "joint_2.phi", "joint_1.omega", "joint_2.omega")
OUTPUTS = ("theta_1", "theta_2")
PLACES = ("joint_1", "joint_2")  # N m
STEPS = 1  # of the integration from row to row
CONDITIONS = Conditions(duration=6.0, step=0.002, noise={"theta_1": 1e-4, "theta_2": 1e-4}, process={"joint_1": 2e-4, "joint_2": 1e-4})
OFFSET = -0.05  # rad, about which joint 2 moves


@dataclass(frozen=True, kw_only=True)
class Arm:
    """Lengths l [m], centres of mass r_3, r_4 [m], masses m_3, m_4 [kg], and the base parameters P_1 .. P_6 [kg m2, kg, kg m]."""

    P_1: float = 0.1080
    P_2: float = 0.005422
    P_3: float = 0.01029
    P_4: float = 0.6059
    P_5: float = 0.1442
    P_6: float = 0.04350
    l_1: float = 0.25
    l_2: float = 0.25
    l_3: float = 0.20
    l_4: float = 0.10
    l_5: float = 0.22
    r_3: float = 0.10
    r_4: float = 0.05
    m_3: float = 0.25
    m_4: float = 0.15

    @cached_property
    def points(self) -> tuple[tuple[float, np.ndarray], ...]:
        """Mass and coefficients c (4,) of the centre of mass of links 4, 56, 3; link 12 turns about the base."""
        return (
            (self.m_4, np.array([self.l_1, self.r_4, 0.0, 0.0])),
            (self.P_4, np.array([self.l_1, self.l_4, self.P_5 / self.P_4, 0.0])),
            (self.m_3, np.array([self.l_1 + self.l_2, 0.0, 0.0, self.r_3])),
        )

    @cached_property
    def inertias(self) -> np.ndarray:
        """Moments of inertia (4,) of links 12 (about its joint), 4, 56, 3 (about their centres of mass)."""
        return np.array([self.P_1, self.P_3, self.P_6 - self.P_5**2 / self.P_4, self.P_2])

    def loop(self, theta_2: float) -> np.ndarray:
        """theta_3, theta_4 (2,) that close the loop, from the assembly with links 56 and 3 on the side of positive angles."""
        c, s = cos(theta_2), sin(theta_2)
        three, four = (0.8, 1.8) if self.l_2 - self.l_4 * c > 0 else (2.0, 0.5)
        for _ in range(50):
            along = self.l_4 * c + self.l_5 * cos(three) - self.l_2 - self.l_3 * cos(four)
            across = self.l_4 * s + self.l_5 * sin(three) - self.l_3 * sin(four)
            ((a, b), (d, e)) = self.inner_rates((three, four))
            change = (e * along - b * across) / (a * e - b * d), (a * across - d * along) / (a * e - b * d)
            three, four = three - change[0], four - change[1]
            if max(abs(change[0]), abs(change[1])) < 1e-14:
                break
        return np.array([three, four])

    def inner_rates(self, inner: Sequence[float] | np.ndarray) -> tuple[tuple[float, float], tuple[float, float]]:
        """Derivative (2, 2) of the loop's closure with respect to theta_3, theta_4."""
        three, four = float(inner[0]), float(inner[1])
        return (-self.l_5 * sin(three), self.l_3 * sin(four)), (self.l_5 * cos(three), -self.l_3 * cos(four))

    def links(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angles a (4,), S (4, 2) and s (4,) of links 12, 4, 56, 3."""
        turn, (three, four) = float(q[1]), self.loop(float(q[1]))
        ((a, b), (d, e)) = self.inner_rates((three, four))
        determinant, outward = a * e - b * d, (cos(turn), sin(turn))

        def solved(x: float, y: float) -> tuple[float, float]:
            """theta_3, theta_4 of the loop's closure times them = (x, y)."""
            return (e * x - b * y) / determinant, (a * y - d * x) / determinant

        ratio = solved(self.l_4 * outward[1], -self.l_4 * outward[0])  # of theta_3', theta_4' to theta_2'
        turning, rate = float(v[1]) ** 2, (ratio[0] * float(v[1]), ratio[1] * float(v[1]))
        fling = self.l_4 * turning, self.l_5 * rate[0] ** 2, -self.l_3 * rate[1] ** 2
        bias = solved(
            fling[0] * outward[0] + fling[1] * cos(three) + fling[2] * cos(four),
            fling[0] * outward[1] + fling[1] * sin(three) + fling[2] * sin(four),
        )
        angles = q[0] + np.array([0.0, turn, three, four])
        return angles, np.array([[1, 0], [1, 1], [1, ratio[0]], [1, ratio[1]]]), np.array([0.0, 0.0, *bias])

    @cached_property
    def weighted(self) -> np.ndarray:
        """The coefficients of the points (3, 1, 4), times the roots of their masses."""
        return np.array([np.sqrt(m) * c for m, c in self.points])[:, None, :]

    def equations(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """M (2, 2) and h (2,) of M q'' + h = torques."""
        a, S, s = self.links(q, v)
        cosine, sine = np.cos(a), np.sin(a)
        e, n = (self.weighted * np.array([cosine, sine])).reshape(6, 4), (self.weighted * np.array([-sine, cosine])).reshape(6, 4)
        P, g, turning = n @ S, n @ s - e @ (S @ v) ** 2, S.T * self.inertias
        return turning @ S + P.T @ P, turning @ s + P.T @ g

    def energy(self, q: np.ndarray, v: np.ndarray) -> float:
        """Kinetic energy [J]."""
        return float(v @ self.equations(q, v)[0] @ v / 2)


NAMES = {f"P_{i}": f"P_{i}" for i in range(1, 7)} | {"link_3.m": "m_3", "link_4.m": "m_4", "link_3.x_c": "r_3", "link_4.x_c": "r_4"}
# k_p [N m/rad] and k_d [N m s/rad] for 15 and 20 rad/s with the default links; the limits are those of the motors.
SERVOS = (
    Servo(k_p=80.0, k_d=7.5, lag=0.008, limit=2.0, resolution=1e-4, step=0.002),
    Servo(k_p=11.0, k_d=0.75, lag=0.008, limit=1.0, resolution=1e-4, step=0.002),
)


def simulate(
    arm: Arm,
    servos: tuple[Servo, Servo],
    time: np.ndarray,
    reference: tuple[Reference, Reference],
    conditions: Conditions,
    rng: np.random.Generator,
    force: Force | None,
) -> Run:
    """Follow the references of theta_1 and theta_2 - OFFSET from rest; force(t, q, v) with theta (2,) and theta' (2,)."""
    rows = time.size
    sensors, held = Sensors(conditions, rows, rng), disturbance(conditions, PLACES, time, rng)
    y = np.array([0.0, OFFSET, 0.0, 0.0])
    tracking = [Tracking(reading=0.0), Tracking(reading=OFFSET)]
    torques, states, sensed = np.empty((rows, 2)), np.empty((rows, 4)), np.empty((rows, 2))
    for k in range(rows):
        states[k] = y
        for i, name in enumerate(OUTPUTS):
            sensed[k, i] = sensors.read(name, k, float(y[i]))
            wanted = reference[i][0][k] + (OFFSET if i else 0.0)
            torques[k, i], tracking[i] = servos[i].command(tracking[i], sensed[k, i], wanted, reference[i][1][k])
        given = torques[k] + held[k]

        def rates(t: float, y: np.ndarray, given: np.ndarray = given) -> np.ndarray:
            M, h = arm.equations(y[:2], y[2:])
            more = given if force is None else given + force(t, y[:2], y[2:])
            return np.concatenate([y[2:], np.linalg.solve(M, more - h)])

        if k + 1 < rows:
            y = advance(rates, time[k], y, time[k + 1] - time[k], STEPS)
    return Run(
        time=time,
        inputs={"tau_1": torques[:, 0], "tau_2": torques[:, 1]},
        outputs=sensors.recorded(OUTPUTS, sensed),
        truth=dict(zip(STATES, states.T, strict=True)) | {"clean.theta_1": states[:, 0], "clean.theta_2": states[:, 1]},
        noise=dict(conditions.noise),
    )


def record(
    arm: Arm = Arm(),
    *,
    seed: int = 0,
    conditions: Conditions = CONDITIONS,
    servos: tuple[Servo, Servo] = SERVOS,
    force: Force | None = None,
) -> Run:
    """Random smooth motion of both joints, up to about 0.4 rad; the same seed gives the same run."""
    rng = np.random.default_rng([seed, 5])
    time = clock(conditions, rng)
    reference = smooth_random(time, 0.4, (0.15, 1.0), rng), smooth_random(time, 0.4, (0.3, 3.0), rng)
    return simulate(arm, servos, time, reference, conditions, rng, force)


def with_values(values: Mapping[str, float]) -> Arm:
    """The arm with these parameters, by the names of the plant; the others keep their defaults."""
    return replace(Arm(), **{NAMES[name]: value for name, value in values.items()})
