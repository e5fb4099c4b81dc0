"""The rounds of a search as a whole: what its end says."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from math import inf

from concealed_axis import posed, run

from backsight.estimation import smooth
from backsight.estimation.diagnosis.search.fits import Fits
from backsight.estimation.diagnosis.search.keep import Keep
from backsight.estimation.diagnosis.search.refit import QUICKLY
from backsight.estimation.diagnosis.search.search import Search
from backsight.estimation.diagnosis.search.standing import Standing


def ended(seconds: float, **carriage: float) -> Search:
    """A search of a time [s] after the model as it is."""
    problem = posed(run(1.0, 2e-3, **carriage))
    fits = Fits(pool=ThreadPoolExecutor(1), ahead=1, kept=Keep(None, problem), say=lambda _: None, end=seconds)
    search = Search(standing=Standing(problem=problem, model=problem.model, result=smooth(problem, settings=QUICKLY)), fits=fits)
    search.run()
    return search


def test_without_time_for_what_is_likely_nobody_says_that_nothing_is_missing():
    search = ended(0.0, f_c=8.0)
    assert "coulomb friction at carriage" in search.cut
    (said,) = (note for note in search.closing if "had no time for a fit" in note)
    assert "coulomb friction at carriage" in said


def test_without_time_where_nothing_is_likely_nothing_is_missing():
    search = ended(0.0)
    assert search.cut == ()
    assert search.verdict() == "none"


def test_what_went_is_not_found_again_but_what_stands_in_its_place():
    """Without Coulomb friction the axis has another law of friction, and the search that ended once ends again."""
    search = ended(inf, f_c=20.0)
    (coulomb,) = search.standing.accepted
    assert coulomb.physics == "coulomb_friction"
    assert not search.go_on([coulomb])  # nothing is left over
    had = search.ended
    search.standing = search.without(0)
    assert search.go_on([coulomb])
    assert coulomb.kind not in [c.kind for c in search.standing.accepted]
    assert any(c.family == "friction" and c.place == "carriage" for c in search.standing.accepted)
    assert len([note for note in search.closing if note.startswith(("Left over", "Unexplained"))]) == 1
    assert search.closing != had[1]
    search.back_to(had)
    assert search.standing.accepted == (coulomb,)
    assert search.ended == had
