"""Weights that the user wants to see turned: the path of one, the grid of several, and what is no such thing."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from shaken import PLANT, STD, TRUE, driven, simulated

from backsight.estimation import Free, Problem, Recording, Weighing, Weights, weigh
from backsight.estimation.command.output import json_text
from backsight.estimation.command.result_json import result_of_weighing
from backsight.estimation.report import balance_chart, grid_chart, parameter_chart, write_weighing_report
from backsight.estimation.weighing.chosen import MOST, chains, checked, grid, labels_of
from backsight.estimation.weighing.estimated import opened
from backsight.estimation.weighing.setting import Setting
from backsight.estimation.weighing.turned import Weight
from backsight.models.errors import InputError

W, V = "W of mass", "V of x"
WEIGHTS = [
    Weight(name="mass", kind="W", std=1.0, unit="N", row=0),
    Weight(name="x", kind="V", std=1.0, unit="m", row=0),
    Weight(name="spring.k", kind="drift", std=1.0, unit="N/m", row=1),
]


def problem() -> Problem:
    """A run of the oscillator and another held out, its spring to be found."""
    runs = []
    for seed, role in ((11, "fit"), (12, "held_out")):
        time, u = driven(200)
        runs.append(Recording(name=role, time=time, inputs={"F": u}, outputs={"x": simulated(seed)}, output_std={"x": STD}, role=role))
    return Problem(model=PLANT, recordings=runs, parameters=TRUE | {"spring.k": Free(30.0)})


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("kept")


@pytest.fixture(scope="module")
def path(kept: Path) -> Weighing:
    return weigh(problem(), vary={W: [10, 0.03, 1, 0.1, 0.03]}, keep=kept)


def test_one_weight_gives_a_path_through_what_the_study_has_anyhow(path):
    chosen = [o for o in path.outcomes if o.setting.group == "chosen"]
    assert path.varied == {W: (0.03, 0.1, 1.0, 10.0)}
    assert sorted(o.setting.factor for o in chosen) == [0.03, 0.1, 1.0, 10.0]
    assert all(o.converged and o.setting.varied == W for o in chosen)
    by_name = {o.setting.name: o for o in path.outcomes}
    assert len(by_name) == len(path.outcomes)
    for o in chosen:
        assert o.weights[W] == pytest.approx(o.setting.factor * by_name["greatest likelihood"].weights[W], rel=1e-5)
        assert o.weights[V] == by_name["greatest likelihood"].weights[V]
    assert by_name[f"chosen: {W} x 0.1"].log_likelihood == by_name["W x 0.1"].log_likelihood
    assert by_name[f"chosen: {W} x 1"].parameters == by_name["greatest likelihood"].parameters


def test_the_path_is_drawn_with_its_bands(path):
    chart = parameter_chart(path, "chosen")
    assert chart is not None
    assert chart.layout["xaxis"]["title"]["text"].startswith(f"log10 factor on {W}")
    assert chart.figure().data[1].x == pytest.approx(np.log10([0.03, 0.1, 1.0, 10.0]), rel=1e-6)
    assert grid_chart(path) is None


def test_two_weights_give_a_grid_and_nothing_else_is_another(path, kept, tmp_path):
    """In the folder of the study with the path: the rest of it is there already, and only what is new is solved."""
    vary, said, before = {W: [0.5, 1, 2], V: np.array([1.0, 0.25])}, list[str](), set(kept.iterdir())
    study = weigh(problem(), vary=vary, keep=kept, progress=said.append)
    rest = [o for o in study.outcomes if o.setting.group != "chosen"]
    assert rest == [o for o in path.outcomes if o.setting.group != "chosen"]
    chosen = {o.setting.name: o for o in study.outcomes if o.setting.group == "chosen"}
    assert chosen.keys() == grid(study.varied).keys() == {f"chosen: {W} x {w}, {V} x {v}" for w in ("0.5", "1", "2") for v in ("0.25", "1")}
    assert len(set(kept.iterdir()) - before) == 5  # one of the six is the greatest likelihood
    every = len({o.setting.theta for o in study.outcomes})
    assert [s for s in said if s.startswith("setting")][:: every - 5] == [f"setting {every - 5} of {every}"]
    assert said.count(f"setting {every} of {every}") == 1
    best = next(o for o in study.outcomes if o.setting.name == "greatest likelihood")
    for name, (w, v) in grid(study.varied).items():
        assert chosen[name].weights == pytest.approx({W: w * best.weights[W], V: v * best.weights[V]}, rel=1e-5)
        assert chosen[name].log_likelihood <= best.log_likelihood + 0.01
    chart = grid_chart(study)
    assert chart is not None
    (trace,) = chart.figure().data
    assert list(trace.x) == [f"{V} x 0.25", f"{V} x 1"]
    assert list(trace.y) == [f"{W} x 0.5", f"{W} x 1", f"{W} x 2"]
    gained = chosen[f"chosen: {W} x 2, {V} x 0.25"].held_out - study.best.held_out
    assert trace.z[2][0] == pytest.approx(np.clip(gained, -10, 10), abs=1e-3)
    assert trace.text[2][0] == f"{gained:.3g}"
    assert "held out" in chart.caption
    assert parameter_chart(study, "chosen") is None
    rows = {row["name"]: row for row in json.loads(json_text(result_of_weighing(study)))["study"]}
    assert rows[f"chosen: {W} x 2, {V} x 0.25"]["factors"] == {W: 2.0, V: 0.25}
    assert rows[f"chosen: {W} x 2, {V} x 0.25"]["group"] == "chosen"
    assert "factors" not in rows["W x 0.1"]
    write_weighing_report(study, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert 'data-chart="chosen_weights"' in page
    assert f"chosen: {W} x 2, {V} x 0.25" in page
    balances = balance_chart(study)
    assert balances is not None
    assert f"chosen: {W} x 2, {V} x 0.25" in balances.data[0]["x"]


def test_every_setting_of_a_chain_is_one_step_from_the_one_before():
    vary = checked({"V of x": [0.1, 0.3, 1, 3, 10], "W of mass": [0.1, 0.5, 2, 4], "drift of spring.k": [1, 2, 5]})
    about = np.array([0.2, -0.1, 0.3])
    found = chains(vary, WEIGHTS, about)
    steps = [sorted([0.1, 0.3, 1, 3, 10]), sorted([0.1, 0.5, 2, 4]), [1, 2, 5]]
    names = [s.name for chain in found for s in chain]
    assert sorted(names) == sorted(grid(vary))
    assert len(names) == 60
    assert sorted(map(len, found)) == [6, 6, 12, 12, 12, 12]  # of each quarter 12 or 18
    quarters = list[list[Setting]]()
    for chain in found:  # the rest of a quarter goes on where its first settings ended
        quarters = [*quarters[:-1], [*quarters[-1], *chain]] if len(chain) == 6 else [*quarters, chain]
    assert len(quarters) == 4
    for chain in quarters:
        at = [[steps[k].index(pytest.approx(f)) for k, f in enumerate(grid(vary)[s.name])] for s in chain]
        assert all(np.abs(np.subtract(one, other)).sum() == 1 for one, other in pairwise(at))
        sizes = [np.abs(np.array(s.theta) - about).max() for s in chain]
        assert sizes[0] == min(sizes)
        for s in chain:
            v, w, drift = grid(vary)[s.name]
            assert s.theta == pytest.approx(about + np.log([w, v, drift]), abs=1e-6)


def test_an_interruption_loses_no_more_than_a_chain_of_a_long_path():
    found = chains(checked({"V of x": np.geomspace(1e-3, 1e3, 399)}), WEIGHTS, np.zeros(3))
    assert sum(map(len, found)) == 399
    assert max(map(len, found)) <= 12


@pytest.mark.parametrize(
    ("vary", "words"),
    [
        ("W of mass", ["vary is a str", "W of carriage"]),
        ({W: "0.1,1"}, ["'W of mass' = '0.1,1'", "list"]),
        ({W: 3.0}, ["'W of mass' = 3.0", "list"]),
        ({W: []}, ["'W of mass' = []", "no factor"]),
        ({W: [1, 0.0]}, ["'W of mass'", "factor 0", "positive"]),
        ({W: [-2.0]}, ["'W of mass'", "factor -2", "positive"]),
        ({W: [float("nan")]}, ["'W of mass'", "factor nan", "finite"]),
        ({W: [float("inf")]}, ["'W of mass'", "factor inf", "finite"]),
        ({W: [1e9]}, ["'W of mass'", "factor 1e+09", "1e+06"]),
        ({W: ["ten"]}, ["'W of mass'", "'ten'", "number"]),
        ({W: [True]}, ["'W of mass'", "True", "number"]),
        ({W: range(1, 22), V: range(1, 21)}, ["21 x 20 = 420", str(MOST)]),
        ({"W of spring": [1.0]}, ["'W of spring'", "did you mean 'W of mass'?"]),
        ({"drift": [1.0]}, ["'drift'", "known: W of mass, V of x"]),
        ({"mass": [1.0]}, ["'mass'", "'W of mass'"]),
    ],
)
def test_what_cannot_be_turned_is_said_before_anything_is_solved(vary, words):
    said = list[str]()
    with pytest.raises(InputError) as error:
        weigh(problem(), vary=vary, progress=said.append)
    assert all(word in str(error.value) for word in words), str(error.value)
    assert not said


def test_the_labels_that_may_be_named_are_known_before_anything_is_solved():
    parameters = TRUE | {"spring.k": Free(60.0, std=1.0), "offset.f": Free(0.5, drift=0.3)}
    posed = opened(Problem(model=PLANT, recordings=problem().recordings, parameters=parameters, weights=Weights(V={"F": 1.0}))).posed
    assert sorted(labels_of(posed)) == sorted([W, V, "V of F", "drift of offset.f", "prior of the parameters"])


@pytest.mark.slow
def test_drift_a_measured_input_and_priors_are_turned_by_their_labels():
    parameters = TRUE | {"spring.k": Free(60.0, std=30.0), "offset.f": Free(0.5, drift=0.3)}
    asked = Problem(model=PLANT, recordings=problem().recordings, parameters=parameters, weights=Weights(V={"F": 1.0}))
    study = weigh(asked, vary={"drift of offset.f": [0.5, 1], "prior of the parameters": [1, 2], "V of F": [1, 1.5]})
    assert sum(o.setting.group == "chosen" and o.converged for o in study.outcomes) == 8
    chart = grid_chart(study)
    assert chart is not None
    assert chart.data[0]["y"][1] == "drift of offset.f x 0.5, prior of the parameters x 2"
    assert chart.data[0]["x"] == ["V of F x 1", "V of F x 1.5"]
