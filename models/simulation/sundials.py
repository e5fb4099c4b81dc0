"""The integrators of SUNDIALS, through CasADi (A. C. Hindmarsh et al., ACM Trans. Math. Softw. 31, 2005), to compare with `radau`.

    idas     F(x', x, z, u, t) = 0 as   x' = r,   0 = F(r, x, z, u, t):   variable-order BDF for index-1 equations
    cvodes   x' = f(x, u, t), for models without algebraic variables whose rates occur linearly: variable-order BDF

Both start again, at order one, at every sample where an input jumps. They know no events: laws keep their rounded corners.
"""

from __future__ import annotations

from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ..dae import Dae
from ..errors import ModelError, SolveError

Array = NDArray[np.float64]
_STEPS = 1_000_000


def integrate(
    method: Literal["idas", "cvodes"],
    dae: Dae,
    residual: Any,
    start: tuple[Array, Array, Array],
    times: Array,
    u: Array,
    slopes: Array,
    rtol: float,
) -> tuple[Array, Array]:
    """States (nx, n) and algebraics (nz, n) at the sample times, from consistent x, x' and z.

    residual  F with numbers for the parameters;  u (nu, n), slopes (nu, n - 1) the inputs and how they go on
    rtol      relative tolerance; the absolute one is 0.1 rtol times the nominal size

    Raises ModelError for a model that the method cannot take, SolveError where it stops.
    """
    x, rate, z = start
    if len(times) == 1 or not len(x):
        return np.tile(x[:, None], len(times)), np.tile(z[:, None], len(times))
    base, slope = ca.SX.sym("base", dae.u.shape[0]), ca.SX.sym("slope", dae.u.shape[0])
    now, length, part = ca.SX.sym("now"), ca.SX.sym("length"), ca.SX.sym("part")  # time is now + length part, 0 <= part <= 1
    held = ca.substitute(residual, ca.vertcat(dae.u, dae.t), ca.vertcat(base + slope * length * part, now + length * part))
    controls = ca.vertcat(base, slope, now, length)
    table = np.vstack([u[:, :-1], slopes, times[None, :-1], np.diff(times)[None]])
    absolute = [0.1 * rtol * q.nominal for q in dae.states]
    options: dict[str, Any] = {"reltol": rtol, "abstol": min(absolute), "max_num_steps": _STEPS, "show_eval_warnings": False}
    equations: dict[str, Any]
    if method == "cvodes":
        equations, unknown = _explicit(dae, held, controls, part), np.zeros(0)
    else:
        equations = {"x": dae.x, "z": ca.vertcat(dae.dx, dae.z), "p": controls, "t": part, "ode": length * dae.dx, "alg": held}
        unknown = np.concatenate([rate, z])
        options |= {"calc_ic": True, "suppress_algebraic": True, "abstolv": [*absolute, *([rtol] * len(unknown))]}
    try:
        run = ca.integrator("run", method, equations, 0.0, 1.0, options)
        y, c = ca.MX.sym("y", len(x) + len(unknown)), ca.MX.sym("c", controls.shape[0])
        end = run(x0=y[: len(x)], z0=y[len(x) :], p=c)
        sample = ca.Function("sample", [y, c], [ca.vertcat(end["xf"], end["zf"])])
        found = sample.mapaccum(table.shape[1])(np.concatenate([x, unknown]), table).full()
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        raise SolveError(f"{method} stopped on '{dae.name}': {reason}; use integrator='radau', or another rtol") from error
    algebraics = found[len(x) + len(rate) :] if method == "idas" else found[:0]
    return np.hstack([x[:, None], found[: len(x)]]), np.hstack([z[:, None], algebraics])


def _explicit(dae: Dae, residual: Any, controls: Any, part: Any) -> dict[str, Any]:
    """x' = -M^-1 F(0, x, ..), for F = M x' + F(0, x, ..)."""
    if dae.z.shape[0] or not ca.is_linear(residual, dae.dx):
        what = f"{dae.z.shape[0]} algebraic variables" if dae.z.shape[0] else "rates that occur nonlinearly"
        raise ModelError(f"integrator='cvodes': model '{dae.name}' has {what}; cvodes takes x' = f(x, u, t) only, use 'radau' or 'idas'")
    known = [dae.x, controls, part]
    pair = ca.Function(
        "pair", known, [ca.densify(ca.jacobian(residual, dae.dx)), ca.densify(ca.substitute(residual, dae.dx, ca.SX.zeros(dae.x.shape[0])))]
    )
    x, c, t = (ca.MX.sym(name, symbol.shape[0]) for name, symbol in zip("xct", known, strict=True))
    mass, force = pair(x, c, t)
    return {"x": x, "p": c, "t": t, "ode": -c[-1] * ca.solve(mass, force, "qr")}
