"""Where a friction law is not to be trusted: near zero velocity.

A rounded sign cannot hold a body at rest, and where a velocity changes its sign inside a mesh interval nobody knows when. A balance
that is enforced there reads both as a force, and bends the parameters to explain it. So the residual force of such a balance gets
room in these intervals, as much as the law is strong, and what happens there tells hardly anything about the parameters.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_propagation

from backsight.models import Dae
from backsight.ocp import Solution
from backsight.ocp.follow import Followed
from backsight.ocp.polynomials import Array

from ..problem import Free, Problem
from ..supposed import INPUT, PARAMETER
from .along import along
from .law_velocity import velocity_of

Room = NDArray[np.bool_]

ROUNDING = 0.01  # smoothing width of a friction law over the rms of its velocity
SHARPER = 0.1  # of that: the least width where a body rests
OTHER = 1.02  # times a width: what evidence would notice
RESTS = 0.3  # of the velocities, that are slow where a body rests and does not only turn
NEAR = 4.0  # widths: where the rounded sign is one to 0.1 %
DOUBT = 3.0  # standard deviations of a velocity within which its sign is not known
BETWEEN, LARGE_DOUBT = 3, 9.0  # intervals at most between two near rest that are so, too, and standard deviations of a velocity there
ROOMY = 2.0  # the same from which on an interval counts as near rest: measured inputs differ less, and that is not for rest
ANY_ROOM = 1.01  # the same from which on it has room at all
SHARP = 1e-6  # width over the rms of the velocity at which a sign is not rounded at all; its inverse: nothing is left of it
STRAINED = 5.0  # standard deviations of a force or a sample near rest, from which on it tells that room is missing there
TINY = 1e-300  # strength that still marks an interval near rest
VELOCITY_UNITS = ("m/s", "rad/s")  # of a width: corners of contacts and of loads are rounded in other units


@dataclass(frozen=True, kw_only=True)
class FrictionLaw:
    """A law with a rounded sign.

    width: index of its smoothing parameter; velocity: its velocity's name among the model's variables; places: whose balances it enters.
    """

    width: int
    velocity: str
    places: tuple[int, ...]


def friction_laws(problem: Problem) -> tuple[FrictionLaw, ...]:
    """The laws with a rounded sign that act: a strength that is fixed at zero is none."""
    dae, laws = problem.dae, []
    fixed = [i for i, p in enumerate(dae.parameters) if not isinstance(problem.parameters.get(p.name), Free)]
    numbers = ca.DM(problem.values)
    for index, parameter in enumerate(dae.parameters):
        component = parameter.name.rsplit(".", 1)[0]
        own = [q.name for q in dae.states if q.name.startswith(f"{component}.") and f"{PARAMETER}{q.name}" not in problem.weights.W]
        presliding = bool(own)  # a law with a state of its own, not a parameter that drifts, holds a body by itself
        if not parameter.smoothing or parameter.unit not in VELOCITY_UNITS or presliding:
            continue
        slope = ca.jacobian(dae.residual, dae.p[index])
        others = [i for i in fixed if i != index]
        slope = ca.substitute(slope, ca.vertcat(*(dae.p[i] for i in others)), numbers[others]) if others else slope
        places = _places(dae, slope)
        velocity = velocity_of(dae, component, index, slope) if places else None
        if velocity is not None:
            laws.append(FrictionLaw(width=index, velocity=velocity, places=places))
    return tuple(laws)


def _places(dae: Dae, slope: Any) -> tuple[int, ...]:
    """Whose balances a column of the residual's slope is in."""
    rows = [r for r in range(slope.shape[0]) if not ca.simplify(slope[r]).is_zero()]
    carried = [e.place if e.shaped is None else e.shaped for r, e in enumerate(dae.equations) if r in rows]
    return tuple(int(k) for k in carried if k is not None)


def rounded_signs(solution: Solution) -> dict[str, dict[str, float]]:
    """Place -> name and value of the widths of the rounded signs in its balance."""
    dae, found = solution.transcription.dae, dict[str, dict[str, float]]()
    for index, parameter in enumerate(dae.parameters):
        if parameter.smoothing and parameter.unit in VELOCITY_UNITS:
            for place in _places(dae, ca.jacobian(dae.residual, dae.p[index])):
                found.setdefault(dae.places[place].name, {})[parameter.name] = float(solution.parameters[index])
    return found


