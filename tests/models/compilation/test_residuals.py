"""Every degree of freedom of a mechanism keeps a residual, and what is said of the others is true."""

import numpy as np
import pytest

from backsight.models import Dae, Model, ModelError, compile_model
from backsight.models.mechanics.planar import Body, FrameFixed, Prismatic, Revolute, World
from backsight.models.mechanics.rotational import Gear, Inertia, RotationalFixed, RotationalSpringDamper, Torque
from backsight.models.mechanics.translational import Force, SpringDamper
from backsight.models.plants import actuator, five_bar

DIRECTION = 0.4


def cart(pole: bool = False, spring: bool = False) -> Model:
    model = Model(
        name="cart",
        components={
            "world": World(tilt=1.2),
            "ground": FrameFixed(),
            "p": Prismatic(direction=DIRECTION),
            "cart": Body(m=2.0),
            "motor": Force(),
            **({"r": Revolute(), "pole": Body(m=0.5, x_c=0.3)} if pole else {}),
        },
        connections=[
            ("ground.frame", "p.frame_a"),
            ("p.frame_b", "cart.frame"),
            ("motor.flange", "p.axis"),
            *([("cart.frame", "r.frame_a"), ("r.frame_b", "pole.frame")] if pole else []),
        ],
        inputs={"F": "motor.f"},
        outputs={"s": "p.s"},
    )
    return model.insert("p", SpringDamper(k=5.0), "spring") if spring else model


def accelerations(dae: Dae, w: np.ndarray) -> np.ndarray:
    """x' with these residuals, from the rows, which are linear in x'."""
    rows = dae.function()
    x, u, p = np.zeros(len(dae.states)), np.zeros(len(dae.inputs)), dae.parameter_values()
    off = rows(0 * x, x, [], u, p, w, 0)[0].full()[:, 0]
    mass = np.column_stack([rows(e, x, [], u, p, w, 0)[0].full()[:, 0] - off for e in np.eye(len(x))])
    return np.asarray(np.linalg.solve(mass, -off))


@pytest.mark.parametrize("spring", [False, True])
def test_a_cart_on_a_slide_has_its_residual_along_the_slide(spring: bool) -> None:
    dae = compile_model(cart(spring=spring))
    assert [(p.name, p.unit, p.kind, p.enabled) for p in dae.places] == [("p", "N", "law", True)]
    assert dae.merged_places["cart.x"] == dae.merged_places["cart.y"] == "p"
    assert "p" not in [p.name for p in dae.dormant_places]
    change = accelerations(dae, np.array([3.0])) - accelerations(dae, np.array([0.0]))
    assert change == pytest.approx([0.0, 3.0 / 2.0])  # m s'' = ... + w


def test_a_place_that_was_merged_points_to_the_joint_that_stands_for_it() -> None:
    with pytest.raises(ModelError, match=r"'cart.x' has no residual of its own: it moves with 'p', whose .* \[N\] .*; ask for 'p' instead"):
        compile_model(cart(), places=("cart.x",))
    with pytest.raises(ModelError, match=r"place 'cart.phi' has no residual: what holds it takes any force there"):
        compile_model(cart(), places=("cart.phi",))


def test_a_cart_pole_has_a_residual_at_the_slide_and_one_at_the_pole() -> None:
    dae = compile_model(cart(pole=True))
    assert sorted(p.name for p in dae.places) == ["p", "pole.phi"]
    free = accelerations(dae, np.zeros(2))
    effects = np.array([accelerations(dae, w) - free for w in np.eye(2)])
    assert np.linalg.matrix_rank(effects) == 2


def test_two_stacked_slides_have_a_residual_each() -> None:
    model = Model(
        name="stack",
        components={
            "world": World(),
            "ground": FrameFixed(),
            "p": Prismatic(),
            "q": Prismatic(direction=1.5),
            "low": Body(m=2.0),
            "high": Body(m=3.0),
        },
        connections=[("ground.frame", "p.frame_a"), ("p.frame_b", "low.frame"), ("low.frame", "q.frame_a"), ("q.frame_b", "high.frame")],
    )
    dae = compile_model(model)
    assert [p.name for p in dae.places] == ["p", "q"]
    mass = np.array([[5.0, 3.0 * np.cos(1.5)], [3.0 * np.cos(1.5), 3.0]])
    change = accelerations(dae, np.array([1.0, -2.0])) - accelerations(dae, np.zeros(2))
    order = [[q.name for q in dae.states].index(name) for name in ("p.v", "q.v")]
    assert change[order] == pytest.approx(np.linalg.solve(mass, [1.0, -2.0]))


def test_the_residuals_that_a_loop_was_given_are_the_only_ones() -> None:
    dae = compile_model(five_bar())
    assert [p.name for p in dae.places] == ["joint_1", "joint_2"]
    held = {place for place, other in dae.merged_places.items() if not other}
    assert held == {"link_12.x", "link_12.y"}  # by the base


def test_a_plant_of_bodies_on_flanges_keeps_its_laws_asleep() -> None:
    dae = compile_model(actuator())
    assert ([p.name for p in dae.places], dict(dae.merged_places)) == (["carriage"], {})


def test_an_inertia_behind_two_gears_of_which_one_is_compliant_points_to_the_one_that_stands_for_it() -> None:
    model = Model(
        name="loop",
        components={
            "motor": Torque(),
            "a": Inertia(),
            "b": Inertia(),
            "one": Gear(ratio=3.0),
            "other": Gear(ratio=3.0),
            "shaft": RotationalSpringDamper(k=10.0, d=1.0),
        },
        connections=[
            ("motor.flange", "a.flange"),
            ("a.flange", "one.flange_a"),
            ("a.flange", "other.flange_a"),
            ("one.flange_b", "b.flange"),
            ("other.flange_b", "shaft.flange_a"),
            ("shaft.flange_b", "b.flange"),
        ],
        inputs={"tau": "motor.tau"},
    )
    dae = compile_model(model)
    assert dict(dae.merged_places) == {"a": "b"}
    with pytest.raises(ModelError, match=r"place 'a' has no residual of its own: it moves with 'b'"):
        compile_model(model, places=("a",))


def test_a_wheel_that_the_ground_holds_has_no_residual() -> None:
    model = Model(
        name="held",
        components={"motor": Torque(), "wheel": Inertia(), "ground": RotationalFixed()},
        connections=[("motor.flange", "wheel.flange"), ("wheel.flange", "ground.flange")],
        inputs={"tau": "motor.tau"},
    )
    assert dict(compile_model(model).merged_places) == {"wheel": ""}
    with pytest.raises(ModelError, match=r"place 'wheel' has no residual: what holds it takes any force there"):
        compile_model(model, places=("wheel",))
