"""Sliding and sticking in several coordinates against closed forms, the integration of one coordinate by another program, and energy."""

import numpy as np
import pytest

from backsight.data.generators.sliding import Body, Motion
from backsight.data.generators.sliding import respond as respond_alone
from backsight.data.generators.stick_slip import Dynamics, Friction, accelerations, advance

Array = np.ndarray


def springs(k: Array, m: Array, drive: Array) -> Dynamics:
    """Masses m (n,) with a stiffness matrix k (n, n) under forces drive (n,)."""
    return lambda _t, q, _v: (np.diag(m), drive - k @ q)


def coulomb(*level: float, breakaway: tuple[float, ...] | None = None) -> Friction:
    return Friction(sliding=np.array(level), breakaway=np.array(breakaway or level))


def test_one_coordinate_moves_as_another_program_says() -> None:
    """`sliding.py` integrates by DOP853 with its own location of events."""
    body, h, rng = Body(m=95.0, d=200.0, f_c=20.0), 1e-3, np.random.default_rng(0)
    forces = np.repeat(rng.uniform(-60, 60, 60), 10) + rng.normal(0, 15, 600)
    x, v = respond_alone(body, forces, h, Motion())
    q, rate = np.zeros(1), np.zeros(1)
    mine = [(0.0, 0.0)]
    for force in forces:
        dynamics: Dynamics = lambda _t, _q, v, force=force: (np.array([[body.m]]), force - body.d * v)  # noqa: E731
        q, rate = advance(dynamics, coulomb(body.f_c), 0.0, q, rate, h, 1)
        mine.append((float(q[0]), float(rate[0])))
    assert ((v == 0).sum() > 20, (np.diff(np.sign(v[v != 0])) != 0).sum() > 5) == (True, True), "the run should stick and reverse"
    assert (np.array(mine)[:, 1] == 0).tolist() == (v == 0).tolist()
    assert np.abs(np.array(mine) - np.column_stack([x, v])).max() < 1e-11


def test_an_oscillator_loses_two_friction_distances_a_half_swing_and_stays_within_one() -> None:
    """m x'' = -k x - c sgn(x'): turning points 1 - 2 n c/k until one lies within c/k of the middle; there it stays."""
    k, m, c = 9.0, 1.0, 0.9
    dynamics, friction, half = springs(np.array([[k]]), np.array([m]), np.zeros(1)), coulomb(c), np.pi / np.sqrt(k / m)
    q, v = np.array([1.0]), np.zeros(1)
    for n in range(1, 4):
        q, v = advance(dynamics, friction, 0.0, q, v, half, 100)
        assert float(q[0]) == pytest.approx((-1) ** n * (1 - 0.2 * n), abs=1e-9)
        assert float(v[0]) == pytest.approx(0.0, abs=1e-8)
    q, v = advance(dynamics, friction, 0.0, np.array([0.55]), np.zeros(1), 30 * half, 3000)
    assert float(v[0]) == 0.0
    assert float(q[0]) == pytest.approx(0.05, abs=1e-8)  # by 0.55, -0.35, 0.15


def test_a_resting_coordinate_lets_go_when_the_spring_pulls_with_the_breakaway_force() -> None:
    """Mass 1, huge, runs at speed u and pulls mass 2, which starts at t = breakaway/(k u) and then swings about the sliding force."""
    k, u, m, slide, stick = 5.0, 0.4, 2.0, 1.0, 1.5
    dynamics = springs(k * np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([1e12, m]), np.zeros(2))
    friction = coulomb(0.0, slide, breakaway=(0.0, stick))
    start, w = stick / (k * u), np.sqrt(k / m)
    q, v = advance(dynamics, friction, 0.0, np.zeros(2), np.array([u, 0.0]), start - 1e-6, 20)
    assert (float(q[1]), float(v[1])) == (0.0, 0.0)
    for late in (0.1, 0.9, 2.0):
        q, v = advance(dynamics, friction, 0.0, np.zeros(2), np.array([u, 0.0]), start + late, 300)
        # e = u t - x_2 - slide/k:  e'' = -w^2 e, e(start) = (stick - slide)/k, e'(start) = u
        expected = u * (1 - np.cos(w * late)) + w * (stick - slide) / k * np.sin(w * late)
        if expected > 0:
            assert float(v[1]) == pytest.approx(expected, rel=1e-8)


