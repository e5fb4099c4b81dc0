"""Alias elimination and causal sorting: minimal coordinates, and residuals that stay where they belong."""

from typing import Any

import casadi as ca
import numpy as np
import pytest

from backsight.models import (
    Component,
    Equation,
    Model,
    ModelError,
    Parameter,
    Rotational,
    Translational,
    Variable,
    compile_model,
    equal,
    simulate,
)
from backsight.models.compilation.eliminate import clean
from backsight.models.mechanics.rotational import Gear, Inertia, Rack, RotationalFixed, RotationalSpring, Torque
from backsight.models.mechanics.translational import Damper, Fixed, Force, Mass, Rigid, Spring, VelocitySensor
from backsight.models.plants import actuator
from backsight.models.signals import Gain, Lag, Offset


def geared() -> Model:
    return Model(
        name="geared",
        components={"motor": Torque(), "fast": Inertia(J=0.2), "gear": Gear(ratio=5.0), "slow": Inertia(J=3.0)},
        connections=[("motor.flange", "fast.flange"), ("fast.flange", "gear.flange_a"), ("gear.flange_b", "slow.flange")],
        inputs={"T": "motor.tau"},
        outputs={"phi": "slow.phi", "omega": "fast.omega"},
    )


def test_two_inertias_on_a_gear_are_one_coordinate_and_no_algebraics() -> None:
    dae = compile_model(geared())
    assert [q.name for q in dae.states] == ["slow.phi", "slow.omega"]
    assert (dae.algebraics, dae.index, dae.kinematics) == ((), 0, ((0, 1, 0),))
    row = ca.Function("row", [dae.dx, dae.x, dae.u, dae.p, dae.w], [dae.residual[1]])
    values = [q.value for q in dae.parameters]
    assert float(row([0, 2.0], [0, 0], [7.0], values, [0.5])) == pytest.approx((3.0 + 25 * 0.2) * 2.0 - 5 * 7.0 - 0.5)


def test_a_gear_runs_as_the_reduced_inertia_does() -> None:
    t = np.linspace(0, 2, 41)
    run = simulate(compile_model(geared()), t, {"T": 4.0})
    assert run.outputs["phi"] == pytest.approx(0.5 * 5 * 4.0 / (3.0 + 25 * 0.2) * t**2, rel=1e-8, abs=1e-14)
    assert run.outputs["omega"] == pytest.approx(5 * 5 * 4.0 / (3.0 + 25 * 0.2) * t, rel=1e-8, abs=1e-14)


def test_the_residual_of_a_body_that_moves_with_another_is_the_others() -> None:
    dae = compile_model(geared())
    assert [place.name for place in dae.places] == ["slow"]
    assert dict(dae.merged_places) == {"fast": "slow"}
    with pytest.raises(ModelError, match=r"'fast' has no residual of its own: it moves with 'slow', whose residual \[N.m\] stands"):
        compile_model(geared(), places=["fast"])


def test_a_chain_of_rack_gear_and_rigid_couplings_stays_one_coordinate() -> None:
    model = Model(
        name="chain",
        components={
            "motor": Torque(),
            "rotor": Inertia(J=0.1),
            "gear": Gear(ratio=4.0),
            "wheel": Inertia(J=0.5),
            "rack": Rack(r=0.05),
            "slide": Mass(m=20.0),
            "coupling": Rigid(),
            "load": Mass(m=30.0),
        },
        connections=[
            ("motor.flange", "rotor.flange"),
            ("rotor.flange", "gear.flange_a"),
            ("gear.flange_b", "wheel.flange"),
            ("wheel.flange", "rack.wheel"),
            ("rack.rack", "slide.flange"),
            ("slide.flange", "coupling.flange_a"),
            ("coupling.flange_b", "load.flange"),
        ],
        inputs={"T": "motor.tau"},
        outputs={"x": "load.s"},
    )
    dae = compile_model(model)
    assert (dae.x.shape[0], dae.z.shape[0], dae.index) == (2, 0, 0)
    inertia = 0.1 * 16 + 0.5 + 50.0 * 0.05**2  # at the wheel
    t = np.linspace(0, 1, 11)
    run = simulate(dae, t, {"T": 3.0})
    assert run.outputs["x"] == pytest.approx(0.05 * 0.5 * 4 * 3.0 / inertia * t**2, rel=1e-8, abs=1e-15)


