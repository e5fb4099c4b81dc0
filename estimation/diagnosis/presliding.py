"""Friction that yields before it slides: the asperities bend elastically over a short way. P. R. Dahl, Aerospace Corp. TOR-158, 1968.

The friction level F that a model has at a body becomes the most that bent asperities carry:

    F zeta,    zeta' = (v - |v| zeta)/delta,    delta = F/sigma_0

Over a way |ds| of one direction, zeta -> s + (zeta - s) exp(-|ds|/delta), s = sgn v. So along the motion as it was smoothed the force is
known at every delta, and the score is that of what it has more than F sgn(v). A model without friction has to be given some first.
"""

from __future__ import annotations

from functools import partial
from math import inf

import numpy as np

from backsight.models import Model
from backsight.models.mechanics import rotational as turning
from backsight.models.mechanics import translational as sliding

from .candidates import Candidate, Insert, Signal
from .laws import Motion, flange_of
from .places import Spot, at_hand, free_name, lent, own_name

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

WAYS = tuple(float(w) for w in np.geomspace(1e-4, 3e-2, 8))  # of the span of the positions: delta
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


def of_presliding(model: Model, spot: Spot, motion: Motion, values: dict[str, float]) -> list[Candidate]:
    """The candidate at a body that has a friction level. values: of the model's parameters."""
    slides = spot.kind == "translational"
    word, rate = ("f_c", "v") if slides else ("tau_c", "omega")
    found = [path for path in at_hand(model, spot, (word,)).get(word, ()) if _alone(model, path) and not lent(model, path)]
    levels = [path for path in found if values.get(own_name(model, path), 0.0) > 0]
    if len(levels) != 1 or not motion.span > 0:
        return []
    (base,) = levels
    level = values[own_name(model, base)]
    width = values.get(own_name(model, f"{base.rpartition('.')[0]}.width"), motion.width)
    grid = [float(level / (way * motion.span)) for way in WAYS]
    kind = sliding.DahlFriction if slides else turning.RotationalDahlFriction
    name = free_name(model, f"presliding_friction_{spot.name}")
    stiffness, own = f"{name}.sigma_0", f"{name}.{word}"
    signals = tuple(
        Signal(
            of=(f"force:{spot.name}",),
            seen=f"{spot.name}.{rate}",
            changed=partial(bristles, level=level, delta=level / sigma_0, width=width),
            start={stiffness: sigma_0},
        )
        for sigma_0 in grid
    )
    component = kind(**{word: level, "sigma_0": grid[0], "width": motion.width})
    return [
        Candidate(
            place=spot.name,
            family="friction",
            physics="presliding_friction",
            edits=(Insert(place=flange_of(spot), component=component, name=name),),
            start={stiffness: (grid[0], grid[-1] / 100, inf), own: (level, level * 1e-3, inf)},
            absorbs={own_name(model, base): own},
            named={"sigma_0": stiffness, word: own},
            signals=signals,
        )
    ]


def _alone(model: Model, path: str) -> bool:
    """Whether a level is all of its law, and not what remains of one that is higher at rest, or of bent asperities themselves."""
    owner, _, word = path.rpartition(".")
    declared = model.components[owner].declared_parameters
    return declared[word].min <= 0 and not {"f_s", "tau_s"} & set(declared)
