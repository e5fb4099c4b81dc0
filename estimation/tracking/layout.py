"""From a window's unknowns to the names that the user knows.

In the problem as it is posed (`supposed.py`) a parameter that drifts and a coloured force are states, an input that was measured has a
force of its own, and states that nothing depends on are left out; these are integrated along the estimates (`models/quadratures.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backsight.models.quadratures import step
from backsight.ocp.called import Called
from backsight.ocp.moving.stage import Stage

from ..problem import Problem
from ..smoothing.columns import places
from ..supposed import INPUT, left_out, noisy_inputs
from .estimate import Names

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@dataclass(frozen=True, kw_only=True)
class Found:
    """What a window tells at its newest knot: values and deviations of x, p, the forces of the soft places, and the recorded inputs."""

    x: Array
    x_std: Array
    p: Array
    p_std: Array
    w: Array
    w_std: Array
    u: Array


class Layout:
    """Names of a problem's quantities, and where they stand; asked: the problem as the user has it, before it is posed."""

    def __init__(self, asked: Problem, stage: Stage) -> None:
        dae = stage.dae
        states, soft = [q.name for q in dae.states], [dae.places[k].name for k in stage.soft]
        free = [dae.parameters[i].name for i in stage.free]
        self._gone = left_out(asked)
        wanted = [f"residual.{place}" for place in places(asked) if place in soft or f"residual.{place}" in states]
        drifting = [name for name, given in asked.varying.items() if given.drift is not None]
        measured = [name for name in noisy_inputs(asked) if f"{INPUT}{name}" in soft]
        self.names = Names(
            outputs=tuple(q.name for q in dae.outputs),
            states=tuple(q.name for q in asked.dae.states),
            forces=tuple(wanted),
            parameters=(*free, *drifting),
            inputs=tuple(measured),
        )
        whole = [*states, *free, *(f"residual.{place}" for place in soft)]  # of [x; p; w]
        gone = [asked.dae.states[g.state].name for g in self._gone]
        self._of_gone = [self.names.states.index(name) for name in gone]
        self._states = np.array([whole.index(name) if name in whole else -1 for name in self.names.states])
        self._parameters = np.array([whole.index(name) for name in self.names.parameters], dtype=np.int64)
        self._forces = np.array([whole.index(name) for name in self.names.forces], dtype=np.int64)
        self._pushed = np.array([whole.index(f"residual.{INPUT}{name}") for name in measured], dtype=np.int64)
        self._recorded = [[q.name for q in dae.inputs].index(name) for name in measured]
        self.gone = np.array([asked.dae.states[g.state].start for g in self._gone])
        if self._gone:
            self._kept = [self.names.states.index(name) for name in states if name in self.names.states]
            self._in_posed = [states.index(self.names.states[i]) for i in self._kept]
            self._middle = Called(stage.sampled("middle", dae.x, [0.5]))
            self._integrated = Called(step(asked.dae, self._gone))

    def move(self, y: Array, p: Array, d: Array, left: Array, right: Array) -> None:
        """Integrate what was left out over a stage: unknowns y, numbers d, states at its ends."""
        if not self._gone:
            return
        x = np.zeros((len(self.names.states), 3))
        middle = self._middle(y, p, d)[0][:, 0]
        for column, values in enumerate((left, middle, right)):
            x[self._kept, column] = values[self._in_posed]
        self.gone = self._integrated(self.gone, x, d[:1])[0][:, 0].copy()

    def read(self, found: Found) -> dict[str, tuple[Array, Array]]:
        """states, forces, parameters and inputs with their deviations, in the order of the names."""
        value, std = np.concatenate([found.x, found.p, found.w]), np.concatenate([found.x_std, found.p_std, found.w_std])
        states, states_std = value[self._states], std[self._states]
        states[self._of_gone], states_std[self._of_gone] = self.gone, np.inf
        return {
            "states": (states, states_std),
            "forces": (value[self._forces], std[self._forces]),
            "parameters": (value[self._parameters], std[self._parameters]),
            "inputs": (found.u[self._recorded] + value[self._pushed], std[self._pushed]),
        }
