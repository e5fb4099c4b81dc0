"""A force that nothing explains is told of where the recordings need it, and not where they are as likely without."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from concealed_axis import LEFT, Force, posed, run
from diagnoses import diagnosis as found
from diagnoses import proof

from backsight.estimation import Weights, smooth
from backsight.estimation.diagnosis.answer.words import withdrawn
from backsight.estimation.diagnosis.scores.lasting import lasting
from backsight.estimation.diagnosis.scores.score import Linearised
from backsight.estimation.diagnosis.scores.shares import FLOOR
from backsight.estimation.diagnosis.search.fits import Fits
from backsight.estimation.diagnosis.search.keep import Keep
from backsight.estimation.diagnosis.search.left_over import NAMELESS, LeftOver
from backsight.estimation.diagnosis.search.refit import HELD, QUICKLY
from backsight.estimation.diagnosis.search.search import Search
from backsight.estimation.diagnosis.search.standing import Standing
from backsight.estimation.smoothing.begun import Begun, force_stds
from backsight.estimation.smoothing.smoother import smoothing
from backsight.models.signals import Lag

SLOW = 3.0  # N, a force that nothing in the axis explains


def begun(force: Force | None = None) -> Search:
    """A search on an axis with a white force of LEFT [N sqrt(s)], its weight from the data; its time is over."""
    problem = replace(posed(run(1.0, 2e-3, force=force)), weights=Weights())
    fits = Fits(pool=ThreadPoolExecutor(1), ahead=1, kept=Keep(None, problem), say=lambda _: None, end=0.0)
    return Search(standing=Standing(problem=problem, model=problem.model, result=smooth(problem, settings=QUICKLY)), fits=fits)


@pytest.fixture(scope="module")
def search() -> Search:
    return begun()


@pytest.fixture(scope="module")
def slow() -> Search:
    """With a force that comes and goes in a seventh of a second."""
    return begun(lambda t, _q, v: np.full_like(v, SLOW * np.sin(2 * np.pi * 7.0 * t)))


def test_its_weight_is_that_of_the_force(search: Search) -> None:
    assert search.result.solution is not None
    assert force_stds(search.result.solution)["carriage"] == pytest.approx(LEFT, rel=0.3)


@pytest.mark.parametrize(("less", "needed"), [(1.02, False), (8.0, True), (100.0, True)])
def test_recordings_need_it_where_they_are_less_likely_with_so_many_times_less(search: Search, less: float, needed: bool) -> None:
    sizes = SimpleNamespace(left={"carriage": less * FLOOR / 2})
    rest = LeftOver(base=search.base, sizes=sizes, first={}, fits=search.fits)  # type: ignore[arg-type]
    assert rest.needed("carriage") is needed


def linearised(search: Search) -> Linearised:
    assert search.result.solution is not None
    return Linearised(search.result.solution)


def left_over(search: Search, needed: bool, monkeypatch: pytest.MonkeyPatch, share: float = 2 * NAMELESS) -> None:
    search.standing, search.closing = replace(search.standing, findings=()), []
    monkeypatch.setattr(LeftOver, "needed", lambda *_: needed)
    left = SimpleNamespace(left={"carriage": share}, base=linearised(search))
    search._unexplained(left)  # type: ignore[arg-type]


@pytest.mark.parametrize("needed", [True, False])
def test_it_becomes_a_finding_or_a_note(slow: Search, needed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    left_over(slow, needed, monkeypatch)
    assert [f.explanation.place for f in slow.standing.findings] == ["carriage"] * needed
    assert [note.partition(":")[0] for note in slow.closing] == ["Left over at carriage"] * (not needed)


def test_a_force_that_is_forgotten_at_once_is_noise(search: Search, monkeypatch: pytest.MonkeyPatch) -> None:
    left_over(search, True, monkeypatch)
    assert search.standing.findings == ()
    assert search.closing[0].endswith("too little for something that is missing.")


@pytest.mark.parametrize(("share", "told"), [(0.9 * FLOOR, "at no place a larger share"), (0.9 * NAMELESS, "too little for something")])
def test_a_force_that_lasts_and_is_small_is_a_note(slow: Search, share: float, told: str, monkeypatch: pytest.MonkeyPatch) -> None:
    left_over(slow, True, monkeypatch, share)
    assert slow.standing.findings == ()
    (note,) = slow.closing
    assert told in note
    assert f"{100 * share:.2g} % of the forces there" in note


@pytest.mark.parametrize("has_found", [False, True])
def test_what_held_weights_left_over_is_explained_by_findings_alone(slow: Search, has_found: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Weights from the data shift a force to where it acts: with nothing found all of it is still to be explained."""
    there = Search(standing=slow.standing, fits=slow.fits, settings=HELD)
    monkeypatch.setattr(Fits, "weighed", lambda *_: (slow.problem, slow.result))
    there.standing = replace(there.standing, findings=(found().findings[0],) * has_found)
    there.first_left = {"elsewhere": 0.05}
    assert there._weighed()
    assert there.settings.weigh
    assert there.first_left == ({"elsewhere": 0.05} if has_found else {})


