"""A machine of a user's own: a body on a strut, a spring and a damper side by side, above a wheel on a tyre. Simulated here."""

from __future__ import annotations

import numpy as np
import pytest
from neutral import Point

from backsight.estimation import Free, Problem, Recording, diagnose, smooth
from backsight.estimation.diagnosis.candidates.laws import BETWEEN, Motion, between, of_law
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.candidates.places import elements
from backsight.estimation.diagnosis.search.refit import QUICKLY
from backsight.models import Model, compile_model
from backsight.models.mechanics.translational import Damper, Fixed, Force, Mass, PositionSensor, Spring

M, M_W, K, K_T, D, D_UP = 30.0, 4.0, 3e3, 3e4, 150.0, 330.0
STEP, SAMPLE, NOISE = 1e-4, 4e-3, 2e-5
MOTION = Motion(v_rms=0.2, low=-0.3, high=0.5)


def strut() -> Model:
    return Model(
        name="strut",
        components={
            "body": Mass(m=M), "wheel": Mass(m=M_W), "spring": Spring(k=K), "damper": Damper(d=D), "tyre": Spring(k=K_T), "road": Fixed(),
            "shaker": Force(), "top": PositionSensor(), "bottom": PositionSensor(),
        },
        connections=[
            ("body.flange", "spring.flange_a"), ("spring.flange_b", "wheel.flange"), ("body.flange", "damper.flange_a"),
            ("damper.flange_b", "wheel.flange"), ("wheel.flange", "tyre.flange_a"), ("tyre.flange_b", "road.flange"),
            ("shaker.flange", "body.flange"), ("top.flange", "body.flange"), ("bottom.flange", "wheel.flange"),
        ],
        inputs={"F": "shaker.f"},
        outputs={"s": "top.s", "s_w": "bottom.s"},
    )  # fmt: skip


def recorded(seed: int, role: str, rebound: float) -> Recording:
    """Four seconds; rebound: damping [N.s/m] while the strut gets longer."""
    rng, per, rows = np.random.default_rng(seed), round(SAMPLE / STEP), list[tuple[float, ...]]()
    rates, sizes, phases = rng.uniform(0.5, 5.0, 5), rng.uniform(20.0, 60.0, 5), rng.uniform(0.0, 2 * np.pi, 5)
    s = v = s_w = v_w = 0.0
    for row in range(1000):
        force = float(np.sum(sizes * np.sin(2 * np.pi * rates * row * SAMPLE + phases)))
        rows.append((force, s, s_w))
        for _ in range(per):
            between = K * (s - s_w) + (rebound if v > v_w else D) * (v - v_w)
            v += STEP * (force - between) / M
            v_w += STEP * (between - K_T * s_w) / M_W
            s, s_w = s + STEP * v, s_w + STEP * v_w
    F, *read = np.array(rows).T
    outputs = {name: y + NOISE * rng.standard_normal(len(y)) for name, y in zip(("s", "s_w"), read, strict=True)}
    return Recording(name=role, role=role, time=np.arange(1000) * SAMPLE, inputs={"F": F}, outputs=outputs)


def posed(rebound: float) -> Problem:
    """Mass of the body and what the tyre is like are known; the strut's numbers are not."""
    recordings = [recorded(seed, role, rebound) for seed, role in ((1, "fit"), (2, "held_out"))]
    free = {"wheel.m": Free(6.0, min=0.1), "spring.k": Free(2e3, min=1.0), "damper.d": Free(250.0, min=0.0)}
    return Problem(model=strut(), recordings=recordings, parameters=free)


def laws() -> list:
    model = strut()
    return [of_law(law, model, spot, MOTION) for spot in elements(model) for law in BETWEEN if spot.name == between(law, model, spot)]


def test_of_a_spring_and_a_damper_side_by_side_each_has_what_may_be_wrong_of_it_and_the_ground_has_neither():
    found = {(c.place, c.physics) for c in laws()}
    assert found == {
        *(("damper", physics) for physics in ("damping", "coulomb_friction", "asymmetric_friction", "quadratic_drag")),
        *(("spring", physics) for physics in ("cubic_spring", "end_stop")),
    }
    (sides,) = (c for c in laws() if c.physics == "asymmetric_friction")
    assert sides.absorbs == {"damper.d": " ".join(sides.strengths)}


@pytest.mark.parametrize("seed", range(3))
def test_forces_between_two_bodies_are_those_of_the_textbooks_on_either(seed):
    model, base = strut(), compile_model(strut())
    point = Point(base, seed)
    x = dict(zip((q.name for q in base.states), point.x, strict=True))
    s, v = x["body.s"] - x["wheel.s"], x["body.v"] - x["wheel.v"]
    textbook = {
        "d": v, "f_c": np.sign(v), "c": v * abs(v), "k3": s**3, "d_plus": max(v, 0.0), "d_minus": min(v, 0.0),
        "end_stop": max(s - 0.01, 0.0), "lower_end_stop": min(s - 0.01, 0.0),
    }  # fmt: skip
    pull = (point.told(base, {"damper.d": D + 1.0})[0] - point.told(base)[0]) / v  # of a force of one that draws the bodies together
    assert sorted(pull[np.abs(pull) > 1e-12]) == pytest.approx([-1.0, 1.0])
    for c in laws():
        dae, shapes = compile_model(c.edited(model)), dict.fromkeys(c.shapes, 0.01)
        for path in c.strengths:
            effect = point.told(dae, {**shapes, path: 1.0})[0] - point.told(dae, shapes)[0]
            owner, _, word = path.rpartition(".")
            force = textbook[owner.removesuffix("_spring") if word == "k" else word]
            assert effect == pytest.approx(force * pull, rel=5e-3, abs=1e-12), path


def test_stops_are_looked_for_within_the_travel_of_the_spring():
    problem = posed(D)
    solution = smooth(problem, settings=QUICKLY).solution
    assert solution is not None
    read = problem.recordings[0].outputs
    travel = read["s"] - read["s_w"]
    stops = [c for c in library(problem, strut(), solution) if (c.place, c.physics) == ("spring", "end_stop")]
    assert len(stops) == 2
    for c in stops:
        (grid,) = c.shapes.values()
        assert travel.min() < min(grid)
        assert max(grid) < travel.max()


@pytest.mark.slow
def test_a_damper_that_rebounds_harder_is_found_with_both_its_numbers():
    found = diagnose(posed(D_UP))
    (finding,) = found.findings
    assert (finding.explanation.place, finding.explanation.physics) == ("damper", "asymmetric_friction")
    numbers = finding.explanation.parameters
    assert numbers["d_plus"].value == pytest.approx(D_UP, rel=0.01)
    assert numbers["d_minus"].value == pytest.approx(D, rel=0.01)
    assert found.held_out is not None
    assert found.held_out.p_value < 0.05


@pytest.mark.slow
def test_one_that_does_not_is_no_such_damper():
    assert diagnose(posed(D)).verdict == "none"
