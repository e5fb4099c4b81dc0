"""The flat model: implicit differential-algebraic equations, with the origin of every row kept.

    F(x', x, z, u, p, w, t) = 0      nx + nz rows, SI units, unscaled
    y = h(x', x, z, u, p, w, t)      ny measured quantities
    I(x, z, u, p, t) = 0             what index reduction leaves behind: must hold at the start

Letters: x differential states, z algebraic variables, u inputs, p parameters, y outputs, t time, w residual forces: one per *place*.
A row with a place reads   (inertia terms) - (forces) - w_k = 0,   so that w_k is the force that the model does not explain.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import casadi as ca

SX = Any  # casadi has no type stubs
Function = Any


_SYMBOLS = ("dx", "x", "z", "u", "p", "w", "t")
_EXPRESSIONS = ("residual", "output", "invariants")


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A state, algebraic variable, input or output: its dotted name, SI unit and size."""

    name: str
    unit: str
    nominal: float = 1.0
    description: str = ""
    start: float = 0.0
    noise_std: float | None = None


@dataclass(frozen=True, kw_only=True)
class ParameterInfo:
    """A parameter of the flat model. `smoothing` marks a width that rounds a corner and is no physics."""

    name: str
    unit: str
    value: float
    minimum: float
    maximum: float
    nominal: float
    description: str = ""
    smoothing: bool = False


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where a residual may act: the balance of a body, or the law of an element."""

    name: str
    unit: str
    kind: Literal["balance", "law"]
    enabled: bool
    origin: str


@dataclass(frozen=True, kw_only=True)
class EquationInfo:
    """Where a row comes from: "force balance" of "carriage"; `place` is its index into w, if it has one.

    shaped: the place whose residual force enters this row as a state, coloured by a row of its own (`augmentation/`).
    """

    name: str
    component: str
    origin: str
    place: int | None = None
    shaped: int | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Dae:
    """Index-reduced implicit equations of a model as CasADi SX columns.

    places           one per entry of w
    dormant_places   places that `compile_model(model, places=...)` can switch on
    merged_places    place whose balance went into other equations -> the place whose residual stands for both; "" where none does
    kinematics       (i, j, row): residual row `row` is exactly x'[i] - x[j] = 0
    index            differential index found before reduction (0 or 1: no reduction was needed)
    variables        every declared variable: dotted name -> expression in x', x, z, u, p, w, t
    """

    name: str
    x: SX
    dx: SX
    z: SX
    u: SX
    p: SX
    w: SX
    t: SX
    states: tuple[Quantity, ...]
    algebraics: tuple[Quantity, ...]
    inputs: tuple[Quantity, ...]
    outputs: tuple[Quantity, ...]
    parameters: tuple[ParameterInfo, ...]
    places: tuple[Place, ...]
    dormant_places: tuple[Place, ...] = ()
    merged_places: Mapping[str, str] = field(default_factory=dict)
    residual: SX
    equations: tuple[EquationInfo, ...]
    output: SX
    invariants: SX
    kinematics: tuple[tuple[int, int, int], ...]
    index: int
    variables: Mapping[str, SX] = field(repr=False)

    def __getstate__(self) -> dict[str, Any]:
        """All expressions as one function: alone, each would travel to another process with symbols of its own."""
        state = {key: value for key, value in self.__dict__.items() if key not in (*_SYMBOLS, *_EXPRESSIONS, "variables")}
        expressions = [*(getattr(self, key) for key in _EXPRESSIONS), *self.variables.values()]
        function = ca.Function("dae", [getattr(self, key) for key in _SYMBOLS], expressions)
        return state | {"function": function, "variables": tuple(self.variables), "merged_places": dict(self.merged_places)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        function, names = state.pop("function"), state.pop("variables")
        symbols = function.sx_in()
        found = function.call(symbols, True, False)
        state |= dict(zip(_SYMBOLS, symbols, strict=True)) | dict(zip(_EXPRESSIONS, found, strict=False))
        self.__dict__.update(state, variables=dict(zip(names, found[len(_EXPRESSIONS) :], strict=True)))

    def __repr__(self) -> str:
        names = ", ".join(q.name for q in self.states)
        return (
            f"Dae({self.name}: states ({names}), {len(self.algebraics)} algebraic, inputs {[q.name for q in self.inputs]}, "
            f"outputs {[q.name for q in self.outputs]}, {len(self.parameters)} parameters, "
            f"places {[q.name for q in self.places]}, index {self.index})"
        )

    def function(self, name: str = "dae") -> Function:
        """(dx, x, z, u, p, w, t) -> (residual, output) as a `casadi.Function`."""
        return ca.Function(
            name,
            [self.dx, self.x, self.z, self.u, self.p, self.w, self.t],
            [self.residual, self.output],
            ["dx", "x", "z", "u", "p", "w", "t"],
            ["residual", "output"],
        )

    def probe(self, *names: str) -> Function:
        """(dx, x, z, u, p, w, t) -> the named variables, one column; any declared variable's dotted name will do."""
        return ca.Function(
            "probe", [self.dx, self.x, self.z, self.u, self.p, self.w, self.t], [ca.vertcat(*(self.variables[name] for name in names))]
        )

    def undisturbed(self, expression: SX) -> SX:
        """The expression without residual forces, w = 0."""
        return ca.substitute(expression, self.w, ca.SX.zeros(self.w.shape[0]))

    def rows_of(self, places: Sequence[int]) -> list[int]:
        """Rows of the residual that carry the residual forces of these places, in their order."""
        found = {e.place: row for row, e in enumerate(self.equations) if e.place is not None}
        return [found[k] for k in places]

    def balances_of(self, places: Sequence[int]) -> list[int]:
        """Rows of the residual in which the forces of these places stand, in their order: of a coloured one not the row that shapes it."""
        shaped = {e.shaped: row for row, e in enumerate(self.equations) if e.shaped is not None}
        return [shaped.get(k, row) for k, row in zip(places, self.rows_of(places), strict=True)]

    def parameter_values(self, overrides: Mapping[str, float] | None = None) -> list[float]:
        """The values of p in order: defaults, replaced by `overrides`."""
        given = dict(overrides or {})
        return [float(given.get(parameter.name, parameter.value)) for parameter in self.parameters]
