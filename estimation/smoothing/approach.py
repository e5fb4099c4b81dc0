"""From trajectories that follow the samples to ones that the model explains, with its parameters: balances weighed ever more tightly.

A balance that may be off by as much as its own largest force binds nothing, one that may not be off at all binds guesses that are wrong.
So the residual forces get room for a share of the forces at their place, white from interval to interval,

    std_k = share * rms(largest term of balance k) * sqrt(h),         share = 1, 0.32, 0.1, 0.03, 0.01

and from share to share a few Gauss-Newton steps bring trajectories and parameters along, friction laws rounded to the same share of their
velocity. Where lags brought parameters along (`driven_fit.py`) the way begins at the share that these leave over. Only a balance that tells
what no output shows, whatever the guesses are (`telling.py`), is as tight as it will be from the beginning: then the others are fitted to
forces and motions that are nearly known, and not to those of a wrong guess. A parameter is held near its first guess by a prior twice as
wide as that, so that none runs away while little is known.
The way is that of graduated non-convexity (Blake & Zisserman, Visual Reconstruction, 1987): the landscape is smooth at first and
becomes the problem's own. The first step holds the parameters: trajectories bend to where they fit the model before both are free. Where
a step strains, samples and balances costing far more than while there was room, it is taken back and a smaller one tried: a friction law
three times as sharp has other valleys, and with much room rotors of no thrust turn a body of no inertia. Where no output shows an attitude
and a few places strain, these keep room for as much as they are off, and the others go on to be tight: a drag that the model lacks leaves
the inertias to the balances of the torques.

A part that sticks and slips where no output shows it goes another way for every parameter: it is searched for first (`driven_search.py`),
and the way begins tight, or its phases would be lost again in all that room. It can still end in the wrong valley where no output shows a
state. There a descent that strains however small its steps is tried again from other parameters, and the most probable one
counts:  least  cost + sum over intervals and places of log std_k.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from backsight.ocp import Options, Solution
from backsight.ocp.follow import Followed
from backsight.ocp.polynomials import Array

from ..problem import Problem
from .along import forces
from .driven_fit import elsewhere, supposed_near
from .program import Settings, make_program, renewed
from .rest import FrictionLaw, left_alone, rounded
from .softened import softened
from .telling import telling_places
from .unseen import complete, of_the_right_size, sought, unseen_states

TIGHTEST = 0.01  # share at which the way ends
FACTOR, LEAST_FACTOR = 10.0**0.5, 10.0**0.1  # from share to share; of the smallest steps
STRAINED = 2.0  # squares per sample, more than at best, at which tighter balances only bend the rest
BENT = 0.5  # the same where no output shows an attitude: there balances that strain turn what nothing else holds
FEW = 0.5  # of the places, that may stay loose where they strain while the others go on
TIGHT = 0.1  # share from which on a descent waits for convergence
BATCHES = 4  # of Gauss-Newton steps at such a share, at most, and
PAID = 0.01  # the share of the cost that one must save for another one to be worth its while
STARTS = 3  # descents, at most, until one is as tight as
NEAR = 0.05  # which a model may strain that leaves something out, wherever it starts
SAME = 1e-2  # relative difference of the costs of two ends that are one
DRIVEN = (0.01, 0.1**1.5, 0.1)  # shares at which descents begin where the unseen was driven, and
CLEAN = 1.2  # squares per sample at which none of them needs another one
OPTIONS = Options(tolerance=1e-4, gauss_newton_iterations=20, max_passes=1)


@dataclass(frozen=True, kw_only=True)
class Approach:
    """Where the balances' own solve starts: trajectories, parameters (np_all,), and place -> the last std of its residual force.

    share: of the forces, that this std is but at places that strain. whole: the std that all of the forces there would be.
    cost: of samples and balances. unlikely: minus the log of the probability, but for a constant.
    """

    followed: Followed
    parameters: Array
    force_std: dict[int, float]
    whole: dict[int, float]
    share: float
    cost: float
    unlikely: float


def approach(
    problem: Problem,
    followed: Followed,
    laws: tuple[FrictionLaw, ...],
    parameters: Array,
    least: Mapping[int, float],
    say: Callable[[str], None],
) -> Approach:
    """Trajectories on the meshes of the followed ones and parameters, starting from those and from parameters (np_all,).

    Widths of the laws that the user gave stay; those of the others end as they stand in `parameters`. least: place -> standard deviation
    that its residual force is given; it gets no less.
    """
    telling, own, hidden = telling_places(problem), len(problem.dae.places), bool(unseen_states(problem))
    if hidden and not telling:
        problem, parameters = of_the_right_size(problem, followed, laws, parameters)
    near = supposed_near(problem)
    rng, found = np.random.default_rng(0), list[Approach]()
    if hidden and (way := _from_search(near, followed, laws, parameters, least, say)):
        return _ended(way, laws, parameters, own)
    soft = softened(near) if hidden else near
    strain, opens = (STRAINED, False) if soft is near else (BENT, True)
    for number in range(STARTS if hidden and problem.free else 1):
        start = parameters.copy()
        if number:
            say(f"another start, {number + 1} of {STARTS} at most")
            start = elsewhere(problem, parameters, rng)
        begun, start, share = complete(near, followed, laws, start) if hidden and not telling else (followed, start, 1.0)
        found.append(_descent(soft, begun, laws, start, share, least, telling, say, strain, opens, hidden=hidden))
        if found[-1].share <= NEAR or any(_the_same(found[-1], other) for other in found[:-1]):
            break
    return _ended(min(found, key=lambda way: (way.share, way.unlikely)), laws, parameters, own)


def _the_same(one: Approach, other: Approach) -> bool:
    """Whether two starts came to one end: then the model strains, and a third start would end there too."""
    return one.share == other.share and abs(one.cost - other.cost) <= SAME * other.cost


def _from_search(
    near: Problem,
    followed: Followed,
    laws: tuple[FrictionLaw, ...],
    parameters: Array,
    least: Mapping[int, float],
    say: Callable[[str], None],
) -> Approach | None:
    """The best way from where the unseen is driven by what is seen; None where it cannot be, or where every such way strains.

    Descents begin tight: in much room the instants at which a body sticks and breaks away would be lost again.
    """
    begun = sought(near, followed, laws, parameters, say)
    if begun is None:
        return None
    found, count, soft = list[Approach](), _count(followed), softened(near)
    for share in DRIVEN:
        way = _descent(soft, begun[0], laws, begun[1], share, least, (), say, hidden=True)
        if way.share <= TIGHTEST and 2 * way.cost <= (1.0 + STRAINED) * count:
            found.append(way)
        if found and 2 * way.cost <= CLEAN * count:
            break
    return min(found, key=lambda way: way.unlikely, default=None)


def _ended(way: Approach, laws: tuple[FrictionLaw, ...], parameters: Array, places: int) -> Approach:
    """The way with the widths of the laws as they stand in parameters (np_all,), and what the model's own places have."""
    ended = way.parameters.copy()
    for law in laws:
        ended[law.width] = parameters[law.width]
    return replace(way, parameters=ended, force_std={k: std for k, std in way.force_std.items() if k < places})


