"""How the recorded machines of `real_sets.py` and `real_diagnoses.py` are read: columns of their files, and what is held out of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from backsight.estimation import Recording

PENDULUM: dict[str, Any] = {
    "time": "t_s",
    "inputs": {"tau_1": "tau1_meas_Nm", "tau_2": "tau2_meas_Nm"},
    "outputs": {"q_1": "q1_rad", "q_2": "q2_rad"},
    "hold": "linear",
}
STAGE: dict[str, Any] = {"time": "t_s", "inputs": {"i": "i1_A"}, "outputs": {"hub": "hub1_rad"}, "hold": "linear"}


def fit_and_later(file: Path, start: float, split: float, end: float, **columns: Any) -> list[Recording]:
    """What is fitted, from start to split [s], and what is held out, from there to the end."""
    return [
        Recording.read(file, name="fit", range=(start, split), **columns),
        Recording.read(file, name="later", role="held_out", range=(split, end), **columns),
    ]
