"""Mechanisms with Coulomb friction in several coordinates: each slides or truly sticks, and every change is an event.

    M(q) v' = f(t, q, v) - c,   q' = v         sliding:   c_i = sliding_i s_i,  s_i = +1 or -1 the direction of v_i
                                               sticking:  v_i = 0 as long as |c_i| <= breakaway_i,  c_i = (f - M v')_i

The mode of all coordinates is kept over a step of the fifth order formula of `runge_kutta.py`. Where the step ends with a velocity that has
turned, or with a reaction beyond its limit, it is shortened to the root, and the coordinates at rest choose their modes anew. Errors: those
of the formula, and a coordinate that turns (or lets go) twice within a step is not seen to do so.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.linalg.lapack import dgesv
from scipy.optimize import brentq

from .runge_kutta import step

__all__ = ["Dynamics", "Friction", "accelerations", "advance"]

# dynamics(t, q, v): M (n, n) and f (n,)
Dynamics = Callable[[float, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
TIME_ERROR = 1e-13  # s, of an event
EVENTS = 100  # in a step: of each coordinate two are seen, and every one of them may let others go or stop


@dataclass(frozen=True, kw_only=True)
class Friction:
    """Coulomb friction of each coordinate (n,): its force while sliding and the largest one of sticking; 0, 0: none.

    factor(t, q): what both are multiplied by (n,), not negative; None: 1.
    """

    sliding: np.ndarray
    breakaway: np.ndarray
    factor: Callable[[float, np.ndarray], np.ndarray] | None = None

    def __post_init__(self) -> None:
        if not ((self.sliding >= 0) & (self.breakaway >= self.sliding)).all():
            raise ValueError(f"sliding {self.sliding}, breakaway {self.breakaway}: needs 0 <= sliding <= breakaway, or nothing would rest")

    @property
    def acts(self) -> np.ndarray:
        """Which coordinates (n,) can stick."""
        return self.breakaway > 0

    def levels(self, t: float, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces of sliding and of breakaway (n,) at t in the position q."""
        if self.factor is None:
            return self.sliding, self.breakaway
        factor = self.factor(t, q)
        return factor * self.sliding, factor * self.breakaway


def accelerations(dynamics: Dynamics, friction: Friction, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """v' (n,) at t, with the modes that the coordinates at rest choose."""
    return _solve(dynamics, friction, t, q, v, _choose(dynamics, friction, t, q, v, {}))[0]


def advance(
    dynamics: Dynamics, friction: Friction, t: float, q: np.ndarray, v: np.ndarray, duration: float, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """q and v (n,) after `duration` [s], in equal steps but for the events; v_i is exactly 0.0 where coordinate i sticks.

    Raises ValueError where the modes change without end: where a force jumps with the sign of a velocity, none may hold.
    """
    end, n = t + duration, q.size
    for i in range(steps):
        until, released, events = end - duration * (steps - 1 - i) / steps, dict[int, float](), 0
        while until - t > TIME_ERROR:
            modes = _choose(dynamics, friction, t, q, v, released)
            y, h, event = _to_next_event(dynamics, friction, t, np.concatenate([q, v]), modes, until - t)
            t, q, v, released, events = t + h, y[:n], np.where(modes == 0, 0.0, y[n:]), {}, events + 1
            if events > EVENTS:
                raise ValueError(
                    f"a body starts and stops without end at t = {t:.6g} s: force(t, q, v) jumps there; round its corner, as by "
                    "tanh(v / width), or give Coulomb friction to the machine itself"
                )
            if event is not None and modes[event] != 0:
                v[event] = 0.0
            elif event is not None:
                released = {event: float(np.sign(_solve(dynamics, friction, t, q, v, modes)[1][event]))}
    return q, v


def _solve(
    dynamics: Dynamics, friction: Friction, t: float, q: np.ndarray, v: np.ndarray, modes: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """v' (n,), what holds the sticking coordinates (n,), and the diagonal of M (n,)."""
    M, f = dynamics(t, q, v)
    drive, slides, a = f - friction.levels(t, q)[0] * modes, modes != 0, np.zeros(q.size)
    if slides.all():
        a = _accelerated(M, drive)
    elif slides.any():
        a[slides] = _accelerated(M[slides][:, slides], drive[slides])
    return a, f - M @ a, M.diagonal()


def _accelerated(M: np.ndarray, f: np.ndarray) -> np.ndarray:
    """M^-1 f (n,); numpy's own solve takes longer to look at its arguments than small matrices take."""
    a: np.ndarray = f / M[0, 0] if f.size == 1 else dgesv(M, f)[2]
    return a


def _choose(dynamics: Dynamics, friction: Friction, t: float, q: np.ndarray, v: np.ndarray, released: dict[int, float]) -> np.ndarray:
    """Modes (n,), 0 for sticking: of those at rest the combination in which all stick within their limits or start the way they slide."""
    modes = np.where(v < 0, -1.0, 1.0)
    rest = [i for i in np.flatnonzero(friction.acts & (v == 0)) if i not in released]
    for i, s in released.items():
        modes[i] = s
    if not rest:
        return modes
    best, least, breakaway = modes, np.inf, friction.levels(t, q)[1]
    for trial in product((0.0, 1.0, -1.0), repeat=len(rest)):
        modes = modes.copy()
        modes[rest] = trial
        a, held, inertia = _solve(dynamics, friction, t, q, v, modes)
        wrong = sum(
            max(0.0, -modes[i] * a[i] * inertia[i]) if modes[i] else max(0.0, abs(held[i]) - breakaway[i]) for i in rest
        )  # N or N m. Where more than one combination has none (breakaway above sliding), bodies at rest stick: that is tried first
        if wrong < least:
            best, least = modes, wrong
        if wrong == 0.0:
            break
    return best


def _to_next_event(
    dynamics: Dynamics, friction: Friction, t: float, y: np.ndarray, modes: np.ndarray, h: float
) -> tuple[np.ndarray, float, int | None]:
    """y = (q, v) at the end of the step h or at the first event before it, the time that takes, and the coordinate of the event."""
    n = modes.size

    def rates(now: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[n:], _solve(dynamics, friction, now, y[:n], y[n:], modes)[0]])

    def left(after: np.ndarray, length: float) -> np.ndarray:
        """Positive as long as the modes last (n,), y being `after` once `length` is over."""
        out = np.where(friction.acts, modes * after[n:], 1.0)
        if not modes.all():
            held = _solve(dynamics, friction, t + length, after[:n], after[n:], modes)[1]
            out = np.where(modes == 0, friction.levels(t + length, after[:n])[1] - np.abs(held), out)
        return out

    def margins(length: float) -> np.ndarray:
        return left(step(rates, t, y, length), length)

    after = step(rates, t, y, h)
    late = np.flatnonzero(left(after, h) < 0)
    if not late.size:
        return after, h, None
    ends = [(_root(margins, int(i), h, bool(modes[i] and y[n + i] == 0.0)), int(i)) for i in late]
    length, event = min(ends)
    return step(rates, t, y, length), length, event


def _root(margins: Callable[[float], np.ndarray], i: int, h: float, starts: bool) -> float:
    """The length in (0, h] at which margin i vanishes; that of a coordinate which starts from rest vanishes at 0, which is not meant."""

    def margin(length: float) -> float:
        return float(margins(length)[i])

    low = 1e-6 * h if starts else 0.0
    return float(brentq(margin, low, h, xtol=TIME_ERROR)) if margin(low) > 0 else max(low, TIME_ERROR)
