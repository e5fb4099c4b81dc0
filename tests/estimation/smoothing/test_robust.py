"""Huber's loss: against dense minimisation, Huber's own formula and known contaminations."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import truths
from examples import OFFSET, D, K, M, compiled, oscillator
from scipy import integrate, optimize, stats

from backsight.estimation import Free, OutputColumn, Problem, Recording, Smoothing, Weights, smooth
from backsight.estimation.smoothing.outliers import _unexpected
from backsight.estimation.smoothing.robust import CORNER, expected_slope, expected_square, heavy_tailed, weight
from backsight.estimation.smoothing.smoother import Settings
from backsight.models.errors import InputError
from backsight.ocp import Options

MODEL, PLANT, STD = compiled(oscillator()), truths.Plant(m=M, d=D, k=K, offset=OFFSET), 1e-3
TRUE = {"mass.m": M, "spring.k": K, "damper.d": D, "offset.f": OFFSET}
FREE = {"mass.m": Free(3.0), "spring.k": Free(30.0), "damper.d": Free(1.0), "offset.f": Free(0.0)}


def recorded(
    seed: int, *, n: int = 300, step: float = 0.01, share: float = 0.0, size: float = 1000.0, loss: str = "huber", given: bool = True
) -> Recording:
    """A record whose samples are off by +-size deviations with this chance."""
    rng = np.random.default_rng(seed)
    time = step * np.arange(n)
    u = 20 * np.sign(np.sin(4.83 * time + seed)) + 10 * np.repeat(rng.normal(size=n // 10 + 1), 10)[:n]
    y = truths.disturbed(PLANT, time, u, np.array([0.02, -0.1]), 1e-3, rng)[:, 0] + STD * rng.normal(size=n)
    off = rng.uniform(size=n) < share
    y[off] += size * STD * np.sign(rng.normal(size=off.sum()))
    return Recording(
        name="run", time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": STD} if given else {}, output_loss={"x": loss}
    )


def fitted(recording: Recording, free: dict | None = None, W: float = 1e-3, settings: Settings = Settings()) -> Smoothing:  # noqa: B008
    problem = Problem(model=MODEL, recordings=[recording], parameters=free or FREE, weights=Weights(W={"mass": W}))
    s = smooth(problem, settings=settings)
    assert s.solver.converged, s.solver.status
    return s


def test_the_weight_is_one_within_the_corner_and_makes_every_pull_beyond_it_the_same():
    z = np.array([0.0, -1.0, CORNER, -2.0, 1e3])
    np.testing.assert_allclose(weight(z)[:3], 1.0)
    np.testing.assert_allclose(np.abs(weight(z) * z)[3:], CORNER)


@pytest.mark.parametrize("variance", [1.0, 0.5, 0.01])
def test_the_expected_squares_and_slopes_are_the_integrals_over_a_gaussian(variance):
    density = stats.norm(scale=np.sqrt(variance)).pdf
    inside = integrate.quad(lambda e: e**2 * density(e), -CORNER, CORNER)[0]
    beyond = 2 * CORNER**2 * stats.norm.sf(CORNER / np.sqrt(variance))
    assert expected_square(np.array(variance)) == pytest.approx(inside + beyond, rel=1e-9)
    assert expected_slope(np.array(variance)) == pytest.approx(integrate.quad(density, -CORNER, CORNER)[0], rel=1e-9)


def hubers_density(z: np.ndarray) -> np.ndarray:
    """log f, with its integral by quadrature."""

    def rho(z):
        return np.where(np.abs(z) > CORNER, CORNER * np.abs(z) - CORNER**2 / 2, np.square(z) / 2)

    return -rho(z) - np.log(integrate.quad(lambda e: np.exp(-rho(e)), -60, 60, points=[-CORNER, CORNER])[0])


def motion_errors(r: Recording, offset: float = OFFSET) -> np.ndarray:
    plant = truths.Plant(m=M, d=D, k=K, offset=offset)
    return (r.outputs["x"] - truths.motion(plant, r.time, r.inputs["F"], np.array([0.02, -0.1]))[:, 0]) / STD


def known_but(r: Recording, **free: Free) -> Smoothing:
    """All known but these parameters, and hardly a force."""
    given = {**TRUE, **{name.replace("_", "."): value for name, value in free.items()}}
    start = {"mass.s": 0.02, "mass.v": -0.1}
    return smooth(Problem(model=MODEL, recordings=[r], parameters=given, weights=Weights(W={"mass": 1e-4}), initial=start))


@pytest.mark.parametrize("share", [0.0, 0.05])
def test_likelihood_and_criteria_are_those_of_hubers_density(share):
    r = recorded(1, share=share, size=20.0)
    y = truths.motion(PLANT, r.time, r.inputs["F"], np.array([0.02, -0.1]))[:, 0] + (
        r.outputs["x"] - recorded(1, loss="square").outputs["x"]
    )
    r = replace(r, outputs={"x": y + STD * np.random.default_rng(7).normal(size=len(y))})
    c = known_but(r).criteria
    expected = np.sum(hubers_density(motion_errors(r)) - np.log(STD))
    assert c.log_likelihood == pytest.approx(expected, abs=0.05)
    assert c.aic == pytest.approx(-2 * expected + 2 * c.effective_parameters, abs=0.2)
    squares = known_but(replace(r, output_loss={"x": "square"})).criteria
    # clean samples are likelier under a Gaussian, contaminated ones under Huber's density
    assert (squares.log_likelihood > c.log_likelihood) == (share == 0.0)


@pytest.mark.slow
def test_the_evidence_with_hubers_density_is_the_integral_over_the_parameter():
    r = recorded(2, share=0.05, size=20.0)
    c = known_but(r, offset_f=Free(0.5, std=2.0)).criteria
    grid = OFFSET + np.linspace(-0.5, 0.5, 401)
    prior = stats.norm(0.5, 2.0)
    logs = np.array([np.sum(hubers_density(motion_errors(r, f)) - np.log(STD)) + prior.logpdf(f) for f in grid])
    integral = logs.max() + np.log(np.trapezoid(np.exp(logs - logs.max()), grid))
    # its curvature in force differs from that at the top by the factor of Huber's deviations, half its logarithm
    assert c.log_evidence == pytest.approx(integral, abs=0.25)


@pytest.mark.slow
def test_outliers_raise_no_alarm_about_the_noise_and_one_that_is_too_small_still_does():
    z, promised = [], []
    for seed in range(6):
        s = fitted(recorded(seed, n=400, share=0.05, size=20.0))
        fit = s.fit["run"]["x"]
        z.append(fit.normality_p)
        promised.append(fit.prediction_rms)
        assert not any("supposed" in note or "not normal" in note for note in s.notes), s.notes
        assert any("The tests of the prediction errors leave them out." in note for note in s.notes)
    assert np.mean(promised) == pytest.approx(1.0, abs=0.06)
    assert min(z) > 1e-3
    r = recorded(3, n=400, share=0.05, size=20.0)
    small = fitted(replace(r, output_std={"x": STD / 2}))
    assert small.fit["run"]["x"].prediction_rms > 1.5


def test_the_tails_of_gaussian_residuals_are_not_called_heavy_and_those_of_outliers_are():
    rng = np.random.default_rng(0)
    # the chance of a false alarm is below 1e-3 each: two of two hundred have less than 0.07
    assert sum(heavy_tailed(rng.normal(size=500)) for _ in range(200)) < 3
    assert heavy_tailed(np.append(rng.normal(size=497), [30.0, -30.0, 30.0]))
    assert heavy_tailed(np.append(rng.normal(size=1998), [250.0, -250.0]))  # too few to be many, too far to be chance
    assert heavy_tailed(rng.standard_t(3, size=2000))
    assert not heavy_tailed(rng.uniform(size=2000))
    assert heavy_tailed(10 * np.append(rng.normal(size=497), [30.0, -30.0, 30.0]))
    assert not heavy_tailed(10 * rng.normal(size=500))  # only the deviation is wrong
    assert not heavy_tailed(0.1 * rng.standard_t(3, size=2000))  # too small to matter
    assert not heavy_tailed(np.zeros(10))


def test_the_estimate_minimises_hubers_cost_over_the_dense_problem():
    r = recorded(3, n=60, share=0.05, size=20.0)
    n, step = len(r.time), 0.01
    found = fitted(r, {"mass.m": M, "spring.k": K, "damper.d": D, "offset.f": Free(0.0)}, W=0.3, settings=Settings(step=step))
    y = np.column_stack([r.outputs["x"], np.full(n, np.nan)])
    nothing = np.full(2, np.inf)
    task = truths.Task(
        plant=PLANT, knots=r.time, degree=2, time=r.time, u=r.inputs["F"], y=y, std=np.full((n, 2), STD), force_std=0.3,
        initial=np.zeros(2), initial_std=nothing,
    )  # fmt: skip
    dense = truths.splines(task)
    C = dense.rows(r.time)[:, 0] / STD
    z0 = r.outputs["x"] / STD
    # what is left of the dense information without the samples is that of the balances
    information = np.linalg.inv(dense.covariance)
    unit = 1 / np.sqrt(np.diag(information))
    P, h = information - C.T @ C, information @ dense.mean - C.T @ z0

    def cost(q):
        x, z = dense.mean + unit * q, z0 - C @ (dense.mean + unit * q)
        far = np.abs(z) > CORNER
        rho = np.where(far, CORNER * np.abs(z) - CORNER**2 / 2, z**2 / 2)
        slope = P @ x - h - C.T @ np.clip(z, -CORNER, CORNER)
        return 0.5 * x @ P @ x - h @ x + rho.sum(), unit * slope

    def curvature(q):
        inside = np.abs(z0 - C @ (dense.mean + unit * q)) <= CORNER
        return unit[:, None] * (P + C[inside].T @ C[inside]) * unit

    q = optimize.minimize(cost, np.zeros(len(unit)), jac=True, hess=curvature, method="trust-exact", options={"gtol": 1e-6}).x
    mean = dense.mean + unit * q
    table = found.estimates["run"]
    # the rounds stop where another one moves nothing by more than 0.02 of a deviation
    np.testing.assert_allclose(table["mass.s"], dense.rows(r.time)[:, 0] @ mean, atol=0.05 * float(table["mass.s.std"].min()))
    assert abs(found.parameters["offset.f"].value - mean[-1]) < 0.05 * found.parameters["offset.f"].std
    plain = np.abs(dense.rows(r.time)[:, 0] @ dense.mean - table["mass.s"].to_numpy()) / table["mass.s.std"]
    assert plain.max() > 3  # least squares is elsewhere


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["huber", "auto"])
@pytest.mark.parametrize("given", [True, False])
def test_one_percent_of_outliers_a_thousand_deviations_off_move_no_estimate_by_half_a_deviation(loss, given):
    clean = fitted(recorded(5, n=600, loss="square", given=given))
    s = fitted(recorded(5, n=600, share=0.01, loss=loss, given=given))
    for name in TRUE:
        assert abs(s.parameters[name].value - clean.parameters[name].value) < 0.5 * clean.parameters[name].std
    assert s.weights.V["x"] == pytest.approx(clean.weights.V["x"], rel=0.1)
    note = next(n for n in s.notes if n.startswith("Loss of x: huber"))
    off = np.flatnonzero(np.abs(recorded(5, n=600, share=0.01).outputs["x"] - recorded(5, n=600).outputs["x"]) > 0.5)
    assert f"{len(off)} of 600 samples lie beyond" in note
    assert any(f"t = {0.01 * k:.9g} s" in note for k in off)
    squares = fitted(recorded(5, n=600, share=0.01, loss="square"))
    assert max(abs(squares.parameters[n].value - clean.parameters[n].value) / clean.parameters[n].std for n in TRUE) > 5


def test_the_fit_is_told_without_the_outliers_that_the_loss_left_out_too():
    """They are known, and so are rows that belong to no piece: a single one between two gaps."""
    whole, clean = (recorded(5, share=share) for share in (0.01, 0.0))
    off = np.abs(whole.outputs["x"] - clean.outputs["x"]) > 0.5
    rows = np.r_[:100, 115, 130:300]
    r = replace(whole, time=whole.time[rows], inputs={"F": whole.inputs["F"][rows]}, outputs={"x": whole.outputs["x"][rows]}, gap=0.1)
    s = fitted(r)
    fit, told = s.fit["run"]["x"], ~off[rows] & (rows != 115)
    error = (s.estimates["run"]["x.measured"] - s.estimates["run"]["x"]).to_numpy()[told]
    assert fit.trimmed is not None
    assert fit.trimmed.outliers == np.count_nonzero(off[rows])
    assert fit.trimmed.rms == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-12)
    assert fit.trimmed.rms < 1.2 * STD < 0.1 * fit.rms
    assert fitted(recorded(5, loss="square")).fit["run"]["x"].trimmed is None


@pytest.mark.parametrize("given", [True, False])
def test_outliers_that_are_squared_are_named_with_the_remedy(given):
    s = fitted(recorded(3, share=0.01, loss="square", given=given))
    (note,) = [note for note in s.notes if "far off" in note]
    assert note.startswith("x: ")
    assert re.search(r"samples? stands? far off (its|their) neighbours? \(t = ", note)
    assert note.endswith('Give the output loss = "auto".')
    assert not any("far off" in note for note in fitted(recorded(3, loss="square", given=given)).notes)


def test_samples_that_are_off_together_need_not_be_far_off_each():
    """Forces that follow outliers promise large errors: each of these is one in a hundred then, and half of them are not by chance."""
    off, told = np.zeros(100, dtype=bool), np.random.default_rng(0).standard_normal(100)
    off[[3, 40, 41, 90]] = True
    assert not _unexpected(off, told).any()
    told[off] = [3.0, -2.8, 0.2, 4.0]
    assert np.array_equal(_unexpected(off, told), off)
    told[off] = [0.1, 0.3, -0.5, 9.0]
    assert np.flatnonzero(_unexpected(off, told)).tolist() == [90]
    assert np.array_equal(_unexpected(off, np.empty(0)), off)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("size", [50.0, 300.0])
def test_forces_do_not_follow_gross_outliers_where_few_samples_tell_how_large_they_are(seed, size):
    """Seven samples in every period of the drive: forces that follow the outliers have room for it once they are loose."""
    recording = recorded(seed, n=150, step=0.1, share=0.03, size=size)
    s = smooth(Problem(model=MODEL, recordings=[recording], parameters=FREE))
    assert s.weights.W["mass"] < 0.02
    assert not [note for note in s.notes if "mislead" in note]
    for name, true in TRUE.items():
        assert abs(s.parameters[name].value - true) < 3.0 * s.parameters[name].std, name


@pytest.mark.parametrize(("W", "followed"), [(1.0, False), (100.0, True)])
def test_outliers_that_forces_have_the_room_to_follow_are_said_to_mislead(W, followed):
    s = fitted(recorded(3, share=0.02, size=30.0), W=W, settings=Settings(marginal=False))
    (note,) = [note for note in s.notes if note.startswith("Loss of x")]
    assert ("bend the trajectory to them" in note) is followed
    assert ("Values and deviations mislead" in note) is followed
    assert "t = 1.22 s" in note


def test_without_outliers_auto_is_least_squares():
    auto, squares = fitted(recorded(5, loss="auto")), fitted(recorded(5, loss="square"))
    for name in TRUE:
        assert abs(auto.parameters[name].value - squares.parameters[name].value) < 0.05 * squares.parameters[name].std
        assert auto.parameters[name].std == pytest.approx(squares.parameters[name].std, rel=1e-3)
    assert any("squares" in note for note in auto.notes if note.startswith("Loss of x"))


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.1])
def test_deviations_grow_by_hubers_factor(share):
    """sqrt(((1 - e) b + e k^2)) / ((1 - e) a) of those of least squares on clean samples: 1.025 and 1.22."""
    a, b = 2 * stats.norm.cdf(CORNER) - 1, integrate.quad(lambda e: min(e**2, CORNER**2) * stats.norm.pdf(e), -12, 12)[0]
    factor = np.sqrt((1 - share) * b + share * CORNER**2) / ((1 - share) * a)
    clean, s = (fitted(recorded(1, n=1500, share=e, loss=loss), W=1e-5) for e, loss in ((0.0, "square"), (share, "huber")))
    # shares among 1500 samples are known to 1 percent or so, and with so small a W the samples alone count
    for name in TRUE:
        assert s.parameters[name].std / clean.parameters[name].std == pytest.approx(factor, rel=0.04)


@pytest.mark.long
@pytest.mark.slow
def test_over_twenty_four_contaminated_records_scores_have_unit_size():
    z = []
    for seed in range(24):
        s = fitted(recorded(seed, share=0.1, size=30.0))
        z.append([(s.parameters[n].value - v) / s.parameters[n].std for n, v in TRUE.items()])
    # the deviation of twenty-four scores is known to 15 %; four parameters within three of that
    size = np.std(z, axis=0)
    assert np.all((size > 0.56) & (size < 1.44)), size


def test_a_loss_that_there_is_not_is_refused():
    with pytest.raises(InputError, match=r'loss of output x is "student"; it must be'):
        recorded(0, loss="student")


def test_a_column_carries_its_loss_into_the_recording(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t,F,x\n" + "\n".join(f"{0.1 * k},{k % 2},{0.1 * k}" for k in range(10)) + "\n")
    r = Recording.read(path, time="t", inputs={"F": "F"}, outputs={"x": OutputColumn("x", loss="huber")})
    assert r.output_loss == {"x": "huber"}


@pytest.mark.parametrize("loss", ["huber", "auto"])
def test_where_plain_steps_do_not_arrive_exact_second_derivatives_lead_on(loss):
    """The rounds of weights begin with plain steps alone; that these stop at their limit is no answer yet."""
    r = recorded(3, share=0.05, loss=loss)
    usual, few = fitted(r), fitted(r, settings=Settings(options=Options(gauss_newton_iterations=1)))
    for name in FREE:
        assert few.parameters[name].value == pytest.approx(usual.parameters[name].value, abs=1e-2 * usual.parameters[name].std)
