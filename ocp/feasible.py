"""A start on the constraints, where they are linear.

Followed samples hardly meet them: a twist's rate is not quite the difference of the speeds at its ends. A filter line search takes any step
that leads onto the constraints, however dear; beside stiff balances with friction that is far from the start, and hundreds of steps do not
lead back. On the constraints it has to pay from the first step on. Of the points there the start is the one that is nearest,

    min |X|^2   s.t.  c + J X = 0            X = -J' (J J')^-1 c

in the units of the program, in which one is about one deviation.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from .nlp import Nlp, Values
from .polynomials import Array

RIDGE = 1e-12  # of the diagonal of J J': constraints that repeat each other leave it singular


def start_on_constraints(nlp: Nlp, values: Values, lower: Array, upper: Array) -> Array:
    """X (n + np,) nearest to zero that satisfies the constraints; zero where there is none, or one that is not linear.

    lower, upper (n + np,): bounds of X. What they fix stays, and so do the parameters.
    """
    X = np.zeros(nlp.size)
    if not nlp.constraint_count or not nlp.evaluated.linear_constraints:
        return X
    evaluated = nlp.evaluated
    parts = [evaluated.linearised(number, X, values) for number, term in enumerate(nlp.terms) if term.equality]
    c = np.concatenate([part.r.ravel(order="F") for part in parts])
    movable = np.flatnonzero((lower < upper)[: nlp.trajectory_size])
    J = sp.csc_matrix(evaluated.jacobian(parts)[:, movable])
    square = J @ J.T
    X[movable] = -(J.T @ splu(sp.csc_matrix(square + RIDGE * sp.diags(square.diagonal()))).solve(c))
    return np.asarray(np.clip(X, lower, upper)) if np.all(np.isfinite(X)) else np.zeros(nlp.size)
