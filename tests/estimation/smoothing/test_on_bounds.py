"""What parameters on their bounds leave open in the others, against brute force: draws of all, of which those within the bounds count."""

from __future__ import annotations

import numpy as np
import pytest
from linear_runs import ALL_FREE, FORCE_STD, PLANT, STD, many, problem

from backsight.estimation import Free, Problem, Recording, Smoothing, smooth
from backsight.estimation.smoothing.on_bounds import _cut_off
from backsight.models import Model
from backsight.models.mechanics.translational import Fixed, Force, Friction, Mass, PositionSensor

NAMES = ["mass.m", "spring.k", "damper.d", "offset.f"]


def draws(mean: np.ndarray, covariance: np.ndarray, low: np.ndarray, high: np.ndarray, count: int = 4_000_000) -> np.ndarray:
    """Of a normal distribution those within the bounds."""
    x = np.random.default_rng(1).multivariate_normal(mean, covariance, count)
    return x[np.all((x >= low) & (x <= high), axis=1)]


@pytest.mark.parametrize(
    ("mean", "correlation", "width"),
    [
        ([-0.5], 0.0, np.inf),
        ([0.4], 0.0, np.inf),
        ([-1.0], 0.0, 0.2),
        ([-2.5], 0.0, np.inf),
        ([-0.2, -0.2], 0.98, np.inf),
        ([-0.2, -0.2], -0.9, np.inf),
        ([-1.0, 0.3], 0.6, 0.5),
        ([-0.5, -0.3, -0.1], 0.5, np.inf),
    ],
)
def test_moments_and_tails_of_what_is_cut_off_are_those_of_draws(mean, correlation, width):
    b = len(mean)
    covariance = np.full((b, b), correlation) + (1 - correlation) * np.eye(b)
    inside = draws(np.array(mean), covariance, np.zeros(b), np.full(b, width))
    M, reach = _cut_off(np.array(mean), covariance, np.full(b, width))
    np.testing.assert_allclose(M, inside.T @ inside / len(inside), rtol=0.02)
    np.testing.assert_allclose(reach, np.quantile(inside, 0.95, axis=0), rtol=0.02)


@pytest.mark.parametrize("a", [5.0, 40.0, 1e4])
def test_far_beyond_a_bound_only_a_tail_is_left(a):
    """Exponential, of length 1/a, with 6/a^2 to its second moment."""
    M, reach = _cut_off(np.array([-a]), np.eye(1), np.array([np.inf]))
    assert a**2 * M[0, 0] / 2 == pytest.approx(1 - 6 / a**2, abs=0.1 if a < 10 else 0.01)
    assert a * reach[0] == pytest.approx(-np.log(0.05), rel=0.1 if a < 10 else 0.01)


def smoothed(**bounds: tuple[float, float]) -> Smoothing:
    rng = np.random.default_rng(7)
    about = {"mass": "m", "spring": "k", "damper": "d"}
    true = {"mass.m": PLANT.m, "spring.k": PLANT.k, "damper.d": PLANT.d}
    free = dict(ALL_FREE)
    for name, (low, high) in bounds.items():
        full = f"{name}.{about[name]}"
        free[full] = Free(float(np.clip(true[full], low, high)), min=low, max=high)
    return problem(many(400, 1, rng)[0] + STD * rng.normal(size=400), parameters=free)[0]


@pytest.fixture(scope="module")
def unbound() -> tuple[np.ndarray, np.ndarray]:
    """Estimates and covariance of NAMES without any bounds."""
    free = smoothed()
    std = np.array([free.parameters[n].std for n in NAMES])
    return np.array([free.parameters[n].value for n in NAMES]), free.correlation.loc[NAMES, NAMES].to_numpy() * np.outer(std, std)


