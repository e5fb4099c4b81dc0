"""What was held out has its say: small effects go out again, a repair is withdrawn or doubted; the verdict is what that leaves of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ..answer.verdict import Class, HeldOut
from ..answer.words import CONTRADICTED, UNPROVED, withdrawn
from ..candidates.candidate import Candidate
from ..search.left_over import NAMELESS
from ..search.refit import FAILURES
from ..search.search import Search
from .contradicted import contradicted
from .predictor import Predictor
from .proof import Case, Proof


@dataclass(frozen=True, kw_only=True)
class Ruling:
    """A verdict, what was held out says of it, if it could be predicted, and notes."""

    verdict: Class
    held_out: HeldOut | None = None
    notes: tuple[str, ...] = ()


def ruling(search: Search, proof: Proof, declared: Case, seen: Callable[[Case], Case]) -> Ruling:
    """What a search found, as what was held out has it; the search is without what goes.

    declared: the model as declared. seen: what a predictor is made of, of a fitted problem.
    """
    if not proof.recordings:
        return Ruling(verdict=search.verdict())
    proof.say(f"{'proof' if search.repaired else 'the model'} on what was held out")
    notes = list[str]()
    try:
        base = proof.predictor(declared, "the base model")
        if not search.repaired:
            return Ruling(verdict=search.verdict(), held_out=proof.compared(base, base).unrepaired)
        after = proof.predictor(seen((search.problem, search.result)), "the repaired model", base)
        after, gone, notes = contradicted(search, proof, after, seen)
        if gone:
            after, more = _gone_on(search, proof, after, seen, gone)
            notes += more
        held_out = proof.compared(base, after)
    except FAILURES as error:
        return Ruling(verdict=search.verdict(), notes=(*notes, f"What was held out could not be predicted: {error}"))
    ruled = _ruled(search, proof, held_out)
    return Ruling(verdict=ruled.verdict, held_out=ruled.held_out, notes=(*notes, *ruled.notes))


def _gone_on(
    search: Search, proof: Proof, after: Predictor, seen: Callable[[Case], Case], gone: Sequence[Candidate]
) -> tuple[Predictor, list[str]]:
    """What is in the place of what went, asked in the same way, with notes; as it was where what was held out has no end with it."""
    before = search.ended
    try:
        if not search.go_on(gone):
            return after, []
        other = proof.predictor(seen((search.problem, search.result)), "the model with what takes its place", after)
        other, more, notes = contradicted(search, proof, other, seen)
        if more:
            search.told_anew()
    except FAILURES:
        search.back_to(before)
        return after, []
    return other, notes


def _ruled(search: Search, proof: Proof, held_out: HeldOut) -> Ruling:
    """The repair as a whole: withdrawn where it is little and not borne out, doubted where it is more."""
    verdict, left = search.verdict(), search.most_left
    passing = not search.beforehand and held_out.untold and search.standing.passing(proof.recordings)
    if passing or (held_out.refuting and search.standing.faint):
        said = withdrawn(search.standing.findings, held_out)
        search.withdraw()
        verdict = search.verdict()
        verdict = "undecided" if passing and verdict == "none" and left > NAMELESS else verdict
        return Ruling(verdict=verdict, held_out=held_out.unrepaired, notes=(said,))
    if held_out.refuting:
        return Ruling(verdict=verdict if verdict == "unknown_physics" else "undecided", held_out=held_out, notes=(CONTRADICTED,))
    if search.standing.named and held_out.doubtful and left > NAMELESS and verdict != "unknown_physics":
        return Ruling(verdict="undecided", held_out=held_out, notes=(UNPROVED,))
    return Ruling(verdict=verdict, held_out=held_out)
