"""The public names of the layer, and that it stands alone."""

import subprocess
import sys

import backsight.models as models
from backsight.models.mechanics import planar, rotational, translational

NAMES = """BacksightError Component Connector Dae Equation EquationInfo InputError Model ModelError Output Pair Parameter ParameterInfo
Place Planar Quantity Rotational Shared SignalInput SignalOutput SolveError Trajectory Translational Variable balance compile_model equal
equations_text law simulate"""


def test_the_public_names_are_these_and_exist() -> None:
    assert sorted(models.__all__) == sorted(NAMES.split())
    assert all(hasattr(models, name) for name in models.__all__)


def test_every_component_says_what_it_is() -> None:
    components = [
        c
        for module in (planar, rotational, translational)
        for c in vars(module).values()
        if isinstance(c, type) and issubclass(c, models.Component) and c is not models.Component
    ]
    assert len(components) >= 27
    for component in components:
        assert (component.__doc__ and "Connectors:" in component.__doc__) or "Base of" in (component.__doc__ or ""), component
        for parameter in component.declared_parameters.values():
            assert all((parameter.unit, parameter.description)), component
        assert not component.declared_parameters or "Parameters:" in (component.__doc__ or ""), component


def test_the_layer_imports_nothing_of_the_layers_above_it() -> None:
    code = (
        "import sys, backsight.models, backsight.models.plants; "
        "sys.exit(any(m.startswith(('backsight.ocp', 'backsight.estimation', 'backsight.data', 'pandas')) for m in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
