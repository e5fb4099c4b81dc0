"""What no output shows: the rotors of a quadrotor, a first-order drive before a mass that is measured, a bit that sticks and slips."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from scipy.linalg import expm

from backsight.data.generators import drillstring, quadrotor
from backsight.data.generators.run import Run
from backsight.estimation import Free, Problem, Recording, smooth
from backsight.estimation.smoothing.along import rms
from backsight.estimation.smoothing.driven import Driven, lags_of, own_rows, simulated, stopping
from backsight.estimation.smoothing.driven_fit import Seen, fitted
from backsight.estimation.smoothing.horizons import output_stds
from backsight.estimation.smoothing.meshing import follow_closely
from backsight.estimation.smoothing.program import Settings
from backsight.estimation.smoothing.rest import friction_laws
from backsight.estimation.smoothing.unseen import sought, unseen_states
from backsight.models import Dae, Model, compile_model
from backsight.models.mechanics.rotational import AngleSensor, Inertia, RotationalDamper, RotationalFixed, RotationalFriction, Torque
from backsight.models.plants import PLANTS
from backsight.models.signals import Lag

ROTORS = [f"rotor_{i}.thrust" for i in (1, 2, 3, 4)]
FREE = ("body.Ixx", "body.Iyy", "body.Izz", "rotor.tau", "rotor.gain")


@cache
def flown() -> Run:
    return quadrotor.record(seed=21, conditions=replace(quadrotor.CONDITIONS, duration=12.0))


def flight(factors: dict[str, float]) -> Problem:
    """A flight with some of the quadrotor's parameters at guesses these factors off, held near them as a descent does."""
    dae = compile_model(PLANTS["quadrotor"]())
    true = {p.name: p.value for p in dae.parameters}
    recording = Recording(name="flight", time=flown().time, inputs=flown().inputs, outputs=flown().outputs, output_std=flown().noise)
    free = {name: Free(true[name] * f, min=0.0, std=2 * true[name] * f) for name, f in factors.items()}
    return Problem(model=dae, recordings=[recording], parameters=free).plain


def rows_of(problem: Problem) -> dict[int, int]:
    return lags_of(problem.dae, set(unseen_states(problem)))


def named(dae: Dae, rows: dict[int, int]) -> list[str]:
    return [dae.states[i].name for i in rows]


def test_rotors_are_lags_and_loads_behind_shafts_are_not():
    problem = flight({})
    assert named(problem.dae, rows_of(problem)) == ROTORS
    unseen = {"string.dphi", "bha.omega"}
    assert lags_of(compile_model(PLANTS["drillstring"]()), unseen) == {}  # the bit has a balance of first order, but the twist moves it
    lagging = compile_model(PLANTS["drillstring"]().insert("input:V", Lag(tau=0.02)))
    assert named(lagging, lags_of(lagging, {*unseen, "lag.y"})) == ["lag.y"]


def test_thrusts_run_as_the_speeds_of_the_rotors_say():
    """Between samples the root of a thrust goes exponentially to gain u; the simulator has it in closed form."""
    problem = flight({})
    followed = follow_closely(problem, output_stds(problem)[0], None)
    run = Driven(problem.dae, rows_of(problem)).run(followed, 0, problem.values)
    true = np.array([np.interp(run.times, flown().time, flown().truth[name]) for name in ROTORS])
    later = run.times > 0.5
    assert np.sqrt(np.mean((run.state - true)[:, later] ** 2)) < 0.02 * np.std(true[:, later])
    moved = simulated(Driven(problem.dae, rows_of(problem)), followed, problem.values)
    _, x, _ = moved.at(0, run.times)
    states = [q.name for q in problem.dae.states]
    assert np.sqrt(np.mean((x[[states.index(name) for name in ROTORS]] - true) ** 2)) < 0.1 * np.std(true)


def test_slopes_are_those_of_differences():
    problem = flight(dict.fromkeys(("rotor.tau", "rotor.gain"), 1.5))
    followed = follow_closely(problem, output_stds(problem)[0], None)
    lags = Driven(problem.dae, rows_of(problem), problem.free)
    run = lags.run(followed, 0, problem.values)
    for k, i in enumerate(problem.free):
        step = np.zeros(len(problem.values))
        step[i] = 1e-5 * problem.values[i]
        more, less = (lags.run(followed, 0, problem.values + s) for s in (step, -step))
        assert run.state_slope[:, :, k] == pytest.approx((more.state - less.state) / (2 * step[i]), rel=1e-4, abs=1e-5)
        assert run.rate_slope[:, :, k] == pytest.approx((more.rate - less.rate) / (2 * step[i]), rel=1e-4, abs=1e-3)


