"""CasADi functions called on buffers that stay where they are: a call costs microseconds beside what it computes."""

from __future__ import annotations

from typing import Any

import numpy as np

from .polynomials import Array


class Called:
    """A function of dense matrices. Results are views that the next call overwrites."""

    def __init__(self, function: Any) -> None:
        self._buffer, self._evaluate = function.buffer()
        shapes_in = [(function.size1_in(i), function.size2_in(i)) for i in range(function.n_in())]
        shapes_out = [(function.size1_out(i), function.size2_out(i)) for i in range(function.n_out())]
        self._given = [np.zeros(shape[::-1]) for shape in shapes_in]
        self._found = [np.zeros(shape[::-1]) for shape in shapes_out]
        for i, a in enumerate(self._given):
            if a.size:
                self._buffer.set_arg(i, memoryview(a.reshape(-1)))  # type: ignore[arg-type]
        for i, a in enumerate(self._found):
            if a.size:
                self._buffer.set_res(i, memoryview(a.reshape(-1)))  # type: ignore[arg-type]

    def __call__(self, *arguments: Array) -> list[Array]:
        """Results (m, n) of arguments (m, n); vectors (m,) are columns."""
        for own, a in zip(self._given, arguments, strict=True):
            own[...] = a.T if a.ndim == 2 else a
        self._evaluate()
        return [a.T for a in self._found]
