"""What all simulated machines have in common, and that the plants, written by others, move like them."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest

from backsight.data.generators import actuator, drillstring, five_bar, quadrotor, xy_table
from backsight.estimation import Recording
from backsight.models import compile_model, simulate
from backsight.models.plants import PLANTS

MACHINES = {"actuator": actuator, "drillstring": drillstring, "five_bar": five_bar, "quadrotor": quadrotor, "xy_table": xy_table}
# How far from the plant's motion, as a share of the largest value: the drillstring goes on from events, each found to 1e-9 s or so.
AGREE = {"actuator": 1e-10, "drillstring": 1e-6, "five_bar": 1e-9, "quadrotor": 1e-8, "xy_table": 1e-8}
SECONDS = {"actuator": 1.0, "drillstring": 15.0, "five_bar": 1.0, "quadrotor": 3.0, "xy_table": 0.6}

each = pytest.mark.parametrize(("name", "machine"), MACHINES.items())


def short(name: str, machine: ModuleType, **changes: object):
    return replace(machine.CONDITIONS, **{"duration": SECONDS[name], **changes})


@each
def test_the_plant_moves_like_the_machine_under_its_inputs_with_other_parameters_too(name: str, machine: ModuleType) -> None:
    dae, rng = compile_model(PLANTS[name]()), np.random.default_rng(7)
    info = {p.name: p.value for p in dae.parameters}
    values = {p: info[p] * rng.uniform(0.9, 1.1) for p in machine.NAMES if p not in ("gear.ratio", "r", "gantry.b", "gantry.c")}
    run = machine.record(machine.with_values(values), seed=1, conditions=short(name, machine, process={}, jitter=0.3))
    start = {state.name: float(run.truth[state.name][0]) for state in dae.states}
    found = simulate(dae, run.time, run.inputs, values, start)
    for signal, told in {**found.states, **{f"clean.{k}": v for k, v in found.outputs.items()}}.items():
        true = run.truth[signal]
        assert np.abs(told - true).max() <= AGREE[name] * max(np.abs(true).max(), 1e-3), signal


@each
def test_every_parameter_of_the_plants_name_is_one_of_the_machine_with_the_same_default(name: str, machine: ModuleType) -> None:
    info = {p.name: p.value for p in compile_model(PLANTS[name]()).parameters}
    default = machine.with_values({})
    for parameter, own in machine.NAMES.items():
        assert getattr(default, own) == info[parameter], parameter


@each
def test_a_seed_gives_one_run_and_another_seed_another(name: str, machine: ModuleType) -> None:
    conditions = short(name, machine, duration=min(SECONDS[name], 0.5))
    one, same, other = (machine.record(seed=seed, conditions=conditions) for seed in (1, 1, 2))
    for output in one.outputs:
        assert np.array_equal(one.outputs[output], same.outputs[output])
        assert not np.array_equal(one.outputs[output], other.outputs[output])


@each
def test_outputs_are_the_truth_with_noise_and_make_a_recording(name: str, machine: ModuleType) -> None:
    run = machine.record(seed=1, conditions=short(name, machine))
    for output, std in run.noise.items():
        error = (run.outputs[output] - run.truth[f"clean.{output}"]) / std
        # Mean and rms of n normal values lie within 4.5 of their deviations in all but one of 100 000 cases.
        assert abs(error.mean()) < 4.5 / np.sqrt(error.size), output
        assert abs(error.std() - 1) < 4.5 / np.sqrt(2 * error.size), output
    recording = Recording(name=name, time=run.time, inputs=run.inputs, outputs=run.outputs, output_std=run.noise)
    assert recording.time.size == round(SECONDS[name] / machine.CONDITIONS.step)


@each
def test_a_process_force_moves_the_machine_and_leaves_the_noise_of_its_sensors_alone(name: str, machine: ModuleType) -> None:
    conditions = short(name, machine, duration=min(SECONDS[name], 0.5))
    size = {place: 20 * std for place, std in machine.CONDITIONS.process.items()}
    run, calm = (machine.record(seed=3, conditions=replace(conditions, process=process)) for process in (size, {}))
    for output in run.noise:
        noise = run.outputs[output] - run.truth[f"clean.{output}"]
        assert noise == pytest.approx(calm.outputs[output] - calm.truth[f"clean.{output}"], abs=1e-12), output
    assert any(np.abs(run.truth[k] - v).max() > 1e-3 * np.ptp(v) > 0 for k, v in calm.truth.items())


@each
def test_a_process_at_a_place_that_is_none_is_refused(name: str, machine: ModuleType) -> None:
    with pytest.raises(ValueError, match="no such place"):
        machine.record(conditions=short(name, machine, process={"nowhere": 1.0}))


@each
def test_an_output_that_is_not_named_is_left_out(name: str, machine: ModuleType) -> None:
    kept = next(iter(machine.CONDITIONS.noise))
    run = machine.record(conditions=short(name, machine, duration=0.3, noise={kept: machine.CONDITIONS.noise[kept]}))
    assert list(run.outputs) == [kept]
