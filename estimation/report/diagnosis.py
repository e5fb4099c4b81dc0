"""The page of a diagnosis, in the order of an engineer's questions: what is missing, where, when, what else was tried, what is it worth on
recordings that the fit has not seen, and what could not have been seen."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from backsight.models import Model

from ..diagnosis.answer.words import CONTRADICTED, numbers, repairs, sentence, when, with_deviation
from ..wording import chance, probability
from .answer import code, joined
from .diagnosis_figures import held_out_charts, mismatch_chart, mismatch_scatter, window_chart
from .document import document, drawn, save
from .graph import Mark, drawing
from .quantities import NOTHING, number, pretty, quantity, uncertain
from .tables import facts, table

if TYPE_CHECKING:
    from ..diagnosis import Diagnosis, Errors, Finding, HeldOut, Tried
    from ..results import Smoothing

__all__ = ["write_diagnosis_report"]

LISTED = 30  # candidates in the table of what was tried
DRAWN = 6  # residual forces: of a place in a recording


def write_diagnosis_report(found: Diagnosis, path: str | Path) -> None:
    """Write the page of a diagnosis to `path`: one HTML file that opens without a network."""
    sections = [
        ("where", "Where", _where(found)),
        ("when", "When, and what it goes with", _when(found)),
        ("what", "What it is", _what(found)),
        ("tried", "What was tried", _tried(found)),
        ("held-out", _heading(found), _held_out(found)),
        ("parameters", "Parameters", _parameters(found)),
        ("limits", "What could not have been seen", _limits(found)),
        ("notes", "Notes", _notes(found)),
    ]
    page = document(
        title=f"{found.after.model}: what the model leaves out",
        sub="Located, named, modelled, and proven on what the fit has not seen",
        lead=f"<p class=answer>{escape(sentence(found))}</p>{_doubts(found)}",
        sections=sections,
    )
    save(page, path)


def _doubts(found: Diagnosis) -> str:
    """What a reader must know before trusting the verdict."""
    said = []
    if not found.after.solver.converged:
        said.append(f"The solver stopped early with the repaired model: {escape(found.after.solver.status)}")
    for f in found.findings:
        if f.rivals:
            others = joined([escape(r.words) for r in f.rivals])
            apart = f" What would tell them apart: {escape(f.separates)}." if f.separates else ""
            said.append(f"These recordings cannot tell {escape(f.explanation.words)} from {others}.{apart}")
    held = found.held_out
    if found.findings and held is None:
        said.append("Nothing was held out: the repair is not proven on other data.")
    elif held is not None and held.refuting:
        said.append(CONTRADICTED)
    elif held is not None and held.repaired and not held.p_value < 0.05:
        said.append(f"What was held out does not confirm the repair ({escape(probability(held.p_value)) or 'no p'}).")
    items = "".join(f"<li>{s}</li>" for s in said)
    return f"<div class=odd><b>Mind</b><ul>{items}</ul></div>" if said else ""


def _where(found: Diagnosis) -> str:
    """The model's components with the guilty place marked, and the residual force of every place."""
    residuals = _residuals(found)
    if not isinstance(found.repaired.model, Model):
        return residuals
    model = found.repaired.model
    marks = {place: Mark("", f"residual {quantity(r.rms, r.unit)}") for place, r in found.before.residual_places.items()}
    guilty = list(dict.fromkeys(f.explanation.place for f in found.findings))
    rivals = [place for place in dict.fromkeys(r.place for f in found.findings for r in f.rivals) if place not in guilty]
    changed = {part.partition(" = ")[0].strip() for f in found.findings for part in f.change.split(";")}
    new = [name for name in model.components if name in changed and name not in guilty]
    for kind, places in (("new", new), ("rival", rivals), ("guilty", guilty)):
        for place in places:
            marks[place] = Mark(kind, marks.get(place, Mark()).text)
    said = [
        f"The bold frame is where the model lacks something: {', '.join(guilty)}." if guilty else "No place is marked: nothing was found."
    ]
    said += [f"A dashed one would explain these recordings as well: {', '.join(rivals)}."] if rivals else []
    said += [f"Blue is what the repair put in: {', '.join(new)}."] if new else []
    caption = f"The model{' with what was found in it' if guilty else ''}, driven from the left. {' '.join(said)} "
    caption += "Beneath a place is the rms of the force that the model as declared leaves unexplained there."
    return drawing(model, marks, caption=caption) + residuals


