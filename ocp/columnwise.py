"""Functions of small dense matrices at many columns, an operation of all columns at a time.

CasADi's virtual machine goes through all operations of one column, then of the next: each costs a dispatch that the processor mispredicts.
Here the same operations, in the same order and with the same work vector, are NumPy's: each goes over a strip of columns, and its dispatch
is shared by all of them. What hangs on nothing but shared arguments (parameters, which all columns have in common) is computed once.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import starmap
from operator import call
from threading import Lock
from typing import Any

import casadi as ca
import numpy as np

from .polynomials import Array

STRIP = 4096  # columns at a time, at most: NumPy's cost per call is small beside its work, and the work vector is no burden
FEWEST = 128  # columns: of less CasADi's map is no slower
REPAYS = 1000  # columns, of all calls together, that repay what it costs to read the operations


def _if_else_zero(condition: Array, value: Array, out: Array) -> None:
    np.copyto(out, np.where(condition != 0, value, 0.0))


def _twice(value: Array, out: Array) -> None:
    np.add(value, value, out)


OPERATIONS: dict[int, Callable[..., Any]] = {
    ca.OP_ASSIGN: np.positive,
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative,
    ca.OP_EXP: np.exp,
    ca.OP_LOG: np.log,
    ca.OP_POW: np.power,
    ca.OP_CONSTPOW: np.power,
    ca.OP_SQRT: np.sqrt,
    ca.OP_SQ: np.square,
    ca.OP_TWICE: _twice,
    ca.OP_SIN: np.sin,
    ca.OP_COS: np.cos,
    ca.OP_TAN: np.tan,
    ca.OP_ASIN: np.arcsin,
    ca.OP_ACOS: np.arccos,
    ca.OP_ATAN: np.arctan,
    ca.OP_LT: np.less,
    ca.OP_LE: np.less_equal,
    ca.OP_EQ: np.equal,
    ca.OP_NE: np.not_equal,
    ca.OP_NOT: np.logical_not,
    ca.OP_AND: np.logical_and,
    ca.OP_OR: np.logical_or,
    ca.OP_FLOOR: np.floor,
    ca.OP_CEIL: np.ceil,
    ca.OP_FMOD: np.fmod,
    ca.OP_FABS: np.fabs,
    ca.OP_SIGN: np.sign,
    ca.OP_COPYSIGN: np.copysign,
    ca.OP_IF_ELSE_ZERO: _if_else_zero,
    ca.OP_FMIN: np.fmin,
    ca.OP_FMAX: np.fmax,
    ca.OP_INV: np.reciprocal,
    ca.OP_SINH: np.sinh,
    ca.OP_COSH: np.cosh,
    ca.OP_TANH: np.tanh,
    ca.OP_ASINH: np.arcsinh,
    ca.OP_ACOSH: np.arccosh,
    ca.OP_ATANH: np.arctanh,
    ca.OP_ATAN2: np.arctan2,
    ca.OP_LOG1P: np.log1p,
    ca.OP_EXPM1: np.expm1,
    ca.OP_HYPOT: np.hypot,
}

# what it does, with which registers (of a constant its number, of an argument its place), and into which register or place of a result
Operation = tuple[int, list[Any], int | list[int]]
Step = tuple[Any, ...]  # a function and its arguments


class Columnwise:
    """A casadi.Function of SX with dense arguments and results of one column each, called for C columns at once.

    shared: which arguments all columns have in common; these are given as vectors (n,), the others as (n, C).
    """

    def __init__(self, function: Any, shared: Sequence[int] = ()) -> None:
        self._function, self._shared = function, frozenset(shared)
        self._mapped: dict[int, tuple[int, Any]] = {}  # by the powers of two that numbers of columns go beyond, as the next
        self._bound: dict[int, _Bound] = {}
        self._seen, self._lock = 0, Lock()

    def __call__(self, *arguments: Array) -> list[Array]:
        """Results (m, C)."""
        given = [np.asarray(a, dtype=np.float64) for a in arguments]
        count = next((a.shape[1] for k, a in enumerate(given) if k not in self._shared), 1)
        with self._lock:  # there is one work vector
            before, self._seen = self._seen, self._seen + count
            if not count:
                return [np.empty((self._function.size1_out(i), 0)) for i in range(self._function.n_out())]
            if count < FEWEST or before < REPAYS or self._operations is None:
                return self._by_casadi(given, count)
            width = -(-count // -(-count // STRIP))
            bound = self._bound.get(width.bit_length())
            if bound is None or bound.width < width:
                bound = self._bound[width.bit_length()] = _Bound(self._function, self._operations, self._shared, width)
            out = [np.empty((self._function.size1_out(i), count)) for i in range(self._function.n_out())]
            with np.errstate(all="ignore"):
                bound.share(given)
                for first in range(0, count, width):
                    bound.run(given, out, first, min(first + width, count))
            return out

    @cached_property
    def _operations(self) -> list[Operation] | None:
        """What the function does; None where that is something else than arithmetic."""
        f, found = self._function, list[Operation]()
        for k in range(f.n_instructions()):
            kind = f.instruction_id(k)
            if kind == ca.OP_CONST:
                found.append((kind, [f.instruction_constant(k)], f.instruction_output(k)[0]))
            elif kind == ca.OP_OUTPUT:
                found.append((kind, f.instruction_input(k), f.instruction_output(k)))
            elif kind in OPERATIONS or kind == ca.OP_INPUT:
                found.append((kind, f.instruction_input(k), f.instruction_output(k)[0]))
            else:
                return None
        return found

    def _by_casadi(self, given: list[Array], count: int) -> list[Array]:
        """By CasADi's map, in place: its own conversion goes by way of lists."""
        width, function = self._mapped.get(count.bit_length(), (0, None))
        if width < count:
            width, function = count, self._function.map(count)
            self._mapped[count.bit_length()] = width, function
        flat = [np.repeat(a[None], width, axis=0) if k in self._shared else _wide(a.T, width) for k, a in enumerate(given)]
        out = [np.empty((width, self._function.size1_out(i))) for i in range(self._function.n_out())]
        buffer, evaluate = function.buffer()
        for i, a in enumerate(flat):
            if a.size:
                buffer.set_arg(i, a.ravel().data)
        for i, a in enumerate(out):
            if a.size:
                buffer.set_res(i, a.ravel().data)
        evaluate()
        return [a.T[:, :count] for a in out]


