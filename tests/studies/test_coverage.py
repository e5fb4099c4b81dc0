"""The study of coverage: what it draws, what it says of made-up runs, and that failing runs do not stop it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from studies import coverage

from backsight.models import compile_model
from backsight.models.plants import PLANTS


@pytest.mark.parametrize("plant", coverage.CASES)
def test_a_seed_draws_a_machine_within_its_range_and_guesses_a_factor_of_three_off(plant: str) -> None:
    default = defaults(plant)
    assert coverage.machine(plant, 0, default) == coverage.machine(plant, 0, default) != coverage.machine(plant, 1, default)
    for one in drawn(plant):
        assert set(one.truth) == set(coverage.CASES[plant].free)
        for name, true in one.truth.items():
            assert 0.7 <= true / default[name] <= 1.3
            assert max(one.guess[name] / true, true / one.guess[name]) == pytest.approx(3.0)


def test_drawn_machines_can_do_what_is_asked_and_guesses_are_bodies() -> None:
    quadrotors, arms, strings = drawn("quadrotor"), drawn("five_bar"), drawn("drillstring")
    assert all(np.sqrt(1.5 * 9.81) / 2 / one.truth["rotor.gain"] <= 0.85 for one in quadrotors)
    assert all(values["P_4"] * values["P_6"] > values["P_5"] ** 2 for one in arms for values in (one.truth, one.guess))
    assert all(1.2 <= one.known["bit.tau_st"] / one.truth["bit.tau_sl"] <= 1.8 for one in strings)


def drawn(plant: str) -> list[coverage.Machine]:
    default = defaults(plant)
    return [coverage.machine(plant, seed, default) for seed in range(20)]


def defaults(plant: str) -> dict[str, float]:
    return {p.name: p.value for p in compile_model(PLANTS[plant]()).parameters}


def test_the_smoother_gets_the_recording_the_noise_and_what_is_known_and_not_the_truth() -> None:
    problem, machine = coverage.pose("drillstring", 0)
    (recording,) = problem.fitted
    assert dict(recording.output_std) == dict(coverage.CASES["drillstring"].generator.CONDITIONS.noise)
    assert problem.parameters["bit.tau_st"] == machine.known["bit.tau_st"]
    assert {name: problem.parameters[name].guess for name in machine.truth} == machine.guess
    assert not problem.weights.W


def run(z: float, *, true: float = 2.0, std: float = 0.1) -> dict:
    parameters = {"k": {"truth": true, "guess": 3 * true, "value": true + z * std, "std": std}}
    return {"status": "converged", "seconds": 1.0, "parameters": parameters}


def test_the_table_tells_bias_spread_and_coverage_of_the_runs_that_converged() -> None:
    z = np.array([-3.0, -1.0, 0.0, 1.0, 1.5, 2.5])
    lost = [{"status": "time limit of 9 s", "seconds": 9.0, "limit": 9.0}, {"status": "failed", "seconds": None, "limit": 0.0}]
    text = coverage.table("plant", [*map(run, z), *lost])
    assert "6 of 8 runs converged; median 1 s, longest 9 s" in text
    assert "1 x time limit of 9 s" in text
    row = text.splitlines()[-1].split()
    # error in % is 5 z; the mean of z is 1/6
    assert [float(row[i]) for i in (1, 4, 5, 6)] == pytest.approx([5 / 6, -15.0, 5.0, 1 / 6], abs=6e-3)
    assert float(row[9]) == pytest.approx(z.std(ddof=1), abs=6e-3)
    assert row[10:] == ["4", "of", "6"]


def test_a_run_that_breaks_or_takes_too_long_is_an_outcome_and_not_an_end() -> None:
    broken = coverage.worker("no such plant", 0, disturbed=True, limit=60)
    assert broken["status"].startswith("failed with exit status 1: KeyError")
    late = coverage.worker("actuator", 0, disturbed=True, limit=0.2)
    assert late == {"status": "time limit of 0.2 s", "seconds": 0.2, "limit": 0.2}


def test_finished_runs_are_not_run_again(tmp_path: Path) -> None:
    out = tmp_path / "runs.json"
    out.write_text(json.dumps({"actuator 0": run(0.5), "actuator 1": run(-0.5)}))
    before = out.read_text()
    command = [sys.executable, str(Path(coverage.__file__)), "--plants", "actuator", "--seeds", "2", "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert "2 runs, 2 of them done before" in done.stdout
    assert "2 of 2 runs converged" in done.stdout
    assert out.read_text() == before
