"""Friction near rest, on an axis that stands still for a good part of its record; the truth sticks by events, not by a smooth law."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from backsight.data.generators.sliding import Body, Motion, respond
from backsight.estimation import Free, Problem, Recording, Weights, smooth
from backsight.estimation.smoothing.begun import followed_by
from backsight.estimation.smoothing.law_velocity import velocity_of
from backsight.estimation.smoothing.program import Settings
from backsight.estimation.smoothing.rest import (
    NEAR,
    ROUNDING,
    friction_laws,
    open_at_rest,
    rounding,
    std_of_one,
    strengths_at_rest,
    wants_room,
)
from backsight.models import Model, Parameter, Variable, compile_model, equal, law
from backsight.models.mechanics.rotational import AngleSensor, Inertia, RotationalElement, RotationalFixed, Torque
from backsight.models.mechanics.spatial import QuadraticDrag
from backsight.models.plants import actuator, quadrotor
from backsight.models.signals import DeadZone
from backsight.ocp.follow import Followed, follow
from backsight.ocp.horizon import Horizon
from backsight.ocp.mesh import mesh_over

DAE = compile_model(actuator())
BODY, OFFSET, STEP = Body(m=95.0, d=203.0, f_c=20.0), -3.0, 0.002
FREE = {"carriage.m": Free(60.0), "friction.d": Free(100.0), "friction.f_c": Free(10.0), "offset.f": Free(0.0)}


def dwelling(seed: int) -> tuple[Recording, np.ndarray]:
    """Strokes with rests of half a second between them, in which the motor pulls less than friction holds."""
    t = np.arange(0.0, 6.0, STEP)
    stroke = 90.0 * np.sin(2 * np.pi * 1.3 * t) + 60.0 * np.sin(2 * np.pi * 3.1 * t)
    force = np.where((t % 2.0) < 1.5, stroke, 5.0 * np.sin(2 * np.pi * 2.0 * t)) + OFFSET
    x, v = (a[:-1] for a in respond(BODY, force - OFFSET, STEP, Motion()))
    noise = 2e-6 * np.random.default_rng(seed).standard_normal(len(t))
    return Recording(name="axis", time=t, inputs={"F": force}, outputs={"x": x + noise}, output_std={"x": 2e-6}), v


def test_parameters_stay_right_though_the_axis_stands_still_for_a_part_of_the_record():
    recording, v = dwelling(0)
    assert np.mean(v == 0.0) > 0.1
    result = smooth(Problem(model=DAE, recordings=[recording], parameters=FREE))
    assert result.solver.converged
    for name, true in (("carriage.m", BODY.m), ("friction.d", BODY.d), ("friction.f_c", BODY.f_c), ("offset.f", OFFSET)):
        estimate = result.parameters[name]
        assert estimate.value == pytest.approx(true, rel=0.005), name
        assert abs(estimate.value - true) < 4 * estimate.std, name
    # nothing but friction is left out, and that only at rest, where it holds what the motor does
    left, w = result.residual_places["carriage"], result.estimates["axis"]["residual.carriage"]
    assert left.rms < 1e-3
    assert 1.0 < left.rest_rms < BODY.f_c
    assert np.mean(v == 0.0) < left.rest_share < 1.5 * np.mean(v == 0.0)
    assert left.rest_share * left.rest_rms**2 + (1 - left.rest_share) * left.rms**2 == pytest.approx(np.mean(w**2))


def followed(recording: Recording) -> Followed:
    n = len(recording.time)
    horizon = Horizon(
        mesh=mesh_over(recording.time, 0.01),
        time=recording.time,
        inputs=recording.inputs["F"][:, None],
        target=recording.outputs["x"][:, None],
        target_std=np.full((n, 1), 2e-6),
        initial=np.zeros(2),
        initial_std=np.full(2, np.inf),
    )
    problem = Problem(model=DAE, recordings=[recording], parameters=FREE)
    return follow(DAE, [horizon], problem.values)


def test_room_is_given_where_the_axis_is_slow_and_nowhere_else():
    recording, v = dwelling(1)
    problem = Problem(model=DAE, recordings=[recording], parameters=FREE)
    std = open_at_rest(problem, friction_laws(problem), followed(recording), [recording.time], (0,), problem.values)
    assert std.shape == (1, len(v) - 1)
    opened = std[std > 0]
    # the guess of 10 N, over intervals of one sample
    np.testing.assert_allclose(opened, 10.0 * np.sqrt(STEP), rtol=1e-3)
    still, fast = (v[1:] == 0.0) & (v[:-1] == 0.0), (np.abs(v[1:]) > 0.05) & (np.abs(v[:-1]) > 0.05)
    assert np.mean(std[0, still] > 0) > 0.9
    assert np.all(std[0, fast] == 0.0)


def test_room_reaches_as_far_as_the_velocity_cannot_be_told_from_zero():
    """v = +-(t - 1/2)^2, known to 0.04/3: less than three deviations from 0.3 s to 0.7 s. Elsewhere a doubt that no rest is next to."""
    time = np.linspace(0.0, 1.0, 101)
    recording = Recording(name="axis", time=time, inputs={"F": np.zeros(101)}, outputs={"x": np.zeros(101)}, output_std={"x": 2e-6})
    problem = Problem(model=DAE, recordings=[recording], parameters=FREE)
    begun = followed(recording)
    t, knots = begun.transcription, begun.transcription.horizons[0].mesh.knots
    names, local, nx = [q.name for q in DAE.states], t.nlp.interpolation.local, t.nlp.interpolation.states
    decisions, covariance = np.zeros(t.nlp.size), np.zeros((len(knots) - 1, local, local))
    since = knots - 0.5
    for name, course in (("carriage.s", np.abs(since) ** 3 / 3), ("carriage.v", np.sign(since) * since**2)):
        i = names.index(name)
        decisions[t.nlp.index[i]], decisions[t.nlp.index[i - nx]] = course[:-1], course[1:]
    middle, v = (knots[1:] + knots[:-1]) / 2, names.index("carriage.v")
    covariance[:, v, v] = covariance[:, v - nx, v - nx] = np.where(np.abs(middle - 0.95) < 0.02, 10.0, 0.04 / 3) ** 2
    values = problem.values
    (law,) = friction_laws(problem)
    values[law.width] = 1e-5
    std = open_at_rest(problem, (law,), replace(begun, decisions=decisions, covariance=covariance), [knots], (0,), values)
    opened = middle[std[0] > 0]
    assert opened.min() == pytest.approx(0.3, abs=0.011)
    assert opened.max() == pytest.approx(0.7, abs=0.011)
    assert len(opened) == pytest.approx(0.4 * len(middle), abs=2)


@pytest.mark.parametrize(
    ("first", "count", "std", "opened"),
    [(40, 1, 0.05, True), (40, 3, 0.05, True), (1, 2, 0.05, True), (40, 4, 0.05, False), (40, 2, 0.02, False), (40, 2, 0.0, False)],
)
def test_a_few_intervals_between_two_at_rest_have_room_if_noise_may_have_made_the_velocity(first, count, std, opened):
    """At rest but for a velocity of 0.3 m/s over some intervals, which comes and goes within one; its deviation is std [m/s]."""
    time = np.linspace(0.0, 1.0, 101)
    recording = Recording(name="axis", time=time, inputs={"F": np.zeros(101)}, outputs={"x": np.zeros(101)}, output_std={"x": 2e-6})
    problem = Problem(model=DAE, recordings=[recording], parameters=FREE)
    begun = followed(recording)
    t, knots = begun.transcription, begun.transcription.horizons[0].mesh.knots
    nx, local, v = t.nlp.interpolation.states, t.nlp.interpolation.local, np.zeros(len(knots))
    v[first : first + 1 + count] = 0.3
    names, decisions, covariance = [q.name for q in DAE.states], np.zeros(t.nlp.size), np.zeros((len(v) - 1, local, local))
    for name, course in (("carriage.s", cumulative_trapezoid(v, knots, initial=0.0)), ("carriage.v", v)):
        i = names.index(name)
        decisions[t.nlp.index[i]], decisions[t.nlp.index[i - nx]] = course[:-1], course[1:]
    covariance[:, i, i] = covariance[:, i - nx, i - nx] = std**2
    there = replace(begun, decisions=decisions, covariance=covariance)
    room = open_at_rest(problem, friction_laws(problem), there, [knots], (0,), problem.values)[0] > 0
    assert np.all(room[: first - 1])
    assert np.all(room[first + 1 + count :])
    assert np.all(room[first : first + count] == opened)


def test_a_friction_that_is_fixed_at_zero_is_no_law():
    recording, _ = dwelling(2)
    assert len(friction_laws(Problem(model=DAE, recordings=[recording], parameters=FREE))) == 1
    assert friction_laws(Problem(model=DAE, recordings=[recording], parameters={**FREE, "friction.f_c": 0.0})) == ()


class Bearing(RotationalElement):
    """A friction of a user's own, its velocity under a name of its own."""

    speed = Variable("rad/s")
    power = Variable("W")
    d = Parameter("N.m.s/rad", 0.1, min=0.0, description="viscous")
    tau_c = Parameter("N.m", 1.0, min=0.0, description="dry")
    width = Parameter("rad/s", 1e-2, min=1e-12, description="rounding of the sign", smoothing=True)

    def equations(self, c: Any) -> dict[str, Any]:
        dry = c.tau_c * c.speed / ca.sqrt(c.speed**2 + c.width**2)
        return {
            **super().equations(c),
            "power": equal(c.power, c.tau * c.speed),
            "speed": equal(c.speed, c.der(c.phi_rel)),
            "friction law": law(c.tau, c.d * c.speed + dry),
        }


