"""The force that is left over when nothing more is found: a finding without a name, a note, or nothing worth a word."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ...smoothing.begun import force_stds
from ..answer.verdict import Finding, Tried
from ..scores.lasting import lasting
from ..scores.shares import FLOOR, Sizes
from .choice import CLEAR
from .findings import nameless
from .fits import Base, Fits
from .refit import settled, worth_of

LAST, TRIES = 200.0, 200  # s, at least, and iterations of the fit that tells whether it is needed
NAMELESS = 0.02  # of the forces at a place: a force that lasts, is no larger, and that nothing explains is no finding
SMALL = f"Less than {100 * FLOOR:.0f} % does not matter, whatever tests say of residual forces."
UNEXPLAINED = 0.5  # of the left-over variance: a repair that leaves more than this is none


@dataclass(frozen=True, kw_only=True)
class LeftOver:
    """A model as the search leaves it, and what was left over beside its first one, place -> share of the forces there.

    sizes: of its forces; fits: where it is fitted once more; seed: of what is drawn.
    """

    base: Base
    sizes: Sizes
    first: Mapping[str, float]
    fits: Fits
    seed: int = 0

    def told(self, tried: Sequence[Tried]) -> Finding | str:
        """A finding, or a note; "" where no place has a residual force."""
        worst, share = max(self.sizes.left.items(), key=lambda item: item[1], default=("", 0.0))
        if not worst:
            return ""
        summary = self.base.result.residual_places[worst]
        force = f"{summary.rms:.3g} {summary.unit} rms, {100 * share:.2g} % of the forces there"
        if share <= FLOOR:
            return f"Left over at {worst}: a force of {force}, and at no place a larger share. {SMALL}"
        if self.explained >= UNEXPLAINED:
            return f"Unexplained at {worst}: a force of {force}."
        if (lasts := lasting(self.sizes.base, worst, self.seed)) * share <= NAMELESS:
            kept = f"{100 * lasts * share:.2g} % of them last for longer than noise, of which W tells"
            return f"Left over at {worst}: a force of {force}. {kept}: too little for something that is missing."
        if not self.needed(worst):
            return f"Left over at {worst}: a force of {force}. With next to none the recordings are as likely: they do not need it."
        return nameless(worst, share, self.base.result, tried, self.base.problem)

    def needed(self, place: str) -> bool:
        """Whether the recordings need the force that is left over at a place: with as little as does not matter they are less likely.

        On a body that no output shows it may be any: its weight is hardly told, and the most likely one is not nothing.
        """
        base = self.base
        if base.result.solution is None or not base.settings.weigh:
            return True
        little = force_stds(base.result.solution)[place] * FLOOR / 2 / self.sizes.left[place]
        weights = replace(base.problem.weights, W={**base.problem.weights.W, place: little})
        problem = settled(replace(base.problem, weights=weights), base.result)
        self.fits.say(f"with next to no force at {place}")
        settings = replace(base.settings, options=replace(base.settings.options, max_iterations=TRIES))
        found = self.fits.again(replace(base, settings=settings), problem, f"with next to no force at {place}", least=LAST)
        if found is None:
            return True
        less, now = worth_of(problem, found, weighed=True), worth_of(base.problem, base.result, weighed=True)
        return not less.over(now) > -CLEAR

    @property
    def explained(self) -> float:
        """Share of the variance of the left-over forces that mattered at first and is explained now, of the place where that is most."""
        left = self.sizes.left
        parts = [1.0 - (left.get(p, 0.0) / was) ** 2 for p, was in self.first.items() if was > FLOOR]
        return max(parts, default=1.0 if self.base.changes else 0.0)
