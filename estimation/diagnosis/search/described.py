"""What a force that no component explains goes with: a description of it as it was smoothed, no explanation.

Of functions of its own velocity and position, of the inputs and of time, one after the other the one that foretells most of what is left,
beside those that were taken before,

    share = 1 - sum over b of |f_b - C_b c_(-b)|^2 / |f|^2,      c_(-b) = argmin |f_(-b) - C_(-b) c|^2

b: one of PARTS parts of the record. Slow noise goes with a few slow waves by chance: what of the motion is told foretells more than
anything does when the whole motion is shifted in time against the force, and what goes with time alone has to be most of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from ...results import Smoothing
from ...wording import listed
from ..answer.mismatch import mismatches
from ..candidates.waves import fine_periods

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

LEAST, MOST, TERMS, PARTS = 0.1, 0.5, 3, 10
ROWS = 4000  # or twice as many, of more
SHIFTS = 12  # of the motion against the force, the whole record round
KNOWN = 2.0  # times the usual deviation of the force: where it is less certain it tells nothing
SLOW = 0.05  # of the rms velocity: slower is no direction
STEP = 0.5
COARSE = np.arange(1.0, 24.5, STEP)  # waves over the way; finer ones where the force waves most
TIDY = 1e-9  # of what columns have together: less is nothing of its own


@dataclass(frozen=True)
class Function:
    """A function of the motion or of an input, in words, and its columns (n, k). along: of waves, what x they are along, and how many."""

    words: str
    columns: Array
    of_input: bool = False
    of_time: bool = False
    steady: bool = False
    along: tuple[Array, float, str] | None = None

    @classmethod
    def waves(cls, x: Array, number: float, words: str, *, of_time: bool = False) -> Function:
        """So many over the way of x (n,). words: with a place for their length."""
        length = float(np.ptp(x)) / number
        turn = 2.0 * np.pi * x / length
        return cls(words.format(f"{length:.3g}"), np.column_stack([np.sin(turn), np.cos(turn)]), along=(x, number, words), of_time=of_time)


def described(result: Smoothing, place: str) -> str:
    """67 % goes with waves of 0.0873 rad along the position and 14 % with the direction of the velocity; "" where with nothing.

    Of inputs it is told apart: in a closed loop an input goes with every force that it makes up for.
    """
    rows = [m for m in mismatches(result) if m.place == place]
    if not rows:
        return ""
    stds = np.concatenate([m.std for m in rows])
    force, told = np.concatenate([m.force for m in rows]), stds <= KNOWN * np.nanmedian(stds)
    told = np.flatnonzero(told & np.isfinite(force))
    told = told[:: max(len(told) // ROWS, 1)]
    if len(told) < PARTS:
        return ""
    common = set.intersection(*(set(m.against) for m in rows))
    units = {name: rows[0].against[name][1] for name in rows[0].against if name in common}
    motion = {name: np.concatenate([m.against[name][0] for m in rows])[told] for name in units}
    if len(rows) == 1:
        motion["time"], units["time"] = rows[0].time[told], "s"
    looks = list(functions(force[told], motion, units))
    inside = [[look for look in looks if look.of_input is side] for side in (False, True)]
    said = [_said(explained(force[told], some)) for some in inside]
    return "; ".join(part for part in (said[0], said[1] and f"by inputs alone, {said[1]}") if part)


def _said(parts: Sequence[tuple[str, float]]) -> str:
    said = [f"{100 * share:.0f} % with {words}" for words, share in parts]
    return ", then ".join(said[:1] + [listed(said[1:])] * bool(said[1:]))


def explained(force: Array, looks: Sequence[Function]) -> list[tuple[str, float]]:
    """Words of the functions that foretell most, one after the other, and the share that each adds. force (n,)."""
    found, taken, so_far = list[tuple[str, float]](), np.empty((len(force), 0)), 0.0
    while looks and len(found) < TERMS:
        shares = [foretold(force, np.hstack([taken, look.columns])) for look in looks]
        best = int(np.argmax(shares))
        chance = MOST if looks[best].of_time else LEAST if looks[best].steady else max(LEAST, _by_chance(force, taken, looks) - so_far)
        if not shares[best] - so_far > chance:
            break
        look = _tuned(force, taken, looks[best])
        whole = foretold(force, np.hstack([taken, look.columns]))
        found.append((look.words, whole - so_far))
        taken, so_far = np.hstack([taken, look.columns]), whole
    return found


def _by_chance(force: Array, taken: Array, looks: Sequence[Function]) -> float:
    """The most that any of the looks foretells when it is shifted in time."""
    shifts = np.linspace(0, len(force), SHIFTS + 2)[1:-1].astype(int).tolist()
    some = [look.columns for look in looks if not (look.of_time or look.steady)]
    return max((foretold(force, np.hstack([taken, np.roll(C, shift, axis=0)])) for C in some for shift in shifts), default=0.0)


def _tuned(force: Array, taken: Array, look: Function) -> Function:
    """Waves as long as foretells most, nearer to these than to the next ones that were looked at."""
    if look.along is None:
        return look
    x, number, words = look.along

    def missed(n: float) -> float:
        return -foretold(force, np.hstack([taken, Function.waves(x, n, words).columns]))

    best = minimize_scalar(missed, bounds=(number - STEP / 2, number + STEP / 2), method="bounded")
    return Function.waves(x, float(best.x), words) if best.fun < missed(number) else look


def foretold(force: Array, columns: Array) -> float:
    """The share of the mean square of a force (n,) that columns (n, k) foretell in parts to which they were not fitted."""
    sizes = np.linalg.norm(columns, axis=0)
    scaled = columns / np.where(sizes > 0, sizes, 1.0)
    parts = np.array_split(np.arange(len(force)), PARTS)
    G, b = scaled.T @ scaled, scaled.T @ force
    left = 0.0
    for part in parts:
        own = scaled[part]
        c = np.linalg.lstsq(G - own.T @ own, b - own.T @ force[part], rcond=TIDY)[0]
        left += float(np.sum((force[part] - own @ c) ** 2))
    whole = float(force @ force)
    return 1.0 - left / whole if whole > 0 else 0.0


def functions(force: Array, motion: Mapping[str, Array], units: Mapping[str, str]) -> Iterator[Function]:
    """What a force (n,) may go with, of what moves: "velocity", "position", "time" or an input -> values (n,)."""
    yield Function("a constant", np.ones((len(force), 1)), steady=True)
    for name, x in motion.items():
        size = float(np.sqrt(np.mean(x**2)))
        if not np.ptp(x) > 0:
            continue
        if name not in ("velocity", "position", "time"):
            yield Function(name, x[:, None], of_input=True)
            continue
        which = f"the {name}"
        if name == "velocity":
            yield Function(f"the direction of {which}", np.tanh(x / (SLOW * size))[:, None])
            yield Function(f"the square of {which}, against it", (x * np.abs(x))[:, None])
        if name == "position":
            yield Function(f"the cube of {which}", ((x - x.mean()) ** 3)[:, None])
        yield Function(which, (x - x.mean() if name == "position" else x)[:, None], of_time=name == "time")
        if name in ("position", "time"):
            unit = f" {units[name]}" if units[name] else ""
            fine = [float(np.ptp(x)) / period for period in fine_periods(x, force, float(COARSE[-1]))]
            for number in (*COARSE.tolist(), *fine):
                yield Function.waves(x, number, f"waves of {{}}{unit} along {which}", of_time=name == "time")
