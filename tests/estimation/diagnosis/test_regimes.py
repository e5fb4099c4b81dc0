"""Where an effect acts: at reversals, one way, at high speed, in a part of the way; or wherever the axis moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from concealed_axis import smoothed

from backsight.data.generators import drillstring
from backsight.estimation import Problem, Recording, smooth
from backsight.estimation.diagnosis.answer.regimes import EVERYWHERE, regime
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.scores.shares import Sizes
from backsight.estimation.diagnosis.scores.supermodel import looked_at
from backsight.models.plants import PLANTS


@pytest.fixture(scope="module")
def axis():
    """The solution of a smoothed axis, and its position and velocity in the middles of the intervals."""
    _, result, _ = smoothed(1.0)
    table, mesh = result.estimates["axis"], result.solution.transcription.horizons[0].mesh
    middles = (mesh.knots[1:] + mesh.knots[:-1]) / 2
    s, v = (np.interp(middles, table["t_s"], table[f"carriage.{name}"]) for name in ("s", "v"))
    return result.solution, s, v


def of(axis, force) -> str:
    solution, s, v = axis
    return regime(solution, "carriage", force(s, v), np.ones(len(s), dtype=bool))


def test_friction_acts_wherever_it_moves_and_nothing_acts_nowhere(axis):
    assert of(axis, lambda _, v: -np.sign(v)) == EVERYWHERE
    assert of(axis, lambda _, v: 0 * v) == EVERYWHERE


def test_the_most_crowded_regime_is_the_one_that_is_said(axis):
    _, s, v = axis
    rms = np.sqrt(np.mean(v**2))
    assert of(axis, lambda _, v: np.exp(-((v / (0.05 * rms)) ** 2))) == "at reversals"
    assert of(axis, lambda _, v: np.exp(-np.abs(v / (0.25 * rms)))) == "mostly at reversals"
    rarer = 1.0 if np.mean(v > 0) < 0.5 else -1.0
    assert np.mean(rarer * v > 0) < 0.4
    assert of(axis, lambda _, v: np.where(rarer * v > 0, 1.0, 0.1)) == ("forwards" if rarer > 0 else "backwards")
    assert of(axis, lambda _, v: np.where(rarer * v < 0, 1.0, 0.1)) == EVERYWHERE  # it moves that way most of the time
    fast = np.quantile(np.abs(v), 0.75)
    said = of(axis, lambda _, v: np.maximum(np.abs(v) - fast, 0.0))
    assert said.startswith("at speeds above ")
    assert float(said.split()[3]) == pytest.approx(fast, rel=0.05)
    low = np.linspace(s.min(), s.max(), 5)[3]
    assert of(axis, lambda s, _: 1.0 * (s > low)) == f"at positions of {low:.3g} .. {s.max():.3g} m"


def test_intervals_that_do_not_count_say_nothing(axis):
    solution, _, v = axis
    assert regime(solution, "carriage", np.where(v > 0, 1.0, 50.0), v > 0) == EVERYWHERE


def test_the_voltage_of_a_motor_is_no_velocity():
    run = drillstring.record(seed=1, conditions=replace(drillstring.CONDITIONS, duration=2.0, process={}))
    recording = Recording(name="run", time=run.time, inputs=run.inputs, outputs=run.outputs, output_std=run.noise)
    result = smooth(Problem(model=PLANTS["drillstring"](), recordings=[recording], parameters={"bit.width": 0.03}))
    mesh = result.solution.transcription.horizons[0].mesh
    middles, counts = (mesh.knots[1:] + mesh.knots[:-1]) / 2, np.ones(mesh.count, dtype=bool)
    voltage, speed = (np.interp(middles, run.time - run.time[0], y) for y in (run.inputs["V"], run.truth["rotary_table.omega"]))
    assert regime(result.solution, "motor", 1.0 * (voltage > np.quantile(voltage, 0.8)), counts) == EVERYWHERE
    assert regime(result.solution, "rotary_table", 1.0 * (speed > np.quantile(speed, 0.8)), counts).startswith("at speeds above")


@pytest.mark.parametrize(
    ("physics", "there"),
    [
        ("coulomb_friction", EVERYWHERE),
        ("stribeck_friction", "at reversals"),
        ("asymmetric_friction", "backwards"),
        ("quadratic_drag", "mostly at speeds above"),
    ],
)
def test_a_candidate_acts_where_its_force_does(physics, there):
    """The last strength of each alone: that of the peak at rest, that of one way."""
    problem, result, base = smoothed(1.0)
    found = [c for c in library(problem, problem.model, result.solution) if c.key == ("carriage", physics)]
    look = looked_at(problem, problem.model, base, found)[0]
    assert Sizes(problem, result, base).regime(look, np.eye(len(look.columns))[-1]).startswith(there)
