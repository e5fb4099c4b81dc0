"""A load that hangs on a cart, in air that drags it at its centre of mass, of which nobody knows how far down it is, or in wind."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from backsight.estimation import Free, Problem, Recording
from backsight.estimation.diagnosis import diagnose
from backsight.models import Model
from backsight.models.mechanics.planar import Body, FrameFixed, Prismatic, Revolute, World
from backsight.models.mechanics.rotational import AngleSensor
from backsight.models.mechanics.translational import Damper, Fixed, Force, PositionSensor

CART, LOAD, DOWN, INERTIA, ROLLING, DRAG, G = 20.0, 8.0, 0.8, 0.15, 15.0, 3.0, 9.81  # kg, kg, m, kg m2, N s/m, N s2/m2, m/s2
GUESSES = {"cart.m": Free(26.0, 1.0), "load.m": Free(6.0, 0.5), "load.y_c": Free(-1.0, -3.0, -0.1), "wheels.d": Free(21.0, 0.0)}
STEP, X_STD, PHI_STD = 4e-3, 2e-5, 3e-4


def crane() -> Model:
    return Model(
        name="crane",
        components={
            "world": World(tilt=math.pi / 2), "rail": FrameFixed(), "slide": Prismatic(), "cart": Body(m=CART, I=1.0), "hinge": Revolute(),
            "load": Body(m=LOAD, y_c=-DOWN, I=INERTIA), "drive": Force(), "wheels": Damper(d=ROLLING), "ground": Fixed(),
            "scale": PositionSensor(), "encoder": AngleSensor(),
        },
        connections=[
            ("rail.frame", "slide.frame_a"), ("slide.frame_b", "cart.frame"), ("cart.frame", "hinge.frame_a"),
            ("hinge.frame_b", "load.frame"), ("drive.flange", "slide.axis"), ("slide.axis", "wheels.flange_a"),
            ("wheels.flange_b", "ground.flange"), ("scale.flange", "slide.axis"), ("encoder.flange", "hinge.axis"),
        ],
        inputs={"F": "drive.f"},
        outputs={"x": "scale.s", "phi": "encoder.phi"},
    )  # fmt: skip


def recorded(seconds: float = 8.0, c: float = 0.0, wind: float = 0.0) -> Recording:
    """Lagrange's equations of a cart and a pendulum, by hand: pushed about, with forces held from row to row. c: of the load; wind [N]."""
    rng, time = np.random.default_rng(3), np.arange(0.0, seconds, STEP)
    force = 60 * np.sin(2 * np.pi * 0.45 * time) + 25 * np.sin(2 * np.pi * 0.9 * time + 1.0) + 10 * np.repeat(rng.normal(size=200), 10)

    def rates(t: float, x: np.ndarray) -> list[float]:
        _, phi, v, w = x
        v_x, v_y = v + DOWN * w * math.cos(phi), DOWN * w * math.sin(phi)
        drag = c * math.hypot(v_x, v_y)
        pushed = force[min(int(t / STEP + 1e-9), len(time) - 1)] - ROLLING * v - drag * v_x + wind + LOAD * DOWN * w**2 * math.sin(phi)
        across = wind - drag * v_x
        turned = DOWN * (across * math.cos(phi) - drag * v_y * math.sin(phi)) - LOAD * G * DOWN * math.sin(phi)
        coupling = LOAD * DOWN * math.cos(phi)
        return [v, w, *np.linalg.solve([[CART + LOAD, coupling], [coupling, LOAD * DOWN**2 + INERTIA]], [pushed, turned])]

    states = [np.zeros(4)]
    for t in time[:-1]:
        states.append(solve_ivp(rates, (t, t + STEP), states[-1], rtol=1e-9, atol=1e-11, max_step=STEP).y[:, -1])
    x, phi = np.array(states)[:, :2].T
    outputs = {"x": x + X_STD * rng.normal(size=len(time)), "phi": phi + PHI_STD * rng.normal(size=len(time))}
    return Recording(name="pushed", time=time, inputs={"F": force}, outputs=outputs, output_std={"x": X_STD, "phi": PHI_STD})


@pytest.mark.slow
def test_drag_acts_where_the_centre_of_mass_is_with_it_and_not_where_it_seemed_to_be_without():
    found = diagnose(Problem(model=crane(), recordings=[recorded(c=DRAG)], parameters=GUESSES))
    (one,) = found.findings
    assert (one.explanation.place, one.explanation.physics) == ("load", "quadratic_drag")
    assert abs(found.before.parameters["load.y_c"].value + DOWN) > 0.005
    c, centre = one.explanation.parameters["c"], found.after.parameters["load.y_c"]
    assert abs(c.value - DRAG) < 3.5 * c.std < 0.01
    point = found.repaired.parameters["quadratic_drag_load.y_c"]
    assert point == pytest.approx(centre.value, abs=1e-4)


@pytest.mark.slow
def test_wind_pushes_the_load_and_neither_the_cart_nor_the_hinge():
    found = diagnose(Problem(model=crane(), recordings=[recorded(wind=2.0)], parameters=GUESSES))
    (one,) = found.findings
    assert (one.explanation.place, one.explanation.physics) == ("load", "constant_force")
    f = one.explanation.parameters["f_x"]
    assert abs(f.value - 2.0) < 3.5 * f.std < 0.05
