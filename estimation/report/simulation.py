"""The page of a simulation: the recording beside what the model makes of its inputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from .answer import code, joined
from .columns import Columns
from .document import document, drawn, points_per_curve, save
from .figures import input_chart, output_chart, state_chart
from .quantities import number, percent, pretty, quantity
from .tables import table

if TYPE_CHECKING:
    from ..recordings.recording import Recording

__all__ = ["write_simulation_report"]


def write_simulation_report(
    frames: pd.DataFrame | Mapping[str, pd.DataFrame],
    recordings: Sequence[Recording],
    path: str | Path,
    *,
    model: str,
    units: Mapping[str, str],
    parameters: Mapping[str, tuple[float, str]] | None = None,
    notes: Sequence[str] = (),
) -> None:
    """Write the page of a simulation to `path`: one HTML file that opens without a network.

    frames      per recording's name (or one table for the only recording): t_s, outputs, states, one row per recorded sample
    recordings  what was measured; outputs that a recording lacks are drawn among the states
    units       of every column, and of the inputs by their names
    parameters  name -> (value, unit), to be listed
    """
    tables = {recordings[0].name: frames} if isinstance(frames, pd.DataFrame) else dict(frames)
    shown = [(r, _beside(tables[r.name], r)) for r in recordings if r.name in tables]
    kinds = [Columns.of(frame) for _, frame in shown]
    points = points_per_curve(sum(3 * len(k.outputs) + len(k.states) + len(r.inputs) for (r, _), k in zip(shown, kinds, strict=True)))
    fits = [(r.name, o, *_fit(frame, o)) for (r, frame), k in zip(shown, kinds, strict=True) for o in k.outputs]
    sections = [("fit", "Fit", _fit_table(fits, units))]
    for n, ((recording, frame), kind) in enumerate(zip(shown, kinds, strict=True)):
        which = f": {recording.name}" if len(shown) > 1 else ""
        sections += _sections(recording, frame, kind, units, points, n, which)
    listed = [[name, number(value, 6), pretty(unit)] for name, (value, unit) in (parameters or {}).items()]
    sections.append(("parameters", "Parameters", table(["parameter", "value", "unit"], listed, words=(0, 2)) if listed else ""))
    remarks = [*notes, *(["Curves are drawn by the minimum and the maximum of every bin of samples."] if _thinned(shown, points) else [])]
    sections.append(("notes", "Notes", f"<ul class=notes>{''.join(f'<li>{escape(r)}</li>' for r in remarks)}</ul>" if remarks else ""))
    page = document(
        title=f"{model}: simulation of {shown[0][0].name if len(shown) == 1 else f'{len(shown)} recordings'}",
        sub="The model under the recorded inputs, beside what was measured",
        lead=f"<p class=answer>{_answer(model, fits, units, len(shown))}</p>",
        sections=sections,
    )
    save(page, path)


def _beside(frame: pd.DataFrame, recording: Recording) -> pd.DataFrame:
    """The trajectory with the measured outputs in columns of their own."""
    measured = {f"{o}.measured": values for o, values in recording.outputs.items() if o in frame and len(values) == len(frame)}
    return frame.assign(**measured)


def _thinned(shown: Sequence[tuple[Recording, pd.DataFrame]], points: int) -> bool:
    return any(len(frame) > points for _, frame in shown)


def _fit(frame: pd.DataFrame, output: str) -> tuple[float, float, float]:
    """Rms error, fit 100 (1 - |e| / |y - mean y|) [%], and the largest error."""
    y = frame[f"{output}.measured"].to_numpy(float)
    error = y - frame[output].to_numpy(float)
    seen = np.isfinite(error)
    if not seen.any():
        return float("nan"), float("nan"), float("nan")
    size = float(np.linalg.norm(y[seen] - y[seen].mean()))
    fit = 100 * (1 - float(np.linalg.norm(error[seen])) / size) if size > 0 else float("nan")
    return float(np.sqrt(np.mean(error[seen] ** 2))), fit, float(np.abs(error[seen]).max())


def _fit_table(fits: Sequence[tuple[str, str, float, float, float]], units: Mapping[str, str]) -> str:
    rows = [
        [name, output, quantity(rms, units.get(output, "")), quantity(top, units.get(output, "")), percent(fit)]
        for name, output, rms, fit, top in fits
    ]
    head = ["recording", "output", "rms error", "largest error", "fit"]
    return table(head, rows, words=(0, 1), codes=(0, 1)) if rows else ""


def _answer(model: str, fits: Sequence[tuple[str, str, float, float, float]], units: Mapping[str, str], count: int) -> str:
    met = [
        f"{code(output)}{f' of {code(name)}' if count > 1 else ''} to <b>{escape(quantity(rms, units.get(output, '')))}</b> rms"
        f" (fit {percent(fit)})"
        for name, output, rms, fit, _ in fits
    ]
    if not met:
        return f"The model {code(model)} under the recorded inputs; nothing measured to hold against it."
    return f"The model {code(model)}, given the recorded inputs and nothing else, meets {joined(met)}."


def _sections(
    recording: Recording, frame: pd.DataFrame, kinds: Columns, units: Mapping[str, str], points: int, n: int, which: str
) -> list[tuple[str, str, str]]:
    group = f"time-{n}"
    outputs = [
        output_chart(frame, o, units.get(o, ""), recording.output_std.get(o), points=points, group=group, model="simulated")
        for o in kinds.outputs
    ]
    body = "".join(drawn(c) for c in outputs)
    others = [state_chart(frame, kinds.states, units, points=points, group=group, model="simulated")] if kinds.states else []
    if recording.inputs:
        others.append(input_chart(recording.time, recording.inputs, units, points=points, group=group, hold=recording.hold))
    return [
        (f"outputs-{n}", f"Measured and simulated{which}", body),
        (f"states-{n}", f"States and inputs{which}", "".join(drawn(c) for c in others)),
    ]