class Crank(Component):
    """A slider driven by a pin on a wheel (Scotch yoke).   s = r cos(phi), power conserving."""

    wheel = Rotational()
    slide = Translational()
    r = Parameter("m", 0.1)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"geometry": equal(c.slide.s, c.r * ca.cos(c.wheel.phi)), "power": equal(c.wheel.tau, c.r * ca.sin(c.wheel.phi) * c.slide.f)}


def test_a_nonlinear_coupling_is_eliminated_by_its_geometry_and_conserves_energy() -> None:
    model = Model(
        name="yoke",
        components={"wheel": Inertia(J=0.02), "crank": Crank(r=0.3), "slider": Mass(m=2.0)},
        connections=[("wheel.flange", "crank.wheel"), ("crank.slide", "slider.flange")],
        outputs={"v": "slider.v", "omega": "wheel.omega"},
    )
    dae = compile_model(model)
    assert [q.name for q in dae.states] == ["wheel.phi", "wheel.omega"]
    assert dae.index == 0
    run = simulate(dae, np.linspace(0, 5, 201), initial={"wheel.phi": 0.3, "wheel.omega": 4.0})
    energy = 0.5 * 0.02 * run.outputs["omega"] ** 2 + 0.5 * 2.0 * run.outputs["v"] ** 2
    assert energy == pytest.approx(np.full(201, energy[0]), rel=1e-9)
    assert run.outputs["v"] == pytest.approx(-0.3 * np.sin(run.states["wheel.phi"]) * run.outputs["omega"], abs=1e-12)


def test_a_law_whose_residual_is_on_keeps_a_row_of_its_own() -> None:
    dae = compile_model(actuator(), places=["friction"])
    assert [place.name for place in dae.places] == ["carriage", "friction"]
    assert [q.name for q in dae.algebraics] == ["friction.f"]
    assert dae.index == 1
    slopes = ca.Function("slopes", [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.w], [ca.jacobian(dae.residual, dae.w)])
    values = [q.value for q in dae.parameters]
    assert slopes([0, 0], [0, 0.1], [1], [1], values, [0, 0]).full().tolist() == [[0, 0], [-1, 0], [0, -1]]


def test_a_massless_spring_and_damper_keep_the_relative_position_as_their_state() -> None:
    model = Model(
        name="voigt",
        components={"motor": Force(), "spring": Spring(k=100.0), "damper": Damper(d=20.0), "ground": Fixed(), "speed": VelocitySensor()},
        connections=[
            ("motor.flange", "spring.flange_a"),
            ("motor.flange", "damper.flange_a"),
            ("motor.flange", "speed.flange"),
            ("spring.flange_b", "ground.flange"),
            ("damper.flange_b", "ground.flange"),
        ],
        inputs={"F": "motor.f"},
        outputs={"x": "spring.s_rel", "v": "speed.v"},
    )
    dae = compile_model(model)
    assert (dae.x.shape[0], dae.z.shape[0]) == (1, 0)
    t = np.linspace(0, 1, 21)
    run = simulate(dae, t, {"F": 5.0})
    assert run.outputs["x"] == pytest.approx(0.05 * (1 - np.exp(-5 * t)), rel=1e-8, abs=1e-14)
    assert run.outputs["v"] == pytest.approx(0.25 * np.exp(-5 * t), rel=1e-8)


def test_a_body_held_by_ground_does_not_move_and_leaves_no_state() -> None:
    model = Model(
        name="held",
        components={"motor": Torque(), "wheel": Inertia(), "spring": RotationalSpring(), "ground": RotationalFixed()},
        connections=[
            ("motor.flange", "wheel.flange"),
            ("wheel.flange", "ground.flange"),
            ("spring.flange_a", "wheel.flange"),
            ("spring.flange_b", "ground.flange"),
        ],
        inputs={"T": "motor.tau"},
        outputs={"reaction": "ground.flange.tau", "omega": "wheel.omega"},
    )
    dae = compile_model(model)
    assert (dae.x.shape[0], dae.z.shape[0]) == (0, 0)
    run = simulate(dae, [0.0, 1.0], {"T": 3.0})
    assert run.outputs["reaction"] == pytest.approx([3.0, 3.0])
    assert run.outputs["omega"] == pytest.approx([0.0, 0.0])


def test_clean_drops_what_cancels() -> None:
    s, x = ca.SX.sym("s"), ca.SX.sym("x")
    assert [symbol.name() for symbol in ca.symvar(clean((s + x) - s))] == ["x"]


