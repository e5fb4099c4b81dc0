"""A body on a guide with viscous and true Coulomb friction: it sticks, and every start, stop and reversal is an event.

    sliding:   M v' = G - d v - f_c s        x' = v        s = +1 or -1, the direction of sliding
    sticking:  v = 0 as long as |G| <= f_c

with G the force on the body over one sample, held: motor force, disturbance and offset together. Nothing is smoothed: the
sign function is a mode `s` of the body, integrated by DOP853 up to the instant where v = 0, where the mode is chosen anew.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

__all__ = ["Body", "Motion", "advance", "respond"]


@dataclass(frozen=True, kw_only=True)
class Body:
    """Mass m [kg], viscous friction d [N s/m] and Coulomb friction f_c [N]; f_c is also the largest force of sticking."""

    m: float
    d: float
    f_c: float


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Position x [m] and velocity v [m/s] at one instant; v is exactly 0.0 while the body sticks."""

    x: float = 0.0
    v: float = 0.0


def advance(body: Body, motion: Motion, force: float, duration: float) -> Motion:
    """The motion `duration` seconds later under the held force `force` [N].

    At most two events fall into one sample: with a held force the velocity runs monotonously towards its terminal value.
    """
    t, x, v = 0.0, motion.x, motion.v
    while t < duration:
        if v == 0.0 and abs(force) <= body.f_c:
            return Motion(x=x, v=0.0)
        s = np.sign(v) if v != 0.0 else np.sign(force)
        t, x, v = _slide(body, x, v, float(s), force, t, duration)
    return Motion(x=x, v=v)


def _slide(body: Body, x: float, v: float, s: float, force: float, start: float, end: float) -> tuple[float, float, float]:
    """Slide in the direction s from `start` until `end` or until the velocity is zero, whichever comes first."""
    m, d, drive = body.m, body.d, force - body.f_c * s

    def rates(_: float, state: np.ndarray) -> list[float]:
        return [state[1], (drive - d * state[1]) / m]

    def stop(_: float, state: np.ndarray) -> float:
        return float(state[1])

    stop.terminal, stop.direction = True, -s  # type: ignore[attr-defined]
    # Relative to the start, so that the tolerance does not depend on where on the guide the body is.
    run = solve_ivp(rates, (start, end), [0.0, v], method="DOP853", events=stop, rtol=1e-10, atol=1e-14, first_step=end - start)
    stopped = run.status == 1
    return float(run.t[-1]), x + float(run.y[0, -1]), 0.0 if stopped else float(run.y[1, -1])


def respond(body: Body, forces: np.ndarray, step: float, start: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (n + 1,) at the samples when forces[k] (n,) is held from sample k to k + 1."""
    motions = [start]
    for force in forces:
        motions.append(advance(body, motions[-1], float(force), step))
    return np.array([q.x for q in motions]), np.array([q.v for q in motions])
