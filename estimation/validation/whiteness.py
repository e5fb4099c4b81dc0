"""Is a series white, is it normal, and how many independent values is it worth? For series with gaps: NaN is missing.

Expectations are for errors of mean zero, as prediction errors are: no mean is taken off, so an offset counts as structure.
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from .autocorrelation import products

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Index = np.ndarray[tuple[int, ...], np.dtype[np.int64]]

LEAST = 50  # values, below which nothing is tested
SINGLE = 8  # lags that stand for themselves; beyond them bands grow
GROWTH = 2.0**0.5  # of one band to the next
FEWEST, REACH = 10, 1.0 / 32.0  # longest lag: so many, or this share of the series; sums over longer bands are not normal any more
MEMORY = 5.0  # correlation times over which the autocorrelation is summed


def bands(longest: int) -> Index:
    """First lags of all bands, and one beyond the last."""
    edges = [*range(1, min(SINGLE, longest) + 1)]
    while edges[-1] < longest:
        edges.append(max(edges[-1] + 1, round(edges[-1] * GROWTH)))
    return np.minimum(np.array(edges, dtype=np.int64), longest + 1)


def longest_lag(n: int) -> int:
    """The longest lag that is looked at in a series of n."""
    return max(FEWEST, int(REACH * n))


def whiteness(e: Array, fitted: int = 0) -> float | None:
    """p-value of the hypothesis that e (n,) is white; None for fewer than 50 values or none that differ.

    Ljung and Box's sum with the lags beyond the eighth gathered in bands b, up to a 32nd of the series, so that a slow memory, a
    little in each of a thousand lags, is seen as well as a short one; of lags that have pairs:

        Q = (n + 2)/n sum_b (sum_(k in b) c_k)^2 / sum_(k in b) n_k,      c_k = sum_t e_t e_(t+k) / mean(e^2),   n_k pairs

    Of white noise the c_k are uncorrelated with variance n_k n/(n + 2) (Ljung & Box, Biometrika 65, 1978; without the mean, exact), so Q
    is chi-square with as many degrees of freedom as bands, less `fitted`: numbers chosen to make e white, which is what
    choosing weights does (Harvey, Forecasting, Structural Time Series Models and the Kalman Filter, section 5.4).
    """
    n = int(np.isfinite(e).sum())
    if n < LEAST:
        return None
    c, pairs = _products(e)
    if not c[0] > 0:
        return None
    edges = bands(longest_lag(c.size))
    sums, counts = (np.add.reduceat(x[: edges[-1]], edges[:-1]) for x in (c, pairs))
    q = (n + 2) / n * float(np.sum(sums**2 / counts))
    return float(stats.chi2.sf(q, max(len(counts) - fitted, 1)))


def effective_samples(e: Array) -> float:
    """How many independent values the mean of e is worth: n / (1 + 2 sum r_k), from 1 to n.

    The sum is over lags that have pairs, and ends at five times the correlation time found so far (Sokal, Functional Integration, 1997,
    section 3).
    """
    n = int(np.isfinite(e).sum())
    c, pairs = _products(e)
    if n < 2 or not c[0] > 0:
        return float(max(n, 1))
    tau = 1.0 + 2.0 * np.concatenate([[0.0], np.cumsum(c[1:] / pairs[1:])])
    lag = np.arange(tau.size)
    enough = np.flatnonzero((lag >= MEMORY * tau) & (lag > 0))
    time = float(tau[enough[0]]) if enough.size else float(np.max(tau))
    return max(n / max(time, 1.0), 1.0)


def _products(e: Array) -> tuple[Array, Array]:
    """c_k and pairs of the lags that have any: of a sensor slower than the rows they are its own."""
    c, pairs = products(e)
    return c[pairs > 0], pairs[pairs > 0]


def normality(e: Array) -> float | None:
    """p-value of the hypothesis that e is normal; None for fewer than 50 values or none that differ.

    D'Agostino and Pearson's K^2 (Biometrika 60, 1973) of skewness and kurtosis. What a memory adds to their variances, as if there were
    fewer values, is sum r_k^3 and sum r_k^4 over all k (Lomnicki, Metrika 4, 1961).
    """
    seen = e[np.isfinite(e)]
    if seen.size < LEAST or not np.ptp(seen) > 1e-12 * np.abs(seen).max():
        return None
    c, pairs = products(np.asarray(e - seen.mean()))
    r = c[1 : e.size // 4] / np.maximum(pairs[1 : e.size // 4], 1.0)
    # what chance leaves at each of very many lags is no memory
    r = np.where(np.abs(r) > 3.0 / np.sqrt(seen.size), r, 0.0)
    seen = seen / np.abs(seen).max()  # where a solve went astray their squares would overflow
    z3, z4 = float(stats.skewtest(seen).statistic), float(stats.kurtosistest(seen).statistic)
    k2 = z3**2 / max(1.0 + 2.0 * float(np.sum(r**3)), 1.0) + z4**2 / (1.0 + 2.0 * float(np.sum(r**4)))
    return float(stats.chi2.sf(k2, 2))
