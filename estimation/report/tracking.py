"""The page of a moving horizon: where the estimates went while the samples came in, and how long each took."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from ..wording import chance
from .answer import code, joined, with_uncertainty
from .chart import Chart
from .columns import Columns
from .document import document, drawn, points_per_curve, save
from .figures import input_chart, output_chart, residual_chart, residual_scatter, state_chart
from .quantities import count, number, percent, pretty, quantity
from .tables import facts, table

if TYPE_CHECKING:
    from ..recordings.recording import Recording
    from ..tracking import Tracking

__all__ = ["write_tracking_report"]

SETTLED = 20.0  # times the deviation at the end: a parameter is drawn from where on its own is no larger, or no larger than its value


def write_tracking_report(result: Tracking, path: str | Path, *, recordings: Sequence[Recording]) -> None:
    """Write the page of `result` to `path`: one HTML file that opens without a network. recordings: those that were tracked."""
    by_name = {r.name: r for r in recordings}
    shown = {name: (frame, Columns.of(frame)) for name, frame in result.estimates.items()}
    curves = sum(5 * len(k.outputs) + 3 * len(k.states) + 6 * len(k.residuals) for _, k in shown.values())
    points = points_per_curve(curves)
    sections = [("parameters", "Parameters", _parameters(result)), ("fit", "Fit", _fit(result))]
    for n, (name, (frame, kinds)) in enumerate(shown.items()):
        which, group, recording = f": {name}" if len(shown) > 1 else "", f"time-{n}", by_name[name]
        estimated = [p for p in kinds.states if p in result.parameters]
        states = [s for s in kinds.states if s not in estimated]
        drawn_ones = [drawn(_over_time(result, frame, estimated, points, group))] if estimated else []
        sections.append((f"over-time-{n}", f"Parameters over time{which}", "".join(drawn_ones)))
        outputs = [
            output_chart(frame, o, result.units.get(o, ""), _noise(result, o, name), points=points, group=group, model="estimated")
            for o in kinds.outputs
        ]
        sections.append((f"outputs-{n}", f"Measured and estimated{which}", "".join(drawn(c) for c in outputs)))
        sections.append((f"residuals-{n}", f"Residual forces{which}", _residuals(result, frame, kinds, points, group)))
        charts = [state_chart(frame, states, result.units, points=points, group=group, model="estimated")] if states else []
        if recording.inputs:
            charts.append(input_chart(recording.time, recording.inputs, result.units, points=points, group=group, hold=recording.hold))
        sections.append((f"states-{n}", f"States and inputs{which}", "".join(drawn(c) for c in charts)))
    sections.append(("solver", "Solver", _solver(result)))
    notes = "".join(f"<li>{escape(note)}</li>" for note in result.notes)
    sections.append(("notes", "Notes", f"<ul class=notes>{notes}</ul>" if notes else ""))
    page = document(
        title=f"{result.model}: {next(iter(shown)) if len(shown) == 1 else f'{len(shown)} recordings'} tracked",
        sub=f"Moving horizon of {result.samples} samples: every estimate is made of the samples up to its own",
        lead=f"<p class=answer>{_answer(result)}</p>",
        sections=sections,
    )
    save(page, path)


def _answer(result: Tracking) -> str:
    free = [p for p in result.parameters.values() if not p.fixed]
    ms, total = result.latency_ms, sum(result.outcomes.values())
    found = f"At the end {joined([f'{code(p.name)} is <b>{with_uncertainty(p)}</b>' for p in free])}. " if free else ""
    failed = "none failed" if not result.failed_steps else f"<b>{result.failed_steps} did not converge</b> and were predicted"
    took = f"each took {number(ms['median'], 2)} ms (median), 99 of 100 at most {number(ms['p99'], 2)} ms"
    return f"{found}{count(total)} estimates, {failed}; {took}."


def _parameters(result: Tracking) -> str:
    rows = [
        [p.name, number(p.value, 6), number(p.std, 2) if p.std else ("fixed" if p.fixed else "not determined"), pretty(p.unit)]
        for p in result.parameters.values()
    ]
    return table(["parameter", "value at the end", "standard deviation", "unit"], rows, words=(0, 3), codes=(0,)) if rows else ""


def _fit(result: Tracking) -> str:
    head = ["recording", "output", "rms of measured − estimated", "fit", "rms of prediction errors over their std", "white (p)"]
    rows = [
        [
            name,
            output,
            quantity(f.rms, result.units.get(output, "")),
            percent(f.fit_percent) if f.fit_percent is not None else "",
            "" if f.prediction_rms is None else number(f.prediction_rms, 3),
            chance(f.whiteness_p),
        ]
        for name, outputs in result.fit.items()
        for output, f in outputs.items()
    ]
    return table(head, rows, words=(0, 1), codes=(0, 1)) if rows else ""


def _over_time(result: Tracking, frame: pd.DataFrame, names: Sequence[str], points: int, group: str) -> Chart:
    """Parameters over time, from where on something is known of them."""
    known = frame[["t_s", *(c for n in names for c in (n, f"{n}.std"))]].copy()
    for name in names:
        std = known[f"{name}.std"].to_numpy(float)
        limit = max(SETTLED * std[-1], abs(float(known[name].iloc[-1]))) if np.isfinite(std[-1]) else np.inf
        known.loc[~(std <= limit), [name, f"{name}.std"]] = np.nan
    return state_chart(known, list(names), result.units, points=points, group=group, model="estimated")


def _residuals(result: Tracking, frame: pd.DataFrame, kinds: Columns, points: int, group: str) -> str:
    parts = []
    for column in kinds.residuals:
        place, unit = column.removeprefix("residual."), result.units.get(column, "")
        parts.append(f"<h3>{code(place)}</h3>{drawn(residual_chart(frame, place, unit, points=points, group=group))}")
        states = tuple(s for s in kinds.states if s not in result.parameters)
        parts.append(drawn(residual_scatter(frame, place, unit, states, result.units, points=points)))
    return "".join(parts)


def _noise(result: Tracking, output: str, recording: str) -> float | None:
    return result.weights.of_output(output, recording)


def _solver(result: Tracking) -> str:
    ms = result.latency_ms
    pairs = [
        ("window", f"{result.samples} samples, {count(result.solver.variables)} unknowns"),
        ("status", result.solver.status),
        ("time an estimate takes", ", ".join(f"{name} {number(value, 3)} ms" for name, value in ms.items())),
        ("Gauss-Newton steps", f"{result.solver.iterations / max(sum(result.outcomes.values()), 1):.2f} an estimate"),
        *((outcome.word, f"{n}: {outcome.value}") for outcome, n in result.outcomes.items()),
    ]
    return facts(pairs) + "<p class=note>Bands are ±1.96 standard deviations. All quantities in SI units, prefixed for reading.</p>"
