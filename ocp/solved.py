"""What is asked of a solve, and what comes of it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from .polynomials import Array


class Status(Enum):
    """How a solve ended; the value is the sentence to show."""

    SOLVED = "Solved to the tolerance asked for."
    ACCEPTABLE = "Solved; the last digits are rounding."
    ITERATIONS = "Stopped at the limit of iterations before convergence."
    INFEASIBLE = "No point was found that satisfies the constraints."
    NUMERICS = "Stopped by numerical trouble: the functions gave values that are not finite, or steps became too small."
    INTERRUPTED = "Interrupted by the user."

    @property
    def converged(self) -> bool:
        """Whether the result can be used."""
        return self in (Status.SOLVED, Status.ACCEPTABLE)


@dataclass(frozen=True, kw_only=True)
class Solved:
    """Decisions in the units of the model, cost, multipliers (of the scaled program) and how the solver fared.

    on_bound: decisions that ended on one of their bounds, within a thousandth of their unit. by_steps: whether plain steps alone found it.
    """

    decisions: Array
    cost: float
    multipliers: Array
    status: Status
    iterations: int
    seconds: float
    on_bound: tuple[int, ...] = ()
    by_steps: bool = False


@dataclass(frozen=True, kw_only=True)
class Options:
    """Limits of a solve.

    tolerance: on the optimality conditions of the scaled program, in which a step of one is about one deviation: 1e-6 leaves the
    estimate within 1e-6 of its own deviation. gauss_newton_iterations, max_iterations: of the first and the second stage.
    drift: relative change of a parameter that the terms refer to beyond which a solve goes on from where it
    arrived, max_passes times at most. seconds: of plain steps, and of one call of Ipopt, which then end as at a limit of iterations.
    hopeless: cost above which the second stage does not follow a first one that has not arrived.
    """

    tolerance: float = 1e-6
    gauss_newton_iterations: int = 40
    max_iterations: int = 300
    drift: float = 0.02
    max_passes: int = 6
    seconds: float = 1e20
    hopeless: float = np.inf
