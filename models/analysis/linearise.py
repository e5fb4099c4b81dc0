"""The model linearised at a working point, and its exact discretisation for held inputs.

Small changes about a point that fulfils F(x', x, z, u, p, w, t) = 0, y = h(x', x, z, u, p, w, t):

    x' = A x + B u + G w          [x'; z] = -[F_x'  F_z]^-1 (F_x x + F_u u + F_w w)
    y  = C x + D u + H w

by the implicit-function theorem, with exact derivatives.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ..dae import Dae, Place, Quantity
from ..errors import ModelError, SolveError, suggestion
from .operating_point import operating_point

Array = NDArray[np.float64]
EXACT_ZERO = 1e-12  # of the sum of magnitudes: a Markov parameter below that is cancellation


@dataclass(frozen=True, kw_only=True, eq=False)
class StateSpace:
    """x' = A x + B u + G w, y = C x + D u + H w; with a `step`, x(t + step) = A x + B u + G w for u and w held over the step.

    A (nx, nx), B (nx, nu), C (ny, nx), D (ny, nu), G (nx, nw), H (ny, nw), deviations from the working point in SI units;
    states, inputs, outputs and places name their columns. step [s], None for continuous time.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    G: Array
    H: Array
    states: tuple[Quantity, ...]
    inputs: tuple[Quantity, ...]
    outputs: tuple[Quantity, ...]
    places: tuple[Place, ...]
    step: float | None = None

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Eigenvalues of A, fastest last: [rad/s] in continuous time, per step in discrete time."""
        values = np.asarray(scipy.linalg.eigvals(scipy.linalg.matrix_balance(self.A, permute=False)[0]), dtype=np.complex128)
        return values[np.lexsort((values.imag, np.abs(values)))]

    def zoh(self, step: float) -> StateSpace:
        """The exact discretisation for inputs and residual forces held over `step` [s].

            | A_d  B_d  G_d |         / | A  B  G |      \\
            | 0    I        |  =  exp | | 0  0  0 | step |
            | 0         I   |         \\ | 0  0  0 |      /

        Raises ModelError for a step that is not positive, or a system that is discrete already.
        """
        if self.step is not None:
            raise ModelError(f"zoh({step!r}): the system is discrete already, with a step of {self.step:g} s; take the continuous one")
        if not (np.isfinite(step) and step > 0):
            raise ModelError(f"zoh({step!r}): a positive step [s] is needed")
        nx, nu = self.B.shape
        _, (scale, _) = scipy.linalg.matrix_balance(self.A, permute=False, separate=True)  # powers of two: no rounding
        width = nx + nu + self.G.shape[1]
        block = np.zeros((width, width))
        block[:nx] = np.hstack([self.A * scale, self.B, self.G]) / scale[:, None] * step
        out = scipy.linalg.expm(block)[:nx] * scale[:, None]
        return replace(self, A=out[:, :nx] / scale, B=out[:, nx : nx + nu], G=out[:, nx + nu :], step=float(step))

    def transfer_function(self, input: str, output: str) -> tuple[Array, Array]:
        """Numerator and denominator in s (or z, for a discrete system), highest power first, the denominator's first being 1.

        By the poles, the zeros and the first Markov parameter c A^(r-1) b that is not zero:

            num / den = c A^(r-1) b  prod(s - zero_i) / prod(s - pole_i)

        where the zeros are the eigenvalues of A - b c A^r / (c A^(r-1) b) on the null space of [c; c A; .. c A^(r-1)] (A. Isidori,
        Nonlinear Control Systems, section 4.3: the zero dynamics). Modes that the input does not drive or the output does not show are in
        both. `input` is an input or a place (its residual force). Raises ModelError for an unknown name.
        """
        b, d = self._column(input, output)
        names = [q.name for q in self.outputs]
        c = self.C[names.index(output)]
        A, (scale, _) = scipy.linalg.matrix_balance(self.A, permute=False, separate=True)
        b, c = b / scale, c * scale
        denominator = np.real(np.poly(self.poles)) if len(A) else np.ones(1)
        if d != 0.0:
            return d * np.real(np.poly(np.linalg.eigvals(A - np.outer(b, c) / d))) if len(A) else np.array([d]), denominator
        rows, sizes, first = [], np.abs(c), 0.0
        for _ in range(len(A)):
            rows.append(c / (np.linalg.norm(c) or 1.0))
            first, largest = float(c @ b), float(sizes @ np.abs(b))
            c, sizes = c @ A, sizes @ np.abs(A)
            if abs(first) > EXACT_ZERO * largest:
                break
        else:
            return np.zeros(1), denominator
        free = scipy.linalg.null_space(np.array(rows))
        zeros = np.linalg.eigvals(free.T @ (A - np.outer(b, c) / first) @ free)
        return first * np.atleast_1d(np.real(np.poly(zeros))), denominator

    def _column(self, input: str, output: str) -> tuple[Array, float]:
        inputs, places, outputs = ([q.name for q in kind] for kind in (self.inputs, self.places, self.outputs))
        if output not in outputs:
            raise ModelError(f"output = '{output}': the system has no such output; {suggestion(output, outputs)}")
        if input not in (*inputs, *places):
            raise ModelError(f"input = '{input}': the system has no such input or place; {suggestion(input, [*inputs, *places])}")
        row = outputs.index(output)
        if input in inputs:
            return self.B[:, inputs.index(input)], float(self.D[row, inputs.index(input)])
        return self.G[:, places.index(input)], float(self.H[row, places.index(input)])


def linearise(
    dae: Dae,
    x: Mapping[str, float] | None = None,
    u: Mapping[str, float] | None = None,
    parameters: Mapping[str, float] | None = None,
    t: float = 0.0,
    z: Mapping[str, float] | None = None,
) -> StateSpace:
    """The model linearised at the states x and inputs u, which need not be an equilibrium; one comes from `equilibrium`:

        point = equilibrium(dae, inputs={"F": 40.0});        linearise(dae, x=point.x, u=point.u, z=point.z)

    x           states; those left out are at their start values. At zero velocity a friction law sticks, at any other it slips
    u           inputs; those left out are zero
    parameters  values that replace the defaults; smoothing widths are 1e-5 of theirs unless given
    t           time [s], for a model that depends on it
    z           guesses of algebraic variables

    Where constraints between states remain (`dae.invariants`), A is that of the underlying differential equation, and the motions that the
    constraints forbid are among its poles. Raises ModelError for unknown names, SolveError where the equations are singular.
    """
    point = operating_point(dae, x, u, parameters, t, z)
    unknown = ca.vertcat(dae.dx, dae.z)
    moved = ca.vertcat(dae.x, dae.u, dae.w)
    parts = [ca.jacobian(e, by) for e in (dae.residual, dae.output) for by in (unknown, moved)]
    function = ca.Function(
        "slopes",
        [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.t],
        [ca.densify(dae.undisturbed(e)) for e in parts],
    )
    F_y, F_m, h_y, h_m = (np.asarray(value.full(), dtype=np.float64) for value in function(*point.columns()))
    try:
        slopes = -np.linalg.solve(F_y, F_m) + 0.0  # no negative zeros
    except np.linalg.LinAlgError:
        slopes = np.full_like(F_m, np.nan)
    if not np.all(np.isfinite(slopes)):
        raise SolveError(f"the equations of '{dae.name}' are singular at this point and do not give x' and z; choose another one")
    nx, nu = dae.x.shape[0], dae.u.shape[0]
    A, B, G = np.split(slopes[:nx], [nx, nx + nu], axis=1)
    C, D, H = np.split(h_m + h_y @ slopes, [nx, nx + nu], axis=1)
    return StateSpace(A=A, B=B, C=C, D=D, G=G, H=H, states=dae.states, inputs=dae.inputs, outputs=dae.outputs, places=dae.places)
