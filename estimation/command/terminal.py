"""Tables for the terminal."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

from rich.console import Console, Group
from rich.markup import escape
from rich.table import Table

from ..report.quantities import NOTHING
from ..results import TELLING
from ..wording import chance, percentage

if TYPE_CHECKING:
    from ..diagnosis import Diagnosis
    from ..results import OutputFit, Smoothing
    from ..simulation import Simulation
    from ..tracking import Tracking
    from ..weighing import Weighing


def console(*, stderr: bool = False) -> Console:
    """Standard output or standard error, as it is at this moment."""
    return Console(stderr=stderr, highlight=False, emoji=False)


def parameter_table(answer: Smoothing) -> Table:
    """Estimated parameters with their deviations, then the fit of each output."""
    table = _estimated(answer, "parameter")
    for recording, outputs in answer.fit.items():
        for output, fit in outputs.items():
            table.add_row(
                escape(f"fit of {output}, {recording}"), f"{_size(fit, answer.units.get(output, ''))}{_whiteness(fit, answer.doubted)}"
            )
    for recording, prediction in answer.held_out.items():
        for output, fit in prediction.fit.items():
            unit, ahead = answer.units.get(output, ""), prediction.window_rms.get(output)
            over = "" if ahead is None else f"; {ahead:.3g} {unit} over {prediction.window_s:.3g} s"
            table.add_row(escape(f"prediction of {output}, {recording}"), f"{_size(fit, unit)}{over}")
    if (times := answer.overstated) > TELLING:
        table.add_row("deviations", f"too small, for what is slow about {times:.2g} times, or more: prediction errors are not white")
    for p in answer.profiles.values():
        ends = (
            f"{p.values[k]:.6g} (bound)" if side in p.limited else _end(value, otherwise)
            for side, value, k, otherwise in (("lower", p.lower, 0, "-inf"), ("upper", p.upper, -1, "inf"))
        )
        table.add_row(escape(f"95 % of {p.name}"), f"{' .. '.join(ends)} {p.unit}")
    return table


def tracking_table(answer: Tracking) -> Table:
    """Parameters at the end, the fit of each output, and how long estimates took."""
    table = _estimated(answer, "parameter, at the end")
    for recording, outputs in answer.fit.items():
        for output, fit in outputs.items():
            table.add_row(escape(f"fit of {output}, {recording}"), f"rms {fit.rms:.3g} {answer.units.get(output, '')}")
    table.add_row("an estimate took", ", ".join(f"{name} {value:.3g} ms" for name, value in answer.latency_ms.items()))
    return table


def weight_table(found: Weighing) -> Group:
    """Every weight from the data with its 95 % interval and the chance of what is seen without it, and the recommended one."""
    table = Table(box=None, pad_edge=False)
    for heading in ("weight", "recommended std", "std from the data", "95 %", "p without"):
        table.add_column(heading)
    for label, c in found.components.items():
        low, high = c.interval
        between = "" if not (isfinite(low) and isfinite(high)) else f"up to {high:.3g}" if c.may_be_none else f"{low:.3g} .. {high:.3g}"
        table.add_row(escape(label), f"{found.best.weights[label]:.4g} {c.unit}", f"{c.std:.4g}", between, chance(c.p_zero))
    return Group(f"{found.recommended.model}: {escape(found.why)}", table)


def diagnosis_table(found: Diagnosis) -> Group:
    """The verdict, every finding with its parameters and the chance of as much evidence if nothing were missing, proof, parameters."""
    from ..diagnosis.answer.words import numbers, sentence, when

    said, table = f"{found.after.model}: {escape(sentence(found))}", Table(box=None, pad_edge=False)
    for heading in ("finding", "", "when", "p"):
        table.add_column(heading)
    for f in found.findings:
        table.add_row(escape(f.explanation.words), escape(numbers(f.explanation.parameters)), escape(when(f)), chance(f.p_value))
        for rival in f.rivals:
            table.add_row(escape(f"  or {rival.words}"), escape(numbers(rival.parameters)))
        if f.separates:
            table.add_row("  to be told apart by", escape(f.separates))
    if held := found.held_out:
        for name, errors in held.before.items():
            then = {s: f" to {held.after[name].windows[s]:.3g}" if held.repaired else "" for s in errors.windows}
            spans = ", ".join(f"{rms:.3g}{then[s]} over {s:.3g} s" for s, rms in errors.windows.items())
            table.add_row(escape(f"held out: error of {name} [{errors.unit}]"), spans)
    return Group(said, *(t for t in (table, _before_and_after(found)) if t.row_count))


def _before_and_after(found: Diagnosis) -> Table:
    """The model's estimated parameters as it was declared, and with what was found."""
    table = Table(box=None, pad_edge=False)
    for heading in ("parameter", "fitted as declared", "fitted with what was found")[: 3 if found.findings else 2]:
        table.add_column(heading)
    for name, then in found.before.parameters.items():
        now = found.after.parameters.get(name)
        if not (then.fixed and (now is None or now.fixed)):
            table.add_row(*(escape(said) for said in (name, str(then), NOTHING if now is None else str(now))[: len(table.columns)]))
    return table


def simulation_table(answer: Simulation) -> Table:
    """The fit of each output of each recording."""
    table = Table(title=f"{answer.model}: simulated", title_justify="left", box=None, pad_edge=False)
    for heading in ("recording", "output", "rms", "fit"):
        table.add_column(heading)
    for recording, outputs in answer.fit.items():
        for output, fit in outputs.items():
            table.add_row(escape(recording), output, f"{fit.rms:.4g} {answer.units[output]}", _share(fit.fit_percent))
    return table


def _estimated(answer: Smoothing | Tracking, heading: str) -> Table:
    """How the solver fared, and the estimated parameters with their deviations."""
    table = Table(title=f"{answer.model}: {answer.solver.status}", title_justify="left", box=None, pad_edge=False)
    table.add_column(heading)
    table.add_column("value", justify="right")
    for name, estimate in answer.parameters.items():
        if not estimate.fixed:
            table.add_row(escape(name), str(estimate))
    return table


def _size(fit: OutputFit, unit: str) -> str:
    but = "" if fit.trimmed is None else f" without {fit.trimmed.outliers} outlier{'s' if fit.trimmed.outliers > 1 else ''}"
    return f"rms {fit.ordinary.rms:.3g} {unit} ({_share(fit.ordinary.fit_percent)}){but}"


def _whiteness(fit: OutputFit, level: float) -> str:
    if fit.whiteness_p is None or fit.effective_samples is None:
        return ""
    return "; white" if fit.whiteness_p > level else f"; not white, {fit.effective_samples:.0f} effective of {fit.samples}"


def _end(value: float | None, nothing: str) -> str:
    return nothing if value is None else f"{value:.6g}"


def _share(percent: float | None) -> str:
    return "no variation to explain" if percent is None else percentage(percent)
