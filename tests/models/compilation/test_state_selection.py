"""Named coordinates of closed loops: what they make of the equations, and what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest

from backsight.models import Model, ModelError, compile_model, simulate
from backsight.models.mechanics.planar import Body, FixedTranslation, FrameFixed, PlanarFixed, PointMass, Revolute, Rod, World
from backsight.models.mechanics.translational import Fixed, Mass, Rigid, Spring

LENGTH = 1.3


def pendulum(*states: str) -> Model:
    return Model(
        name="pendulum",
        components={"bob": PointMass(m=0.7), "rod": Rod(length=LENGTH), "pivot": PlanarFixed()},
        connections=[("bob.point", "rod.point_a"), ("rod.point_b", "pivot.point")],
        states=states,
        start={"bob.y": -LENGTH},
    )


def four_bar(*states: str) -> Model:
    """A four-bar linkage."""
    return Model(
        name="four_bar",
        components={
            "world": World(tilt=math.pi / 2),
            "left": FrameFixed(),
            "right": FrameFixed(x_0=0.5),
            "first": Revolute(),
            "second": Revolute(),
            "third": Revolute(),
            "fourth": Revolute(),
            "crank": Body(x_c=0.1),
            "coupler": Body(x_c=0.2),
            "rocker": Body(x_c=0.1),
            "crank_tip": FixedTranslation(r_x=0.2),
            "coupler_tip": FixedTranslation(r_x=0.4),
            "rocker_tip": FixedTranslation(r_x=0.25),
        },
        connections=[
            ("left.frame", "first.frame_a"),
            ("first.frame_b", "crank.frame"),
            ("crank.frame", "crank_tip.frame_a"),
            ("crank_tip.frame_b", "second.frame_a"),
            ("second.frame_b", "coupler.frame"),
            ("coupler.frame", "coupler_tip.frame_a"),
            ("right.frame", "third.frame_a"),
            ("third.frame_b", "rocker.frame"),
            ("rocker.frame", "rocker_tip.frame_a"),
            ("coupler_tip.frame_b", "fourth.frame_a"),
            ("rocker_tip.frame_b", "fourth.frame_b"),
        ],
        states=states,
    )


def test_a_pendulum_in_one_cartesian_coordinate_has_two_states_and_its_height_to_solve_for() -> None:
    dae = compile_model(pendulum("bob.x"))
    assert [q.name for q in dae.states] == ["bob.x", "bob.v_x"]
    assert "bob.y" in [q.name for q in dae.algebraics]
    assert (dae.invariants.shape[0], dae.index) == (0, 3)


def test_a_pendulum_in_one_cartesian_coordinate_accelerates_as_the_one_in_the_angle() -> None:
    angle, rate = 0.4, 1.5
    x, v = LENGTH * np.sin(angle), LENGTH * np.cos(angle) * rate
    run = simulate(compile_model(pendulum("bob.x")), [0.0], initial={"bob.x": x, "bob.v_x": v})
    turn = -9.81 / LENGTH * np.sin(angle)
    assert run.algebraics["bob.y"][0] == pytest.approx(-LENGTH * np.cos(angle))
    assert run.derivatives["bob.v_x"][0] == pytest.approx(LENGTH * (np.cos(angle) * turn - np.sin(angle) * rate**2), rel=1e-10)


def test_a_rate_may_be_named_beside_its_coordinate() -> None:
    dae = compile_model(four_bar("third.phi", "third.omega"))
    assert [q.name for q in dae.states] == ["third.phi", "third.omega"]


def test_a_name_that_does_not_exist_is_refused_with_the_nearest() -> None:
    with pytest.raises(ModelError, match=r"state 'first.psi': Revolute 'first' has no variable 'psi'; did you mean 'first.phi'\?"):
        four_bar("first.psi")


def test_a_variable_that_others_express_is_no_coordinate() -> None:
    with pytest.raises(ModelError, match=r"states names 'coupler.v_x', which is no independent coordinate: .* first.phi, first.omega"):
        compile_model(four_bar("coupler.v_x"))


def test_too_many_coordinates_are_counted() -> None:
    message = r"states = \(first.phi, second.phi\) names 2 of the coordinates in closed loops .*, of which 1 is independent; leave out 1"
    with pytest.raises(ModelError, match=message):
        compile_model(four_bar("first.phi", "second.phi"))


def test_too_few_coordinates_are_counted_and_the_others_listed() -> None:
    far = four_bar("first.phi")
    twice = {f"other_{name}": component for name, component in far.components.items() if name != "world"}
    joined = [(f"other_{a}", f"other_{b}") for a, b in far.connections]
    model = Model(name="two", components={**far.components, **twice}, connections=[*far.connections, *joined], states=("first.phi",))
    message = r"names 1 of the coordinates in closed loops .*, of which 2 are independent; name 1 more of .*other_first.phi"
    with pytest.raises(ModelError, match=message):
        compile_model(model)


def test_coordinates_that_leave_another_undetermined_are_not_independent() -> None:
    far = four_bar("first.phi", "second.phi")
    twice = {f"other_{name}": component for name, component in far.components.items() if name != "world"}
    joined = [(f"other_{a}", f"other_{b}") for a, b in far.connections]
    model = Model(name="two", components={**far.components, **twice}, connections=[*far.connections, *joined], states=far.states)
    with pytest.raises(ModelError, match=r"states = \(first.phi, second.phi\) are not independent: .* do not determine .*other_"):
        compile_model(model)


@pytest.mark.parametrize("chosen", ["front", "back"])
def test_a_named_state_survives_where_a_rigid_coupling_leaves_the_choice(chosen: str) -> None:
    model = Model(
        name="train",
        components={"front": Mass(), "hook": Rigid(), "back": Mass(), "spring": Spring(), "end": Fixed()},
        connections=[
            ("front.flange", "hook.flange_a"),
            ("hook.flange_b", "back.flange"),
            ("back.flange", "spring.flange_a"),
            ("spring.flange_b", "end.flange"),
        ],
        states=(f"{chosen}.s",),
    )
    assert [q.name for q in compile_model(model).states] == [f"{chosen}.s", f"{chosen}.v"]


def test_a_reading_of_a_dependent_coordinate_is_an_output_like_any_other() -> None:
    model = replace(four_bar("first.phi"), outputs={"rocker": "third.phi", "rate": "third.omega"})
    run = simulate(compile_model(model), [0.0, 1e-5], initial={"first.phi": 1.0, "first.omega": 2.0, "third.phi": 1.2, "second.phi": -1.0})
    assert (run.outputs["rocker"][1] - run.outputs["rocker"][0]) / 1e-5 == pytest.approx(run.outputs["rate"].mean(), rel=1e-6)