def test_the_velocity_of_a_law_of_ones_own_is_found_by_its_equations():
    model = Model(
        name="rotor",
        components={
            "motor": Torque(),
            "rotor": Inertia(J=1.0),
            "bearing": Bearing(),
            "ground": RotationalFixed(),
            "encoder": AngleSensor(),
        },
        connections=[
            ("motor.flange", "rotor.flange"),
            ("encoder.flange", "rotor.flange"),
            ("rotor.flange", "bearing.flange_a"),
            ("bearing.flange_b", "ground.flange"),
        ],
        inputs={"tau": "motor.tau"},
        outputs={"phi": "encoder.phi"},
    )
    recording = Recording(
        name="r", time=np.arange(3.0), inputs={"tau": np.zeros(3)}, outputs={"phi": np.arange(3.0)}, output_std={"phi": 1.0}
    )
    (law,) = friction_laws(Problem(model=model, recordings=[recording], parameters={"bearing.tau_c": Free(1.0)}))
    assert law.velocity == "bearing.speed"


def test_a_sign_is_as_sharp_as_a_body_rests_and_as_round_as_it_was_where_it_only_turns():
    t = np.linspace(0.0, 20.0, 20_001)
    turning = 0.2 * np.sin(2 * np.pi * t)
    round_one = ROUNDING * float(np.sqrt(np.mean(turning**2)))
    assert rounding(turning) == pytest.approx(round_one)
    still = np.where(t < 8.0, turning, 0.0)
    still_rms = float(np.sqrt(np.mean(still**2)))
    assert rounding(still) == pytest.approx(0.1 * ROUNDING * still_rms)  # the least
    seen = np.where(t < 8.0, turning, 0.4 * ROUNDING * still_rms)
    assert rounding(seen) == pytest.approx(0.4 * ROUNDING * float(np.sqrt(np.mean(seen**2))), rel=0.02)
    assert rounding(still, resting=False) == pytest.approx(ROUNDING * still_rms)
    assert rounding(np.full(9, NEAR)) == pytest.approx(NEAR * ROUNDING)  # it never slows down


