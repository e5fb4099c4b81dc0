"""The rounds of the search: scores, fits of the best, one that is kept; and what is left when there is none."""

from __future__ import annotations

import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...problem import Free
from ...wording import listed
from ..answer.verdict import Class, Finding, Tried, Undetectable
from ..answer.words import UNKNOWN
from ..candidates.candidate import Candidate, Kind
from ..evidence.latent import Latent
from ..scores.shares import Sizes, limits
from .amended import amend, freed
from .choice import CLEAR, chosen, idle
from .findings import verdict
from .fits import Base
from .left_over import NAMELESS, LeftOver
from .refit import QUICKLY, comparable, hidden, settled
from .refusals import loose
from .round import Best, Round
from .runaway import free_again
from .standing import FEW, Standing
from .state import State

EFFECTS = 6
MOVES = 3  # times that the model as it is goes where a fit came to rest
AGAIN, WORTH = 5, 1.0  # times that the model as it is is fitted once more, at most; nats for which it is done another time
LOST = 0.2  # of what an effect gained, that sharp corners may cost
ASTRAY = 0.1  # of the forces at a body that no output shows: with as much left over its parameters may have gone anywhere
OWED = 0.25  # of the time that is left: as much at most is kept for the scores after a round's fits
AS_IT_IS, TURNS = 1e-4, 3  # relative difference of a number that need not be moved, nor by a deviation; times that it is, at most
FINER = 1.2  # times as many intervals: a mesh on which numbers are others

INCOMPARABLE = (
    "No models were compared: where the model as it is came to rest the recordings do not tell its parameters and states apart. Give what "
    "is known of them, in [parameters], in [initial] or by another sensor."
)
OUT_OF_TIME = "The search was ended by its limit of time: there may be more. A second run goes on from here."
HELD_NEAR = (
    "With what was found {names} would still be far from what was guessed, and was held near it: more is missing than that, or the guess "
    "is far off. Verdict and numbers are those beside it."
)

Ended = tuple[Standing, list[str], list[Undetectable], tuple[str, ...], bool]