class Stepping(Component):
    """A body without mass on a spring, against drag and dry friction.   2 v + sgn(v) = u - x;   z = y where y + floor(y)/2 = u"""

    x = Variable("m", state=True)
    v = Variable("m/s")
    f = Variable("N")
    y = Variable("1")
    z = Variable("1")
    u = Variable("N")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "velocity": equal(c.v, c.der(c.x)),
            "drag and friction": equal(c.f, 2 * c.v + ca.sign(c.v)),
            "spring": equal(c.f, c.u - c.x),
            "stairs": equal(c.u, c.y + ca.floor(c.y) / 2),
            "copy": equal(c.z, c.y),
        }


def test_a_variable_inside_a_step_is_not_solved_for() -> None:
    dae = compile_model(Model(name="m", components={"a": Stepping()}, inputs={"u": "a.u"}, outputs={"v": "a.v"}))
    z = {"a.y": 2.0, "a.z": 2.0, "a.v": 1.0, "a.f": 3.0}  # at u = 3, x = 0: 2*1 + 1 = 3 and 2 + 1 = 3
    at = [z[q.name] for q in dae.algebraics]
    rows = ca.Function("rows", [dae.dx, dae.x, dae.z, dae.u], [dae.residual])
    assert rows(1.0, 0.0, at, 3.0).full()[:, 0] == pytest.approx(np.zeros(len(dae.equations)))
    assert np.abs(rows(1.5, 0.0, at, 3.0).full()).max() > 0.5  # 2 v = u - x, as if sgn(v) were not there
    assert np.abs(rows(1.0, 0.0, [3.0 if q.name in ("a.y", "a.z") else z[q.name] for q in dae.algebraics], 3.0).full()).max() > 0.5


def test_a_rate_inside_a_step_is_no_kinematic_row() -> None:
    class Slip(Component):
        """x' + sgn(x') = v"""

        x = Variable("m", state=True)
        v = Variable("m/s", state=True)

        def equations(self, c: Any) -> dict[str, Equation]:
            rate = c.der(c.x)
            return {"slip": equal(c.v, rate + ca.sign(rate)), "motion": equal(c.der(c.v), -c.x)}

    dae = compile_model(Model(name="m", components={"a": Slip()}))
    assert dae.kinematics == ()
    rows = ca.Function("rows", [dae.dx, dae.x], [dae.residual])
    assert rows([1.0, -0.5], [0.5, 2.0]).full()[:, 0] == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize("root", [ca.sqrt, lambda a: a**0.5])
def test_a_root_of_what_turns_out_to_be_a_square_has_a_rate_that_steps(root: Any) -> None:
    """d sqrt(x^2)/dt is sgn(x) x', once the square is put in."""

    class Distance(Component):
        """a = x^2;   y = sqrt(a);   z = y';   x' = u"""

        x = Variable("m", state=True)
        a = Variable("m2")
        y = Variable("m")
        z = Variable("m/s")
        u = Variable("m/s")

        def equations(self, c: Any) -> dict[str, Equation]:
            return {
                "square": equal(c.a, c.x**2),
                "root": equal(c.y, root(c.a)),
                "rate": equal(c.z, c.der(c.y)),
                "motion": equal(c.der(c.x), c.u),
            }

    dae = compile_model(Model(name="m", components={"d": Distance()}, inputs={"u": "d.u"}, outputs={"z": "d.z", "y": "d.y"}))
    read = ca.Function("read", [dae.x, dae.z, dae.u], [dae.output])
    assert len(dae.algebraics) == 0
    assert read(-2.0, [], 3.0).full()[:, 0] == pytest.approx([-3.0, 2.0])


def test_the_equation_of_a_lag_is_the_same_whatever_stands_before_it() -> None:
    """Row by row, not divided by its time constant: what a gain there would do is judged by the rows of the model without it."""
    alone = actuator().insert("input:F", Lag(tau=0.01), "late")
    before = alone.insert("input:F", Gain(), "amplifier").insert("input:F", Offset(), "zero")
    rows = []
    for model in (alone, before):
        dae, rng = compile_model(model), np.random.default_rng(1)
        assert [e.origin for e in dae.equations][-1] == "lag of late"
        point = dae.dx, dae.x, dae.z, dae.u, dae.w, dae.t
        at = [rng.uniform(-1.0, 1.0, s.shape[0]) for s in point]
        residual = ca.Function("residual", [*point, dae.p], [dae.residual])
        rows.append(np.asarray(residual(*at, dae.parameter_values())).ravel())
    assert rows[1] == pytest.approx(rows[0], abs=1e-12)
