"""Room for residual forces near rest, stage by stage: what `smoothing/rest.py` says of a whole horizon, for a window.

A velocity is near zero in a stage where it changes its sign, falls below its own change or below NEAR widths of the rounded sign; and from
there on as long as it cannot be told from zero. There the balances that the law enters get as much room as the law is strong, or ROOM
times their own where that is more: evidences are not compared here, and one step a sample arrives across a reversal only in much room.

A reading that sees the law's force at once, as an accelerometer does, sees it at an instant. What the rounded sign makes of that force
within the stage is the rounding's, not the machine's, and the reading may be wrong by it: taken at its word it would tell within a hair
where in the sign the body is, and no Gauss-Newton step follows that.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from backsight.ocp.called import Called
from backsight.ocp.moving.native import native
from backsight.ocp.moving.stage import Stage
from backsight.ocp.moving.window import Window

from ..smoothing.rest import DOUBT, NEAR, SHARP, TINY, FrictionLaw

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

LOOKED_AT = (0.0, 0.5, 1.0)  # places of a stage
ROOM = 50.0  # factor on the standard deviation of a residual force near rest, at least


class Room:
    """The deviations of the residual forces and samples in the stages of a window; away from rest std (n_soft,) [unit * sqrt(s)] and
    noise (ny,)."""

    def __init__(self, stage: Stage, laws: tuple[FrictionLaw, ...], std: Array, noise: Array, length: int, *, jit: bool = False) -> None:
        self.std, self.noise, self.laws, self.length = std, noise, laws, length
        self.doubt = np.zeros((len(laws), 0))  # DOUBT deviations of the velocities, by stages, from when each was the newest
        self._widths = stage.fixed[[law.width for law in laws]]
        self._marks = np.zeros((len(laws), len(std), 1))  # a law of no strength for now is marked all the same
        for mark, law in zip(self._marks, laws, strict=True):
            mark[[stage.soft.index(k) for k in law.places if k in stage.soft]] = TINY
        if not laws:
            return
        dae, count = stage.dae, len(laws)
        velocities = ca.vertcat(*(dae.variables[law.velocity] for law in laws))
        strengths = ca.vertcat(*(_strength(stage, law, width) for law, width in zip(laws, self._widths, strict=True)))
        seen = stage.sampled("seen", ca.vertcat(velocities, strengths), LOOKED_AT)
        y, p_ref, d = (ca.SX.sym(n, seen.size1_in(i)) for i, n in enumerate(("y", "p_ref", "d")))
        values = seen(y, p_ref, d)
        v, f = values[:count, :], values[count:, :]
        slope = ca.jacobian(v[:, -1], y)[:, stage.interpolation.states + stage.interpolation.interior :]
        function = ca.Function("near", [y, p_ref, d], [ca.densify(v), ca.densify(f), ca.densify(slope)], {"cse": True})
        function = native([function])[0][0] if jit else function
        self._near, self._nears = Called(function), Called(function.map(length))

    def given(self, window: Window) -> None:
        """Write the scales of forces and samples into the window's stages, for the trajectory in force."""
        k = window.count
        if not self.laws or not k:
            return
        v, f, slope = self._seen(window)
        half, unknown = window.spread()
        std = np.sqrt(np.sum((slope @ half) ** 2, axis=1))
        std[(np.abs(slope[:, unknown]) > 0).any(axis=1)] = np.inf
        self.doubt = np.column_stack([self.doubt, np.tile(DOUBT * std[:, None], window.passed)])[:, -k:]
        doubt = np.full((len(self.laws), k), np.inf)
        doubt[:, k - self.doubt.shape[1] :] = self.doubt
        ns, h = len(self.std), window.d[0]
        room = np.zeros((f.shape[1], k))
        for law in range(len(self.laws)):
            high, low = v[law].max(axis=0), v[law].min(axis=0)
            change, least = high - low, np.where(np.sign(high) != np.sign(low), 0.0, np.minimum(np.abs(high), np.abs(low)))
            slow = least <= NEAR * self._widths[law]
            near = (least <= change) | _spread(slow, slow | (least <= doubt[law]))
            room[:ns] += np.where(near, np.maximum(np.abs(f[law, :ns]).max(axis=1), self._marks[law]), 0.0)
            room[ns:] += np.ptp(f[law, ns:], axis=1)
        forces, rows = room[:ns] * np.sqrt(h), window.d[-len(room) :]
        forces = np.where(forces > 0, np.maximum(ROOM * self.std[:, None], forces), self.std[:, None])
        rows[:] = np.where(rows > 0, 1.0 / np.concatenate([forces, np.hypot(self.noise[:, None], room[ns:])]), 0.0)

    def _seen(self, window: Window) -> tuple[Array, Array, Array]:
        """Velocities (laws, 3, k), what `_strength` tells of, (laws, n_soft + ny, 3, k), and the newest velocities' slopes in [x; p]."""
        y, p, k, count = window.here.stages, window.here.p, window.count, len(self.laws)
        if k == self.length:
            v, f, slope = self._nears(y, window.here.parameters, window.d)
        else:
            parts = [[a.copy() for a in self._near(y[:, j], p, window.d[:, j])] for j in range(k)]
            v, f, slope = (np.hstack(column) for column in zip(*parts, strict=True))
        n = slope.shape[1] // k
        return v.reshape(count, k, 3).swapaxes(1, 2), f.reshape(count, -1, k, 3).swapaxes(2, 3), slope[:, (k - 1) * n :]


def _spread(slow: NDArray[np.bool_], doubtful: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """All of the doubtful stages in a row (k,) among which one is slow."""
    run = np.cumsum(~doubtful)
    reached = np.zeros(len(run) + 1, dtype=bool)
    reached[run[slow]] = True
    return np.asarray(doubtful & reached[run])


def _strength(stage: Stage, law: FrictionLaw, width: float) -> Any:
    """What the soft balances lose when the law's sign is rounded away, (n_soft,), and what the outputs see at once of the law, (ny,)."""
    dae = stage.dae
    F, symbol = dae.undisturbed(dae.residual[dae.rows_of(stage.soft)]), dae.p[law.width]
    # the width is a hundredth of the velocity's rms, or as the user has it
    sharp, rounded, none = (ca.substitute(F, symbol, w) for w in (SHARP * width, width, width / SHARP))
    return ca.vertcat(sharp - none, stage.direct @ (rounded - none))
