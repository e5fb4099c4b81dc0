"""A plant as an affine difference equation about a working point, exact for held inputs where the plant is affine.

    x' = f + A (x - x*) + B (u - u*) + G w          f = x' at the working point, which need not be an equilibrium
    y  = g + C (x - x*) + D (u - u*) + v

With the state x - x* and the held drive [u - u*; 1] the step h is the matrix exponential of `StateSpace.zoh`; white residual forces w of
spectral density W^2 add over it the covariance (C. F. Van Loan, IEEE Trans. Automatic Control 23, 1978)

    Q = int_0^h e^(A s) G W^2 G' e^(A' s) ds
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from backsight.models import Dae
from backsight.models.analysis import OperatingPoint, linearise, operating_point

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@dataclass(frozen=True, kw_only=True, eq=False)
class AffineStep:
    """x(k+1) = F x(k) + E [u(k) - u*; 1] + noise of covariance Q;   y(k) = C x(k) + D [u(k) - u*; 1];   x is x - x*.

    F (nx, nx), E (nx, nu + 1), C (ny, nx), D (ny, nu + 1) with g in its last column, at (nx,) and input (nu,) the point;
    unit_noise (nw, nx, nx): Q of a force of density one at each place alone.
    """

    F: Array
    E: Array
    C: Array
    D: Array
    unit_noise: Array
    at: Array
    input: Array

    def noise(self, density: Array) -> Array:
        """Q of residual forces of the densities `density` (nw,)."""
        return np.asarray(np.einsum("w,wij->ij", density**2, self.unit_noise))


def affine(dae: Dae, point: OperatingPoint, parameters: Mapping[str, float], step: float, outputs: Sequence[int]) -> AffineStep:
    """The plant about the states and inputs of `point`, its rates following from the parameters.

    outputs: indices of those that are measured. Raises SolveError where x' cannot be told.
    """
    here = operating_point(dae, point.x, point.u, parameters, point.t, point.z)
    linear = linearise(dae, point.x, point.u, parameters, point.t, point.z)
    rate = np.array(list(here.dx.values()))
    dx, x, z, u, p, t = here.columns()
    output = dae.function()(dx, x, z, u, p, np.zeros(dae.w.shape[0]), t)[1].full()[:, 0]
    discrete = replace(linear, B=np.column_stack([linear.B, rate]), D=np.column_stack([linear.D, output])).zoh(step)
    return AffineStep(
        F=discrete.A,
        E=discrete.B,
        C=discrete.C[list(outputs)],
        D=discrete.D[list(outputs)],
        unit_noise=np.array([_process_noise(linear.A, g, step) for g in linear.G.T]).reshape(-1, len(x), len(x)),
        at=np.array(x),
        input=np.array(u),
    )


def _process_noise(A: Array, g: Array, step: float) -> Array:
    """Q (nx, nx) of a force that enters by g (nx,), by doubling: Q(2 h) = Q(h) + e^(A h) Q(h) e^(A' h).

    The exponential of a stiff system over the whole step would lose Q's digits, one over a short piece does not.
    """
    n = len(A)
    doublings = max(0, int(np.ceil(np.log2(max(float(np.abs(A).sum(axis=1).max(initial=0.0)) * step, 1e-12)))))
    piece = step / 2.0**doublings
    W = np.outer(g, g)
    block = scipy.linalg.expm(np.block([[-A, W], [np.zeros((n, n)), A.T]]) * piece)
    F = block[n:, n:].T
    Q = F @ block[:n, n:]
    for _ in range(doublings):
        Q, F = Q + F @ Q @ F.T, F @ F
    return np.asarray((Q + Q.T) / 2, dtype=np.float64)
