"""Simulation: holds, initial values, agreement with other integrators, and what it refuses."""

from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete

from backsight.models import Component, Equation, Model, ModelError, Parameter, SolveError, Variable, compile_model, equal, simulate
from backsight.models.mechanics.translational import AccelerationSensor, Force, Mass
from backsight.models.plants import PLANTS, actuator


def free_mass() -> Model:
    return Model(
        name="free",
        components={"motor": Force(), "body": Mass(m=2.0)},
        connections=[("motor.flange", "body.flange")],
        inputs={"F": "motor.f"},
    ).insert("body", AccelerationSensor(), name="shake")


def test_a_held_force_is_exact_at_uneven_sample_times() -> None:
    t = np.array([0.0, 0.1, 0.15, 0.4, 1.0])
    force = np.array([2.0, -4.0, 6.0, 0.0, 8.0])
    run = simulate(compile_model(free_mass()), t, {"F": force})
    speed = np.concatenate([[0.0], np.cumsum(force[:-1] / 2.0 * np.diff(t))])
    assert run.states["body.v"] == pytest.approx(speed, abs=1e-14)
    assert run.states["body.s"] == pytest.approx(np.concatenate([[0.0], np.cumsum((speed[:-1] + speed[1:]) / 2 * np.diff(t))]), abs=1e-14)


def test_a_linear_hold_joins_the_samples_by_straight_lines() -> None:
    t = np.array([0.0, 0.5, 2.0])
    run = simulate(compile_model(free_mass()), t, {"F": 3.0 * t}, hold="linear")
    assert run.states["body.v"] == pytest.approx(3.0 / 4.0 * t**2, abs=1e-13)
    assert run.states["body.s"] == pytest.approx(3.0 / 12.0 * t**3, abs=1e-13)


def test_an_acceleration_is_read_with_the_input_of_its_sample_already_acting() -> None:
    model = Model(
        name="m", components=free_mass().components, connections=free_mass().connections, inputs={"F": "motor.f"}, outputs={"a": "shake.a"}
    )
    force = np.array([2.0, -4.0, 6.0])
    run = simulate(compile_model(model), [0.0, 0.1, 0.2], {"F": force})
    assert run.outputs["a"] == pytest.approx(force / 2.0)
    assert run.derivatives["body.v"] == pytest.approx(force / 2.0)


def test_a_recording_need_not_start_at_zero() -> None:
    t = np.arange(50) * 0.01
    early = simulate(compile_model(actuator()), t, {"F": 60.0})
    late = simulate(compile_model(actuator()), t + 1.7e9, {"F": 60.0})
    assert late.states["carriage.v"] == pytest.approx(early.states["carriage.v"], abs=1e-6)


def test_one_sample_gives_the_initial_values() -> None:
    run = simulate(compile_model(actuator()), [3.0], {"F": [1.0]}, initial={"carriage.s": 0.2})
    assert run.outputs["x"].tolist() == [0.2]


class VanDerPol(Component):
    """x'' = mu (1 - x^2) x' - x, whose answer no hand knows."""

    x = Variable("1", start=2.0)
    v = Variable("1/s")
    mu = Parameter("1", 50.0, min=0.0)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"rate": equal(c.der(c.x), c.v), "oscillation": equal(c.der(c.v), c.mu * (1 - c.x**2) * c.v - c.x)}


def test_a_stiff_oscillator_agrees_with_cvodes() -> None:
    dae = compile_model(Model(name="vdp", components={"o": VanDerPol()}))
    t = np.linspace(0.0, 100.0, 21)
    run = simulate(dae, t)
    x = ca.SX.sym("x", 2)
    ode = {"x": x, "ode": ca.vertcat(x[1], 50.0 * (1 - x[0] ** 2) * x[1] - x[0])}
    options = {"reltol": 1e-11, "abstol": 1e-11, "max_num_steps": 100000}
    cvodes = ca.integrator("vdp", "cvodes", ode, 0.0, t[1:], options)(x0=[2.0, 0.0])["xf"].full()
    assert run.states["o.x"][1:] == pytest.approx(cvodes[0], abs=2e-6)


class Implicit(Component):
    """x' + x'^3 = -x with an algebraic y: y + y^3 = x. No way to solve for either in closed form."""

    x = Variable("1", start=1.0)
    y = Variable("1")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"rate": equal(c.der(c.x) + c.der(c.x) ** 3, -c.x), "loop": equal(c.y + c.y**3, c.x)}


