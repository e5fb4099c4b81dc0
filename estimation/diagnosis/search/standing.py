"""The model with what was found so far: its problem and smoothing, the findings, and the candidates that they came of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from backsight.models import Model

from ...problem import Problem
from ...recordings.recording import Recording
from ...results import Smoothing
from ..answer.verdict import Finding
from ..answer.words import UNKNOWN
from ..candidates.candidate import Candidate
from ..scores.shares import Sizes
from .elimination import Bare
from .findings import finding, renewed
from .round import Best, Round

FEW = 100.0  # nats: with less an effect is small
FAINT = 1e-3  # chance of what is taken back where held-out recordings speak against it


@dataclass(frozen=True, kw_only=True)
class Standing:
    """A problem, its model and its smoothing; what was found that makes them so, one candidate to every finding that has a name."""

    problem: Problem
    model: Model
    result: Smoothing
    findings: tuple[Finding, ...] = ()
    accepted: tuple[Candidate, ...] = ()

    @property
    def named(self) -> list[Finding]:
        """The findings that have a name, one for every candidate that was accepted."""
        return [f for f in self.findings if f.explanation.physics != UNKNOWN]

    @property
    def faint(self) -> bool:
        """Whether no finding is so sure that other recordings could not take it back.

        Beside a force without a name none is: chances suppose that nothing else was left out. What no score tells of has no chance; its
        evidence tells.
        """
        sure = [f.gain > FEW if np.isnan(f.p_value) else f.p_value < FAINT for f in self.findings]
        return len(self.named) < len(self.findings) or not any(sure)

    def passing(self, recordings: Sequence[Recording]) -> bool:
        """Whether all that was found sets in at some time, or acts for a while, also within these recordings, and gained little.

        There are hundreds of such times and spans to choose from, and a noise that remembers is off for a while, too.
        """
        spans = [(float(r.time[0]), float(r.time[-1])) for r in recordings]

        def acts(c: Candidate) -> bool:
            return c.onset is not None and any(c.onset < end and (c.until is None or c.until > start) for start, end in spans)

        late = [acts(c) and f.gain < FEW for f, c in zip(self.named, self.accepted, strict=True)]
        return bool(late) and all(late) and len(late) == len(self.findings)

    def at(self, problem: Problem, result: Smoothing, model: Model | None = None) -> Standing:
        """The same findings where their model, or another one with them, is fitted anew."""
        return replace(self, problem=problem, result=result, model=model or self.model)

    def gaining(self, nats: float) -> Standing:
        """With so much more that the last finding gained."""
        *others, last = self.findings
        return replace(self, findings=(*others, replace(last, gain=last.gain + nats)))

    def instead_of(self, gone: Finding, more: float, heir: Finding | None = None) -> Standing:
        """Without a finding that is nothing beside another one, the last unless told, which gains what both did; the other one lacks
        what that added.

        more: nats by which the model is more probable without it.
        """
        heir = heir or self.findings[-1]
        known = {e.key for e in (heir.explanation, *heir.rivals)}
        lacking = () if gone.explanation.key in known else (replace(gone.explanation, gap=heir.gain + more),)
        others = sorted((*(a for a in heir.alternatives if a.key != gone.explanation.key), *lacking), key=lambda a: a.gap)
        richer = replace(heir, alternatives=tuple(others), gain=heir.gain + gone.gain + more)
        return replace(self, findings=tuple(richer if f is heir else f for f in self.findings))

    def keeping(self, scored: Round, best: Best) -> Standing:
        """With the best of a round, and without what that replaces; raises ValueError where it has no fit."""
        c, _, f = best.judged
        if f.problem is None or f.model is None or f.whole is None:
            raise ValueError(f"{c.title} has no fit")
        refused = {t.explanation.key for t in scored.tried if t.refused} - {t.explanation.key for t in scored.tried if not t.refused}
        new = finding(scored.linearised, best.judged, scored.fitted, scored.found, scored.sizes, best.same, best.as_good, refused)
        stay = [not c.replaces(old) for old in self.accepted]
        for old in self.accepted:
            if c.exchanges(old):
                c = c.instead_of(old)
                new = renewed(replace(new, explanation=replace(new.explanation, place=c.place)), c, f.whole, scored.sizes)
        whole = sum(old.gain for old, there in zip(self.findings, stay, strict=True) if not there)
        return Standing(
            problem=f.problem,
            model=f.model,
            result=f.whole,
            findings=(*(old for old, there in zip(self.findings, stay, strict=True) if there), replace(new, gain=new.gain + whole)),
            accepted=(*(old for old, there in zip(self.accepted, stay, strict=True) if there), c),
        )

    def having(self, candidates: Sequence[Candidate], bare: Bare) -> tuple[Problem, Model] | None:
        """The declared model with these; None where one needs another one, or a component would be what it is in neither model."""
        posed = bare.having(candidates, self.problem, self.result)
        known = bare.model.components, self.model.components
        if posed is None or any(type(c) not in [type(there.get(name)) for there in known] for name, c in posed[1].components.items()):
            return None
        return posed

    def tidied(self, bare: Bare) -> tuple[Problem, Model]:
        """Its problem and model, without the components of what was accepted once and has been taken over wholly."""
        posed = self.having(self.accepted, bare) if len(self.accepted) == len(self.findings) else None
        fewer = posed is not None and posed[1].components.keys() < self.model.components.keys()
        return posed if posed is not None and fewer else (self.problem, self.model)

    def others(self, k: int) -> tuple[Candidate, ...]:
        """What was accepted but for the k-th."""
        return (*self.accepted[:k], *self.accepted[k + 1 :])

    def taking_out(self, k: int, rest: Standing) -> Standing:
        """The k-th of what was accepted goes, and the model is the rest's."""
        gone = self.named[k]
        return replace(rest, findings=tuple(f for f in self.findings if f is not gone), accepted=self.others(k))

    def with_dates(self, k: int, c: Candidate) -> Standing:
        """The k-th of what was accepted sets in, and ends, when this one does."""
        old = self.named[k]
        found = tuple(replace(f, onset=c.onset, until=c.until) if f is old else f for f in self.findings)
        return replace(self, findings=found, accepted=(*self.accepted[:k], c, *self.accepted[k + 1 :]))

    def renewed(self, sizes: Sizes) -> Standing:
        """What was found first has the numbers that it has beside what was found later, and the name that goes with these."""
        of = {id(f): c for f, c in zip(self.named, self.accepted, strict=True)}
        found = (renewed(f, of[id(f)], self.result, sizes) if id(f) in of else f for f in self.findings)
        return replace(self, findings=tuple(found))