def _residuals(found: Diagnosis) -> str:
    rows, results = [], _results(found)
    for place, r in found.before.residual_places.items():
        each = [result.residual_places.get(place) for result in results.values()]
        follows = NOTHING if r.follows is None else f"{r.follows.what} (correlation {number(r.follows.correlation, 2)})"
        rows.append([place, *(quantity(s.rms, s.unit) if s else NOTHING for s in each), follows])
    first, *others = results
    head = ["place", f"residual force, {first}", *others, "at first it goes with" if others else "it goes with"]
    return table(head, rows, words=(0, 1 + len(results))) if rows else ""


def _results(found: Diagnosis) -> dict[str, Smoothing]:
    """What stands side by side in tables: the model as declared and the repaired one, where something was repaired."""
    return {"model as declared": found.before} | ({"with the repair": found.after} if repairs(found) else {})


def _when(found: Diagnosis) -> str:
    """The residual force at the guilty places over time, and against what it may hang on."""
    guilty = {f.explanation.place for f in found.findings}
    shown = [k for k, m in enumerate(found.mismatch) if {m.place, m.place.partition(".")[0]} & guilty] or list(range(len(found.mismatch)))
    by_place: dict[tuple[str, str], list[int]] = {}
    for k in shown:
        by_place.setdefault((found.mismatch[k].place, found.mismatch[k].recording), []).append(k)
    parts = []
    for number_, ((place, recording), which) in enumerate(list(by_place.items())[:DRAWN]):
        chosen = [found.mismatch[k] for k in which]
        own = [f for f in found.findings if f.explanation.place in (place, place.partition(".")[0])]
        times, told = [time for f in own for time in (f.onset, f.until) if time is not None], [when(f) for f in own]
        said = f"<p>{escape(f'It acts: {joined(told)}.')}</p>" if told else ""
        parts.append(f"<h3>{code(place)} on {code(recording)}</h3>{said}")
        parts.append(drawn(mismatch_chart(chosen, times, label=f"mismatch_{number_}")))
        parts.append(drawn(mismatch_scatter(chosen, label=f"mismatch_against_{number_}")))
    return "".join(parts)


def _what(found: Diagnosis) -> str:
    """Every finding with its numbers, and what else it might have been."""
    parts = [f"<h3>{escape(f.explanation.words)}</h3>{facts(_finding(f))}" for f in found.findings]
    note = (
        "The chance is that of as much evidence anywhere in the library if nothing were missing. Evidence is the logarithm of how much "
        "likelier the recordings are with the effect than without, all parameters estimated again in both."
    )
    return "".join(parts) + f"<p class=note>{note}</p>" if parts else ""


def _finding(f: Finding) -> list[tuple[str, str]]:
    share = NOTHING if f.share is None else f"{number(100 * f.share, 2)} % of the force there"
    others = [f"{e.words} (lacks {number(e.gap, 3)} nats)" if e.gap > 0 else e.words for e in f.alternatives]
    pairs = [
        ("strength", numbers(f.explanation.parameters) or NOTHING),
        ("acts", when(f)),
        ("share", share),
        ("chance without it", chance(f.p_value) or "no score tells it"),
        ("evidence", f"{number(f.gain, 4)} nats"),
        ("change of the model", f.change),
    ]
    pairs += [("of its mean square go", f"{f.described}: a description, no explanation")] if f.described else []
    return [*pairs, *([("rather than", "; ".join(others))] if others else [])]


def _tried(found: Diagnosis) -> str:
    if not found.tried:
        return ""
    chosen = {f.explanation.key for f in found.findings}
    rivals = {r.key for f in found.findings for r in f.rivals}

    def fate(t: Tried) -> str:
        which = t.explanation.key
        if which in chosen:
            return "accepted"
        if which in rivals:
            return t.refused or "cannot be told from what was accepted"
        return t.refused or ("less evidence" if t.fitted is not None else "not fitted: too little to gain")

    rows = [
        [_words(t.explanation.physics), t.explanation.where, number(t.predicted, 3), number(t.fitted, 4), fate(t)]
        for t in found.tried[:LISTED]
    ]
    head = ["effect", "place", "gain foreseen [nats]", "gain when fitted [nats]", "what became of it"]
    more = len(found.tried) - LISTED
    note = f"<p class=note>{more} more were tried, in later rounds.</p>" if more > 0 else ""
    return table(head, rows, words=(0, 1, 4), codes=(1,)) + note


