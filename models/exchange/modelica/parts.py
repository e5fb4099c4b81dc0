"""From rumoca's flat model to components: every top-level component of the class becomes one of ours, with its own equations.

What the class itself declares becomes one more component, named like the class; its parameters are the model's own. Connections between
connectors of top-level components stay connections, others stay equations. An equation is the balance of a body, and carries a residual
force, when it holds a derivative that it does not merely define:  m der(v) = f,  or  m a = f  with  a = der(v), v = der(s).
"""

from __future__ import annotations

import functools
import json
import math
import re
from typing import Any

import casadi as ca

from ...connectors import Electrical, Rotational, Translational
from ...errors import ModelError
from ...language import Component, Connector, Equation, Pair, Parameter, Variable
from ...model import Model
from .arrays import elements
from .balances import balanced, oriented, unit_of_terms
from .expressions import Translator, number
from .loops import unrolled
from .trees import Tree, definition_of_rate, derivatives, name_of, plain, reference, references, spans

_REFUSED = ("algorithms", "when_chains", "initial_algorithms")
_WORDS = {"Connection": "connection", "FlowSum": "balance at the connection", "UnconnectedFlow": "nothing flows at the open end"}
_KNOWN = {(("s", "m"), ("f", "N")): Translational, (("phi", "rad"), ("tau", "N.m")): Rotational, (("v", "V"), ("i", "A")): Electrical}


class Part(Component):
    """A component of a Modelica class, its equations as they stand in the text."""

    specification = ""

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild, (self.specification, dict(self.parameters))

    def equations(self, c: Any) -> dict[str, Equation]:
        own = json.loads(self.specification)
        translate = Translator(c.at, lambda e: c.der(e), own["functions"], c.time)
        found = {}
        for title, kind, place, unit, tree in own["equations"]:
            try:
                found[title] = Equation(translate(tree), ca.SX(0), kind, place, unit)
            except ModelError as error:
                raise ModelError(f"{own['doc']}: '{title}': {error}") from None
        return found


@functools.lru_cache(maxsize=256)
def _part(specification: str) -> type[Part]:
    own = json.loads(specification)
    declared: dict[str, Any] = {"specification": specification, "__doc__": own["doc"]}
    declared |= {word: Parameter(**values) for word, values in own["parameters"].items()}
    declared |= {word: Variable(**values) for word, values in own["variables"].items()}
    declared |= {word: _connector(tuple(tuple(pair) for pair in pairs)) for word, pairs in own["connectors"].items()}
    return type(re.sub(r"\W", "_", own["name"]), (Part,), declared)


@functools.lru_cache(maxsize=256)
def _connector(pairs: tuple[tuple[str, str, str, str], ...]) -> Connector:
    """One of our own connectors where names and units agree, else a connector of these pairs; unconnected ends carry no flow."""
    if len(pairs) == 1:
        potential, potential_unit, flow, flow_unit = pairs[0]
        kind = _KNOWN.get(((potential, potential_unit), (flow, flow_unit)))
        if kind is not None:
            return kind(optional=True)
    named = tuple(Pair(p, pu, f, fu, f"balance of {f}") for p, pu, f, fu in pairs)
    name = "_".join(["Connector", *(word for pair in pairs for word in (pair[0], pair[2]))])
    return _kind(name, named)(optional=True)


@functools.lru_cache(maxsize=256)
def _kind(name: str, pairs: tuple[Pair, ...]) -> type[Connector]:
    return type(name, (Connector,), {"pairs": pairs})


def _rebuild(specification: str, values: dict[str, float]) -> Part:
    return _part(specification)(**values)


def assemble(flat: dict[str, Any], texts: dict[int, str], class_name: str) -> Model:
    """The model of a flat Modelica class."""
    return _Assembly(flat, texts, class_name).model()


