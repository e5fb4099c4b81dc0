"""The simulated gantry table against its energies, its spindle mode, rest under friction and the balance of work."""

from dataclasses import replace

import numpy as np
import pytest

from backsight.data.generators import xy_table
from backsight.data.generators.stick_slip import advance
from backsight.data.generators.xy_table import CONDITIONS, START, Table, motion, record

TABLE = Table()


def kinetic(table: Table, x: np.ndarray, v: np.ndarray) -> float:
    """T of the published formula, in the positions of slides and tool."""
    w, alpha_rate = v / table.r, (v[0] - v[1]) / table.b
    tool = v[0] + (v[1] - v[0]) * x[2] / table.b + (x[1] - x[0]) * v[2] / table.b, v[2]
    wheels = table.J_1 * w[0] ** 2 + table.J_2 * w[1] ** 2 + table.J_3 * w[2] ** 2
    slides = table.m_1 * v[0] ** 2 + table.m_2 * v[1] ** 2
    slideway = table.m_y * ((v[0] + v[1]) / 2) ** 2 + table.m_y * table.c**2 / 12 * alpha_rate**2
    return float(wheels + slides + slideway + table.m_e * (tool[0] ** 2 + tool[1] ** 2)) / 2


def test_the_equations_are_those_of_lagrange_for_the_published_energy() -> None:
    """d/dt dT/dv - dT/dx by differences of T along a motion with given accelerations; T is a square in v, so those in v are exact."""
    rng, h = np.random.default_rng(0), 1e-4
    for _ in range(5):
        table = replace(TABLE, J_2=1e-3, d=0.02)
        x, v, a = rng.uniform([-0.1, -0.1, 0.2], [0.1, 0.1, 0.8]), rng.normal(0, 2, 3), rng.normal(0, 5, 3)

        def momentum(t: float, x=x, v=v, a=a, table=table) -> np.ndarray:
            at, speed, e = x + v * t + a * t * t / 2, v + a * t, np.eye(3)
            return np.array([(kinetic(table, at, speed + e[i]) - kinetic(table, at, speed - e[i])) / 2 for i in range(3)])

        slope = np.array([(kinetic(table, x + h * e, v) - kinetic(table, x - h * e, v)) / (2 * h) for e in np.eye(3)])
        twist = (table.k * (x[0] - x[1]) + table.d * (v[0] - v[1])) / table.r**2
        needed = (momentum(h) - momentum(-h)) / (2 * h) - slope + twist * np.array([1.0, -1.0, 0.0])
        M, f = table.dynamics(np.zeros(2), np.zeros(3), None)(0.0, x, v)
        assert M @ a - f == pytest.approx(needed, rel=1e-6, abs=1e-5)


def test_with_wheel_1_held_the_spindle_mode_lies_near_four_hertz() -> None:
    """The report: about 4 Hz with k = 0.46 N m/rad. Slide 2 feels m_2, a quarter of slideway and tool, and the slideway's turning."""
    table = replace(TABLE, k=0.46, tau_1=1e3, tau_3=1e3)
    mass = table.m_2 + table.m_y * (1 / 4 + table.c**2 / 12) + table.m_e / 4
    frequency = np.sqrt(0.46 / table.r**2 / mass) / (2 * np.pi)
    assert frequency == pytest.approx(4.0, abs=0.15)
    x, v, h, speeds = np.array([0.0, 1e-3, START]), np.zeros(3), 1e-3, []
    for _ in range(2000):
        x, v = advance(table.dynamics(np.zeros(2), np.zeros(3), None), table.friction, 0.0, x, v, h, 1)
        speeds.append(v[1])
    crossings = np.flatnonzero(np.diff(np.sign(speeds)) != 0)
    s = np.array(speeds)
    times = h * (1 + crossings - s[crossings] / (s[crossings + 1] - s[crossings]))
    assert 0.5 / np.diff(times).mean() == pytest.approx(frequency, rel=1e-4)
    assert (v[0], v[2]) == (0.0, 0.0)


def test_below_the_friction_of_the_wheels_nothing_moves_at_all() -> None:
    current = np.array([0.99 * TABLE.tau_1 / TABLE.K_x, -0.99 * TABLE.tau_3 / TABLE.K_y])
    x, v = np.array([0.0, 0.0, START]), np.zeros(3)
    for _ in range(100):
        x, v = advance(TABLE.dynamics(current, np.zeros(3), None), TABLE.friction, 0.0, x, v, 0.002, 1)
    assert x.tolist() == [0.0, 0.0, START]
    assert v.tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("along", ["random", "line", "circle"])
