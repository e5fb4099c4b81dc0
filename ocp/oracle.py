"""A program as Ipopt asks for it: CasADi functions of X without symbols, whose numbers are those of `evaluated`.

    f, g;   grad f;   dg/dX by its nonzeros;   upper triangle of the Hessian of  lam_f f + lam_g . g,  or of Gauss-Newton's, by its nonzeros

No expression of the whole program is ever made, so that a solver is ready as soon as the columns' small functions are.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from .evaluated import Linearised
from .polynomials import Array

if TYPE_CHECKING:
    from .nlp import Nlp, Values

Index = NDArray[np.int64]


def no_check() -> None:
    """Nothing ends a solve before its time."""


class Oracle:
    """The functions of one program, with the numbers that it has at the time.

    CasADi keeps no reference to what it calls back: an oracle has to live as long as a solver that asks it. After an interrupt, or an error
    in one of its functions, every evaluation fails, so that the solver ends; then `interrupted` tells, and the error is raised again.
    """

    def __init__(self, nlp: Nlp) -> None:
        self._nlp = nlp
        self.interrupted = False
        self.failed: BaseException | None = None
        self.check: Callable[[], None] = no_check
        self._values: Values | None = None
        self._kept: list[Any] = []
        self._last: tuple[Array, list[Linearised]] | None = None

    @contextmanager
    def answering(self, values: Values, check: Callable[[], None] = no_check) -> Iterator[None]:
        """With these numbers, while a solver asks. CasADi would take a signal for an evaluation that failed: it is kept by a handler.

        check: called before every evaluation; what it raises is an error in that.
        """
        self._values, self._last, self.interrupted, self.failed, self.check = values, None, False, None, check
        before = signal.getsignal(signal.SIGINT) if threading.current_thread() is threading.main_thread() else None
        catches = before is not None and before is signal.default_int_handler
        if catches:
            signal.signal(signal.SIGINT, self._interrupt)
        try:
            yield
        finally:
            if catches:
                signal.signal(signal.SIGINT, before)
            self._last, self._values, self.check = None, None, no_check
        if self.failed is not None:
            raise self.failed

    def about(self, values: Values) -> None:
        """From now on with these numbers."""
        self._values, self._last = values, None

    def _interrupt(self, *_: object) -> None:
        self.interrupted = True

    def program(self) -> Any:
        """(x, p) -> (f, g)."""
        evaluated, n, m = self._nlp.evaluated, self._nlp.size, self._nlp.constraint_count
        f = self._called("f", [n], [ca.Sparsity.dense(1)], lambda X: [evaluated.cost(X, self.values)])
        g = self._called("g", [n], [ca.Sparsity.dense(m)], lambda X: [evaluated.constraints(X, self.values)]) if m else None
        return self._function("program", [f, g], ["f", "g"])

    def gradient(self) -> Any:
        """(x, p) -> (f, grad_f_x)."""
        evaluated, n = self._nlp.evaluated, self._nlp.size

        def numbers(X: Array) -> list[Array]:
            parts = [part for part in self._at(X) if not self._nlp.terms[part.number].equality]
            return [np.array([sum(float(np.sum(part.r**2)) / 2 for part in parts)]), evaluated.gradient(parts)]

        called = self._called("grad_f", [n], [ca.Sparsity.dense(1), ca.Sparsity.dense(n)], numbers)
        return self._function("nlp_grad_f", [called], ["f", "grad_f_x"])

    def jacobian(self) -> Any:
        """(x, p) -> (g, jac_g_x)."""
        n, m = self._nlp.size, self._nlp.constraint_count
        if not m:
            x, p = ca.MX.sym("x", n), ca.MX.sym("p", 0)
            return ca.Function("nlp_jac_g", [x, p], [ca.MX(0, 1), ca.MX(0, n)], ["x", "p"], ["g", "jac_g_x"])

        def numbers(X: Array) -> list[Array]:
            parts = [part for part in self._at(X) if self._nlp.terms[part.number].equality]
            return [np.concatenate([part.r.ravel(order="F") for part in parts]), self._nlp.evaluated.jacobian_entries(parts)]

        sparsity = _sparsity(m, n, *self._nlp.evaluated.jacobian_places)
        return self._function("nlp_jac_g", [self._called("jac_g", [n], [ca.Sparsity.dense(m), sparsity], numbers)], ["g", "jac_g_x"])

    def hessian(self, exact: bool) -> Any:
        """(x, p, lam_f, lam_g) -> triu_hess_gamma_x_x; not exact: of the squares alone."""
        evaluated, n, m = self._nlp.evaluated, self._nlp.size, self._nlp.constraint_count

        def numbers(X: Array, weight: Array, multipliers: Array) -> list[Array]:
            return [evaluated.upper_entries(self._at(X), X, self.values, float(weight[0]), multipliers, exact)]

        sparsity = _sparsity(n, n, *evaluated.upper_places(exact))
        return self._function(
            "nlp_hess_l", [self._called("hess_l", [n, 1, m], [sparsity], numbers)], ["triu_hess_gamma_x_x"], lam_f=1, lam_g=m
        )

    @property
    def values(self) -> Values:
        """The numbers that the program has at the time."""
        if self._values is None:
            raise ValueError("Oracle: asked before it was told the program's numbers; call about(values) first.")
        return self._values

    def _at(self, X: Array) -> list[Linearised]:
        """All terms linearised, once for all that Ipopt asks at one X."""
        if self._last is None or not np.array_equal(self._last[0], X):
            self._last = X.copy(), [self._nlp.evaluated.linearised(k, X, self.values) for k in range(len(self._nlp.terms))]
        return self._last[1]

    def _called(self, name: str, sizes: Sequence[int], sparsities: Sequence[Any], numbers: Callable[..., Sequence[Any]]) -> Any:
        called = _Called(self, name, sizes, sparsities, numbers)
        self._kept.append(called)
        return called

    def _function(self, name: str, called: Sequence[Any], names: list[str], **more: int) -> Any:
        """A function of x, p and `more`, the results of what is called one after the other; None has none."""
        x, p = ca.MX.sym("x", self._nlp.size), ca.MX.sym("p", 0)
        further = [ca.MX.sym(name, size) for name, size in more.items()]
        results = list[Any]()
        for part in called:
            found = ca.MX(0, 1) if part is None else part(x, *further)
            results += found if isinstance(found, (list, tuple)) else [found]
        return ca.Function(name, [x, p, *further], results, ["x", "p", *more], names)


class _Called(ca.Callback):
    """A function whose numbers are Python's: `numbers` of dense vectors of these sizes, results as nonzeros of these sparsities."""

    def __init__(
        self, oracle: Oracle, name: str, sizes: Sequence[int], sparsities: Sequence[Any], numbers: Callable[..., Sequence[Any]]
    ) -> None:
        ca.Callback.__init__(self)
        self._oracle, self._sizes, self._sparsities, self._numbers = oracle, sizes, sparsities, numbers
        self.construct(name, {})

    def get_n_in(self) -> int:
        """As many as there are sizes."""
        return len(self._sizes)

    def get_n_out(self) -> int:
        """As many as there are sparsities."""
        return len(self._sparsities)

    def get_sparsity_in(self, i: int) -> Any:
        """Dense."""
        return ca.Sparsity.dense(self._sizes[i])

    def get_sparsity_out(self, i: int) -> Any:
        """As given."""
        return self._sparsities[i]

    def has_eval_buffer(self) -> bool:
        """Numbers come and go in place."""
        return True

    def eval_buffer(self, arg: Sequence[Any], res: Sequence[Any]) -> int:
        """Called by CasADi."""
        try:
            if self._oracle.interrupted or self._oracle.failed is not None:
                return 1
            self._oracle.check()
            given = [np.frombuffer(a, dtype=np.float64) if len(a) else np.empty(0) for a in arg]
            for out, found in zip(res, self._numbers(*given), strict=True):
                if out is not None and len(out):
                    np.frombuffer(out, dtype=np.float64)[:] = found
        except KeyboardInterrupt:
            self._oracle.interrupted = True
            return 1
        except Exception as error:
            self._oracle.failed = error
            return 1
        return 0


def _sparsity(rows: int, columns: int, row: Index, column: Index) -> Any:
    """The pattern with entries at these places, column by column, rows rising in each."""
    return ca.Sparsity(rows, columns, np.searchsorted(column, np.arange(columns + 1)).tolist(), row.tolist())
