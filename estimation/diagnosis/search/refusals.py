"""Why a fit that brought enough evidence is no explanation all the same."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from backsight.models import Model

from ...results import Smoothing
from ...smoothing.along import shown_of_ways
from ...smoothing.begun import followed_by
from ...smoothing.rest import rounded_signs, sliding, strengths_at_rest
from ..answer.verdict import TOO_SMALL, Finding, Tried
from ..candidates.candidate import Candidate
from ..scores.screen import Screen, Screened
from ..scores.shares import FLOOR, Sizes, leaves_more
from .choice import LATE, SIGNALS, amiss, clear, sound
from .findings import Judged, explained, fitted_strengths
from .refit import Fitted

DETAIL = 0.05  # of what a coupling gained: what acts within it and gains less mends its model
SIMPLE = {"d": "viscous_friction", "f_c": "coulomb_friction", "tau_c": "coulomb_friction"}  # by what they are in a base law
VISCOUS = ("d", "d_plus", "d_minus")
ONE_WAY = ("f_plus", "f_minus", "tau_plus", "tau_minus")
HARDLY_LATE = 0.05  # of a sampling interval, where the fit of what is late begins
YIELDS = 3.0  # standard deviations of a position, by which asperities have to bend to be told from ones that do not
SLIDES = 0.01  # of all that a body slides: by less than that nothing is known of a direction
LARGE, SEEN = 10.0, 0.1  # times all that varies at its place, and part of it that was left over there before: see `stands_in`


@dataclass(frozen=True, kw_only=True)
class Beside:
    """What a fit is judged beside: what the model has already, its result, its forces and all scores.

    loose: components of couplings that were found soft or loose, and what these brought; least: nats that an effect there has to bring.
    """

    accepted: Sequence[Candidate]
    result: Smoothing
    sizes: Sizes
    found: Screen
    loose: Collection[str] = ()
    least: float = 0.0


def why_not(c: Candidate, s: Screened | None, f: Fitted, beside: Beside) -> str:
    """What speaks against a fit, in words; "" where nothing does."""
    before, sizes = beside.result, beside.sizes
    if not sound(c, f):
        return "its strength is not told, or none that it can have"
    if slight(c, s, f, sizes):
        return TOO_SMALL
    if c.place in beside.loose and f.gain < beside.least:
        return "a detail of the coupling that was found: no model of one is exact"
    if refining(c, s, f, before, sizes, beside.found):
        return "hardly other than the law that the model has"
    if creeping(c, f):
        return "only how a rounded sign creeps at rest"
    if unyielding(c, f):
        return "Coulomb friction: it yields by less than samples tell before it slides"
    if one_way(c, f):
        return "of a direction in which the body hardly ever slides"
    if trifling(c, f, beside.accepted, before, sizes):
        return "one more law of a kind of which there are two, and it hardly helps"
    if misleading(c, f, sizes):
        return "more force is left over with it than without"
    if stands_in(c, s, f, before, sizes):
        return "it takes the place of forces that the model explains, and leaves as much over"
    return ""


def borne_out(fits: Sequence[Judged], beside: Beside) -> tuple[list[Judged], list[Tried]]:
    """The fits with enough evidence against which nothing speaks; and what was tried, with what does."""
    good, tried = list[Judged](), list[Tried]()
    for c, s, f in fits:
        told = clear(s, f)
        refused = f.failed or (why_not(c, s, f, beside) if told else "")
        if told and not refused:
            good.append((c, s, f))
        gained = f.gain if np.isfinite(f.gain) else None
        tried.append(Tried(explanation=explained(c, f.result), predicted=s.gain if s else 0.0, fitted=gained, refused=refused))
    return good, tried


def loose(findings: Sequence[Finding], accepted: Sequence[Candidate], bare: Model, model: Model) -> tuple[set[str], float]:
    """Components of couplings found soft or loose, with what these brought, and the nats that an effect there has to bring.

    findings: of what was accepted, in its order. bare: the model as it was declared.
    """
    gains = [finding.gain for finding, c in zip(findings, accepted, strict=True) if c.dear]
    own = bare.components
    there = {name for name, one in model.components.items() if name not in own or type(one) is not type(own[name])}
    return (there, DETAIL * max(gains)) if gains else (set(), 0.0)


def slight(c: Candidate, s: Screened | None, f: Fitted, sizes: Sizes) -> bool:
    """Whether its fit made it so small that its force is less than the floor at every place.

    Play by what its coupling bears differently, k gap/2: less than half of that mends what a mesh of one interval a sample cannot
    follow. Several strengths, and waves, by what the fit made of them; others by what they were at their score: an effect goes with its
    one strength, and a dead zone's with its width. What is late by less than a part of a sampling interval is on time: no clock and no
    simulation is better. A parameter that is wrong by a share that matters is never slight.
    """
    if f.result is None:
        return False
    if "gap" in c.named:
        spot = c.named["gap"].rpartition(".")[0]
        gap, k = (f.result.parameters.get(f"{spot}.{word}") for word in ("gap", "k"))
        known = [size for size in sizes.forces.values() if np.isfinite(size)]
        return gap is not None and k is not None and bool(known) and k.value * gap.value / 2 < FLOOR / 2 * min(known)
    if c.physics in LATE:
        told = ((f.result.parameters.get(path), c.start[path][0]) for path in c.named.values() if path in c.start)
        if any(p is not None and p.value < HARDLY_LATE * interval for p, interval in told):
            return True
    if s is None:
        return False
    if (len(c.strengths) > 1 or (c.quadrature and c.named.keys() & {"period", "order"})) and not (c.signals or c.absorbs or c.ratio):
        return 0.0 < max(sizes.shares(s.look, fitted_strengths(c, f.result)).values(), default=0.0) < FLOOR
    if (alone := _alone(c, s)) is None:
        return False
    path, there = alone
    if amiss(c, [f.result.parameters[path].value - c.neutral(path)]):
        return False
    share = max(sizes.shares(s.look, np.ones(1) if c.all_shape else s.estimate).values(), default=0.0)
    return 0.0 < share * abs(f.result.parameters[path].value - c.neutral(path)) < FLOOR * abs(there)


def _alone(c: Candidate, s: Screened) -> tuple[str, float] | None:
    """The one parameter that a force goes with, and what it was at the score; None where there is no such one."""
    if c.family == "sensor" or c.absorbs or c.quadrature:
        return None
    if c.grows:
        return c.grows[0], float(s.estimate[0])
    if c.signals:
        width = c.named.get("width", "")
        return (width, s.look.shape[width]) if width in s.look.shape else None
    return (c.strengths[0], float(s.estimate[0])) if len(c.strengths) == 1 else None


def refining(c: Candidate, s: Screened | None, f: Fitted, before: Smoothing, sizes: Sizes, found: Screen) -> bool:
    """Whether it takes the place of a simpler law that is at work in the model, and what that cannot do of its force does not matter.

    By its shape at the score.
    """
    at_work = [base.rpartition(".")[2] for base in c.absorbs if base in before.parameters and before.parameters[base].value]
    working = {SIMPLE[word] for word in at_work if word in SIMPLE}
    if not working or c.quadrature or s is None or f.result is None:
        return False
    every = (shapes[0].look for shapes in found.shapes.values())
    simple = [look for look in every if look.candidate.place == c.place and look.candidate.physics in working]
    return bool(simple) and sizes.net(s.look, fitted_strengths(c, f.result), simple) < FLOOR / 2


def creeping(c: Candidate, f: Fitted) -> bool:
    """Whether it is viscous friction steeper than the rounded sign that holds the body: more than the level of that over its width.

    A body that moves so slowly rests; friction of a direction in which it never turns would be found so.
    """
    if c.family != "friction" or f.result is None or f.worth.solution is None:
        return False
    level = strengths_at_rest(f.worth.solution).get(c.place, 0.0)
    width = max(rounded_signs(f.worth.solution).get(c.place, {}).values(), default=np.inf)
    viscous = [path for word, path in c.named.items() if word in VISCOUS and path in f.result.parameters]
    return level > 0 and any(f.result.parameters[path].value * width > level for path in viscous)


def unyielding(c: Candidate, f: Fitted) -> bool:
    """Whether it is friction that the model has, but for a way before it slides that hardly leaves the noise of measured positions.

    A body that sticks is held by stiff asperities better than by a rounded sign, which creeps; that it yields is what samples have to show.
    """
    solution = f.worth.solution
    if c.physics != "presliding_friction" or not c.absorbs or f.result is None or f.problem is None or solution is None:
        return False
    level = max(f.result.value(path) for word, path in c.named.items() if word != "sigma_0")
    way = level / f.result.value(c.named["sigma_0"])
    return 0.0 < way * shown_of_ways(f.problem.posed.dae, c.signals[0].seen, followed_by(solution), solution.parameters) < YIELDS


def one_way(c: Candidate, f: Fitted) -> bool:
    """Whether it is a friction level of either direction, of a body that slides in one of them alone, or nearly so."""
    levels, solution = [path for word, path in c.named.items() if word in ONE_WAY], f.worth.solution
    if not levels or f.problem is None or solution is None:
        return False
    slides = sliding(f.problem.posed, solution, followed_by(solution)).get(f"{levels[0].rpartition('.')[0]}.width")
    return slides is not None and min(slides) < SLIDES * sum(slides)


def trifling(c: Candidate, f: Fitted, accepted: Sequence[Candidate], before: Smoothing, sizes: Sizes) -> bool:
    """Whether it is one more law of a family of which a place has two already, and takes less than the floor from what is left there.

    Real friction follows no formula: a third one mends a little of the first two, and their numbers, which were right, bend for it.
    """
    had = [a for a in accepted if (a.place, a.family) == (c.place, c.family) and not c.replaces(a)]
    if len(had) < 2 or f.result is None:
        return False
    was, now = before.residual_places.get(c.place), f.result.residual_places.get(c.place)
    return was is not None and now is not None and was.rms**2 - now.rms**2 < (FLOOR * sizes.forces.get(c.place, 0.0)) ** 2


def misleading(c: Candidate, f: Fitted, sizes: Sizes) -> bool:
    """Whether it is a fault of a sensor or an input, or a coupling, with which more forces are left over than without it.

    Such a fault leaves the forces as they are: what is one takes forces away that stood for it. A body that a coupling brings is moved by
    what is on both its sides; one that is moved by forces which nobody knows sets everything beyond it free.
    """
    if not (c.family in SIGNALS or c.dear) or f.problem is None or (whole := f.whole) is None:
        return False
    return leaves_more(f.problem, whole, sizes)


def stands_in(c: Candidate, s: Screened | None, f: Fitted, before: Smoothing, sizes: Sizes) -> bool:
    """Whether it is a constant force far larger than all that varies at its place, of which next to nothing was left over there.

    Then a parameter of the model gave way to it: of a body that hovers a constant force can take the thrust's place, and a thrust that
    hardly varies with the speeds of its propellers spares the model the torques that these should bring and do not.
    """
    if c.physics != "constant_force" or c.onset is not None or s is None or f.result is None:
        return False
    left = {name: summary.rms for name, summary in before.residual_places.items()}
    shares = sizes.shares(s.look, fitted_strengths(c, f.result))
    return any(x > LARGE and left.get(place, np.inf) < SEEN * x * sizes.varying[place] for place, x in shares.items())
