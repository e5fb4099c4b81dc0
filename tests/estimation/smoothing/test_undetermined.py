"""What the recordings leave open is named; everything else keeps its deviation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import truths
from examples import OFFSET, D, K, M, compiled, lagged, on_mass, oscillator

from backsight.estimation import Free, Problem, Recording, Smoothing, Weights, smooth
from backsight.estimation.command.result_json import result_of_smoothing
from backsight.estimation.smoothing.notes import _on_structure
from backsight.estimation.smoothing.program import Settings
from backsight.estimation.smoothing.undetermined import _together, open_where_it_stopped
from backsight.models.mechanics.translational import Force, Spring
from backsight.ocp import Options

PLANT, STD = truths.Plant(m=M, d=D, k=K, offset=OFFSET), 1e-3
FREE = {"mass.m": Free(3.0), "spring.k": Free(30.0), "damper.d": Free(1.0), "offset.f": Free(0.0)}


def record(name: str = "run", seed: int = 0, plant: truths.Plant = PLANT, n: int = 300) -> Recording:
    rng = np.random.default_rng(seed)
    time, u = 0.01 * np.arange(n), 20 * np.repeat(rng.normal(size=n // 10 + 1), 10)[:n]
    y = truths.disturbed(plant, time, u, np.array([0.02, -0.1]), 0.1, rng) + STD * rng.normal(size=(n, 2))
    return Recording(name=name, time=time, inputs={"F": u}, outputs={"x": y[:, 0]}, output_std={"x": STD})


def fitted(free: dict, *recordings: Recording, W: float | None = 0.1) -> Smoothing:
    weights = Weights(W={} if W is None else {"mass": W})
    return smooth(Problem(model=compiled(oscillator()), recordings=list(recordings or [record()]), parameters=free, weights=weights))


@pytest.mark.parametrize("W", [0.1, 1e-9, None], ids=["soft", "rigid", "W from the data"])
def test_one_parameter_too_many_takes_the_deviations_of_none_but_its_partner(W):
    right, more = fitted(FREE, W=W), fitted({**FREE, "spring.s_rel0": Free(0.0)}, W=W)
    assert more.solver.converged
    for name in ("offset.f", "spring.s_rel0"):
        assert more.parameters[name].std is None
        assert more.parameters[name].identifiable is False
    for name in ("mass.m", "spring.k", "damper.d"):
        assert more.parameters[name].value == pytest.approx(right.parameters[name].value, abs=0.02 * right.parameters[name].std)
        assert more.parameters[name].std == pytest.approx(right.parameters[name].std, rel=0.01)
        assert more.parameters[name].identifiable
    a, b = right.estimates["run"], more.estimates["run"]
    # a force's deviation belongs to its interval, and meshes differ a little where W does
    for column in ("x.std", "mass.s.std", "mass.v.std", *(["residual.mass.std"] if W is not None else [])):
        np.testing.assert_allclose(b[column], a[column], rtol=0.02)


def test_the_note_names_what_cannot_be_told_apart_and_the_combination():
    s = fitted({**FREE, "spring.s_rel0": Free(0.0)})
    (note,) = [n for n in s.notes if "do not tell" in n]
    assert "offset.f and spring.s_rel0 apart" in note or "spring.s_rel0 and offset.f apart" in note
    # k (s - s_rel0) + offset: 1 N of the one is 1/k of the other
    k = s.parameters["spring.k"].value
    said = dict(part.split(" by ") for part in note.split("moving ")[1].split(" changes")[0].split(" and "))
    newton, metre = float(said["offset.f"].removesuffix(" N")), float(said["spring.s_rel0"].removesuffix(" m"))
    assert newton / metre == pytest.approx(k, rel=0.01)
    assert note.endswith("this takes nothing from the deviations of all others.")


def test_a_parameter_that_enters_nothing_is_named_alone():
    s = fitted({**FREE, "spring.k": 0.0, "spring.s_rel0": Free(0.0)}, record(plant=truths.Plant(m=M, d=D, k=0.0, offset=OFFSET)))
    assert any(n.startswith("The recordings do not determine spring.s_rel0. Fix") for n in s.notes)
    assert s.parameters["mass.m"].identifiable
    assert s.parameters["offset.f"].std is not None
    assert result_of_smoothing(s, command="smooth")["parameters"]["spring.s_rel0"]["std"] is None


@pytest.mark.slow
def test_a_position_that_no_output_shows_is_open_in_every_recording_and_the_parameters_are_not():
    plant = truths.Plant(m=M, d=D, k=0.0, offset=OFFSET)
    recordings = []
    for k in range(2):
        rng, n = np.random.default_rng(k), 300
        time, u = 0.01 * np.arange(n), 20 * np.repeat(rng.normal(size=n // 10 + 1), 10)[:n]
        v = truths.disturbed(plant, time, u, np.array([0.0, 0.1]), 0.1, rng)[:, 1] + 1e-2 * rng.normal(size=n)
        recordings.append(Recording(name=f"run {k}", time=time, inputs={"F": u}, outputs={"v": v}, output_std={"v": 1e-2}))
    free = {"spring.k": 0.0, "motor.T": 1e-3, "mass.m": Free(3.0), "damper.d": Free(1.0)}
    s = smooth(Problem(model=compiled(lagged()), recordings=recordings, parameters=free, weights=Weights(W={"mass": 0.1})))
    for name, true in (("mass.m", M), ("damper.d", D)):
        assert abs(s.parameters[name].value - true) < 3.5 * s.parameters[name].std
    for r in recordings:
        assert any(n.startswith(f"The recordings do not determine mass.s at the start of {r.name}.") for n in s.notes)
        table = s.estimates[r.name]
        assert np.isinf(table["mass.s.std"]).all()
        assert np.isfinite(table[["mass.v.std", "v.std", "residual.mass.std"]].to_numpy()).all()


def test_where_all_is_determined_there_is_no_such_note():
    assert not any("determine" in n or "do not tell" in n for n in fitted(FREE).notes)


def test_of_many_unknowns_that_move_together_a_few_are_named():
    """A speed alone does not tell where the spring rests: that, and the start of every recording, move together."""
    model = compiled(on_mass("speed_only", Force(), Spring(k=K), {"v": "speed.v"}))
    runs = [
        Recording(name=f"r{k}", time=r.time, inputs=r.inputs, outputs={"v": np.gradient(r.outputs["x"], 0.01)}, output_std={"v": 0.1})
        for k, r in enumerate(record(seed=k, n=60) for k in range(12))
    ]
    free = {"mass.m": Free(2.0), "spring.s_rel0": Free(0.0)}
    s = smooth(Problem(model=model, recordings=runs, parameters=free, weights=Weights(W={"mass": 0.1})))
    (note,) = [n for n in s.notes if "do not tell" in n]
    assert "spring.s_rel0" in note
    assert " and 7 more apart" in note  # thirteen in all
    assert note.count("mass.s at the start of") <= 12


def covariance_of(std: list[float], r: float) -> np.ndarray:
    """Of four parameters, the first two correlated with r."""
    correlation = np.eye(len(std))
    correlation[0, 1] = correlation[1, 0] = r
    return correlation * np.outer(std, std)


@pytest.mark.parametrize(
    ("covariance", "group"),
    [
        (covariance_of([0.9, 0.8, 0.01, 0.01], 0.17), None),  # two that are poorly told, each by itself
        (covariance_of([0.9, 0.8, 0.01, 0.01], 0.99), {0, 1}),
        (covariance_of([0.9, 0.01, 0.8, 0.01], 0.99), {0, 1}),
        (1e-6 * np.eye(4) + 0.5 * np.outer([1, 1, 0.09, 0], [1, 1, 0.09, 0]), {0, 1, 2}),  # the third moves little, and must
        (np.eye(4) - 0.249999 * np.ones((4, 4)), {0, 1, 2, 3}),  # only their sum is told
    ],
)
def test_together_are_those_of_which_one_is_poorly_told_for_the_others_sake(covariance, group):
    found = _together(np.linalg.pinv(covariance, hermitian=True), 0)
    assert found is None if group is None else set(found) == group
    if found is not None:  # what is said to move changes next to nothing with all the rest held
        information = np.linalg.pinv(covariance, hermitian=True)
        step = np.zeros(4)
        along = np.linalg.inv(information[np.ix_(found, found)])[:, 0]
        step[found] = 0.5 * along / np.abs(along).max()
        assert step @ information @ step < 3.0


@pytest.mark.parametrize("more", [True, False])
def test_what_no_recording_could_tell_is_said_where_a_solve_does_not_arrive(more):
    free = {**FREE, "spring.s_rel0": Free(0.0)} if more else FREE
    told = _on_structure(Problem(model=compiled(oscillator()), recordings=[record()], parameters=free))
    assert len(told) == more
    if told:
        assert told[0].startswith("No recording of x can tell all that is free")
        assert {"offset.f", "spring.s_rel0"} <= set(told[0].replace(",", " ").replace("*", " ").replace(";", " ").split())
        assert "mass.m" not in told[0]


def of_one_frequency(w: float) -> Problem:
    """A force of one frequency, long after the start: of mass and spring it tells k - m w^2."""
    rng, time = np.random.default_rng(0), 0.01 * np.arange(800)
    u = 20 * np.sin(w * time)
    y = truths.disturbed(PLANT, time, u, np.array([0.02, -0.1]), 0.1, rng)[:, 0] + STD * rng.normal(size=len(time))
    late = time >= 4.0
    run = Recording(name="run", time=time[late], inputs={"F": u[late]}, outputs={"x": y[late]}, output_std={"x": STD})
    return Problem(model=compiled(oscillator()), recordings=[run], parameters=FREE, weights=Weights(W={"mass": 10.0}))


def test_a_solve_that_did_not_arrive_says_from_its_last_iterate_what_trades_off():
    stopped = smooth(of_one_frequency(7.0), settings=Settings(options=Options(gauss_newton_iterations=1, max_iterations=1)))
    assert not stopped.solver.converged
    (note,) = [n for n in stopped.notes if "apart" in n]
    assert note.startswith("At the last iterate, which is no estimate, the recordings hardly tell")
    said = dict(part.split(" by ") for part in note.split("moving ")[1].split(" changes")[0].replace(" and ", ", ").split(", "))
    assert set(said) == {"mass.m", "spring.k"}
    kilogram, newton = float(said["mass.m"].removesuffix(" kg")), float(said["spring.k"].removesuffix(" N/m"))
    assert newton / kilogram == pytest.approx(7.0**2, rel=0.03)
    assert "takes nothing" not in note
    arrived = smooth(of_one_frequency(7.0))
    assert arrived.solver.converged
    assert any(n.startswith("The recordings hardly tell") for n in arrived.notes)
    assert stopped.solution is not None
    posed, lost = of_one_frequency(7.0).posed, {"run": {"x": replace(stopped.fit["run"]["x"], fit_percent=20.0)}}
    assert open_where_it_stopped(posed, stopped.solution, None, stopped.fit) == [note]
    assert open_where_it_stopped(posed, stopped.solution, None, lost) == []  # it does not follow the samples
