"""Derivatives of the program: one check, run over models, transcriptions, degrees, horizons, free parameters and priors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from examples import compiled, lagged, number, oscillator, random_horizon, shaken, shaken_hard, stiffening
from truths import differences

from backsight.ocp import Horizon, ParameterPrior, Solver, Transcription, transcribe
from backsight.ocp.nlp import Values
from backsight.ocp.oracle import Oracle

MODELS = {"oscillator": oscillator, "lagged": lagged, "stiffening": stiffening, "shaken": shaken, "shaken hard": shaken_hard}
DAES = {name: compiled(model()) for name, model in MODELS.items()}


@dataclass(frozen=True, kw_only=True)
class Case:
    """One program to differentiate."""

    model: str = "stiffening"
    method: str = "spline"
    degree: int = 2
    free: tuple[str, ...] = ("mass.m", "friction.f_c", "friction.width", "spring.a")
    prior: tuple[float, ...] = ()
    horizons: int = 1
    known: bool = False
    soft: bool = True
    hold: str = "zero"

    def __str__(self) -> str:
        extra = (
            ["prior"] * bool(self.prior) + ["known"] * self.known + ["hard"] * (not self.soft) + ["linear-hold"] * (self.hold == "linear")
        )
        return "-".join([self.model, self.method, str(self.degree), f"{len(self.free)}free", f"{self.horizons}h", *extra])

    def transcribed(self) -> Transcription:
        dae = DAES[self.model]
        horizons = [random_horizon(dae, 7 + k, intervals=3 + k, known=self.known, hold=self.hold) for k in range(self.horizons)]
        std = np.array(self.prior or (np.inf,) * len(self.free))
        prior = ParameterPrior(mean=np.full(len(self.free), 1.3), std=std)
        force = {0: 0.4} if self.soft else {}
        return transcribe(dae, horizons, free=number(dae, *self.free), prior=prior, force_std=force, method=self.method, degree=self.degree)


CASES = [
    *(Case(method="spline", degree=d) for d in (2, 3, 4, 5)),
    *(Case(method="collocation", degree=d) for d in (1, 2, 3, 4)),
    *(Case(method=m, horizons=2, known=True) for m in ("spline", "collocation")),
    *(Case(method=m, free=(), soft=False) for m in ("spline", "collocation")),
    *(Case(method=m, prior=(0.3, np.inf, 0.2, np.inf), hold="linear") for m in ("spline", "collocation")),
    *(Case(model="lagged", method=m, degree=3, free=("motor.T", "spring.k"), horizons=2) for m in ("spline", "collocation")),
    *(Case(model="oscillator", method=m, free=("mass.m",)) for m in ("spline", "collocation")),
    *(Case(model="shaken", method=m, free=("mass.m", "spring.k")) for m in ("spline", "collocation")),
    *(Case(model="shaken hard", degree=d, free=("mass.m", "friction.f_c", "spring.a"), horizons=2) for d in (2, 3)),
]


def point(t: Transcription) -> tuple[Solver, np.ndarray, Values]:
    """A random point with random units and a random reference, so that the scaling is differentiated as well."""
    rng, nlp = np.random.default_rng(3), t.nlp

    def decisions() -> np.ndarray:
        return np.concatenate([rng.normal(size=nlp.trajectory_size) * 0.3, rng.uniform(0.8, 1.5, len(nlp.free))])

    values = replace(nlp.values(np.array([p.value for p in t.dae.parameters])), unit=rng.uniform(0.5, 2.0, nlp.size))
    values = nlp.about(values, decisions())
    return Solver(nlp), values.scaled(decisions()), values


@pytest.mark.parametrize("case", CASES, ids=str)
def test_gradient_jacobian_and_hessian_are_those_of_the_functions(case):
    t = case.transcribed()
    solver, x, values = point(t)
    oracle, rng = Oracle(solver.nlp), np.random.default_rng(4)
    oracle.about(values)
    program, grad, jac, hess, square = (
        oracle.program(),
        oracle.gradient(),
        oracle.jacobian(),
        oracle.hessian(exact=True),
        oracle.hessian(exact=False),
    )
    lam, weight = rng.normal(size=solver.nlp.constraint_count), 1.7

    def f(x):
        return np.array(program(x, [])[0]).ravel()

    def g(x):
        return np.array(program(x, [])[1]).ravel()

    def gradient(x):
        return np.array(grad(x, [])[1]).ravel()

    def jacobian(x):
        return np.array(jac(x, [])[1])

    assert float(grad(x, [])[0]) == pytest.approx(float(f(x)[0]), rel=1e-14)
    np.testing.assert_allclose(np.array(jac(x, [])[0]).ravel(), g(x), rtol=1e-13, atol=1e-13)
    close(gradient(x), differences(f, x).ravel())
    close(jacobian(x), differences(g, x))
    upper = np.array(hess(x, [], weight, lam))
    assert np.array_equal(upper, np.triu(upper))
    close(symmetric(upper), differences(lambda x: weight * gradient(x) + jacobian(x).T @ lam, x))
    squares = solver.hessian(values.decisions(x), values)[0].toarray()
    np.testing.assert_allclose(np.array(square(x, [], weight, lam)), weight * squares, rtol=1e-12, atol=1e-12 * np.abs(squares).max())


@pytest.mark.parametrize("case", CASES, ids=str)
def test_the_gauss_newton_hessian_is_the_square_of_the_rows_jacobian(case):
    t = case.transcribed()
    solver, x, values = point(t)
    squared = [i for i, term in enumerate(t.nlp.terms) if not term.equality]

    def rows(x):
        every = solver.rows(values.decisions(x), values)
        return np.concatenate([every[i].ravel(order="F") for i in squared])

    J = differences(rows, x)
    upper = solver.hessian(values.decisions(x), values)[0].toarray()
    close(symmetric(upper), J.T @ J)
    assert t.nlp.evaluated.cost(x, values) == pytest.approx(0.5 * np.sum(rows(x) ** 2), rel=1e-12)


@pytest.mark.parametrize("case", CASES[:2] + CASES[4:6] + CASES[8:10], ids=str)
def test_the_small_jacobians_of_every_row_are_those_of_the_rows(case):
    t = case.transcribed()
    solver, x, values = point(t)
    nlp = t.nlp
    for number_, term in enumerate(nlp.terms):
        J = solver.jacobian_of_rows(number_, values.decisions(x), values)
        whole = np.zeros((*term.target.shape, nlp.size))
        for r, interval in enumerate(term.interval):
            where = np.concatenate([nlp.index[:, interval], np.arange(nlp.trajectory_size, nlp.size)])
            whole[:, r][:, where] += J[r]

        def gathered(x, number_=number_):
            return solver.rows(values.decisions(x), values)[number_].ravel() / values.scale[number_].ravel()

        there = values.scale[number_].ravel() > 0
        with np.errstate(invalid="ignore", divide="ignore"):
            slopes = differences(gathered, x)
        close(whole.reshape(-1, nlp.size)[there] * values.unit, slopes[there])


def test_rows_do_not_depend_on_the_reference_that_decisions_are_measured_from():
    t = Case().transcribed()
    solver, x, values = point(t)
    decisions = values.decisions(x)
    elsewhere = np.ones(t.nlp.size)
    elsewhere[t.nlp.trajectory_size :] = values.reference[t.nlp.trajectory_size :]  # the reference parameters are part of the problem
    for other in (t.nlp.values(values.parameters), t.nlp.about(values, elsewhere)):
        for one, two in zip(solver.rows(decisions, values), solver.rows(decisions, other), strict=True):
            np.testing.assert_allclose(one, two, rtol=1e-9, atol=1e-9)


def test_a_missing_sample_changes_neither_cost_nor_gradient_whatever_stands_there():
    t = Case().transcribed()
    _, x, values = point(t)
    i = [term.name for term in t.nlp.terms].index("samples")
    missing = ~np.isfinite(np.concatenate([h.target for h in t.horizons]).T)
    assert missing.any()
    target = values.target[i].copy()
    target[missing] = 1e6
    other = replace(values, target=tuple(target if k == i else v for k, v in enumerate(values.target)))
    evaluated = t.nlp.evaluated
    assert evaluated.cost(x, values) == evaluated.cost(x, other)
    one, two = ([evaluated.linearised(k, x, v) for k in range(len(t.nlp.terms))] for v in (values, other))
    assert np.array_equal(evaluated.gradient(one), evaluated.gradient(two))


def test_the_unknowns_stand_in_time_order_with_the_parameters_last():
    t = Case(method="collocation", degree=2, horizons=2).transcribed()
    nlp, nx = t.nlp, 3
    stride = nx + nlp.interpolation.interior
    assert stride == nx + (2 - 1) * nx + 2 * (1 + 1)
    counts = [h.mesh.count for h in t.horizons]
    assert nlp.trajectory_size == sum(n * stride + nx for n in counts)
    assert t.starts.tolist() == [[0, 1, 2], [counts[0] * stride + nx + i for i in range(nx)]]
    assert np.array_equal(nlp.index[:nx, 1], nlp.index[stride:, 0])
    assert nlp.size == nlp.trajectory_size + 4
    assert nlp.constraint_count == 4 * 2 * sum(counts)


def test_two_horizons_cost_what_they_cost_alone():
    dae = DAES["lagged"]
    horizons: list[Horizon] = [random_horizon(dae, k, intervals=2 + k) for k in (1, 2)]
    nothing = ParameterPrior(mean=np.empty(0), std=np.empty(0))

    def program(chosen: list[Horizon]) -> Transcription:
        return transcribe(dae, chosen, free=(), prior=nothing, force_std={0: 0.3})

    both, rng = program(horizons), np.random.default_rng(0)
    x = rng.normal(size=both.nlp.size)
    parameters = np.array([p.value for p in dae.parameters])
    alone = [program([h]) for h in horizons]
    edges = np.cumsum([0, *(t.nlp.size for t in alone)])
    costs = [t.nlp.evaluated.cost(x[a:b], t.nlp.values(parameters)) for t, a, b in zip(alone, edges, edges[1:], strict=False)]
    assert both.nlp.evaluated.cost(x, both.nlp.values(parameters)) == pytest.approx(sum(costs), rel=1e-13)


def symmetric(upper: np.ndarray) -> np.ndarray:
    return upper + np.triu(upper, 1).T


def close(value: np.ndarray, expected: np.ndarray) -> None:
    """Equal but for the error of the differences, relative to the largest entry of each row, and rounding."""
    if expected.size == 0:
        assert value.size == 0
        return
    size = np.abs(expected).max(axis=-1, keepdims=True) + 1e-6 * np.abs(expected).max() + 1e-300
    assert np.max(np.abs(value - expected) / size) < 5e-6
