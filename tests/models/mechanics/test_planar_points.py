"""Points in the plane: free fall, and pendulums in Cartesian coordinates against the same motion in angles."""

from typing import Any

import examples
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from backsight.models import Component, Equation, Model, ModelError, Parameter, Variable, balance, compile_model, equal, simulate
from backsight.models.mechanics.planar import PlanarFixed, PointMass, Rod


def pendulum() -> Model:
    return examples.pendulum(PointMass(m=0.7), Rod(length=1.3))


def swing(angle: float) -> dict[str, float]:
    return {"bob.x": 1.3 * np.sin(angle), "bob.y": -1.3 * np.cos(angle)}


def in_the_angle(t: np.ndarray, angle: float) -> np.ndarray:
    truth = solve_ivp(
        lambda _, q: [q[1], -9.81 / 1.3 * np.sin(q[0])], (0.0, t[-1]), [angle, 0.0], method="DOP853", rtol=1e-13, atol=1e-14, t_eval=t
    )
    return np.asarray(truth.y)


def test_a_point_mass_falls_on_a_parabola() -> None:
    model = Model(name="fall", components={"stone": PointMass(g=10.0), "air": Free()}, connections=[("stone.point", "air.point")])
    t = np.linspace(0, 1, 11)
    run = simulate(compile_model(model), t, initial={"stone.v_x": 2.0, "stone.v_y": 3.0})
    assert run.states["stone.x"] == pytest.approx(2.0 * t, abs=1e-13)
    assert run.states["stone.y"] == pytest.approx(3.0 * t - 5.0 * t**2, abs=1e-12)


class Free(Component):
    """Nothing: takes no force."""

    point = PointMass.declared_connectors["point"]

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"no force x": equal(c.point.f_x, 0), "no force y": equal(c.point.f_y, 0)}


def test_a_cartesian_pendulum_has_index_three_and_two_invariants() -> None:
    dae = compile_model(pendulum())
    assert dae.index == 3
    assert [q.name for q in dae.states] == ["bob.x", "bob.y", "bob.v_x", "bob.v_y"]
    assert [q.name for q in dae.algebraics] == ["rod.tension"]
    assert dae.kinematics == ((0, 2, 0), (1, 3, 1))
    assert [e.origin for e in dae.equations][2:] == [
        "force balance x of bob",
        "force balance y of bob",
        "second derivative of rod length of rod",
    ]


def test_the_invariants_of_a_pendulum_are_its_length_and_the_velocity_along_it() -> None:
    import casadi as ca

    dae = compile_model(pendulum())
    invariants = ca.Function("I", [dae.x, dae.p], [dae.invariants])
    values = dae.parameter_values()
    point = np.array([0.3, -0.9, 1.1, 0.4])
    defects = invariants(point, values).full()[:, 0]
    assert sorted(np.abs(defects)) == pytest.approx(sorted(np.abs([0.3**2 + 0.9**2 - 1.3**2, 2 * (0.3 * 1.1 - 0.9 * 0.4)])))


@pytest.mark.parametrize("angle", [0.3, 2.5])
def test_a_cartesian_pendulum_swings_as_the_angle_does(angle: float) -> None:
    t = np.linspace(0.0, 10.0, 501)
    run = simulate(compile_model(pendulum()), t, initial=swing(angle))
    truth = in_the_angle(t, angle)
    assert np.abs(run.outputs["x"] - 1.3 * np.sin(truth[0])).max() < 1.3e-8
    assert np.abs(run.outputs["y"] + 1.3 * np.cos(truth[0])).max() < 1.3e-8
    assert np.abs(run.states["bob.v_x"] - 1.3 * truth[1] * np.cos(truth[0])).max() < 1e-8
    tension = 0.7 * (1.3 * truth[1] ** 2 + 9.81 * np.cos(truth[0])) / 1.3
    assert np.abs(run.algebraics["rod.tension"] - tension).max() < 1e-7


def test_a_pendulum_returns_after_the_period_of_the_elliptic_integral() -> None:
    angle = 2.0
    period = 4.0 * np.sqrt(1.3 / 9.81) * ellipk(np.sin(angle / 2) ** 2)
    run = simulate(compile_model(pendulum()), np.array([0.0, period / 2, period, 10 * period]), initial=swing(angle))
    assert run.outputs["x"] / (1.3 * np.sin(angle)) == pytest.approx([1.0, -1.0, 1.0, 1.0], abs=1e-8)