def test_what_holds_an_axis_that_rests_most_of_the_time_is_friction_and_no_dead_zone():
    """As much is pulled at rest as a dead zone would take: only that it holds on while the pull changes tells the two apart."""
    t = np.arange(0.0, 6.0, STEP)
    stroke = 90.0 * np.sin(2 * np.pi * 1.3 * t) + 60.0 * np.sin(2 * np.pi * 3.1 * t)
    force = np.where((t % 2.0) < 0.5, stroke, 12.0 * np.sin(2 * np.pi * 0.7 * t))
    x, v = (a[:-1] for a in respond(BODY, force, STEP, Motion()))
    assert np.mean(v == 0.0) > 0.5
    noise = 2e-6 * np.random.default_rng(0).standard_normal(len(t))
    recording = Recording(name="axis", time=t, inputs={"F": force}, outputs={"x": x + noise}, output_std={"x": 2e-6})
    free = {"carriage.m": Free(90.0), "friction.d": Free(190.0)}
    held = smooth(Problem(model=actuator(), recordings=[recording], parameters={**free, "friction.f_c": Free(15.0), "offset.f": 0.0}))
    zone = actuator().insert("input:F", DeadZone(width=1.0), "zone")
    given = {**free, "friction.f_c": 0.0, "offset.f": 0.0, "zone.width": Free(15.0, min=1e-3)}
    missed = smooth(Problem(model=zone, recordings=[recording], parameters=given))
    assert held.solver.converged
    assert held.parameters["friction.f_c"].value == pytest.approx(BODY.f_c, rel=0.02)
    assert held.criteria.log_evidence > missed.criteria.log_evidence + 100.0


