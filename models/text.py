"""Equations as readable text: terms with derivatives on the left, as in a textbook.

carriage.m*der(carriage.v) = F - friction.d*carriage.v - offset.f + w[carriage]
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import casadi as ca

from .dae import Dae

SX = Any
_SUM, _PRODUCT, _POWER, _ATOM = range(4)


def equations_text(dae: Dae) -> str:
    """The flat equations, one a line with its origin; then the outputs and the invariants."""
    lines = [f"{equation_text(row)}    [{info.origin}]" for row, info in zip(ca.vertsplit(dae.residual), dae.equations, strict=True)]
    if dae.outputs:
        lines += [f"{q.name} = {expression_text(y)}    [output]" for q, y in zip(dae.outputs, ca.vertsplit(dae.output), strict=True)]
    if dae.invariants.shape[0]:
        lines += [f"{equation_text(row)}    [invariant: holds from the start]" for row in ca.vertsplit(dae.invariants)]
    return "\n".join(lines)


def equation_text(residual: SX) -> str:
    """residual = 0, its terms with derivatives (or else its first term) on the left, the others on the right."""
    terms = list(_terms(residual, 1))
    left = [term for term in terms if "der(" in str(term[1])] or terms[:1]
    right = [(-sign, term) for sign, term in terms if not any(term is other for _, other in left)]
    if all(sign < 0 for sign, _ in left):
        left, right = [(-s, e) for s, e in left], [(-s, e) for s, e in right]
    return f"{_join(left)} = {_join(right)}"


def expression_text(expression: SX) -> str:
    """An SX scalar without needless brackets."""
    return _text(expression)[0]


def _terms(e: SX, sign: int) -> Iterator[tuple[int, SX]]:
    op = e.op()
    if op == ca.OP_ADD or op == ca.OP_SUB:
        yield from _terms(e.dep(0), sign)
        yield from _terms(e.dep(1), sign if op == ca.OP_ADD else -sign)
    elif op == ca.OP_NEG:
        yield from _terms(e.dep(0), -sign)
    else:
        yield sign, e


def _join(terms: list[tuple[int, SX]]) -> str:
    if not terms:
        return "0"
    residual = [t for t in terms if t[1].is_symbolic() and t[1].name().startswith("w[")]
    plain = [t for t in terms if not any(t is other for other in residual)]
    ordered = [*(t for t in plain if t[0] > 0), *(t for t in plain if t[0] < 0), *residual]
    parts = []
    for i, (sign, term) in enumerate(ordered):
        text, level = _text(term)
        text = f"({text})" if level == _SUM else text
        parts.append((" + " if sign > 0 else " - ") + text if i else ("" if sign > 0 else "-") + text)
    return "".join(parts)


def _text(e: SX) -> tuple[str, int]:
    if e.is_symbolic():
        return str(e.name()), _ATOM
    if e.is_constant():
        value = float(e)
        return f"{value:.12g}", _ATOM if value >= 0 else _SUM
    op = e.op()
    if op in (ca.OP_ADD, ca.OP_SUB, ca.OP_NEG):
        return _join(list(_terms(e, 1))), _SUM
    if op == ca.OP_MUL:
        return f"{_bracket(e.dep(0), _PRODUCT)}*{_bracket(e.dep(1), _PRODUCT)}", _PRODUCT
    if op == ca.OP_DIV:
        return f"{_bracket(e.dep(0), _PRODUCT)}/{_bracket(e.dep(1), _POWER)}", _PRODUCT
    if op == ca.OP_TWICE:
        return f"2*{_bracket(e.dep(0), _PRODUCT)}", _PRODUCT
    if op == ca.OP_SQ:
        return f"{_bracket(e.dep(0), _ATOM)}^2", _POWER
    if op in (ca.OP_POW, ca.OP_CONSTPOW):
        return f"{_bracket(e.dep(0), _ATOM)}^{_bracket(e.dep(1), _ATOM)}", _POWER
    name = str(e).rpartition("], ")[2].split("(")[0]
    arguments = ", ".join(_text(e.dep(i))[0] for i in range(e.n_dep()))
    return f"{name}({arguments})", _ATOM


def _bracket(e: SX, level: int) -> str:
    text, own = _text(e)
    return f"({text})" if own < level else text
