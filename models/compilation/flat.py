"""What flattening makes of a model: one list of variables and equations in dotted names, each with its origin."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import casadi as ca

from ..language import Parameter
from ..model import Model

SX = Any


@dataclass(frozen=True, kw_only=True)
class FlatVariable:
    """A declared variable (or connector variable, or auxiliary derivative) of the flat model; rank orders who survives an alias."""

    name: str
    unit: str
    rank: int  # 0 connector or auxiliary, 1 variable, 2 state of a body, 3 of a joint
    nominal: float = 1.0
    start: float = 0.0
    description: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatEquation:
    """residual = 0, where it came from, and what kind of slot it may carry. `slot` is None or (place, unit)."""

    residual: SX
    name: str
    component: str
    kind: Literal["equal", "balance", "law"]
    slot: tuple[str, str] | None = None

    @cached_property
    def held(self) -> tuple[str, ...]:
        """The names of the symbols that the residual holds, in the order in which CasADi meets them."""
        return tuple(symbol.name() for symbol in ca.symvar(self.residual))

    @property
    def origin(self) -> str:
        return f"{self.name} of {self.component}" if self.component else self.name


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatModel:
    """Equations over symbols: `symbols[name]` and, where it occurs, `derivatives[name]`; inputs and parameters are known."""

    name: str
    variables: dict[str, FlatVariable]
    symbols: dict[str, SX]
    derivatives: dict[str, SX]
    parameters: dict[str, tuple[Parameter, float, SX]]
    time: SX
    equations: list[FlatEquation] = field(default_factory=list)


def connection_sets(model: Model) -> list[list[str]]:
    """The nodes of the model: lists of joined connectors, in order of declaration."""
    node: dict[str, list[str]] = {}
    for a, b in model.connections:
        left, right = node.setdefault(a, [a]), node.setdefault(b, [b])
        if left is not right:
            left += right
            node.update(dict.fromkeys(right, left))
    order = {path: i for i, path in enumerate(node)}
    unique = {id(members): sorted(members, key=order.__getitem__) for members in node.values()}
    return sorted(unique.values(), key=lambda members: order[members[0]])
