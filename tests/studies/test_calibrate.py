"""The study of false alarms and power: what it conceals at which strength, and what it counts."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parent))  # scripts import each other by name; at the end, for one of them is called coverage
import calibrate

from backsight.data.cases.case import Drawn
from backsight.data.cases.suite import benches, write_case

KINDS = {kind.name: kind for kind in calibrate.kinds([], [], range(1, 2))}


def answer(**row: object) -> dict:
    return {"place": "carriage", "physics": "coulomb_friction", "parameter": "f_c", "minimum_strength": 0.5, "unit": "N"} | row


def test_every_plant_has_clean_machines_wrong_parameters_and_effects() -> None:
    for bench in benches:
        cases = [k.case for k in KINDS.values() if k.bench is bench]
        assert sum(case.strength == "none" for case in cases) >= 9
        assert sum(case.strength == "parameter" for case in cases) >= 3
        assert sum(case.strength not in ("none", "parameter") for case in cases) >= 5
    assert len({(k.seed, k.bench.plant) for k in KINDS.values()}) == len(KINDS)  # a machine of its own each


def test_the_size_is_that_of_the_least_strength_that_would_have_been_shown() -> None:
    kind = KINDS["actuator.coulomb.1"]
    size = calibrate.unit_size(kind, [answer(physics="spring", parameter="k"), answer()])
    drawn = Drawn(values={**kind.bench.base, **kind.bench.known}, size=1.0)
    (effect,) = calibrate.sized(kind.case, 3 * size).effects(drawn)
    assert effect.parameters["f_c"][0] == pytest.approx(1.5)
    gain = KINDS["five_bar.encoder_gain-theta_2.1"]  # nothing is a gain of 1
    row = answer(place="sensor:theta_2", physics="sensor_gain", parameter="gain", minimum_strength=0.01)
    (effect,) = calibrate.sized(gain.case, 3 * calibrate.unit_size(gain, [row])).effects(drawn)
    assert effect.parameters["gain"][0] == pytest.approx(1.03)
    assert np.isnan(calibrate.unit_size(kind, [answer(place="screw", physics="spring")]))


def test_a_wrong_parameter_counts_where_recordings_would_have_shown_it() -> None:
    least = {"place": "carriage", "physics": "wrong_parameter", "parameter": "carriage.m"}
    values = {"carriage.m": 100.0}
    assert calibrate.shown("carriage.m", values, [least | {"minimum_strength": 10.0}])
    assert not calibrate.shown("carriage.m", values, [least | {"minimum_strength": 20.0}])
    assert not calibrate.shown("carriage.m", values, [least | {"minimum_strength": None}])
    assert calibrate.shown("carriage.m", values, [])


def test_a_machine_without_its_effect_is_the_same_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kind = KINDS["actuator.coulomb.1"]
    monkeypatch.setattr(type(kind.bench), "conditions", replace(kind.bench.conditions, duration=0.2))
    silent = replace(kind.case, effects=lambda d: tuple(e.silent for e in kind.case.effects(d)), strength="none", verdict="none")
    made = [
        write_case(kind.bench, case, n, tmp_path / "cases", tmp_path / "truth", kind.seed) for n, case in (("a", kind.case), ("b", silent))
    ]
    one, other = (m.truth["base_parameters_true"] for m in made)
    assert isinstance(one, dict)
    assert isinstance(other, dict)
    assert one["friction.f_c"] > 0.0 == other["friction.f_c"]
    assert {n: v for n, v in one.items() if n != "friction.f_c"} == {n: v for n, v in other.items() if n != "friction.f_c"}
    studies = [(m.folder / "study.toml").read_text(encoding="utf-8") for m in made]
    assert studies[0] == studies[1]
    assert made[1].truth["verdict"] == "none"
