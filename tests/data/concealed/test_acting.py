"""What acts of a command, row by row, against the textbook's signal."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from backsight.data.generators.concealed.acting import Actuation, InputFault

TIME = np.arange(60) * 0.01
COMMANDS = np.random.default_rng(3).normal(size=60)


def acted(fault: InputFault, times: np.ndarray) -> np.ndarray:
    """u as it acts at these times, which are increasing."""
    actuation, out = Actuation({0: fault}, np.array([0.2])), np.empty(times.size)
    for k, t in enumerate(TIME):
        for begin, end, u in actuation.pieces(t, t + 0.01, COMMANDS[k : k + 1]):
            for i in np.flatnonzero((times >= begin - 1e-12) & (times < end - 1e-12)):
                out[i] = u(times[i])[0]
    return out


def held(t: np.ndarray) -> np.ndarray:
    """The commands as a signal, 0.2 before the first."""
    k = np.searchsorted(TIME, t + 1e-9, side="right") - 1
    return np.where(k < 0, 0.2, COMMANDS[np.maximum(k, 0)])


FINE = (np.arange(1200) + 0.5) * 5e-4


@pytest.mark.parametrize("delay", [0.0, 0.004, 0.01, 0.0237])
def test_a_delay_shifts_the_held_command_even_within_a_row(delay: float) -> None:
    assert np.array_equal(acted(InputFault(delay=delay), FINE), held(FINE - delay))


def test_pieces_fill_the_row() -> None:
    actuation = Actuation({0: InputFault(delay=0.0237)}, np.zeros(1))
    for k, t in enumerate(TIME):
        pieces = actuation.pieces(t, t + 0.01, COMMANDS[k : k + 1])
        assert pieces[0][0] == t
        assert pieces[-1][1] == t + 0.01
        assert all(one[1] == other[0] for one, other in pairwise(pieces))


def test_a_lag_follows_its_differential_equation() -> None:
    x, ends = 0.2, []
    for u in COMMANDS:
        x = solve_ivp(lambda _t, y, u=u: (u - y) / 0.03, (0, 0.01), [x], rtol=1e-10, atol=1e-12).y[0, -1]
        ends.append(x)
    assert acted(InputFault(tau=0.03), TIME[1:]) == pytest.approx(ends[:-1], abs=1e-8)


def test_static_faults_do_what_their_names_say() -> None:
    assert InputFault(gain=0.9).static(2.0) == pytest.approx(1.8)
    assert InputFault(offset=-0.5).static(2.0) == pytest.approx(1.5)
    assert InputFault(limit=1.5).static(-2.0) == pytest.approx(-1.5)
    assert [InputFault(width=0.3).static(u) for u in (0.2, -0.2, 1.0, -1.0)] == pytest.approx([0.0, 0.0, 0.7, -0.7])


def test_before_its_onset_a_fault_is_none() -> None:
    found = acted(InputFault(gain=0.5, tau=0.03, onset=0.3), FINE)
    assert np.array_equal(found[FINE < 0.3], held(FINE[FINE < 0.3]))
    assert not np.allclose(found[FINE > 0.3], held(FINE[FINE > 0.3]))


def test_without_faults_the_command_acts_as_it_is() -> None:
    ((begin, end, u),) = Actuation({}, np.zeros(1)).pieces(0.0, 0.01, np.array([3.0]))
    assert (begin, end, u(0.004)[0]) == (0.0, 0.01, 3.0)
