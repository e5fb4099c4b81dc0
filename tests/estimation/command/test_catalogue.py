"""What `backsight models NAME --json` hands to other programs."""

from __future__ import annotations

import json
from pathlib import Path

from backsight.estimation.command.catalogue import catalogue, description, details
from backsight.estimation.command.output import json_text

BLIND = """
from backsight.models import Model
from backsight.models.mechanics.translational import Damper, Fixed, Mass, VelocitySensor

def coast():
    return Model(
        name="coast",
        components={"body": Mass(m=2.0), "damper": Damper(d=0.7), "ground": Fixed(), "radar": VelocitySensor()},
        connections=[("body.flange", "damper.flange_a"), ("damper.flange_b", "ground.flange"), ("radar.flange", "body.flange")],
        outputs={"v": "radar.v"},
    )
"""


def test_a_coasting_body_tells_a_ratio_and_not_where_it_is(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "coast.py").write_text(BLIND)
    monkeypatch.chdir(tmp_path)
    found = json.loads(json_text(details("coast.py:coast")))
    told = found["identifiability"]
    assert told["identifiable"] == {"body.m": False, "damper.d": False}
    assert told["combinations"] == [{"parameters": {"body.m": 1.0, "damper.d": 1.0}, "kind": "factor", "states": []}]
    assert told["unobservable"] == ["body.s"]
    assert found["components"]["body"] == {"kind": "Mass", "parameters": {"m": 2.0}}
    assert "unobservable from v: body.s" in description("coast.py:coast")


def test_every_plant_has_a_sentence_and_says_what_its_outputs_tell() -> None:
    assert all(text for text in catalogue().values())
    assert details("actuator")["identifiability"]["notes"] == ["all 4 parameters can be told from x"]
