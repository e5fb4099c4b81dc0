"""What a study of the weights found, in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..smoothing.explaining import EXPLAINS_NOTHING
from ..wording import listed
from .plan import ALONE
from .recommendation import RULE, alike, likeliest

if TYPE_CHECKING:
    from .components import Component
    from .weigh import Weighing

FELT = 0.1  # of a parameter's std: a weight that moves none by as much, a tenth or tenfold, hardly matters
MOVING = 1.0  # and one that moves some by as much decides about it
TOLD = 0.35  # std of a logarithm above which a weight is hardly told: a factor of two either way
TWINS = 0.9  # correlation of the logarithms of two weights of which the data tell the sum alone, or the ratio
LARGE, SMALL = 0.05, 0.01  # of the forces at a place: what a balance leaves over
LOST = 1e3  # the largest condition number of all settings over the one in their middle
DIGITS = 16.0  # of a number
NAMED = 6  # settings that did not converge


def unreliable(arrived: bool, notes: Sequence[str]) -> str:
    """What comes before a recommendation that is none; notes: of smoothing with the recommended weights."""
    lost = [] if arrived else ["the search for the weights of greatest likelihood went no further, and they have no intervals"]
    if any(EXPLAINS_NOTHING in note for note in notes):
        lost.append(f"with them {EXPLAINS_NOTHING}, as where a few samples lie far off and no loss (auto, huber) leaves them out")
    return f"Not to be relied on: {' and '.join(lost)}. " if lost else ""


def words(found: Weighing) -> tuple[str, ...]:
    """Sentences, the most important ones first."""
    return (found.why, *_equations(found), *_weights(found), *_moving(found), *_kinds(found), *_conditioning(found))


def of_each(found: Weighing) -> list[str]:
    """Noise that recordings have of their own."""
    V = found.recommended.weights.V
    out = []
    for label, c in found.components.items():
        own = {case.partition(" [")[2][:-1]: std for case, std in V.items() if label.startswith("V ") and case.startswith(f"{label[5:]} [")}
        if own:
            each = listed([f"{std:.3g} {c.unit} in {name}" for name, std in own.items()])
            out.append(f"{label} is {each}, turned together; the table has their rms.")
    return out


def _equations(found: Weighing) -> list[str]:
    out = []
    for place, (rms, _) in found.best.force.items():
        size, component = found.forces.get(place), found.components.get(f"W of {place}")
        if component is not None and component.may_be_none:
            out.append(_doubtful(found, place, component))
        if size is None or component is None or component.may_be_none:
            continue
        share = rms / size
        if share > LARGE:
            left = f"{place}: the data cannot satisfy its balance: {100 * share:.0f} % of its forces are left over"
            out.append(f"{left}, as noise or as physics that the model lacks: `backsight diagnose` tells which.")
        elif share < SMALL:
            known = component.p_zero is not None and np.isfinite(component.p_zero)
            beside = "but more than none" if known else "and whether more than none is not known"
            out.append(f"{place}: its balance leaves {100 * share:.2g} % of its forces over: little, {beside}.")
        else:
            out.append(f"{place}: its balance leaves {100 * share:.1f} % of its forces over.")
    return out


def _doubtful(found: Weighing, place: str, component: Component) -> str:
    """Of a force that the data do not tell from none, how large it may be: beside what the rule of magnitudes makes of the forces there."""
    most, chance = component.interval[1], f"p = {component.p_zero:.2g} without it"
    rule = next((o.weights.get(f"W of {place}", np.nan) for o in found.outcomes if o.setting.name == RULE), np.nan)
    share = most / rule if place in found.forces and rule > 0 else np.nan
    untold = f"{place}: the data do not tell a residual force from none ({chance})"
    if not np.isfinite(most):
        return f"{untold}, nor how large it is at most."
    limit = f"is at most {most:.2g} {component.unit} at 95 %"
    if not np.isfinite(share):
        return f"{untold}; its std {limit}."
    over = "" if place in found.problem.weights.tau else "over a sampling interval "
    limit = f"{limit}, {over}{100 * share:.2g} % of the rms of the largest force there"
    if share < SMALL:
        return f"{place}: its balance holds as it stands: the std of a residual force {limit} ({chance})."
    return f"{untold}; its std {limit}."


def _weights(found: Weighing) -> list[str]:
    hardly = [label for label, c in found.components.items() if not c.may_be_none and c.log_std > TOLD]
    out = [f"The data hardly tell {listed(hardly)}: a factor of two either way would do."] if hardly else []
    untold = [label for label, c in found.components.items() if found.arrived and label.startswith("V") and np.isnan(c.log_std)]
    for label in untold:
        given = _given_noise(found, label.removeprefix("V of "))
        refused = given and not np.isclose(given, found.components[label].std).any()  # each recording may have one of its own
        told = f"only that its noise is less than the {given[0]:.3g} given" if refused else "nothing of its noise"
        out.append(f"{label}: the residual forces can follow every sample, and tell {told}; give what its sensor has.")
    twins = [pair for pair, r in found.correlation.items() if r < -TWINS]
    out += [f"{a} and {b} explain the same: what one has more the other has less." for a, b in twins]
    tied = [pair for pair, r in found.correlation.items() if r > TWINS]
    return out + [f"The data tell the ratio of {a} and {b} better than either: what one has more the other has too." for a, b in tied]


def _given_noise(found: Weighing, output: str) -> list[float]:
    """The noise that the problem gives an output of the fitted recordings."""
    given = [found.problem.weights.noise(output, r) for r in found.problem.recordings if r.role == "fit"]
    return [std for std in given if std is not None]


def _moving(found: Weighing) -> list[str]:
    quiet, out = list[str](), list[str]()
    best = likeliest(found.outcomes)
    solved = {(o.setting.varied, o.setting.factor) for o in found.outcomes if best is not None and alike(o, best)}
    for label, moves in found.moves.items():
        ends = [(abs(move), name, word) for name, pair in moves.items() for move, word in zip(pair, ("a tenth", "ten times"), strict=True)]
        told = [end for end in ends if np.isfinite(end[0])]  # what is undetermined or on its bound moves by no share of its deviation
        if told and max(told)[0] < FELT and {(label, factor) for factor in (min(ALONE), max(ALONE))} <= solved:
            quiet.append(label)
        if told and max(told)[0] > MOVING:
            size, most, word = max(told)
            out.append(f"{label} decides about {most}: with {word} its std it moves by {size:.1f} of its deviations.")
    still = f"Hardly a matter: {listed(quiet)}; with a tenth or ten times the std no parameter moves by {FELT:g} of its deviation."
    return [still, *out] if quiet else out


def _kinds(found: Weighing) -> list[str]:
    """Settings whose parameters cannot be compared with those of greatest likelihood, about which all are turned."""
    best = likeliest(found.outcomes)
    others = [o.setting.name for o in found.outcomes if best is not None and o.converged and not alike(o, best)]
    if best is None or not others:
        return []
    one, other = "those of most marginal likelihood", "those most probable together with a trajectory"
    here, there = (one, other) if best.arrived else (other, one)
    return [f"With {listed(others)} parameters are {there}, with the weights of greatest likelihood {here}: they do not compare."]


def _conditioning(found: Weighing) -> list[str]:
    solved = [o for o in found.outcomes if np.isfinite(o.condition)]
    failed = [o.setting.name for o in found.outcomes if not o.converged]
    usual = float(np.median([o.condition for o in solved])) if solved else np.nan
    worst = max(solved, key=lambda o: o.condition, default=None)
    out = []
    if worst is not None:
        digits = DIGITS - np.log10(worst.condition)
        text = f"Condition numbers of the KKT matrix: {usual:.1e} in the middle, {worst.condition:.1e} at most, with {worst.setting.name}"
        out.append(f"{text}{f', where {max(digits, 0):.0f} of 16 digits are left' if worst.condition > LOST * usual else ''}.")
    if failed:
        named = failed if len(failed) <= NAMED else [*failed[: NAMED - 1], f"{len(failed) - NAMED + 1} others"]
        out.append(f"No convergence with {listed(named)}.")
    return out
