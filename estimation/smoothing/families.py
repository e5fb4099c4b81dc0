"""The standard deviation of a family of rows, of which one factor is sought: the fixed point, and the steps towards it.

With r the rows of one family (the moments of one place's balance, or one output's differences) for standard deviation s, and l their
leverage (the share of each that the fit could choose freely, l = J C J'/s^2 with C the posterior covariance), the fixed point

    s^2 = sum r^2 s^2 / sum (1 - l)

is where the marginal likelihood is stationary (MacKay, Neural Computation 4, 1992).
"""

from __future__ import annotations

import numpy as np

from backsight.ocp import Solution

from .robust import row_squares

Mask = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]

UNTOLD = 0.1  # of a row: what a family always has of freedom and of squares, so that one that nothing tells about stays as it is
UNDECIDED = 0.3  # of the deviation of a log-likelihood's slope: a residual force's std that is nearer to its best cannot be told from it
BOLDEST = 4.0  # times the fixed point's own step, at most
NOTHING = 1.0  # sum of squares that a family costs when no one can tell it from none, and
CHOSEN = 0.05  # the share of its rows that the fit chooses then, at most
FARTHEST, FARTHEST_DOWN = 30.0, 8.0  # largest factors of one round, up and down


class Family:
    """The standard deviation of one family of rows, as log of its factor on the first one, sought by secant steps.

    columns: of the term that belong to it; None is all.
    """

    def __init__(self, term: str, row: int, lowest: float, columns: Mask | None = None, highest: float = np.inf) -> None:
        self.term, self.row, self.lowest, self.highest, self.columns, self.log = term, row, lowest, highest, columns, 0.0
        self._last: tuple[float, float] | None = None

    def step(self, solution: Solution) -> float:
        """Move towards ratio = 1; returns how far that may be: as far as it moved, or more where nobody knows yet how slow the way is."""
        ratio, settled = _ratio(solution, self.term, self.row, self.columns)
        if self.term != "samples" and settled:
            return 0.0
        wanted = float(np.log(ratio))
        move, known = wanted, False
        if self._last is not None and self.log != self._last[0]:
            slope = (wanted - self._last[1]) / (self.log - self._last[0])
            # a slope of -1 is the fixed point's own step; towards 0 it converges ever slower, and the secant is bolder
            known = slope < -1.0 / BOLDEST
            move = -wanted / slope if known else wanted * BOLDEST
        # downwards in smaller steps: where an equation holds as it stands, an ever smaller number only costs digits
        move = float(np.clip(move, -np.log(FARTHEST_DOWN), np.log(FARTHEST)))
        before, self._last = self.log, (self.log, wanted)
        self.log = max(min(self.log + move, self.highest), self.lowest)
        moved = abs(self.log - before)
        return moved if known or moved == 0 else max(moved, BOLDEST * abs(wanted))

    def halfway_to(self, log: float) -> float:
        """Move halfway to another one, and forget how it went; returns how far that is."""
        moved = (log - self.log) / 2
        self._last, self.log = None, self.log + moved
        return abs(moved)


def _ratio(solution: Solution, term: str, i: int, columns: Mask | None) -> tuple[float, bool]:
    """Factor by which the standard deviation of family i of a term should change, and whether no change would be felt.

    Rows that the fit cannot choose, and yet cost nothing, are those of an equation that holds as it stands. The slope of the log-likelihood
    in log s is  sum r^2 - sum (1 - l),  of variance 2 sum (1 - l): where it is small beside that, s is as good as any other nearby.
    """
    number = solution.term(term)
    families = len(solution.transcription.dae.outputs) if term == "samples" else len(solution.transcription.soft)
    scale = solution.values.scale[number][i::families]
    there = scale > 0 if columns is None else (scale > 0) & columns
    squares, freedom = (float(np.sum(rows[i::families][there])) for rows in row_squares(solution, number))
    count = np.count_nonzero(there)
    exact = bool(freedom > (1.0 - CHOSEN) * count and squares < NOTHING)
    # of a force, where the likelihood's slope cannot be told from none, another std would be no better
    undecided = term != "samples" and abs(squares - freedom) < UNDECIDED * np.sqrt(2.0 * max(freedom, 0.0))
    return float(np.sqrt((squares + UNTOLD) / (max(freedom, 0.0) + UNTOLD))), exact or undecided
