"""Small effects beside large ones, asked of what was held out: one with which that is predicted worse goes out of the model again.

A motion that repeats itself bears out everything that its first turn does, in every part of the recording. Another motion does not.
What was held out has its say here only against an effect: what it is predicted better by is not sought with it. What sets in at some time,
or acts for a while, there are two dozen times to choose from for, and one record to tell: of that it has to be predicted better, too.
"""

from __future__ import annotations

from collections.abc import Callable

from ..answer.verdict import Finding
from ..answer.words import taken_out
from ..candidates.candidate import Candidate
from ..search.refit import FAILURES
from ..search.search import Search
from ..search.standing import FEW
from .predictor import Predictor
from .proof import Case, Proof

MINOR = 0.1  # of the nats of the largest effect: with less than that, or than FEW, an effect is asked
SHARE = 0.5  # of the time that is left for its fit without one


def contradicted(
    search: Search, proof: Proof, whole: Predictor, case: Callable[[Case], Case]
) -> tuple[Predictor, list[Candidate], list[str]]:
    """Takes out of the search's model what was held out contradicts, the faintest first; the predictor with what stays, and notes on each.

    whole: predictor with all that was found. case: what a predictor is made of, of a fitted problem.
    """
    gone, said = list[Candidate](), list[str]()
    for finding in sorted(minor(search.standing.named), key=lambda f: f.gain):
        if proof.left <= 0:
            break
        k = next(n for n, f in enumerate(search.standing.named) if f is finding)
        sets_in = search.standing.accepted[k].onset is not None
        try:
            without = search.without(k, least=SHARE * proof.left)
            if without is None:
                continue
            other = proof.predictor(case((without.problem, without.result)), f"the model without {finding.explanation.words}", whole)
            held_out = proof.compared(other, whole)
        except FAILURES:
            continue
        if held_out.refuting or (sets_in and finding.gain < FEW and held_out.untold):
            gone.append(search.standing.accepted[k])
            said.append(taken_out(finding, held_out))
            search.standing = without
            whole = other
    if said:
        search.renew()
    return whole, gone, said


def minor(findings: list[Finding]) -> list[Finding]:
    """Those of several that gained little, for themselves or beside the largest; never that one."""
    if len(findings) < 2:
        return []
    largest = max(findings, key=lambda f: f.gain)
    return [f for f in findings if f is not largest and f.gain < max(FEW, MINOR * largest.gain)]
