"""What is asked of what was found, once a round has kept something: whether all of it stays, and whether what held before still does."""

from __future__ import annotations

from dataclasses import replace
from math import isfinite

from ...problem import Free
from ...results import Smoothing
from ..evidence.latent import without_force
from ..scores.shares import left_over
from .choice import CLEAR, DOUBTS, LATE, RIVAL, idle
from .dates import redated
from .elimination import Bare, alone
from .one_level import OneLevel
from .refit import settled
from .runaway import free_again
from .state import State

LITTLE = 0.1  # of what an effect gained: a model that lacks more without it is another one


def amend(state: State) -> None:
    """All of it, one after the other."""
    for ask in (eliminate, stood_in, late_by_both, of_one_level, dated_again, held_again, freed):
        ask(state)


def eliminate(state: State) -> None:
    """What was found before the last effect and is nothing beside it goes out of the model again.

    Where that made a difference, what stayed is asked once more: it may have stood for what is gone.
    """
    while _without_idle_ones(state):
        pass


def _without_idle_ones(state: State) -> bool:
    """One turn of that; whether something is gone."""
    before = len(state.standing.accepted)
    for k in reversed(range(before - 1)):
        c = state.standing.accepted[k]
        if not idle(c, state.result):
            continue
        state.fits.say(f"{c.title} is nothing beside what was found later")
        found = state.without(k)
        if found is None or (more := state.worth(found.problem, found.result).over(state.now)) < -CLEAR:
            continue
        state.standing = found.instead_of(state.standing.findings[k], more)
    return len(state.standing.accepted) < before


def stood_in(state: State) -> None:
    """What was found before another effect, and took a part of what that is, goes where that one alone does as well.

    Friction of a machine that its controller moves slowly is an input's dead zone, too: while it slides only their sum is told. Their own
    fit sees how a law with a rounded sign creeps and takes it for a difference; of two models that hold a body by the same law it is none
    (`worth.py`). So the model without it is fitted, from where the fit says that the others would be with it at nothing. It stays where the
    model is better with it beyond doubt, or by a tenth of what it gained; two of which one went once are not asked again.
    """
    for k in reversed(range(len(state.standing.accepted) - 1)):
        c, later = state.standing.accepted[k], state.standing.accepted[k + 1 :]
        twin = alone(c, later, state.problem, state.result)
        if twin is None or state.fits.left == 0:
            continue
        heir, begin = twin
        pair = frozenset({c.key, later[heir].key})
        if pair in state.parted:
            continue
        state.fits.say(f"{later[heir].title} without {c.title}")
        found = state.without(k, begin=begin)
        if found is None:
            continue
        gone, worth = state.standing.named[k], state.worth(found.problem, found.result)
        doubt = worth.doubt(state.now)
        most = max(CLEAR, min(DOUBTS * doubt, LITTLE * gone.gain)) if isfinite(doubt) else CLEAR
        if (more := worth.over(state.now)) > -most:
            state.standing = found.instead_of(gone, more, found.named[k + heir])
            state.parted.add(pair)


def late_by_both(state: State) -> None:
    """What is late stays alone where it does as well as it does beside something late that was found first.

    A delay beside a lag of the same signal, a sensor's beside an input's: as late as both are, for no small steps lead there from where
    each makes good what the other one is not.
    """
    if not state.standing.accepted or state.standing.accepted[-1].physics not in LATE:
        return
    *before, new = state.standing.accepted
    (path,) = new.named.values()
    free = state.problem.parameters[path]
    if not isinstance(free, Free):
        return
    for k, old in reversed(list(enumerate(before))):
        alike = old.place == new.place
        asked = old.physics in LATE and old.key != new.key and (alike or old.family != new.family)
        if not asked or state.fits.left == 0:
            continue
        (other,) = old.named.values()
        whole = sum(state.result.parameters[name].value for name in (other, path))
        state.fits.say(f"{new.title} without {old.title}")
        found = state.without(k, begin={path: replace(free, guess=min(whole, free.max))})
        if found is not None and state.worth(found.problem, found.result).over(state.now) > (-CLEAR if alike else -RIVAL):
            state.standing = found.gaining(state.standing.findings[k].gain)
            return


def of_one_level(state: State) -> None:
    """Friction of one level where that is as good, beside a constant force that was found after friction of two."""
    posed = OneLevel.of(state.standing, state.bare, state.first) if state.fits.left > 0 else None
    if posed is None:
        return
    what = f"{posed.candidate.title} instead of {state.standing.accepted[posed.number].title}"
    state.fits.say(what)
    found = state.again(posed.problem, what)
    if found is not None and state.worth(posed.problem, found).over(state.now) > -CLEAR:
        state.standing = posed.instead(state.standing, found, state.sizes)


def dated_again(state: State) -> None:
    """What set in before the last effect was found has the times that are best beside that."""
    for k, c in enumerate(state.standing.accepted[:-1]):
        if c.onset is None or state.fits.left == 0:
            continue
        state.fits.say(f"when {c.title} sets in, beside what was found later")
        new = redated(state.problem, state.standing.model, state.result, c)
        now = state.standing
        posed = None if new is None else now.having((*now.accepted[:k], new, *now.accepted[k + 1 :]), state.bare)
        if new is None or posed is None:
            continue
        problem = settled(posed[0], state.result)
        found = state.again(problem, f"{c.title} from {new.onset} to {new.until}")
        if found is not None and state.worth(problem, found).over(state.now) > 0:
            state.standing = now.at(problem, found, posed[1]).with_dates(k, new)


def held_again(state: State) -> None:
    """Back to held inputs where these are better with what was found: what was missing may have looked like straight ones.

    Then the model without it is the one with held inputs, too.
    """
    if state.held is None or not state.standing.findings or state.fits.left == 0:
        return
    state.fits.say("held inputs again, with what was found")
    straight = settled(state.problem, state.result)
    held = replace(straight, recordings=state.held.problem.recordings)
    one, other = state.again(held, "held inputs"), state.again(straight, "straight inputs")
    if one is not None and (other is None or state.worth(held, one).over(state.worth(straight, other)) > 0):
        state.first, state.first_weights = state.held.result, state.held.problem.weights
        state.first_left = left_over(state.held.problem, state.held.result)
        state.bare = Bare(problem=without_force(state.held.problem), model=state.held.model)
        state.standing, state.held = state.standing.at(held, one), None


def freed(state: State) -> Smoothing | None:
    """The model with inertias that are near their guesses as free as the study has them; it stands there where none of them runs away."""
    problem = free_again(state.problem)
    if problem is state.problem or state.fits.left == 0:
        return None
    what = "inertias as the study has them"
    state.fits.say(what)
    problem = settled(problem, state.result)
    found = state.again(problem, what)
    if found is None:
        state.freely = None
        return None
    worth = state.freely = state.worth(problem, found)
    if state.near_enough(problem, found) and worth.over(state.now) > 0:
        state.standing = state.standing.at(problem, found)
        state.free()
    return found
