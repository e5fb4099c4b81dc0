"""From loose to tight balances: guesses a factor three off come home, whatever the plant."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest

from backsight.data.generators import actuator, drillstring, five_bar, quadrotor, xy_table
from backsight.data.generators.run import Force
from backsight.estimation import Free, Problem, Recording
from backsight.estimation.smoothing.approach import TIGHTEST, Approach, approach
from backsight.estimation.smoothing.horizons import output_stds
from backsight.estimation.smoothing.meshing import follow_closely
from backsight.estimation.smoothing.program import Program
from backsight.estimation.smoothing.rest import friction_laws, smoothing_widths
from backsight.models.plants import PLANTS

OFF = 3.0
FREE = {
    "actuator": ("carriage.m", "friction.d", "friction.f_c"),
    "xy_table": ("spindle.k", "drive_1.J", "drive_3.J", "friction_1.tau_c", "friction_3.tau_c"),
    "five_bar": ("P_1", "P_4", "P_5", "P_6"),
    "drillstring": ("string.k", "bha.J", "bit.tau_sl"),
    "quadrotor": ("body.Ixx", "body.Iyy", "body.Izz", "rotor.tau", "rotor.gain"),
}


def problem_of(
    name: str, generator: ModuleType, duration: float, seed: int, force: Force | None = None, **fixed: float
) -> tuple[Problem, dict[str, float]]:
    """A closed-loop recording of the independent simulator, every parameter guessed three times too large or too small."""
    run = generator.record(seed=seed, conditions=replace(generator.CONDITIONS, duration=duration), force=force)
    recording = Recording(name=name, time=run.time, inputs=run.inputs, outputs=run.outputs, output_std=run.noise)
    model, factor = PLANTS[name](), OFF ** (1 if seed % 2 else -1)  # one for all: bodies stay bodies
    truth = {p.name: p.value for p in Problem(model=model, recordings=[recording]).dae.parameters}
    guesses = {p: Free(truth[p] * factor, min=0.0) for p in FREE[name]}
    return Problem(model=model, recordings=[recording], parameters={**guesses, **fixed}).plain, truth


def approached(problem: Problem) -> Approach:
    stds, _ = output_stds(problem)
    followed, laws, start = follow_closely(problem, stds, None), friction_laws(problem), problem.values
    for index, width in smoothing_widths(problem, laws, followed).items():
        start[index] = width
    return approach(problem, followed, laws, start, {}, lambda _: None)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "generator", "duration"),
    [
        ("actuator", actuator, 4.0),
        ("xy_table", xy_table, 1.2),
        ("five_bar", five_bar, 4.0),
        ("quadrotor", quadrotor, 10.0),
        ("drillstring", drillstring, 20.0),
    ],
)
@pytest.mark.parametrize("seed", [11, 12])
def test_guesses_three_times_off_come_home_before_any_weight_is_chosen(name, generator, duration, seed):
    problem, truth = problem_of(name, generator, duration, seed)
    way = approached(problem)
    found = {p.name: float(v) for p, v in zip(problem.dae.parameters, way.parameters, strict=True)}
    assert {p: found[p] / truth[p] for p in FREE[name]} == pytest.approx(dict.fromkeys(FREE[name], 1.0), abs=0.15)


def test_it_ends_where_balances_are_tight_and_trajectories_meet_the_samples():
    problem, _ = problem_of("actuator", actuator, 3.0, 5)
    way = approached(problem)
    assert way.share == TIGHTEST
    (horizon,) = way.followed.horizons
    _, x, _ = way.followed.at(0, horizon.time)
    noise = problem.fitted[0].output_std["x"]
    assert np.sqrt(np.mean((x[0] - horizon.target[:, 0]) ** 2)) < 1.5 * noise


@pytest.mark.parametrize("cost", [1e9, np.nan])
def test_a_solve_that_goes_astray_is_taken_back(monkeypatch, cost):
    """The second one, the first in which parameters are free, ends anywhere."""
    problem, truth = problem_of("actuator", actuator, 3.0, 5)
    solve, calls = Program.solve, []

    def astray(self, *arguments):
        solution = solve(self, *arguments)
        calls.append(solution)
        if len(calls) != 2:
            return solution
        return replace(solution, solved=replace(solution.solved, cost=cost, decisions=-1e3 * solution.solved.decisions))

    monkeypatch.setattr(Program, "solve", astray)
    way = approached(problem)
    names = [p.name for p in problem.dae.parameters]
    assert way.share == TIGHTEST
    assert way.parameters[names.index("carriage.m")] == pytest.approx(truth["carriage.m"], rel=0.05)


def test_a_width_that_the_user_gave_stays():
    problem, _ = problem_of("actuator", actuator, 2.0, 5, **{"friction.width": 0.02})
    way = approached(problem)
    width = [p.name for p in problem.dae.parameters].index("friction.width")
    assert way.parameters[width] == 0.02


def test_a_residual_force_gets_no_less_room_than_it_is_given():
    problem, _ = problem_of("actuator", actuator, 2.0, 5)
    stds, _ = output_stds(problem)
    followed, laws = follow_closely(problem, stds, None), friction_laws(problem)
    way = approach(problem, followed, laws, problem.values, {0: 123.0}, lambda _: None)
    assert way.force_std[0] == 123.0


def test_a_model_that_lacks_a_strong_force_stops_before_it_bends_to_the_samples():
    """A spring of 2000 N/m that the axis does not know: balances cannot be as tight as 1 % of the forces there."""
    run = actuator.record(seed=3, conditions=replace(actuator.CONDITIONS, duration=3.0), force=lambda *tqv: -2000.0 * np.asarray(tqv[1]))
    recording = Recording(name="sprung", time=run.time, inputs=run.inputs, outputs=run.outputs, output_std=run.noise)
    problem = Problem(model=PLANTS["actuator"](), recordings=[recording], parameters={p: Free(20.0, min=0.0) for p in FREE["actuator"]})
    assert approached(problem).share > TIGHTEST


@pytest.mark.slow
def test_where_no_output_shows_the_attitude_a_place_that_strains_stays_loose_and_the_others_tell_the_parameters():
    """A drag of 0.45 N s/m that the quadrotor does not know: the forces at its body are off by a fifth, and nothing else is."""
    problem, truth = problem_of("quadrotor", quadrotor, 10.0, 12, force=lambda *tqv: -0.45 * np.r_[tqv[2][:2], np.zeros(4)])
    way = approached(problem)
    room = {problem.dae.places[k].name: std / way.whole[k] for k, std in way.force_std.items()}
    loose = {"body.f_x", "body.f_y"}
    assert {name for name, share in room.items() if share > 5 * TIGHTEST} == loose
    assert [share for name, share in room.items() if name not in loose] == pytest.approx([TIGHTEST] * (len(room) - 2))
    found = {p.name: float(v) for p, v in zip(problem.dae.parameters, way.parameters, strict=True)}
    assert {p: found[p] / truth[p] for p in FREE["quadrotor"]} == pytest.approx(dict.fromkeys(FREE["quadrotor"], 1.0), abs=0.1)