def smoothing_widths(problem: Problem, laws: tuple[FrictionLaw, ...], followed: Followed, unseen: Collection[int] = ()) -> dict[int, float]:
    """Widths of the laws that the user left alone, by `rounding`. unseen: places of bodies no output shows, whose rests are guesses."""
    widths = {}
    for law in left_alone(problem, laws):
        v = _velocity(problem, law, followed, problem.values)
        least = problem.dae.parameters[law.width].minimum
        if np.any(v):
            widths[law.width] = max(rounding(v, resting=not set(law.places) & set(unseen)), least)
    return widths


def other_widths(problem: Problem, solution: Solution, followed: Followed, unseen: Collection[int]) -> dict[str, float]:
    """Names and values of widths that the trajectories of a solution, followed, ask for where that has others.

    A sensor's gain makes another motion of its samples. Of two models that say the same of these the one whose signs are the sharper would
    be the better one, by hundreds of nats.
    """
    laws = tuple(law for law in friction_laws(problem) if not set(law.places) & set(unseen))
    asked = smoothing_widths(problem, laws, followed, unseen)
    names = [p.name for p in problem.dae.parameters]
    return {names[i]: width for i, width in asked.items() if abs(np.log(width / solution.parameters[i])) > np.log(OTHER)}


def rounding(velocity: Array, resting: bool = True) -> float:
    """Width over which a sign is rounded, of velocities (M,): a hundredth of their rms, and less where the body rests.

    What holds a body at rest is a creeping as fast as the width, on and on. So it is as little as what is seen there: where a good part of
    all velocities is slow, their median, but no less than a tenth of the width, or no solver gets round the corner.
    """
    width = ROUNDING * float(np.sqrt(np.mean(velocity**2)))
    slow = np.abs(velocity)[np.abs(velocity) <= NEAR * width]
    rests = resting and len(slow) > RESTS * len(velocity)
    return float(np.clip(np.median(slow), SHARPER * width, width)) if rests else width


def sliding(problem: Problem, solution: Solution, followed: Followed) -> dict[str, tuple[float, float]]:
    """Name of a law's width -> the shares of all knots at which its body slides forwards and backwards, faster than NEAR widths."""
    found = {}
    for law in friction_laws(problem):
        v = _velocity(problem, law, followed, solution.parameters) / solution.parameters[law.width]
        found[problem.dae.parameters[law.width].name] = float(np.mean(v > NEAR)), float(np.mean(v < -NEAR))
    return found


def left_alone(problem: Problem, laws: tuple[FrictionLaw, ...]) -> tuple[FrictionLaw, ...]:
    """The laws whose width the user did not give."""
    return tuple(law for law in laws if problem.dae.parameters[law.width].name not in problem.parameters)


def rounded(problem: Problem, laws: tuple[FrictionLaw, ...], followed: Followed, parameters: Array, share: float) -> Array:
    """The parameters (np_all,) with the signs of laws rounded over a share of the rms of their velocities."""
    out = parameters.copy()
    for law in laws:
        out[law.width] = share * (rms_velocity(problem, law, followed, parameters) or 1.0)
    return out


def rms_velocity(problem: Problem, law: FrictionLaw, followed: Followed, parameters: Array) -> float:
    """The law's rms velocity along the followed trajectories of all recordings."""
    return float(np.sqrt(np.mean(_velocity(problem, law, followed, parameters) ** 2)))


def _velocity(problem: Problem, law: FrictionLaw, followed: Followed, parameters: Array) -> Array:
    """A law's velocity at all knots."""
    expression = problem.dae.variables[law.velocity]
    return np.hstack(
        [along(problem.dae, expression, followed, k, h.mesh.knots, parameters) for k, h in enumerate(followed.horizons)]
    ).ravel()


