"""What a search has found so far, and how models are fitted and compared beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from ...problem import Free, Problem, Weights
from ...results import Smoothing
from ...smoothing.program import Settings
from ..answer.verdict import Key
from ..evidence.latent import without_force
from ..evidence.worth import Worth
from ..scores.shares import Sizes, left_over
from .elimination import Bare
from .fits import Base, Fits
from .refit import HELD, QUICKLY, settled, worth_of
from .runaway import Near, free_again, wild, with_inertias_near
from .standing import Standing


@dataclass
class State:
    """The model with what was found, at first as it was declared, and what it is held against.

    standing: that model. fits: where candidates are fitted, and until when; settings: of these. held: the model as it is with its inputs
    held, as a study has them, where straight ones were better for it. bare: the problem and its model before anything was found. first: the
    model without anything that was found, with weights from the data where it was smoothed with these; first_weights: of its problem;
    first_left: place -> what it leaves over. sizes: of the last round's forces. freely: where inertias are near their guesses
    (`runaway.py`), what the model as it is is worth with these free. parted: keys of two that were found together, of which one went.
    """

    standing: Standing
    fits: Fits
    settings: Settings = QUICKLY
    held: Standing | None = None
    first_left: dict[str, float] = field(default_factory=dict)
    bare: Bare = field(init=False)
    first: Smoothing = field(init=False, repr=False)
    first_weights: Weights = field(init=False, repr=False)
    sizes: Sizes = field(init=False, repr=False)
    freely: Worth | None = field(default=None, init=False, repr=False)
    parted: set[frozenset[Key]] = field(default_factory=set, init=False, repr=False)
    _checked: Smoothing | None = field(default=None, init=False, repr=False)
    _told: tuple[Smoothing, bool, Worth] | None = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        self.bare = Bare(problem=without_force(self.standing.problem), model=self.standing.model)
        self.first, self.first_weights = self.standing.result, self.standing.problem.weights

    @property
    def problem(self) -> Problem:
        """The problem with what was found so far."""
        return self.standing.problem

    @property
    def result(self) -> Smoothing:
        """Its smoothing."""
        return self.standing.result

    @property
    def most_left(self) -> float:
        """The largest share of the forces at a place that is left over."""
        return max(left_over(self.problem, self.result).values(), default=self.sizes.most)

    @property
    def base(self) -> Base:
        """What candidates are fitted beside."""
        changes = tuple(f.change for f in self.standing.findings)
        return Base(problem=self.problem, model=self.standing.model, result=self.result, settings=self.settings, changes=changes)

    @property
    def now(self) -> Worth:
        """What the model as it is is worth."""
        if self._told is None or self._told[0] is not self.result or self._told[1] is not self.settings.weigh:
            self._told = self.result, self.settings.weigh, self.worth(self.problem, self.result)
        return self._told[2]

    @property
    def near(self) -> set[str]:
        """Inertias that are near their guesses."""
        return {name for name, free in self.problem.parameters.items() if isinstance(free, Near)}

    def near_enough(self, problem: Problem, result: Smoothing) -> bool:
        """Whether no inertia of the study has run away in a result of a problem."""
        return not (wild(problem, result) or with_inertias_near(problem, result, free_again(self.bare.problem).parameters)[1])

    def free(self) -> None:
        """Inertias that were near their guesses are so no longer, in no model that may come."""
        self.bare = replace(self.bare, problem=free_again(self.bare.problem))
        self.held = self.held and replace(self.held, problem=free_again(self.held.problem))
        self.freely = None

    def worth(self, problem: Problem, result: Smoothing) -> Worth:
        """What the models of one round compare by."""
        return worth_of(problem, result, weighed=self.settings.weigh)

    def again(self, problem: Problem, what: str) -> Smoothing | None:
        """A fit of the model as it is, posed otherwise; None where it does not arrive. what: in words, other ones for every fit."""
        return self.fits.again(self.base, problem, what)

    def without(self, k: int, least: float = 0.0, begin: Mapping[str, Free] | None = None) -> Standing | None:
        """Without the k-th of what was accepted, fitted anew; None where others need that, or it does not arrive.

        least: time that the fit has when the search's is over [s]. begin: parameters that begin elsewhere than where they are; first at the
        weights as they are then, which that is no reason to leave.
        """
        posed = self.standing.having(self.standing.others(k), self.bare)
        if posed is None:
            return None
        problem, c, base = settled(posed[0], self.result), self.standing.accepted[k], self.base
        what = f"without {c.title}, {c.key}, {sorted(c.named.values())}, {c.onset}"
        if begin:
            own = {name: free for name, free in begin.items() if name in problem.parameters}
            problem, what = replace(problem, parameters={**problem.parameters, **own}), f"{what}, {begin}"
            at_held = replace(HELD, supposed=base.settings.supposed, step=base.settings.step)
            held = self.fits.again(replace(base, settings=at_held), problem, f"{what}, held") if base.settings.weigh else None
            if held is not None:
                problem, base = settled(problem, held), replace(base, result=held)
        found = self.fits.again(base, problem, what, least=least)
        return None if found is None else self.standing.taking_out(k, self.standing.at(problem, found, posed[1]))

    def on_a_checked_mesh(self) -> None:
        """The model with what was found on a mesh that no longer moves its numbers: candidates are compared on that which it began with.

        Nothing where it is on such a mesh already. Components of what a richer law has taken over wholly are not in it.
        """
        if self.standing.findings and self.fits.left > 0 and self.result is not self._checked:
            self.fits.say("the mesh, with what was found")
            base = replace(self.base, settings=replace(self.settings, check_mesh=True))
            holds = "".join(f", {r.name} {r.hold}" for r in self.problem.recordings)
            problem, model = self.standing.tidied(self.bare)
            self._checked = self.fits.again(base, settled(problem, self.result), f"on a checked mesh{holds}")
            if self._checked is not None:
                self.standing = self.standing.at(problem, self._checked, model)

    def renew(self) -> None:
        """What was found has the numbers that it has in the model as it stands."""
        self.standing = self.standing.renewed(self.sizes)