def _count(followed: Followed) -> int:
    return sum(int(np.isfinite(h.target).sum()) for h in followed.horizons)


def _descent(
    near: Problem,
    followed: Followed,
    laws: tuple[FrictionLaw, ...],
    parameters: Array,
    share: float,
    least: Mapping[int, float],
    telling: Collection[int],
    say: Callable[[str], None],
    strain: float = STRAINED,
    opens: bool = False,
    *,
    hidden: bool,
) -> Approach:
    """One way from loose to tight, but for the telling places, which are tight throughout; it ends where it strains.

    opens: where single places strain these stay as loose as their forces are off, and the others go on. Forces count without their means:
    of thrusts that carry a weight only what they vary by turns the body. hidden: whether outputs leave states unseen; then nothing but
    these shares holds them, and no length that a spring multiplies may make a force of what is hardly stretched.
    """
    pairs = zip(followed.horizons, followed.transcription.horizons, strict=True)
    horizons = [replace(horizon, mesh=coarse.mesh) for horizon, coarse in pairs]
    steps = np.concatenate([h.mesh.steps for h in horizons])
    count = _count(followed)
    best, way, program, size, loose, factor = np.inf, None, None, dict[int, float](), dict[int, float](), FACTOR
    share = float(np.clip(share, TIGHTEST, 1.0))

    def reached(cost: float) -> Approach:
        unlikely = cost + len(steps) * sum(np.log(s) for s in std.values())
        return Approach(followed=followed, parameters=parameters, force_std=std, whole=whole, share=share, cost=cost, unlikely=unlikely)

    while True:
        room: Array | None = None
        parameters = rounded(near, left_alone(near, laws), followed, parameters, share)
        now = forces(near, followed, parameters, varying=opens, taut=hidden)
        size = {k: min(f, size.get(k, np.inf)) for k, f in now.items()}
        whole = {k: f * float(np.sqrt(np.median(steps))) for k, f in size.items()}
        shares = {k: TIGHTEST if k in telling else max(share, loose.get(k, 0.0)) for k in size}
        std = {k: max(shares[k] * f, least.get(k, 0.0)) for k, f in whole.items()}
        if program is None or way is None:
            settings = Settings(options=OPTIONS, method="spline")
            program = make_program(near, settings, horizons, followed, laws, std, parameters, parameters)
            room = program.at_rest
            held = program.held.solve(program.start, program.values, False, _silent)
            if np.isfinite(held.solved.cost):
                followed, best = _followed(held, followed), held.solved.cost
            way = reached(held.solved.cost)
        cost = np.inf
        for _ in range(BATCHES if share <= TIGHT else 1):
            program = renewed(program, near, followed, laws, std, parameters, parameters, room)
            room = program.at_rest  # what an interval near rest has taken up is not asked back at the same share
            solution = program.solve(program.start, program.values, False, _silent)
            if not np.isfinite(solution.solved.cost):
                cost = np.inf
                break
            followed, parameters = _followed(solution, followed), solution.parameters
            before, cost = cost, solution.solved.cost
            if solution.solved.status.converged or cost > (1.0 - PAID) * before:
                break
        said = f", {', '.join(near.dae.places[k].name for k in loose)} looser" if loose else ""
        say(f"balances within {100 * share:.3g} % of their forces{said}: cost {cost:.6g}")
        squares = _squares(solution) if np.isfinite(cost) else {}
        strained = cost - sum(float(np.sum(r)) / 2 for k, r in squares.items() if k in loose)
        best = min(best, strained)
        if 2 * (strained - best) <= strain * count:
            way = reached(cost)
            if share <= TIGHTEST:
                return way
        else:
            factor = float(np.sqrt(factor))
            more = _straining(squares, share, {*loose, *telling}) if opens else {}
            if more and len(more) + len(loose) <= FEW * len(squares):
                loose, factor = loose | more, FACTOR
            if factor < LEAST_FACTOR or way.share <= TIGHTEST:
                return way
        followed, parameters = way.followed, way.parameters
        share = max(way.share / factor, TIGHTEST)


def _squares(solution: Solution) -> dict[int, Array]:
    """Place -> squares of its residual force over the room that it has, (K, N)."""
    t, rows = solution.transcription, solution.rows[solution.term(solution.transcription.force_term)]
    return {k: rows[i :: len(t.soft)] ** 2 for i, k in enumerate(t.soft)}


def _straining(squares: Mapping[int, Array], share: float, others: Collection[int]) -> dict[int, float]:
    """Place -> what share of its forces its residual force is; of all but the others, where that is more than the share they have."""
    needed = {k: share * float(np.sqrt(np.mean(r))) for k, r in squares.items() if k not in others}
    return {k: s for k, s in needed.items() if s > share}


def _followed(solution: Solution, before: Followed) -> Followed:
    t = solution.transcription
    return Followed(transcription=t, horizons=t.horizons, decisions=solution.solved.decisions, mean_square=before.mean_square)


def _silent(_: str) -> None:
    """A descent says what it does by itself."""
