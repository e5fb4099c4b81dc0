"""Which candidates are worth a fit, and which fits bear their candidate out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace
from math import inf
from typing import TypeVar

import numpy as np

from ...results import Smoothing
from ..answer.verdict import Explanation, Strength
from ..candidates.candidate import Candidate
from ..candidates.edits import Change
from ..candidates.laws import FASTEST, SLOWEST
from ..evidence.density_ratio import more_probable_alike, more_probable_at
from ..evidence.offsets import PREFIX, counted_out
from ..scores.screen import SURE, Screen, Screened
from ..scores.shares import FLOOR, Sizes
from .refit import Fitted, holds

T = TypeVar("T")
Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

CLEAR = 6.0  # nats of evidence that an effect has to bring
DOUBTS = 2.0  # deviations of that evidence that it has to be, where no score tells what it is worth
RIVAL = 3.0  # nats within which two explanations cannot be told apart
FITTED, EACH, MOST = 4, 1, 6  # candidates that are fitted in a round: the best, of every other place, in all
SURELY = 2  # and the best of them for what their gains are worth
WORTH, WORTH_ELSEWHERE = 0.5, 0.2  # of the best one's gain, at least
SHORT = 0.5  # of the gain by the score: a fit that brings less has not borne it out
MUCH_LESS = 1.5  # times the worth of a fit: another one that is worth as much is better than just as good
SPREAD, SPREAD_OF_COUPLINGS = 0.3, 0.5  # standard deviation of a strength over the largest one; of a coupling its evidence tells more
COLOURED = 1e-9  # chance of the prediction errors' autocorrelation if they are white
COUPLED = ("gap", "k")  # what tells a coupling, the first that it has
NOTHING = 1e-6  # of a strength on its bound, in SI: solvers stop beside it
AT_NOTHING = {"width": 1, "tau": 1, "delay": 1, "limit": 2}  # of (guess, least, largest): where such a fault does next to nothing
NEARLY = 0.01  # of that value
HARDLY = 2.0  # times too large or too small: hardly anybody is so far off with a number of a model
WRONG = 0.03  # of a parameter of the machine: one so far off is wrong, however little of the forces that is
IMPOSSIBLE = 3.0  # deviations beyond what a parameter may be
LATE = ("sensor_delay", "sensor_lag", "input_delay", "input_lag")
SIGNALS = ("sensor", "actuator")  # families whose effects are no forces
SAME = 0.99999  # correlation of two effects of which one fit stands for both
AS_WELL = 2  # of those that a fit stood for which fell short


def chosen(found: Screen, sizes: Sizes, but: Sequence[Screened] = ()) -> list[Screened]:
    """The candidates worth a fit: unlikely by chance, large enough to matter, and not one that a better one stands for.

    The best of all, and the best of every balance: what no output shows at once is scored less well than it fits, and far from the truth a
    gain says little of what an effect is worth. Beside a law of several strengths the simplest of its family is fitted too: scores go by
    straight lines, and the richer one may end in a worse valley. but: of those that were fitted, and of what does the same.
    """
    open_ones = [s for s in found.found if s not in but and all(found.alike(o, s) <= SAME for o in but)]
    worth, likely = list[Screened](), [s for s in open_ones if _likely(s, found, sizes)]
    for s in likely:
        same = next((k for k, o in enumerate(worth) if found.alike(o, s) > SAME), None)
        if same is not None:
            if plainness(s.candidate, s.estimate) < plainness(worth[same].candidate, worth[same].estimate):
                worth[same] = s
        elif not simpler_there(s, open_ones, sizes):
            worth.append(s)
    most = max((s.gain for s in worth), default=0.0)
    best = [s for s in worth if s.gain >= WORTH * most][:FITTED]
    places = Counter(_balance(s, sizes) for s in best)
    for s in worth:
        if s not in best and s.gain >= WORTH_ELSEWHERE * most and places[there := _balance(s, sizes)] < EACH and len(best) < MOST:
            best.append(s)
            places[there] += 1
    lasting = [s for s in worth if s.candidate.until is None]  # of what ends too few parts tell how much its score varies
    best += [s for s in sorted(lasting, key=lambda s: -s.worth)[:SURELY] if s not in best]
    best += _late_elsewhere(best, open_ones, most)
    for s in tuple(best):
        simple = simplest_beside(s, likely)
        if simple is not None and simple not in best:
            best.append(simple)
    return best


def _late_elsewhere(best: Sequence[Screened], found: Sequence[Screened], most: float) -> list[Screened]:
    """Where what is late gains most, the best of what may be late instead on the other side of the machine, an input or a sensor.

    Whatever else gains as much: of what is late by a good part of the motion a straight line says next to nothing.
    """
    late, least = [s for s in found if s.candidate.physics in LATE], WORTH_ELSEWHERE * most
    sides = {s.candidate.family for s in best if s in late and s.gain >= WORTH * most}
    others = (s for s in late if s not in best and s.candidate.family not in sides and s.gain >= least)
    return [s] if sides and (s := next(others, None)) is not None else []


def _balance(s: Screened, sizes: Sizes) -> str:
    """Its place; of one with several balances, such as a body in space, with that where its force is the largest share.

    What comes late is a balance of its own: a score, which goes by a straight line, says little of it beside a gain.
    """
    place = s.candidate.place
    if s.candidate.physics in LATE:
        return f"{place} in time"
    shares = {} if place in sizes.names or s.candidate.signals else sizes.shares(s.look, s.estimate)
    return f"{place} {max(shares, key=lambda name: shares[name])}" if any(shares.values()) else place


def _likely(s: Screened, found: Screen, sizes: Sizes) -> bool:
    """Whether its gain is unlikely by chance, its strength possible, and its effect large enough to matter.

    A parameter that is wrong matters however little of the forces that is; beside noise of that size its gain is what that leaves of it.
    """
    gain = s.gain if matters(s, sizes) else s.worth if amiss(s.candidate, s.estimate) else 0.0
    return found.chance.of(gain) <= SURE and not beyond(s)


def stood_for(found: Screen, sizes: Sizes, fits: Sequence[tuple[Candidate, Screened | None, Fitted]]) -> list[Screened]:
    """What others stood for whose fits fell short of their scores: all that do the same, and the best richer one at their place.

    Scores go by straight lines: laws that are alike along a trajectory astray are not where it comes to rest.
    """
    out, fitted = list[Screened](), {c.key for c, _, _ in fits}
    for c, s, f in fits:
        if s is None or f.late or f.gain > SHORT * s.gain:
            continue
        same = [o for o in found.found if o.candidate.key not in fitted and found.alike(s, o) > SAME and _likely(o, found, sizes)]
        out += same[:AS_WELL]
        fitted |= {o.candidate.key for o in same[:AS_WELL]}
        there = [o for o in found.found if o.candidate.place == c.place and o.candidate.size > c.size and o.candidate.key not in fitted]
        good = (o for o in there if o.gain >= WORTH * s.gain and _likely(o, found, sizes))
        if (best := next(good, None)) is not None:
            out.append(best)
            fitted.add(best.candidate.key)
    return out


def simplest_beside(s: Screened, others: Sequence[Screened]) -> Screened | None:
    """The best candidate of the same family and place with fewer strengths, if it gains a good part of as much.

    Asperities as stiff as can be are Coulomb friction: beside some with which a body yields far, that may be what they come to.
    """
    c = s.candidate
    there = [o for o in others if (o.candidate.place, o.candidate.family) == (c.place, c.family) and o.candidate.size < c.size]
    if c.physics == "presliding_friction" and not c.absorbs:
        return next((o for o in there if o.candidate.physics == "coulomb_friction"), None)
    return max((o for o in there if o.gain >= WORTH * s.gain), key=lambda o: o.gain, default=None)


def held_unseen(found: Screen, worth: Sequence[Screened], unseen: Collection[str]) -> list[Screened]:
    """Friction that may hold a body of which no output tells: a model without it has no such phases, and so no score of them."""
    there = [s for s in found.found if holds(s.candidate, unseen)]
    return [s for s in there if s.candidate.key not in {o.candidate.key for o in worth}]


def plainest_first(worth: Sequence[Screened], unheld: Collection[str]) -> tuple[list[Screened], list[Screened]]:
    """What is fitted first, and what only at bodies for which no fit of the first came to rest.

    Where friction may hold a body that no output shows, its plainest law is the first: from where that one came to rest a further round
    tells what a richer one, or one that sets in, would have more.
    """
    rich = {id(s) for s in worth if holds(s.candidate, unheld) and (s.candidate.larger is not None or s.candidate.onset is not None)}
    return [s for s in worth if id(s) not in rich], [s for s in worth if id(s) in rich]


def inside_unseen(found: Screen, inside: Collection[str]) -> list[Screened]:
    """What may be wrong of components that no output shows: the best damping, and parameters. Far from the truth no score tells of it."""
    there = [s for s in found.found if s.candidate.place in inside]
    damping = [s for s in there if s.candidate.physics == "damping"][:1]
    return [*damping, *(s for s in there if s.candidate.family == "parameter" and not s.candidate.changes)]


def steady(result: Smoothing, candidates: Sequence[Candidate], sizes: Sizes) -> list[Candidate]:
    """Components that stand for the offsets which stay (`offsets.py`), where one of these is as large as matters."""
    _, stay = counted_out(result)
    large = {n for n in stay if abs(result.parameters[n].value) > FLOOR * sizes.varying.get(n.removeprefix(PREFIX), inf)}
    return [c for c in candidates if large & set(c.absorbs)]


def coloured(result: Smoothing) -> bool:
    """Whether prediction errors tell, beyond all doubt, that something is left out, however small the forces that stand for it."""
    found = (fit.whiteness_p for fits in result.fit.values() for fit in fits.values())
    return any(p is not None and p < COLOURED for p in found)


def simpler_there(s: Screened, others: Sequence[Screened], sizes: Sizes) -> bool:
    """Whether a candidate at the same balance gains as much with fewer parameters. What is beyond it, a later round will tell."""
    c = s.candidate
    there = (o for o in others if o.candidate.place == c.place and o.candidate.size < c.size)
    as_good = [o for o in there if s.gain - o.gain < RIVAL * (c.size - o.candidate.size)]
    return bool(as_good) and _balance(s, sizes) in (_balance(o, sizes) for o in as_good)


def beyond(s: Screened) -> bool:
    """Whether a strength would have to be where it cannot be: a sensor that reads six times what there is."""
    c = s.candidate
    if c.signals:
        return False
    if c.quadrature:
        return float(np.hypot(*np.split(s.estimate, 2))[0]) > c.start.get(c.strengths[0], (0.0, -inf, inf))[2]
    for name, a in zip(c.strengths, s.estimate.tolist(), strict=True):
        low, high = c.bounds(name)
        if not low <= c.neutral(name) + a <= high:
            return True
    return False


def matters(s: Screened, sizes: Sizes) -> bool:
    """Whether its force is half of the floor at least, by the score; of a sensor, what share of a reading is wrong, the whole floor."""
    if s.candidate.family == "sensor":
        return not s.candidate.of_reading or float(np.abs(s.estimate).max()) > FLOOR
    return max(sizes.shares(s.look, s.estimate).values(), default=0.0) > FLOOR / 2


def amiss(c: Candidate, change: Sequence[float] | Array) -> bool:
    """Whether it is a parameter of the machine that is wrong by a share of what it was taken for. change (n,): of its strengths."""
    if c.family != "parameter" or c.changes:
        return False
    return any(abs(a) > WRONG * abs(c.neutral(name)) for name, a in zip(c.strengths, change, strict=True))


def plainness(c: Candidate, change: Sequence[float] | Array) -> tuple[int, ...]:
    """What is named first of those that no recording can tell apart: a number of the model that is off by a factor of two comes last.

    change (n,): of its strengths.
    """
    by = [(c.neutral(name), a) for name, a in zip(c.strengths, change, strict=True)] if c.family == "parameter" else []
    far = any(was != 0.0 and not 1.0 / HARDLY <= (was + a) / was <= HARDLY for was, a in by)
    return int(far), c.rank, c.size, int(not c.stated)


def sound(c: Candidate, f: Fitted) -> bool:
    """Whether its strengths are told, to less than SPREAD of the largest of their unit, and are such as it has.

    Of a coupling that is its play or its stiffness, of a level that waves by how much it does.
    """
    if f.result is None:
        return False
    if not all(_possible(change, f.result) for change in c.changes):
        return False
    if c.larger is not None and not f.result.parameters[c.larger[0]].value > f.result.parameters[c.larger[1]].value:
        return False
    coupled = [c.named[word] for word in COUPLED if word in c.named] if c.dear else []
    means = coupled[:1] or ([c.ratio] if c.ratio else list(c.strengths or c.start))
    told = [p for n in means if (p := f.result.parameters.get(n)) is not None and p.std is not None]
    if not told:
        return False
    nothing, spread = without_effect(c), SPREAD_OF_COUPLINGS if c.dear else SPREAD
    alike = dict[str, list[tuple[float, float]]]()
    for p in told:
        alike.setdefault(p.unit, []).append((p.std or 0.0, abs(p.value - nothing.get(p.name, c.neutral(p.name)))))
    return all(max(std for std, _ in one) < spread * max(size for _, size in one) for one in alike.values())


def _possible(change: Change, result: Smoothing) -> bool:
    """Whether a parameter may be what it is after its change, as far as its deviation tells."""
    by = result.parameters[change.name]
    later, doubt = result.parameters[change.path].value + by.value, IMPOSSIBLE * (by.std or 0.0)
    return change.least - doubt <= later <= change.most + doubt


def clear(s: Screened | None, f: Fitted) -> bool:
    """Whether a fit brought as much evidence as an effect has to, for what that is worth beside residuals that are not white."""
    return f.gain > (max(CLEAR, DOUBTS * f.doubt) if s is None else CLEAR * s.inflation)


def explaining(c: Candidate, s: Screened | None, f: Fitted) -> bool:
    """Whether a fit explains something. A sensor or an input that stands for what is left of a motion leaves some of that in the errors."""
    return clear(s, f) and sound(c, f) and not (c.family in SIGNALS and f.result is not None and coloured(f.result))


def as_good(good: Sequence[tuple[T, Screened | None, float, tuple[int, ...]]]) -> list[T]:
    """Of fits (what it is, its score, nats gained, how plain), best first: those that cannot be told from the best, the plainest first.

    What the best one leaves over tells how far: where that is not white, nats are worth less, and those are out of it that are worth much
    less than another one.
    """
    (_, top, most, _) = good[0]
    usual = 1.0 if top is None else top.inflation
    near = [(one, gained / (usual if s is None else s.inflation), plain, gained) for one, s, gained, plain in good]
    near = [n for n in near if most - n[3] < RIVAL * usual]
    worth = max(n[1] for n in near)
    return [n[0] for n in sorted((n for n in near if n[1] * MUCH_LESS >= worth), key=lambda n: (*n[2], -n[3]))]


def idle(c: Candidate, result: Smoothing) -> bool:
    """Whether a model that has a candidate would be as good without it, or has it at nothing, on its bound."""
    return spare(c, result) > -CLEAR


def spared(candidates: Sequence[Candidate], result: Smoothing) -> tuple[int, float]:
    """How many of these a model that has them would be as good without, all at once, and by how many nats it is more probable then."""
    gone, nats, at = 0, 0.0, dict[str, float]()
    told = {n for n, p in result.parameters.items() if p.std is not None}
    for own, c in sorted(((spare(c, result), c) for c in candidates), key=lambda one: -one[0]):
        if not own > -CLEAR:
            break
        both = at | {n: end for n, end in without_effect(c).items() if n in told}
        more = nats + own if not at else more_probable_at(result, both)
        if more - nats > -CLEAR:
            gone, nats, at = gone + 1, more, both
    return gone, nats


def spare(c: Candidate, result: Smoothing) -> float:
    """By how many nats a model that has a candidate would be more probable without it, by its own fit; -inf where nobody can say.

    At nothing, on its bound, it is as good without. So it is without one whose two strengths are one, where the model had that. Of
    couplings, which have no strength, nobody can say.
    """
    nothing = without_effect(c)
    if c.all_shape:
        ends = shapes_without_effect(c)
        near = {path: NEARLY * abs(end) for path, end in ends.items()}
    else:
        ends = nothing
        near = dict.fromkeys(ends, NOTHING)
    there = {n: p for n in ends if (p := result.parameters.get(n)) is not None}
    if there and all(p.on_bound and abs(p.value - ends[n]) <= near[n] for n, p in there.items()):
        return 0.0
    told = {n for n, p in result.parameters.items() if p.std is not None}
    pairs = (names.split() for names in c.absorbs.values())
    more = [more_probable_alike(result, *both) for both in pairs if len(both) == 2 and told.issuperset(both)]
    at = {n: end for n, end in nothing.items() if n in told}
    return max([*more, *([more_probable_at(result, at)] if at else [])], default=-inf)


def shapes_without_effect(c: Candidate) -> dict[str, float]:
    """The same of what has but shapes: width of a dead zone, time of a lag."""
    return {path: c.start[path][AT_NOTHING[word]] for word, path in c.named.items() if word in AT_NOTHING and path in c.start}


def without_effect(c: Candidate) -> dict[str, float]:
    """Parameter -> its value where there is no effect: a level that waves is there without it, and has no waves then."""
    return {c.ratio: 0.0} if c.ratio else {n: c.neutral(n) for n in c.strengths or c.grows[:1]}


def evened(e: Explanation, c: Candidate, result: Smoothing, force: float) -> Explanation:
    """Coulomb friction where a richer law has come to be that.

    Of the mean level, where it is not sure that this hangs on the direction by as much as matters beside the forces there; of the level c,
    where it is sure that its growth from the slowest to the fastest velocities does not matter.
    """
    growth, level = (e.parameters.get(word) for word in ("b", "c"))
    if e.physics == "logarithmic_friction" and level is not None and growth is not None:
        none = growth.std is None and growth.value <= NOTHING
        most = growth.value + DOUBTS * growth.std if growth.std is not None else inf
        if none or most * np.log(FASTEST / SLOWEST) < FLOOR * force:
            return replace(e, physics="coulomb_friction", parameters={"f_c" if level.unit == "N" else "tau_c": level})
    for word, plus, minus in (("f_c", "f_plus", "f_minus"), ("tau_c", "tau_plus", "tau_minus")):
        both = [e.parameters[n] for n in (plus, minus) if n in e.parameters]
        if len(both) < 2:
            continue
        apart, std = abs(both[0].value - both[1].value) / 2, None
        if both[0].std is not None and both[1].std is not None:
            C = result.covariance([c.named[plus], c.named[minus]])
            std = float(np.sqrt(C.sum())) / 2
            apart -= DOUBTS * float(np.sqrt(max(C[0, 0] + C[1, 1] - 2 * C[0, 1], 0.0))) / 2
        if apart >= FLOOR * force:
            continue
        level = Strength(value=(both[0].value + both[1].value) / 2, std=std, unit=both[0].unit)
        return replace(e, physics="coulomb_friction", parameters={word: level})
    return e
