"""Scores against dense least squares of finite differences, and against what a full fit makes of a small effect."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
from concealed_axis import posed, run, smoothed
from scipy.linalg import null_space

from backsight.data.generators import five_bar
from backsight.estimation import Free, Problem, Recording, Weights, smooth
from backsight.estimation.diagnosis.candidates.laws import AGAINST_GROUND, Motion, of_law
from backsight.estimation.diagnosis.candidates.places import bodies
from backsight.estimation.diagnosis.scores.enlarged import Enlarged
from backsight.estimation.diagnosis.scores.score import Columns, Linearised
from backsight.estimation.smoothing.rest import near_rest
from backsight.models import compile_model
from backsight.models.plants import PLANTS
from backsight.ocp import ParameterPrior, transcribe

MOTION = Motion(v_rms=0.1, low=-0.05, high=0.05)


def rows_at(nlp, values, decisions) -> tuple[np.ndarray, np.ndarray]:
    """Rows that are squared, and rows that must be nothing."""
    rows = nlp.evaluated.rows(values.scaled(decisions), values)
    squares = [r.T.ravel() for r, t in zip(rows, nlp.terms, strict=True) if not t.equality]
    exact = [r.T.ravel() for r, t in zip(rows, nlp.terms, strict=True) if t.equality]
    return np.concatenate(squares), np.concatenate([np.empty(0), *exact])


def slopes(nlp, values, decisions) -> tuple[np.ndarray, np.ndarray]:
    """Their derivatives in all unknowns, by central differences."""
    found = []
    for i in range(nlp.size):
        step = np.zeros(nlp.size)
        step[i] = 1e-3 * values.unit[i]
        up, down = rows_at(nlp, values, decisions + step), rows_at(nlp, values, decisions - step)
        found.append([(a - b) / 2e-3 for a, b in zip(up, down, strict=True)])
    return np.column_stack([f[0] for f in found]), np.column_stack([f[1] for f in found])


def in_strength(solution, dae, name, parameters, priors=MappingProxyType({})) -> tuple[np.ndarray, np.ndarray]:
    """The rows' derivative in a parameter of another model, by transcribing that model alone and moving the parameter."""
    t = solution.transcription
    names, places = [p.name for p in dae.parameters], [p.name for p in dae.places]
    free = [names.index(t.dae.parameters[i].name) for i in t.nlp.free]
    std = np.array([priors.get(names[i]) or np.inf for i in free])
    force_std = {places.index(t.dae.places[k].name): s for k, s in zip(t.soft, t.force_std, strict=True)}
    other = transcribe(
        dae,
        t.horizons,
        free=free,
        prior=ParameterPrior(mean=np.zeros(len(free)), std=std),
        force_std=force_std,
        method=t.method,
        degree=t.degree,
    ).nlp
    assert [term.target.shape for term in other.terms] == [term.target.shape for term in t.nlp.terms]
    sides = []
    for sign in (1, -1):
        now = parameters.copy()
        now[names.index(name)] += sign * 1e-3
        s = solution.values
        values = replace(other.values(now), data=s.data, target=s.target, scale=s.scale, unit=s.unit)
        sides.append(rows_at(other, other.about(values, solution.solved.decisions), solution.solved.decisions))
    return tuple((a - b) / 2e-3 for a, b in zip(*sides, strict=True))


def dense(solution, effects) -> tuple[np.ndarray, np.ndarray]:
    """b and G by projections: min |r + J dX + s a|^2 subject to g + A dX + s_g a = 0."""
    decisions, nlp = solution.solved.decisions, solution.transcription.nlp
    r, g = rows_at(nlp, solution.values, decisions)
    J, A = slopes(nlp, solution.values, decisions)
    s, s_g = np.column_stack([e[0] for e in effects]), np.column_stack([e[1] for e in effects])
    free = np.eye(nlp.size)
    if len(g):
        free = null_space(A)
        inverse = np.linalg.pinv(A)
        r, s = r - J @ inverse @ g, s - J @ inverse @ s_g
    Q, _ = np.linalg.qr(J @ free)
    s = s - Q @ (Q.T @ s)
    return s.T @ (r - Q @ (Q.T @ r)), s.T @ s


