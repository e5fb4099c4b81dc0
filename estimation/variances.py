"""Weights that nobody gave, from the data: the variances that make the fit's own residuals as large as they are said to be.

With r the rows of one family (the moments of one place's balance, or one output's differences) for standard deviation s, and l their leverage
(the share of each that the fit could choose freely, l = J C J'/s^2 with C the posterior covariance), the fixed point

    s^2 = sum r^2 s^2 / sum (1 - l)

is where the marginal likelihood is stationary (MacKay, Neural Computation 4, 1992). It is iterated from a loose start, a few
solves warm-started from each other. A simple rule for a start: it supposes that what is left over is white.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np

from backsight.ocp import Solution, Transcription
from backsight.ocp.nlp import Values

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

ROUNDS = 8
CLOSE = 0.1  # relative change of every standard deviation at which the iteration ends
LEAST_FREEDOM = 0.02  # of the rows, so that a variance cannot collapse onto a fit that explains everything
BOLDEST = 10.0  # largest factor of one round


@dataclass(frozen=True, kw_only=True)
class Choice:
    """The solution at the weights in force; force_std (n_soft,), and factors on the outputs' given or first standard deviations (ny,)."""

    solution: Solution
    force_std: Array
    output_factor: Array
    rounds: int
    settled: bool
    iterations: int


def choose_weights(
    solve: Callable[[Array, Values, bool], Solution],
    start: Array,
    values: Values,
    transcription: Transcription,
    places: Collection[int],
    outputs: Collection[str],
    say: Callable[[str], None],
) -> Choice:
    """Solve with the weights given; where places or outputs have none, iterate theirs.

    solve(decisions, values, to the full tolerance) -> Solution.
    """
    dae = transcription.dae
    open_forces = [i for i, k in enumerate(transcription.soft) if k in places]
    open_outputs = [i for i, q in enumerate(dae.outputs) if q.name in outputs]
    force_factor, output_factor = np.ones(len(transcription.soft)), np.ones(len(dae.outputs))
    iterations, rounds, settled = 0, 0, True
    if open_forces or open_outputs:
        settled = False
        for rounds in range(1, ROUNDS + 1):
            solution = solve(start, _weighted(values, transcription, force_factor, output_factor), False)
            start, iterations = solution.solved.decisions, iterations + solution.solved.iterations
            if not solution.solved.status.converged:
                break
            change = 0.0
            for indices, factor, term in ((open_forces, force_factor, _force_term(transcription)), (open_outputs, output_factor, "samples")):
                for i in indices:
                    ratio = _ratio(solution, term, i)
                    factor[i] *= ratio
                    change = max(change, abs(np.log(ratio)))
            say(f"weights from the data, round {rounds}: change {100 * np.expm1(change):.0f} %")
            if change < CLOSE:
                settled = True
                break
    solution = solve(start, _weighted(values, transcription, force_factor, output_factor), True)
    return Choice(
        solution=solution,
        force_std=transcription.force_std * force_factor,
        output_factor=output_factor,
        rounds=rounds,
        settled=settled,
        iterations=iterations + solution.solved.iterations,
    )


def _force_term(transcription: Transcription) -> str:
    return "balances" if transcription.method == "spline" else "residual forces"


def _weighted(values: Values, transcription: Transcription, force_factor: Array, output_factor: Array) -> Values:
    """The program's numbers with these standard deviations in place of the first ones."""
    factors = {_force_term(transcription): force_factor, "samples": output_factor}
    scale = tuple(
        s / factors[t.name][:, None] if t.name in factors else s for t, s in zip(transcription.nlp.terms, values.scale, strict=True)
    )
    return replace(values, scale=scale)


def _ratio(solution: Solution, term: str, i: int) -> float:
    """Factor by which the standard deviation of family i of a term should change."""
    number = solution.term(term)
    scale = solution.values.scale[number][i]
    there = scale > 0
    squares = float(np.sum(solution.rows[number][i][there] ** 2))
    freedom = float(np.sum(1.0 - (solution.leverage(number)[i] * scale**2)[there]))
    freedom = max(freedom, LEAST_FREEDOM * np.count_nonzero(there))
    return float(np.clip(np.sqrt(squares / freedom), 1 / BOLDEST, BOLDEST))