def test_lags_without_an_answer_leave_trajectories_as_they_are():
    problem = flight({})
    followed = follow_closely(problem, output_stds(problem)[0], None)
    parameters = problem.values.copy()
    parameters[[p.name for p in problem.dae.parameters].index("rotor.gain")] = np.nan
    assert simulated(Driven(problem.dae, rows_of(problem)), followed, parameters) is followed
    found, left = fitted(problem, rows_of(problem), followed, parameters)
    assert np.array_equal(found, parameters, equal_nan=True)
    assert left == 1.0


@pytest.mark.parametrize("factors", list(product((1 / 3, 3.0), repeat=3)))
def test_what_moves_the_quadrotor_is_found_along_the_samples(factors):
    """Inertias, time constant and gain three times too large or too small, in any combination."""
    inertia, tau, gain = factors
    problem = flight(dict(zip(FREE, (inertia, inertia, 1 / inertia, tau, gain), strict=True)))
    followed = follow_closely(problem, output_stds(problem)[0], None)
    found, left = fitted(problem, rows_of(problem), followed, problem.values)
    ratio = {p.name: float(found[i]) / p.value for i, p in enumerate(problem.dae.parameters) if p.name in FREE}
    assert ratio == pytest.approx(dict.fromkeys(FREE, 1.0), abs=0.1)
    assert left < 0.15


TRUE = {"motor.J": 2e-3, "lag.tau": 0.05}  # with a damping that is known: the poles of both could be exchanged otherwise
DAMPING = 0.02
STEP, NOISE = 0.004, 1e-4


def lagging() -> Model:
    """A motor whose torque lags behind its command, and an encoder."""
    return Model(
        name="lagging",
        components={
            "source": Torque(),
            "motor": Inertia(J=2e-3),
            "bearing": RotationalDamper(d=DAMPING),
            "ground": RotationalFixed(),
            "encoder": AngleSensor(),
        },
        connections=[
            ("source.flange", "motor.flange"),
            ("encoder.flange", "motor.flange"),
            ("motor.flange", "bearing.flange_a"),
            ("bearing.flange_b", "ground.flange"),
        ],
        inputs={"tau": "source.tau"},
        outputs={"phi": "encoder.phi"},
    ).insert("input:tau", Lag(tau=0.05))


@pytest.mark.slow
@pytest.mark.parametrize("off", list(product((1 / 3, 3.0), repeat=2)))
def test_a_torque_that_lags_behind_its_command_is_smoothed_from_guesses_three_times_off(off):
    """The exact motion under a held command by the matrix exponential."""
    (J, tau), d = TRUE.values(), DAMPING
    block = np.zeros((4, 4))
    block[:3] = [[0, 1, 0, 0], [0, -d / J, 1 / J, 0], [0, 0, -1 / tau, 1 / tau]]
    step, rng = expm(block * STEP), np.random.default_rng(8)
    t = np.arange(0.0, 4.0, STEP)
    command = 0.05 * np.repeat(rng.uniform(-1, 1, 51), 20)[: len(t)]
    x = np.zeros((len(t), 3))
    for k in range(len(t) - 1):
        x[k + 1] = step[:3, :3] @ x[k] + step[:3, 3] * command[k]
    noisy = x[:, 0] + NOISE * rng.standard_normal(len(t))
    recording = Recording(name="run", time=t, inputs={"tau": command}, outputs={"phi": noisy}, output_std={"phi": NOISE})
    free = {name: Free(value * f, min=0.0) for (name, value), f in zip(TRUE.items(), off, strict=True)}
    result = smooth(Problem(model=lagging(), recordings=[recording], parameters=free))
    assert result.solver.converged
    for name, true in TRUE.items():
        estimate = result.parameters[name]
        assert abs(estimate.value - true) < 4 * estimate.std, f"{name}: {estimate}"
        assert estimate.std < 0.02 * true


@cache
def drilled() -> Run:
    return drillstring.record(
        drillstring.with_values({"bit.tau_sl": 0.35, "bit.tau_st": 0.55}),
        seed=4,
        conditions=replace(drillstring.CONDITIONS, duration=30.0, process={}),
    )


def drilling(factors: dict[str, float], first: float = 0.0, rows: np.ndarray | slice = slice(None)) -> Problem:
    """A bit that sticks and slips, with some parameters at guesses these factors off, held near them as a descent does."""
    dae = compile_model(PLANTS["drillstring"]())
    true = {p.name: p.value for p in dae.parameters} | {"bit.tau_sl": 0.35, "bit.tau_st": 0.55}
    rows = np.flatnonzero(drilled().time - drilled().time[0] >= first)[rows]
    inputs, outputs = ({name: y[rows] for name, y in table.items()} for table in (drilled().inputs, drilled().outputs))
    recording = Recording(name="run", time=drilled().time[rows], inputs=inputs, outputs=outputs, output_std=drilled().noise)
    free = {name: Free(true[name] * f, min=0.0, std=2 * true[name] * f) for name, f in factors.items()}
    fixed = {name: true[name] for name in ("bit.tau_sl", "bit.tau_st") if name not in factors}
    return Problem(model=dae, recordings=[recording], parameters={**fixed, **free}).plain