def enlarged(solution, dae, strengths, parameters) -> Columns:
    names = [p.name for p in dae.parameters]
    made = Enlarged(Linearised(solution), dae, [names.index(n) for n in strengths], solution.transcription.horizons, parameters)
    return made.columns(parameters)


def values_of(solution, dae, shapes) -> np.ndarray:
    known = dict(zip((p.name for p in solution.transcription.dae.parameters), solution.parameters.tolist(), strict=True))
    return np.array([shapes.get(p.name, known.get(p.name, p.value)) for p in dae.parameters])


@pytest.mark.parametrize("std", [None, 3.0])
def test_scores_of_laws_with_shapes_and_phases_are_those_of_dense_least_squares(std):
    problem = posed(run(0.15), carriage__m=Free(94.0, std=std))
    solution = smooth(problem).solution
    (spot,) = bodies(problem.model)
    wanted = ("constant_force", "stribeck_friction", "cogging", "cubic_spring", "quadratic_drag")
    candidates = [of_law(law, problem.model, spot, MOTION) for law in AGAINST_GROUND if law.physics in wanted]
    model, effects, strengths, shapes = problem.model, [], [], {}
    for c in candidates:
        shapes |= {name: grid[3] for name, grid in c.shapes.items()} | ({c.quadrature: 0.7} if c.quadrature else {})
    for c in candidates:
        model = c.edited(model)
        alone = compile_model(c.edited(problem.model))
        for name in c.strengths:
            strengths.append(name)
            effects.append(in_strength(solution, alone, name, values_of(solution, alone, shapes), {"carriage.m": std}))
    dae = compile_model(model)
    columns = enlarged(solution, dae, strengths, values_of(solution, dae, shapes))
    base = Linearised(solution)
    scores, apart = base.scores(columns), base.effects(columns)
    b, G = dense(solution, effects)
    size = np.sqrt(np.diag(G))
    assert apart.T @ apart == pytest.approx(scores.G, rel=1e-6, abs=1e-9 * size.max() ** 2)
    assert apart.T @ base.left / size == pytest.approx(scores.b / size, abs=1e-6)
    assert len(base.intervals) == len(apart)
    assert 0 <= base.intervals.min() <= base.intervals.max() == len(solution.transcription.nlp.steps) - 1
    assert scores.G / np.outer(size, size) == pytest.approx(G / np.outer(size, size), abs=1e-5)
    assert scores.b / size == pytest.approx(b / size, abs=1e-4)
    assert scores.plain == pytest.approx([np.sum(s**2) for s, _ in effects], rel=1e-4)


@pytest.mark.slow
def test_scores_are_those_of_dense_least_squares_where_equations_hold_exactly():
    made = five_bar.record(seed=1, conditions=replace(five_bar.CONDITIONS, duration=0.12))
    recording = Recording(name="arm", time=made.time, inputs=made.inputs, outputs=made.outputs, output_std=made.noise)
    problem = Problem(model=PLANTS["five_bar"](), recordings=[recording], weights=Weights(W={"joint_1": 1e-3, "joint_2": 1e-3}))
    solution = smooth(problem).solution
    assert any(term.equality for term in solution.transcription.nlp.terms)
    candidates = [
        of_law(law, problem.model, spot, MOTION)
        for spot in bodies(problem.model)
        if spot.name in ("joint_1", "joint_3")
        for law in AGAINST_GROUND
        if law.physics in ("viscous_friction", "spring")
    ]
    model, effects = problem.model, []
    for c in candidates:
        model = c.edited(model)
        alone = compile_model(c.edited(problem.model))
        effects.append(in_strength(solution, alone, c.strengths[0], values_of(solution, alone, {})))
    dae = compile_model(model)
    columns = enlarged(solution, dae, [c.strengths[0] for c in candidates], values_of(solution, dae, {}))
    base = Linearised(solution)
    scores, apart = base.scores(columns), base.effects(columns)
    b, G = dense(solution, effects)
    size = np.sqrt(np.diag(G))
    assert apart.T @ apart == pytest.approx(scores.G, rel=1e-6, abs=1e-9 * size.max() ** 2)
    assert apart.T @ base.left / size == pytest.approx(scores.b / size, abs=1e-6)
    assert len(base.intervals) == len(apart)
    assert 0 <= base.intervals.min() <= base.intervals.max() == len(solution.transcription.nlp.steps) - 1
    assert scores.G / np.outer(size, size) == pytest.approx(G / np.outer(size, size), abs=1e-4)
    assert scores.b / size == pytest.approx(b / size, abs=1e-3)


