"""What a compiled model promises to those who use it."""

import casadi as ca
import numpy as np
import pytest
from examples import pendulum

from backsight.models import Model, ModelError, compile_model, simulate
from backsight.models.mechanics.translational import Damper, Force, Mass, Spring
from backsight.models.plants import actuator


def models() -> list[Model]:
    two = Model(
        name="two",
        components={"motor": Force(), "a": Mass(m=2.0), "spring": Spring(k=9.0), "damper": Damper(d=0.4), "b": Mass(m=3.0)},
        connections=[
            ("motor.flange", "a.flange"),
            ("a.flange", "spring.flange_a"),
            ("a.flange", "damper.flange_a"),
            ("spring.flange_b", "b.flange"),
            ("damper.flange_b", "b.flange"),
        ],
        inputs={"F": "motor.f"},
        outputs={"x": "b.s"},
    )
    return [actuator(), two, pendulum()]


@pytest.mark.parametrize("model", models(), ids=lambda model: model.name)
def test_sizes_and_records_agree(model: Model) -> None:
    dae = compile_model(model)
    for symbols, records in (
        (dae.x, dae.states),
        (dae.dx, dae.states),
        (dae.z, dae.algebraics),
        (dae.u, dae.inputs),
        (dae.p, dae.parameters),
        (dae.w, dae.places),
        (dae.output, dae.outputs),
        (dae.residual, dae.equations),
    ):
        assert symbols.shape == (len(records), 1)
    assert dae.residual.shape[0] == dae.x.shape[0] + dae.z.shape[0]
    inside = {s.name() for s in ca.symvar(ca.vertcat(dae.residual, dae.output, *dae.variables.values()))}
    known = {s.name() for column in (dae.dx, dae.x, dae.z, dae.u, dae.p, dae.w, dae.t) for s in ca.symvar(column)}
    assert inside <= known


@pytest.mark.parametrize("model", models(), ids=lambda model: model.name)
def test_every_residual_acts_on_its_row_alone_with_weight_minus_one(model: Model) -> None:
    dae = compile_model(model)
    slopes = ca.DM(ca.jacobian(dae.residual, dae.w)).full()
    expected = np.zeros_like(slopes)
    for row, equation in enumerate(dae.equations):
        if equation.place is not None:
            expected[row, equation.place] = -1.0
            assert dae.places[equation.place].origin == equation.origin
    assert np.array_equal(slopes, expected)
    assert {e.place for e in dae.equations} - {None} == set(range(len(dae.places)))


@pytest.mark.parametrize("model", models(), ids=lambda model: model.name)
def test_kinematic_rows_are_exactly_rate_minus_velocity(model: Model) -> None:
    dae = compile_model(model)
    assert len(dae.kinematics) == dae.x.shape[0] // 2
    for i, j, row in dae.kinematics:
        difference = ca.Function("d", [dae.dx, dae.x], [dae.residual[row] - (dae.dx[i] - dae.x[j])])
        assert all(float(difference(dx, x)) == 0.0 for dx, x in ((3.0, 2.0), (-1.0, 0.5)))
        assert dae.equations[row].place is None


def test_every_declared_variable_can_be_probed() -> None:
    dae = compile_model(actuator())
    run = simulate(dae, [0.0, 0.1], {"F": 80.0}, initial={"carriage.v": 0.1})
    k = 0
    force = dae.probe("motor.f", "screw.f", "friction.f", "offset.flange_a.f", "ground.flange.f", "friction.v_rel")
    values = force(
        [run.derivatives[q.name][k] for q in dae.states],
        [run.states[q.name][k] for q in dae.states],
        [],
        [80.0],
        dae.parameter_values(),
        [0.0],
        0.0,
    ).full()[:, 0]
    friction = 203.5 * 0.1 + 20.394
    assert values == pytest.approx([80.0, 80.0, friction, -3.165, friction - 3.165, 0.1])


def test_an_unknown_place_is_refused_with_the_nearest() -> None:
    with pytest.raises(ModelError, match=r"model 'actuator' has no place 'scrw' for a residual; did you mean 'screw'\?"):
        compile_model(actuator(), places=["scrw"])


def test_a_balance_may_be_asked_for_though_it_is_on_already() -> None:
    assert [p.name for p in compile_model(actuator(), places=["carriage"]).places] == ["carriage"]


def test_compiling_twice_gives_the_same_order_of_everything() -> None:
    one, other = compile_model(actuator(), places=["screw", "friction"]), compile_model(actuator(), places=["friction", "screw"])
    assert str(one.residual) == str(other.residual)
    assert one.places == other.places


def test_a_model_can_be_too_loose_numerically_though_it_counts_right() -> None:
    from backsight.models import Component, Variable, equal

    class Dependent(Component):
        """x + y = 1 and 2x + 2y = 2: two equations that are one."""

        x, y = Variable("1"), Variable("1")

        def equations(self, c):  # type: ignore[no-untyped-def]
            return {"one": equal(c.x * c.x + c.y * c.y, 1), "two": equal(2 * c.x * c.x + 2 * c.y * c.y, 2)}

    with pytest.raises(ModelError, match="model 'm' is singular: the equations 'one of d', 'two of d' depend on each other"):
        compile_model(Model(name="m", components={"d": Dependent()}))