INF = np.inf
CASES = {  # bounds in deviations from the estimate without any
    "one, near": {"damper": (0.3, INF)},
    "one, above": {"damper": (-INF, -0.5)},
    "one, far": {"damper": (2.0, INF)},
    "a narrow range": {"damper": (0.2, 0.4)},
    "two that go together, both above": {"mass": (-INF, -0.2), "spring": (-INF, -0.2)},
    "two that go together, both below": {"mass": (0.5, INF), "spring": (0.5, INF)},
    "above and below": {"mass": (0.5, INF), "damper": (-INF, -0.5)},
}


@pytest.mark.parametrize("case", CASES)
def test_deviations_are_those_of_draws_that_keep_the_bounds(unbound, case):
    """About the estimate within the bounds."""
    mean, covariance = unbound
    std = np.sqrt(np.diag(covariance))
    low, high = np.full(4, -INF), np.full(4, INF)
    for name, (a, b) in CASES[case].items():
        k = [n.split(".")[0] for n in NAMES].index(name)
        low[k], high[k] = mean[k] + a * std[k], mean[k] + b * std[k]
    held = smoothed(**{n: (low[k], high[k]) for k, n in enumerate(m.split(".")[0] for m in NAMES) if n in CASES[case]})
    on = [held.parameters[n].on_bound for n in NAMES]
    assert any(on)
    there = np.array([held.parameters[n].value for n in NAMES])
    inside = draws(mean, covariance, low, high)
    expected = np.sqrt(np.mean((inside - there) ** 2, axis=0))
    for k, name in enumerate(NAMES):
        if on[k]:
            note = next(n for n in held.notes if n.startswith(f"{name} ended on its bound"))
            if "may as well be" in note:
                reach = float(note.split("well be ")[1].split()[0])
                assert reach == pytest.approx(np.quantile(np.abs(inside[:, k] - there[k]), 0.95), rel=0.08)
        else:
            assert held.parameters[name].std == pytest.approx(expected[k], rel=0.04)


def test_far_from_what_the_data_want_a_bound_is_named_with_its_pull_and_nothing_is_added(unbound):
    mean, covariance = unbound
    std = np.sqrt(np.diag(covariance))
    held = smoothed(damper=(mean[2] + 8 * std[2], INF))
    note = next(n for n in held.notes if n.startswith("damper.d ended on its bound"))
    assert float(note.split("pull it ")[1].split()[0]) == pytest.approx(8.0, rel=0.05)
    assert held.notes[0] == note  # all else depends on it
    assert not any("apart" in n for n in held.notes)
    rest = np.sqrt(np.diag(covariance)[[0, 1, 3]] - covariance[[0, 1, 3], 2] ** 2 / covariance[2, 2])
    np.testing.assert_allclose([held.parameters[NAMES[k]].std for k in (0, 1, 3)], rest, rtol=0.05)


def test_where_bounds_leave_a_combination_no_way_both_are_held_and_nothing_is_said_to_be_open():
    """An offset that may only push and a rest length that may only pull: their sum alone is told, and it is negative."""
    rng = np.random.default_rng(7)
    y = many(400, 1, rng)[0] + STD * rng.normal(size=400)
    free = {**ALL_FREE, "damper.d": PLANT.d, "offset.f": Free(0.05, 0.0, 0.1), "spring.s_rel0": Free(1e-3, 0.0, 1.0)}
    held = problem(y, parameters=free)[0]
    assert held.parameters["spring.k"].std is not None
    assert not any("not tell" in n and "apart" in n for n in held.notes)
    notes = [n for n in held.notes if "ended on its bound" in n]
    assert len(notes) == 2
    assert any("deviations beyond" in n for n in notes)


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
    assert s.parameters["friction.f_c"].on_bound
    for name, size in (("body.m", m), ("friction.d", d)):
        assert s.parameters[name].std is None or s.parameters[name].std > size / 2
        assert not s.parameters[name].identifiable
    assert any("the recordings hardly tell it" in note or "do not tell it" in note for note in s.notes)
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
