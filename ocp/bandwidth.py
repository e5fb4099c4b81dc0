"""How fast a smoother's answer can move, which is how fine its mesh must be.

The smoother of a linear model  x' = A x + G w,  y = C x + v  with white w of density Q and samples of std r every dt has the modes of

    | A            G Q G' |
    | C' R^-1 C    -A'    |,          R = r^2 dt,

half of them stable and half of them not (Bryson & Ho, Applied Optimal Control, section 13.3). Without noise in the model (Q = 0) they are those of A.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from backsight.models import Dae

from .polynomials import Array


def fastest_rate(
    dae: Dae, dx: Array, x: Array, z: Array, u: Array, parameters: Array, force_std: Mapping[int, float], sample_density: Array
) -> float:
    """Median over M places of the largest mode [rad/s], of the model linearised there.

    dx, x (nx, M), z (nz, M), u (nu, M): where; force_std: place -> std of its white residual force; sample_density (ny,): r^2 dt of every
    output, inf when it is not sampled. Returns 0 where nothing moves, or the model does not determine x'.
    """
    soft = sorted(force_std)
    unknown = ca.vertcat(dae.dx, dae.z)
    parts = [ca.jacobian(dae.residual, unknown), ca.jacobian(dae.residual, dae.x), ca.jacobian(dae.residual, dae.w)[:, soft]]
    parts += [ca.jacobian(dae.output, dae.x), ca.jacobian(dae.output, unknown)]
    w = ca.SX.zeros(dae.w.shape[0])
    arguments = [dae.dx, dae.x, dae.z, dae.u, dae.p]
    function = ca.Function("linear", arguments, [ca.densify(ca.substitute(ca.substitute(e, dae.w, w), dae.t, 0)) for e in parts])
    nx, Q = dae.x.shape[0], np.diag([force_std[k] ** 2 for k in soft])
    rates = []
    for k in range(x.shape[1]):
        E, F_x, F_w, H_x, H_e = (np.asarray(m, dtype=np.float64) for m in function(dx[:, k], x[:, k], z[:, k], u[:, k], parameters))
        try:
            inverse = np.linalg.inv(E)
        except np.linalg.LinAlgError:
            continue
        slope = -inverse @ F_x
        A, G, C = slope[:nx], -(inverse @ F_w)[:nx], H_x + H_e @ slope
        information = C.T @ np.diag(1.0 / sample_density) @ C
        hamiltonian = np.block([[A, G @ Q @ G.T], [information, -A.T]])
        if np.all(np.isfinite(hamiltonian)):
            rates.append(float(np.max(np.abs(np.linalg.eigvals(_balanced(hamiltonian, nx))))))
    return float(np.median(rates)) if rates else 0.0


def _balanced(hamiltonian: Array, nx: int) -> Array:
    """The same modes with the two halves of comparable size: noise densities span many decades."""
    upper, lower = np.abs(hamiltonian[:nx, nx:]).max(initial=0.0), np.abs(hamiltonian[nx:, :nx]).max(initial=0.0)
    if upper == 0.0 or lower == 0.0:
        return hamiltonian
    scale = np.ones(2 * nx)
    scale[nx:] = np.sqrt(lower / upper)
    return np.asarray(hamiltonian / scale[:, None] * scale[None, :], dtype=np.float64)
