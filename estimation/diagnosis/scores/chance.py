"""How likely a gain is by chance anywhere in a library: drawn for gains that are common, and from there on by the bound.

Where nothing is missing twice the gain of a look is chi squared, and that of as much as g anywhere in the library has a chance of at most

    bound(g) = sum over looks of P(chi2_r > 2 g)                    (Bonferroni; r: how many strengths a look tells)

which counts two hundred wave numbers, or dates when something may set in, as if they had nothing in common. Rows are drawn instead, scored
by all looks as those of the recordings are (a parametric bootstrap of the linearised problem), and the largest gain g_k of every draw tells
what share of the bound is true. Were the looks a few independent ones, each many times, bound(g_k) would be exponential of rate kappa, and

    p(g) = 1 - exp(-kappa bound(g))

(P. H. Westfall, S. S. Young, Resampling-based multiple testing, 1993). Looks that are only related have more of their own the larger a
gain: kappa is that of the m largest gains of n, by the likelihood of exponentials of which the others are only known to be larger,

    kappa = m / (sum_(k <= m) b_k + (n - m) b_m),     b_k = bound(g_k), the least first

Far beyond what was drawn p is too small by the factor 1/kappa at most.
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

DRAWS = 256
TAIL = 0.125  # of the draws, those with the largest gains, that tell the share: to a sixth
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
        b, m = np.sort(self.bound(self.most)), round(TAIL * len(self.most))
        waited = float(b[:m].sum() + (len(b) - m) * b[m - 1]) if m else 0.0
        return min(1.0, m / waited) if waited > 0 else 1.0

    def of(self, gain: float) -> float:
        """As much gain anywhere in the library if nothing is missing."""
        return -expm1(-self.share * float(self.bound(np.array([gain]))[0]))

    def needed(self, chance: float) -> float:
        """The gain that has this chance."""
        if not self.of(LEAST) > chance:
            return LEAST
        return float(brentq(lambda g: self.of(g) - chance, LEAST, MOST))
