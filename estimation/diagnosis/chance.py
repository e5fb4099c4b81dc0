"""How likely a gain is by chance anywhere in a library: drawn for gains that are common, and from there on by the bound.

Where nothing is missing twice the gain of a look is chi squared, and that of as much as g anywhere in the library has a chance of at most

    bound(g) = sum over looks of P(chi2_r > 2 g)                    (Bonferroni; r: how many strengths a look tells)

which counts two hundred wave numbers, or dates when something may set in, as if they had nothing in common. Rows are drawn instead, scored
by all looks as those of the recordings are (a parametric bootstrap of the linearised problem), and the largest gain g_k of every draw tells
what share of the bound is true. With bound(g) exponential of rate kappa, as the least of many independent chances is,

    p(g) = 1 - exp(-kappa bound(g)),        kappa = 1 / mean of bound(g_k)

(P. H. Westfall, S. S. Young, Resampling-based multiple testing, 1993; one number for the library, since few draws tell a tail.)
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from functools import cached_property
from math import expm1

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

DRAWS = 64  # tell the share to an eighth
LEAST, MOST = 0.1, 1e3  # nats, between which gains are looked for


@dataclass(frozen=True, kw_only=True)
class Chance:
    """Of gains. looks: how many there were of every freedom; most (draws,): the largest gain of every draw, none: the bound itself."""

    looks: Counter[int]
    most: Array = field(default_factory=lambda: np.empty(0))

    def bound(self, gains: Array) -> Array:
        """Sum of the chances of all looks, one by one."""
        parts = [count * chi2.sf(2.0 * gains, freedom) for freedom, count in self.looks.items()]
        return np.sum(parts, axis=0) if parts else np.zeros_like(gains)

    @cached_property
    def share(self) -> float:
        """kappa: of the looks, as many as have something of their own."""
        mean = float(self.bound(self.most).mean()) if len(self.most) else 0.0
        return min(1.0, 1.0 / mean) if mean > 0 else 1.0

    def of(self, gain: float) -> float:
        """As much gain anywhere in the library if nothing is missing."""
        return -expm1(-self.share * float(self.bound(np.array([gain]))[0]))

    def needed(self, chance: float) -> float:
        """The gain that has this chance."""
        if not self.of(LEAST) > chance:
            return LEAST
        return float(brentq(lambda g: self.of(g) - chance, LEAST, MOST))
