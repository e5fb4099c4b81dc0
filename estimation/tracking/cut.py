"""Of a Gaussian margin that falls or rises over an interval, the part that ends, and the part that does not.

The margin at the end of the interval is N(margin - fall, std^2 + noise^2), its noise another one in every interval. It ends where it is
negative then, and was not negative before. Of what was negative before, a share std^2/(std^2 + noise^2) is the same now: all of it without
noise, nothing where all is noise. So in standard deviations from the mean

    b = (fall - margin) / sqrt(std^2 + noise^2),    Phi(a) = std^2/(std^2 + noise^2) Phi(-margin / sqrt(std^2 + noise^2))

what ends lies between a and b, also of a margin that rises if there is noise; of what still lasted, all above a, that is
[Phi(b) - Phi(a)] / Phi(-a). `fall` counts a step of `jump` at the very beginning, as an input makes it that also holds the body. The
moments are those of a truncated Gaussian and of what it leaves (N. L. Johnson, S. Kotz & N. Balakrishnan, Continuous Univariate
Distributions 1, 1994, section 13.10.1).
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr, ndtri

LEAST = 1e-6  # std over the fall at least, and share of an interval
SMALLEST = 1e-200  # a probability below which nothing more is computed
REST = 1e-9  # of all that must remain for its moments to be computed


class Cut:
    """mass: probability that a margin ends that lasted until now.

    share: of the interval, after which it ends on the average; left: the margin there on the average, zero unless the step ended it.
    """

    def __init__(self, *, margin: float, fall: float, std: float, noise: float, jump: float = 0.0) -> None:
        self._std = max(std, LEAST * abs(fall), SMALLEST)
        self._whole = float(np.hypot(self._std, noise))
        a, b = -margin / self._whole, (fall - margin) / self._whole
        if noise:
            a = float(ndtri((self._std / self._whole) ** 2 * ndtr(a)))
        self._part = max(0.0, float(ndtr(b) - ndtr(a)) if a < 0 else float(ndtr(-a) - ndtr(-b)))
        lasted = float(ndtr(-a))
        if self._part < SMALLEST:  # so far off that it has ended for certain, or will not
            self._part, self._mean, self._square = 0.0, 0.0, 1.0
            self.mass, self.share, self.left = float(lasted < SMALLEST and fall > 0), LEAST, 0.0
            return
        at_a, at_b = (float(np.exp(-(e**2) / 2) / np.sqrt(2 * np.pi)) for e in (a, b))
        self.mass = self._part / lasted
        self._mean = (at_a - at_b) / self._part  # of those that end, as their mean square: from `margin`, over the deviation of all
        self._square = 1.0 + ((a * at_a if np.isfinite(a) else 0.0) - b * at_b) / self._part
        before = margin + self._whole * self._mean - jump
        self.share = float(np.clip(before / (fall - jump), LEAST, 1.0)) if fall > jump else LEAST if jump > 0 else 0.5
        self.left = min(before, 0.0) if jump > 0 else 0.0

    def ends(self, move: float) -> tuple[float, float]:
        """How far the mean of the margin without its noise moves for those that end, if with it it moves by `move`; ratio of deviations."""
        return self._without(move, self._square - self._mean**2)

    def rest(self) -> tuple[float, float]:
        """The same for those that do not end."""
        left = max(1.0 - self._part, REST)
        mean = -self._mean * self._part / left
        return self._without(self._whole * mean, (1.0 - self._part * self._square) / left - mean**2)

    def _without(self, move: float, variance: float) -> tuple[float, float]:
        """Of the margin without noise, when the sum with it moves and has `variance` of what it had: by regression on the sum."""
        gain = (self._std / self._whole) ** 2
        return gain * move, float(np.sqrt(max(1.0 - gain * (1.0 - variance), 0.0)))
