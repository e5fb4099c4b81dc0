"""Units and names that blocks take from what they are connected to."""

import pytest

from backsight.models import Model, compile_model
from backsight.models.plants import actuator, drillstring
from backsight.models.signals import AsymmetricLag, DeadZone, Drift, Lag, PIController


def with_block(block: object) -> Model:
    return drillstring().insert("input:V", block, "block")  # type: ignore[arg-type]


@pytest.mark.parametrize(("block", "unit"), [(Lag(), "V"), (AsymmetricLag(), "V/s"), (PIController(), "")])
def test_the_residual_of_a_block_has_the_unit_of_its_law(block: object, unit: str) -> None:
    dae = compile_model(with_block(block), places=("block",))
    assert {p.name: p.unit for p in dae.places}["block"] == unit


@pytest.mark.parametrize(
    ("block", "name", "unit"),
    [
        (AsymmetricLag(), "block.width", "V"),
        (AsymmetricLag(), "block.tau_up", "s"),
        (DeadZone(), "block.width", "V"),
        (Drift(), "block.rate", "V/s"),
        (PIController(), "block.k", ""),
    ],
)
def test_a_parameter_of_a_block_has_the_unit_of_its_signals(block: object, name: str, unit: str) -> None:
    assert {p.name: p.unit for p in compile_model(with_block(block)).parameters}[name] == unit


def test_the_state_of_a_lag_keeps_the_name_of_the_lag() -> None:
    dae = compile_model(actuator().insert("input:F", Lag(tau=0.1), "lag"))
    assert {q.name: q.unit for q in dae.states} == {"carriage.s": "m", "carriage.v": "m/s", "lag.y": "N"}
