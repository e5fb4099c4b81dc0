"""The tree of errors and the suggestions in their texts."""

import pytest

from backsight.models import BacksightError, InputError, ModelError, SolveError
from backsight.models.errors import suggestion


def test_the_tree_is_small_and_two_of_its_leaves_are_value_errors() -> None:
    assert issubclass(ModelError, BacksightError)
    assert issubclass(ModelError, ValueError)
    assert issubclass(InputError, BacksightError)
    assert issubclass(InputError, ValueError)
    assert issubclass(SolveError, BacksightError)
    assert not issubclass(SolveError, ValueError)


@pytest.mark.parametrize(
    ("name", "known", "text"),
    [
        ("actuatr", ["actuator", "quadrotor"], "did you mean 'actuator'?"),
        ("motor.inductance", ["carriage.m", "friction.d"], "known: carriage.m, friction.d"),
        ("rubbing.f_c", ["carriage.m", "friction.f_c"], "did you mean 'friction.f_c'?"),
        ("x", [], "there are none"),
    ],
)
def test_an_unknown_name_gets_the_nearest_or_the_list(name: str, known: list[str], text: str) -> None:
    assert suggestion(name, known) == text
