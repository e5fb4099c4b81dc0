"""The repaired model as a user would have declared it: with what was found in it, and every number as it was estimated."""

from __future__ import annotations

from collections.abc import Mapping

from backsight.models import Model, ModelError


def as_declared(model: object, values: Mapping[str, float]) -> Model:
    """A problem's model with these values of its parameters, by their names in a result.

    What a study has besides, a sensor's delay, is left out. Raises ModelError for a compiled model, which has no components.
    """
    if not isinstance(model, Model):
        raise ModelError("the model is a compiled Dae, which has no components; give the Model itself")
    own, of_components = dict[str, float](), dict[str, dict[str, float]]()
    for path, value in values.items():
        owner, _, word = path.partition(".")
        if path in model.parameters:
            own[path] = value
        elif owner in model.components and word in model.components[owner].declared_parameters and path not in model.bindings:
            of_components.setdefault(owner, {})[word] = value
    return model.with_values(**own, **of_components)
