"""The rounds of the search: scores, fits of the best, one that is kept; what is named so far, and what is left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from backsight.models import Model

from ..problem import Free, Problem
from ..recordings.recording import Recording
from ..results import Smoothing
from ..smoothing.program import Settings
from .candidates import Candidate
from .choice import (
    CLEAR,
    chosen,
    coloured,
    explaining,
    held_unseen,
    idle,
    simplest,
    sound,
    steady,
    stood_for,
)
from .elimination import Bare
from .findings import Judged, finding, fitted_strengths, renewed, verdict
from .fits import Base, Fits
from .indistinct import indistinct
from .left_over import UNEXPLAINED, LeftOver
from .library import library
from .offsets import counted_out
from .onsets import dated, late, moved
from .places import joined_to
from .refit import QUICKLY, comparable, hidden, settled, worth_of
from .refusals import Beside, borne_out, loose
from .score import Linearised
from .screen import Screen, Screened, screen
from .shares import FLOOR, Sizes, limits
from .supermodel import looked_at
from .verdict import Class, Finding, Tried, Undetectable
from .words import UNKNOWN
from .worth import Worth, gains

EFFECTS = 6
DATES = 3  # times that the date of what sets in is sought anew
HINT = 0.25  # of the floor: with as much left over and no other effect, couplings are tried, since what they do hides in inertias
NEAR = 0.5  # of the largest left-over share of forces: what is fitted without a score is so at places with that much
AGAIN, WORTH = 5, 1.0  # times that the model as it is is fitted once more, at most; nats for which it is done another time
FAINT = 1e-3  # chance of what is taken back where held-out recordings speak against it
LOST = 0.2  # of what an effect gained, that sharp corners may cost
FINER = 1.2  # times as many intervals: a mesh on which numbers are others


@dataclass(frozen=True, kw_only=True)
class Before:
    """What there was before the last effect was found."""

    problem: Problem
    model: Model
    findings: list[Finding]
    accepted: list[Candidate]


INCOMPARABLE = (
    "No models were compared: where the model as it is came to rest the recordings do not tell its parameters and states apart. Give what "
    "is known of them, in [parameters], in [initial] or by another sensor."
)


@dataclass
class Search:
    """What the search has found so far: the problem with it, its model and its smoothing.

    fits: where candidates are fitted, and until when; settings: of these; seed: of what is drawn. held: recordings whose inputs are held,
    as a study has them, where straight ones were better for the model as it is. compared: whether models could be.
    """

    problem: Problem
    model: Model
    result: Smoothing
    fits: Fits
    settings: Settings = QUICKLY
    seed: int = 0
    findings: list[Finding] = field(default_factory=list)
    tried: list[Tried] = field(default_factory=list)
    undetectable: list[Undetectable] = field(default_factory=list)
    first_left: dict[str, float] = field(default_factory=dict)
    left: dict[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    accepted: list[Candidate] = field(default_factory=list)
    before: Before | None = None
    bare: Bare = field(init=False)
    held: tuple[Recording, ...] | None = None
    compared: bool = field(default=True, init=False)
    _first: Smoothing = field(init=False, repr=False)
    _sizes: Sizes = field(init=False, repr=False)
    _checked: Smoothing | None = field(default=None, init=False, repr=False)
    _told: tuple[Smoothing, bool, Worth] | None = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        self.bare = Bare(problem=self.problem, model=self.model)
        self._first = self.result

    def run(self) -> None:
        """Rounds until nothing more is found; then what could not have been seen.

        Where weights are held they come from the data as soon as the model bears it: evidences at held weights find what leads most of the
        forces astray, but what is left of them then they take for an effect too. A model that has none at held weights is weighed at once.
        """
        tried, more = not self.settings.weigh and not comparable(self.problem, self.result), True
        if tried:
            self._weighed()
        self._as_fits_are()
        while more:
            base, candidates, found, sizes = self._scores()
            more = self.fits.left > 0 and len(self.findings) < EFFECTS and self._round(base, found, sizes, candidates)
            if not self.settings.weigh and (more or not tried):
                tried = True
                more |= self._weighed()
            if more:
                self._eliminate()
                self._held_again()
        if self.fits.left == 0:
            self.notes.append("The search was ended by its limit of time: there may be more. A second run goes on from here.")
        self._on_a_checked_mesh()
        self.renew()
        self._limits(found, sizes)

    def _as_fits_are(self) -> None:
        """The model as it is fitted once more from where it came to rest, as candidates are: what that alone gains is nobody's merit."""
        for k in range(AGAIN if self.settings.weigh else 0):
            problem = settled(self.problem, self.result)
            again = self._again(problem, f"the model as it is, as fits are, {k + 1}")
            if again is None:
                return
            more = self._worth(problem, again).over(self.now)
            if self.result.solver.converged and not more > 0:
                return
            self.problem, self.result = problem, again
            if more < WORTH:
                return

    def _on_a_checked_mesh(self) -> None:
        """The model with what was found on a mesh that no longer moves its numbers: candidates are compared on that which it began with.

        Nothing where it is on such a mesh already.
        """
        if self.findings and self.fits.left > 0 and self.result is not self._checked:
            self.fits.say("the mesh, with what was found")
            base = replace(self._base, settings=replace(self.settings, check_mesh=True))
            holds = "".join(f", {r.name} {r.hold}" for r in self.problem.recordings)
            self._checked = self.fits.again(base, settled(self.problem, self.result), f"on a checked mesh{holds}")
            self.result = self._checked or self.result

    def _finer(self) -> None:
        """The same at once, and for all that comes: what a lag makes of a mesh that is too coarse for it, further effects would explain."""
        had = self.result.solution
        self._on_a_checked_mesh()
        now = self.result.solution
        if had is None or now is None:
            return
        before, after = had.transcription, now.transcription
        if len(after.nlp.steps) > FINER * len(before.nlp.steps):
            self.settings = replace(self.settings, step=min(float(np.median(h.mesh.steps)) for h in after.horizons))

    def _held_again(self) -> None:
        """Back to held inputs where these are better with what was found: what was missing may have looked like straight ones."""
        if self.held is None or not self.findings or self.fits.left == 0:
            return
        self.fits.say("held inputs again, with what was found")
        straight = settled(self.problem, self.result)
        held = replace(straight, recordings=list(self.held))
        one, other = self._again(held, "held inputs"), self._again(straight, "straight inputs")
        if one is not None and (other is None or self._worth(held, one).over(self._worth(straight, other)) > 0):
            self.problem, self.result, self.held = held, one, None

    def _eliminate(self) -> None:
        """What was found before the last effect and is nothing beside it goes out of the model again.

        Where that made a difference, what stayed is asked once more: it may have stood for what is gone.
        """
        while self._without_idle_ones():
            pass

    def _without_idle_ones(self) -> bool:
        """One turn of that; whether something is gone."""
        before = len(self.accepted)
        for k in reversed(range(len(self.accepted) - 1)):
            c = self.accepted[k]
            if not idle(c, self.result):
                continue
            self.fits.say(f"{c.title} is nothing beside what was found later")
            found = self.without(k)
            if found is None or self._worth(found.problem, found.result).over(self.now) < -CLEAR:
                continue
            gone = self.findings[k].gain
            self.take_out(k, found)
            self.findings[-1] = replace(self.findings[-1], gain=self.findings[-1].gain + gone)
        return len(self.accepted) < before

    @property
    def named(self) -> list[Finding]:
        """The findings that have a name, one for every candidate that was accepted."""
        return [f for f in self.findings if f.explanation.physics != UNKNOWN]

    def without(self, k: int, least: float = 0.0) -> Base | None:
        """The model without the k-th of what was accepted, fitted anew; None where others need that, or it does not arrive.

        least: time that the fit has when the search's is over [s].
        """
        posed = self.bare.having([*self.accepted[:k], *self.accepted[k + 1 :]], self.problem, self.result)
        if posed is None:
            return None
        problem = settled(posed[0], self.result)
        found = self.fits.again(self._base, problem, f"without {self.accepted[k].title}", least=least)
        return None if found is None else replace(self._base, problem=problem, model=posed[1], result=found)

    def take_out(self, k: int, rest: Base) -> None:
        """The k-th of what was accepted goes, and the model is what stays."""
        gone = self.named[k]
        self.findings = [f for f in self.findings if f is not gone]
        self.problem, self.model, self.result = rest.problem, rest.model, rest.result
        self.accepted = [*self.accepted[:k], *self.accepted[k + 1 :]]

    def _again(self, problem: Problem, what: str) -> Smoothing | None:
        return self.fits.again(self._base, problem, what)

    def _fits(self, wanted: Sequence[tuple[Candidate, Screened | None]]) -> list[Judged]:
        return self.fits.candidates(self._base, wanted)

    @property
    def _base(self) -> Base:
        changes = tuple(f.change for f in self.findings)
        return Base(problem=self.problem, model=self.model, result=self.result, settings=self.settings, changes=changes)

    @property
    def now(self) -> Worth:
        """What the model as it is is worth."""
        if self._told is None or self._told[0] is not self.result or self._told[1] is not self.settings.weigh:
            self._told = self.result, self.settings.weigh, self._worth(self.problem, self.result)
        return self._told[2]

    def _worth(self, problem: Problem, result: Smoothing) -> Worth:
        """What the models of one round compare by."""
        return worth_of(problem, result, weighed=self.settings.weigh)

    def renew(self) -> None:
        """What was found first has the numbers that it has beside what was found later, and the name that goes with these."""
        of = {id(f): c for f, c in zip(self.named, self.accepted, strict=True)}
        self.findings = [renewed(f, of[id(f)], self.result, self._sizes) if id(f) in of else f for f in self.findings]

    def _scores(self) -> tuple[Linearised, list[Candidate], Screen, Sizes]:
        """The model linearised where it came to rest, all candidates, their scores, and sizes of what is left."""
        self.fits.say(f"round {len(self.findings) + 1}: scores")
        if self.result.solution is None:
            raise ValueError("a smoothed model has its solution")
        base = Linearised(self.result.solution)
        candidates = library(self.problem, self.model, base.solution, brought={n for c in self.accepted for n in c.brought})
        looks = looked_at(self.problem, self.model, base, candidates)
        found, sizes = (
            screen(base, looks, late(base, looks), seed=self.seed, threads=self.fits.jobs),
            Sizes(self.problem, self.result, base),
        )
        self._sizes, self.left = sizes, sizes.left
        self.first_left = self.first_left or sizes.left
        return base, candidates, found, sizes

    def _weighed(self) -> bool:
        """Whether the model has come to rest with weights from the data, found from here; then the search goes on with these.

        What was found last at held weights is taken back where these do not bear it out.
        """
        self.fits.say("weights from the data")
        found = self.fits.weighed(self._base, self.problem, self.result)
        if found is None:
            return False
        if self.before is not None and idle(self.accepted[-1], found[1]):
            self.fits.say(f"{self.accepted[-1].title} is not borne out")
            again = self.fits.weighed(self._base, self.before.problem, found[1])
            if again is not None:
                found, self.model = again, self.before.model
                self.findings, self.accepted = self.before.findings, self.before.accepted
        (self.problem, self.result), self.settings = found, replace(QUICKLY, supposed=self.settings.supposed, step=self.settings.step)
        return True

    def _round(self, base: Linearised, found: Screen, sizes: Sizes, candidates: Sequence[Candidate]) -> bool:
        """Fits the best candidates and keeps one; whether there was one. None can be better than a model of which nobody knows how good."""
        now = self.now
        if not np.isfinite(now.nats):
            self.compared = False
            self.notes.append(INCOMPARABLE)
            return False
        worth = [dated(base, s) for s in chosen(found, sizes)]
        if worth:
            rests = {name for name, place in self.result.residual_places.items() if place.rest_share}
            worth += held_unseen(found, worth, hidden(self.problem) - rests)
        fits = _gained(self._fits([(s.candidate, s) for s in worth]), now)
        more = self._fits([(s.candidate, s) for s in (dated(base, s) for s in stood_for(found, sizes, fits))])
        fits = _gained([*fits, *more], now)
        most, plain = max(sizes.left.values(), default=0.0), [fit for fit in fits if explaining(*fit)]
        hinted = most > HINT * FLOOR or (self.settings.weigh and coloured(self.result))
        if not self._explains(plain) and (most > FLOOR or (hinted and not plain)):
            dear = self._fits([(c, None) for c in candidates if c.dear and self._left_near(c.place, most) >= NEAR * most])
            fits = _gained([*fits, *dear], now)
        fits.sort(key=lambda f: (-f[2].gain, f[0].rank))
        good = self._borne_out(fits, sizes, found)
        if not good and (constant := steady(self.result, candidates, sizes)):
            without = counted_out(self.result, all_of_them=True)[0] - counted_out(self.result)[0]
            last = _gained(self._fits([(c, None) for c in constant]), replace(now, nats=now.nats + without))
            fits = [*fits, *last]
            good = self._borne_out(last, sizes, found)
        if not good:
            return False
        best = simplest([(f, f[1], f[2].gain, (f[0].rank, f[0].size)) for f in good])
        same = indistinct(best, good)
        best, same = min([best, *same], key=lambda f: (f[0].plainness, -f[2].gain)), [best, *same]
        self._keep(base, self._set_in(best), fits, found, sizes, [f[0] for f in same])
        return True

    def _set_in(self, best: Judged) -> Judged:
        """A fit of what sets in, from the time that is best beside the fit itself: far from it the score misses that."""
        for _ in range(DATES):
            c, s, f = best
            if s is None or s.look.whole is None or c.onset is None or f.problem is None or f.model is None or f.worth.solution is None:
                return best
            self.fits.say(f"when {c.title} sets in")
            there = Linearised(f.worth.solution)
            again = [d for d in library(f.problem, f.model, f.worth.solution, brought=set(c.brought)) if d.key == c.key]
            looks = [look for look in looked_at(f.problem, f.model, there, again) if len(look.columns) == len(s.estimate)]
            if f.result is None or not looks:
                return best
            strengths = fitted_strengths(c, f.result)
            time, gained = moved(there, looks[0], strengths, c.onset)
            since = s.look.whole.candidate.since(time)
            if gained < CLEAR or since is None:
                return best
            look = replace(s.look, candidate=since)
            (again_fitted,) = self._fits([(since, replace(s, look=look, estimate=strengths))])
            c, s, f_again = again_fitted
            more = f_again.worth.over(f.worth)
            if more < 0 or not sound(since, f_again):
                return best
            best = c, s, replace(f_again, gain=f.gain + more)
        return best

    def _explains(self, fits: list[Judged]) -> bool:
        """Whether one of the fits leaves less than half of the left-over variance at the worst place."""
        worst = max(self.left, key=lambda p: self.left[p], default="")
        after = [f.result.residual_places[worst].rms for _, _, f in fits if f.result is not None and worst in f.result.residual_places]
        return bool(after) and min(after) ** 2 < (1.0 - UNEXPLAINED) * self.result.residual_places[worst].rms ** 2

    def _left_near(self, place: str, most: float) -> float:
        """What is left over at a place, or the most of what is at those that an element without a balance of its own joins."""
        if place in self.left:
            return self.left[place]
        merged = self.problem.dae.merged_places
        joined = {merged.get(name, name) for name in joined_to(self.model, place)}
        return max((self.left[name] for name in joined if name in self.left), default=most)

    def _borne_out(self, fits: list[Judged], sizes: Sizes, found: Screen) -> list[Judged]:
        """The fits with enough evidence against which nothing speaks; all are remembered, with what does."""
        there, least = loose(self.findings, self.accepted, self.bare.model, self.model)
        beside = Beside(accepted=self.accepted, result=self.result, sizes=sizes, found=found, loose=there, least=least)
        good, tried = borne_out(fits, beside)
        self.tried += tried
        return good

    def _keep(
        self,
        base: Linearised,
        best: Judged,
        fits: list[Judged],
        found: Screen,
        sizes: Sizes,
        same: Sequence[Candidate] = (),
    ) -> None:
        """The best becomes a part of the model. same: candidates that nobody can tell from it."""
        c, _, f = best
        had = self.findings, self.accepted
        if f.problem is None or f.model is None or f.whole is None:
            raise ValueError(f"{c.title} has no fit")
        new = finding(base, best, fits, found, sizes, same)
        stay = [not c.replaces(old) for old in self.accepted]
        whole = sum(old.gain for old, there in zip(self.findings, stay, strict=True) if not there)
        self.findings = [*(old for old, there in zip(self.findings, stay, strict=True) if there), replace(new, gain=new.gain + whole)]
        self.accepted = [*(old for old, there in zip(self.accepted, stay, strict=True) if there), c]
        self.before = Before(problem=self.problem, model=self.model, findings=had[0], accepted=had[1])
        brought = {p.name for p in f.problem.dae.places} - {p.name for p in self.problem.dae.places}
        self.settings = replace(self.settings, supposed=self.settings.supposed | (hidden(f.problem) & brought))
        lags = c.signals and len(f.problem.dae.states) > len(self.problem.dae.states)
        self.problem, self.model, self.result = f.problem, f.model, f.whole
        self._free(c)
        if lags:
            self._finer()

    def _free(self, c: Candidate) -> None:
        """What comes free with a candidate once it is kept, and what is rounded by what was found of it, where that is no worse.

        Of rounding it may be a little worse: no machine has such corners, and wide ones pass for what contacts have besides stiffness.
        """
        if not (c.later or c.rounded):
            return
        free: dict[str, Free | float] = {name: Free(*bounds) for name, bounds in c.later.items()}
        for name, (whole, share) in c.rounded.items():
            free[name] = share * self.result.parameters[whole].value
        problem = settled(replace(self.problem, parameters={**self.problem.parameters, **free}), self.result)
        found = self._again(problem, f"{c.title}, as it was found")
        least = -LOST * self.findings[-1].gain if c.rounded else 0.0
        if found is not None and (more := self._worth(problem, found).over(self.now)) > least:
            self.problem, self.result = problem, found
            self.findings[-1] = replace(self.findings[-1], gain=self.findings[-1].gain + more)

    def _limits(self, found: Screen, sizes: Sizes) -> None:
        skipped = {(f.explanation.place, f.explanation.physics) for f in self.findings}
        self.undetectable = limits(found, sizes, self.model, skipped)
        self._unexplained(sizes)

    def _unexplained(self, sizes: Sizes) -> None:
        """What is left over and matters: a finding without a name, or a note beside those that have one."""
        rest = LeftOver(base=self._base, sizes=sizes, first=self.first_left, fits=self.fits, seed=self.seed).told(self.tried)
        if isinstance(rest, Finding):
            self.findings.insert(0, rest)
        elif rest:
            self.notes.append(rest)

    @property
    def faint(self) -> bool:
        """Whether no finding is so sure that other recordings could not take it back."""
        return not any(f.p_value < FAINT for f in self.findings)

    def withdraw(self) -> None:
        """The model as it was declared; of what was found only forces without a name stay."""
        self.problem, self.model, self.result = self.bare.problem, self.bare.model, self._first
        self.findings, self.accepted = [f for f in self.findings if f.explanation.physics == UNKNOWN], []

    def verdict(self) -> Class:
        """One word for what was found."""
        return verdict(self.findings) if self.compared else "undecided"


def _gained(fits: Sequence[Judged], now: Worth) -> list[Judged]:
    """The fits with what they gain over the model as it is."""
    found = gains([(c.place, (c.size, c.rank), f.worth) for c, _, f in fits], now)
    doubts = [f.worth.doubt(now) if s is None and np.isfinite(f.worth.nats) else 0.0 for _, s, f in fits]
    return [(c, s, replace(f, gain=gain, doubt=doubt)) for (c, s, f), gain, doubt in zip(fits, found, doubts, strict=True)]