def open_at_rest(
    problem: Problem,
    laws: tuple[FrictionLaw, ...],
    followed: Followed,
    knots: list[Array],
    soft: tuple[int, ...],
    parameters: Array,
    known: Mapping[int, float] | None = None,
) -> Array:
    """Standard deviations of residual forces in intervals near rest that leave a law's whole strength open, 0 elsewhere; (n_soft, N).

    A body at rest is held by any force up to the law's strength f, so a force of that size acts over an interval h: f sqrt(h), or what
    brings a coloured force there within it. An interval is near rest when the velocity of a law falls below its own change over the
    interval, or below NEAR widths; and from there on as long as it cannot be told from zero: while a body stands still, its estimated
    velocity is noise, of which the law would make forces of either sign. So are a few intervals between two of these, where noise is large
    for once: a body would break away there against its law, and two such intervals in thousands would settle the weight of all of them.

    known: place -> strength of its laws together, where that is not to be theirs (`strengths_at_rest`).
    """
    strengths = _together(laws, [_strengths(problem, law, followed, parameters) for law in laws], known or {})
    parts = []
    for number, own in enumerate(knots):
        part = np.zeros((len(soft), len(own) - 1))
        for law, strength in zip(laws, strengths, strict=True):
            times = np.concatenate([own[:-1], (own[1:] + own[:-1]) / 2, own[1:]])
            v = along(problem.dae, problem.dae.variables[law.velocity], followed, number, times, parameters).reshape(3, -1)
            change = v.max(axis=0) - v.min(axis=0)
            std = _velocity_std(problem, law, followed, number, times, parameters).reshape(3, -1).max(axis=0)
            least = np.where(np.sign(v.max(axis=0)) != np.sign(v.min(axis=0)), 0.0, np.abs(v).min(axis=0))
            slow = least <= NEAR * parameters[law.width]
            resting = binary_propagation(slow, mask=slow | (least <= DOUBT * std))
            near = (least <= change) | resting | (_closed(resting, BETWEEN) & (least <= LARGE_DOUBT * std))
            for place, f in zip(law.places, strength, strict=True):
                if place in soft:
                    part[soft.index(place), near] += max(f, TINY) * std_of_one(problem.dae, place, np.diff(own))[near]
        parts.append(part)
    return np.hstack(parts)


def _closed(there: Room, gap: int) -> Room:
    """With gaps of so many at most, between two that are there, filled."""
    return np.asarray(binary_closing(np.pad(there, gap + 1), np.ones(gap + 1, dtype=np.bool_))[gap + 1 : -gap - 1], dtype=np.bool_)


def _together(laws: tuple[FrictionLaw, ...], strengths: list[list[float]], known: Mapping[int, float]) -> list[list[float]]:
    """Strengths with a sum at every place that is what is known of it."""
    whole, count = dict[int, float](), dict[int, int]()
    for law, own in zip(laws, strengths, strict=True):
        for place, f in zip(law.places, own, strict=True):
            whole[place], count[place] = whole.get(place, 0.0) + f, count.get(place, 0) + 1

    def scaled(place: int, f: float) -> float:
        if place not in known:
            return f
        return f * known[place] / whole[place] if whole[place] > 0 else known[place] / count[place]

    return [[scaled(place, f) for place, f in zip(law.places, own, strict=True)] for law, own in zip(laws, strengths, strict=True)]


def strengths_at_rest(solution: Solution) -> dict[str, float]:
    """Place -> strength for which a solution has room near rest, where it has any.

    Models of one place are compared with the same room there: with less, because something else took a part of a law's strength, every
    interval at rest would count for evidence, of which nobody knows anything.
    """
    t = solution.transcription
    std = t.force_std_at(solution.values)
    one = np.array([std_of_one(t.dae, k, t.nlp.steps) for k in t.soft]).reshape(std.shape)
    beyond = np.sqrt(np.maximum(std**2 - std.min(axis=1, keepdims=True, initial=np.inf) ** 2, 0.0)) / one * near_rest(std)
    found = zip(t.soft, beyond.max(axis=1, initial=0.0).tolist(), strict=True)
    return {t.dae.places[k].name: strength for k, strength in found if strength > 0}


def _velocity_std(problem: Problem, law: FrictionLaw, followed: Followed, number: int, times: Array, parameters: Array) -> Array:
    """Standard deviation of a law's velocity along the followed trajectory, (M,); 0 where nobody knows it."""
    if followed.covariance is None:
        return np.zeros(len(times))
    dae = problem.dae
    slope = ca.jacobian(dae.variables[law.velocity], ca.vertcat(dae.dx, dae.x, dae.z)).T
    return followed.spread(number, times, along(dae, slope, followed, number, times, parameters))


def std_of_one(dae: Dae, place: int, steps: Array) -> Array:
    """Standard deviation of the white noise in a place's row that brings a force of one within intervals of these lengths h, (N,).

    A white force is that noise: sqrt(h). A coloured one is shaped from it by c f' + .. = w or c f'' + .. = w: c h^-1/2, c h^-3/2.
    """
    balance, row = dae.balances_of([place])[0], dae.rows_of([place])[0]
    if row == balance:
        return np.asarray(np.sqrt(steps))
    slope = ca.jacobian(dae.residual[row], dae.dx)
    (state,) = slope.sparsity().get_col()
    order = 2 if state in {j for _, j, _ in dae.kinematics} else 1
    return np.asarray(float(ca.evalf(slope[state])) * steps ** (0.5 - order))


