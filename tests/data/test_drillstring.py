"""The simulated drillstring against published numbers, closed forms and the balance of energy."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import cont2discrete, ss2tf

from backsight.data.generators import drillstring
from backsight.data.generators.drillstring import CONDITIONS, Drillstring, Rig, record

STRING = Drillstring()
QUIET = np.zeros(3)


def transfer(h: float) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator (without the leading 0 and 1) of the held voltage to the current, by the simulator's own steps."""
    rig, A = Rig(replace(STRING, tau_sl=0.0, tau_st=0.0)), np.empty((4, 4))
    for i in range(4):
        A[:, i] = rig.flow(1, np.zeros(4), np.eye(4)[i], h)
    b = rig.flow(1, rig.string.drive(1, 1.0, QUIET), np.zeros(4), h)
    numerator, denominator = ss2tf(A, b[:, None], np.eye(4)[:1], np.zeros((1, 1)))
    return numerator[0, 1:], denominator[1:]


@pytest.mark.parametrize(
    ("h", "a", "b"),
    [
        (0.05, [-2.3503, 1.7085, -0.3557, 0.0001], [0.0208, -0.0621, 0.0619, -0.0206]),
        (0.10, [-2.1069, 1.2474, -0.1262, 0.0001], [0.0076, -0.0223, 0.0220, -0.0073]),
    ],
)
def test_the_sampled_transfer_function_has_the_published_coefficients(h, a, b) -> None:
    """KSEPL, 1992, section 4: voltage to motor current, zero-order hold, four digits; its last a at 10 Hz is a slip, 6e-9."""
    numerator, denominator = transfer(h)
    assert numerator == pytest.approx(b, abs=6e-5)
    assert denominator == pytest.approx(a, abs=1.1e-4)


def test_a_stuck_bit_leaves_the_published_transfer_function_of_third_order() -> None:
    A, *_ = cont2discrete((STRING.sticking[:3, :3], np.eye(3)[:, :1] / STRING.L, np.eye(3)[:1], np.zeros((1, 1))), 0.1)
    assert np.poly(A)[1:] == pytest.approx([-1.1251, 0.1265, 0.0], abs=6e-5)


def test_a_bit_held_by_a_twisting_string_lets_go_at_breakaway_and_then_swings_about_sliding() -> None:
    """The table turns at 1 rad/s (huge inertia): Omega_b = 1 - cos w t + w (tau_st - tau_sl)/k sin w t after t = tau_st/k."""
    string = replace(STRING, J_c=1e12, B_r=0.0, Km=0.0, B_b=0.0)
    rig, y, s, h = Rig(string), np.array([0.0, 1.0, 0.0, 0.0]), 0, 0.02
    start, w = string.tau_st / string.k, np.sqrt(string.k / string.J_b)
    speeds = []
    for _ in range(round(start / h) + 90):
        y, s = rig.advance(y, s, 0.0, QUIET, h)
        speeds.append(y[3])
    t = h * np.arange(1, len(speeds) + 1) - start
    expected = np.where(t < 0, 0.0, 1 - np.cos(w * t) + w * (string.tau_st - string.tau_sl) / string.k * np.sin(w * t))
    assert (t < 0).sum() > 300
    assert np.array(speeds) == pytest.approx(expected, abs=1e-9)
    assert not np.array(speeds)[t < 0].any()


def test_a_string_twisted_less_than_breakaway_never_moves_the_bit() -> None:
    rig, y, s = Rig(STRING), np.array([0.0, 0.0, 0.999 * STRING.tau_st / STRING.k, 0.0]), 0
    hold = STRING.R / (STRING.n * STRING.Km) * STRING.k * y[2]  # the voltage that holds the table against the string
    y[0] = hold / STRING.R
    for _ in range(500):
        y, s = rig.advance(y, s, hold, QUIET, 0.02)
        assert (s, y[3]) == (0, 0.0)
    assert y[2] == pytest.approx(0.999 * STRING.tau_st / STRING.k, rel=1e-9)