STUCK = ("string.dphi", "bha.omega")


def string_and_bit(problem: Problem) -> Driven:
    rows = own_rows(problem.dae, set(STUCK))
    return Driven(problem.dae, rows, velocities=stopping(problem.dae, rows, [law.velocity for law in friction_laws(problem)]))


def test_string_and_bit_have_balances_to_themselves_and_one_law_stops_the_bit():
    problem = drilling({})
    driven = string_and_bit(problem)
    assert sorted(named(problem.dae, driven.rows)) == sorted(STUCK)
    assert driven.velocities == ("bit.omega_rel",)
    twice = stopping(problem.dae, driven.rows, ["bit.omega_rel", "bit.omega_rel"])  # two laws at one body stop it once
    assert twice == ("bit.omega_rel",)


def test_of_two_laws_between_the_same_bodies_one_stops_them():
    model = PLANTS["drillstring"](sections=2)
    for ring in ("ring_1", "ring_2"):
        model = model.insert("string_2", RotationalFriction(tau_c=0.1), name=ring)
    dae = compile_model(model)
    rows = own_rows(dae, {"string_1.dphi", "string_2.dphi", "section_1.omega", "bha.omega"})
    assert len(stopping(dae, rows, ["ring_1.omega_rel", "ring_2.omega_rel", "bit.omega_rel"])) == 2


@pytest.mark.parametrize(("first", "slips"), [(0.0, False), (2.0, False), (4.0, True), (5.0, True)])
def test_a_recording_may_begin_while_the_bit_slips(first, slips):
    """From where it is said to begin, as little is left over throughout as from where it truly began."""
    problem = drilling({}, first)
    followed = follow_closely(problem, output_stds(problem)[0], None)
    driven = string_and_bit(problem)
    seen, instants = Seen(problem, driven, followed, problem.values), driven.instants(followed, 0)
    along = driven.along(followed, 0, (instants[1:] + instants[:-1]) / 2)
    begun = seen.begun(instants, along, problem.values)
    truth = {name: float(np.interp(drilled().time[0] + first, drilled().time, drilled().truth[name])) for name in STUCK}
    assert (truth["bha.omega"] > 1.0) == slips
    true = np.array([truth[name] for name in named(problem.dae, driven.rows)])

    def left(states: np.ndarray) -> float:
        r, _ = seen.left(driven.go(instants, along, problem.values, states), along, problem.values)
        return float(np.sum(np.log(rms(r))))

    assert left(begun) < left(true) + 0.05
    if first:
        assert left(np.zeros(len(true))) > left(true) + 0.08


@pytest.mark.parametrize("first", [0.0, 2.0, 4.0, 5.0, 6.5])
def test_where_all_parameters_are_known_the_unseen_begins_as_it_moves_there(first):
    """At rest or slipping, as the instants that follow tell it; among free parameters a start in motion would fit anything."""
    problem = replace(drilling({}, first), parameters=drilling({}, first).parameters | {"bit.width": 0.03})
    followed = follow_closely(problem, output_stds(problem)[0], None)
    found = sought(problem, followed, friction_laws(problem), problem.values, lambda _: None)
    assert found is not None
    times = np.linspace(0.0, 4.0, 401)[1:]
    _, x, _ = found[0].at(0, times)
    for i in string_and_bit(problem).rows:
        name = problem.dae.states[i].name
        true = np.interp(first + times, drilled().time - drilled().time[0], drilled().truth[name])
        assert np.sqrt(np.mean((x[i] - true) ** 2)) < 0.25 * max(np.std(true), problem.dae.states[i].nominal), name


@pytest.mark.slow
def test_pieces_too_short_to_drive_anything_are_no_hindrance():
    rows = np.r_[0:4, 10:700, 720:724, 800:1500]
    problem = drilling({"string.k": 1.5, "bha.J": 1.5}, rows=rows)
    followed = follow_closely(problem, output_stds(problem)[0], None)
    found = sought(problem, followed, friction_laws(problem), problem.values, lambda _: None)
    assert found is not None
    true = drilling({}).values
    assert found[1][list(problem.free)] == pytest.approx(true[list(problem.free)], rel=0.3)


