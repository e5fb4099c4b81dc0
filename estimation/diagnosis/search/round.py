"""One round of a search: all candidates scored beside a model, the best of them fitted, and the one that the evidence bears out."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...problem import Free, Problem
from ...results import Smoothing
from ..answer.verdict import Tried
from ..candidates.candidate import Candidate, Kind
from ..candidates.changing import changing
from ..candidates.library import library
from ..candidates.places import joined_to
from ..evidence.misfit import NEARER, OFF, off
from ..evidence.offsets import counted_out
from ..evidence.worth import Worth, gains
from ..scores.onsets import dated, late
from ..scores.score import Linearised
from ..scores.screen import Screen, Screened, identifiable, screen
from ..scores.shares import FLOOR, Sizes
from ..scores.supermodel import looked_at
from .choice import (
    CLEAR,
    as_good,
    chosen,
    coloured,
    explaining,
    held_unseen,
    inside_unseen,
    plainest_first,
    plainness,
    sound,
    spared,
    steady,
    stood_for,
)
from .dates import redated
from .elimination import Bare
from .findings import Judged, fitted_strengths
from .fits import Base, Fits
from .indistinct import indistinct
from .late_signals import late_as_another, late_unheard
from .left_over import UNEXPLAINED
from .refit import at_work, bared, hidden, holds, settled, worth_of
from .refusals import SIMPLE, Beside, borne_out
from .runaway import Near, unheld

DATES = 3  # times that the date of what sets in is sought anew
HINT = 0.25  # of the floor: with as much left over and no effect in the round couplings are tried, since what they do hides in inertias
LOST = 0.5  # of the forces at a place: with more left over no end that a fit from there comes to is sure to be the best
NEAR = 0.25  # of the largest left-over share of forces: what is fitted without a score is so at places with that much first


@dataclass(frozen=True, kw_only=True)
class Best:
    """What a round ends with: the fit that is kept, candidates that nobody could tell beside it, and those whose fits are as good."""

    judged: Judged
    same: tuple[Candidate, ...]
    as_good: tuple[Candidate, ...] = ()


@dataclass(kw_only=True)
class Round:
    """A model linearised where it came to rest, or where a latent force led, all candidates, their scores, and sizes of what is left.

    base: that model; bare: the first one; loose: as `Beside` has it, and least. fitted: candidates so far, and
    tried: what became of them.
    """

    base: Base
    bare: Bare
    fits: Fits
    linearised: Linearised
    candidates: Sequence[Candidate]
    found: Screen
    sizes: Sizes
    accepted: Sequence[Candidate]
    loose: tuple[set[str], float]
    fitted: list[Judged] = field(default_factory=list)
    tried: list[Tried] = field(default_factory=list)

    @classmethod
    def of(
        cls,
        base: Base,
        bare: Bare,
        accepted: Sequence[Candidate],
        loose: tuple[set[str], float],
        fits: Fits,
        seed: int,
        without: Collection[Kind] = (),
    ) -> Round:
        """The scores of all candidates but those of some kinds. seed: of what is drawn."""
        problem, solution = bared(base.problem, base.result)
        linearised = Linearised(solution)
        brought = {n for c in accepted for n in c.brought}
        candidates = library(problem, base.model, solution, brought=brought)
        candidates = [c.with_all_of(accepted, problem.parameters) for c in candidates if c.kind not in without]
        looks = looked_at(problem, base.model, linearised, candidates)
        if (free := unheld(problem, solution)) is not solution:  # what a bound leaves over alone is nothing that is missing
            looks = identifiable(Linearised(free), looks)
        near = {name for name, free in problem.parameters.items() if isinstance(free, Near)}
        may_change = [c for c in changing(problem, base.model, solution, brought) if not near & {*c.strengths}]
        changes = looked_at(problem, base.model, linearised, may_change)
        dates = (look for look in late(linearised, looks, changes) if look.candidate.kind not in without)
        found = screen(linearised, looks, dates, seed=seed, threads=fits.jobs)
        return cls(
            base=base,
            bare=bare,
            fits=fits,
            linearised=linearised,
            candidates=candidates,
            found=found if problem is base.problem else found.beside_white,
            sizes=Sizes(problem, base.result, linearised),
            accepted=accepted,
            loose=loose,
        )

    def best(self, now: Worth, *, moving: bool) -> Best | Base | None:
        """The fit that is kept, or the model as it is from where another fit came to rest; None where there is neither.

        now: what the model as it is is worth. moving: whether it may go where a fit came to rest.
        """
        most = self.sizes.most
        self._fit_the_likely(now)
        plain = [fit for fit in self.fitted if explaining(*fit)]
        if not plain and self.fitted and most > FLOOR and self.fits.left > 0:
            self._fit_the_others(now)
            plain = [fit for fit in self.fitted if explaining(*fit)]
        alone = not self.accepted
        hinted = most > HINT * FLOOR or (alone and self.base.settings.weigh and coloured(self.base.result))
        least = 0.0 if (contradicting := self._contradicting(plain)) else NEAR * most
        couplings = list[tuple[float, Candidate]]()
        if contradicting or (not self._explained(plain) and (most > FLOOR or (hinted and not plain))):
            near = [(self._left_near(c.place, most), c) for c in self.candidates if c.dear]
            couplings = sorted(near, key=lambda one: -one[0])  # while there is time
            self._fit([(c, None) for left, c in couplings if left >= least], now)
        self.fitted = _best_of_each(self.fitted)
        good = self._borne_out(self.fitted)
        if not good and (constant := steady(self.base.result, self.candidates, self.sizes)):
            without = counted_out(self.base.result, all_of_them=True)[0] - counted_out(self.base.result)[0]
            fits = self.fits.candidates(self.base, [(c, None) for c in constant])
            good = self._borne_out(self._alone(fits, replace(now, nats=now.nats + without)))
        if not good and most > FLOOR and (far := [c for left, c in couplings if left < least]):
            good = self._borne_out(_best_of_each(self._alone(self.fits.candidates(self.base, [(c, None) for c in far]), now)))
        if moving and (nearer := self._from_a_fit(now, good)) is not None:
            return nearer
        if not good and hinted and alone:
            good = self._borne_out(self._alone(self._fitted_anew(), now))
        return self._kept(good) if good else None

    def best_of_the_likely(self, now: Worth, near_enough: Callable[[Problem, Smoothing], bool]) -> Best | None:
        """The fit that is kept of what the scores make likely alone, of those of which a result is `near_enough`."""
        self._fit_the_likely(now)
        fits = [f for f in self.fitted if f[2].problem is not None and f[2].whole is not None and near_enough(f[2].problem, f[2].whole)]
        fits, all_of_them = _best_of_each(fits), _best_of_each(self.fitted)
        self.fitted = [*fits, *(f for f in all_of_them if all(f[0] is not c for c, _, _ in fits))]
        good = self._borne_out(fits)
        return self._kept(good) if good else None

    def _kept(self, good: list[Judged]) -> Best:
        """The plainest of the fits that are borne out and as good as the best of them."""
        end = {id(fit[2]): self._in_the_end(fit) for fit in self.fitted}
        good = sorted((end[id(fit[2])] for fit in good), key=lambda fit: -fit[2].ends_with)
        self.fitted = [end[id(fit[2])] for fit in self.fitted]
        near = as_good([(fit, fit[1], fit[2].ends_with, _plainness(fit)) for fit in good])
        best = near[0]
        same = [best, *indistinct(best, [fit for fit in good if fit[2].beside <= best[2].beside])]
        best = min(same, key=lambda fit: (_plainness(fit), -fit[2].ends_with))
        same = [fit for fit in same if fit[2].beside <= best[2].beside]
        return Best(judged=self._set_in(best), same=tuple(fit[0] for fit in same), as_good=tuple(fit[0] for fit in near))

    def _fit_the_likely(self, now: Worth) -> None:
        """Fits of what the scores make likely, and of what they may not tell of."""
        worth = self._chosen()
        if worth:
            worth += held_unseen(self.found, worth, self._unheld)
        first, rich = plainest_first(worth, self._unheld)
        self._fit([(s.candidate, s) for s in first], now)
        held = {c.place for c, _, f in self.fitted if holds(c, self._unheld) and np.isfinite(f.gain)}
        self._fit([(s.candidate, s) for s in rich if s.candidate.place not in held], now)
        richer = [dated(self.linearised, s) for s in stood_for(self.found, self.sizes, self.fitted)]
        self._fit([(s.candidate, s) for s in richer], now)
        self._fit_where([(c, None, there) for c, there in self._plainer_than_fitted()], now)
        self._fit_where([(s.candidate, s, there) for s, there in late_as_another(self.fitted)], now)
        unheard = late_unheard(self.fitted, [c for c in self.candidates if not self._there(c)], self.found, self.sizes.most)
        self._fit([(c, None) for c in unheard], now)

    def _fit_the_others(self, now: Worth) -> None:
        """Fits of what comes next, where none of the best by their scores explains anything.

        Beside an input that does nothing, and a mass without end, a wave that was most of what is left over had a sixth of their scores.
        """
        fitted = [s.origin or s for _, s, _ in self.fitted if s is not None]
        self._fit([(s.candidate, s) for s in self._chosen(but=fitted)], now)

    def _chosen(self, but: Sequence[Screened] = ()) -> list[Screened]:
        """What the scores make likely, and the model has not, from the time that is best of what sets in."""
        return [dated(self.linearised, s) for s in chosen(self.found, self.sizes, but) if not self._there(s.candidate)]

    def _there(self, c: Candidate) -> bool:
        """Whether the model has the same already, all along and free: a second one only helps what is not linear in it.

        Waves may have others beside them.
        """
        if c.onset is not None or "period" in c.named:
            return False
        return any(a.key == c.key and a.named.keys() == c.named.keys() and a.onset is None for a in self.accepted)

    def _plainer_than_fitted(self) -> list[tuple[Candidate, Smoothing]]:
        """Laws of a level alone where a richer law has no end, or its peak at rest is not told, with that one's fit, where theirs begins.

        From where the base came to rest a body that sticks where no output shows it may lead their own fits astray.
        """
        found = list[tuple[Candidate, Smoothing]]()
        for c, _, f in self.fitted:
            if c.larger is None or (there := f.whole) is None or (np.isfinite(f.gain) and sound(c, f)):
                continue
            level = c.larger[1]
            plain = next((o for o in self.candidates if o.place == c.place and o.physics == SIMPLE.get(level.rpartition(".")[2])), None)
            if plain is None:
                continue
            gained = max((other.gain for o, _, other in self.fitted if o.key == plain.key), default=-np.inf)
            if not np.isfinite(gained) or gained < f.gain:
                (strength,) = plain.strengths
                found.append((replace(plain, start={**plain.start, strength: (there.parameters[level].value, 0.0, np.inf)}), there))
        return found

    def _fit_where(self, wanted: Sequence[tuple[Candidate, Screened | None, Smoothing]], now: Worth) -> None:
        """Fits of candidates from where others came to rest."""
        fits = [self.fits.candidates(replace(self.base, result=there), [(c, s)]) for c, s, there in wanted]
        self.fitted = _gained([*self.fitted, *(fit for own in fits for fit in own)], now)

    def _fit(self, wanted: Sequence[tuple[Candidate, Screened | None]], now: Worth) -> None:
        """Fits of candidates, held against those that there are."""
        fits = self._judged(wanted)
        self.fitted = _gained([*self.fitted, *fits, *self._from_the_guesses(fits)], now)

    def _from_the_guesses(self, fits: list[Judged]) -> list[Judged]:
        """The fits of what was scored from the guesses, too, if the model as it is leaves most of the forces over.

        Weights from the data have several ends: from one at which residual forces do everything no small steps lead to one that leaves
        next to nothing to them.
        """
        if not (self.sizes.most > LOST and self.base.settings.weigh):
            return []
        return self.fits.candidates(self._as_guessed, [(c, s) for c, s, _ in fits if s is not None], anew=True)

    def _judged(self, wanted: Sequence[tuple[Candidate, Screened | None]]) -> list[Judged]:
        """Fits of candidates from where the base came to rest; of what may hold a body that no output shows, from the guesses.

        A model without friction never holds that body: no small steps lead from there to one that sticks, and neither strengths by their
        scores nor parameters that came to rest without it are anything to start from. Nor does a score tell what such a fit is worth.
        """
        holding = [(c, None) for c, _ in wanted if holds(c, self._unheld)]
        others = [(c, s) for c, s in wanted if not holds(c, self._unheld)]
        return [*self.fits.candidates(self.base, others), *self.fits.candidates(self._as_guessed, holding, anew=True)]

    @property
    def _unheld(self) -> set[str]:
        """Bodies that no output shows, and that nothing in the model may hold at rest."""
        resting = {name for name, place in self.base.result.residual_places.items() if place.rest_share}
        return hidden(self.base.problem) - resting - at_work(self.base.problem)

    def _alone(self, fits: list[Judged], now: Worth) -> list[Judged]:
        """Further fits, best first, with what they gain over the model as it is, whatever others there are."""
        fits = sorted(_gained(fits, now), key=lambda f: (-f[2].gain, f[0].rank))
        self.fitted = [*self.fitted, *fits]
        return fits

    def _fitted_anew(self) -> list[Judged]:
        """Fits from the guesses of what may be wrong inside of what no output shows, and of what is likely there and did not come to rest.

        What the former are worth no score tells; damping, which has no guess, begins at its score's. Of a model in which something was
        found already this is not asked: its parameters came to rest with that.
        """
        problem, model = self.base.problem, self.base.model
        unseen = hidden(problem)
        around = {name for body in unseen & model.components.keys() for name in joined_to(model, body)}
        inside = (unseen | around) - ({place.name for place in problem.dae.places} - unseen)
        lost = [s for c, s, f in self.fitted if s is not None and c.place in inside and not np.isfinite(f.gain)]
        others = [s for s in inside_unseen(self.found, inside) if s not in lost]
        wanted = [*((s.candidate, s) for s in lost), *((s.candidate, s if s.candidate.physics == "damping" else None) for s in others)]
        fits = self.fits.candidates(self._as_guessed, wanted, anew=True)
        return [(c, s if s in lost else None, f) for c, s, f in fits]

    @property
    def _as_guessed(self) -> Base:
        """The base with the guesses of its parameters that were given; of those that nobody gave, where they are."""
        own, given = settled(self.base.problem, self.base.result).parameters, self.bare.problem.parameters
        both = {n: (free, given[n]) for n, free in own.items() if n in given}
        begin = {n: replace(a, guess=b.guess) for n, (a, b) in both.items() if isinstance(a, Free) and isinstance(b, Free)}
        return replace(self.base, problem=replace(self.base.problem, parameters={**own, **begin}))

    def _borne_out(self, fits: list[Judged]) -> list[Judged]:
        """The fits with enough evidence against which nothing speaks; all are remembered, with what does."""
        there, least = self.loose
        beside = Beside(accepted=self.accepted, result=self.base.result, sizes=self.sizes, found=self.found, loose=there, least=least)
        good, tried = borne_out(fits, beside)
        self.tried += tried
        return good

    def _from_a_fit(self, now: Worth, good: list[Judged]) -> Base | None:
        """The model as it is from where a fit came to rest whose own effect is nothing, where it is better there.

        A model may never fit worse than one of which it is a part. Not asked where what was borne out is about as good as that fit.
        """
        least = CLEAR + max((f.gain for _, _, f in good), default=0.0)
        idle = [(f.gain, c.title, f.whole) for c, _, f in self.fitted if np.isfinite(f.gain) and f.gain >= least and not sound(c, f)]
        _, title, there = max(idle, key=lambda one: one[0], default=(0.0, "", None))
        if there is None:
            return None
        what = f"the model as it is, from where {title} came to rest"
        self.fits.say(what)
        problem, weigh = settled(self.base.problem, there), self.base.settings.weigh
        again = self.fits.again(replace(self.base, result=there), problem, what)
        if again is None or not worth_of(problem, again, weighed=weigh).over(now) > CLEAR:
            return None
        return replace(self.base, problem=problem, result=again)

    def _in_the_end(self, fit: Judged) -> Judged:
        """A fit with what it gains in a model without what was found before and is idle beside it, and how many effects that has besides.

        What takes the place of another effect is plainer than what mends that. A law that takes over an accepted one counts for what it has
        more than that.
        """
        c, s, f = fit
        if f.result is None or f.result.criteria is None:
            return fit
        gone, nats = spared([a for a in self.accepted if not c.replaces(a)], f.result)
        return c, s, replace(f, spared=nats, beside=len(self.accepted) - gone)

    def _set_in(self, best: Judged) -> Judged:
        """A fit of what sets in, from the time that is best beside the fit itself: far from it the score misses that."""
        for _ in range(DATES):
            c, s, f = best
            if s is None or c.onset is None or f.problem is None or f.model is None or f.whole is None:
                return best
            self.fits.say(f"when {c.title} sets in")
            new = redated(f.problem, f.model, f.whole, c)
            if new is None:
                return best
            there = replace(s, look=replace(s.look, candidate=new), estimate=fitted_strengths(c, f.whole), origin=s.origin or s)
            (again_fitted,) = self.fits.candidates(self.base, [(new, there)])
            c, s, f_again = again_fitted
            more = f_again.worth.over(f.worth)
            if more < 0 or not sound(new, f_again):
                return best
            best = c, s, replace(f_again, gain=f.gain + more, spared=f.spared, beside=f.beside)
        return best

    def _explained(self, fits: list[Judged]) -> bool:
        """Whether one of the fits leaves less than half of the left-over variance at the worst place."""
        left, before = self.sizes.left, self.base.result.residual_places
        worst = max(left, key=lambda p: left[p], default="")
        after = [f.result.residual_places[worst].rms for _, _, f in fits if f.result is not None and worst in f.result.residual_places]
        return bool(after) and min(after) ** 2 < (1.0 - UNEXPLAINED) * before[worst].rms ** 2

    def _contradicting(self, fits: list[Judged]) -> bool:
        """Whether outputs contradict each other beside the model as it is, and with each of the fits."""
        if not self.sizes.contradicting > OFF:
            return False
        fitted = [(f.problem, f.result) for _, _, f in fits if f.problem is not None and f.result is not None]
        return all(off(*one, contradicting=True) > NEARER * self.sizes.contradicting for one in fitted)

    def _left_near(self, place: str, most: float) -> float:
        """What is left over at a place, or the most of what is at those that an element without a balance of its own joins."""
        left, merged = self.sizes.left, self.base.problem.dae.merged_places
        if place in left:
            return left[place]
        joined = {merged.get(name, name) for name in joined_to(self.base.model, place)}
        return max((left[name] for name in joined if name in left), default=most)


def _best_of_each(fits: Sequence[Judged]) -> list[Judged]:
    """The fits, best first; of one candidate the better one."""
    found = dict[int, Judged]()
    for fit in sorted(fits, key=lambda f: (-f[2].gain, f[0].rank)):
        found.setdefault(id(fit[0]), fit)
    return list(found.values())


def _plainness(fit: Judged) -> tuple[int, ...]:
    """What is kept first of those that are as good: the fewest effects, then the plainest candidate."""
    c, _, f = fit
    change = np.zeros(len(c.strengths)) if f.result is None else fitted_strengths(c, f.result)
    return f.beside, *plainness(c, change)


def _gained(fits: Sequence[Judged], now: Worth) -> list[Judged]:
    """The fits with what they gain over the model as it is."""
    found = gains([(c.place, (c.size, c.rank), f.worth) for c, _, f in fits], now)
    doubts = [f.worth.doubt(now) if s is None and np.isfinite(f.worth.nats) else 0.0 for _, s, f in fits]
    return [(c, s, replace(f, gain=gain, doubt=doubt)) for (c, s, f), gain, doubt in zip(fits, found, doubts, strict=True)]
