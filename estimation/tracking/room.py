"""Room for residual forces near rest, stage by stage: what `smoothing/rest.py` says of a whole horizon, for a window.

A velocity is near zero in a stage where it changes its sign, falls below its own change or below NEAR widths of the rounded sign; and from
there on as long as it cannot be told from zero. There the balances that the law enters get as much room as the law is strong.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from scipy.ndimage import binary_propagation

from backsight.models import Dae
from backsight.ocp.moving.called import Called
from backsight.ocp.moving.stage import Stage
from backsight.ocp.moving.window import Window

from ..smoothing.rest import DOUBT, NEAR, ROOM, SHARP, TINY, FrictionLaw

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

LOOKED_AT = (0.0, 0.5, 1.0)  # places of a stage


class Room:
    """The deviations of the residual forces in the stages of a window; std (n_soft,): away from rest [unit * sqrt(s)]."""

    def __init__(self, stage: Stage, laws: tuple[FrictionLaw, ...], std: Array, length: int) -> None:
        self.std, self.laws, self.length = std, laws, length
        self.doubt = np.zeros((len(laws), 0))  # DOUBT deviations of the velocities, by stages, from when each was the newest
        self._entered = [[stage.soft.index(k) for k in law.places if k in stage.soft] for law in laws]
        self._widths = stage.fixed[[law.width for law in laws]]
        if not laws:
            return
        dae, count = stage.dae, len(laws)
        velocities = ca.vertcat(*(dae.variables[law.velocity] for law in laws))
        strengths = ca.vertcat(*(_strength(dae, stage.soft, law, width) for law, width in zip(laws, self._widths, strict=True)))
        seen = stage.sampled("seen", ca.vertcat(velocities, strengths), LOOKED_AT)
        y, p_ref, d = (ca.SX.sym(n, seen.size1_in(i)) for i, n in enumerate(("y", "p_ref", "d")))
        values = seen(y, p_ref, d)
        v, f = values[:count, :], values[count:, :]
        slope = ca.jacobian(v[:, -1], y)[:, stage.interpolation.states + stage.interpolation.interior :]
        function = ca.Function("near", [y, p_ref, d], [ca.densify(v), ca.densify(f), ca.densify(slope)], {"cse": True})
        self._near, self._nears = Called(function), Called(function.map(length))

    def given(self, window: Window) -> None:
        """Write the forces' scales into the window's stages, for the trajectory in force."""
        k = window.count
        if not self.laws or not k:
            return
        v, f, slope = self._seen(window)
        half, unknown = window.spread()
        std = np.sqrt(np.sum((slope @ half) ** 2, axis=1))
        std[(np.abs(slope[:, unknown]) > 0).any(axis=1)] = np.inf
        self.doubt = np.column_stack([self.doubt, DOUBT * std])[:, -k:]
        doubt = np.full((len(self.laws), k), np.inf)
        doubt[:, k - self.doubt.shape[1] :] = self.doubt
        h, rows = window.d[0], self._rows(window)
        room = np.zeros((len(self.std), k))
        for law, entered in enumerate(self._entered):
            change = v[law].max(axis=0) - v[law].min(axis=0)
            least = np.where(np.sign(v[law].max(axis=0)) != np.sign(v[law].min(axis=0)), 0.0, np.abs(v[law]).min(axis=0))
            slow = least <= NEAR * self._widths[law]
            near = (least <= change) | binary_propagation(slow, mask=slow | (least <= doubt[law]))
            for i in entered:
                strength = np.abs(f[law, i]).max(axis=0)
                room[i] += np.where(near, np.maximum(strength, TINY) * np.sqrt(h), 0.0)
        std_now = np.where(room > 0, np.maximum(ROOM * self.std[:, None], room), self.std[:, None])
        window.d[rows] = 1.0 / std_now

    def _rows(self, window: Window) -> slice:
        ny, ns = window.stage.dae.output.shape[0], len(self.std)
        return slice(window.stage.numbers - ny - ns, window.stage.numbers - ny)

    def _seen(self, window: Window) -> tuple[Array, Array, Array]:
        """Velocities (laws, 3, k), strengths (laws, n_soft, 3, k), and the newest velocities' slopes in [x; p], (laws, n)."""
        y, p, k, count = window.here.stages, window.here.p, window.count, len(self.laws)
        if k == self.length:
            v, f, slope = self._nears(y, window.here.parameters, window.d)
        else:
            parts = [[a.copy() for a in self._near(y[:, j], p, window.d[:, j])] for j in range(k)]
            v, f, slope = (np.hstack(column) for column in zip(*parts, strict=True))
        n = slope.shape[1] // k
        return v.reshape(count, k, 3).swapaxes(1, 2), f.reshape(count, -1, k, 3).swapaxes(2, 3), slope[:, (k - 1) * n :]


def _strength(dae: Dae, soft: tuple[int, ...], law: FrictionLaw, width: float) -> Any:
    """What the soft balances lose when the law's sign is rounded away, (n_soft,)."""
    F, symbol = dae.undisturbed(dae.residual[dae.rows_of(soft)]), dae.p[law.width]
    # the width is a hundredth of the velocity's rms, or as the user has it
    return ca.substitute(F, symbol, SHARP * width) - ca.substitute(F, symbol, width / SHARP)
