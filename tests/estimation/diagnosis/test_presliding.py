"""Bending asperities along a known motion, against an integrator's; and the candidate that has them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from examples import oscillator
from scipy.integrate import solve_ivp

from backsight.estimation import Free, Problem, Recording, diagnose
from backsight.estimation.diagnosis.candidates.edits import Insert
from backsight.estimation.diagnosis.candidates.laws import Motion
from backsight.estimation.diagnosis.candidates.places import bodies
from backsight.estimation.diagnosis.candidates.presliding import bristles, of_presliding
from backsight.estimation.diagnosis.scores.score import Columns
from backsight.estimation.diagnosis.scores.screen import Screened
from backsight.estimation.diagnosis.scores.supermodel import Look
from backsight.estimation.diagnosis.search.refit import begun
from backsight.models import Parameter, compile_model
from backsight.models.mechanics.friction_laws import bristle_rate
from backsight.models.mechanics.translational import AsymmetricFriction, DahlFriction, Friction, StribeckFriction
from backsight.models.plants import actuator

LEVEL, DELTA, WIDTH = 20.0, 2e-4, 1e-4


@pytest.mark.parametrize("rate", [500.0, 2000.0])
def test_the_force_is_what_the_law_of_dahl_gives_over_the_sign_of_the_velocity(rate: float) -> None:
    time = np.arange(0.0, 1.5, 1 / rate)

    def v(t):
        return 0.02 * np.sin(2 * np.pi * 3 * t) + 0.004 * np.cos(2 * np.pi * 11 * t)

    law = solve_ivp(
        lambda t, z: v(t) - np.abs(v(t)) * z / DELTA, (0.0, 1.6), [DELTA], rtol=1e-9, atol=1e-12, max_step=2e-4, dense_output=True
    )
    fine = (np.arange(40) + 0.5) / 40 / rate
    true = np.array([np.mean(LEVEL * (np.tanh(v(t + fine) / WIDTH) - law.sol(t + fine)[0] / DELTA)) for t in time])
    found = bristles(time, v(time), level=LEVEL, delta=DELTA, width=WIDTH)
    assert np.sqrt(np.mean(true**2)) > 0.2 * LEVEL
    assert np.sqrt(np.mean((found - true) ** 2)) < 0.1 * (500.0 / rate) * np.sqrt(np.mean(true**2))


def test_where_asperities_are_stiff_nothing_is_left_but_the_sign() -> None:
    time = np.linspace(0.0, 1.0, 2001)
    velocity = 0.2 * np.cos(2 * np.pi * time)
    moving = np.abs(velocity) > 0.01
    assert np.abs(bristles(time, velocity, level=1.0, delta=1e-7, width=1e-5)[moving]).max() < 1e-3


def test_a_body_with_friction_may_have_it_and_gives_its_level_up() -> None:
    model = actuator()
    (carriage,) = (s for s in bodies(model) if s.name == "carriage")
    motion = Motion(v_rms=0.1, low=-0.1, high=0.1)
    (c,) = of_presliding(model, carriage, motion, {"friction.f_c": 20.0, "friction.width": 1e-3}, seen=True)
    assert c.absorbs == {"friction.f_c": "presliding_friction_carriage.f_c"}
    assert c.start["presliding_friction_carriage.f_c"][0] == 20.0
    edited = compile_model(c.edited(model))
    assert set(c.start) <= {p.name for p in edited.parameters}
    assert "presliding_friction_carriage.z" in {q.name for q in edited.states}
    ways = [20.0 / next(iter(s.start.values())) for s in c.signals]
    assert ways == sorted(ways)
    assert 0 < min(ways) < max(ways) < motion.span


def test_a_creeping_body_bends_its_asperities_as_the_law_of_dahl_has_it() -> None:
    """Over a way as long as they bend, at half a percent of the usual velocity: with |v| rounded as signs are none would ever slide."""
    (carriage,) = (s for s in bodies(actuator()) if s.name == "carriage")
    motion = Motion(v_rms=0.1, low=-0.1, high=0.1)
    (c,) = of_presliding(actuator(), carriage, motion, {"friction.f_c": LEVEL, "friction.width": 1e-3}, seen=True)
    made = c.edits[0].component.parameters
    v, way = 0.005 * motion.v_rms, LEVEL / made["sigma_0"]
    rate = lambda _, z: bristle_rate(v, z, made["sigma_0"], LEVEL, made["width"])  # noqa: E731
    slow = solve_ivp(rate, (0.0, way / v), [0.0], rtol=1e-9, atol=1e-15)
    assert slow.y[0, -1] == pytest.approx(way * (1 - np.exp(-1)), rel=0.01)


def test_a_body_without_friction_may_have_as_much_as_the_score_tells() -> None:
    """Bouc and Dahl: a loop over the position of a joint that never slides all the way; what brings no output is known of has none."""
    model, motion = actuator(), Motion(v_rms=0.1, low=-0.1, high=0.1)
    (carriage,) = bodies(model)
    (c,) = of_presliding(model, carriage, motion, {"friction.f_c": 0.0}, seen=True)
    assert c.grows == ("presliding_friction_carriage.f_c", "presliding_friction_carriage.sigma_0")
    assert c.absorbs == {}
    way = c.signals[3].start["presliding_friction_carriage.f_c"] / c.signals[3].start["presliding_friction_carriage.sigma_0"]
    assert 0.01 * motion.span < way < motion.span
    look = Look(candidate=c, shape=dict(c.signals[3].start), columns=Columns(squares=np.empty((0, 1)), multiplied=np.empty((0, 1))))
    screened = Screened(look=look, gain=9.0, estimate=np.array([7.0]), std=np.array([0.1]), freedom=1)
    start = begun(c, screened, {})
    assert start == pytest.approx({"presliding_friction_carriage.f_c": 7.0, "presliding_friction_carriage.sigma_0": 7.0 / way})
    assert of_presliding(model, carriage, motion, {"friction.f_c": 0.0}, seen=False) == []


def test_where_nothing_moves_or_another_law_holds_a_body_there_is_nothing_to_bend() -> None:
    model = actuator()
    (carriage,) = bodies(model)
    for level in (0.0, 1.0):
        assert of_presliding(model, carriage, Motion(v_rms=0.1, low=0.0, high=0.0), {"friction.f_c": level}, seen=True) == []
    law = Insert(place="carriage.flange", component=AsymmetricFriction(), name="own")(model)
    values = {"friction.f_c": 0.0, "own.f_plus": 3.0, "own.f_minus": 4.0}
    assert of_presliding(law, carriage, Motion(v_rms=0.1, low=-0.1, high=0.1), values, seen=True) == []


@pytest.mark.slow
def test_a_stage_whose_guide_yields_is_found_with_its_numbers() -> None:
    """8 N that come up over 2 mm, in a guide that the model takes for frictionless; simulated with the law of Dahl at sharp corners."""

    def record(seed: int, role: str) -> Recording:
        rng, n, rate = np.random.default_rng(seed), 1200, 400.0
        force = np.convolve(np.repeat(rng.normal(0.0, 18.0, n // 40), 40), np.ones(30) / 30, "same")
        state, read = np.zeros(3), np.empty(n)
        for k in range(n):
            read[k] = state[0]

            def slope(_t: float, x: np.ndarray, f: float = force[k]) -> list[float]:
                return [x[1], (f - 2e3 * x[0] - 10.0 * x[1] - 4e3 * x[2]) / 2.0, x[1] - 4e3 * abs(x[1]) * x[2] / 8.0]

            state = solve_ivp(slope, (0.0, 1.0 / rate), state, rtol=1e-8, atol=1e-12).y[:, -1]
        y = read + 2e-6 * rng.standard_normal(n)
        return Recording(name=role, role=role, time=np.arange(n) / rate, inputs={"F": force}, outputs={"x": y})

    known = {"mass.m": Free(1.7, min=0.01), "spring.k": Free(2.5e3, min=10.0), "damper.d": Free(20.0, min=0.0), "offset.f": 0.0}
    found = diagnose(Problem(model=oscillator(), recordings=[record(1, "fit"), record(2, "held_out")], parameters=known))
    assert found.verdict == "missing_physics"
    (f,) = found.findings
    assert (f.explanation.place, f.explanation.physics) == ("mass", "presliding_friction")
    told = f.explanation.parameters
    for word, true in (("f_c", 8.0), ("sigma_0", 4e3)):
        assert told[word].value == pytest.approx(true, rel=2e-3)
        assert abs(told[word].value - true) < 5 * told[word].std
    assert found.held_out is not None
    assert found.held_out.improvement_percent > 90.0


def test_a_level_that_is_not_all_of_its_law_stays() -> None:
    model = actuator()
    (carriage,) = bodies(model)
    motion, values = Motion(v_rms=0.1, low=-0.1, high=0.1), {"friction.f_c": 20.0}
    laws = {"stribeck_friction": StribeckFriction(), "coulomb_friction": Friction(), "presliding_friction": DahlFriction()}
    for name, component in laws.items():
        edited = Insert(place="carriage.flange", component=component, name="own")(model)
        found = of_presliding(edited, carriage, motion, {"friction.f_c": 0.0, "own.f_c": 20.0}, seen=True)
        assert [c.absorbs for c in found] == ([{"own.f_c": f"{found[0].named['f_c']}"}] if name == "coulomb_friction" else [])
    assert len(of_presliding(model, carriage, motion, values, seen=True)) == 1


def test_a_level_that_two_bodies_share_stays_and_a_width_by_another_name_is_found() -> None:
    model, motion = actuator(), Motion(v_rms=0.1, low=-0.1, high=0.1)
    (carriage,) = bodies(model)
    level = Parameter("N", 20.0, min=0.0, description="level")
    width = Parameter("m/s", 1e-3, min=1e-9, description="width")
    own = replace(model, parameters={"level": level, "w": width}, bindings={"friction.f_c": "level", "friction.width": "w"})
    (c,) = of_presliding(own, carriage, motion, {"level": 20.0, "w": 3e-3}, seen=True)
    assert list(c.absorbs) == ["level"]
    assert all(signal.changed.keywords["width"] == 3e-3 for signal in c.signals)
    both = replace(own, bindings={**own.bindings, "offset.f": "level"})
    assert of_presliding(both, carriage, motion, {"level": 20.0, "w": 3e-3}, seen=True) == []
