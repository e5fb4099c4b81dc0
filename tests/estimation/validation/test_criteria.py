"""Evidence, AIC and BIC against one dense Gaussian."""

from __future__ import annotations

import numpy as np
import pytest
from linear_runs import PLANT, STD, STEP, dense, many, problem
from scipy.stats import multivariate_normal

from backsight.estimation import Free, Known, Problem, Recording, Weights, smooth
from backsight.estimation.smoothing.program import Settings
from backsight.estimation.validation.innovations import _unit_information
from backsight.models.plants import actuator

N = 80
FINE = Settings(step=STEP, degree=2)
FIXED = {"mass.m": PLANT.m, "spring.k": PLANT.k, "damper.d": PLANT.d, "offset.f": PLANT.offset}
AT_REST = {"mass.s": 0.0, "mass.v": 0.0}
MEAN, C, EFFECT = dense(N)


def record(seed: int) -> np.ndarray:
    return many(N, 1, np.random.default_rng(seed))[0] + STD * np.random.default_rng(seed + 100).normal(size=N)


def test_without_anything_unknown_likelihood_and_evidence_are_the_density_of_the_samples():
    y = record(0)
    c = problem(y, settings=FINE, parameters=FIXED, initial=AT_REST)[0].criteria
    assert c.log_likelihood == pytest.approx(multivariate_normal.logpdf(y, MEAN, C), abs=2e-3)
    assert c.log_evidence == c.log_likelihood
    assert c.first_states == 0.0
    assert c.samples == N


def test_a_parameter_with_a_prior_is_integrated_out():
    y, b, std = record(1), EFFECT[:, 2], 0.4
    given = {**FIXED, "offset.f": Free(0.5, std=std)}
    c = problem(y, settings=FINE, parameters=given, initial=AT_REST)[0].criteria
    # the offset enters linearly: the evidence is a density again
    wide = multivariate_normal.logpdf(y, MEAN + b * (0.5 - PLANT.offset), C + std**2 * np.outer(b, b))
    assert c.log_evidence == pytest.approx(wide, abs=2e-3)


@pytest.mark.slow
def test_a_parameter_of_which_nothing_is_known_counts_as_even_over_its_nominal_size():
    y, b = record(2), EFFECT[:, 2]
    result, solution = problem(y, settings=FINE, parameters={**FIXED, "offset.f": Free(0.0)}, initial=AT_REST)
    (nominal,) = [p.nominal for p in solution.transcription.dae.parameters if p.name == "offset.f"]
    grid = np.linspace(-3.0, 3.0, 4001)
    densities = [multivariate_normal.logpdf(y, MEAN + b * f, C) for f in grid]
    top = max(densities)
    integral = top + np.log(np.trapezoid(np.exp(np.array(densities) - top), grid))
    assert result.criteria.log_likelihood == pytest.approx(top, abs=2e-3)
    assert result.criteria.log_evidence == pytest.approx(integral - np.log(nominal), abs=2e-3)


def test_first_states_of_which_nothing_is_known_are_integrated_out_evenly():
    y, start = record(3), EFFECT[:, :2]
    c = problem(y, settings=FINE, parameters=FIXED)[0].criteria
    information = np.linalg.inv(C)
    best = np.linalg.solve(start.T @ information @ start, start.T @ information @ (y - MEAN))
    at_best = multivariate_normal.logpdf(y, MEAN + start @ best, C)
    integral = at_best + np.log(2 * np.pi) - 0.5 * np.linalg.slogdet(start.T @ information @ start)[1]
    assert c.log_likelihood == pytest.approx(integral, abs=2e-3)


def test_as_much_may_be_known_of_first_states_as_the_sample_that_tells_most_of_each():
    """Samples one after the other, each less what those before tell of it, are the rows of L^-1, L L' their covariance."""
    y, start = record(3), EFFECT[:, :2]
    c = problem(y, settings=FINE, parameters=FIXED)[0].criteria
    rows, L = np.linalg.inv(np.linalg.cholesky(C)) @ start, np.linalg.cholesky(C)
    errors = np.linalg.solve(L, y - MEAN)
    best = np.linalg.lstsq(rows, errors, rcond=None)[0]
    M = np.diag(np.max(rows**2, axis=0))
    at_best = multivariate_normal.logpdf(y, MEAN + start @ best, C)
    integral = at_best + 0.5 * np.linalg.slogdet(M)[1] - 0.5 * np.linalg.slogdet(rows.T @ rows + M)[1]
    assert c.log_likelihood + c.first_states == pytest.approx(integral, abs=5e-3)


