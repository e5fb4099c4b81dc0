"""Which of the candidate weights a study recommends, and why: those that what was held out speaks for.

    sum log p(held out | weights)  more than TIED ahead of that with the weights of greatest likelihood, or else these themselves

Where nothing that was held out can judge, what was fitted does.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from backsight.models.errors import InputError

from ..wording import listed
from .setting import Outcome

TIED = 3.0  # log likelihood of what was held out: less makes no difference
LIKELIHOOD, GIVEN, RULE, FIRST = "greatest likelihood", "as given", "rule of magnitudes", "as smooth chooses them"
JUDGED = "what was held out is more probable with them"
THOSE = {
    LIKELIHOOD: "the weights of greatest likelihood",
    GIVEN: "the weights as given",
    RULE: "those of the rule of magnitudes",
    FIRST: "those that smooth chooses by itself",
}


def likeliest(outcomes: Sequence[Outcome]) -> Outcome | None:
    """Of the setting of greatest likelihood, about which all others are turned; None where it did not converge."""
    return next((o for o in outcomes if o.setting.name == LIKELIHOOD and o.converged), None)


def alike(one: Outcome, other: Outcome) -> bool:
    """Whether parameters of both are there and of one kind: with another kind they would differ by more than by the weights."""
    return one.converged and other.converged and one.arrived == other.arrived


def recommended(outcomes: Sequence[Outcome], *, held_out: bool) -> tuple[Outcome, str]:
    """The candidate and a sentence; held_out: whether anything was. Raises InputError where no candidate converged."""
    every = [o for o in outcomes if o.setting.group == "candidate"]
    candidates = [o for o in every if o.converged]
    if not candidates:
        states = listed([f"{o.status.rstrip('.')} with {THOSE[o.setting.name]}" for o in every])
        remedy = "smooth it with weights that are given and mend what the notes say of parameters, starts and units; then weigh again"
        raise InputError(f"weigh: the study recommends nothing, because no candidate converged ({states}); {remedy}.")
    judged = [o for o in candidates if np.isfinite(o.held_out)]
    best, lost = likeliest(judged or candidates), list[str]()
    if best is None:
        best = max(judged or candidates, key=_fitted)
        lost = [] if likeliest(candidates) else [f"there was no convergence with {THOSE[LIKELIHOOD]}"]
    if not judged:
        none = "what was held out could not be smoothed with any, and judges none" if held_out else "nothing was held out to judge them"
        return best, _sentence(best, [*lost, none])
    unjudged = [THOSE[o.setting.name] for o in candidates if o not in judged]
    lost += [f"what was held out could not be smoothed with {listed(unjudged)}"] if unjudged else []
    first = max(judged, key=lambda o: o.held_out)
    chosen, behind = (first, [best]) if first.held_out - best.held_out > TIED else (best, judged)
    others = [f"{THOSE[o.setting.name]} (by {ahead:.0f} nats)" for o in behind if (ahead := chosen.held_out - o.held_out) > TIED]
    tied = [THOSE[o.setting.name] for o in behind if o is not chosen and abs(chosen.held_out - o.held_out) <= TIED]
    why = [f"{JUDGED} than with {listed(others)}"] if others else []
    why += [f"between them and {listed(tied)} it makes no difference of more than {TIED:g} nats"] if tied else []
    return chosen, _sentence(chosen, [*why, *lost])


def _sentence(chosen: Outcome, why: list[str]) -> str:
    return "; ".join([f"Recommended: {THOSE[chosen.setting.name]}", *why]) + "."


def _fitted(outcome: Outcome) -> float:
    """Log likelihood of what was fitted, least where there is none."""
    return outcome.log_likelihood if np.isfinite(outcome.log_likelihood) else -np.inf
