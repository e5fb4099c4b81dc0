"""A force that nothing explains is told of where the recordings need it, and not where they are as likely without."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import pytest
from concealed_axis import LEFT, posed, run

from backsight.estimation import Weights, smooth
from backsight.estimation.diagnosis.fits import Fits
from backsight.estimation.diagnosis.keep import Keep
from backsight.estimation.diagnosis.refit import QUICKLY
from backsight.estimation.diagnosis.search import Search
from backsight.estimation.diagnosis.shares import FLOOR
from backsight.estimation.smoothing.begun import force_stds


@pytest.fixture(scope="module")
def search() -> Search:
    """An axis with a white force of LEFT [N sqrt(s)], its weight from the data; the time of the search is over."""
    problem = replace(posed(run(1.0, 2e-3)), weights=Weights())
    fits = Fits(pool=ThreadPoolExecutor(1), ahead=1, kept=Keep(None, problem), say=lambda _: None, end=0.0)
    return Search(problem=problem, model=problem.model, result=smooth(problem, settings=QUICKLY), fits=fits)


def test_its_weight_is_that_of_the_force(search: Search) -> None:
    assert search.result.solution is not None
    assert force_stds(search.result.solution)["carriage"] == pytest.approx(LEFT, rel=0.3)


@pytest.mark.parametrize(("less", "needed"), [(1.02, False), (8.0, True), (100.0, True)])
def test_recordings_need_it_where_they_are_less_likely_with_so_many_times_less(search: Search, less: float, needed: bool) -> None:
    assert search._needed("carriage", less * FLOOR / 2) is needed


@pytest.mark.parametrize("needed", [True, False])
def test_it_becomes_a_finding_or_a_note(search: Search, needed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    search.findings, search.notes = [], []
    monkeypatch.setattr(Search, "_needed", lambda *_: needed)
    search._unexplained(SimpleNamespace(left={"carriage": 2 * FLOOR}))  # type: ignore[arg-type]
    assert [f.explanation.place for f in search.findings] == ["carriage"] * needed
    assert [note.partition(":")[0] for note in search.notes] == ["Left over at carriage"] * (not needed)