def test_a_sliding_bit_that_stops_sticks_or_turns_back_as_the_string_says() -> None:
    for twist, after in ((2.0, 0), (9.0, 1), (-9.0, -1)):
        y, s = np.array([0.0, 0.0, twist, 0.0]), 0
        assert STRING.mode(y, 0.0) == after, s


def test_the_energy_of_the_source_is_stored_or_dissipated() -> None:
    rig, rng, h = Rig(STRING), np.random.default_rng(4), 2e-4
    y, s, states, volts, sticks = np.zeros(4), 0, [np.zeros(4)], [], 0
    for _ in range(150):
        voltage = rng.uniform(-20, 90)
        for _ in range(500):
            y, s = rig.advance(y, s, voltage, QUIET, h)
            states.append(y)
            volts.append(voltage)
            sticks += s == 0
    Y = np.array(states)
    before, behind = Y[:-1], Y[1:]

    def integral(product: np.ndarray) -> float:
        return float(product.sum() * h)

    def square(i: int) -> np.ndarray:  # of a straight line between the rows
        return (before[:, i] ** 2 + before[:, i] * behind[:, i] + behind[:, i] ** 2) / 3

    middle = (before + behind) / 2
    work = integral(np.array(volts) * middle[:, 0])
    heat = integral(STRING.R * square(0) + STRING.B_r * square(1) + STRING.B_b * square(3) + STRING.tau_sl * np.abs(middle[:, 3]))
    stored = float(np.array([STRING.L, STRING.J_c, STRING.k, STRING.J_b]) @ Y[-1] ** 2 / 2)
    assert 1000 < sticks < 70_000, "the bit should stick and slide"
    assert heat + stored == pytest.approx(work, rel=2e-5)


def test_the_length_of_the_steps_does_not_matter_to_what_is_solved_exactly() -> None:
    rig = Rig(STRING)
    ends = []
    for steps in (1, 7):
        y, s = np.array([0.3, 4.0, 2.0, 0.0]), 0
        for voltage in (60.0, 20.0, 90.0, 10.0):
            for _ in range(60 * steps):
                y, s = rig.advance(y, s, voltage, QUIET, 0.02 / steps)
        ends.append(y)
    assert ends[0] == pytest.approx(ends[1], rel=1e-8)


def test_a_force_of_the_caller_is_followed_to_second_order(monkeypatch) -> None:
    """A cubic drag on the bit, by two ways of halving the substep."""

    def drag(_t: float, _q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.array([0.0, 0.0, -2e-4 * v[1] ** 3])

    quiet = replace(CONDITIONS, duration=10.0, noise={"I_m": 1e-9, "Omega_r": 1e-9}, process={})
    runs = []
    for substep in (0.02, 0.01, 0.005):
        monkeypatch.setattr(drillstring, "SUBSTEP", substep)
        runs.append(record(seed=1, conditions=quiet, force=drag).truth["bha.omega"])
    errors = [np.abs(coarse - fine).max() for coarse, fine in pairwise(runs)]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.5)
    assert errors[1] < 1e-3
    plain = record(seed=1, conditions=quiet).truth["bha.omega"]
    assert np.abs(plain - runs[-1]).max() > 0.1


def test_the_default_run_sticks_and_slips_at_several_speeds() -> None:
    run = record(seed=1)
    bit = run.truth["bha.omega"]
    assert 0.1 < (bit == 0).mean() < 0.9
    assert (np.diff((bit == 0).astype(int)) == 1).sum() >= 3
    noise = run.outputs["I_m"] - run.truth["clean.I_m"]
    assert noise.std() == pytest.approx(CONDITIONS.noise["I_m"], rel=0.08)


def test_a_bit_that_slides_harder_than_it_sticks_is_refused() -> None:
    with pytest.raises(ValueError, match="tau_sl <= tau_st"):
        Drillstring(tau_sl=0.7)
