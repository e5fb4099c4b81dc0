"""A kept part of a diagnosis is found again by what it hangs on, and by nothing else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from backsight.estimation import Free, Known, Problem, Recording, Weights
from backsight.estimation.diagnosis.search import keep
from backsight.estimation.diagnosis.search.keep import Keep
from backsight.estimation.recordings.drive import Drive
from backsight.models.plants import actuator

TIME = 0.01 * np.arange(50)


def posed(**recording: object) -> Problem:
    log = Recording(name="run", time=TIME, inputs={"F": np.sin(TIME)}, outputs={"x": TIME**2}, output_std={"x": 1e-5})
    return Problem(model=actuator(), recordings=[replace(log, **recording)], parameters={"carriage.m": Free(90.0)})


def named(problem: Problem) -> str:
    return Keep(Path("somewhere"), problem).name("base")


def test_the_same_problem_has_the_same_name_and_any_other_has_another(monkeypatch):
    problem, own = posed(), named(posed())
    assert named(problem) == own
    others = [
        posed(output_loss={"x": "huber"}),
        posed(gap=0.05),
        posed(output_std={"x": 2e-5}),
        posed(outputs={"x": TIME**3}),
        posed(limits={"F": (-2.0, 2.0)}),
        posed(drive=Drive(TIME[::2], {"F": np.sin(TIME[::2])})),
        posed(hold="linear"),
        replace(problem, parameters={"carriage.m": Free(90.0, std=1.0)}),
        replace(problem, parameters={"carriage.m": Free(90.0), "friction.d": 1.0}),
        replace(problem, weights=Weights(W={"carriage": 1.0})),
        replace(problem, initial={"carriage.v": Known(0.0, 0.1)}),
        replace(problem, bounds={"carriage.v": (-9.0, 9.0)}),
    ]
    names = [named(other) for other in others]
    assert len({own, *names}) == 1 + len(others)
    monkeypatch.setattr(keep, "code_of", lambda *_: "another code")
    assert named(problem) != own


def test_what_is_kept_is_there_again_and_what_cannot_be_read_is_not(tmp_path):
    kept = Keep(tmp_path / "parts", posed())
    name = kept.name("base")
    assert kept.get(name) is None
    kept.put(name, {"a": 1})
    assert kept.get(name) == {"a": 1}
    (path,) = (tmp_path / "parts").iterdir()
    path.write_bytes(path.read_bytes()[:-3])
    assert kept.get(name) is None


@pytest.mark.parametrize("what", ["base", "fit"])
def test_without_a_folder_nothing_is_kept(what):
    nothing = Keep(None, posed())
    nothing.put(nothing.name(what), 1)
    assert nothing.get(nothing.name(what)) is None