def test_a_bit_that_sticks_and_slips_goes_as_in_the_simulator_that_finds_its_stops_as_roots():
    problem = drilling({})
    followed = follow_closely(problem, output_stds(problem)[0], None)
    parameters = problem.values.copy()
    parameters[[p.name for p in problem.dae.parameters].index("bit.width")] = 0.02
    driven = string_and_bit(problem)
    run = driven.run(followed, 0, parameters, np.zeros(2))
    true = {name: np.interp(run.times, drilled().time, drilled().truth[name]) for name in STUCK}
    state = dict(zip(named(problem.dae, driven.rows), run.state, strict=True))
    stuck = np.abs(true["bha.omega"]) < 1e-9
    assert 0.1 < np.mean(stuck) < 0.9
    assert np.mean(np.abs(state["bha.omega"][stuck]) < 0.1) > 0.9
    for name in STUCK:
        assert np.sqrt(np.mean((state[name] - true[name]) ** 2)) < 0.2 * np.std(true[name]), name


@pytest.mark.slow
@pytest.mark.parametrize("off", [1 / 3, 3.0])
def test_what_a_bit_sticks_and_slips_by_is_searched_for(off):
    """Guesses three times off, which an ordinary descent does not lead home from; the inertia of the table is one."""
    problem = drilling({"string.k": 1 / off, "bha.J": off, "bit.tau_sl": off, "bit.tau_st": off, "rotary_table.J": off})
    followed = follow_closely(problem, output_stds(problem)[0], None)
    found = sought(problem, followed, friction_laws(problem), problem.values, lambda _: None)
    assert found is not None
    true = drilling({}).values
    ratio = {problem.dae.parameters[i].name: float(found[1][i] / true[i]) for i in problem.free}
    assert ratio == pytest.approx(dict.fromkeys(ratio, 1.0), abs=0.15)


def test_only_a_body_that_a_law_may_hold_is_searched_for():
    problem = drilling({"string.k": 1.0})
    followed = follow_closely(problem, output_stds(problem)[0], None)
    assert sought(problem, followed, (), problem.values, lambda _: None) is None


def test_nothing_is_searched_for_where_a_lag_hides_every_body():
    """An encoder that lags shows no body at once: no balance of what is seen is left to fit anything to."""
    t, J, tau, omega, swing = np.linspace(0.0, 3.0, 601), 0.01, 0.02, 6.0, 0.5
    turned = swing / np.hypot(1.0, omega * tau) * np.sin(omega * t - np.arctan(omega * tau))
    given = {"tau": -J * swing * omega**2 * np.sin(omega * t)}
    recording = Recording(name="swing", time=t, inputs=given, outputs={"phi": turned}, output_std={"phi": 1e-5}, hold="linear")
    model = Model(
        name="lagging",
        components={
            "source": Torque(), "rotor": Inertia(J=J), "bearing": RotationalFriction(tau_c=0.01), "housing": RotationalFixed(),
            "encoder": AngleSensor(), "lag": Lag(tau=tau),
        },
        connections=[
            ("source.flange", "rotor.flange"), ("rotor.flange", "bearing.flange_a"), ("bearing.flange_b", "housing.flange"),
            ("rotor.flange", "encoder.flange"), ("encoder.phi", "lag.u"),
        ],
        inputs={"tau": "source.tau"},
        outputs={"phi": "lag.y"},
    )  # fmt: skip
    parameters = {"bearing.tau_c": Free(0.01, min=0.0, std=0.01), "rotor.J": Free(1.5 * J, min=1e-4)}
    problem = Problem(model=model, recordings=[recording], parameters=parameters)
    followed = follow_closely(problem, output_stds(problem)[0], None)
    assert len(unseen_states(problem)) == 2
    assert sought(problem, followed, friction_laws(problem), problem.values, lambda _: None) is None
    rows = own_rows(problem.dae, set(unseen_states(problem)))
    assert fitted(problem, rows, followed, problem.values)[1] == 1.0
    result = smooth(problem)
    assert result.solver.converged
    assert result.value("rotor.J") == pytest.approx(J, rel=0.02)
    assert result.value("bearing.tau_c") < 2e-3


@pytest.mark.long
@pytest.mark.slow
def test_a_string_that_sticks_and_slips_is_smoothed_from_guesses_of_all_its_parameters():
    """Nothing tells the torque of the string here: the inertia of the table is a guess too."""
    off = {"rotary_table.J": 1.2, "rotary_table.d": 0.7, "string.k": 0.7, "bha.J": 0.8, "bit.tau_sl": 1.3, "bit.tau_st": 1.3}
    problem, true = drilling(off), drilling({}).values
    known = {k: replace(f, std=None) if isinstance(f, Free) else f for k, f in problem.parameters.items()}
    result = smooth(replace(problem, parameters=known), settings=Settings(check_mesh=False))
    assert result.solver.converged
    for i in problem.free:
        estimate = result.parameters[problem.dae.parameters[i].name]
        assert abs(estimate.value - true[i]) < 4 * estimate.std, f"{estimate}"
        assert estimate.std < 0.2 * true[i], f"{estimate}"
