"""Times that estimates took, counted in classes of equal ratio: quantiles of any number of them in constant memory."""

from __future__ import annotations

import numpy as np

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

SHORTEST, LONGEST = 1e-6, 1e3  # s, of the classes
RATIO = 1.01  # from class to class


class Latency:
    """Counts (m,) of the classes, and the longest time [s]."""

    def __init__(self) -> None:
        self.counts = np.zeros(int(np.ceil(np.log(LONGEST / SHORTEST) / np.log(RATIO))), dtype=np.int64)
        self.longest = 0.0

    def add(self, seconds: float) -> None:
        """One time more."""
        place = int(np.log(max(seconds, SHORTEST) / SHORTEST) / np.log(RATIO))
        self.counts[min(place, len(self.counts) - 1)] += 1
        self.longest = max(self.longest, seconds)

    def quantile(self, share: float) -> float:
        """Seconds that this share of the times did not exceed, to a hundredth of it; NaN before the first."""
        total = int(self.counts.sum())
        if not total:
            return float("nan")
        place = int(np.searchsorted(np.cumsum(self.counts), share * total))
        return float(min(SHORTEST * RATIO ** (place + 1), self.longest))

    def milliseconds(self) -> dict[str, float]:
        """median, p95, p99 and max."""
        shares = {"median": 0.5, "p95": 0.95, "p99": 0.99}
        return {name: 1e3 * self.quantile(share) for name, share in shares.items()} | {"max": 1e3 * self.longest}
