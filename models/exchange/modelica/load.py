"""A Modelica file and a class name -> a `Model`. rumoca parses, instantiates and flattens; the parts keep their names and connections.

    model = load_modelica("drive.mo", "Drives.TwoMass")

Every component of the class is a component here, so that it can be a place: `model.insert("motor.flange_b", RotationalFriction())` works
where the connector has an angle phi [rad] and a flow tau [N.m], or a position s [m] and a force f [N], or v [V] and i [A].
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from ...errors import InputError, ModelError
from ...model import Model
from .parts import assemble


def load_modelica(file: str | Path, name: str) -> Model:
    """The model of the class `name` ("Package.Class") in a Modelica file.

    Libraries are looked for in the folders of the environment variable MODELICAPATH. Top-level inputs and outputs become the model's inputs
    and outputs, real parameters without a binding expression its parameters; whole and logical numbers stay what the text says. Array
    elements and arrays of components are written mass_1, z_2. An initial equation x = 5 is a start value.
    Raises InputError for a missing file or compiler, ModelError for what the compiler refuses, what has no value, and what is not
    continuous (when, algorithms, discrete variables).
    """
    if not name:
        raise InputError(f'"{Path(file).name}" names no class; write "{Path(file).name}:Class"')
    if not Path(file).is_file():
        raise InputError(f'"{Path(file).name}:{name}": there is no file {file}')
    flat, texts = _flattened(Path(file), name)
    return assemble(flat, texts, name)


def _flattened(path: Path, name: str) -> tuple[dict[str, Any], dict[int, str]]:
    """rumoca's flat model and the source texts by their number."""
    try:
        import rumoca
    except ImportError:
        raise InputError(
            f'"{path.name}:{name}": Modelica text needs the rumoca compiler; install it: pip install "backsight[modelica]"'
        ) from None
    roots = [root for root in os.environ.get("MODELICAPATH", "").split(os.pathsep) if root]
    session = rumoca.Session(roots=roots) if roots else rumoca.Session()
    try:
        compiled = session.load(str(path), model=name)
    except rumoca.RumocaError as error:
        raise ModelError(f"{path.name}: {' '.join(str(error).split())}") from None
    files = compiled.to_dict(stage="dae")["source_map"]["files"]
    return compiled.to_dict(stage="flat"), {number: text for number, _, text in files}
