"""Networks whose potentials have no origin."""

import pytest

from backsight.models import Model, ModelError, compile_model
from backsight.models.electrical import Capacitor, ElectricalGround, Resistor, Voltage
from backsight.models.mechanics.translational import Force, Mass, Spring
from backsight.models.plants import drillstring


def test_a_circuit_without_a_ground_is_told_to_have_one() -> None:
    with pytest.raises(
        ModelError,
        match=r"potentials source.p.v, .* \(6\) occur as differences only and have no origin; add an ElectricalGround 'ground' and "
        r"connect it to one of them, \('source.p', 'ground.pin'\)",
    ):
        compile_model(drillstring().without("earth"))


def circuits(*grounded: str) -> Model:
    """Two circuits that do not touch."""
    parts = {f"{name}_{side}": kind() for side in "ab" for name, kind in (("source", Voltage), ("wire", Resistor), ("store", Capacitor))}
    return Model(
        name="two",
        components={**parts, **{f"earth_{side}": ElectricalGround() for side in grounded}},
        connections=[
            *((f"source_{s}.p", f"wire_{s}.p") for s in "ab"),
            *((f"wire_{s}.n", f"store_{s}.p") for s in "ab"),
            *((f"store_{s}.n", f"source_{s}.n") for s in "ab"),
            *((f"earth_{s}.pin", f"source_{s}.n") for s in grounded),
        ],
        inputs={f"V_{s}": f"source_{s}.v" for s in "ab"},
    )


def test_every_circuit_needs_a_ground_of_its_own() -> None:
    with pytest.raises(ModelError, match=r"potentials source_b.p.v, .* \(6\) occur as differences only"):
        compile_model(circuits("a"))
    assert [q.name for q in compile_model(circuits("a", "b")).states] == ["store_a.v", "store_b.v"]


def test_springs_between_forces_need_a_ground_and_between_bodies_none() -> None:
    def pulled(body: bool) -> Model:
        ends = {"left": Mass(), "right": Mass()} if body else {}
        return Model(
            name="pulled",
            components={"one": Force(), "other": Force(), "spring": Spring(), **ends},
            connections=[
                ("one.flange", "spring.flange_a"),
                ("other.flange", "spring.flange_b"),
                *([("left.flange", "spring.flange_a"), ("right.flange", "spring.flange_b")] if body else []),
            ],
            inputs={"F": "one.f", "G": "other.f"},
        )

    with pytest.raises(ModelError, match=r"occur as differences only and have no origin; add a Fixed 'ground'"):
        compile_model(pulled(body=False))
    assert len(compile_model(pulled(body=True)).states) == 4
