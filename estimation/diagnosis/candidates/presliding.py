"""Friction that yields before it slides: the asperities bend elastically over a short way. P. R. Dahl, Aerospace Corp. TOR-158, 1968.

The friction level F that a model has at a body becomes the most that bent asperities carry:

    F zeta,    zeta' = (v - |v| zeta)/delta,    delta = F/sigma_0

Over a way |ds| of one direction, zeta -> s + (zeta - s) exp(-|ds|/delta), s = sgn v. So along the motion as it was smoothed the force is
known at every delta, and the score is that of what it has more than F sgn(v). Where a body has no friction F is what the score tells, and
only ways are looked at that are no sharp corner of F sgn(v): joints and mounts that never slide all the way, whose force is a loop over
the position.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from math import inf

import numpy as np

from backsight.models import Model
from backsight.models.mechanics import rotational as turning
from backsight.models.mechanics import translational as sliding

from .candidate import Candidate, Signal
from .edits import Insert
from .laws import Motion, flange_of
from .places import RATES, Spot, at_hand, free_name, lent, own_name

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Carried = Callable[[Array, Array], Array]

WAYS = tuple(float(w) for w in np.geomspace(1e-4, 3e-2, 8))  # of the span of the positions: delta
LONG_WAYS = tuple(float(w) for w in np.geomspace(1e-2, 1.0, 7))  # where there is no friction yet
LEVELS, UNITS = ("f_c", "tau_c", "f_plus", "f_minus", "tau_plus", "tau_minus", "c"), ("N", "N.m")
SHARPER = 0.1  # of what signs are rounded over: |v| has a corner that no force jumps at, and slow ways bend asperities, too
FINE = 4  # parts of a row in which the velocity keeps its direction


def bristles(time: Array, velocity: Array, *, level: float, delta: float, width: float) -> Array:
    """Mean force over every row that bent asperities push with beyond F sgn(v), positive along v.

    time [s] and velocity [m/s or rad/s] of the rows (n,), linear between them; level F [N or N.m], delta [m or rad], width over which the
    model rounds its sign [as velocity].
    """
    step = np.diff(time, append=2 * time[-1] - time[-2])
    share = (np.arange(FINE) + 0.5) / FINE
    following = np.append(velocity[1:], velocity[-1])
    v = velocity[:, None] + (following - velocity)[:, None] * share
    decay, zeta = np.exp(-np.abs(v) * (step / FINE)[:, None] / delta).ravel(), np.empty(v.size)
    now = float(np.sign(velocity[0]))
    for k, (s, e) in enumerate(zip(np.sign(v).ravel().tolist(), decay.tolist(), strict=True)):
        before, now = now, s + (now - s) * e
        zeta[k] = (before + now) / 2
    return np.asarray(level * np.mean(np.tanh(v / width) - zeta.reshape(v.shape), axis=1))


def carried(time: Array, velocity: Array, *, delta: float) -> Array:
    """Mean force over every row that bent asperities push with where F is one, positive along v; arguments as of `bristles`."""
    return bristles(time, velocity, level=1.0, delta=delta, width=inf)


def of_presliding(model: Model, spot: Spot, motion: Motion, values: dict[str, float], *, seen: bool) -> list[Candidate]:
    """The candidate at a body with one friction level, or with none. values: of all parameters; seen: whether an output shows it."""
    word = "f_c" if spot.kind == "translational" else "tau_c"
    there = at_hand(model, spot, LEVELS)
    levels = {path: level for path in chain(*there.values()) if (level := _level(model, path, values)) > 0}
    if not motion.span > 0 or len(levels) > 1:
        return []
    if not levels:
        return [_grown(model, spot, motion, word)] if seen else []
    ((base, level),) = levels.items()
    if not base.endswith(f".{word}") or not _alone(model, base) or lent(model, base):
        return []
    width = values.get(own_name(model, f"{base.rpartition('.')[0]}.width"), motion.width)
    ways, force = [way * motion.span for way in WAYS], partial(bristles, level=level, width=width)
    c = _candidate(model, spot, motion, word, level, ways, lambda way: partial(force, delta=way))
    return [replace(c, absorbs={own_name(model, base): c.named[word]})]


def _grown(model: Model, spot: Spot, motion: Motion, word: str) -> Candidate:
    """The candidate where there is no friction, with all that it has as large as the score tells."""
    c = _candidate(model, spot, motion, word, 1.0, [way * motion.span for way in LONG_WAYS], lambda way: partial(carried, delta=way))
    level, stiffness = c.named[word], c.named["sigma_0"]
    signals = tuple(replace(s, start={level: 1.0, **s.start}) for s in c.signals)
    free = {level: (1.0, 0.0, inf), stiffness: (c.start[stiffness][0], 0.0, inf)}
    return replace(c, signals=signals, start=free, grows=(level, stiffness))


def _candidate(
    model: Model, spot: Spot, motion: Motion, word: str, level: float, ways: Sequence[float], force: Callable[[float], Carried]
) -> Candidate:
    """With a level, seen at some ways; force: what there is of it at one of them, by time and velocity."""
    name = free_name(model, f"presliding_friction_{spot.name}")
    kind = sliding.DahlFriction if spot.kind == "translational" else turning.RotationalDahlFriction
    own, stiffness, stiffest = f"{name}.{word}", f"{name}.sigma_0", level / min(ways)
    return Candidate(
        place=spot.name,
        family="friction",
        physics="presliding_friction",
        edits=(
            Insert(place=flange_of(spot), component=kind(**{word: level, "sigma_0": stiffest, "width": SHARPER * motion.width}), name=name),
        ),
        start={stiffness: (stiffest, level / max(ways) / 100, inf), own: (level, level * 1e-3, inf)},
        named={"sigma_0": stiffness, word: own},
        signals=tuple(
            Signal(of=(f"force:{spot.name}",), seen=f"{spot.name}.{RATES[spot.kind]}", changed=force(way), start={stiffness: level / way})
            for way in ways
        ),
    )


def _level(model: Model, path: str, values: dict[str, float]) -> float:
    """A force that does not vanish with the velocity; nothing of what is measured otherwise."""
    owner, _, word = path.rpartition(".")
    return values.get(own_name(model, path), 0.0) if model.components[owner].declared_parameters[word].unit in UNITS else 0.0


def _alone(model: Model, path: str) -> bool:
    """Whether a level is all of its law, and not what remains of one that is higher at rest, or of bent asperities themselves."""
    owner, _, word = path.rpartition(".")
    declared = model.components[owner].declared_parameters
    return declared[word].min <= 0 and not {"f_s", "tau_s"} & set(declared)