class _Assembly:
    """What is known of the flat class while its parts are put together."""

    def __init__(self, flat: dict[str, Any], texts: dict[int, str], class_name: str) -> None:
        for refused in _REFUSED:
            if flat[refused]:
                raise ModelError(f"Modelica class '{class_name}' has {refused.replace('_', ' ')}: only continuous equations are supported")
        self.flat, self.texts, self.class_name = {**flat, "equations": unrolled(flat)}, texts, class_name
        for k, equation in enumerate(self.flat["equations"]):
            if equation["scalar_count"] != 1:
                title = self._title(equation, k + 1)
                raise ModelError(
                    f"Modelica class '{class_name}': '{title}' is an equation of arrays; write it with scalars, or in a for loop"
                )
        self.own = re.sub(r"\W", "_", class_name.rpartition(".")[2])
        self.declared = self._declared()
        self.parameters, self.fixed = self._parameters()
        self.variables = self._variables()
        self.start = self._start()
        self.connectors = self._connectors()
        self.connections, self.handled = self._connections()
        self.rates = self._rates()

    # --- what the class declares

    def _declared(self) -> dict[str, Tree]:
        """All scalar variables and parameters by their names here."""
        found: dict[str, Tree] = {}
        origin: dict[str, str] = {}
        for name, declared in self.flat["variables"].items():
            try:
                scalars = dict(elements(name, declared))
            except ModelError as error:
                raise self._error(str(error)) from None
            for scalar, own in scalars.items():
                if scalar in found:
                    raise self._error(f"'{origin[scalar]}' and '{name}' would both be called '{scalar}' here; rename one of them")
                found[scalar], origin[scalar] = own, name
        return found

    def _parameters(self) -> tuple[dict[str, Tree], dict[str, Tree]]:
        """Independent parameters, and those that are an expression of others, whole or logical numbers, or constants, by name."""
        declared = {n: v for n, v in self.declared.items() if isinstance(v["variability"], dict)}
        declared = {n: v for n, v in declared.items() if {"Parameter", "Constant"} & v["variability"].keys()}
        fixed = {
            n: v["binding"]
            for n, v in declared.items()
            if "Constant" in v["variability"] or v["is_discrete_type"] or references(v["binding"] or {})
        }
        return {n: v for n, v in declared.items() if n not in fixed}, fixed

    def _variables(self) -> dict[str, Tree]:
        found = {n: v for n, v in self.declared.items() if n not in self.parameters and n not in self.fixed}
        for name, declared in found.items():
            if declared["is_discrete_type"] or declared["variability"] not in ("Empty", "Continuous"):
                raise self._error(f"'{name}' is discrete; only continuous Real variables are supported")
        return found

    def _start(self) -> dict[str, float]:
        """The values that the initial equations give to variables."""
        found = {}
        values = {n: self._parameter(n)["default"] for n in self.parameters}
        for k, equation in enumerate(self.flat["initial_equations"], start=1):
            sides = equation["residual"].get("Binary", {})
            for one, other in ((sides.get("lhs", {}), sides.get("rhs")), (sides.get("rhs", {}), sides.get("lhs"))):
                name = name_of(one["VarRef"]) if "VarRef" in one else ""
                if sides.get("op") == "Sub" and name in self.variables and not references(other) & self.variables.keys():
                    value = number(self._resolved(other), values, self.flat["functions"])
                    if value is not None:
                        found[name if "." in name else f"{self.own}.{name}"] = value
                        break
            else:
                raise self._error(
                    f"the initial equation '{self._title(equation, k)}' is not supported; write the value of one variable, x = 5, "
                    "or start values"
                )
        return found

    def _error(self, text: str) -> ModelError:
        return ModelError(f"Modelica class '{self.class_name}': {text}")

    def _connectors(self) -> dict[str, list[tuple[str, str, str, str]]]:
        """Physical connectors of top-level components: "motor.flange" -> its pairs of potential and flow, with their units."""
        groups: dict[str, list[str]] = {}
        for name in self.variables:
            if name.count(".") == 2:
                groups.setdefault(name.rpartition(".")[0], []).append(name.rpartition(".")[2])
        found = {}
        for path, words in groups.items():
            flows = [w for w in words if self.variables[f"{path}.{w}"]["flow"]]
            potentials = [w for w in words if w not in flows]
            if flows and len(flows) == len(potentials):
                found[path] = [(p, self._unit(f"{path}.{p}"), f, self._unit(f"{path}.{f}")) for p, f in zip(potentials, flows, strict=True)]
        return found

    def _connections(self) -> tuple[list[tuple[str, str]], set[int]]:
        """Pairs of connectors to connect, and the numbers of the equations that say so."""
        connections: dict[tuple[str, str], None] = {}
        handled = set()
        for k, equation in enumerate(self.flat["equations"]):
            [(kind, origin)] = equation["origin"].items()
            if kind == "Connection":
                ends = tuple(plain(origin[side]).rpartition(".")[0] for side in ("lhs", "rhs"))
                if all(end in self.connectors for end in ends):
                    connections[(ends[0], ends[1])] = None
                    handled.add(k)
            elif kind in ("FlowSum", "UnconnectedFlow"):
                names = references(equation["residual"])
                if all(name.rpartition(".")[0] in self.connectors for name in names):
                    handled.add(k)
        return list(connections), handled

    def _rates(self) -> dict[str, str]:
        """a -> b where an equation says a = der(b)."""
        found = {}
        for equation in self.flat["equations"]:
            definition = definition_of_rate(equation["residual"])
            if definition:
                found[definition[0]] = definition[1]
        return found

    # --- the model

    def model(self) -> Model:
        """Components, connections, inputs and outputs."""
        owners = dict.fromkeys(self._owner(n) for n in [*self.variables, *(p for p in self.parameters if "." in p)])
        equations: dict[str, list[list[Any]]] = {owner: [] for owner in owners}
        for k, equation in enumerate(self.flat["equations"]):
            if k not in self.handled:
                owner = self._home(equation)
                title = self._title(equation, k + 1)
                title += f" no. {k + 1}" if title in {row[0] for row in equations.get(owner, [])} else ""
                equations.setdefault(owner, []).append([title, *self._read(equation["residual"])])
        for name, declared in self.variables.items():
            if declared["binding"]:
                tree = {"Binary": {"op": "Sub", "lhs": reference(name), "rhs": declared["binding"]}}
                equations.setdefault(self._owner(name), []).append([f"binding of {name}", "equal", "", "", tree])
        components = {owner: self._component(owner, rows) for owner, rows in equations.items()}
        own = {n: self._parameter(n) for n in self.parameters if "." not in n}
        causal = {c: [n for n, v in self.variables.items() if "." not in n and c in v["causality"]] for c in ("Input", "Output")}
        return Model(
            name=self.class_name,
            description=self.flat["model_description"] or "",
            components=components,
            connections=self.connections,
            parameters={n: Parameter(**values) for n, values in own.items()},
            inputs={n: f"{self.own}.{n}" for n in causal["Input"]},
            outputs={n: f"{self.own}.{n}" for n in causal["Output"]},
            start=self.start,
        )

    def _component(self, owner: str, rows: list[list[Any]]) -> Part:
        prefix = "" if owner == self.own else f"{owner}."
        mine = [n for n in self.variables if self._owner(n) == owner]
        ports = [path for path in self.connectors if path.startswith(prefix)] if prefix else []
        inside = {f"{path}.{word}" for path in ports for pair in self.connectors[path] for word in (pair[0], pair[2])}
        balances = [row for row in rows if row[1] == "balance"]
        taken: set[str] = set()
        for row in balances:
            row[2] = "" if len(balances) == 1 else _free(_place(row[2]), taken)
            taken.add(row[2])
        specification = {
            "name": owner,
            "doc": f"{owner} of {self.class_name}",
            "parameters": {n.removeprefix(prefix): self._parameter(n) for n in self.parameters if prefix and n.startswith(prefix)},
            "variables": {n.removeprefix(prefix): self._variable(n) for n in mine if n not in inside},
            "connectors": {path.removeprefix(prefix): self.connectors[path] for path in ports},
            "equations": [[*row[:4], self._resolved(row[4])] for row in rows],
            "functions": self.flat["functions"],
        }
        return _part(json.dumps(specification))()

    def _resolved(self, tree: Tree) -> Tree:
        """References as dotted names of the model, with dependent parameters written out."""
        if isinstance(tree, list):
            return [self._resolved(item) for item in tree]
        if not isinstance(tree, dict):
            return tree
        if "VarRef" in tree:
            name = name_of(tree["VarRef"])
            if name in self.fixed:
                if self.fixed[name] is None:
                    raise self._error(f"parameter '{name}' has no value; give it one")
                return self._resolved(self.fixed[name])
            return reference(f"{self.own}.{name}" if name in self.variables and "." not in name else name)
        return {key: self._resolved(value) for key, value in tree.items() if key != "span"}

    def _parameter(self, name: str) -> dict[str, Any]:
        declared = self.parameters[name]
        given = declared["binding"] or (None if _is_filled_in(declared) else declared["start"])
        try:
            value = number(given, {}, self.flat["functions"])
        except ModelError as error:
            raise self._error(f"parameter '{name}': {error}") from None
        if value is None:
            raise self._error(f"parameter '{name}' has no value; give it one")
        low, high = (number(declared[word], {}, {}) for word in ("min", "max"))
        return {
            "unit": declared["unit"] or "",
            "default": value,
            "min": -math.inf if low is None else low,
            "max": math.inf if high is None else high,
            "nominal": number(declared["nominal"], {}, {}),
            "description": declared["description"] or "",
        }

    def _variable(self, name: str) -> dict[str, Any]:
        declared = self.variables[name]
        values = {n: self._parameter(n)["default"] for n in self.parameters}
        try:
            start = number(self._resolved(declared["start"]), values, self.flat["functions"]) if declared["start"] else 0.0
        except ModelError as error:
            raise self._error(f"the start value of '{name}': {error}") from None
        if start is None:
            raise self._error(f"the start value of '{name}' is no number")
        return {
            "unit": declared["unit"] or "",
            "nominal": number(declared["nominal"], values, {}) or 1.0,
            "start": start,
            "state": declared["state_select"] in ("Prefer", "Always") or name in self.rates.values() or name in self._differentiated,
            "description": declared["description"] or "",
        }

    @functools.cached_property
    def _differentiated(self) -> set[str]:
        return set().union(*(derivatives(equation["residual"]) for equation in self.flat["equations"]))

    def _owner(self, name: str) -> str:
        return name.partition(".")[0] if "." in name else self.own

    def _home(self, equation: Tree) -> str:
        [(kind, origin)] = equation["origin"].items()
        return plain(origin["component"]).partition(".")[0] or self.own if kind == "ComponentEquation" else self.own

    def _unit(self, name: str) -> str:
        return self.variables[name]["unit"] or ""

    def _read(self, residual: Tree) -> tuple[str, str, str, Tree]:
        """balance or equal, with the variable whose balance it is, its unit, and the equation the right way round."""
        variable = "" if definition_of_rate(residual) else balanced(residual, self.rates)
        if not variable:
            return "equal", "", "", residual
        unit = unit_of_terms(residual, lambda name: self._unit(name) if name in self.variables else "")
        return "balance", variable, unit, oriented(residual, variable, self._value)

    def _value(self, name: str) -> float:
        """The value of an independent parameter; 1 for anything else."""
        return float(self._parameter(name)["default"]) if name in self.parameters else 1.0

    def _title(self, equation: Tree, k: int) -> str:
        [(kind, origin)] = equation["origin"].items()
        if kind != "ComponentEquation":
            return f"{_WORDS.get(kind, kind)} {origin.get('description') or ' = '.join(map(str, origin.values()))}"
        region = equation["span"]
        source = self.texts.get(region["source"])
        if not source:
            return f"equation {k}"
        text, start = source.encode(), region["start"]
        if b"=" not in text[start : region["end"]]:  # the head of a loop; its body follows
            inside = [piece["start"] for piece in spans(equation["residual"]) if piece["source"] == region["source"]]
            start = min((s for s in inside if s >= start), default=start)
        while text[start - 1 : start] == b"(":
            start -= 1
        before, after = text[:start].decode(), text[start:].decode()
        line, snippet = before.count("\n") + 1, " ".join(after.partition(";")[0].split())
        return f"{snippet[:60]} (line {line})"


def _is_filled_in(declared: Tree) -> bool:
    """Whether a start value stands nowhere in the text: the compiler's own stands where the name is declared."""
    return declared["start"] is None or any(span == declared["source_span"] for span in spans(declared["start"]))


def _free(place: str, taken: set[str]) -> str:
    """A name for a second balance of the same variable: v_2."""
    return next(name for name in (place, *(f"{place}_{k}" for k in range(2, len(taken) + 3))) if name not in taken)


def _place(variable: str) -> str:
    return variable.rpartition(".")[2]
