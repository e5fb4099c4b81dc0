"""The report of a smoothing: the answer in words, then tables and charts that let the reader check it."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .answer import answer, code, noise_std, oddities
from .columns import Columns
from .document import document, drawn, points_per_curve, save
from .figures import input_chart, output_chart, profile_chart, residual_chart, residual_scatter, state_chart, whiteness_chart
from .quantities import count, quantity
from .tables import correlation_table, criteria_facts, facts, fit_table, parameter_table, prediction_table, profile_table, weight_table

if TYPE_CHECKING:
    from ..recordings.recording import Recording
    from ..results import Prediction, Smoothing

__all__ = ["write_report"]

ABREAST = 3  # charts of profiles side by side


def write_report(result: Smoothing, path: str | Path, *, recordings: Sequence[Recording]) -> None:
    """Write the report of `result` to `path`: one HTML file that opens without a network.

    recordings: those the result was made from, in any order; they give the page the kind of hold and the stated noise. Long ones are
    drawn by the minimum and maximum of every bin, which the page says.
    """
    by_name = {r.name: r for r in recordings}
    names = [r.name for r in recordings if r.name in result.estimates] + [n for n in result.estimates if n not in by_name]
    points = points_per_curve(sum(_curves(result, n) for n in names) + 3 * sum(len(p.fit) for p in result.held_out.values()))
    longest = max((len(result.estimates[n]) for n in names), default=0)
    sections = [("parameters", "Parameters", parameter_table(result) + correlation_table(result) if result.parameters else "")]
    criteria = criteria_facts(result.criteria) if result.criteria is not None else ""
    sections.append(("fit", "Fit", fit_table(result.fit, result) + criteria if result.fit else ""))
    sections.append(("profiles", "Profile likelihood", _profiles(result)))
    for k, name in enumerate(names):
        which = f": {name}" if len(names) > 1 else ""
        kinds = Columns.of(result.estimates[name])
        recording = by_name.get(name)
        sections.append((f"outputs-{k}", f"Measured and smoothed{which}", _outputs(result, name, kinds, recording, points, k)))
        sections.append((f"residuals-{k}", f"Residual forces{which}", _residuals(result, name, kinds, points, k)))
        sections.append((f"states-{k}", f"States and inputs{which}", _states(result, name, kinds, recording, points, k)))
    for k, (name, prediction) in enumerate(result.held_out.items()):
        page_of = _held_out(result, name, prediction, by_name.get(name), points, len(names) + k)
        sections.append((f"held-out-{k}", f"Held out: {name}", page_of))
    sections.append(("weights", "Weights", _weights(result)))
    sections.append(("solver", "Solver", _solver(result, points, longest)))
    unused = [r.name for r in recordings if r.name not in result.estimates and r.name not in result.held_out]
    page = document(
        title=f"{result.model}: {names[0] if len(names) == 1 else f'{len(names)} recordings'}",
        sub="Whole-horizon smoothing: states, residual forces and parameters with their uncertainties",
        lead=f"<p class=answer>{answer(result, recordings)}</p>{_odd(oddities(result, recordings), unused)}",
        sections=sections,
    )
    save(page, path)


def _curves(result: Smoothing, name: str) -> int:
    """Curves of one recording, a band counting as two, and the clouds of dots beside each residual."""
    kinds = Columns.of(result.estimates[name])
    return 5 * len(kinds.outputs) + 3 * len(kinds.states) + 6 * len(kinds.residuals) + len(result.inputs.get(name, {}))


def _odd(sentences: Sequence[str], unused: Sequence[str]) -> str:
    aside = f"<p class=note>Not part of this estimation: {', '.join(code(n) for n in unused)}.</p>" if unused else ""
    if not sentences:
        calm = "Nothing looks odd: the errors have the stated size and next to no memory, and no residual force follows the motion."
        return f'<div class="odd none">{calm}</div>{aside}'
    items = "".join(f"<li>{s}</li>" for s in sentences)
    return f"<div class=odd><b>Worth a look</b><ul>{items}</ul></div>{aside}"


def _outputs(result: Smoothing, name: str, kinds: Columns, recording: Recording | None, points: int, k: int) -> str:
    frame = result.estimates[name]
    charts = [
        output_chart(frame, o, result.units.get(o, ""), noise_std(result, o, recording), points=points, group=f"time-{k}")
        for o in kinds.outputs
    ]
    return "".join(drawn(c) for c in charts) + drawn(whiteness_chart(frame, kinds.outputs, label=f"autocorrelation_{k}"))


def _residuals(result: Smoothing, name: str, kinds: Columns, points: int, k: int) -> str:
    parts, frame = [], result.estimates[name]
    for column in kinds.residuals:
        place = column.removeprefix("residual.")
        if not np.isfinite(frame[column].to_numpy(float)).any():
            continue
        summary = result.residual_places.get(place)
        unit = summary.unit if summary is not None else result.units.get(column, "")
        parts.append(f"<h3>{code(place)}</h3>{drawn(residual_chart(frame, place, unit, points=points, group=f'time-{k}'))}")
        parts.append(drawn(residual_scatter(frame, place, unit, kinds.states, result.units, points=points)))
    return "".join(parts)


def _held_out(result: Smoothing, name: str, prediction: Prediction, recording: Recording | None, points: int, k: int) -> str:
    """Measured and predicted outputs: nothing but the start was taken from the recording."""
    kinds = Columns.of(prediction.estimates)
    said = "".join(f"<p>{escape(note)}</p>" for note in result.notes if note.startswith(f"Held out: {name}"))
    charts = [
        output_chart(
            prediction.estimates,
            o,
            result.units.get(o, ""),
            noise_std(result, o, recording),
            points=points,
            group=f"time-{k}",
            model="predicted",
        )
        for o in kinds.outputs
    ]
    return said + prediction_table(prediction, result.units) + "".join(drawn(c) for c in charts)


def _states(result: Smoothing, name: str, kinds: Columns, recording: Recording | None, points: int, k: int) -> str:
    frame, inputs = result.estimates[name], result.inputs.get(name, {})
    charts = []
    if kinds.states:
        charts.append(state_chart(frame, kinds.states, result.units, points=points, group=f"time-{k}", model="smoothed"))
    if inputs:
        hold = recording.hold if recording is not None else "zero"
        charts.append(input_chart(frame["t_s"].to_numpy(float), inputs, result.units, points=points, group=f"time-{k}", hold=hold))
    return "".join(drawn(c) for c in charts)


def _profiles(result: Smoothing) -> str:
    profiles = list(result.profiles.values())
    rows = [profiles[k : k + ABREAST] for k in range(0, len(profiles), ABREAST)]
    return profile_table(result.profiles) + "".join(drawn(profile_chart(row)) for row in rows) if profiles else ""


def _weights(result: Smoothing) -> str:
    notes = "".join(f"<li>{escape(note)}</li>" for note in result.notes)
    return weight_table(result) + (f"<ul class=notes>{notes}</ul>" if notes else "")


def _solver(result: Smoothing, points: int, longest: int) -> str:
    s = result.solver
    pairs = [
        ("status", s.status),
        ("converged", "yes" if s.converged else "no"),
        ("iterations", str(s.iterations)),
        ("time", f"{quantity(s.seconds, 's')} to solve, {quantity(s.build_seconds, 's')} to build"),
        ("variables", count(s.variables)),
    ]
    drawing = "Every sample is drawn."
    if longest > points:
        drawing = (
            f"Records longer than {count(points)} samples are drawn by the minimum and the maximum of every bin of samples, so that no peak"
            " is lost; a zoom does not bring back the samples between. All of them are in estimates.csv."
            " Means and correlations are taken over all samples."
        )
    note = f"{drawing} Bands are ±1.96 standard deviations. All quantities in SI units, prefixed for reading."
    return f"{facts(pairs)}<p class=note>{note}</p>"
