"""The machines of `tracking.py`: recordings with their truth, and their equations once more, by hand, for the peers.

The recordings come from `data/generators`, whose machines stick and slip; all estimators round the sign of a velocity with the same width.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from backsight.data.generators import axis as axes
from backsight.data.generators import xy_table as tables
from backsight.data.generators.references import strokes
from backsight.data.generators.run import Conditions, Run
from backsight.data.generators.servo import Servo
from backsight.estimation import Free, Problem, Recording, Weights
from backsight.models.plants import PLANTS

WINDOW = 50  # intervals of a window


@dataclass(frozen=True, kw_only=True)
class Case:
    """A run and what the estimators suppose of its machine; all stds in the order of their variables.

    rates, readings: (x, u, p, w) -> x', y by hand, p the free parameters and w the residual forces. guesses: name -> (first guess, true
    value). prompt: outputs that x tells alone. force_std [unit * sqrt(s)], noise_std. arrival_x, arrival_p: stds of the arrival cost that
    a peer is set to, about what is known of a window's first state, and a tenth of each parameter. stiff: one step of RK4 between two rows
    is not stable.
    """

    name: str
    run: Run
    states: tuple[str, ...]
    fixed: Mapping[str, float]
    guesses: Mapping[str, tuple[float, float]]
    places: tuple[str, ...]
    rates: Callable[[Any, Any, Any, Any], Any]
    readings: Callable[[Any, Any, Any, Any], Any]
    prompt: tuple[int, ...]
    force_std: np.ndarray
    noise_std: np.ndarray
    arrival_x: np.ndarray
    stiff: bool = False

    @property
    def step(self) -> float:
        return float(self.run.time[1] - self.run.time[0])

    @property
    def inputs(self) -> np.ndarray:
        """(n, nu)."""
        return np.column_stack(list(self.run.inputs.values()))

    @property
    def outputs(self) -> np.ndarray:
        """(n, ny)."""
        return np.column_stack(list(self.run.outputs.values()))

    @property
    def truth(self) -> np.ndarray:
        """(n, nx)."""
        return np.column_stack([self.run.truth[name] for name in self.states])

    @property
    def guess(self) -> np.ndarray:
        return np.array([guess for guess, _ in self.guesses.values()])

    @property
    def true_parameters(self) -> np.ndarray:
        return np.array([true for _, true in self.guesses.values()])

    @property
    def arrival_p(self) -> np.ndarray:
        return 0.1 * np.abs(self.guess)

    def start(self) -> np.ndarray:
        """A first guess of the state: at rest where the first row is."""
        x = np.zeros(len(self.states))
        x[: len(x) // 2] = self.truth[0, : len(x) // 2]
        return x

    def problem(self) -> Problem:
        """For `backsight`, with every weight given."""
        names = list(self.run.outputs)
        recording = Recording(name=self.name, time=self.run.time, inputs=self.run.inputs, outputs=self.run.outputs)
        return Problem(
            model=PLANTS[{"axis": "actuator"}.get(self.name, self.name)](),
            recordings=[recording],
            parameters={**self.fixed, **{name: Free(guess) for name, (guess, _) in self.guesses.items()}},
            weights=Weights(W=dict(zip(self.places, self.force_std, strict=True)), V=dict(zip(names, self.noise_std, strict=True))),
        )


def axis() -> Case:
    """An axis like EMPS: strokes under position control at 100 Hz, 20 rad/s with a damping ratio of 0.7."""
    width, servo = 1e-3, Servo(k_p=38e3, k_d=2660.0, lag=0.004, limit=350.0, resolution=0.01, step=0.01)
    time = np.arange(600) * servo.step
    run = axes.operate(axes.AXIS, axes.ENCODER, servo, time, strokes(time, np.random.default_rng(1)), np.random.default_rng(2))
    body = axes.AXIS.body

    def rates(x: Any, u: Any, p: Any, w: Any) -> Any:
        return ca.vertcat(x[1], (u[0] + w[0] - body.d * x[1] - p[0] * ca.tanh(x[1] / width) - p[1]) / body.m)

    return Case(
        name="axis",
        run=run,
        states=("carriage.s", "carriage.v"),
        fixed={"carriage.m": body.m, "friction.d": body.d, "friction.width": width},
        guesses={"friction.f_c": (10.0, body.f_c), "offset.f": (0.5, axes.AXIS.offset)},
        places=("carriage",),
        rates=rates,
        readings=lambda x, *_: x[0],
        prompt=(0,),
        force_std=np.array([axes.AXIS.disturbance_std * servo.step**0.5]),
        noise_std=np.array([(axes.ENCODER.noise_std**2 + axes.ENCODER.resolution**2 / 12) ** 0.5]),
        arrival_x=np.array([1e-6, 1e-4]),
    )


def xy_table() -> Case:
    """A gantry at 500 Hz, six sensors: Lagrange's equations in the positions of the slides (`data/generators/xy_table.py`)."""
    width, table = 0.05, tables.Table(d_1=0.02, d_3=0.005)
    conditions = Conditions(duration=1.2, step=0.002, noise=tables.CONDITIONS.noise, process=tables.CONDITIONS.process)
    run = tables.record(table, seed=1, conditions=conditions)
    r, b = table.r, table.b

    def accelerations(x: Any, u: Any, p: Any, w: Any) -> Any:
        """Of the slides [m/s2]."""
        q, v = r * x[:3], r * x[3:]
        j = ca.vertcat(1 - q[2] / b, q[2] / b, (q[1] - q[0]) / b)
        M = ca.SX(ca.DM(table.fixed)) + p[4] * (j @ j.T)
        M[0, 0] += (p[3] - table.J_1) / r**2
        spindle = p[2] * (x[0] - x[1])
        torque = ca.vertcat(
            table.K_x * u[0] - table.d_1 * x[3] - p[0] * ca.tanh(x[3] / width) - spindle,
            spindle,
            table.K_y * u[1] - table.d_3 * x[5] - p[1] * ca.tanh(x[5] / width),
        )
        M[2, 2] += p[4] - table.m_e
        return ca.solve(M, (torque + w) / r - p[4] * 2 * (v[1] - v[0]) * v[2] / b * j)

    def readings(x: Any, u: Any, p: Any, w: Any) -> Any:
        q, v, a = r * x[:3], r * x[3:], accelerations(x, u, p, w)
        alpha = (q[0] - q[1]) / b
        ax = (1 - q[2] / b) * a[0] + q[2] / b * a[1] + (q[1] - q[0]) / b * a[2] + 2 * (v[1] - v[0]) * v[2] / b
        turned = ca.cos(alpha) * ax + ca.sin(alpha) * a[2], ca.cos(alpha) * a[2] - ca.sin(alpha) * ax
        return ca.vertcat(q[0] + (q[1] - q[0]) * q[2] / b, q[2], *turned, q[0], q[2])

    return Case(
        name="xy_table",
        run=run,
        states=tables.STATES,
        fixed={"friction_1.d": table.d_1, "friction_3.d": table.d_3, **{f"friction_{i}.width": width for i in (1, 2, 3)}},
        guesses={
            "friction_1.tau_c": (0.35, table.tau_1),
            "friction_3.tau_c": (0.1, table.tau_3),
            "spindle.k": (0.4, table.k),
            "drive_1.J": (3e-3, table.J_1),
            "end_effector.m": (3.0, table.m_e),
        },
        places=tables.PLACES,
        rates=lambda x, u, p, w: ca.vertcat(x[3:], accelerations(x, u, p, w) / r),
        readings=readings,
        prompt=(0, 1, 4, 5),
        force_std=np.array([conditions.process[place] for place in tables.PLACES]),
        noise_std=np.array(list(run.noise.values())),
        arrival_x=np.array([2e-3, 2e-3, 2e-3, 2e-2, 2e-2, 2e-2]),
        stiff=True,  # friction.tau_c / (width J) is 4e3/s, of which RK4 takes 2.8 in a step
    )


CASES = {"axis": axis, "xy_table": xy_table}
