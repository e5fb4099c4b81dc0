"""Which balances tell what no output shows, whatever the guesses of the parameters are.

The torque of a shaft is what a seen inertia cannot explain, the twist that torque over a stiffness, and the speed of the load follows from
the twist. Where every unseen state is told so, these balances need no better start.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import structural_rank

from ..problem import Problem
from .unseen import moving_unseen, unseen_states


def telling_places(problem: Problem) -> frozenset[int]:
    """Places whose balances together tell every unseen state, whatever the free parameters are; none where some stay untold.

    They are balances of what is seen, and a guess must not matter there but for the size of what is unseen: dF/dp = 0 for every free p
    where the unseen states are zero. With the equations that hold exactly they must determine all unseen states and algebraic variables:
    the pattern of these has full structural rank (an unseen state counts where its rate does; a telling balance is solved for it along
    the whole trajectory).
    """
    dae = problem.dae
    names = set(unseen_states(problem))
    unseen = [i for i, q in enumerate(dae.states) if q.name in names]
    if not unseen or not problem.free:
        return frozenset()
    hidden = ca.vertcat(*(s[i] for s in (dae.x, dae.dx) for i in unseen))
    guesses = ca.vertcat(*(dae.p[i] for i in problem.free))
    bent = ca.substitute(ca.jacobian(dae.residual, guesses), hidden, ca.SX.zeros(hidden.shape[0]))
    own = moving_unseen(problem)
    sure = [ca.simplify(ca.densify(bent[r, :])).is_zero() for r in range(bent.shape[0])]
    certain = [r for r, e in enumerate(dae.equations) if e.place is None or (e.place not in own and sure[r])]
    pattern = np.zeros((len(certain), len(unseen) + dae.z.shape[0]), dtype=bool)
    for row, r in enumerate(certain):
        for symbols in (dae.x, dae.dx):
            columns = set(ca.jacobian_sparsity(dae.residual[r], symbols).get_col())
            pattern[row, : len(unseen)] |= np.isin(unseen, list(columns))
        pattern[row, len(unseen) + np.array(ca.jacobian_sparsity(dae.residual[r], dae.z).get_col(), dtype=np.int64)] = True
    if structural_rank(csr_matrix(pattern)) < pattern.shape[1]:
        return frozenset()
    return frozenset(int(place) for r in certain if (place := dae.equations[r].place) is not None)
