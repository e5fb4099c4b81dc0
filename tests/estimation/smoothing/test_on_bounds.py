"""What a parameter on its bound leaves open in the others."""

from __future__ import annotations

import numpy as np
import pytest
from linear_runs import ALL_FREE, FORCE_STD, PLANT, STD, many, problem
from scipy.integrate import quad

from backsight.estimation import Free, Problem, Recording, Smoothing, smooth
from backsight.estimation.smoothing.on_bounds import _second_moment
from backsight.models import Model
from backsight.models.mechanics.translational import Fixed, Force, Friction, Mass, PositionSensor

NAMES = ["mass.m", "spring.k", "damper.d", "offset.f"]


@pytest.mark.parametrize("a", [-5.0, -0.3, 0.0, 1.0, 4.0, 12.0, 29.0, 31.0, 1e4])
def test_the_second_moment_of_what_is_left_of_a_normal_distribution(a):
    """Against quadrature, in units of its own length 1/a where only a tail is left."""
    unit = 1.0 / max(a, 1.0)
    ends = (0.0, max(-a, 0.0) + 10.0) if a < 1 else (0.0, 50.0)
    moment, mass = (
        quad(lambda s, n=n: s**n * np.exp(-((unit * s) ** 2) / 2 - a * unit * s), *ends, epsabs=0, epsrel=1e-10)[0] for n in (2, 0)
    )
    assert _second_moment(np.array([a]))[0] == pytest.approx(unit**2 * moment / mass, rel=6e-3 if a > 30 else 1e-6)


def smoothed(low: float = -np.inf, high: float = np.inf) -> Smoothing:
    rng = np.random.default_rng(7)
    free = {**ALL_FREE, "damper.d": Free(np.clip(PLANT.d, low, high), min=low, max=high)}
    return problem(many(400, 1, rng)[0] + STD * rng.normal(size=400), parameters=free)[0]


@pytest.mark.parametrize("outside", [-0.4, 0.3, 2.0, 8.0])
@pytest.mark.parametrize("upper", [False, True])
def test_deviations_are_those_of_draws_that_keep_the_bound(outside, upper):
    """Draws from the posterior without a bound, those within it kept; about the estimate that the bound allows."""
    free = smoothed(0.0)
    mean = np.array([free.parameters[n].value for n in NAMES])
    std = np.array([free.parameters[n].std for n in NAMES])
    covariance = free.correlation.loc[NAMES, NAMES].to_numpy() * np.outer(std, std)
    sign = -1.0 if upper else 1.0
    bound = mean[2] + sign * outside * std[2]
    held = smoothed(high=bound) if upper else smoothed(low=bound)
    if outside < 0:  # the bound does not matter to the estimate, and changes nothing
        np.testing.assert_allclose([held.parameters[n].std for n in NAMES], std, rtol=0.01)
        return
    assert held.parameters["damper.d"].on_bound
    rng, others = np.random.default_rng(1), [0, 1, 3]
    slope = covariance[others, 2] / covariance[2, 2]
    inside = std[2] * inner_tail(rng, outside)
    rest = np.diag(covariance)[others] - slope**2 * covariance[2, 2]
    expected = np.sqrt(rest + slope**2 * np.mean(inside**2))
    found = [held.parameters[NAMES[k]].std for k in others]
    np.testing.assert_allclose(found, expected, rtol=0.03)
    note = next(n for n in held.notes if n.startswith("damper.d ended on its bound"))
    if outside > 3:
        assert "deviations beyond" in note
        assert float(note.split("pull it ")[1].split()[0]) == pytest.approx(outside, rel=0.05)
    else:
        reach = float(note.split("well be ")[1].split()[0])
        assert reach == pytest.approx(np.quantile(inside, 0.95), rel=0.06)


def inner_tail(rng: np.random.Generator, a: float) -> np.ndarray:
    """Draws of what of N(-a, 1) is positive, by rejection from an exponential distribution (Robert, Statistics and Computing 5, 1995)."""
    rate = (a + np.sqrt(a**2 + 4)) / 2
    x = a + rng.exponential(1 / rate, size=400_000)
    return x[rng.uniform(size=len(x)) < np.exp(-((x - rate) ** 2) / 2)] - a


def test_a_constant_force_tells_no_mass_though_friction_is_held_by_its_bound():
    """A cart from rest under 20 N: (F - f_c)/d and m/d are all that the way shows, and whatever f_c is makes the same way."""
    m, d, f_c, force = 12.0, 35.0, 6.0, 20.0
    time = 0.002 * np.arange(1500)
    tau, rng = m / d, np.random.default_rng(5)
    x = (force - f_c) / d * (time - tau * (1 - np.exp(-time / tau))) + 2e-5 * rng.standard_normal(len(time))
    cart = Model(
        name="cart",
        components={"source": Force(), "body": Mass(m=30.0), "friction": Friction(d=90.0), "ground": Fixed(), "encoder": PositionSensor()},
        connections=[
            ("source.flange", "body.flange"),
            ("encoder.flange", "body.flange"),
            ("body.flange", "friction.flange_a"),
            ("friction.flange_b", "ground.flange"),
        ],
        inputs={"F": "source.f"},
        outputs={"x": "encoder.s"},
    )
    recording = Recording(name="run", time=time, inputs={"F": np.full(len(time), force)}, outputs={"x": x}, output_std={"x": 2e-5})
    free = {"body.m": Free(36.0), "friction.d": Free(100.0), "friction.f_c": Free(18.0)}
    s = smooth(Problem(model=cart, recordings=[recording], parameters=free))
    assert s.solver.converged
    assert not any(p.identifiable for p in s.parameters.values())
    for name, true in (("body.m", m), ("friction.d", d)):
        assert s.parameters[name].std is None or abs(s.parameters[name].value - true) < 2 * s.parameters[name].std
    assert any(note.startswith("Input F is 20 in every row") for note in s.notes)
    (note,) = [note for note in s.notes if "apart" in note]
    assert all(name in note for name in free)
    # what the note says to move changes nothing: along it m/d and (F - f_c)/d stay
    steps = {
        part.split(" by ")[0]: float(part.split(" by ")[1].split()[0])
        for part in note.split("moving ")[1].split(" changes")[0].replace(" and ", ", ").split(", ")
    }
    p = {name: s.parameters[name].value for name in free}
    assert steps["body.m"] / steps["friction.d"] == pytest.approx(p["body.m"] / p["friction.d"], rel=0.02)
    assert -steps["friction.f_c"] / steps["friction.d"] == pytest.approx((force - p["friction.f_c"]) / p["friction.d"], rel=0.02)


def test_forces_of_the_smoother_have_the_unit_of_their_density():
    rng = np.random.default_rng(3)
    s = problem(many(300, 1, rng)[0] + STD * rng.normal(size=300))[0]
    assert any(note == f"W of mass: std {FORCE_STD} N.sqrt(s) as given." for note in s.notes)
