"""Weights that the user wants to see turned: one along a path, several together on a grid of their factors.

    theta = theta of greatest likelihood + log(factors),        all products of the factors of {label: factors}

A grid is solved outwards from where no weight is turned, a quarter of it (for two weights) to and fro, so that each setting begins where
its neighbour, one step of one factor away, arrived; in chains of no more than LONGEST, each of which is kept when it is solved.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from math import prod

import numpy as np

from backsight.models.errors import InputError, suggestion

from ..arguments import check_mapping, check_number
from ..problem import Free, Problem
from ..supposed import INPUT, PARAMETER
from .plan import rounded
from .setting import Setting
from .turned import Weight

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Factors = Mapping[str, tuple[float, ...]]

MOST = 400  # settings of a grid
LONGEST = 12  # settings of a chain: what an interruption may lose
SMALLEST, LARGEST = 1e-6, 1e6  # factors: beyond them solves lose their digits
DIGITS = 6  # of a factor
EXAMPLE = '{"W of carriage": [0.1, 1, 10]}'


def checked(vary: Mapping[str, Iterable[float]] | None) -> dict[str, tuple[float, ...]]:
    """Label of a weight -> its factors, ascending, each once. Raises InputError for what is no factor, and for too many of them."""
    check_mapping({} if vary is None else vary, "weigh: vary", f"give labels of weights and factors on their std, {EXAMPLE} say")
    found = {}
    for label, factors in (vary or {}).items():
        where = f"weigh: vary {label!r}"
        if isinstance(factors, str) or not isinstance(factors, Iterable):
            raise InputError(f"{where} = {factors!r}: needs a list of factors on its std, [0.1, 1, 10] say.")
        for factor in (own := list(factors)):
            check_number(factor, f"{where}: factor")
            if not (np.isfinite(factor) and factor > 0):
                raise InputError(f"{where}: factor {factor:g}: a factor on a std is positive and finite; leave it out.")
            if not SMALLEST <= factor <= LARGEST:
                raise InputError(f"{where}: factor {factor:g}: lies outside {SMALLEST:g} .. {LARGEST:g}, where solves have digits left.")
        if not own:
            raise InputError(f"{where} = []: there is no factor; give some, [0.1, 1, 10] say, or leave the weight out.")
        found[label] = tuple(sorted({_shown(factor): float(factor) for factor in own}.values()))
    if (count := prod(map(len, found.values()))) > MOST:
        times = " x ".join(str(len(factors)) for factors in found.values())
        raise InputError(f"weigh: vary asks for {times} = {count} settings, and at most {MOST} are solved; give fewer factors.")
    return found


def check_labels(vary: Factors, labels: Sequence[str]) -> None:
    """Raise InputError where there is no such weight."""
    for label in vary:
        if label not in labels:
            raise InputError(f"weigh: vary {label!r}: this study has no such weight; {suggestion(label, labels)}.")


def labels_of(posed: Problem) -> list[str]:
    """The weights that the study of a posed problem may have, before it is smoothed: where balances hold exactly it has fewer."""
    found = []
    for name in (p.name for p in posed.dae.places):
        kind = "V" if name.startswith(INPUT) else "drift" if name.startswith(PARAMETER) else "W"
        found.append(f"{kind} of {name.removeprefix(INPUT).removeprefix(PARAMETER)}")
    recorded = {name for r in posed.recordings if r.role == "fit" for name in r.outputs}
    found += [f"V of {q.name}" for q in posed.dae.outputs if q.name in recorded]
    priors = any(isinstance(p, Free) and p.std is not None for p in posed.parameters.values())
    return [*found, "prior of the parameters"] if priors else found


def grid(vary: Factors) -> dict[str, tuple[float, ...]]:
    """Name of a setting -> the factor of every weight, in the order of the labels; the last one runs fastest. Without weights none."""
    every = product(*vary.values()) if vary else ()
    return {_name(vary, factors): factors for factors in every}


def chains(vary: Factors, weights: Sequence[Weight], about: Array) -> list[list[Setting]]:
    """The settings of a grid, in chains that lead outwards; about: theta (F,) from which the factors count.

    Raises InputError where there is no such weight.
    """
    labels = [w.label for w in weights]
    check_labels(vary, labels)
    at = [labels.index(label) for label in vary]
    ways = [([s for s in reversed(factors) if s < 1], [s for s in factors if s >= 1]) for factors in vary.values()]
    one = next(iter(vary)) if len(vary) == 1 else ""
    found = list[list[Setting]]()
    for corner in product(*ways) if vary else ():
        found.append([])
        for factors in _to_and_fro(corner):
            theta = about.copy()
            theta[at] += np.log(factors)
            factor = factors[0] if one else 1.0
            found[-1].append(Setting(name=_name(vary, factors), group="chosen", theta=rounded(theta), varied=one, factor=factor))
    return [chain[k : k + LONGEST] for chain in found for k in range(0, len(chain), LONGEST)]


def _to_and_fro(axes: Sequence[Sequence[float]]) -> Iterator[tuple[float, ...]]:
    """All products of factors, each one step along one axis from the one before."""
    rest = list(_to_and_fro(axes[1:])) if len(axes) > 1 else [()]
    for k, factor in enumerate(axes[0]):
        yield from ((factor, *others) for others in (reversed(rest) if k % 2 else rest))


def _name(vary: Iterable[str], factors: Iterable[float]) -> str:
    """Of its own kind: a weight may be turned by the same factor elsewhere in the study, from another start."""
    return f"chosen: {', '.join(f'{label} x {_shown(s)}' for label, s in zip(vary, factors, strict=True))}"


def _shown(factor: float) -> str:
    """What is the same in it is one factor."""
    return f"{factor:.{DIGITS}g}"
