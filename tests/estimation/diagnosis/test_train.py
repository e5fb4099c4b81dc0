"""Three carts in a row, of which the middle one is not seen, and a stop that the last one runs into.

Without the stop the last cart is next to nothing, with a spring as stiff as a rod: all that the middle one does is blamed instead.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from backsight.estimation import Free, Problem, Recording
from backsight.estimation.diagnosis import diagnose
from backsight.models import Model
from backsight.models.mechanics.translational import Damper, Fixed, Force, Mass, PositionSensor, SpringDamper

M, K, D, ROLLING = (2.0, 1.5, 1.0), (900.0, 600.0), (3.0, 2.0), (1.5, 1.0, 0.8)  # kg, N/m, N s/m, N s/m
STOP, STIFF = 0.07, 4e4  # m, N/m
STEP, STD = 2e-3, 1e-5


def train() -> Model:
    numbers = (1, 2, 3)
    return Model(
        name="train",
        components={
            "drive": Force(), "ground": Fixed(), **{f"cart_{k}": Mass(m=m) for k, m in zip(numbers, M, strict=True)},
            **{f"wheels_{k}": Damper(d=d) for k, d in zip(numbers, ROLLING, strict=True)},
            "spring_12": SpringDamper(k=K[0], d=D[0]), "spring_23": SpringDamper(k=K[1], d=D[1]),
            "scale_1": PositionSensor(), "scale_3": PositionSensor(),
        },
        connections=[
            ("drive.flange", "cart_1.flange"), ("cart_1.flange", "spring_12.flange_a"), ("spring_12.flange_b", "cart_2.flange"),
            ("cart_2.flange", "spring_23.flange_a"), ("spring_23.flange_b", "cart_3.flange"), ("scale_1.flange", "cart_1.flange"),
            ("scale_3.flange", "cart_3.flange"), *((f"cart_{k}.flange", f"wheels_{k}.flange_a") for k in numbers),
            *((f"wheels_{k}.flange_b", "ground.flange") for k in numbers),
        ],
        inputs={"F": "drive.f"},
        outputs={"x1": "scale_1.s", "x3": "scale_3.s"},
    )  # fmt: skip


def recorded(role: str, seed: int, seconds: float) -> Recording:
    """Newton's law for three masses, by hand: pushed by what a spring to a reference would, held from row to row."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, seconds, STEP)
    phase = rng.uniform(0.0, 2 * np.pi)
    force = np.zeros(len(time))

    def rates(t: float, x: np.ndarray) -> list[float]:
        s, v = x[:3], x[3:]
        first, second = K[0] * (s[0] - s[1]) + D[0] * (v[0] - v[1]), K[1] * (s[1] - s[2]) + D[1] * (v[1] - v[2])
        held = -STIFF * max(0.0, s[2] - STOP) - 20.0 * max(0.0, v[2]) * (s[2] > STOP)
        net = np.array([force[min(int(t / STEP + 1e-9), len(time) - 1)] - first, first - second, second + held]) - np.multiply(ROLLING, v)
        return [*v, *(net / M)]

    states = [np.zeros(6)]
    for k, t in enumerate(time):
        there = 0.12 * np.sin(2 * np.pi * 0.4 * t) + 0.03 * np.sin(2 * np.pi * 0.9 * t + phase)
        force[k] = 500.0 * (there - states[-1][0]) - 30.0 * states[-1][3] + (rng.uniform(-6, 6) if k % 25 == 0 else 0.0)
        states.append(solve_ivp(rates, (t, t + STEP), states[-1], rtol=1e-8, atol=1e-10, max_step=STEP / 4).y[:, -1])
    x1, x3 = np.array(states[:-1])[:, [0, 2]].T + STD * rng.normal(size=(2, len(time)))
    assert np.max(x3) > STOP
    return Recording(name=role, time=time, inputs={"F": force}, outputs={"x1": x1, "x3": x3}, output_std={"x1": STD, "x3": STD}, role=role)


@pytest.mark.slow
def test_the_stop_is_found_where_the_last_cart_runs_into_it():
    guesses = {
        "cart_1.m": Free(2.5, 0.1, 50.0), "cart_3.m": Free(0.8, 0.1, 50.0), "spring_12.k": Free(800.0, 10.0, 1e5),
        "spring_23.k": Free(700.0, 10.0, 1e5), "wheels_1.d": Free(2.0, 0.0, 100.0), "wheels_3.d": Free(1.0, 0.0, 100.0),
    }  # fmt: skip
    found = diagnose(Problem(model=train(), recordings=[recorded("fit", 3, 5.0), recorded("held_out", 4, 3.0)], parameters=guesses))
    (one,) = found.findings
    assert (one.explanation.place, one.explanation.physics) == ("cart_3", "end_stop")
    assert one.explanation.parameters["x"].value == pytest.approx(STOP, abs=1e-4)
    assert found.after.parameters["cart_3.m"].value == pytest.approx(M[2], rel=0.01)
    assert any("cart_3.m" in note and "twice the guess" in note for note in found.notes)
