"""The marginal likelihood of the weights: how probable they make what was measured, trajectories and parameters integrated out.

With theta the logarithms of standard deviations, r(X; theta) all scaled rows of the cost and H = J'J at the estimate X^, by Laplace,

    l(theta)  =  -1/2 r'r  +  sum over samples and priors of log scale  +  1/2 log det H_0  -  1/2 log det H  +  const

    dl/dtheta_f  =  r_f'r_f  -  sum (1 - lambda),          lambda the leverage of the rows f, tr(H^-1 J_f'J_f) in all
    AI_fg        =  2 (delta_fg r_f'r_f  -  (J_f'r_f)' H^-1 (J_g'r_g))

H_0 is what the balances alone add to H, with parameters and first states known, and makes a density of forces one of trajectories: it has
the inertia, at other weights the parameters are others, and the slopes of the laws. A rounded sign in which a body rests is steep by a
thousand times its damping: H and H_0 have it both, and l next to nothing.
AI is the average information of Gilmour, Thompson & Cullis (Biometrics 51, 1995): the mean of the observed and the expected one, in which
the traces that are dear to compute have cancelled. Both neglect how H and H_0 bend with a trajectory.

With the parameters they bend where white forces are large and little damps: g = d/dp (1/2 log det H_0 - 1/2 log det H), H without the
parameters, and l falls short by 1/2 g'Sigma g where X^ are the most probable parameters together with a trajectory. Where that is BENT or
more X^ is the trajectory at the parameters of most marginal likelihood (`smoothing/marginal.py`), about which Laplace's bell is one.

A parameter that lies on its bound is integrated out like the others, or l would jump by the logarithm of its deviation where one comes to
lie there: H has it held, and `edges.py` its integral.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from backsight.ocp import Solution
from backsight.ocp.marginal import log_density_of_forces

from ..smoothing.marginal import Moved, at, marginal
from ..smoothing.robust import row_squares
from .edges import Edges, edges
from .kkt import gauss_newton
from .turned import Mask, Turned

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
BY_ITSELF = ("samples", "initial state", "parameter prior", "further prior")  # terms whose rows are densities of what they are said of
BENT = 0.2  # nats, see above: a twentieth of what tells a force from none; solves at other parameters take their time
LEAST = 0.1  # degrees of freedom, of which squares say anything
Rows = list[tuple[int, Mask]]  # number of a term, which of its rows


def likelihood(turned: Turned, theta: Array, solution: Solution) -> Likelihood:
    """Of a solution with log factors theta (F,) on the standard deviations, at the parameters that the study compares."""
    n = solution.transcription.nlp.trajectory_size
    bounds = turned.program.lower[n:], turned.program.upper[n:]
    return Likelihood(solution, [turned.rows(f, theta) for f in range(len(theta))], bounds, turned.bent)


def summit(turned: Turned, solution: Solution) -> Moved:
    """A solution at the parameters of most marginal likelihood, or as near as steps led; as it is where it did not converge."""
    converged = solution.solved.status.converged
    return marginal(turned.program, solution, lambda _: None) if converged else Moved(solution=solution)


def bends(solution: Solution) -> bool:
    """Whether determinants bend so much with the parameters that the likelihood is another one."""
    there = at(solution)
    if not there.minimum:
        return False
    g = there.determinants
    return bool(0.5 * g @ there.covariance @ g > BENT)


@dataclass(frozen=True)
class Likelihood:
    """Of a solution, with the rows of every weight (F lists) and the bounds of its np free parameters, as decisions.

    bent: whether its parameters are those of most marginal likelihood.
    """

    solution: Solution
    rows: Sequence[Rows]
    bounds: tuple[Array, Array]
    bent: bool = False

    @cached_property
    def value(self) -> float:
        """l but for a constant of the mesh; NaN where the solution is no minimum."""
        s = self.solution
        if s.curvature is None:
            return float("nan")
        total = 0.0
        for number, term in enumerate(s.transcription.nlp.terms):
            scale, r = s.values.scale[number], s.rows[number]
            if term.name in BY_ITSELF:
                total += float(np.sum(np.log(scale[scale > 0])))
            if not term.equality:
                total -= 0.5 * float(np.sum(r**2))
        n = s.transcription.nlp.trajectory_size
        determinant = s.curvature.log_determinant
        try:
            density, left = log_density_of_forces(s), self._edges
        except np.linalg.LinAlgError:  # weights so small or large that nothing moves
            return float("nan")
        # of both matrices in the program's units, the first states and the parameters are in one of them only
        free = np.zeros(s.transcription.nlp.size, dtype=bool)
        free[s.transcription.starts], free[n:] = True, True
        free[s.held] = False
        return total + density - 0.5 * determinant + (left.value if left else 0.0) + float(np.sum(np.log(s.values.unit[free])))

    @cached_property
    def _edges(self) -> Edges | None:
        """What bounds leave of the integral over parameters; None where those on their bounds are held, and known."""
        there, on = at(self.solution), self.solution.parameters_on_bounds
        if not there.minimum or not np.all(np.isin(on, there.moving)):
            return None
        return edges(there, self.bounds, self.bent)

    @property
    def squares(self) -> Array:
        """r_f'r_f, (F,)."""
        return self._summed[0]

    @property
    def freedom(self) -> Array:
        """Sum of 1 - leverage over the rows of every weight, (F,)."""
        return self._summed[1]

    @property
    def counts(self) -> Array:
        """Rows of every weight, (F,)."""
        return np.array([sum(int(np.count_nonzero(of & (self.solution.values.scale[k] > 0))) for k, of in rows) for rows in self.rows])

    @property
    def ratio(self) -> Array:
        """Root of the squares over their freedom, (F,): 1 where a weight is right; NaN where its rows have none."""
        told = self.freedom > LEAST
        return np.asarray(np.sqrt(np.divide(self.squares, self.freedom, out=np.full(len(self.rows), np.nan), where=told)), dtype=np.float64)

    @property
    def slope(self) -> Array:
        """dl/dtheta, (F,)."""
        return self.squares - self.freedom + (self._edges.slope(self.rows, self.pulls) if self._edges else 0.0)

    @cached_property
    def information(self) -> Array:
        """AI, (F, F)."""
        return 2.0 * (np.diag(self.squares) - self.pulls.T @ gauss_newton(self.solution).solve(self.pulls))

    @cached_property
    def pulls(self) -> Array:
        """J_f'r_f in the program's units, (n + np, F): how the rows of a weight pull at the unknowns."""
        s = self.solution
        evaluated, X = s.transcription.nlp.evaluated, s.values.scaled(s.solved.decisions)
        parts = {k: evaluated.linearised(k, X, s.values) for rows in self.rows for k, _ in rows}
        out = np.zeros((s.transcription.nlp.size, len(self.rows)))
        for f, rows in enumerate(self.rows):
            masked = [type(parts[k])(k, np.where(of, parts[k].r, 0.0), parts[k].J) for k, of in rows]
            out[:, f] = evaluated.gradient(masked)
        return out

    @cached_property
    def _summed(self) -> tuple[Array, Array]:
        """Squares and freedom."""
        scale, of_terms = self.solution.values.scale, {k: row_squares(self.solution, k) for rows in self.rows for k, _ in rows}
        squares, freedom = (
            np.array([sum(float(np.sum(of_terms[k][part][of & (scale[k] > 0)])) for k, of in rows) for rows in self.rows])
            for part in (0, 1)
        )
        return squares, freedom