def test_equations_implicit_in_rates_and_algebraics_are_solved_as_they_are() -> None:
    dae = compile_model(Model(name="implicit", components={"a": Implicit()}, outputs={"y": "a.y"}))
    assert dae.index == 1
    assert [q.name for q in dae.algebraics] == ["a.y"]

    def root(x: float) -> float:
        return float(np.real(next(r for r in np.roots([1, 0, 1, -x]) if abs(np.imag(r)) < 1e-9)))

    t = np.linspace(0.0, 2.0, 11)
    run = simulate(dae, t)
    truth = solve_ivp(lambda _, q: [root(-q[0])], (0, 2), [1.0], method="DOP853", rtol=1e-12, atol=1e-13, t_eval=t)
    assert run.states["a.x"] == pytest.approx(truth.y[0], rel=1e-9)
    assert run.outputs["y"] == pytest.approx([root(x) for x in truth.y[0]], rel=1e-9)


@pytest.mark.parametrize("name", ["xy_table", "five_bar", "quadrotor"])
def test_a_plant_under_smooth_inputs_agrees_with_idas(name: str) -> None:
    """Laws rounded at their defaults, so that both integrate the same equations."""
    dae = compile_model(PLANTS[name]())
    t = np.linspace(0.0, 1.0, 6)
    size = {"xy_table": 3.0, "five_bar": 0.02, "quadrotor": 0.02}[name]
    mean = 0.7 if name == "quadrotor" else 0.0
    u = {q.name: mean + size * np.sin((i + 1) * t) for i, q in enumerate(dae.inputs)}
    widths = {q.name: q.value for q in dae.parameters if q.smoothing}
    ours = simulate(dae, t, u, widths, hold="linear")
    theirs = simulate(dae, t, u, widths, hold="linear", integrator="idas", rtol=1e-11)
    for mine, other in ((ours.states, theirs.states), (ours.algebraics, theirs.algebraics), (ours.outputs, theirs.outputs)):
        for key, values in mine.items():
            assert values == pytest.approx(other[key], abs=2e-6 * max(np.ptp(values), 1e-3))


def test_held_inputs_agree_with_cvodes_and_with_the_matrix_exponential() -> None:
    dae = compile_model(actuator())
    t = np.arange(200) * 1e-2
    force = 50.0 * np.random.default_rng(0).standard_normal(len(t))
    linear = {"friction.f_c": 0.0, "offset.f": 0.0}
    A, B = np.array([[0.0, 1.0], [0.0, -203.5 / 95.109]]), np.array([[0.0], [1.0 / 95.109]])
    step, push, *_ = cont2discrete((A, B, np.eye(2), np.zeros((2, 1))), 1e-2)
    exact = np.zeros((2, len(t)))
    for k in range(len(t) - 1):
        exact[:, k + 1] = step @ exact[:, k] + push[:, 0] * force[k]
    for integrator, rtol, accuracy in (("radau", 1e-10, 1e-12), ("cvodes", 1e-9, 1e-5), ("idas", 1e-9, 1e-5)):
        run = simulate(dae, t, {"F": force}, linear, integrator=integrator, rtol=rtol)  # type: ignore[arg-type]
        for name, row in zip(("carriage.s", "carriage.v"), exact, strict=True):
            assert run.states[name] == pytest.approx(row, abs=accuracy * np.ptp(row))


def test_a_stuck_axis_agrees_with_scipy_on_the_rounded_law() -> None:
    """Coulomb friction through reversals: scipy's Radau on tanh(v/width), to what the width of 1e-6 m/s leaves open."""
    t = np.linspace(0.0, 2.0, 21)
    run = simulate(compile_model(actuator()), t, {"F": 40.0 * np.sin(6.0 * t)}, {"offset.f": 0.0}, hold="linear")

    def rate(time: float, q: np.ndarray) -> list[float]:
        return [q[1], (np.interp(time, t, 40.0 * np.sin(6.0 * t)) - 203.5 * q[1] - 20.394 * np.tanh(q[1] / 1e-6)) / 95.109]

    truth = np.array([0.0, 0.0])[:, None]
    for now, then in pairwise(t.tolist()):
        part = solve_ivp(rate, (now, then), truth[:, -1], method="Radau", rtol=1e-9, atol=1e-12)
        truth = np.column_stack([truth, part.y[:, -1]])
    assert run.states["carriage.v"] == pytest.approx(truth[1], abs=2e-4 * np.ptp(truth[1]))
    assert run.states["carriage.s"] == pytest.approx(truth[0], abs=2e-4 * np.ptp(truth[0]))
    assert any(event.kind == "stick" for event in run.events)


