"""A drive of which speeds are measured and no angle, for the tests of diagnosis. Simulated here by matrices, in fine steps."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from backsight.estimation import Free, Problem, Recording
from backsight.models import Model
from backsight.models.mechanics.rotational import (
    AngularVelocitySensor,
    Inertia,
    RotationalDamper,
    RotationalFixed,
    RotationalSpringDamper,
    Torque,
)

J_1, J_2, K, D, B = 0.02, 0.08, 30.0, 0.05, 0.1
NOISE, STEP = 0.02, 5e-3


def drive() -> Model:
    return Model(
        name="drive",
        components={
            "source": Torque(), "motor": Inertia(J=J_1), "shaft": RotationalSpringDamper(k=K, d=D), "load": Inertia(J=0.05),
            "bearing": RotationalDamper(d=B), "housing": RotationalFixed(), "fast": AngularVelocitySensor(),
            "slow": AngularVelocitySensor(),
        },
        connections=[
            ("source.flange", "motor.flange"), ("motor.flange", "shaft.flange_a"), ("shaft.flange_b", "load.flange"),
            ("load.flange", "bearing.flange_a"), ("bearing.flange_b", "housing.flange"), ("fast.flange", "motor.flange"),
            ("slow.flange", "load.flange"),
        ],
        inputs={"tau": "source.tau"},
        outputs={"n_1": "fast.omega", "n_2": "slow.omega"},
    )  # fmt: skip


def recorded(seed: int, role: str, *, drag: float = 0.0) -> Recording:
    """Six seconds of a held random torque; drag [N.m s2/rad2] at the load, in steps of a fiftieth of the sampling."""
    rng, n, fine = np.random.default_rng(seed), 1200, 50
    tau = np.repeat(rng.uniform(-1.0, 2.0, n // 20), 20)
    A = np.array([[0.0, 1.0, -1.0], [-K / J_1, -D / J_1, D / J_1], [K / J_2, D / J_2, -(D + B) / J_2]])
    whole = np.zeros((5, 5))
    whole[:3, :3], whole[1, 3], whole[2, 4] = A, 1.0 / J_1, 1.0 / J_2
    exact = scipy.linalg.expm(whole * STEP / fine)
    x, rows = np.zeros(3), []
    for t in tau:
        rows.append(x[1:])
        for _ in range(fine):
            x = exact[:3, :3] @ x + exact[:3, 3:] @ [t, -drag * abs(x[2]) * x[2]]
    y = np.array(rows) + NOISE * rng.standard_normal((n, 2))
    return Recording(name=role, role=role, time=STEP * np.arange(n), inputs={"tau": tau}, outputs={"n_1": y[:, 0], "n_2": y[:, 1]})


def posed(**how) -> Problem:
    return Problem(
        model=drive(),
        recordings=[recorded(1, "fit", **how), recorded(2, "held_out", **how)],
        parameters={"load.J": Free(0.05), "bearing.d": Free(0.06)},
    )
