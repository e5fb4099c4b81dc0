"""A model as an FMU 3.0 for model exchange (Functional Mock-up Interface, Modelica Association, fmi-standard.org), through CasADi.

The equations F(x', x, z, u, p, 0, t) = 0 are handed over solved for x' and z: by Newton's method inside the FMU, which is one step where F
is linear in them. The FMU holds C code and CasADi's own serialised functions; with a C compiler and the FMI headers (extra `fmu`) also the
binary that other tools run.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import casadi as ca

from ..compilation.compiler import compile_model
from ..dae import Dae, Quantity
from ..errors import InputError, ModelError, SolveError
from ..model import Model

MX = Any


def export_fmu(model: Model | Dae, path: str | Path, *, binary: bool | None = None) -> Path:
    """Write the FMU of a model to `path` ("actuator.fmu") and return that path.

    States, inputs, outputs, algebraic variables and parameters (tunable) keep their names, units and start values; residual forces are
    zero; widths that round corners keep their defaults.
    binary  True: with the compiled code of this machine, False: without, None: with it where a C compiler and the extra `fmu` are there

    Raises InputError for a path that does not end in .fmu or has no folder, and when a binary is asked for and cannot be made; ModelError
    for a model with constraints between its states, and for an output named like another quantity.
    """
    target = Path(path).absolute()
    if target.suffix != ".fmu" or not target.parent.is_dir():
        raise InputError(f"export_fmu(path='{path}'): the path ends in .fmu and its folder exists; change it")
    dae = model if isinstance(model, Dae) else compile_model(model)
    _refuse(dae)
    builder = _builder(dae)
    headers = _headers()
    compiler = shutil.which(os.environ.get("CC", "cc")) or shutil.which("gcc")
    if binary and not (headers and compiler):
        lacking = "a C compiler (cc or gcc)" if headers else "the FMI headers: pip install 'backsight[fmu]'"
        raise InputError(f"export_fmu(binary=True): a binary needs {lacking}; add it, or export with binary=False")
    with _folder() as folder:
        files = builder.export_fmu({"no_warning": True})
        _complete(folder / "modelDescription.xml")
        if headers and compiler and binary is not False:
            files = builder.compile_fmu(files, {"include_dirs": [headers], "compiler_options": {"compiler": compiler}})
        packed = builder.pack_fmu(files, {"path": "packed.fmu"})
        shutil.move(folder / packed, target)
    return target


def _refuse(dae: Dae) -> None:
    """What an FMU cannot hold: constraints between states, which an importer would not keep, and two quantities of one name."""
    if dae.invariants.shape[0]:
        raise ModelError(
            f"export_fmu: '{dae.name}' has {dae.invariants.shape[0]} constraints between its states "
            f"({', '.join(q.name for q in dae.states)}), which an FMU cannot keep; name the independent coordinates: Model(states=...)"
        )
    taken = {q.name: "a state" for q in dae.states} | {q.name: "an algebraic variable" for q in dae.algebraics}
    taken |= {q.name: "an input" for q in dae.inputs} | {q.name: "a parameter" for q in dae.parameters}
    for q in dae.outputs:
        if q.name in taken:
            raise ModelError(
                f"export_fmu: output '{q.name}' of '{dae.name}' has the name of {taken[q.name]}; give it another in Model(outputs=...)"
            )


def _builder(dae: Dae) -> Any:
    """The equations as a `casadi.DaeBuilder`."""
    builder = ca.DaeBuilder(dae.name.replace(".", "_"))
    t = builder.add("time", "independent", {}) if _depends_on_time(dae) else ca.MX(0)
    x = [_add(builder, q, state=True) for q in dae.states]
    p = [
        builder.add(
            q.name, "parameter", "tunable", {"start": q.value, "unit": q.unit, "min": q.minimum, "max": q.maximum, "nominal": q.nominal}
        )
        for q in dae.parameters
    ]
    u = [_add(builder, q, "input") for q in dae.inputs]
    rates, z, y = _solved(dae, ca.vertcat(*x), ca.vertcat(*u), ca.vertcat(*p), t)
    for state, rate in zip(x, ca.vertsplit(rates), strict=True):
        builder.eq(builder.der(state), rate)
    for quantity, value in zip(dae.algebraics, ca.vertsplit(z) if dae.algebraics else [], strict=True):
        builder.eq(_add(builder, quantity), value)
    for quantity, value in zip(dae.outputs, ca.vertsplit(y) if dae.outputs else [], strict=True):
        builder.eq(_add(builder, quantity, "output"), value)
    return builder


def _solved(dae: Dae, x: MX, u: MX, p: MX, t: MX) -> tuple[MX, MX, MX]:
    """x', z and y as functions of x, u, p, t."""
    unknown = ca.vertcat(dae.dx, dae.z)
    known = ca.vertcat(dae.x, dae.u, dae.p, dae.t)
    residual, output = (dae.undisturbed(e) for e in (dae.residual, dae.output))
    guess = ca.DM([0.0] * len(dae.states) + [q.start for q in dae.algebraics])
    newton = ca.rootfinder("highest", "fast_newton", {"x": unknown, "p": known, "g": residual}, {"max_iter": 50, "abstol": 1e-13})
    given = ca.vertcat(x, u, p, t)
    found = newton(x0=guess, p=given)["x"]
    reading = ca.Function("outputs", [unknown, known], [output])
    nx = len(dae.states)
    return found[:nx], found[nx:], reading(found, given)


def _complete(description: Path) -> None:
    """Define the units that are used, and call the names what they are: der(carriage.s) is no structured name in the sense of FMI."""
    tree = ElementTree.parse(description)
    root = tree.getroot()
    root.set("variableNamingConvention", "flat")
    units = sorted({unit for variable in root.iter() if (unit := variable.get("unit"))})
    definitions = ElementTree.Element("UnitDefinitions")
    definitions.extend(ElementTree.Element("Unit", {"name": unit}) for unit in units)
    place = [child.tag for child in root].index("ModelVariables")
    earlier = [k for k, child in enumerate(root) if child.tag in ("TypeDefinitions", "LogCategories", "DefaultExperiment")]
    if units:
        root.insert(min([place, *earlier]), definitions)
    tree.write(description, encoding="UTF-8", xml_declaration=True)


def _add(builder: Any, quantity: Quantity, causality: str = "local", *, state: bool = False) -> MX:
    attributes = {"unit": quantity.unit, "nominal": quantity.nominal, "description": quantity.description}
    if causality == "input":
        attributes["start"] = quantity.start
    elif state:
        attributes |= {"start": quantity.start, "initial": "exact"}
    return builder.add(quantity.name, causality, attributes)


def _depends_on_time(dae: Dae) -> bool:
    return bool(ca.depends_on(ca.vertcat(dae.residual, dae.output), dae.t))


def _headers() -> str | None:
    """The folder of fmi3Functions.h."""
    try:
        import fmpy
    except ImportError:
        return None
    folder = Path(fmpy.__file__).parent / "c-code"
    return str(folder) if (folder / "fmi3Functions.h").is_file() else None


@contextmanager
def _folder() -> Iterator[Path]:
    """A temporary working directory: CasADi writes into the current one."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            yield Path(folder)
        except RuntimeError as error:
            raise SolveError(f"the FMU could not be made: {str(error).strip().splitlines()[-1]}") from error
        finally:
            os.chdir(before)