def test_of_two_resting_coordinates_those_start_that_the_forces_overcome() -> None:
    """Coupled masses M = [[2, 1], [1, 2]], levels 1, 1: the reaction of a held one counts, not the force on it alone."""
    M, friction = np.array([[2.0, 1.0], [1.0, 2.0]]), coulomb(1.0, 1.0)

    def start(*drive: float) -> Array:
        return accelerations(lambda _t, _q, _v: (M, np.array(drive)), friction, 0.0, np.zeros(2), np.zeros(2))

    assert start(0.9, -1.0).tolist() == [0.0, 0.0]
    assert start(2.0, 0.0) == pytest.approx([0.5, 0.0])  # held: 0 - 1 * 0.5 within 1
    # Alone, 1 would move with 3/2 and pull 2 with -0.2 - 1.5, more than 1: both move, against each other.
    both = np.linalg.solve(M, [4.0 - 1.0, -0.2 + 1.0])
    assert start(4.0, -0.2) == pytest.approx(both)
    assert both[0] > 0 > both[1]


def test_work_is_energy_and_friction_heat_over_many_sticks_and_slips() -> None:
    k = np.array([[40.0, -25.0, 0.0], [-25.0, 60.0, -20.0], [0.0, -20.0, 20.0]])
    m, level, h = np.array([1.0, 0.5, 0.8]), np.array([0.8, 0.5, 0.0]), 2e-3
    friction, rng = coulomb(*level), np.random.default_rng(5)
    q, v = np.zeros(3), np.zeros(3)
    work, heat, rest, drive = 0.0, 0.0, np.zeros(2), np.zeros(3)
    for i in range(1500):
        drive = rng.normal(0, 1, 3) if i % 10 == 0 else drive
        before = q
        q, v = advance(springs(k, m, drive), friction, 0.0, q, v, h, 1)
        work += drive @ (q - before)
        heat += level @ np.abs(q - before)  # misses the way there and back within the few steps of a reversal
        rest += v[:2] == 0
    energy = (m @ v**2 + q @ k @ q) / 2
    assert rest.min() > 20
    assert energy + heat == pytest.approx(work, rel=1e-4)


def test_halving_the_step_leaves_a_run_with_events_as_it_is() -> None:
    k, m = np.array([[30.0, -30.0], [-30.0, 30.0]]), np.array([1.0, 0.3])

    def driven(t: float, q: Array, _: Array) -> tuple[Array, Array]:
        return np.diag(m), np.array([3 * np.sin(5 * t), 0.0]) - k @ q

    ends = [np.concatenate(advance(driven, coulomb(0.5, 0.3), 0.0, np.zeros(2), np.zeros(2), 4.0, n)) for n in (400, 800, 1600)]
    assert np.abs(ends[1] - ends[0]).max() < 1e-7
    assert np.abs(ends[2] - ends[1]).max() < 1e-8


def test_friction_that_slides_harder_than_it_sticks_is_refused() -> None:
    with pytest.raises(ValueError, match="sliding <= breakaway"):
        coulomb(2.0, breakaway=(1.0,))


def test_a_force_that_jumps_with_the_sign_of_the_velocity_ends_with_an_error_and_not_never() -> None:
    """Friction 1 of the machine and 10 sgn(v) in the force: a drive of 1.1 starts what 11 would hold; one of 14 moves it, with 3."""

    def driven(drive: float) -> Dynamics:
        return lambda _t, _q, v: (np.eye(1), drive - 10.0 * np.sign(v))

    with pytest.raises(ValueError, match=r"starts and stops without end at t = 7 s: force\(t, q, v\) jumps there"):
        advance(driven(1.1), coulomb(1.0), 7.0, np.zeros(1), np.zeros(1), 1e-3, 1)
    q, v = advance(driven(14.0), coulomb(1.0), 7.0, np.zeros(1), np.array([1.0]), 0.1, 10)
    assert (float(q[0]), float(v[0])) == pytest.approx((0.1 + 0.015, 1.3))