# Near rest a fit with Coulomb friction gives its residual force room for as much, which the score of the model without it does not know.
@pytest.mark.parametrize(("physics", "of", "near"), [("constant_force", "offset.f", 0.02), ("coulomb_friction", "friction.f_c", 0.25)])
def test_a_small_concealed_effect_is_predicted_as_a_full_fit_finds_it(physics, of, near):
    made = run(1.0, **{"f_0" if of == "offset.f" else "f_c": 0.5})
    problem = posed(made)
    solution = smooth(problem).solution
    (spot,) = bodies(problem.model)
    law = next(law for law in AGAINST_GROUND if law.physics == physics)
    v = made.truth["carriage.v"]
    motion = replace(MOTION, v_rms=float(np.sqrt(np.mean(v**2))))
    c = of_law(law, problem.model, spot, motion)
    dae = compile_model(c.edited(problem.model))
    scores = Linearised(solution).scores(enlarged(solution, dae, c.strengths, values_of(solution, dae, {})))
    strength, gain = -scores.b[0] / scores.G[0, 0], 0.5 * scores.b[0] ** 2 / scores.G[0, 0]
    full = smooth(replace(problem, parameters={**problem.parameters, of: Free(0.4, min=0.0)}))
    cost = [0.5 * sum(np.sum(r**2) for r in s.rows) for s in (solution, full.solution)]
    assert strength == pytest.approx(full.parameters[of].value, rel=0.03)
    assert scores.G[0, 0] ** -0.5 == pytest.approx(full.parameters[of].std, rel=near)
    assert gain == pytest.approx(cost[0] - cost[1], rel=near)
    assert strength == pytest.approx(0.5, abs=3.5 * scores.G[0, 0] ** -0.5)


def test_a_model_that_does_not_hold_the_solution_is_refused():
    problem = posed(run(0.15))
    solution = smooth(problem).solution
    dae = compile_model(problem.model)
    other = values_of(solution, dae, {"offset.f": 5.0})
    with pytest.raises(ValueError, match="does not hold the solution"):
        enlarged(solution, dae, ["friction.f_c"], other)


def test_what_acts_near_rest_alone_is_nothing_while_moving():
    """A model with Coulomb friction of an axis that reverses: a force there, and a force elsewhere."""
    problem = posed(run(1.5, f_c=20.0), friction__f_c=Free(15.0))
    base = Linearised(smooth(problem).solution)
    t = base.solution.transcription
    near = near_rest(t.force_std_at(base.solution.values))[0]
    assert 0.02 < near.mean() < 0.5
    (force,) = [term for term in t.nlp.terms if term.name == t.force_term]
    rows = np.repeat(near, force.target.shape[0])
    first = sum(term.target.size for term in t.nlp.terms[: t.nlp.terms.index(force)] if term.equality or term.heavy)
    both = np.zeros((len(base.sizes), 2))
    both[first : first + rows.size, 0], both[first : first + rows.size, 1] = rows / base.sizes[: rows.size], ~rows / base.sizes[: rows.size]
    columns = Columns(squares=np.zeros((len(base._squares), 2)), multiplied=both)
    whole, moving = np.diag(base.scores(columns).G), np.diag(base.moving.scores(base.while_moving(columns)).G)
    assert base.rests
    assert moving[0] < 1e-3 * whole[0]
    assert moving[1] == pytest.approx(whole[1], rel=0.5)


def test_where_nothing_rests_moving_is_all_there_is():
    _, _, base = smoothed()
    assert not base.rests
    columns = Columns(squares=np.ones((len(base._squares), 1)), multiplied=np.ones((len(base.sizes), 1)))
    np.testing.assert_array_equal(base.while_moving(columns).multiplied, columns.multiplied)
