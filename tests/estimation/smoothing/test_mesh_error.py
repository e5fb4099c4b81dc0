"""The mesh's own error: seen where it matters, and mended."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import truths
from examples import OFFSET, D, K, M, compiled, oscillator

from backsight.estimation import Free, Problem, Recording, Smoothing, Weights, smooth
from backsight.estimation.smoothing import mesh_error, work
from backsight.estimation.smoothing import start as begun
from backsight.estimation.smoothing.smoother import Settings
from backsight.ocp import Horizon, Mesh, ParameterPrior, Solution, Solved, Solver, Status, transcribe

PLANT, MODEL = truths.Plant(m=M, d=D, k=K, offset=OFFSET), compiled(oscillator())
TRUE = {"mass.m": M, "spring.k": K, "damper.d": D}
FREE = {"mass.m": Free(3.0), "spring.k": Free(30.0), "damper.d": Free(1.0)}


def rigid(n: int = 1000, std: float = 1e-5, dt: float = 0.02) -> tuple[Recording, np.ndarray]:
    """No residual force, and a sensor much finer than what a mesh of the plant's own speed can follow."""
    rng = np.random.default_rng(1)
    time, u = dt * np.arange(n), 20 * np.repeat(rng.normal(size=n // 10 + 1), 10)[:n]
    x = truths.motion(PLANT, time, u, np.array([0.02, -0.1]))
    y = x[:, 0] + std * rng.normal(size=n)
    return Recording(name="run", time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": std}), x


def fitted(recording: Recording, W: float | None, **more) -> Smoothing:
    weights = Weights(W={} if W is None else {"mass": W})
    return smooth(Problem(model=MODEL, recordings=[recording], parameters=FREE, weights=weights), **more)


def scores(s: Smoothing) -> np.ndarray:
    return np.array([(s.parameters[n].value - v) / s.parameters[n].std for n, v in TRUE.items()])


@pytest.mark.slow
@pytest.mark.parametrize("W", [1e-5, None], ids=["rigid W", "W from the data"])
def test_a_mesh_too_coarse_for_rigid_weights_is_refined_until_the_deviations_hold(W, monkeypatch):
    recording, x = rigid()
    s = fitted(recording, W)
    assert np.all(np.abs(scores(s)) < 3.5)
    assert np.sqrt(np.mean((s.estimates["run"]["x"] - x[:, 0]) ** 2)) < 0.35e-5
    assert not any("The mesh itself" in note for note in s.notes)
    monkeypatch.setattr(mesh_error, "HALVINGS", 0)
    coarse = fitted(recording, W)
    if W is not None:
        assert np.abs(scores(coarse)).max() > 10  # the check can fail: without refinement it does


def test_a_mesh_that_was_asked_for_stays_and_a_note_tells_its_error():
    recording, x = rigid()
    s = fitted(recording, 1e-5, settings=Settings(step=0.1))
    (note,) = [n for n in s.notes if n.startswith("The mesh itself moves x by about ")]
    told = float(note.removeprefix("The mesh itself moves x by about ").split()[0])
    true = float(np.sqrt(np.mean((s.estimates["run"]["x"] - x[:, 0]) ** 2))) / 1e-5
    # a residual force that is free to bend hides a part of it
    assert told > 0.1
    assert true / 3 < told < 3 * true


def test_where_a_second_look_would_cost_too_much_the_mesh_is_not_called_fine(monkeypatch):
    recording, _ = rigid(std=1e-3)
    monkeypatch.setattr(mesh_error, "UNRESOLVED", 0.0)
    monkeypatch.setattr(mesh_error, "MOST_INTERVALS", 10)
    s = fitted(recording, 0.3)
    assert any("was not measured (it would take more than 10 intervals)" in note for note in s.notes)


def test_with_room_for_the_forces_nothing_is_solved_twice():
    recording, _ = rigid(std=1e-3)
    told: list[str] = []
    fitted(recording, 0.3, progress=told.append)
    assert not any("looking again" in line for line in told)


def test_the_first_moment_left_out_is_that_of_a_known_residual():
    """A mass that is told to move as s = t^4 under no force: m s'' = 12 m t^2, whose moment with L_2 on (0, h) is 12 m h^2/(6 sqrt 5)."""
    h, std = 0.4, 0.7
    time = np.array([0.0, h])
    empty = np.zeros((2, 1))
    horizon = Horizon(
        mesh=Mesh(time), time=time, inputs=empty, target=empty, target_std=empty + 1, initial=np.zeros(2), initial_std=np.ones(2)
    )
    nothing = ParameterPrior(mean=np.empty(0), std=np.empty(0))
    t = transcribe(MODEL, [horizon], free=(), prior=nothing, force_std={0: std}, degree=3)
    fixed = {"spring.k": 0.0, "damper.d": 0.0, "offset.f": 0.0}
    values = t.nlp.values(np.array([fixed.get(p.name, p.value) for p in MODEL.parameters]))
    # degree 3: positions are polynomials of degree 4, x = (s, v) at both ends and one bubble; found by least squares on the whole
    tau = np.linspace(0, 1, 20)
    basis = t.nlp.interpolation.values(tau, np.full(20, h))
    T = t.nlp.interpolation.matrix(basis)[:, 2]
    local = np.linalg.lstsq(T, (h * tau) ** 4, rcond=None)[0]
    solved = Solved(decisions=local, cost=0.0, multipliers=np.empty(0), status=Status.SOLVED, iterations=0, seconds=0.0)
    solution = Solution(transcription=t, solver=Solver(t.nlp), values=values, solved=solved)
    # with K = 3 the third moment, of L_3, is that of nothing: 12 m t^2 is of degree 2
    assert mesh_error.unresolved_moment(solution) == pytest.approx(0.0, abs=1e-9)
    lower = replace(solution, transcription=replace(t, degree=2))
    assert mesh_error.unresolved_moment(lower) == pytest.approx(12 * M * h**2 / (6 * np.sqrt(5)) * np.sqrt(h) / std, rel=1e-9)


def test_a_first_weight_far_too_small_gets_a_second_mesh_and_does_no_harm(monkeypatch):
    rng, n = np.random.default_rng(0), 400
    time, u = 0.01 * np.arange(n), 20 * np.repeat(rng.normal(size=n // 10 + 1), 10)[:n]
    y = truths.disturbed(PLANT, time, u, np.array([0.02, -0.1]), 3.0, rng)[:, 0] + 1e-4 * rng.normal(size=n)
    recording = Recording(name="run", time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": 1e-4})
    usual = fitted(recording, None)
    assert not any("chosen anew" in note for note in usual.notes)
    first = begun.approach
    monkeypatch.setattr(begun, "approach", lambda *a: replace(first(*a), force_std={0: 1e-3}))
    monkeypatch.setattr(work.Work, "roughly", lambda *_: None)
    s = fitted(recording, None)
    assert any("the mesh was chosen anew" in note for note in s.notes)
    assert s.solver.variables > 0.7 * usual.solver.variables
    assert s.weights.W["mass"] == pytest.approx(usual.weights.W["mass"], rel=0.15)
    for name in TRUE:
        assert abs(s.parameters[name].value - usual.parameters[name].value) < 0.3 * usual.parameters[name].std


def test_the_noise_that_is_told_is_the_one_in_force_however_often_the_mesh_was_made_finer(monkeypatch):
    monkeypatch.setattr(mesh_error, "UNRESOLVED", 0.0)
    monkeypatch.setattr(mesh_error, "LEFT", 0.0)  # every halving is solved to the end
    monkeypatch.setattr(work.Work, "roughly", lambda *_: None)  # so that the last factor is far from one
    rng, n = np.random.default_rng(0), 300
    time, u = 0.01 * np.arange(n), 20 * np.repeat(rng.normal(size=n // 10 + 1), 10)[:n]
    y = truths.disturbed(PLANT, time, u, np.array([0.02, -0.1]), 0.1, rng)[:, 0] + 1e-3 * rng.normal(size=n)
    s = fitted(Recording(name="run", time=time, inputs={"F": u}, outputs={"x": y}), 1e-2)
    scale = s.solution.values.scale[s.solution.term("samples")]
    assert s.weights.V["x"] == pytest.approx(1.0 / scale[0, 0], rel=1e-9)
    # W is far too small, so that the noise takes what the forces do
    assert s.weights.V["x"] > 1.2e-3
    assert s.fit["run"]["x"].rms == pytest.approx(s.weights.V["x"], rel=0.05)
