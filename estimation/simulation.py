"""The model under the recorded inputs, beside the recordings."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from backsight.models import Dae

from .recordings.drive import run
from .recordings.recording import Recording
from .results import OutputFit
from .study.study import Study
from .validation.fit import output_fit
from .workers import workers


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """What the model does under the inputs of each recording.

    model          its name
    parameters     every parameter's value, SI
    estimates      recording -> table of t_s, outputs and states at the recorded times
    fit            recording -> output -> how well the measured samples are met
    units          column or input -> unit
    seconds        spent integrating, build_seconds before that
    """

    model: str
    parameters: dict[str, float]
    estimates: dict[str, pd.DataFrame]
    fit: dict[str, dict[str, OutputFit]]
    units: dict[str, str]
    seconds: float
    build_seconds: float


def simulate_study(
    study: Study,
    estimated: Mapping[str, float] | None = None,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    progress: Callable[[str], None] | None = None,
) -> Simulation:
    """Simulate every recording of a study from rest, or from its [initial] values; free parameters stand at their guess.

    estimated   parameters that take the place of the study's, SI
    jobs        processes over which several recordings are spread
    scheduler   address of a Dask cluster to do it on instead
    progress    is told what is being done

    Raises InputError for a study that cannot be simulated, SolveError where the integration fails.
    """
    say = progress or (lambda _: None)
    began = time.perf_counter()
    say("reading the recordings")
    values, initial, recordings = {**study.values(), **(estimated or {})}, study.initial(), study.recordings
    dae = study.dae
    built = time.perf_counter()
    say(f"simulating {len(recordings)} recording{'s' * (len(recordings) > 1)}")
    if len(recordings) == 1 or (jobs == 1 and scheduler is None):
        with workers(jobs, scheduler):
            frames = [simulate_recording(dae, recording, values, initial) for recording in recordings]
    else:
        with workers(jobs, scheduler) as pool:
            frames = [
                f.result() for f in [pool.submit(_simulate_nth, study.path, study.file.model, k, values) for k in range(len(recordings))]
            ]
    units = {q.name: q.unit for q in (*dae.inputs, *dae.outputs, *dae.states)}
    return Simulation(
        model=dae.name,
        parameters={p.name: values.get(p.name, p.value) for p in dae.parameters},
        estimates={recording.name: frame for recording, frame in zip(recordings, frames, strict=True)},
        fit={
            recording.name: {name: output_fit(y, frame[name].to_numpy()) for name, y in recording.outputs.items()}
            for recording, frame in zip(recordings, frames, strict=True)
        },
        units={"t_s": "s"} | units,
        seconds=time.perf_counter() - built,
        build_seconds=built - began,
    )


def simulate_recording(dae: Dae, recording: Recording, parameters: Mapping[str, float], initial: Mapping[str, float]) -> pd.DataFrame:
    """t_s, every output and every state of the model at the times of the recording, under its inputs."""
    found = run(dae, recording, parameters, initial)
    return pd.DataFrame({"t_s": found.t} | dict(found.outputs) | dict(found.states))


def _simulate_nth(study: Path, model: str, k: int, values: Mapping[str, float]) -> pd.DataFrame:
    """The k-th recording of a study file, in a worker: equations do not travel between processes, files do."""
    own = Study.read(study).of(model)
    return simulate_recording(own.dae, own.recordings[k], values, own.initial())