def matrices(entries: Array, rows: int, columns: int = -1) -> Array:
    """C matrices, (C, rows, columns), of their entries column by column, (columns * rows, C)."""
    return np.ascontiguousarray(entries.reshape(columns, rows, entries.shape[1]).transpose(2, 1, 0))


def _wide(rows: Array, count: int) -> Array:
    """So many rows, (count, n), the last of which are the first once more."""
    wide = np.empty((count, rows.shape[1]))
    wide[: len(rows)], wide[len(rows) :] = rows, rows[0]
    return wide


class _Bound:
    """The operations with their places in a work vector of a certain width, (registers, width)."""

    def __init__(self, function: Any, operations: Sequence[Operation], shared: frozenset[int], width: int) -> None:
        f, self.width, self._shared = function, width, shared
        self._own = [np.zeros((f.numel_in(i), 1 if i in shared else width)) for i in range(f.n_in())]
        self._results = [np.zeros((f.size1_out(i), width)) for i in range(f.n_out())]
        work = np.zeros((f.sz_w(), width))
        self._once, self._every = list[Step](), list[Step]()
        now: dict[int, Array] = {}  # register -> where its value stands
        for kind, read, written in operations:
            if isinstance(written, list):
                result, row = written
                self._every.append((np.copyto, self._results[result][row], now[read[0]]))
            elif kind == ca.OP_CONST:
                now[written] = np.full(1, read[0])
            elif kind == ca.OP_INPUT:
                now[written] = self._own[read[0]][read[1]]
            else:
                operands = tuple(now[i] for i in read[: _arity(kind)])
                once = all(a.size == 1 for a in operands)
                out = np.zeros(1) if once else work[written]
                (self._once if once else self._every).append((OPERATIONS[kind], *operands, out))
                now[written] = out

    def share(self, given: list[Array]) -> None:
        """The arguments that all columns have, and what hangs on nothing else."""
        for i in self._shared:
            self._own[i][:, 0] = given[i]
        _carried_out(self._once)

    def run(self, given: list[Array], out: list[Array], first: int, stop: int) -> None:
        """Results of some columns; the rest of a strip keeps what was there."""
        for i, own in enumerate(self._own):
            if i not in self._shared:
                own[:, : stop - first] = given[i][:, first:stop]
        _carried_out(self._every)
        for found, part in zip(out, self._results, strict=True):
            found[:, first:stop] = part[:, : stop - first]


def _carried_out(steps: list[Step]) -> None:
    """One after the other, without a line of Python in between."""
    deque(starmap(call, steps), maxlen=0)


def _arity(kind: int) -> int:
    """How many operands an operation has; CasADi names one twice where there is but one."""
    function = OPERATIONS[kind]
    return 1 if function is _twice or (isinstance(function, np.ufunc) and function.nin == 1) else 2