def test_the_work_of_the_motors_is_energy_and_friction_heat(along: str) -> None:
    table = replace(TABLE, tau_2=0.1)
    run = record(table, seed=1, along=along, conditions=replace(CONDITIONS, duration=1.0, process={}))
    phi, omega = (np.column_stack([run.truth[f"drive_{i}.{name}"] for i in (1, 2, 3)]) for name in ("phi", "omega"))
    step = np.diff(phi, axis=0)
    work = (table.K_x * run.inputs["I_x"][:-1] * step[:, 0] + table.K_y * run.inputs["I_y"][:-1] * step[:, 2]).sum()
    heat = (np.array([table.tau_1, table.tau_2, table.tau_3]) * np.abs(step)).sum()  # misses the ways within steps with a reversal
    stored = kinetic(table, phi[-1] * table.r, omega[-1] * table.r) + table.k * (phi[-1, 0] - phi[-1, 1]) ** 2 / 2
    assert (omega[10:, 0] == 0).sum() > 3
    assert stored + heat == pytest.approx(work, rel=3e-4)


def test_the_accelerometer_reads_the_second_difference_of_the_tool_turned_by_the_angle() -> None:
    """Where no wheel turns back, and the currents keep still: by a fine run of the equations under held currents."""
    x, v, h, rows = np.array([0.01, -0.01, 0.45]), np.array([0.3, -0.2, 0.25]), 1e-4, []
    dynamics = TABLE.dynamics(np.array([3.0, 4.0]), np.zeros(3), None)
    for _ in range(200):
        rows.append(np.concatenate([x, TABLE.outputs(x, v, xy_table.accelerations(dynamics, TABLE.friction, 0.0, x, v))]))
        x, v = advance(dynamics, TABLE.friction, 0.0, x, v, h, 1)
    R = np.array(rows)
    path = R[:, 3:5]
    second = (path[2:] - 2 * path[1:-1] + path[:-2]) / h**2
    alpha = (R[1:-1, 0] - R[1:-1, 1]) / TABLE.b
    assert np.abs(alpha).max() > 0.02
    expected = np.column_stack(
        [np.cos(alpha) * second[:, 0] + np.sin(alpha) * second[:, 1], np.cos(alpha) * second[:, 1] - np.sin(alpha) * second[:, 0]]
    )
    assert R[1:-1, 5:7] == pytest.approx(expected, abs=1e-4)


def test_halving_the_step_of_the_integration_changes_nothing_that_matters(monkeypatch) -> None:
    short = replace(CONDITIONS, duration=0.6)
    coarse = record(seed=1, conditions=short).truth
    monkeypatch.setattr(xy_table, "STEPS", 2)
    fine = record(seed=1, conditions=short).truth
    for name in ("clean.x_r", "clean.y_r"):
        assert np.abs(coarse[name] - fine[name]).max() < 1e-8


def test_the_motions_are_those_that_are_named() -> None:
    time, rng = np.arange(1000) * 0.002, np.random.default_rng(0)
    (x, vx), (y, vy) = motion("circle", time, rng)
    assert np.hypot(x - 0.02, y) == pytest.approx(np.full(1000, 0.02))
    line, _ = motion("line", time, rng)
    assert (line[0].min(), line[0].max()) == pytest.approx((0.0, 0.040), abs=1e-6)
    for position, speed in ((x, vx), (y, vy), line, *motion("random", time, rng)):
        assert np.abs(np.gradient(position, 0.002)[1:-1] - speed[1:-1]).max() < 2e-3
        assert (position[0], speed[0]) == pytest.approx((0.0, 0.0), abs=1e-12)
    with pytest.raises(ValueError, match='motion "square"'):
        motion("square", time, rng)


def test_the_tool_follows_the_circle() -> None:
    run = record(seed=1, along="circle", conditions=replace(CONDITIONS, duration=1.5))
    x, y = run.truth["clean.x_m"], run.truth["clean.y_m"] - START
    assert np.abs(np.hypot(x - 0.02, y) - 0.02)[300:].max() < 0.008