def test_a_pendulum_keeps_its_energy_and_its_length() -> None:
    run = simulate(compile_model(pendulum()), np.linspace(0, 10, 201), initial=swing(1.5))
    s = run.states
    energy = 0.7 * (0.5 * (s["bob.v_x"] ** 2 + s["bob.v_y"] ** 2) + 9.81 * s["bob.y"])
    assert energy == pytest.approx(np.full(201, energy[0]), abs=1e-9)
    assert s["bob.x"] ** 2 + s["bob.y"] ** 2 == pytest.approx(np.full(201, 1.69), rel=1e-10)


def test_initial_values_that_are_not_given_follow_from_the_constraint() -> None:
    run = simulate(compile_model(pendulum()), [0.0, 0.1], initial={"bob.x": 0.5, "bob.v_x": 1.0, "bob.y": -1.2})
    assert run.states["bob.y"][0] == -1.2
    assert run.states["bob.v_y"][0] == pytest.approx(0.5 / 1.2)


def test_initial_values_that_break_the_constraint_are_refused() -> None:
    with pytest.raises(ModelError, match=r"bob.x = 3, bob.y = 1 violates the constraints of 'pendulum' by 8.3"):
        simulate(compile_model(pendulum()), [0.0, 0.1], initial={"bob.x": 3.0, "bob.y": 1.0})


def test_a_double_pendulum_of_two_rods_keeps_its_energy() -> None:
    model = Model(
        name="double",
        components={
            "upper": PointMass(m=1.0),
            "lower": PointMass(m=0.5),
            "first": Rod(length=0.8),
            "second": Rod(length=0.6),
            "pivot": PlanarFixed(),
        },
        connections=[
            ("pivot.point", "first.point_b"),
            ("first.point_a", "upper.point"),
            ("upper.point", "second.point_b"),
            ("second.point_a", "lower.point"),
        ],
    )
    dae = compile_model(model)
    assert (dae.x.shape[0], dae.z.shape[0], dae.invariants.shape[0], dae.index) == (8, 2, 4, 3)
    run = simulate(dae, np.linspace(0, 3, 61), initial={"upper.x": 0.8, "upper.y": 0.0, "lower.x": 0.8, "lower.y": 0.6})
    s = run.states
    energy = sum(m * (0.5 * (s[f"{b}.v_x"] ** 2 + s[f"{b}.v_y"] ** 2) + 9.81 * s[f"{b}.y"]) for b, m in (("upper", 1.0), ("lower", 0.5)))
    assert energy == pytest.approx(np.full(61, energy[0]), abs=1e-8)
    assert (s["lower.x"] - s["upper.x"]) ** 2 + (s["lower.y"] - s["upper.y"]) ** 2 == pytest.approx(np.full(61, 0.36), rel=1e-9)


class Pendulum(Component):
    """A free-standing pendulum with its own equations and an algebraic rod force."""

    x = Variable("m", state=True)
    y = Variable("m", state=True)
    v_x = Variable("m/s", state=True)
    v_y = Variable("m/s", state=True)
    rod = Variable("N/m")
    m = Parameter("kg", 0.7, min=0.0)
    length = Parameter("m", 1.3, min=0.0)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {
            "velocity x": equal(c.v_x, c.der(c.x)),
            "velocity y": equal(c.v_y, c.der(c.y)),
            "force balance x": balance(c.m * c.der(c.v_x), -c.rod * c.x, place="x", unit="N"),
            "force balance y": balance(c.m * c.der(c.v_y), -c.rod * c.y, -c.m * 9.81, place="y", unit="N"),
            "rod length": equal(c.x**2 + c.y**2, c.length**2),
        }


def test_a_component_may_stand_alone_with_its_own_equations() -> None:
    dae = compile_model(Model(name="alone", components={"p": Pendulum()}, outputs={"x": "p.x"}))
    assert dae.index == 3
    assert [(place.name, place.unit) for place in dae.places] == [("p.x", "N"), ("p.y", "N")]
    t = np.linspace(0.0, 3.0, 61)
    run = simulate(dae, t, initial={"p.x": 1.3 * np.sin(1.0), "p.y": -1.3 * np.cos(1.0)})
    assert np.abs(run.outputs["x"] - 1.3 * np.sin(in_the_angle(t, 1.0)[0])).max() < 1.3e-8
