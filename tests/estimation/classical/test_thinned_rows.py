"""Rows thinned out by `every`, between which the inputs act as recorded: every method against the exact motion under all of them."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest
import truths
from examples import OFFSET, D, K, M, compiled, oscillator
from scipy.linalg import expm

from backsight.estimation import Free, Problem, Recording
from backsight.estimation.classical import (
    Orders,
    armax,
    filtered_least_squares,
    harmonic,
    multiple_models,
    prediction_error,
    recursive_armax,
    state_variable_filter,
    two_stage,
    zoh_prediction_error,
)
from backsight.models.errors import InputError

OSCILLATOR, PLANT = compiled(oscillator()), truths.Plant(m=M, d=D, k=K, offset=OFFSET)
TRUE = {"mass.m": M, "spring.k": K, "damper.d": D, "offset.f": OFFSET}
FREE = {"mass.m": Free(2.2), "spring.k": Free(45.0), "damper.d": Free(1.2), "offset.f": Free(0.5)}
STEP, EVERY = 1e-3, 20


def force(n: int) -> np.ndarray:
    """A sweep of blocks, and beyond what the thinned rows can follow a square wave that is always up where one is."""
    k = np.arange(n)
    return 20 * np.sign(np.sin(2 * np.pi * 0.9 * STEP * k * (1 + 0.1 * STEP * k))) + 15 * np.where(k % EVERY < EVERY // 2, 1.0, -1.0)


def moved(u: np.ndarray, hold: str) -> np.ndarray:
    """Positions (n,) from rest under u (n,), held or joined by straight lines: x, u and its slope by one matrix exponential."""
    A, B, _ = PLANT.matrices
    slope = np.array([[0.0, 1.0 / STEP], [0.0, 0.0]])
    phi = expm(STEP * np.block([[A, B[:, :1], np.zeros((2, 1))], [np.zeros((2, 2)), slope]]))
    push, x, y = truths.discrete(A, B, STEP)[1][:, 1], np.zeros(2), np.empty(len(u))
    rise = np.append(np.diff(u), 0.0) if hold == "linear" else np.zeros(len(u))
    for k in range(len(u)):
        y[k] = x[0]
        x = phi[:2, :2] @ x + phi[:2, 2] * u[k] + phi[:2, 3] * rise[k] + push
    return y


def written(folder: Path, columns: dict[str, np.ndarray], **options: object) -> Recording:
    lines = [",".join(columns), *(",".join(repr(float(v)) for v in row) for row in zip(*columns.values(), strict=True))]
    (folder / "run.csv").write_text("\n".join(lines) + "\n")
    inputs = {name: name for name in columns if name not in ("t", "x")}
    return Recording.read(folder / "run.csv", time="t", inputs=inputs, outputs={"x": "x"}, **{"every": EVERY, **options})


def thinned(folder: Path, u: np.ndarray, hold: str = "zero") -> Recording:
    noise = 1e-5 * np.random.default_rng(0).normal(size=len(u))
    return written(folder, {"t": STEP * np.arange(len(u)), "F": u, "x": moved(u, hold) + noise}, hold=hold)


@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_what_simulates_does_so_under_the_inputs_as_they_acted(tmp_path, hold):
    run = thinned(tmp_path, force(2500), hold)
    found = prediction_error(Problem(model=OSCILLATOR, recordings=[run], parameters=FREE))
    for name, true in TRUE.items():
        assert abs(found.parameters[name].value - true) < 5 * found.parameters[name].std < 5e-3
    assert found.fit["run.csv"]["x"].rms == pytest.approx(1e-5, rel=0.15)


@pytest.mark.parametrize("method", [filtered_least_squares, state_variable_filter])
@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_filters_take_the_mean_that_acted(tmp_path, method, hold):
    """At the rows the wave adds 15 N, which would be seen as an offset."""
    found = method(Problem(model=OSCILLATOR, recordings=[thinned(tmp_path, force(10000), hold)], parameters=FREE), cutoff=4.0)
    for name, true in TRUE.items():
        assert found.parameters[name].value == pytest.approx(true, rel=0.03, abs=0.1)
    assert found.fit["run.csv"]["x"].rms < 2e-3


def test_harmonics_of_an_input_are_those_on_its_own_clock(tmp_path):
    """Of 10 periods of 2 s, after 30 s in which it settles: the force's harmonics 1, 3, 5, and a square wave of the rows' own frequency."""
    w, k, steady = np.pi, np.arange(50000), slice(30000, None)
    u = sum(20 / i * np.cos(i * w * STEP * k) for i in (1, 3, 5)) + 15 * np.where(k % EVERY < EVERY // 2, 1.0, -1.0)
    run = written(tmp_path, {"t": STEP * k[steady], "F": u[steady], "x": moved(u, "zero")[steady]})
    found = harmonic(Problem(model=OSCILLATOR, recordings=[run], parameters=FREE), frequency=w, harmonics=7, motion_harmonics=7)
    for name, true in TRUE.items():
        assert found.parameters[name].value == pytest.approx(true, rel=2e-3)


def test_difference_equations_take_the_mean_that_acted(tmp_path):
    """The gain of a first-order lag at rest, sum b / (1 + a) = 1: of values at the rows, where the wave is always up, it is another."""
    n = 20000
    k, rng = np.arange(n), np.random.default_rng(1)
    slow = np.repeat(rng.normal(size=n // 400), 400)
    u = slow * (1.0 + np.where(k % EVERY < EVERY // 2, 1.0, -1.0))
    y, a = np.zeros(n), np.exp(-STEP / 0.1)
    for i in range(n - 1):
        y[i + 1] = a * y[i] + (1 - a) * u[i]
    run = written(tmp_path, {"t": STEP * k, "F": u, "x": y})
    orders = Orders(na=1, nb=1)
    still = armax(run, output="x", orders=orders).theta
    wandering = recursive_armax(run, output="x", orders=orders).theta[-1]
    for a_1, b_1 in (still, wandering):
        assert b_1 / (1 + a_1) == pytest.approx(1.0, rel=0.1)
        assert -a_1 == pytest.approx(a**EVERY, rel=0.01)


@pytest.mark.parametrize(
    "method",
    [zoh_prediction_error, partial(multiple_models, modes={"still": {}, "moving": {"mass.v": 0.1}}, dwell=1.0)],
)
def test_methods_that_hold_inputs_over_a_step_refuse_those_that_change_meanwhile(tmp_path, method):
    with pytest.raises(
        InputError, match=r"run\.csv: .* recorded every 0\.001 s and change between rows 0\.02 s apart; read it with every = 1"
    ):
        method(Problem(model=OSCILLATOR, recordings=[thinned(tmp_path, force(1000))], parameters=FREE))


def test_inputs_that_stay_from_row_to_row_are_held_whatever_their_clock(tmp_path):
    run = thinned(tmp_path, np.repeat(20 * np.random.default_rng(3).normal(size=200), EVERY))
    found = zoh_prediction_error(Problem(model=OSCILLATOR, recordings=[run], parameters=FREE), noise="none")
    for name, true in TRUE.items():
        assert abs(found.parameters[name].value - true) < 5 * found.parameters[name].std < 1e-2


def test_the_first_of_two_stages_is_on_the_clock_of_the_inputs(tmp_path):
    """F follows the reference within three samples; between the rows the second stage has the input that the reference explains."""
    n = 2500
    r = force(n)
    u = np.convolve(r, [0.0, 0.5, 0.3, 0.2])[:n] + 0.5 * np.random.default_rng(2).normal(size=n)
    run = written(tmp_path, {"t": STEP * np.arange(n), "F": u, "r": r, "x": moved(u, "zero")})
    found = two_stage(Problem(model=OSCILLATOR, recordings=[run], parameters=FREE), references=["r"], order=20)
    for name, true in TRUE.items():
        assert found.parameters[name].value == pytest.approx(true, rel=0.01, abs=0.02)
    explained = float(found.notes[0].split("F of run.csv ")[1].split(" %")[0])
    assert explained == pytest.approx(100 * (1 - 0.25 / np.var(u)), abs=0.1)