@dataclass
class Search(State):
    """The rounds, and what came of them besides the model as it stands.

    seed: of what is drawn. tried: what was fitted, last_tried: in the last round. gone: what is not looked for any more. notes: on the
    search; closing: on the model that it ends with. before: what there was before the last effect was found; aside: what was taken back to
    be sought again with weights from the data. compared: whether models could be; cut: what may be missing in the model as it stands, and
    whose fit had no time. moved: how often the model as it is went where a fit came to rest. asked: beside which candidate it was smoothed
    from the guesses, too. beforehand: what was found before any of it.
    """

    seed: int = 0
    tried: list[Tried] = field(default_factory=list)
    last_tried: Sequence[Tried] = ()
    undetectable: list[Undetectable] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    closing: list[str] = field(default_factory=list)
    beforehand: tuple[Finding, ...] = ()
    gone: set[Kind] = field(default_factory=set, init=False)
    before: Standing | None = None
    aside: Standing | None = field(default=None, init=False, repr=False)
    compared: bool = field(default=True, init=False)
    cut: tuple[str, ...] = field(default=(), init=False)
    moved: int = field(default=0, init=False)
    asked: Candidate | None = field(default=None, init=False)

    def run(self) -> None:
        """Rounds until nothing more is found; then what could not have been seen.

        Where weights are held they come from the data as soon as the model bears it: evidences at held weights find what leads most of the
        forces astray, but what is left of them then they take for an effect too. A model that has none at held weights is weighed at once,
        and so is one that has a force for what is missing: nothing leads the others astray.
        """
        at_once = isinstance(self.problem.weights, Latent) or not comparable(self.problem, self.result)
        tried = at_once and not self.settings.weigh
        if tried:
            self._weighed()
        self._as_fits_are()
        self.first = freed(self) or self.first
        scored, late = self._rounds(tried=tried)
        if late or self.fits.left == 0:
            if self.aside is not None:
                self.standing = self.aside
                scored = self._scored()
                self.cut, self.fits = _unfitted(scored), replace(self.fits, owed=0.0)
            self.notes.append(OUT_OF_TIME)
        self._closed(scored)

    def go_on(self, without: Collection[Candidate]) -> bool:
        """Whether the model is another one once more was looked for in the place of what went since it was not borne out.

        That is not looked for again, nor whether inputs are held. Not asked where next to nothing is left over without it, or no time is.
        """
        if self.fits.left == 0 or not self.compared or self.most_left <= NAMELESS:
            return False
        self.gone |= {c.kind for c in without}
        self.before = self.aside = self.held = None
        self._unnamed_out()
        had = self.result
        scored, late = self._rounds(tried=True)
        self._closed(scored)
        if late or self.fits.left == 0:
            self.closing.append(OUT_OF_TIME)
        return self.result is not had

    def told_anew(self) -> None:
        """What is left over in the model as it stands, after something went."""
        self._unnamed_out()
        self._said_of(self._scored())

    def _unnamed_out(self) -> None:
        self.standing = replace(self.standing, findings=tuple(self.standing.named))

    @property
    def ended(self) -> Ended:
        """How it ended."""
        return self.standing, self.closing, self.undetectable, self.cut, self.compared

    def back_to(self, ended: Ended) -> None:
        """As it had ended before it went on."""
        self.standing, self.closing, self.undetectable, self.cut, self.compared = ended

    def _rounds(self, *, tried: bool) -> tuple[Round, bool]:
        """Rounds until nothing is kept: the last one, and whether that is for want of time. tried: whether weights from the data were."""
        more = True
        while more:
            scored = self._scored()
            if self._better_from_the_guesses(scored):
                scored = self._scored()
            late = self.fits.left == 0
            self.cut = _unfitted(scored) if late else ()
            more = not late and len(self.standing.findings) < EFFECTS and self._went_on(scored)
            if not self.settings.weigh and (more or not tried):
                tried = True
                more |= self._weighed()
            if more:
                amend(self)
        self.fits = replace(self.fits, owed=0.0)
        return scored, late

    def _closed(self, scored: Round) -> None:
        """The model with what was found on a checked mesh, and what is said of it in the end. scored: the last round."""
        self.on_a_checked_mesh()
        self.renew()
        self._said_of(scored)

    def _said_of(self, scored: Round) -> None:
        self.closing = []
        if self.cut:
            self.closing.append(f"What may be missing had no time for a fit that ends: {listed(sorted({*self.cut}))}.")
        if self.near and self.standing.named:
            self.closing.append(HELD_NEAR.format(names=listed(sorted(self.near))))
        self._limits(scored)

    @property
    def repaired(self) -> bool:
        """Whether anything that has a name was found."""
        return bool(self.standing.named or self.beforehand)

    def _as_fits_are(self) -> None:
        """The model as it is fitted once more from where it came to rest, as candidates are: what that alone gains is nobody's merit."""
        for k in range(AGAIN if self.settings.weigh else 0):
            problem = settled(self.problem, self.result)
            again = self.again(problem, f"the model as it is, as fits are, {k + 1}")
            if again is None:
                return
            more = self.worth(problem, again).over(self.now)
            if self.result.solver.converged and not more > 0:
                return
            self.standing = self.standing.at(problem, again)
            if more < WORTH:
                return

    def _finer(self) -> None:
        """The same at once, and for all that comes: what a lag makes of a mesh that is too coarse for it, further effects would explain."""
        had = self.result.solution
        self.on_a_checked_mesh()
        now = self.result.solution
        if had is None or now is None:
            return
        before, after = had.transcription, now.transcription
        if len(after.nlp.steps) > FINER * len(before.nlp.steps):
            self.settings = replace(self.settings, step=min(float(np.median(h.mesh.steps)) for h in after.horizons))

    def _scored(self) -> Round:
        """All candidates beside the model as it is; as much time as that takes is owed to the scores that come after its fits."""
        now, began = self.standing, time.time()
        self.fits.say(f"round {len(now.findings) + 1}: scores")
        brought = loose(now.findings, now.accepted, self.bare.model, now.model)
        scored = Round.of(self.base, self.bare, now.accepted, brought, self.fits, self.seed, self.gone)
        self.sizes, self.first_left = scored.sizes, self.first_left or scored.sizes.left
        self.fits = replace(self.fits, owed=min(time.time() - began, OWED * max(self.fits.end - time.time(), 0.0)))
        return replace(scored, fits=self.fits)

    def _better_from_the_guesses(self, scored: Round) -> bool:
        """Whether the model with what was found is better from the guesses of the study; then it is there.

        Asked once beside what was found last, where a body that no output shows leaves much over. Where the model as it was, which was
        wrong, came to rest that body's parameters may be anything, and no small steps lead back from there.
        """
        unseen = {name: left for name, left in scored.sizes.left.items() if name in hidden(self.problem)}
        accepted = self.standing.accepted
        if not accepted or self.asked is accepted[-1] or max(unseen.values(), default=0.0) < ASTRAY or self.fits.left == 0:
            return False
        self.asked = accepted[-1]
        posed = self.standing.having(accepted, self.bare)
        self.fits.say("the model with what was found, from the guesses")
        found = None if posed is None else self.fits.anew(self.base, posed[0])
        if posed is None or found is None or not self.worth(*found).over(self.now) > CLEAR:
            return False
        self.standing = self.standing.at(*found, posed[1])
        return True

    def _went_on(self, scored: Round) -> bool:
        """Whether a round ends with something to keep, which is kept, or with a better rest of the model as it is.

        None can be better than a model of which nobody knows how good.
        """
        now = self.now
        if not np.isfinite(now.nats):
            self.compared = False
            self.notes.append(INCOMPARABLE)
            return False
        outcome: Best | Base | None = None
        if (freely := self._with_inertias_free(scored)) is not None:
            outcome = freely.best_of_the_likely(self.freely or now, self.near_enough)
        if freely is not None and outcome is not None:
            scored = freely
            self.free()
        else:
            outcome = scored.best(now, moving=self.moved < MOVES)
        self.tried, self.last_tried = [*self.tried, *scored.tried], scored.tried
        self.cut = tuple(c.title for c, _, fit in scored.fitted if fit.late and not np.isfinite(fit.gain))
        if isinstance(outcome, Base):
            self.standing, self.moved = self.standing.at(outcome.problem, outcome.result), self.moved + 1
            if not self.standing.findings:
                self.first_left = {}  # no effect has explained what is left over no longer
        elif outcome is not None:
            self._keep(scored, outcome)
        return outcome is not None

    def _with_inertias_free(self, scored: Round) -> Round | None:
        """A round that fits with inertias free which are near their guesses; None where there are none."""
        problem = free_again(self.problem)
        return None if problem is self.problem else replace(scored, base=replace(scored.base, problem=problem), fitted=[])

    def _weighed(self) -> bool:
        """Whether the model has come to rest with weights from the data, found from here; then the search goes on with these.

        What was found last at held weights is taken back where these do not bear it out, and where it gained little: then it is sought
        once more, for a force with a memory and less than its share gains as much.
        """
        self.fits.say("weights from the data")
        found = self.fits.weighed(self.base, self.problem, self.result)
        if found is None:
            return False
        now, found = self.standing.at(*found), None
        if self.before is not None and (idle(now.accepted[-1], now.result) or now.findings[-1].gain < FEW):
            self.fits.say(f"{now.accepted[-1].title} is asked again")
            found = self.fits.weighed(self.base, self.before.problem, now.result)
        if self.before is not None and found is not None:
            self.aside = None if idle(now.accepted[-1], now.result) else now
            now = self.before.at(*found)
        self.standing, self.settings = now, replace(QUICKLY, supposed=self.settings.supposed, step=self.settings.step)
        if not self.standing.findings:
            self.first, self.first_weights = self.result, self.problem.weights
            self.first_left = {}  # held weights left it elsewhere, and nothing has explained that
            self.first = freed(self) or self.first
        return True

    def _keep(self, scored: Round, best: Best) -> None:
        """The best becomes a part of the model."""
        had, now = self.standing, self.standing.keeping(scored, best)
        c, new, old = now.accepted[-1], now.problem.dae, had.problem.dae
        brought = {p.name for p in new.places} - {p.name for p in old.places}
        self.settings = replace(self.settings, supposed=self.settings.supposed | (hidden(now.problem) & brought))
        self.standing, self.before, self.aside = now, had, None
        self._free(c)
        if c.signals and len(new.states) > len(old.states):
            self._finer()

    def _free(self, c: Candidate) -> None:
        """What comes free with a candidate once it is kept, and what is rounded by what was found of it, where that is no worse.

        Of rounding it may be a little worse: no machine has such corners, and wide ones pass for what contacts have besides stiffness.
        """
        free: dict[str, Free | float] = {name: Free(*bounds) for name, bounds in c.later.items()}
        least = -LOST * self.standing.findings[-1].gain if c.rounded else 0.0
        for turn in range(TURNS):
            now = self.result.parameters
            for name, (whole, share) in c.rounded.items():
                if whole not in now or name not in now:
                    continue  # every recording has its own
                value, std = share * now[whole].value, share * (now[whole].std or 0.0)
                if abs(value - now[name].value) > max(std, AS_IT_IS * abs(value)):
                    free[name] = value
            if not free:
                return
            problem = settled(replace(self.problem, parameters={**self.problem.parameters, **free}), self.result)
            found = self.again(problem, f"{c.title}, as it was found" + (f", {turn + 1}" if turn else ""))
            if found is None or not (more := self.worth(problem, found).over(self.now)) > (-CLEAR if turn else least):
                return
            self.standing, free = self.standing.at(problem, found).gaining(more), {}

    def _limits(self, scored: Round) -> None:
        """What could not have been seen, and what is left over."""
        skipped = {f.explanation.key for f in self.standing.findings}
        self.undetectable = limits(scored.found, scored.sizes, self.standing.model, skipped)
        self._unexplained(scored.sizes)

    def _unexplained(self, sizes: Sizes) -> None:
        """What is left over and matters: a finding without a name, or a note beside those that have one."""
        left = LeftOver(base=self.base, sizes=sizes, first=self.first_left, fits=self.fits, seed=self.seed)
        refused = sorted((t for t in self.last_tried if t.refused and t.fitted is not None), key=lambda t: -(t.fitted or 0.0))
        rest = left.told(refused)
        if isinstance(rest, Finding):
            self.standing = replace(self.standing, findings=(rest, *self.standing.findings))
        elif rest:
            self.closing.append(rest)

    def withdraw(self) -> None:
        """The model as it was declared; of what was found only forces without a name stay."""
        nameless = tuple(f for f in self.standing.findings if f.explanation.physics == UNKNOWN)
        problem = replace(free_again(self.bare.problem), weights=self.first_weights)
        self.standing = Standing(problem=problem, model=self.bare.model, result=self.first, findings=nameless)

    def verdict(self) -> Class:
        """One word for what was found; where nothing was, and models were not compared or had no time, there is none.

        Nor is there where inertias would run away with what was found.
        """
        there = (*self.beforehand, *self.standing.findings)
        if not self.compared or (self.cut and not there):
            return "undecided"
        found = verdict(there)
        return "undecided" if self.near and self.standing.named and found != UNKNOWN else found


def _unfitted(scored: Round) -> tuple[str, ...]:
    """What would be fitted in a round that has no time for it."""
    return tuple(s.candidate.title for s in chosen(scored.found, scored.sizes))
