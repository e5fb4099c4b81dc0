"""Joints of a recorded industrial arm, smoothed with the study's models: published friction, the maker's inertia, held-out samples."""

from __future__ import annotations

import importlib
import os
from pathlib import Path
from types import ModuleType

import numpy as np
import pandas as pd
import pytest

from backsight.estimation import smooth

STUDIES = Path(__file__).resolve().parent.parent / "studies"


@pytest.fixture
def studies(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(STUDIES))
    return importlib.import_module("real_sets")


def recorded(name: str) -> Path:
    folder = os.environ.get("BACKSIGHT_DATA")
    if not folder or not (Path(folder) / "ur10e" / name).is_file():
        pytest.skip(f"needs ur10e/{name} in the folder that BACKSIGHT_DATA names")
    return Path(folder) / "ur10e" / name


@pytest.mark.slow
def test_a_recorded_joint_under_velocity_control_gives_its_published_friction_and_the_makers_inertia(studies: ModuleType) -> None:
    """Mamedov & Mikhel 2020 give 21.256 N.m.s/rad and 12.548 N.m on average over all motions of the arm; grease warms, so 15 %.

    The inertia is read off the torque that the maker's controller computes for the recorded motion.
    """
    file = recorded("joint1_only.csv")
    result = smooth(studies.joint_1(file))
    assert result.solver.converged
    assert result.parameters["friction.d"].value == pytest.approx(21.256, rel=0.15)
    assert result.parameters["friction.tau_c"].value == pytest.approx(12.548, rel=0.15)
    assert result.parameters["arm.J"].value == pytest.approx(makers_inertia(file), rel=0.25)
    # friction that the model lacks is in what is left over, and the verdict must say so
    assert result.fit["fit"]["q"].whiteness_p < 1e-3
    assert any("q: its prediction errors are not white" in note and "too small" in note for note in result.notes)
    assert result.held_out["later"].fit["q"].fit_percent > 75.0  # 18 s in one go; with an inertia of 10 kg.m2 it is 67


@pytest.mark.slow
def test_friction_that_grows_with_the_load_predicts_what_was_held_out_of_a_recorded_shoulder(studies: ModuleType) -> None:
    file = recorded("joint2_only.csv")
    without, loaded = smooth(studies.joint_2(file)), smooth(studies.joint_2_loaded(file))
    mu = loaded.parameters["teeth.mu"]
    assert mu.std is not None
    assert mu.value > 10 * mu.std
    assert 0.02 < mu.value < 0.2  # the losses of a strain wave gear under load
    assert loaded.held_out["later"].window_rms["q"] < 0.4 * without.held_out["later"].window_rms["q"]


def makers_inertia(file: Path) -> float:
    """Slope of the maker's torque over the acceleration, both as sines: the motion is one sine of a known period after its start."""
    table = pd.read_csv(file)
    table = table[(table.t_s > 5.0) & (table.t_s < 55.0)]
    t, rate, torque = (table[c].to_numpy() for c in ("t_s", "qd1_radps", "tau1_des_Nm"))
    frequencies = np.linspace(0.02, 0.5, 2000)
    power = [abs(np.sum(rate * np.exp(-2j * np.pi * f * t))) for f in frequencies]
    w = 2 * np.pi * frequencies[int(np.argmax(power))]
    basis = np.column_stack([np.sin(w * t), np.cos(w * t), np.ones_like(t)])
    (s, c, _), (s_tau, c_tau, _) = (np.linalg.lstsq(basis, y, rcond=None)[0] for y in (rate, torque))
    acceleration = np.array([-w * c, w * s])  # of sine and cosine
    return float(acceleration @ [s_tau, c_tau] / (acceleration @ acceleration))
