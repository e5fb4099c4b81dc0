"""All candidates in one model: each looks as it does alone, waves as their component, and signals as the block that does the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from concealed_axis import smoothed

from backsight.estimation import Free, Problem, Recording, smooth
from backsight.estimation.diagnosis.candidates.candidate import Candidate, Signal
from backsight.estimation.diagnosis.candidates.edits import Exchange
from backsight.estimation.diagnosis.candidates.library import library
from backsight.estimation.diagnosis.scores.enlarged import Enlarged
from backsight.estimation.diagnosis.scores.score import Columns, Linearised
from backsight.estimation.diagnosis.scores.supermodel import looked_at
from backsight.estimation.diagnosis.search.refit import QUICKLY
from backsight.models import Model, compile_model
from backsight.models.mechanics import translational
from backsight.models.mechanics.planar import Body, FrameFixed, Prismatic, World
from backsight.models.mechanics.rotational import Gear, Inertia, Rack, Torque
from backsight.models.plants import actuator
from backsight.models.signals import Lag


@pytest.fixture(scope="module")
def axis() -> tuple:
    problem, result, base = smoothed(0.5)
    candidates = library(problem, problem.model, result.solution)
    return problem, base, candidates, looked_at(problem, problem.model, base, candidates)


def same(a: Columns, b: Columns, rel: float = 1e-7) -> None:
    for mine, other in ((a.squares, b.squares), (a.multiplied, b.multiplied)):
        assert mine == pytest.approx(other, rel=rel, abs=rel * max(1e-12, float(np.abs(other).max(initial=0.0))))


def of(looks, physics: str) -> list:
    return [look for look in looks if look.candidate.physics == physics]


def test_every_candidate_that_has_a_score_is_looked_at_at_all_its_shapes(axis):
    _, _, candidates, looks = axis
    for c in candidates:
        if c.dear:
            assert not [look for look in looks if look.candidate is c]
            continue
        count = len(c.signals) or max((len(grid) for grid in c.shapes.values()), default=1)
        mine = [look for look in looks if look.candidate is c]
        assert len(mine) == count, c.title
        assert all(len(look.columns) == (1 if c.signals else len(c.strengths) * (2 if c.quadrature else 1)) for look in mine)


@pytest.mark.parametrize("physics", ["coulomb_friction", "stribeck_friction", "asymmetric_friction", "cubic_spring", "input_gain"])
def test_a_candidate_among_the_others_looks_as_it_does_alone(axis, physics):
    problem, base, candidates, looks = axis
    for c in (c for c in candidates if c.physics == physics):
        alone = looked_at(problem, problem.model, base, [c])
        for a, b in zip(alone, [look for look in looks if look.candidate is c], strict=True):
            assert a.shape == b.shape
            same(a.columns, b.columns)


def test_waves_are_those_of_the_component_that_waves(axis):
    """cogging, sin(2 pi s/period + phase), compiled with its period, against a constant force times sines of the position."""
    problem, base, candidates, looks = axis
    (c,) = (c for c in candidates if c.physics == "cogging")
    grid = {name: values[::13] for name, values in c.shapes.items()}
    plain = looked_at(problem, problem.model, base, [replace(c, shapes=grid)])
    for look in plain:
        (waved,) = (w for w in of(looks, "cogging") if w.shape == look.shape)
        same(waved.columns, look.columns, rel=1e-5)


def test_friction_that_waves_spans_what_its_component_does_with_the_friction_beside_it(axis):
    problem, base, candidates, looks = axis
    (c,) = (c for c in candidates if c.physics == "position_dependent_friction")
    coulomb = next(look for look in of(looks, "coulomb_friction") if look.candidate.place == "carriage")
    grid = {name: values[3:4] for name, values in c.shapes.items()}
    (look,) = looked_at(problem, problem.model, base, [replace(c, shapes=grid)])
    (waved,) = (w for w in of(looks, "position_dependent_friction") if w.shape == look.shape)
    # f_c (1 + sin(..)) sgn(v): less the friction that does not wave, it is the wave
    plain = coulomb.columns
    less = Columns(squares=look.columns.squares - plain.squares, multiplied=look.columns.multiplied - plain.multiplied)
    same(waved.columns, less, rel=1e-5)


def test_an_input_that_is_twice_what_it_was_is_a_gain(axis):
    problem, base, _, looks = axis
    twice = Candidate(place="input:F", family="actuator", physics="x", signals=(Signal(of=("input:F",), changed=lambda _, u: 2 * u),))
    (look,) = looked_at(problem, problem.model, base, [twice])
    (right,) = of(looks, "input_gain")
    same(look.columns, right.columns, rel=1e-6)
    more = Candidate(place="input:F", family="actuator", physics="x", signals=(Signal(of=("input:F",), changed=lambda _, u: u + 1.0),))
    (look,) = looked_at(problem, problem.model, base, [more])
    (right,) = of(looks, "input_offset")
    same(look.columns, right.columns, rel=1e-6)


def test_a_reading_that_is_off_by_one_is_a_bias_and_one_that_grows_drifts(axis):
    problem, base, _, looks = axis
    for physics, changed in (
        ("sensor_bias", lambda _, y: y + 1.0),
        ("sensor_gain", lambda _, y: 2 * y),
        ("sensor_drift", lambda t, y: y + t),
    ):
        c = Candidate(place="sensor:x", family="sensor", physics="x", signals=(Signal(of=("sensor:x",), changed=changed),))
        (look,) = looked_at(problem, problem.model, base, [c])
        (right,) = of(looks, physics)
        same(look.columns, right.columns, rel=1e-4)


def test_a_fixed_parameter_is_looked_at_as_the_law_that_it_belongs_to(axis):
    problem, base, _, looks = axis
    c = Candidate(place="offset", family="parameter", physics="wrong_parameter", strengths=("offset.f",))
    (look,) = looked_at(problem, problem.model, base, [c])
    (right,) = of(looks, "constant_force")
    same(look.columns, right.columns)


def test_what_cannot_be_in_the_model_or_has_states_is_left_out_and_the_others_are_not(axis):
    problem, base, candidates, _ = axis
    good = next(c for c in candidates if c.key == ("carriage", "coulomb_friction"))
    soft = Candidate(
        place="screw",
        family="transmission",
        physics="compliance",
        edits=(Exchange(name="friction", component=translational.DahlFriction()),),
        strengths=("friction.d",),
    )
    wrong = Candidate(
        place="no",
        family="friction",
        physics="x",
        edits=(Exchange(name="nothing", component=translational.Spring()),),
        strengths=("nothing.k",),
    )
    looks = looked_at(problem, problem.model, base, [soft, wrong, good])
    assert [look.candidate for look in looks] == [good]
    assert looked_at(problem, problem.model, base, [wrong]) == []
    assert actuator().components.keys() == problem.model.components.keys()


def geared_cart() -> Model:
    """A rotor drives a cart on a rail over a gear and a rack: a gear with an error has its force at the rail, and not at the rotor."""
    return Model(
        name="geared_cart",
        components={
            "source": Torque(), "rotor": Inertia(J=1e-3), "gear": Gear(ratio=4.0), "pinion": Rack(r=0.02), "world": World(),
            "base": FrameFixed(), "rail": Prismatic(), "cart": Body(m=0.8, I=1e-3),
        },
        connections=[
            ("source.flange", "rotor.flange"), ("rotor.flange", "gear.flange_a"), ("gear.flange_b", "pinion.wheel"),
            ("pinion.rack", "rail.axis"), ("base.frame", "rail.frame_a"), ("rail.frame_b", "cart.frame"),
        ],
        inputs={"tau": "source.tau"},
        outputs={"s": "rail.s"},
    )  # fmt: skip


def test_of_two_that_cannot_both_be_there_one_is_looked_at_and_so_are_all_others(axis):
    problem, base, candidates, looks = axis
    spring = next(c for c in candidates if c.physics == "spring")
    (insert,) = spring.edits
    (path,) = spring.strengths
    twin = replace(
        spring,
        physics="twin",
        edits=(replace(insert, component=translational.Damper()),),
        strengths=(f"{insert.name}.d",),
        shapes={},
        start={},
    )
    assert path.startswith(insert.name)
    together = looked_at(problem, problem.model, base, [*candidates, twin])
    assert of(together, "spring")
    assert not of(together, "twin")
    assert {look.candidate.physics for look in together} == {look.candidate.physics for look in looks}


def test_a_candidate_with_which_a_force_stands_elsewhere_is_left_out_and_the_others_are_not():
    rng = np.random.default_rng(1)
    tau, time = np.repeat(rng.uniform(-0.02, 0.02, 20), 10), 0.01 * np.arange(200)
    way = np.cumsum(np.cumsum(tau)) * 0.01**2 * 0.02 / 4 / (1e-3 + 0.8 * (0.02 / 4) ** 2) + 1e-5 * rng.standard_normal(200)
    problem = Problem(
        model=geared_cart(),
        recordings=[Recording(name="run", time=time, inputs={"tau": tau}, outputs={"s": way}, output_std={"s": 1e-5})],
        parameters={"cart.m": Free(0.6)},
    )
    base = Linearised(smooth(problem, settings=QUICKLY).solution)
    (place,) = problem.dae.places
    known = [c for c in library(problem, problem.model, base.solution) if c.edits and c.strengths and not c.signals]
    moved = [c for c in known if place.name not in [p.name for p in compile_model(c.edited(problem.model)).places]]
    assert [c.physics for c in moved] == ["kinematic_error"]
    seen = {look.candidate.key for look in looked_at(problem, problem.model, base, known)}
    assert moved[0].key not in seen
    assert (place.name, "viscous_friction") in seen


@pytest.mark.parametrize("late", [False, True])
def test_a_model_with_all_candidates_is_the_smoothed_one_off_the_solution_too(late, monkeypatch):
    """Where all that must vanish does a row that another model divides by something is the same. late: an input that lags already."""
    problem, _, base = smoothed(0.5)
    if late:
        problem = replace(problem, model=actuator().insert("input:F", Lag(tau=0.01), "late"), parameters=dict(problem.parameters))
        base = Linearised(smooth(problem).solution)
    compared = list[int]()

    def off_too(self: Enlarged, parameters: np.ndarray) -> None:
        solution, rng = self._base.solution, np.random.default_rng(1)
        values, decisions = self._values(parameters)
        moved = solution.solved.decisions + 0.1 * solution.values.unit * rng.standard_normal(solution.solved.decisions.shape)
        own = solution.transcription.nlp.evaluated.rows(solution.values.scaled(moved), solution.values)
        rows = self._program.nlp.evaluated.rows(values.scaled(np.concatenate([moved, decisions[len(moved) :]])), values)
        for k, row in zip(self._numbered, rows, strict=True):
            assert row == pytest.approx(own[k], rel=1e-6, abs=1e-6 * max(1.0, float(np.abs(own[k]).max(initial=0.0))))
            compared.append(row.size)

    monkeypatch.setattr(Enlarged, "check", off_too)
    assert looked_at(problem, problem.model, base, library(problem, problem.model, base.solution))
    assert sum(compared) > 1000
