"""Laws of the concealed forces: none at strength zero, none takes work that it should give back, the textbook's where they add up."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from backsight.data.generators.concealed.effects import FAMILY, Coulomb, Effect, Law, family, laws, on
from backsight.data.generators.concealed.rig import sticking
from backsight.data.generators.stick_slip import Friction

TIMES = np.array([0.3, 0.8])
ALL = {
    "viscous": lambda s: laws.viscous(s),
    "asymmetric_viscous": lambda s: laws.asymmetric_viscous(2 * s, s),
    "quadratic_drag": lambda s: laws.quadratic_drag(s),
    "spring": lambda s: laws.spring(s, 3 * s),
    "end_stop": lambda s: laws.end_stop(0.1, s),
    "cogging": lambda s: laws.cogging(s, 0.3, 0.4),
    "constant": lambda s: laws.constant(s),
    "stribeck": lambda s: laws.stribeck(s, 0.05),
    "logarithmic": lambda s: laws.logarithmic(s, 1e-3),
    "whirl": lambda s: laws.whirl(s, 0.3),
    "chirp": lambda s: laws.chirp(s, 1.0, 0.5),
    "bumps": lambda s: laws.bumps(s, TIMES, 0.05),
}


@pytest.mark.parametrize("name", ALL)
def test_a_law_vanishes_with_its_strength_and_follows_it(name: str) -> None:
    none, one, two = (ALL[name](s) for s in (0.0, 1.0, 2.0))
    points = [(0.31, 0.23, 0.4), (0.79, -0.2, -0.3), (1.2, 0.15, 0.0)]
    assert all(none(*point) == 0 for point in points)
    assert any(one(*point) for point in points)
    assert all(two(*point) == pytest.approx(2 * one(*point)) for point in points)


@pytest.mark.parametrize("law", [laws.spring(3.0, 20.0), laws.end_stop(0.1, 50.0), laws.cogging(2.0, 0.05, 0.3)])
def test_a_potential_gives_back_what_it_takes(law: Law) -> None:
    there, back = (quad(lambda q, v=v: law(0.0, q, v), a, b, limit=200)[0] for a, b, v in ((-0.2, 0.3, 1.0), (0.3, -0.2, -1.0)))
    assert there == pytest.approx(-back)


@pytest.mark.parametrize("law", [laws.viscous(2.0), laws.asymmetric_viscous(2.0, 1.0), laws.quadratic_drag(3.0)])
def test_friction_takes_power_in_both_directions(law: Law) -> None:
    assert all(law(0.0, 0.1, v) * v > 0 for v in (-0.5, -0.01, 0.01, 0.5))


def test_a_spring_takes_half_k_q_squared() -> None:
    assert quad(lambda q: laws.spring(3.0, 20.0)(0.0, q, 0.0), 0, 0.4)[0] == pytest.approx(3 * 0.4**2 / 2 + 20 * 0.4**4 / 4)


@pytest.mark.parametrize("v", [-0.3, -0.02, 0.004, 0.1])
def test_level_and_law_together_are_the_textbooks_friction(v: float) -> None:
    f_c, more, v_s, b, c, v_dead = 20.0, 15.0, 0.05, 5.0, 46.0, 1e-3
    stribeck = np.sign(v) * (f_c + more) + laws.stribeck(more, v_s)(0.0, 0.0, v)
    assert stribeck == pytest.approx(np.sign(v) * (f_c + more * np.exp(-((v / v_s) ** 2))))
    logarithmic = np.sign(v) * (c + b * np.log(v_dead)) + laws.logarithmic(b, v_dead)(0.0, 0.0, v)
    assert logarithmic == pytest.approx(np.sign(v) * (c + b * np.log(abs(v))))


def test_a_force_is_against_the_motion_of_its_coordinate_alone() -> None:
    force = on(1, 3, laws.viscous(2.0))(0.0, np.zeros(3), np.array([1.0, 3.0, 5.0]))
    assert force.tolist() == [0.0, -6.0, 0.0]


def test_levels_that_stick_add_up_and_those_of_a_place_follow_it() -> None:
    base = Friction(sliding=np.array([10.0, 0.0]), breakaway=np.array([12.0, 0.0]))
    effect = Effect(
        place="",
        physics="",
        friction=(Coulomb(i=0, level=5.0), Coulomb(i=1, level=2.0), Coulomb(i=0, level=3.0, factor=lambda q: float(np.sin(q)))),
    )
    sliding, breakaway = sticking(base, [effect]).levels(0.0, np.array([np.pi / 2, 0.3]))
    assert sliding == pytest.approx([18.0, 2.0])
    assert breakaway == pytest.approx([17.0 * 18 / 15, 2.0])


def test_a_level_of_a_place_without_any_other_is_refused() -> None:
    effect = Effect(place="", physics="", friction=(Coulomb(i=0, level=3.0, factor=lambda _q: 1.0),))
    with pytest.raises(ValueError, match="needs some beside it"):
        sticking(Friction(sliding=np.zeros(1), breakaway=np.zeros(1)), [effect])


def test_a_word_belongs_to_one_family() -> None:
    words = [word for members in FAMILY.values() for word in members.split()]
    assert len(words) == len(set(words))
    assert (family("cogging"), family("sensor_lag"), family("drive_1.J")) == ("periodic", "sensor", "parameter")