def test_room_is_as_much_as_is_known_of_a_place_whatever_the_law_there():
    recording, _ = dwelling(1)
    problem = Problem(model=DAE, recordings=[recording], parameters=FREE)
    laws, begun, knots = friction_laws(problem), followed(recording), [recording.time]
    own, known = (open_at_rest(problem, laws, begun, knots, (0,), problem.values, strengths) for strengths in ({}, {0: 25.0}))
    np.testing.assert_allclose(known[known > 0], 25.0 * np.sqrt(STEP), rtol=1e-3)
    assert np.array_equal(known > 0, own > 0)
    np.testing.assert_array_equal(open_at_rest(problem, laws, begun, knots, (0,), problem.values, {1: 25.0}), own)
    nothing = problem.values
    nothing[[p.name for p in DAE.parameters].index("friction.f_c")] = 0.0
    assert open_at_rest(problem, laws, begun, knots, (0,), nothing, {0: 25.0}).max() == pytest.approx(25.0 * np.sqrt(STEP), rel=1e-3)


def test_what_begins_at_a_solution_has_its_room_near_rest():
    """With less friction than the solution found, the place has as much room as there: evidence does not hang on a law's strength."""
    recording, _ = dwelling(1)
    first = smooth(Problem(model=DAE, recordings=[recording], parameters=FREE)).solution
    (strength,) = strengths_at_rest(first).values()
    assert strength == pytest.approx(20.0, rel=0.3)
    less = Problem(model=DAE, recordings=[recording], parameters={**FREE, "friction.f_c": Free(8.0)})
    again = smooth(less, begin=first, settings=Settings(check_mesh=False)).solution
    assert strengths_at_rest(again)["carriage"] == pytest.approx(strength, rel=1e-6)


