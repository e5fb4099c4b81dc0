"""All candidates at once: what each would gain, how likely as much is where nothing is missing, and which cannot be told apart.

A candidate with strengths a at a shape gains  max over allowed a of  -b'a - a'Ga/2  nats. Under the null b ~ N(0, G): how likely as much is
anywhere in the library, at any shape, is drawn (`chance.py`).

That takes what is left over for white. Where it is not, or where the model leaves out something else as well, a score varies more than G
says. With c the effect of a candidate as it is found, r what is left over, and b_k the sum of c (r + c) over the k-th of K equal parts of
the recordings,

    inflation = max(1, sum_k b_k^2 / c'c)

is by how much, and a gain is worth that much less (variance over clusters: H. White, Econometrica 48, 1980; its use for likelihoods that
leave correlation out: R. E. Chandler, S. Bate, Biometrika 94, 2007).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, groupby, product

import numpy as np

from ...workers import in_order
from ..candidates.candidate import Candidate
from .chance import DRAWS, Chance
from .score import Columns, Drawn, Linearised, Scores
from .supermodel import Look
from .windows import best_window

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Index = np.ndarray[tuple[int, ...], np.dtype[np.int64]]

LEFT = 1e-8  # of a strength's squares, once trajectory and parameters are projected out: less is rounding
SURE = 0.05  # chance of as much anywhere in the library if nothing is missing, at most
UNTOLD = 1e-3  # of a strength's square: with that much that nobody tells it has no deviation
BATCH = 128  # columns at a time
SCALES = 1e-4  # of what a parameter does that is no scale of residual forces: less is none
CLOSE = 40  # candidates, best first, whose effects are compared with each other
PLAINLY, PART = 10.0, 0.02  # nats, and share of its gain, by which an effect has to gain more by setting in
HOLD_AT_REST = ("friction", "transmission")  # families of what is seen where a body rests
PARTS = 25  # of the recordings, long enough that what is left over in one tells little of the next


@dataclass(frozen=True, kw_only=True, eq=False)
class Screened:
    """A candidate at its best shape. gain [nats]; estimate, std (n,) of its strengths; freedom: how many of them the recordings tell.

    inflation: of the variance of its score, over that beside white residuals. origin: as the screen has it, of one that was changed since.
    """

    look: Look
    gain: float
    estimate: Array
    std: Array
    freedom: int
    inflation: float = 1.0
    origin: Screened | None = None

    @property
    def worth(self) -> float:
        """Its gain for what it is worth beside residuals that are not white [nats]."""
        return self.gain / self.inflation

    @property
    def shape_gain(self) -> float:
        """What tells one shape from others [nats]: the gain, of what is all shape with a strength of one at the most.

        A delay a fifth as long, and five times as strong, gains as much where it is but noise of the input that it moves. Where parameters
        have made up for a part of it no shape has its whole strength.
        """
        if not self.candidate.all_shape:
            return self.gain
        whole = min(max(float(self.estimate[0]), 0.0), 1.0)
        return whole * (float(self.estimate[0]) - whole / 2) / float(self.std[0]) ** 2

    @property
    def candidate(self) -> Candidate:
        """What was looked at."""
        return self.look.candidate


Scored = tuple[Screened, Array, int]  # what the best of so many looks would gain by every draw, (draws,)


@dataclass(frozen=True, kw_only=True)
class Screen:
    """Best first, each candidate once.

    chance: of gains. G: information of the first ones, with their columns. shapes: id of a candidate -> it at all that were looked at, but
    for what sets in.
    """

    found: tuple[Screened, ...]
    chance: Chance
    G: Array
    plain: Array
    columns: tuple[tuple[int, ...], ...]
    shapes: Mapping[int, Sequence[Screened]] = field(default_factory=dict)

    @property
    def beside_white(self) -> Screen:
        """The same with no inflation: of fits that are held against a force which takes all that is left over."""
        return replace(self, found=tuple(replace(s, inflation=1.0) for s in self.found))

    def alike(self, a: Screened, b: Screened) -> float:
        """How well an effect of one can always stand for an effect of the other: cosine of the largest principal angle between them."""
        order = {id(s): k for k, s in enumerate(self.found[: len(self.columns)])}
        a, b = a.origin or a, b.origin or b
        if a.freedom != b.freedom or id(a) not in order or id(b) not in order:
            return 0.0
        at = [list(self.columns[order[id(s)]]) for s in (a, b)]
        roots = [inverse_root(self.G[np.ix_(k, k)], self.plain[k]) for k in at]
        cross = roots[0].T @ self.G[np.ix_(*at)] @ roots[1]
        return float(np.linalg.svd(cross, compute_uv=False).min()) if cross.size else 0.0


def screen(
    base: Linearised, looks: Sequence[Look], late: Iterable[Look] = (), *, seed: int = 0, draws: int = DRAWS, threads: int = 1
) -> Screen:
    """Scores of all looks, but of parameters that only scale what is left over. late: of what sets in; seed, draws: of chances."""
    best, freedoms = dict[tuple[int, int], Screened](), Counter[int]()
    shapes, most = dict[int, list[Screened]](), np.zeros(draws)
    for scored in in_order(_scored(base, chain(told(base, looks), late), seed, draws), threads):
        for found, gained, count in scored:
            look = found.look
            if look.whole is None:
                shapes.setdefault(id(look.candidate), []).append(found)
            if not found.freedom:
                continue
            most = np.maximum(most, gained)
            freedoms[found.freedom] += count
            key = (1 + (look.candidate.until is not None), id(look.whole)) if look.whole else (0, id(look.candidate))
            if key not in best or found.shape_gain > best[key].shape_gain:
                best[key] = found
    ordered = tuple(sorted(_inflated(base, _set_in(best), threads), key=lambda s: (-_adjusted(s), s.candidate.rank)))
    close, first, columns = ordered[:CLOSE], 0, list[tuple[int, ...]]()
    for s in close:
        columns.append(tuple(range(first, first + len(s.look.columns))))
        first += len(s.look.columns)
    joint = (
        base.scores(Columns.joined([s.look.columns for s in close]))
        if close
        else Scores(b=np.empty(0), G=np.empty((0, 0)), plain=np.empty(0))
    )
    chance = Chance(looks=freedoms, most=most)
    return Screen(found=ordered, chance=chance, G=joint.G, plain=joint.plain, columns=tuple(columns), shapes=shapes)


def identifiable(base: Linearised, looks: Sequence[Look]) -> list[Look]:
    """The looks of which something is told once all that is free is projected out."""
    found = list[Look]()
    for batch, at_rest in _batches(looks):
        there, joined = seen(base, Columns.joined([look.columns for look in batch]), at_rest)
        scores, first = there.scores(joined), 0
        for look in batch:
            k = np.arange(first, first := first + len(look.columns))
            if inverse_root(scores.G[np.ix_(k, k)], scores.plain[k]).shape[1]:
                found.append(look)
    return found


def _scored(base: Linearised, looks: Iterable[Look], seed: int, draws: int) -> Iterator[Callable[[], list[Scored]]]:
    """Calls that give some looks with their scores."""
    drawn = dict[int, Drawn]()
    for batch, at_rest in _batches(looks):
        there, joined = seen(base, Columns.joined([look.columns for look in batch]), at_rest)
        if id(there) not in drawn:
            drawn[id(there)] = there.drawn(seed, draws)
        yield partial(_batch, batch, there, joined, drawn[id(there)])


def _batch(batch: Sequence[Look], there: Linearised, joined: Columns, drawn: Drawn) -> list[Scored]:
    scores, b, first, out = there.scores(joined), drawn.b(joined), 0, list[Scored]()

    def taken(at: Index) -> Scores:
        return Scores(b=scores.b[at], G=scores.G[np.ix_(at, at)], plain=scores.plain[at])

    for _, group in groupby(batch, key=_of_one):
        looks, begun = list(group), first
        for look in looks:
            at = np.arange(first, first := first + len(look.columns))
            one = taken(at)
            root = inverse_root(one.G, one.plain)
            out.append((_judged(look, one, root), _gained(look, replace(one, b=b[at]), root)[0], 1))
        if (
            first - begun == len(looks) > 1
            and (window := best_window(looks, taken(at := np.arange(begun, first)), b[at], LEFT)) is not None
        ):
            one = window.scores
            out.append((_judged(window.look, one, inverse_root(one.G, one.plain)), window.gained, window.count))
    return out


def _of_one(look: Look) -> tuple[bool, int]:
    """What looks at one effect that sets in have in common."""
    return look.whole is not None, id(look.whole or look)


def told(base: Linearised, looks: Sequence[Look]) -> list[Look]:
    """The looks without those at parameters that do nothing but scale residual forces, when all others make up for them.

    The mass of a body of which only the acceleration is read is one: with half of it, and half of all forces, every row is as before but
    those of the residual forces, which are halved. That gains whatever these cost, and tells nothing.
    """
    given = [look for look in looks if look.candidate.family == "parameter"]
    if not given:
        return list(looks)
    pairs = zip(given, only_scale(base, [look.columns for look in given], base.residual_forces), strict=True)
    scaling = {id(look) for look, scales in pairs if scales}
    return [look for look in looks if id(look) not in scaling]


def only_scale(base: Linearised, given: Sequence[Columns], forces: Columns) -> list[bool]:
    """Which of these do nothing but scale residual forces, with columns `forces`, when all that is free makes up for them."""
    if not given or not len(forces):
        return [False] * len(given)
    scores, first, found = base.scores(Columns.joined([*given, forces])), 0, list[bool]()
    last = np.arange(sum(len(columns) for columns in given), len(scores.b))
    root = inverse_root(scores.G[np.ix_(last, last)], scores.plain[last])
    for columns in given:
        at = np.arange(first, first + len(columns))
        first += len(at)
        whole, common = np.trace(scores.G[np.ix_(at, at)]), np.sum((scores.G[np.ix_(at, last)] @ root) ** 2)
        found.append(bool(common > (1.0 - SCALES) * whole))
    return found


def _set_in(best: Mapping[tuple[int, int], Screened]) -> list[Screened]:
    """The best looks without those at what sets in that gain hardly more than if it acts all along, or does not end."""
    whole, found = {of: s.gain for (late, of), s in best.items() if late == 0}, list[Screened]()
    for (late, of), s in best.items():
        least = whole.get(id(s.look.whole.candidate), 0.0) if s.look.whole else 0.0
        onward, ends = (best[there, of].gain if (there, of) in best else 0.0 for there in (1, 2))
        if late == 0 or (plainly(s.gain, max(least, onward)) if late == 2 else plainly(s.gain, least) and not plainly(ends, onward)):
            found.append(s)
    return found


def plainly(late: float, whole: float) -> bool:
    """Whether an effect gains so much more by setting in that it does not act all along."""
    return late - whole > max(PLAINLY, PART * whole)


def _inflated(base: Linearised, found: list[Screened], threads: int) -> list[Screened]:
    """With the inflation of their scores."""
    of = {id(s.look): s for s in found}

    def inflated(batch: Sequence[Look], there: Linearised, joined: Columns) -> list[Screened]:
        effects, first, out = there.effects(joined), 0, list[Screened]()
        for look in batch:
            s, last = of[id(look)], first + len(look.columns)
            out.append(replace(s, inflation=inflation(effects[:, first:last] @ s.estimate, there.left, there.intervals)))
            first = last
        return out

    batches = _batches([s.look for s in found])
    calls = (partial(inflated, batch, *seen(base, Columns.joined([o.columns for o in batch]), at_rest)) for batch, at_rest in batches)
    return list(chain.from_iterable(in_order(calls, threads)))


def inflation(effect: Array, left: Array, intervals: Index) -> float:
    """Of the variance of a score, over that beside white residuals. effect, left, intervals (R,): of every row."""
    size = float(effect @ effect)
    if not size > 0:
        return 1.0
    last = int(intervals.max()) + 1
    sums = np.bincount(intervals * min(PARTS, last) // last, weights=effect * (left + effect))
    return max(1.0, float(sums @ sums) / size)


def seen(base: Linearised, columns: Columns, at_rest: bool) -> tuple[Linearised, Columns]:
    """Where columns are scored, and what they are there. at_rest: whether one acts on bodies at rest, too."""
    return (base, columns) if at_rest or not base.rests else (base.moving, base.while_moving(columns))


def _batches(looks: Iterable[Look]) -> Iterator[tuple[list[Look], bool]]:
    """Some at a time, those at one effect that sets in together, and whether what they look at acts on bodies at rest, too."""
    open_ones = {True: list[Look](), False: list[Look]()}
    for group in (list(group) for _, group in groupby(looks, key=_of_one)):
        at_rest = group[0].candidate.family in HOLD_AT_REST
        batch = open_ones[at_rest]
        if batch and sum(len(one.columns) for one in (*batch, *group)) > BATCH:
            yield batch, at_rest
            batch = open_ones[at_rest] = []
        batch.extend(group)
    yield from ((batch, at_rest) for at_rest, batch in open_ones.items() if batch)


def _adjusted(s: Screened) -> float:
    return s.gain - 0.5 * (s.freedom - 1) * float(np.log(max(2.0 * s.gain, 1.0)))


def _judged(look: Look, scores: Scores, root: Array) -> Screened:
    gains, a = _gained(look, replace(scores, b=scores.b[:, None]), root)
    # a strength of which a part is not told may be any, but beside a parameter that it takes the place of it is measured from that
    of_one = root * np.sqrt(scores.plain)[:, None]
    whole = np.diag(of_one @ np.linalg.pinv(of_one)) > 1.0 - UNTOLD
    std = np.where(whole | bool(root.size and look.candidate.absorbs), np.sqrt(np.sum(root**2, axis=1)), np.inf)
    return Screened(look=look, gain=float(gains[0]), estimate=a[:, 0], std=std, freedom=root.shape[1])


def _gained(look: Look, scores: Scores, root: Array) -> tuple[Array, Array]:
    """Gains (draws,) and strengths (n, draws) of scores b (n, draws)."""
    if (look.candidate.one_sided and not look.candidate.absorbs) or look.candidate.signals:
        return _one_sided(scores)
    along = root.T @ scores.b
    return 0.5 * np.sum(along**2, axis=0), -root @ along


def gain(scores: Scores, columns: Sequence[int]) -> float:
    """What some strengths would gain together [nats]."""
    at = list(columns)
    root = inverse_root(scores.G[np.ix_(at, at)], scores.plain[at])
    return float(0.5 * np.sum((root.T @ scores.b[at]) ** 2))


def _one_sided(scores: Scores) -> tuple[Array, Array]:
    """The largest gain with no strength negative, by trying which of them are nothing."""
    best, found = np.zeros(scores.b.shape[1]), np.zeros(scores.b.shape)
    for chosen in product((False, True), repeat=len(scores.b)):
        at = np.flatnonzero(chosen)
        if not len(at):
            continue
        root = inverse_root(scores.G[np.ix_(at, at)], scores.plain[at])
        along = root.T @ scores.b[at]
        a, gains = -root @ along, 0.5 * np.sum(along**2, axis=0)
        better = np.all(a >= 0, axis=0) & (gains > best)
        best[better], found[:, better] = gains[better], 0.0
        found[np.ix_(at, better)] = a[:, better]
    return best, found


def inverse_root(G: Array, plain: Array) -> Array:
    """R (n, rank) with R R' = G^-1 over what is told of the strengths."""
    size = np.sqrt(np.where(plain > 0, plain, 1.0))
    e, Q = np.linalg.eigh(G / np.outer(size, size))
    told = e > LEFT
    return np.asarray(Q[:, told] / np.sqrt(e[told]) / size[:, None])
