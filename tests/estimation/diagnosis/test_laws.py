"""The laws of the library: without strength they are not there, with it they are what textbooks say, linear in their strengths."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from neutral import Point

from backsight.estimation.diagnosis.candidates.laws import AGAINST_GROUND, BETWEEN, Motion, between, of_law
from backsight.estimation.diagnosis.candidates.places import bodies, elements
from backsight.estimation.smoothing.rest import ROUNDING
from backsight.models import Dae, compile_model
from backsight.models.plants import PLANTS, actuator
from backsight.models.quadratures import without_ignorable

MOTION = Motion(v_rms=0.2, low=-0.3, high=0.5)
WIDE = replace(MOTION, high=0.8)  # rad: a part of a turn that tells a weight


def candidates(model) -> list:
    return [of_law(law, model, spot, WIDE) for spot in bodies(model) for law in AGAINST_GROUND if law.there(spot.kind, WIDE)] + [
        of_law(law, model, spot, WIDE) for spot in elements(model) for law in BETWEEN if between(law, model, spot) == spot.name
    ]


def shaped(c) -> dict[str, float]:
    return {name: 0.0 if name.endswith(".x") else grid[-1] for name, grid in c.shapes.items()} | (
        {c.quadrature: 0.4} if c.quadrature else {}
    )


@cache
def grown(plant: str) -> tuple:
    """A plant, the plant with the laws of all its places, and these laws, without those that need a state that the plant does without."""
    model = PLANTS[plant]()
    base = without_ignorable(compile_model(model))

    def all_of(laws: list) -> Dae:
        whole = model
        for c in laws:
            whole = c.edited(whole)
        return without_ignorable(compile_model(whole))

    used = candidates(model)
    whole = all_of(used)
    if len(whole.states) > len(base.states):
        used = [c for c in used if len(all_of([c]).states) == len(base.states)]
        whole = all_of(used)
    return base, whole, used


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["actuator", "xy_table", "drillstring", "five_bar"])
def test_without_strength_all_of_them_together_change_nothing(plant):
    base, whole, used = grown(plant)
    assert len(used) >= 10
    shapes = {name: value for c in used for name, value in shaped(c).items()}
    for seed in range(3):
        point = Point(base, seed)
        for a, b in zip(point.told(whole, shapes), point.told(), strict=True):
            assert a == pytest.approx(b, rel=1e-9, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["actuator", "xy_table", "drillstring", "five_bar"])
def test_every_strength_does_something_and_twice_the_strength_twice_as_much(plant):
    base, whole, used = grown(plant)
    for c in used:
        moves = np.zeros(len(c.strengths))
        for seed in range(8):
            point, shapes = Point(base, seed), shaped(c)
            still = np.concatenate(point.told(whole, shapes))
            for i, name in enumerate(c.strengths):
                once, twice = (np.concatenate(point.told(whole, {**shapes, name: a})) - still for a in (0.5, 1.0))
                if c.physics != "added_mass" or plant in ("actuator",):  # elsewhere the mass may stand in what is solved for
                    assert twice == pytest.approx(2 * once, rel=1e-6, abs=1e-9), c.title
                moves[i] += np.abs(once).max()
        assert np.all(moves > 1e-11), c.title


def formula(c, s: float, v: float, a: float, width: float, values: dict[str, float]) -> dict[str, float]:
    """Strength -> force against the motion at unit strength, away from the rounding of sgn."""
    sgn = np.sign(v)
    sh = {path.rpartition(".")[2]: value for path, value in values.items()}
    wave = np.sin(2 * np.pi * s / sh["period"] + sh["phase"]) if "period" in sh else 0.0
    fall = np.exp(-((v / sh["v_s"]) ** 2)) if "v_s" in sh else 0.0
    by_physics = {
        "viscous_friction": {"d": v},
        "coulomb_friction": {"f_c": sgn},
        "stribeck_friction": {"f_c": (1 - fall) * sgn, "f_s": fall * sgn},
        "logarithmic_friction": {"b": sgn * np.log(abs(v) / 0.0254), "c": sgn},
        "position_dependent_friction": {"f_c": (1 + wave) * sgn},
        "cogging": {"amplitude": wave},
        "spring": {"k": s - sh.get("s_rel0", 0.0)},
        "cubic_spring": {"k3": s**3},
        "quadratic_drag": {"c": v * abs(v)},
        "constant_force": {"f": 1.0},
        "added_mass": {"m": a},
        "end_stop": {"k": min(s, 0.0) if c.strengths[0].startswith("lower") else max(s, 0.0)},
    }
    sides = {"d_plus": max(v, 0.0), "d_minus": min(v, 0.0), "f_plus": float(v > 0), "f_minus": -float(v < 0)}
    del width
    return by_physics.get(c.physics, sides)


@pytest.mark.parametrize("seed", range(4))
def test_forces_on_the_axis_are_those_of_the_textbooks(seed):
    model = actuator()
    base, whole, used = grown("actuator")
    point = Point(base, seed)
    names = [q.name for q in base.states]
    s, v = point.x[names.index("carriage.s")], point.x[names.index("carriage.v")]
    a = point.dx[names.index("carriage.v")]
    # what a newton against the motion does to the balance, by a law that the model has
    still, pushed = (point.told(base, {"offset.f": f})[0] for f in (0.0, 1.0))
    newton = pushed - still
    assert abs(v) > 0.01
    assert np.count_nonzero(newton) == 1
    for c in used:
        if c.place != "carriage":
            continue
        shapes = shaped(c)
        for path in c.strengths:
            effect = point.told(whole, {**shapes, path: 1.0})[0] - point.told(whole, shapes)[0]
            force = formula(c, s, v, a, 0.0, shapes)[path.rpartition(".")[2]]
            assert effect == pytest.approx(force * newton, rel=2e-3, abs=1e-6 * np.abs(newton).max()), (c.title, path)
    assert len(model.components) < len(whole.parameters)


@pytest.mark.parametrize("physics", ["cogging"])
def test_a_phase_is_between_its_two_quadratures(physics):
    base, whole, used = grown("actuator")
    c = next(c for c in used if c.physics == physics)
    point, (name,) = Point(base), c.strengths
    shapes = shaped(c)

    def effect(phase: float) -> np.ndarray:
        return point.told(whole, {**shapes, c.quadrature: phase, name: 1.0})[0] - point.told(whole, shapes)[0]

    phase = 0.9
    assert effect(phase) == pytest.approx(np.cos(phase) * effect(0.0) + np.sin(phase) * effect(np.pi / 2))


@pytest.mark.parametrize("plant", ["actuator", "xy_table", "drillstring", "five_bar"])
def test_what_physics_lets_only_be_positive_brakes(plant):
    base, whole, used = grown(plant)
    asked = 0
    for c in used:
        if not c.one_sided or c.family not in ("friction", "fluid", "transmission") or len(c.strengths) > 1:
            continue
        spot = next((s for s in bodies(PLANTS[plant]()) if s.name == c.place), None)
        rate = f"{c.place}.{'v' if spot and spot.kind == 'translational' else 'omega'}"
        if spot is None or rate not in base.variables:
            continue
        push = f"constant_force_{spot.name}"
        for seed in range(3):
            point = Point(base, seed)
            v = float(base.probe(rate)(point.dx, point.x, point.z, point.u, base.parameter_values(), point.w, point.t))
            effect = point.told(whole, {c.strengths[0]: 1.0})[0] - point.told(whole)[0]
            unit = next((f"{push}.{w}" for w in ("f", "tau") if f"{push}.{w}" in {p.name for p in whole.parameters}), None)
            if unit is None or abs(v) < 1e-3:
                continue
            against = point.told(whole, {unit: 1.0})[0] - point.told(whole)[0]
            assert effect @ against * v > 0, c.title
            asked += 1
    assert asked > 0


def test_shapes_hang_on_how_the_machine_moved():
    model = actuator()
    (spot,) = bodies(model)
    by = {law.label or law.physics: of_law(law, model, spot, MOTION) for law in AGAINST_GROUND if law.there(spot.kind, MOTION)}
    (velocities,) = by["stribeck_friction"].shapes.values()
    assert velocities[0] == pytest.approx(0.002)
    assert velocities[-1] == pytest.approx(0.2)
    (periods,) = by["cogging"].shapes.values()
    assert max(periods) == pytest.approx(0.8)
    waves = 0.8 / np.array(periods)
    assert np.diff(waves) == pytest.approx(0.5)
    (coarse,) = by["position_dependent_friction"].shapes.values()
    assert set(coarse) < set(periods)
    assert min(coarse) > 0.8 / 12
    (rests,) = by["spring_at_rest"].shapes.values()
    assert np.mean(rests) == pytest.approx(0.1)
    assert min(rests) < -0.3 - 0.8
    angles = np.arctan((np.array(rests) - 0.1) / 0.4)  # of what is constant and what varies, for positions spread evenly over the way
    assert np.diff(angles) == pytest.approx(np.pi / len(rests))
    still = Motion(v_rms=0.2, low=0.1, high=0.1)
    law = next(law for law in AGAINST_GROUND if law.physics == "cogging")
    (none,) = of_law(law, model, spot, still).shapes.values()
    assert none == ()


def test_signs_are_rounded_in_proportion_to_the_velocity():
    model = actuator()
    (spot,) = bodies(model)
    law = next(law for law in AGAINST_GROUND if law.physics == "coulomb_friction")
    (edit,) = of_law(law, model, spot, MOTION).edits
    assert edit.component.parameters["width"] == pytest.approx(ROUNDING * 0.2)


def test_a_richer_law_takes_the_part_of_a_plainer_one_that_is_there():
    model = actuator()
    (spot,) = bodies(model)
    by = {law.label or law.physics: of_law(law, model, spot, MOTION) for law in AGAINST_GROUND if law.there(spot.kind, MOTION)}
    assert by["stribeck_friction"].absorbs == {"friction.f_c": "stribeck_friction_carriage.f_c stribeck_friction_carriage.f_s"}
    assert by["asymmetric_friction"].absorbs == {"friction.d": "asymmetric_friction_carriage.d_plus asymmetric_friction_carriage.d_minus"}
    assert by["logarithmic_friction"].absorbs == {"friction.f_c": "logarithmic_friction_carriage.c"}
    assert by["coulomb_friction"].absorbs == {}
    turning = PLANTS["xy_table"]()
    drive = next(s for s in bodies(turning) if s.name == "drive_1")
    law = next(law for law in AGAINST_GROUND if law.physics == "stribeck_friction")
    c = of_law(law, turning, drive, MOTION)
    assert c.absorbs == {"friction_1.tau_c": "stribeck_friction_drive_1.tau_c stribeck_friction_drive_1.tau_s"}
    assert set(c.named) == {"tau_c", "tau_s", "v_s"}


def test_a_name_that_is_taken_is_not_taken_twice():
    model = actuator()
    (spot,) = bodies(model)
    law = next(law for law in AGAINST_GROUND if law.physics == "coulomb_friction")
    first = of_law(law, model, spot, MOTION)
    second = of_law(law, first.edited(model), spot, MOTION)
    assert first.strengths != second.strengths
    assert compile_model(second.edited(first.edited(model)))


def test_all_laws_have_names_that_findings_can_be_written_with():
    for plant in ("actuator", "xy_table", "drillstring", "five_bar"):
        model = PLANTS[plant]()
        for c in candidates(model):
            declared = {f"{e.name}.{w}" for e in c.edits for w in e.component.declared_parameters}
            assert set(c.named.values()) <= declared
            assert set(c.strengths) <= set(c.named.values())
            assert {*c.shapes, *c.start} <= declared


@pytest.mark.parametrize(
    ("kind", "low", "high", "there"),
    [
        ("rotational", -0.6, 0.6, True),
        ("rotational", 0.0, 0.4, False),
        ("rotational", 0.0, 7.0, False),
        ("translational", -0.6, 0.6, False),
    ],
)
def test_a_weight_beside_the_axis_is_looked_for_where_a_part_of_a_turn_tells_it(kind, low, high, there):
    (law,) = (law for law in AGAINST_GROUND if law.physics == "gravity")
    assert law.there(kind, Motion(v_rms=1.0, low=low, high=high)) is there


def test_a_weight_takes_the_place_of_a_spring_that_was_found_and_of_none_that_the_model_has():
    spring, weight = (next(law for law in AGAINST_GROUND if law.physics == physics) for physics in ("spring", "gravity"))
    model = PLANTS["drillstring"]()
    spot = next(spot for spot in bodies(model) if spot.kind == "rotational")
    found = of_law(spring, model, spot, WIDE)
    (brought,) = (path.partition(".")[0] for path in found.strengths)
    sprung = found.edited(model)
    assert of_law(weight, sprung, spot, WIDE, {brought}).replaces(found)
    assert not of_law(weight, sprung, spot, WIDE).absorbs
    stop = of_law(next(law for law in AGAINST_GROUND if law.physics == "end_stop"), model, spot, WIDE)
    (stopping,) = {path.partition(".")[0] for path in stop.strengths}
    assert stop.later == {f"{stopping}.d": (0.0, 0.0, np.inf)}
    assert f"{stopping}.d" not in {*stop.strengths, *stop.start, *stop.named.values()}  # sought without it
    assert not of_law(weight, stop.edited(model), spot, WIDE, {stopping}).absorbs