def test_of_first_states_as_much_counts_as_known_as_one_sample_tells():
    rng = np.random.default_rng(0)
    E = rng.normal(size=(40, 4)) * [1.0, 1e3, 1e-4, 2.0]
    known = np.array([[0.3, 0.0, 5.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 1e4]])  # the second hardly, the last one well
    R = np.linalg.qr(np.vstack([E, known[:, 1:]]))[1]
    M = np.max(E[:, :3] ** 2, axis=0)
    whole = R.T @ R + np.diag([*(M - [0.0, 25.0, 0.0]), 0.0])
    own = np.sum(np.log(M / (2 * np.pi))) - np.log(25.0 / (2 * np.pi)) + 0.3**2 * (1 - 25.0 / M[1])
    expected = 0.5 * np.linalg.slogdet(R.T @ R)[1] - 0.5 * np.linalg.slogdet(whole)[1] + 0.5 * own
    assert _unit_information(R, E, np.vstack([known, np.zeros((2, 5))])) == pytest.approx(expected, rel=1e-9)


def test_what_one_sample_tells_is_no_edge():
    """Known a little less, or a little more, than that, and four deviations off."""
    E = np.random.default_rng(2).normal(size=(20, 2))
    M = np.max(E[:, 0] ** 2)
    less, more = (np.array([[4.0, np.sqrt(share * M), 0.0]]) for share in (0.999, 1.001))
    found = [_unit_information(np.linalg.qr(np.vstack([E, known[:, 1:]]))[1], E, known) for known in (less, more)]
    assert found[0] == pytest.approx(found[1], abs=0.02)


def test_of_first_states_that_are_tied_only_directions_in_which_nothing_is_known_count():
    """A sum that is known, and one state apart from it."""
    rng = np.random.default_rng(1)
    E = rng.normal(size=(30, 3))
    known = np.array([[0.0, 1e3, 1e3, 0.0]])
    R = np.linalg.qr(np.vstack([E, known[:, 1:]]))[1]
    N = np.array([[0.0, 0.0, 1.0], [0.5**0.5, -(0.5**0.5), 0.0]]).T
    M = np.max((E @ N) ** 2, axis=0)
    whole = R.T @ R + (N * M) @ N.T
    expected = 0.5 * np.linalg.slogdet(R.T @ R)[1] - 0.5 * np.linalg.slogdet(whole)[1] + 0.5 * np.sum(np.log(M / (2 * np.pi)))
    assert _unit_information(R, E, known) == pytest.approx(expected, rel=1e-9)


def test_comparisons_do_not_hang_on_how_little_was_known_of_a_start():
    y = record(5)

    def compared(initial: dict[str, Known | float]) -> float:
        c = problem(y, settings=FINE, parameters=FIXED, initial=initial)[0].criteria
        return c.log_likelihood + c.first_states

    nothing = compared({"mass.v": 0.0})
    for std in (1.0, 1e3):
        assert compared({"mass.s": Known(0.2, std=std), "mass.v": 0.0}) == pytest.approx(nothing, abs=1e-3)
    sure = problem(y, settings=FINE, parameters=FIXED, initial={"mass.s": Known(0.0, std=1e-6), "mass.v": 0.0})[0].criteria
    assert sure.first_states == 0.0


def test_effective_parameters_are_the_trace_of_the_hat_matrix_and_penalise_a_density_given_the_fit():
    y = record(4)
    result, _ = problem(y, settings=FINE, parameters=FIXED, initial=AT_REST)
    hat = (C - STD**2 * np.eye(N)) @ np.linalg.inv(C)
    fitted = MEAN + hat @ (y - MEAN)
    assert result.estimates["run"]["x"].to_numpy() == pytest.approx(fitted, abs=2e-2 * STD)
    given_fit = float(np.sum(-0.5 * ((y - fitted) / STD) ** 2 - np.log(STD * np.sqrt(2 * np.pi))))
    c = result.criteria
    assert c.effective_parameters == pytest.approx(np.trace(hat), rel=2e-3)
    assert c.aic == pytest.approx(-2 * given_fit + 2 * np.trace(hat), abs=0.1)
    assert c.bic == pytest.approx(-2 * given_fit + np.trace(hat) * np.log(N), abs=0.1)


def test_what_is_not_determined_has_no_evidence():
    """An actuator at rest without a sample that differs from zero: nothing says how heavy it is."""
    time = 0.01 * np.arange(200)
    still = Recording(name="still", time=time, inputs={"F": 0 * time}, outputs={"x": 0 * time}, output_std={"x": 1e-3})
    given = {"carriage.m": Free(80.0), "friction.f_c": 0.0, "friction.d": 0.0, "offset.f": 0.0}
    result = smooth(Problem(model=actuator(), recordings=[still], parameters=given, weights=Weights(W={"carriage": 1.0})))
    assert not result.solution.determined
    assert result.criteria.log_evidence is None
    assert result.criteria.log_likelihood is None
    assert np.isfinite(result.criteria.aic)