def test_cvodes_refuses_a_model_with_algebraic_variables() -> None:
    dae = compile_model(Model(name="implicit", components={"a": Implicit()}))
    with pytest.raises(ModelError, match=r"integrator='cvodes': model 'implicit' has 1 algebraic variables; .*use 'radau' or 'idas'"):
        simulate(dae, [0.0, 1.0], integrator="cvodes")


class RunAway(Component):
    """x' = x^2 from 1: infinite at t = 1."""

    x = Variable("1", start=1.0)

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"growth": equal(c.der(c.x), c.x**2)}


def test_a_solution_that_runs_away_stops_with_its_time() -> None:
    dae = compile_model(Model(name="runaway", components={"a": RunAway()}))
    with pytest.raises(SolveError, match=r"the integration stopped at t = (0\.999\d*|1) s"):
        simulate(dae, [0.0, 0.5, 2.0])


def test_a_mass_of_zero_has_no_motion_and_is_refused() -> None:
    with pytest.raises(SolveError, match="singular for these parameter values"):
        simulate(compile_model(actuator()), [0.0, 0.1], {"F": 1.0}, {"carriage.m": 0.0})


def test_smoothing_widths_do_not_matter_unless_given() -> None:
    t = np.arange(200) * 0.005
    dae = compile_model(actuator())
    force = 60.0 * np.sin(8.0 * t)
    sharp = simulate(dae, t, {"F": force})
    sharper = simulate(dae, t, {"F": force}, {"friction.width": 1e-10})
    blunt = simulate(dae, t, {"F": force}, {"friction.width": 1e-2})
    span = np.ptp(sharp.states["carriage.v"])
    assert np.abs(sharp.states["carriage.v"] - sharper.states["carriage.v"]).max() < 1e-6 * span
    assert np.abs(sharp.states["carriage.v"] - blunt.states["carriage.v"]).max() > 1e-3 * span


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"inputs": {"G": 1.0}}, "inputs\\['G'\\]: model 'actuator' has no such input; known: F"),
        ({"inputs": {}}, "inputs: 'F' \\[N\\] of model 'actuator' is missing"),
        ({"inputs": {"F": [1.0, 2.0]}}, r"inputs\['F'\] has shape \(2,\); 3 sample times need \(3,\) values"),
        ({"inputs": {"F": [1.0, np.nan, 2.0]}}, r"inputs\['F'\]\[1\] = nan is not finite"),
        ({"parameters": {"carriage.mass": 1.0}}, r"parameters\['carriage.mass'\]: .*did you mean 'carriage.m'\?"),
        ({"parameters": {"carriage.m": -1.0}}, r"parameters\['carriage.m'\] = -1: the value must lie between 0 and inf kg"),
        ({"parameters": {"carriage.m": np.nan}}, r"parameters\['carriage.m'\] = nan: a finite number is needed"),
        ({"initial": {"carriage.x": 1.0}}, r"initial\['carriage.x'\]: .*did you mean 'carriage.[sv]'\?"),
        ({"initial": {"carriage.s": "far"}}, r"initial\['carriage.s'\] = 'far': a finite number is needed"),
        ({"t": [0.0, 0.2, 0.1]}, r"t\[2\] = 0.1 s does not follow t\[1\] = 0.2 s; sort the samples"),
        ({"t": [0.0, np.nan, 0.1]}, r"t\[1\] = nan is not finite"),
        ({"t": [[0.0, 0.1]]}, r"t has shape \(1, 2\); give the sample times as one column"),
        ({"integrator": "euler"}, "integrator = 'euler': there are 'radau', 'idas' and 'cvodes'"),
        ({"hold": "cubic"}, "hold = 'cubic': an input is held 'zero' or 'linear'"),
    ],
)
def test_a_wrong_argument_is_refused_with_its_name_value_and_remedy(change: dict[str, Any], text: str) -> None:
    arguments: dict[str, Any] = {"t": [0.0, 0.1, 0.2], "inputs": {"F": 1.0}, **change}
    with pytest.raises(ModelError, match=text):
        simulate(compile_model(actuator()), **arguments)