def test_weights_are_sought_from_a_model_that_had_a_lag_more(search: Search) -> None:
    """What was found last, a lag of the reading, is taken back: the solution has a state that the problem has not."""
    lagging = search.problem.model.insert("sensor:x", Lag(tau=1e-3), "lag")  # type: ignore[union-attr]
    late, solution = replace(search.problem, model=lagging), search.result.solution
    assert solution is not None
    near = smoothing(late, settings=QUICKLY, begin=Begun.of(solution, late))
    fits = replace(search.fits, end=time.time() + 1e3)
    again = fits.weighed(search.base, search.problem, near)
    assert again is not None
    assert again[1].solver.converged


def test_rows_of_forces_are_those_that_the_smoother_left(slow: Search) -> None:
    base = linearised(slow)
    t = base.solution.transcription
    (rows,) = (r for term, r in zip(t.nlp.terms, base.solution.rows, strict=True) if term.name == t.force_term)
    assert base.force_rows.shape == rows.shape
    assert base.left[base.force_rows] == pytest.approx(rows, abs=1e-3 * float(np.abs(rows).max()))


def test_the_share_that_lasts_is_that_of_what_comes_and_goes(search: Search, slow: Search) -> None:
    both, one = (s.result.residual_places["carriage"].rms for s in (slow, search))
    assert lasting(linearised(search), "carriage") < 0.2
    assert lasting(linearised(slow), "carriage") == pytest.approx(SLOW / 2**0.5 / both, abs=0.1)
    assert one < 0.5 * both


@pytest.mark.parametrize("noise", [0, 1, 2])
def test_of_white_noise_seen_through_the_smoother_nothing_lasts(slow: Search, noise: int) -> None:
    """Where a force that lasts is told by the same rows; of three records with ten draws each."""
    base = linearised(slow)
    drawn = base.drawn(100 + noise, 10).left
    told = []
    for column in drawn.T:
        base.__dict__["left"] = column
        told.append(lasting(base, "carriage", noise))
    assert np.count_nonzero(told) <= 3  # of each one in seventeen is expected


@pytest.mark.parametrize(("gain", "faint"), [(5200.0, False), (50.0, True)])
def test_what_has_no_chance_is_faint_by_its_evidence(search: Search, gain: float, faint: bool) -> None:
    sure = replace(search.standing, findings=(replace(found().findings[0], p_value=float("nan"), gain=gain),))
    assert sure.faint is faint
    assert withdrawn(sure.findings, proof()).startswith("Not borne out: coulomb friction at carriage, by")


@pytest.mark.parametrize(("chances", "faint"), [((0.03,), True), ((0.03, 1e-6), False), ((1e-6,), False)])
def test_what_is_withdrawn_leaves_the_model_as_declared_and_forces_without_a_name(
    search: Search, slow: Search, chances: tuple[float, ...], faint: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    left_over(slow, True, monkeypatch)
    (nameless,) = slow.standing.findings
    changed = Search(standing=search.standing, fits=search.fits)
    changed.standing = replace(slow.standing, findings=tuple(replace(found().findings[0], p_value=p) for p in chances))
    assert changed.standing.faint is faint
    changed.standing = replace(changed.standing, findings=(*changed.standing.findings, nameless))
    assert changed.standing.faint  # nothing is sure beside a force that nobody knows
    text = withdrawn(changed.standing.findings, replace(proof(), improvement_percent=-12.0))
    assert text.startswith("Not borne out: coulomb friction at carriage (p ")
    assert "unknown" not in text
    assert "12 % larger" in text
    changed.withdraw()
    assert changed.standing.findings == (nameless,)
    assert (changed.problem, changed.result) == (search.problem, search.result)
    assert changed.verdict() == "unknown_physics"


def test_what_scores_take_is_owed_to_those_that_come_after_fits(search: Search) -> None:
    began = time.time()
    there = replace(search, fits=replace(search.fits, end=began + 1000.0))
    fits = there._scored().fits
    took = time.time() - began
    assert 0.0 < fits.owed <= took
    assert fits is there.fits
    assert fits.left == pytest.approx(1000.0 - took - fits.owed, abs=1.0)
    assert replace(fits, end=began + took).left == 0.0
