"""Whether parameters of a fit are worth having, without a fit that does without them.

A model in which some parameters theta_S have certain values is inside the one in which they are free, and the ratio of their evidences is
that of the densities of these parameters there, after the samples and before. With theta^, covariance C and n samples

    log Z(theta_S = v) / Z = |S|/2 log n - (v - theta^_S)' C_SS^-1 (v - theta^_S) / 2,          theta_S ~ N(theta^_S, n C_SS) beforehand

(J. M. Dickey, Ann. Math. Statist. 42, 1971, with the unit information of `refit.evidence`).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...results import Smoothing

ROUNDING = 1e-12  # of two variances: what is left of their difference where the two go together


def more_probable_at(result: Smoothing, values: Mapping[str, float]) -> float:
    """By how much the evidence is larger with parameters at these values than with them free [nats]. They have deviations in the result.

    -inf where two of them are one number to the last digit.
    """
    if result.criteria is None:
        raise ValueError("a result without criteria has no evidence to compare")
    names = list(values)
    d = np.array([values[n] - result.parameters[n].value for n in names])
    try:
        squares = float(d @ np.linalg.solve(result.covariance(names), d))
    except np.linalg.LinAlgError:
        return -np.inf
    return 0.5 * len(names) * float(np.log(result.criteria.samples)) - 0.5 * squares


def more_probable_alike(result: Smoothing, one: str, other: str) -> float:
    """The same of two parameters that are one number, whatever it is, than of two."""
    if result.criteria is None:
        raise ValueError("a result without criteria has no evidence to compare")
    a, b = (result.parameters[n] for n in (one, other))
    C = result.covariance([one, other])
    variance = float(max(C[0, 0] + C[1, 1] - 2.0 * C[0, 1], ROUNDING * (C[0, 0] + C[1, 1])))
    return 0.5 * float(np.log(result.criteria.samples)) - 0.5 * (a.value - b.value) ** 2 / variance
