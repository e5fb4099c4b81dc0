"""An axis with friction, simulated by SciPy, for the tests of the moving horizon."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from scipy.integrate import solve_ivp

from backsight.estimation import Free, Problem, Recording
from backsight.estimation.tracking import Sample
from backsight.models.plants import PLANTS

# what a study says of it, but for its outputs
STUDY = """model = "actuator"

[parameters]
"carriage.m" = 95.0
"friction.d" = 200.0
"friction.f_c" = { guess = 8.0, min = 0.0 }
"offset.f" = { guess = 1.0 }

[[recording]]
file = "record.csv"
time = "t_s"
inputs = { F = "F_N" }
"""


class FrictionAxis:
    """An axis with friction under a held force, simulated with white noise on its force: 600 rows at 100 Hz.

    time (n,), force (n,), states (n, 2), read (n,); Coulomb friction and an offset are to be estimated from guesses that are far off.
    """

    FREE: ClassVar = {"friction.f_c": 20.0, "offset.f": -3.0}
    FORCE_STD, NOISE = 0.4, 1e-5

    def __init__(self, seed: int = 0, count: int = 600) -> None:
        rng, step, fine = np.random.default_rng(seed), 0.01, 10
        self.time = step * np.arange(count)
        self.force = 60.0 * np.sign(np.sin(2.1 * self.time)) + 45.0 * np.sin(7.3 * self.time)
        mass, damping, f_c, offset = 95.0, 200.0, self.FREE["friction.f_c"], self.FREE["offset.f"]
        self.states, x, h = np.zeros((count, 2)), np.zeros(2), step / fine
        for k in range(count - 1):
            for _ in range(fine):  # the white force is held over a tenth of a sample
                push = self.force[k] + self.FORCE_STD / np.sqrt(h) * rng.standard_normal()

                def rate(_: float, s: np.ndarray, push: float = push) -> list[float]:
                    return [s[1], (push - damping * s[1] - f_c * np.tanh(s[1] / 1e-3) - offset) / mass]

                x = solve_ivp(rate, (0, h), x, method="LSODA", rtol=1e-9, atol=1e-12).y[:, -1]
            self.states[k + 1] = x
        self.read = self.states[:, 0] + self.NOISE * rng.standard_normal(count)
        self.problem = self.posed({"friction.f_c": Free(8.0, min=0.0), "offset.f": Free(1.0)})

    def posed(self, parameters: dict[str, Free | float]) -> Problem:
        """The problem with other parameters free."""
        recording = Recording(name="axis", time=self.time, inputs={"F": self.force}, outputs={"x": self.read}, output_std={"x": self.NOISE})
        return Problem(
            model=PLANTS["actuator"](), recordings=[recording], parameters={"carriage.m": 95.0, "friction.d": 200.0, **parameters}
        )

    def sample(self, k: int) -> Sample:
        """Row k."""
        return Sample(time=float(self.time[k]), inputs={"F": float(self.force[k])}, outputs={"x": float(self.read[k])})