def with_room(force_std: Array, at_rest: Array) -> Array:
    """Standard deviations in every interval from those of the places (n_soft,) and those `open_at_rest`; (n_soft, N).

    Both forces act there. More room than the law is strong would cost evidence at every reversal, and laws that hardly stand out of the
    residual forces would be refused for it.
    """
    return np.asarray(np.hypot(force_std[:, None], at_rest), dtype=np.float64)


def wants_room(
    problem: Problem, laws: tuple[FrictionLaw, ...], solution: Solution, followed: Followed, known: Mapping[int, float] | None = None
) -> bool:
    """Whether a solution strains where it has come to rest: in intervals near rest that have no room there.

    Room is given by the trajectory that a solve began at; where its noise hid a rest, a body breaks away against its own law, and what that
    costs, in forces or in samples of an accelerometer, the weights would take for noise. followed: of the solution; known: as for
    `open_at_rest`.
    """
    t = solution.transcription
    if not laws or not t.soft:
        return False
    at_rest = open_at_rest(problem, laws, followed, [h.mesh.knots for h in t.horizons], t.soft, solution.parameters, known)
    std = t.force_std_at(solution.values)
    lacking = near_rest(with_room(std.min(axis=1), at_rest)) & ~near_rest(std)
    if not lacking.any():
        return False
    number = solution.term(t.force_term)
    interval = t.nlp.terms[number].interval
    forces = any(_strained(solution.rows[number][i :: len(t.soft)][:, there[interval]]) for i, there in enumerate(lacking))
    rows = np.concatenate([np.any(list(_rows(solution, k, lacking).values()), axis=0) for k in range(len(t.horizons))])
    return forces or _strained(solution.rows[solution.term("samples")][:, rows])


def _strained(rows: Array) -> bool:
    """Whether one of these rows, of standard deviation one, is beyond all chance."""
    return bool(np.max(np.abs(rows), initial=0.0) > STRAINED)


def near_rest(std: Array) -> Room:
    """Which intervals of a place have room for rest, by standard deviations as `with_room` made them; (n_soft, N)."""
    return np.asarray(std > ROOMY * std.min(axis=1, keepdims=True, initial=np.inf), dtype=np.bool_)


def rows_near_rest(solution: Solution, number: int) -> dict[int, Room]:
    """Place -> which samples of a horizon are in such intervals, (n,); one at a knot has a part in both."""
    return _rows(solution, number, near_rest(solution.transcription.force_std_at(solution.values)))


def rows_with_room(solution: Solution, number: int) -> dict[int, Room]:
    """The same of intervals with any room for rest that tells, beside residual forces that may be as large."""
    t = solution.transcription
    std = t.force_std_at(solution.values)
    measured = np.array([t.dae.places[k].name.startswith(INPUT) for k in t.soft], dtype=np.bool_)
    return _rows(solution, number, (std > ANY_ROOM * std.min(axis=1, keepdims=True, initial=np.inf)) & ~measured[:, None])


def _rows(solution: Solution, number: int, room: Room) -> dict[int, Room]:
    t = solution.transcription
    horizon = t.horizons[number]
    interval, tau = horizon.mesh.locate(horizon.time)
    here = t.offsets[number] + interval
    before = here - ((tau == 0) & (interval > 0))
    return dict(zip(t.soft, room[:, here] | room[:, before], strict=True))


def _strengths(problem: Problem, law: FrictionLaw, followed: Followed, parameters: Array) -> list[float]:
    """Largest force of a law on each of its places: what the balance loses when the sign is rounded away altogether."""
    dae = problem.dae
    F = dae.residual[dae.balances_of(law.places)]
    rms = rms_velocity(problem, law, followed, parameters) or 1.0
    largest = np.zeros(len(law.places))
    for number, horizon in enumerate(followed.horizons):
        sides = []
        for width in (SHARP * rms, rms / SHARP):
            there = parameters.copy()
            there[law.width] = width
            sides.append(along(dae, F, followed, number, horizon.mesh.knots, there))
        largest = np.maximum(largest, np.abs(sides[0] - sides[1]).max(axis=1))
    return [float(f) if np.isfinite(f) else 0.0 for f in largest]
