"""Several tests of one run, judged together."""

from __future__ import annotations

from collections.abc import Iterable


def largest_rejected(p: Iterable[float], level: float) -> float:
    """The largest p value that Holm's procedure rejects, -1 where it rejects none: what is no larger is rejected too.

    In ascending order p_1 .. p_m are rejected as long as

        p_k <= level/(m + 1 - k)

    Whatever the tests have to do with each other, a true hypothesis is rejected in no more than a share `level` of all runs
    (Holm, Scand. J. Statist. 6, 1979).
    """
    ordered, rejected = sorted(p), -1.0
    for k, value in enumerate(ordered):
        if not value <= level / (len(ordered) - k):
            break
        rejected = value
    return rejected
