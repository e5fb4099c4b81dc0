"""Equations as readable text: terms with derivatives on the left, as in a textbook.

carriage.m*der(carriage.v) = F - friction.d*carriage.v - offset.f + w[carriage]
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import casadi as ca

from .dae import Dae

SX = Any
SHORT = 30  # characters: a repeated expression of that length is written out
_LOGIC, _SUM, _PRODUCT, _POWER, _ATOM = range(5)
_RELATIONS = {ca.OP_LT: "<", ca.OP_LE: "<=", ca.OP_EQ: "==", ca.OP_NE: "!=", ca.OP_AND: "and", ca.OP_OR: "or"}


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


def is_longer(e: SX, limit: int) -> bool:
    """Whether an expression takes more than about so many characters."""
    return _size(e, {}) > limit


def abbreviated(rows: Sequence[SX]) -> tuple[list[SX], list[tuple[str, SX]]]:
    """The rows with what they repeat replaced by e1, e2, ..., and the definitions of these, each after those that it needs."""
    shared, symbols, values = ca.shared(ca.vertsplit(ca.cse(ca.vertcat(*rows))), "e")
    column, kept = ca.vertcat(*shared, *values), {}
    for number, symbol in enumerate(symbols, start=len(rows)):
        if is_longer(column[number], SHORT):
            kept[symbol.name()] = (symbol, number)
        else:
            column = ca.substitute(column, symbol, column[number])
    order: dict[str, SX] = {}

    def visit(expression: SX) -> None:
        for symbol in ca.symvar(expression):
            name = symbol.name()
            if name in kept and name not in order:
                visit(column[kept[name][1]])
                order[name] = ca.SX.sym(f"e{len(order) + 1}")

    visit(column[: len(rows)])
    if order:
        column = ca.substitute(column, ca.vertcat(*(kept[name][0] for name in order)), ca.vertcat(*order.values()))
    return [column[i] for i in range(len(rows))], [(short.name(), column[kept[name][1]]) for name, short in order.items()]


def wrapped(text: str, width: int, indent: int) -> list[str]:
    """An equation in lines of at most `width` characters where it can be broken before = + -, the lines after the first indented."""
    lines, room = [], width
    while len(text) > room and (at := _break(text, room)):
        lines.append(text[:at])
        text, room = " " * indent + text[at + 1 :], width
    return [*lines, text]


def _break(text: str, room: int) -> int:
    """The space before =, + or - within `room`, in as few brackets as possible and then as late as possible; 0 if there is none."""
    depth, best, start = 0, (0, 0), len(text) - len(text.lstrip())
    for i, character in enumerate(text[: room + 1]):
        depth += (character == "(") - (character == ")")
        if i > start + room // 3 and text[i : i + 3] in (" + ", " - ", " = "):
            best = max(best, (1000 - depth, i))
    return best[1]


def _size(e: SX, known: dict[int, int]) -> int:
    """About how many characters an expression takes, in time linear in its nodes."""
    stack = [e]
    while stack:
        node = stack[-1]
        key = node.element_hash()
        below = [node.dep(i) for i in range(node.n_dep())]
        missing = [d for d in below if d.element_hash() not in known]
        if missing:
            stack += missing
            continue
        stack.pop()
        known[key] = (len(node.name()) if node.is_symbolic() else 3) + sum(known[d.element_hash()] for d in below)
    return known[e.element_hash()]


def _terms(e: SX, sign: int) -> Iterator[tuple[int, SX]]:
    """The summands of an expression with their signs, from left to right; sums of any depth."""
    stack = [(sign, e)]
    while stack:
        now, node = stack.pop()
        op = node.op()
        if op in (ca.OP_ADD, ca.OP_SUB):
            stack += [(now if op == ca.OP_ADD else -now, node.dep(1)), (now, node.dep(0))]
        elif op == ca.OP_NEG:
            stack.append((-now, node.dep(0)))
        else:
            yield now, node


def _join(terms: list[tuple[int, SX]]) -> str:
    if not terms:
        return "0"
    residual = [t for t in terms if t[1].is_symbolic() and t[1].name().startswith("w[")]
    plain = [t for t in terms if not any(t is other for other in residual)]
    ordered = [*(t for t in plain if t[0] > 0), *(t for t in plain if t[0] < 0), *residual]
    parts = []
    for i, (sign, term) in enumerate(ordered):
        text, level = _text(term)
        text = f"({text})" if level <= _SUM else text
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
    if op in _RELATIONS:
        return f"{_bracket(e.dep(0), _SUM)} {_RELATIONS[op]} {_bracket(e.dep(1), _SUM)}", _LOGIC
    if op == ca.OP_NOT:
        return f"not {_bracket(e.dep(0), _PRODUCT)}", _LOGIC
    if op == ca.OP_IF_ELSE_ZERO:
        return f"{_bracket(e.dep(1), _SUM)} if {_text(e.dep(0))[0]} else 0", _LOGIC
    if op == ca.OP_INV:
        return f"1/{_bracket(e.dep(0), _POWER)}", _PRODUCT
    arguments = ", ".join(_text(e.dep(i))[0] for i in range(e.n_dep()))
    return f"{_name(op, e.n_dep())}({arguments})", _ATOM


def _name(op: int, arguments: int) -> str:
    """The name of a function: as CasADi writes it with plain symbols."""
    x = ca.SX.sym("x")
    return str(ca.SX.unary(op, x) if arguments == 1 else ca.SX.binary(op, x, ca.SX.sym("y"))).partition("(")[0]


def _bracket(e: SX, level: int) -> str:
    text, own = _text(e)
    return f"({text})" if own < level else text