def _heading(found: Diagnosis) -> str:
    before = "" if found.held_out is None or not found.held_out.repaired else "Before and after, on what"
    return f"{before or 'What'} the fit has not seen"


def _held_out(found: Diagnosis) -> str:
    held = found.held_out
    if held is None:
        return ""
    rows = [row for name, errors in held.before.items() for row in _errors(name, errors, held)]
    said = (
        f"Windows of {joined([code(r) for r in held.recordings]) or escape(held.role)} are predicted with the inputs alone, from the "
        "state at their first row, by the model as declared with its parameters fitted again"
    )
    if not held.repaired:
        forces = [[place, quantity(a, unit)] for place, (a, _, unit) in held.force.items()]
        beside = table(["residual force on what was held out, at", "rms"], forces) if forces else ""
        return f"<p>{said}.</p>{table(['output', 'over', 'rms error'], [r[:3] for r in rows])}{drawn(window_chart(held))}{beside}"
    said += (
        f" and by the repaired one. Prediction errors are <b>{escape(_change(held.improvement_percent))}</b> (geometric mean of all rows "
        f"below), {escape(probability(held.p_value))} from {held.blocks} blocks."
    )
    if held.attainable_percent is not None:
        said += f" That is {number(held.attainable_percent, 3)} % of what forces that are free at every place would take from them."
    head = ["output", "over", "rms error before", "after", "change"]
    forces = [[place, quantity(a, unit), quantity(b, unit)] for place, (a, b, unit) in held.force.items()]
    return (
        f"<p>{said}</p>{table(head, rows)}{drawn(window_chart(held))}"
        + "".join(drawn(chart) for chart in held_out_charts(found))
        + (table(["residual force on what was held out, at", "before", "after"], forces) if forces else "")
    )


def _errors(name: str, before: Errors, held: HeldOut) -> list[list[str]]:
    after, rows = held.after.get(name), []
    for span, rms in before.windows.items():
        then = after.windows.get(span) if after is not None else None
        change = NOTHING if then is None or not rms > 0 else _change(100 * (1 - then / rms))
        rows.append([name, quantity(span, "s"), quantity(rms, before.unit), quantity(then, before.unit), change])
    return rows


def _parameters(found: Diagnosis) -> str:
    """All that was estimated in either, and the parameters of what was found."""
    rows, results = [], _results(found)
    for name in dict.fromkeys(name for result in results.values() for name in result.parameters):
        each = [result.parameters.get(name) for result in results.values()]
        if all(p is None or p.fixed for p in each):
            continue
        told = [NOTHING if p is None else "fixed" if p.fixed and p.value == 0 else _estimate(p.value, p.std) for p in each]
        unit = next(p.unit for p in each if p is not None)
        rows.append([name, *told, pretty(unit)])
    said = table(["parameter", *results, "unit"], rows, words=(0, 1 + len(results))) if rows else ""
    own = [[f.explanation.words, n, with_deviation(s)] for f in found.findings for n, s in f.explanation.parameters.items()]
    return said + (table(["of the finding", "parameter", "estimate"], own, words=(0, 1, 2), codes=(1,)) if own else "")


def _estimate(value: float, std: float | None) -> str:
    text, deviation = uncertain(value, std)
    return f"{text} ± {deviation}" if std is not None and np.isfinite(std) else text


def _limits(found: Diagnosis) -> str:
    if not found.undetectable:
        return ""
    rows = [
        [_words(u.physics), u.place, u.parameter, quantity(u.strength, u.unit) if np.isfinite(u.strength) else "these recordings show none"]
        for u in found.undetectable
    ]
    said = (
        "An effect that is weaker than this would have gone unnoticed in these recordings, so nothing is said about it. "
        "Of one that may have many shapes it is the strength at one in the middle."
    )
    return f"<p>{said}</p>" + table(["effect", "place", "of", "least strength that shows"], rows, words=(0, 1, 2), codes=(1, 2))


def _notes(found: Diagnosis) -> str:
    notes: Sequence[str] = list(dict.fromkeys((*found.notes, *found.after.notes)))
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    pairs = [("candidates", str(len(found.tried))), ("time", quantity(found.seconds, "s")), ("seed", str(found.seed))]
    return (f"<ul class=notes>{items}</ul>" if items else "") + facts([*pairs, ("last solve", found.after.solver.status)])


def _words(physics: str) -> str:
    return physics.replace("_", " ")


def _change(percent: float) -> str:
    return f"{number(abs(percent), 3)} % {'smaller' if percent >= 0 else 'larger'}"
