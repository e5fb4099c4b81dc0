"""The public names of the layer, and that it stands alone."""

import subprocess
import sys

import backsight.models as models
from backsight.models import electrical, signals
from backsight.models.mechanics import gantry, planar, rotational, spatial, translational

NAMES = """BacksightError BodyFrame Component Connector Dae Electrical Equation EquationInfo Event Frame InputError Model ModelError
Output Pair Parameter ParameterInfo Place Planar Quantity Rotational Shared SignalInput SignalOutput SolveError Trajectory
Translational Variable balance compile_model equal equations_text law simulate"""


def test_the_public_names_are_these_and_exist() -> None:
    assert sorted(models.__all__) == sorted(NAMES.split())
    assert all(hasattr(models, name) for name in models.__all__)


def test_every_component_says_what_it_is() -> None:
    components = [
        c
        for module in (electrical, gantry, planar, rotational, signals, spatial, translational)
        for c in vars(module).values()
        if isinstance(c, type) and issubclass(c, models.Component) and c is not models.Component
    ]
    assert len(components) >= 27
    for component in components:
        assert any(word in (component.__doc__ or "") for word in ("Connectors:", "Signals:", "Base of")), component
        for parameter in component.declared_parameters.values():
            assert parameter.description, component
            assert parameter.unit or not component.declared_connectors, component  # a block's may be that of its signals
        assert not component.declared_parameters or "Parameters:" in (component.__doc__ or ""), component


def test_the_layer_imports_nothing_of_the_layers_above_it() -> None:
    code = (
        "import sys, backsight.models, backsight.models.plants; "
        "sys.exit(any(m.startswith(('backsight.ocp', 'backsight.estimation', 'backsight.data', 'pandas')) for m in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
