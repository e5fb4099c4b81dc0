"""Couplings that were thought to be rigid: where they are, that a stiff one is the rigid one again, and the resonance they are given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigvals

from backsight.estimation.diagnosis.candidates.couplings import bodies_behind, of_coupling, of_soft, place_of
from backsight.estimation.diagnosis.candidates.laws import Motion
from backsight.estimation.diagnosis.candidates.places import elements
from backsight.estimation.diagnosis.search.refit import begun, posed
from backsight.estimation.problem import Free, Problem
from backsight.estimation.recordings.recording import Recording
from backsight.models import Model, compile_model, simulate
from backsight.models.mechanics.rotational import AngleSensor, Inertia, RotationalRigid, Torque, TorqueSensor
from backsight.models.mechanics.translational import SpringDamper
from backsight.models.plants import PLANTS, actuator, xy_table

MOTION = Motion(v_rms=0.2, low=-0.1, high=0.1)


@pytest.mark.parametrize(
    ("plant", "expected"),
    [
        ("actuator", {"screw": "screw"}),
        ("xy_table", {"spindle": "drive_1", "belt_1": "drive_1", "belt_2": "drive_2", "belt_3": "drive_3"}),
        ("drillstring", {"string": "rotary_table"}),
    ],
)
def test_a_coupling_is_at_the_body_that_drives_it(plant, expected):
    model = PLANTS[plant]()
    assert {spot.name: place_of(model, spot) for spot in elements(model)} == expected


def screws(physics: str) -> list:
    model = actuator()
    (screw,) = elements(model)
    return [c for c in of_coupling(model, screw, MOTION, {"carriage": 95.0}, {}) if c.physics == physics]


def test_a_screw_may_be_soft_or_loose_and_the_encoder_at_either_end():
    for physics in ("compliance", "backlash"):
        ends = {
            next(b for a, b in c.edited(actuator()).connections if a.startswith("encoder") or b.startswith("encoder"))
            for c in screws(physics)
        }
        assert ends == {"screw.flange_a", "screw.flange_b"}
        assert all(c.dear and c.place == "screw" for c in screws(physics))


def test_soft_screws_resonate_where_they_say():
    found = {round(swing(c.edited(actuator()), {"offset.f": 0.0}), 6) for c in screws("compliance")}
    guesses = {c.start["screw.k"][0] for c in screws("compliance")}
    assert len(guesses) == len(found)
    reduced = 1 / (1 / 95.0 + 1 / (0.3 * 95.0))  # of the masses at its ends
    m = actuator().components["carriage"].parameters["m"]
    actual = 1 / (1 / m + 1 / (0.3 * 95.0))
    assert sorted(found) == pytest.approx([np.sqrt(k / actual) / (2 * np.pi) for k in sorted(guesses)], rel=1e-4)
    assert reduced == pytest.approx(actual, rel=1e-3)


def test_a_belt_behind_which_there_is_no_body_but_a_joint_is_tried_as_stiff_as_what_the_joint_moves():
    model = xy_table()
    spots = {s.name: s for s in elements(model)}
    masses = {"slide_1": 3.8, "slide_2": 3.8, "end_effector": 2.3}
    assert bodies_behind(model, "belt_1", "belt_1.flange_b", "m") == ["slide_1"]
    assert bodies_behind(model, "belt_3", "belt_3.flange_b", "m") == sorted(masses)
    found = [c for c in of_coupling(model, spots["belt_3"], MOTION, masses, {}) if c.physics == "compliance"]
    assert {c.place for c in found} == {"drive_3"}
    swings = sorted(swing(c.edited(model), {"spindle.k": 0.0}) for c in found)
    assert swings[0] < 30.0 < swings[-1]  # Hz: guesses lie about what such belts have


def swing(model: Model, values: dict[str, float]) -> float:
    """The fastest rate at which a model at rest swings [Hz], without friction."""
    dae = compile_model(model)
    free = {p.name: 0.0 for p in dae.parameters if p.name.endswith((".d", ".tau_c", ".f_c"))}
    p, F, nx, nz = dae.parameter_values({**free, **values}), dae.function(), len(dae.states), len(dae.algebraics)
    at = [np.zeros(n) for n in (nx, nx, nz, len(dae.inputs))]

    def column(which: int, i: int) -> np.ndarray:
        there = [z.copy() for z in at]
        there[which][i] = 1.0
        moved, still = (np.asarray(F(*a, p, np.zeros(len(dae.places)), 0.0)[0]).ravel() for a in (there, at))
        return moved - still

    A = np.column_stack([column(1, i) for i in range(nx)] + [column(2, i) for i in range(nz)])
    E = np.column_stack([column(0, i) for i in range(nx)] + [np.zeros(len(A)) for _ in range(nz)])
    rates = np.abs(eigvals(-A, E))
    return float(rates[np.isfinite(rates) & (rates < 1e6)].max() / (2 * np.pi))


def test_a_screw_that_is_nearly_rigid_moves_as_a_rigid_one_with_both_masses():
    time = 1e-3 * np.arange(400)
    force = {"F": 80.0 * np.sin(20 * time)}
    c = screws("compliance")[0]
    (body,) = (name.partition(".")[0] for name in c.start if name.endswith(".m"))
    stiff = {"screw.k": 1e9, "screw.d": 1e6, f"{body}.m": 28.0, "carriage.m": 67.0, "friction.f_c": 0.0}
    soft = simulate(compile_model(c.edited(actuator())), time, force, parameters=stiff)
    rigid = simulate(compile_model(actuator()), time, force, parameters={"carriage.m": 95.0, "friction.f_c": 0.0})
    assert soft.outputs["x"] == pytest.approx(rigid.outputs["x"], abs=1e-6 + 1e-3 * np.abs(rigid.outputs["x"]).max())


def test_a_screw_with_play_passes_no_force_within_it():
    c = screws("backlash")[0]
    dae = compile_model(c.edited(actuator()))
    assert "screw.f" in dae.variables
    names = [q.name for q in dae.states]
    gap = c.start["screw.gap"][0]

    def force(apart: float) -> float:
        x = np.zeros(len(names))
        x[names.index("screw_mass.s")] = apart
        nothing = [np.zeros(n) for n in (len(names), len(dae.algebraics), len(dae.inputs), len(dae.places))]
        return float(dae.probe("screw.f")(nothing[0], x, nothing[1], nothing[2], dae.parameter_values(), nothing[3], 0.0))

    k = c.start["screw.k"][0]
    assert abs(force(0.0)) < 1e-6 * k * gap
    assert force(3 * gap) - force(2 * gap) == pytest.approx(k * gap, rel=0.02)
    assert force(-2 * gap) == pytest.approx(-force(2 * gap))
    assert abs(force(0.2 * gap)) < 0.02 * force(2 * gap)


def test_play_that_is_kept_is_rounded_and_damped_by_what_was_found_of_it():
    rigid, soft = actuator(), actuator("compliant")
    (spot,) = (s for s in elements(soft) if s.name == "screw")
    loose = [c for c in of_soft(soft, spot, MOTION, {"carriage": 75.0}, {"screw.k": 4e6, "screw.d": 300.0}) if c.physics == "backlash"]
    for model, found, damped in ((rigid, screws("backlash"), True), (soft, loose, False)):
        for c in found:
            known = {p.name: p for p in compile_model(c.edited(model)).parameters}
            ((width, (gap, share)),) = c.rounded.items()
            # where play is sought by steps from several guesses no corner is sharper than that of the largest
            sharpest = max(other.start[gap][0] for other in found) if damped else c.start[gap][0]
            assert known[width].value == pytest.approx(share * sharpest)
            assert bool(c.later) is damped
            assert all(known[name].value == pytest.approx(guess) for name, (guess, _, _) in c.later.items())


def test_what_is_no_rigid_coupling_or_has_no_mass_behind_it_is_left_alone():
    model = actuator()
    (screw,) = elements(model)
    assert of_coupling(model, screw, MOTION, {}, {}) == []
    soft = actuator(screw="compliant")
    (screw,) = elements(soft)
    assert of_coupling(soft, screw, MOTION, {"carriage": 75.0, "motor_mass": 20.0}, {}) == []


def test_a_cell_in_series_stays_where_it_is_and_a_coupling_that_never_turned_has_no_play():
    """A torque cell before a rigid shaft: a sensor at the shaft, and yet what the torque goes through."""
    model = Model(
        name="brake",
        components={
            "source": Torque(), "rotor": Inertia(J=0.1), "cell": TorqueSensor(), "shaft": RotationalRigid(), "disc": Inertia(J=0.4),
            "encoder": AngleSensor(),
        },
        connections=[
            ("source.flange", "rotor.flange"), ("rotor.flange", "cell.flange_a"), ("cell.flange_b", "shaft.flange_a"),
            ("shaft.flange_b", "disc.flange"), ("encoder.flange", "shaft.flange_a"),
        ],
        inputs={"tau": "source.tau"},
        outputs={"tau_s": "cell.tau", "phi": "encoder.phi"},
    )  # fmt: skip
    (shaft,) = (spot for spot in elements(model) if spot.name == "shaft")
    masses = {"rotor": 0.1, "disc": 0.4}
    found = of_coupling(model, shaft, MOTION, masses, {})
    assert {c.physics for c in found} == {"compliance", "backlash"}
    ends = set()
    for c in found:
        edited = c.edited(model)
        compile_model(edited)
        assert {("rotor.flange", "cell.flange_a"), ("cell.flange_b", "shaft.flange_a")} <= set(edited.connections)
        ends |= {b for a, b in edited.connections if a == "encoder.flange"}
    assert ends == {"shaft.flange_a", "shaft.flange_b"}
    still = of_coupling(model, shaft, replace(MOTION, low=0.0, high=0.0), masses, {})
    assert {c.physics for c in still} == {"compliance"}


def test_play_in_a_coupling_that_is_soft_already_takes_the_place_of_its_softness():
    model = actuator("compliant")
    (spot,) = (s for s in elements(model) if s.name == "screw")

    for c in of_soft(model, spot, MOTION, {"carriage": 75.0}, {"screw.k": 4e6, "screw.d": 300.0}):
        assert c.exchanged == (["screw"] if c.physics == "backlash" else [])


def test_a_coupling_in_two_sections_leaves_others_alone_whose_names_end_like_its_own():
    model = actuator("compliant")
    (spot,) = (s for s in elements(model) if s.name == "screw")
    second = SpringDamper(k=1e5, d=0.0)
    beside = replace(
        model,
        components={**model.components, "other_screw": second},
        connections=(*model.connections, ("other_screw.flange_a", "screw.flange_a"), ("other_screw.flange_b", "screw.flange_b")),
    )
    (section,) = (c for c in of_soft(beside, spot, MOTION, {"carriage": 75.0}, {"screw.k": 4e6}) if c.physics == "compliance")
    ends = {end for pair in section.edited(beside).connections for end in pair}
    assert "other_screw.flange_b" in ends
    compile_model(section.edited(beside))


def test_a_string_in_two_sections_begins_as_what_it_was_in_one():
    """As soft, and with all that turns at its end as heavy: the rest of the motion hangs on that where a bit sticks and slips."""
    model = PLANTS["drillstring"]()
    (spot,) = (s for s in elements(model) if s.name == "string")
    known = {"string.k": 0.08, "rotary_table.J": 0.3, "bha.J": 0.09}
    found = [c for c in of_soft(model, spot, MOTION, {"rotary_table": 0.3, "bha": 0.09}, known) if c.physics == "compliance"]
    stiff_at = {"string_2.flange_a": 0, "string_2.flange_b": 1}
    free = {**{name: Free(value, 0.0, 10.0) for name, value in known.items()}, "rotary_table.J": 0.3}
    time = np.arange(5) / 10
    problem = Problem(
        model=model,
        recordings=[Recording(name="r", time=time, inputs={"V": 0 * time}, outputs={"I_m": 0 * time, "Omega_r": time})],
        parameters=free,
    )
    outer = set()
    for c in found:
        edited = posed(problem, model, c, begun(c, None, known))[0]
        p = {name: v.guess if isinstance(v, Free) else v for name, v in edited.parameters.items()}
        assert p["string.k"] * p["string_2.k"] / (p["string.k"] + p["string_2.k"]) == pytest.approx(0.08)
        # what the study knows of the table stays what it is
        assert p["rotary_table.J"] == 0.3
        behind = p["bha.J"] + p["string_section.J"]
        ends = {a if b.startswith("bha.") else b for a, b in c.edited(model).connections if "bha." in a + b and "string" in a + b}
        assert behind == pytest.approx(0.09 if ends == {"string_2.flange_b"} else 0.09 + 0.03)
        outer |= {
            stiff_at[end] for pair in c.edited(model).connections for end in pair if end in stiff_at and "section" not in "".join(pair)
        }
    assert outer == {0, 1}