def test_room_is_missing_where_a_solution_strains_at_rest_without_it_and_nowhere_else():
    recording, _ = dwelling(1)
    problem = Problem(model=DAE, recordings=[recording], parameters=FREE)
    solution = smooth(problem).solution
    laws, t = friction_laws(problem), solution.transcription
    assert not wants_room(problem, laws, solution, followed_by(solution))
    std = t.force_std_at(solution.values)
    without = std.min(axis=1, keepdims=True) / std
    bare = replace(solution, values=t.with_force_std(solution.values, without))
    assert t.force_std_at(bare.values) == pytest.approx(np.broadcast_to(std.min(axis=1, keepdims=True), std.shape))
    assert wants_room(problem, laws, bare, followed_by(solution))
    assert not wants_room(problem, (), bare, followed_by(solution))


COLOURS = pytest.mark.parametrize("kind", ["ou", "matern"])


@COLOURS
def test_a_coloured_force_is_let_go_as_far_as_the_law_is_strong(kind):
    """What the white noise that shapes it makes of it within an interval, by fine explicit steps from nothing."""
    weights, tau, rng = Weights(W={"carriage": 1.0}, tau={"carriage": 0.05}, kind={"carriage": kind}), 0.05, np.random.default_rng(3)
    dae = Problem(model=DAE, recordings=[dwelling(1)[0]], parameters=FREE, weights=weights).posed.dae
    (std,) = std_of_one(dae, 0, np.array([STEP]))
    fine, lam = 200, np.sqrt(3.0) / tau
    w = std * rng.standard_normal((fine, 4000)) * np.sqrt(fine / STEP)
    f = g = np.zeros(4000)
    for noise in w:
        if kind == "ou":
            f = f + STEP / fine * (noise / np.sqrt(tau / 2) - f / tau)
        else:
            f, g = f + STEP / fine * g, g + STEP / fine * (2 * lam**1.5 * noise - 2 * lam * g - lam**2 * f)
    assert 0.5 < np.std(f) < 1.05
    np.testing.assert_allclose(std_of_one(DAE, 0, np.array([STEP])), np.sqrt(STEP))  # a white one is that noise, whose mean counts


@COLOURS
def test_parameters_stay_right_beside_a_coloured_force_though_the_axis_stands_still(kind):
    recording, _ = dwelling(0)
    weights = Weights(W={"carriage": 0.3}, tau={"carriage": 0.05}, kind={"carriage": kind})
    result = smooth(Problem(model=DAE, recordings=[recording], parameters=FREE, weights=weights))
    (strength,) = strengths_at_rest(result.solution).values()
    assert strength == pytest.approx(BODY.f_c, rel=0.3)
    for name, true in (("carriage.m", BODY.m), ("friction.d", BODY.d), ("friction.f_c", BODY.f_c), ("offset.f", OFFSET)):
        assert abs(result.parameters[name].value - true) < 3 * result.parameters[name].std, name
    assert 0.1 < result.residual_places["carriage"].rest_share < 0.4


def test_a_component_without_variables_of_its_own_has_no_velocity():
    """The drag of a body in space, say, whose velocity is that of the body's frame."""
    (law,) = friction_laws(Problem(model=DAE, recordings=[dwelling(1)[0]], parameters=FREE))
    assert velocity_of(DAE, "nobody", law.width, ca.jacobian(DAE.residual, DAE.p[law.width])) is None


def test_a_body_in_space_with_drag_can_be_smoothed_for_its_friction():
    edited = quadrotor().insert("body", QuadraticDrag(), name="drag")
    dae = compile_model(edited)
    still = {q.name: np.zeros(3) for q in dae.outputs}
    inputs = {q.name: np.zeros(3) for q in dae.inputs}
    recording = Recording(name="flight", time=np.arange(3.0), inputs=inputs, outputs=still, output_std=dict.fromkeys(still, 1.0))
    (name,) = (p.name for p in dae.parameters if p.name.startswith("drag.") and p.name.endswith("c"))
    assert friction_laws(Problem(model=dae, recordings=[recording], parameters={name: Free(0.1)})) == ()
