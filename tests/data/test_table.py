"""The bundled recordings of the gantry table against their generator, their card and an energy balance that needs no model."""

from __future__ import annotations

import gzip
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import backsight.data
from backsight.data.generators import table
from backsight.data.generators.concealed.rig import Trace

TRUE = {"spindle.k": 0.275, "drive_1.J": 2.33e-3, "drive_3.J": 2.37e-4, "friction_1.tau_c": 0.473, "friction_3.tau_c": 0.149}


@pytest.fixture(scope="module")
def held_out() -> Trace:
    return table.record("table_held_out")


def test_what_the_motors_put_in_goes_into_motion_spindle_and_friction(held_out: Trace) -> None:
    """Power by hand: of the motors, less friction of all three wheels, against the change of what moves and is twisted."""
    machine = table.TABLE
    v, s, h = held_out.v, held_out.q, table.USUAL.step
    motors = held_out.acted * [machine.K_x, machine.K_y] / machine.r  # N at the wheels
    work = np.sum(motors[:-1] * np.diff(s[:, [0, 2]], axis=0))  # held from row to row
    rubbed = np.array([machine.tau_1, table.FRICTION, machine.tau_3]) / machine.r
    lost = np.sum(np.abs(np.diff(s, axis=0)) @ rubbed)

    def stored(k: int) -> float:
        M, _ = table.Gantry(table=machine).equations(s[k], v[k])
        return float(v[k] @ M @ v[k] / 2 + machine.k * ((s[k, 0] - s[k, 1]) / machine.r) ** 2 / 2)

    assert lost > 0.2 * abs(work)
    assert work - lost == pytest.approx(stored(-1) - stored(0), abs=0.02 * lost)
    assert h == pytest.approx(held_out.time[1] - held_out.time[0])


def test_the_study_lacks_the_friction_and_its_guesses_are_up_to_half_off() -> None:
    study = tomllib.loads(backsight.data.studies()["demo"].read_text())
    given = study["parameters"]
    assert given.pop("friction_2.tau_c") == 0.0  # what the demonstration is to find
    assert table.TABLE.tau_2 == table.FRICTION > 0
    assert given.keys() == TRUE.keys()
    assert {name: abs(given[name]["guess"] / value - 1) > 0.2 for name, value in TRUE.items()} == dict.fromkeys(TRUE, True)
    for recording in study["recording"]:
        columns = pd.read_csv(backsight.data.path(recording["file"]), nrows=1).columns
        assert {recording["time"], *recording["inputs"].values(), *(o["column"] for o in recording["outputs"].values())} <= set(columns)
    assert f"{table.FRICTION:g}" in backsight.data.path("table.md").read_text()


def test_another_seed_makes_another_record_of_the_same_machine() -> None:
    one, other = (table.record("table_fit", seed=seed, duration=0.3) for seed in (table.SEED, 1))
    assert one.commands.shape == other.commands.shape
    assert not np.array_equal(one.commands, other.commands)


def test_bundled_files_and_card_are_what_the_generator_writes(tmp_path: Path, held_out: Trace) -> None:
    for written in table.write(tmp_path):
        old, new = backsight.data.path(written.name).read_bytes(), written.read_bytes()
        # Compressors differ between builds of zlib, the text does not.
        assert (gzip.decompress(old) == gzip.decompress(new)) if written.suffix == ".gz" else (old == new)
        assert len(old) < 100_000
    assert table.compressed(held_out)[4:8] == b"\0\0\0\0", "a date in the header would change the bytes"
