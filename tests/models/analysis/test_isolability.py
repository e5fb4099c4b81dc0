"""Faults that outputs can tell apart, against ranks of the transfer matrices of the linearised models."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from backsight.models import Dae, Model, compile_model
from backsight.models.analysis.describe import describe
from backsight.models.analysis.isolability import isolability, telling
from backsight.models.mechanics.translational import Force, Mass, PositionSensor, Spring
from backsight.models.plants import PLANTS

S = 3.0 + 7.0j  # rad/s, of no mode


def transfer(dae: Dae) -> np.ndarray:
    """From every place, input and fault of an output to all outputs, (ny, faults), linearised at a random point."""
    rng = np.random.default_rng(5)
    arguments = [dae.dx, dae.x, dae.z, dae.u, dae.p, dae.w, dae.t]
    both = ca.vertcat(dae.residual, dae.output)
    of = [ca.densify(ca.jacobian(both, a)) for a in (dae.dx, dae.x, dae.z, dae.w, dae.u)]
    point = [rng.uniform(0.1, 1.0, a.shape[0]) for a in arguments]
    point[4] = np.array([q.value or 0.5 for q in dae.parameters])
    dx, x, z, w, u = (np.asarray(J) for J in ca.Function("slopes", arguments, of)(*point))
    n = dae.residual.shape[0]
    inner, caused = np.hstack([S * dx + x, z]), np.hstack([w, u])
    G = caused[n:] - inner[n:] @ np.linalg.solve(inner[:n], caused[:n])
    return np.hstack([G, np.eye(len(G))])


@pytest.mark.parametrize("name", sorted(PLANTS))
def test_what_is_told_apart_is_what_acts_on_the_outputs_in_another_way(name):
    dae = compile_model(PLANTS[name]())
    found, G = isolability(dae), transfer(dae)
    size = np.linalg.norm(G, axis=0)
    seen = size > 1e-9 * size.max()
    assert found.seen.tolist() == seen.tolist()
    unit = G / np.where(seen, size, 1.0)
    common = np.abs(unit.conj().T @ unit)
    assert found.apart.tolist() == (seen[:, None] & (common < 1 - 1e-9)).tolist()


def two_masses(**outputs: str) -> Model:
    return Model(
        name="two masses",
        components={
            "motor": Force(),
            "one": Mass(m=1.0),
            "spring": Spring(k=3.0),
            "two": Mass(m=2.0),
            "a": PositionSensor(),
            "b": PositionSensor(),
        },
        connections=[
            ("motor.flange", "one.flange"),
            ("one.flange", "spring.flange_a"),
            ("spring.flange_b", "two.flange"),
            ("a.flange", "one.flange"),
            ("b.flange", "two.flange"),
        ],
        inputs={"F": "motor.f"},
        outputs=outputs,
    )


def test_a_second_position_tells_on_which_mass_a_force_acts():
    both = compile_model(two_masses(x="a.s", y="b.s"))
    assert set(isolability(both).alike("two")) == set()
    assert set(isolability(both).alike("one")) == {"input:F"}
    assert set(isolability(both, ["x"]).alike("two")) == {"one", "input:F", "sensor:x"}
    assert isolability(both, ["x"]).classes == [("one", "two", "input:F", "sensor:x")]
    states = [q.name for q in both.states]
    assert telling(both, "two", ["one"], [["x"]], states) == ["two.s", "two.v"]
    assert telling(both, "two", ["one"], [["x"]], ["two.v"]) == ["two.v"]
    assert telling(both, "one", ["input:F"], [["x", "y"]], states) == []


def test_units_do_not_matter():
    model = two_masses(x="a.s", y="b.s")
    heavy = {**model.components, "one": Mass(m=1e6), "two": Mass(m=2e9), "spring": Spring(k=1e3)}
    assert set(isolability(compile_model(replace(model, components=heavy))).alike("two")) == set()


def test_two_outputs_that_read_the_same_tell_no_more_than_one():
    twice = two_masses(x="spring.s_rel", y="spring.f")
    assert set(isolability(compile_model(twice)).alike("two")) == {"one", "input:F"}


def test_what_no_output_shows_is_not_seen_and_stands_in_the_text_of_a_model():
    model = two_masses(x="a.s")
    components = {**model.components, "idle": Mass(m=1.0), "c": PositionSensor()}
    alone = replace(model, components=components, connections=[*model.connections, ("c.flange", "idle.flange")])
    found = isolability(compile_model(alone))
    assert found.unseen == ("idle",)
    assert "idle" not in {name for names in found.classes for name in names}
    assert "idle: not seen at all" in describe(alone, 120)
    assert "one, two, input:F, sensor:x: one as well as another" in describe(alone, 120)
