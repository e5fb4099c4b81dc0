"""What may be missing in planes and in space, against Newton's and Euler's laws written down by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from neutral import Point

from backsight.estimation import Known, Problem, Recording
from backsight.estimation.diagnosis.candidates.frames import of_frames, with_heading
from backsight.models import Model, compile_model
from backsight.models.mechanics import spatial
from backsight.models.mechanics.planar import Body, FixedTranslation, FrameFixed, MomentBody, Prismatic, Revolute, World
from backsight.models.plants import PLANTS, quadrotor, xy_table
from backsight.models.quadratures import without_ignorable


def by_name(model) -> dict:
    return {(c.place, c.physics): c for c in reversed(of_frames(model, {}))}  # of given wrenches the force


@pytest.mark.parametrize("plant", [xy_table, quadrotor])
def test_without_strength_they_change_nothing(plant):
    model = plant()
    base, grown = compile_model(model), model
    for c in of_frames(model, {}):
        if c.strengths:
            grown = c.edited(grown)
    whole = compile_model(grown)
    for seed in range(3):
        point = Point(base, seed)
        for a, b in zip(point.told(whole), point.told(), strict=True):
            assert a == pytest.approx(b, abs=1e-10)


def test_rotors_that_spin_down_as_fast_as_up_are_the_ones_that_were_there():
    model = quadrotor()
    base = compile_model(model)
    (c,) = (c for c in of_frames(model, {"rotor.tau": 0.08}) if c.physics == "asymmetric_lag")
    assert (c.place, c.strengths, c.without) == ("rotor_1", ("rotor.tau_down",), {"rotor.tau_down": 0.08})
    dae = compile_model(c.edited(model))
    assert next(p.value for p in dae.parameters if p.name == "rotor.tau_down") == 0.08
    rotors = [f"rotor_{i}.thrust" for i in (1, 2, 3, 4)]
    for seed in range(3):
        point = Point(base, seed)
        still = np.concatenate(point.told(base, {"rotor.tau": 0.08}))
        same = np.concatenate(point.told(dae, {"rotor.tau": 0.08}))
        assert same == pytest.approx(still, rel=1e-9, abs=1e-9)
        slower = np.concatenate(point.told(dae, {"rotor.tau": 0.08, "rotor.tau_down": 0.2}))
        assert np.count_nonzero(~np.isclose(slower, still, rtol=1e-9, atol=1e-12)) == len(rotors)


def test_the_inertia_of_rotors_turns_the_body_against_them_as_the_law_of_angular_momentum_says():
    model = quadrotor()
    c = by_name(model)["body", "rotor_inertia"]
    assert c.one_sided
    point, effect = body_effect(model, c, *c.strengths, seed=2)
    base = compile_model(model)
    names = [q.name for q in base.states]
    x, dx = dict(zip(names, point.x, strict=True)), dict(zip(names, point.dx, strict=True))
    k_r, spins = 1e-5, {"rotor_1": 1, "rotor_2": -1, "rotor_3": 1, "rotor_4": -1}
    speed = {name: np.sqrt(abs(x[f"{name}.thrust"]) / k_r) for name in spins}
    h = sum(s * speed[name] for name, s in spins.items())
    rate = sum(s * np.sign(x[f"{name}.thrust"]) * dx[f"{name}.thrust"] / (2 * k_r * speed[name]) for name, s in spins.items())
    torque = np.array([-x["body.q"] * h, x["body.p"] * h, -rate])
    told = effect[np.abs(effect) > 1e-9]
    assert len(told) == 3
    assert np.sort(np.abs(told)) == pytest.approx(np.sort(np.abs(torque)), rel=1e-3)


def test_rotors_turn_the_body_that_they_sit_on_though_there_is_another_one():
    model = quadrotor()
    both = replace(model, components={**model.components, "another": spatial.RigidBody()})
    (c,) = (c for c in of_frames(both, {}) if c.physics == "rotor_inertia")
    assert c.place == "body"


def test_a_mass_off_the_centre_is_all_of_the_mass_whatever_the_plant_had_by_itself():
    (c,) = (c for c in of_frames(quadrotor(), {"body.m": 0.032}) if c.physics == "coupling")
    assert c.edits[0].component.parameters["m"] == 0.032


def body_effect(model, c, path: str, seed: int, size: float = 1.0) -> tuple[Point, np.ndarray]:
    base, dae = compile_model(model), compile_model(c.edited(model))
    point = Point(base, seed)
    return point, np.concatenate(point.told(dae, {path: size})) - np.concatenate(point.told(dae))


def unit_forces(model, seed: int) -> np.ndarray:
    """What a newton along x, y, z of the body does to residual and outputs, (rows, 3)."""
    c = by_name(model)["body", "constant_force"]
    return np.column_stack([body_effect(model, c, path, seed)[1] for path in c.strengths])


@pytest.mark.slow
def test_drag_is_against_the_velocity():
    model = quadrotor()
    found = by_name(model)
    for seed in range(2):
        newton = unit_forces(model, seed)
        point, linear = body_effect(model, found["body", "linear_drag"], found["body", "linear_drag"].strengths[0], seed)
        names = [q.name for q in point.dae.states]
        nu = np.array([point.x[names.index(f"body.{w}")] for w in "uvw"])
        assert linear == pytest.approx(newton @ (-nu * [1, 1, 0]), abs=1e-9)
        _, square = body_effect(model, found["body", "quadratic_drag"], found["body", "quadratic_drag"].strengths[0], seed)
        assert square == pytest.approx(newton @ (-np.linalg.norm(nu) * nu), rel=1e-4, abs=1e-6)


@pytest.mark.slow
def test_the_moment_of_drag_goes_with_the_velocity_across():
    """Against what a newton metre about each axis does."""
    model = quadrotor()
    c, torque = by_name(model)["body", "drag_moment"], next(c for c in of_frames(model, {}) if c.strengths[0].endswith(".tau_x"))
    for seed in range(2):
        effects = [body_effect(model, c, path, seed) for path in c.strengths]
        point = effects[0][0]
        u, v = (point.x[[q.name for q in point.dae.states].index(f"body.{w}")] for w in "uv")
        about = [body_effect(model, torque, path, seed)[1] for path in torque.strengths[:2]]
        for (_, effect), factor, one in zip(effects, (-v, u), about, strict=True):
            assert effect == pytest.approx(factor * one, abs=1e-9)


@pytest.mark.slow
def test_a_constant_force_shows_in_the_accelerometer_over_the_mass():
    model = quadrotor()
    base = compile_model(model)
    newton = unit_forces(model, 0)
    rows = base.residual.shape[0]
    assert np.linalg.matrix_rank(newton[:rows]) == 3


@pytest.mark.slow
def test_a_small_offset_of_the_mass_is_linear_in_it():
    model = quadrotor()
    c = by_name(model)["body", "coupling"]
    for path in c.strengths:
        _, small = body_effect(model, c, path, 0, 1e-4)
        _, twice = body_effect(model, c, path, 0, 2e-4)
        assert np.linalg.norm(small) > 0
        assert twice == pytest.approx(2 * small, rel=1e-2, abs=1e-3 * np.abs(small).max())


def test_a_tilt_for_which_a_parameter_of_the_model_stands_is_that_parameter():
    plain = xy_table()
    for slope, strength in ((0.0, "slope"), (0.3, "world.direction")):
        model = replace(
            plain,
            parameters={**plain.parameters, "slope": replace(World().declared_parameters["tilt"], default=slope)},
            bindings={**plain.bindings, "world.tilt": "slope"},
        )
        (c,) = (c for c in of_frames(model, {"slope": slope}) if c.physics == "gravity")
        assert c.strengths == (strength,)
        assert {*c.strengths, *c.start} <= {p.name for p in compile_model(model).parameters}


def test_a_tilted_plane_pulls_along_its_direction():
    model = xy_table()
    c = by_name(model)["world", "gravity"]
    base = compile_model(model)
    point, tilt, (path,) = Point(base), 1e-3, c.strengths
    still = np.concatenate(point.told())

    def effect(direction: float) -> np.ndarray:
        return (np.concatenate(point.told(base, {path: tilt, c.quadrature: direction})) - still) / tilt

    x, y = effect(0.0), effect(np.pi / 2)
    assert np.linalg.norm(x) > 0
    assert effect(0.8) == pytest.approx(np.cos(0.8) * x + np.sin(0.8) * y, rel=1e-4, abs=1e-6 * np.abs(x).max())
    assert effect(0.8 + np.pi) == pytest.approx(-effect(0.8), rel=1e-4, abs=1e-6 * np.abs(x).max())


def test_a_rail_that_is_not_level_pulls_as_the_weight_along_it_does():
    """18 kg on a rail in a vertical plane, which leans by .02 rad."""
    model = Model(
        name="trolley",
        components={"world": World(tilt=np.pi / 2), "base": FrameFixed(), "rail": Prismatic(), "body": Body(m=18.0)},
        connections=(("base.frame", "rail.frame_a"), ("rail.frame_b", "body.frame")),
        outputs={"way": "rail.s"},
    )
    c = by_name(model)["world", "gravity"]
    (path,) = c.strengths
    assert c.neutral(path) == pytest.approx(-np.pi / 2)
    base = compile_model(model)
    force = np.concatenate(Point(base).told(base, {path: c.neutral(path) + 0.02})) - np.concatenate(Point(base).told())
    assert np.abs(force).max() == pytest.approx(18.0 * 9.81 * np.sin(0.02), rel=1e-9)
    assert "tilt" not in c.named


def arm(**moments: float) -> Model:
    """A link on a hinge in a vertical plane."""
    return Model(
        name="arm",
        components={"world": World(tilt=np.pi / 2), "base": FrameFixed(), "hinge": Revolute(), "link": MomentBody(**moments)},
        connections=(("base.frame", "hinge.frame_a"), ("hinge.frame_b", "link.frame")),
        outputs={"angle": "hinge.phi"},
    )


def test_a_mass_beside_the_line_of_a_link_pulls_as_its_weight_across_does():
    model = arm(m=1.0, m_x=0.2, J=0.05)
    dae = compile_model(model)
    (c,) = (c for c in of_frames(model, {p.name: p.value for p in dae.parameters}) if c.physics == "added_mass")
    assert (c.place, c.strengths) == ("link", ("link.m_y",))
    for seed in range(3):
        point = Point(dae, seed)
        phi = point.x[[q.name for q in dae.states].index("hinge.phi")]
        moved = point.told(dae, {"link.m_y": 0.03})[0] - point.told()[0]
        assert np.abs(moved).max() == pytest.approx(9.81 * 0.03 * abs(np.sin(phi)), rel=1e-9)
        assert np.count_nonzero(moved) == 1
    assert [c.physics for c in of_frames(arm(m_y=0.1), {"link.m_y": 0.1}) if c.place == "link"] == []  # it has one there


def crane(*, joint: type[Prismatic | Revolute] = Revolute) -> Model:
    """A body that hangs, 1.2 m below, from one that slides."""
    parts = {"world": World(), "base": FrameFixed(), "rail": Prismatic(), "trolley": Body(), "hook": joint(), "load": Body(y_c=-1.2)}
    pairs = (
        ("base.frame", "rail.frame_a"),
        ("rail.frame_b", "trolley.frame"),
        ("trolley.frame", "hook.frame_a"),
        ("hook.frame_b", "load.frame"),
    )
    return Model(name="crane", components=parts, connections=pairs, outputs={"way": "rail.s"})


@pytest.mark.parametrize("physics", ["linear_drag", "quadratic_drag"])
def test_drag_of_what_swings_acts_at_its_centre_on_all_that_moves_it(physics):
    model = crane()
    (c,) = (c for c in of_frames(model, {}) if c.key == ("load", physics))
    base = compile_model(model)
    dae = compile_model(c.edited(model))
    assert [q.name for q in dae.states] == [q.name for q in base.states]
    for seed in range(3):
        point = Point(base, seed)
        x = dict(zip((q.name for q in base.states), point.x, strict=True))
        phi, v, omega = x["hook.phi"], x["rail.v"], x["hook.omega"]
        velocity = np.array([v + 1.2 * np.cos(phi) * omega, 1.2 * np.sin(phi) * omega])
        f_x, f_y = -velocity * (np.hypot(*velocity) if physics == "quadratic_drag" else 1.0)
        turning = 1.2 * (np.sin(phi) * f_y + np.cos(phi) * f_x)
        told = point.told(dae, {c.strengths[0]: 1.0})[0] - point.told(dae)[0]
        assert np.sort(np.abs(told[np.abs(told) > 1e-9])) == pytest.approx(np.sort(np.abs([f_x, turning])), rel=1e-5)


def test_what_slides_or_turns_about_one_hinge_has_its_drag_there():
    drags = {"linear_drag", "quadratic_drag"}
    assert {c.place for c in of_frames(crane(), {}) if c.physics in drags} == {"load"}
    assert {c.place for c in of_frames(crane(joint=Prismatic), {}) if c.physics in drags} == set()
    assert {c.place for c in of_frames(xy_table(), {}) if c.physics in drags} == set()
    pieces = {"bar": FixedTranslation(r_x=0.3), "tool": Body()}
    arm_with_tool = replace(crane(), components={**crane().components, **pieces})
    held = replace(arm_with_tool, connections=(*arm_with_tool.connections, ("trolley.frame", "bar.frame_a"), ("bar.frame_b", "tool.frame")))
    assert {c.place for c in of_frames(held, {}) if c.physics in drags} == {"load"}
    flying = Model(name="puck", components={"world": World(), "puck": Body()}, connections=(), outputs={"x": "puck.x"})
    assert {c.place for c in of_frames(flying, {}) if c.physics in drags} == {"puck"}


def test_a_manipulator_may_carry_such_a_mass_on_every_link():
    model = PLANTS["five_bar"]()
    values = {p.name: p.value for p in compile_model(model).parameters}
    beside = {c.place: c.strengths for c in of_frames(model, values) if c.physics == "added_mass"}
    assert beside == {
        "link_12": ("link_12.m_y",),
        "link_3": ("link_3.y_c",),
        "link_4": ("link_4.y_c",),
        "link_56": ("link_56.m_y",),
    }


@pytest.mark.parametrize("plant", ["actuator", "drillstring"])
def test_machines_without_frames_have_none(plant):
    assert of_frames(PLANTS[plant](), {}) == []


def test_drag_in_still_air_needs_no_heading_that_nothing_shows():
    model = quadrotor()
    own = [q.name for q in without_ignorable(compile_model(model)).states]
    assert "body.psi" not in own
    for physics in ("linear_drag", "quadratic_drag", "drag_moment", "constant_force", "coupling"):
        dae = without_ignorable(compile_model(by_name(model)["body", physics].edited(model)))
        assert [q.name for q in dae.states] == own, physics


def test_rotors_with_time_constants_of_their_own_spin_down_each_in_its_own_time():
    shared = quadrotor()
    model = replace(shared, bindings={path: to for path, to in shared.bindings.items() if not path.endswith(".tau")})
    found = [c for c in of_frames(model, {}) if c.physics == "asymmetric_lag"]
    assert [c.place for c in found] == [f"rotor_{i}" for i in (1, 2, 3, 4)]
    for c in found:
        assert set(c.strengths) <= {p.name for p in compile_model(c.edited(model)).parameters}


def test_a_wind_needs_a_heading_which_counts_from_its_start_where_nothing_shows_it():
    model = quadrotor()
    (wind,) = [c for c in of_frames(model, {}) if c.key == ("body", "constant_force") and c.quadrature]
    nothing = {side: dict.fromkeys(names, np.zeros(3)) for side, names in (("inputs", model.inputs), ("outputs", model.outputs))}
    problem = Problem(model=model, recordings=[Recording(name="at rest", time=np.arange(3.0), **nothing)])
    assert "body.psi" not in {q.name for q in problem.posed.dae.states}
    headed = with_heading(problem, model)
    assert headed.initial == {"body.psi": Known(0.0, always=True)}
    own = [q.name for q in headed.posed.dae.states]
    assert "body.psi" in own
    assert [q.name for q in replace(headed, model=wind.edited(model)).posed.dae.states] == own
    seen = replace(problem, initial={"body.psi": Known(0.4, 0.1)})
    assert with_heading(seen, model).initial == seen.initial
