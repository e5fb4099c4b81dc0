"""The answer in words: the parameters, how well the model fits, and what is odd. Every sentence is HTML, all names escaped."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from ..results import TELLING
from .columns import Columns
from .quantities import count, number, percent, pretty, quantity, uncertain

if TYPE_CHECKING:
    from ..recordings.recording import Recording
    from ..results import OutputFit, ParameterEstimate, ResidualSummary, Smoothing

__all__ = ["answer", "code", "noise_std", "oddities", "whiteness_sentence", "with_uncertainty", "without"]

NAMED = 6  # parameters named in the sentence; the table has them all
VANISHED = 1e-6  # of its guess: a parameter that ran towards zero and met no bound, for nothing pulled it there
WORTH = 0.9  # effective samples over samples: a memory that costs less is not worth a word


def code(name: str) -> str:
    return f"<code>{escape(name)}</code>"


def joined(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else "".join(words)


def with_uncertainty(parameter: ParameterEstimate) -> str:
    """95.011 ± 0.027 kg."""
    value, std = uncertain(parameter.value, parameter.std)
    unit = escape(pretty(parameter.unit))
    return f"{value} ± {std} {unit}".rstrip() if parameter.std is not None and np.isfinite(parameter.std) else f"{value} {unit}".rstrip()


def answer(result: Smoothing, recordings: Sequence[Recording]) -> str:
    """One paragraph: what was estimated from what, how close the model comes, how much force it leaves unexplained."""
    used = [r for r in recordings if r.name in result.estimates] or list(recordings)
    seconds, samples = sum(r.time[-1] - r.time[0] for r in used), sum(r.time.size for r in used)
    source = code(used[0].name) if len(used) == 1 else f"{len(used)} recordings"
    said = [f"Smoothing {source} ({number(seconds, 3)} s, {count(samples)} samples) with the model {code(result.model)} "]
    free = [p for p in result.parameters.values() if not p.fixed]
    if free:
        found = [f"{code(p.name)} = <b>{with_uncertainty(p)}</b>" for p in free[:NAMED]]
        more = [f"{len(free) - NAMED} more (table below)"] if len(free) > NAMED else []
        said.append(f"gives {joined(found + more)}.")
        if result.overstated > TELLING:
            times = number(result.overstated, 2)
            said.append(
                f" <b>The prediction errors are not white: stated deviations are too small, for what is slow about {times} times, "
                "or more.</b>"
            )
    else:
        said.append("with all parameters fixed estimates its states and the forces it does not explain.")
    if not result.solver.converged:
        said.insert(0, "<b>The solver did not converge: the numbers are those where it stopped.</b> ")
    said += [_met(result), _predicted(result)]
    rests = []
    for place, summary in result.residual_places.items():
        rms = escape(quantity(summary.rms, summary.unit))
        rests.append(f"{rms} rms at {code(place)}{_share(summary.rms, summary.unit, result, used)}{_near_rest(summary)}")
    if rests:
        said.append(f" Unexplained: {joined(rests[:NAMED])}{' and more' if len(rests) > NAMED else ''}.")
    return "".join(said)


def _met(result: Smoothing) -> str:
    """How closely the outputs are met: each by name, or the range of their fits where they are many."""
    fits = [(name, output, fit) for name, outputs in result.fit.items() for output, fit in outputs.items()]
    if not fits:
        return ""
    if len(fits) > 3:
        known = sorted(
            (f.ordinary.fit_percent, name, output)
            for name, output, f in fits
            if f.ordinary.fit_percent is not None and np.isfinite(f.ordinary.fit_percent)
        )
        if not known:
            return ""
        (worst, name, output), best = known[0], known[-1][0]
        left = sum(f.trimmed.outliers for _, _, f in fits if f.trimmed)
        but = f", {without(left)}" if left else ""
        return f" {len(fits)} outputs are met with a fit of {percent(worst)} ({code(output)} on {code(name)}) to {percent(best)}{but}."
    met = []
    for name, output, fit in fits:
        where = f" on {code(name)}" if len(result.fit) > 1 else ""
        rms = escape(quantity(fit.ordinary.rms, result.units.get(output, "")))
        but = f" {without(fit.trimmed.outliers)}" if fit.trimmed else ""
        met.append(f"{code(output)} is met to {rms} rms{where} (fit {percent(fit.ordinary.fit_percent)}){but}")
    return f" {joined(met)}."


def without(outliers: int) -> str:
    return f"without {count(outliers)} outlier{'s' if outliers > 1 else ''}"


def _predicted(result: Smoothing) -> str:
    """How closely held-out outputs are predicted, over windows where there are any: the first of them by name."""
    said = []
    for name, prediction in result.held_out.items():
        for output, fit in prediction.fit.items():
            unit, ahead = result.units.get(output, ""), prediction.window_rms.get(output)
            over = "" if ahead is None else f", {escape(quantity(ahead, unit))} over {quantity(prediction.window_s, 's')}"
            size = f"{escape(quantity(fit.rms, unit))} rms (fit {percent(fit.fit_percent)}){over}"
            said.append(f"{code(output)} of {code(name)} is predicted to {size}")
    more = f", {len(said) - NAMED} more below" if len(said) > NAMED else ""
    return f" Held out: {'; '.join(said[:NAMED])}{more}." if said else ""


def _share(rms: float, unit: str, result: Smoothing, recordings: Sequence[Recording]) -> str:
    """How much that is of the one input in the same unit; nothing where there is none, or more than one."""
    alike = [n for n in recordings[0].inputs if unit and result.units.get(f"input.{n}", result.units.get(n)) == unit] if recordings else []
    if len(alike) != 1:
        return ""
    values = np.concatenate([np.asarray(r.inputs[alike[0]], dtype=float) for r in recordings if alike[0] in r.inputs])
    size = float(np.sqrt(np.mean(values**2)))
    if not size > 0:
        return ""
    return f", {number(100 * rms / size, 2)} % of the input {code(alike[0])} ({escape(quantity(size, unit))} rms)"


def _near_rest(summary: ResidualSummary) -> str:
    """What stands in for a friction law near rest, which the rms leaves out."""
    if not summary.rest_share > 0:
        return ""
    size = escape(quantity(summary.rest_rms, summary.unit))
    return f" (and {size} rms in the {number(100 * summary.rest_share, 2)} % of the samples near rest, where it stands in for friction)"


def noise_std(result: Smoothing, output: str, recording: Recording | None) -> float | None:
    """The standard deviation an output was weighed with; the recording's own where the weights do not name it."""
    if recording is None:
        return result.weights.V.get(output)
    own = recording.output_std.get(output)
    if recording.role == "held_out" and own is not None:
        return own
    return result.weights.noise(output, recording)


def oddities(result: Smoothing, recordings: Sequence[Recording]) -> list[str]:
    """What a careful reader would stumble over, one sentence each; empty if nothing is odd."""
    found = [] if result.solver.converged else [f"The solver stopped early: {escape(result.solver.status)}"]
    for p in result.parameters.values():
        if p.fixed:
            continue
        if p.on_bound:
            found.append(f"{code(p.name)} ended on its bound; the notes say what that means for the others.")
        elif p.near_zero:
            found.append(f"{code(p.name)} cannot be told from 0: {escape(str(p))}.")
        elif p.identifiable is False:
            vanished = p.guess is not None and abs(p.value) < VANISHED * abs(p.guess)
            said = (
                "it ran towards 0, where the model does without it"
                if vanished
                else "its value is that of its guess or prior, or one of many"
            )
            found.append(f"The data do not determine {code(p.name)}: {said}.")
        elif p.std is not None and p.value and p.std > 0.2 * abs(p.value):
            found.append(f"{code(p.name)} is known to {number(100 * p.std / abs(p.value), 2)} % only.")
    for place, summary in result.residual_places.items():
        if (friend := summary.follows) is not None:
            what, law = escape(friend.what), escape(friend.law)
            found.append(f"The residual force at {code(place)} goes with {what} (r = {friend.correlation:.2f}), as {law} would make it.")
    by_name = {r.name: r for r in recordings}
    for name, frame in result.estimates.items():
        kinds = Columns.of(frame)
        where = f" on {code(name)}" if len(result.estimates) > 1 else ""
        for output in kinds.outputs:
            error = frame[f"{output}.measured"].to_numpy(float) - frame[output].to_numpy(float)
            unit = result.units.get(output, "")
            fit = result.fit.get(name, {}).get(output)
            worth = "" if fit is None else coloured(fit, result.doubted)
            found += _odd_errors(code(output) + where, error, unit, noise_std(result, output, by_name.get(name)), fit, worth)
    return found


def _odd_errors(which: str, error: np.ndarray, unit: str, std: float | None, fit: OutputFit | None, worth: str) -> list[str]:
    seen = error[np.isfinite(error)]
    if seen.size < 20:
        return []
    rms, found = float(np.sqrt(np.mean(seen**2))) if fit is None or fit.trimmed is None else fit.trimmed.rms, []
    if std is not None and std > 0 and not 0.5 <= rms / std <= 2.0:
        ratio = rms / std
        verb = f"{number(ratio, 2)} times" if ratio > 1 else f"only {number(100 * ratio, 2)} % of"
        found.append(f"The error of {which} is {verb} the noise it was weighed with ({escape(quantity(std, unit))}).")
    if worth:
        found.append(f"The prediction errors of {which} are not white: {worth}. Something is left out, and deviations mislead.")
    spread_ = 1.4826 * float(np.median(np.abs(seen - np.median(seen))))
    outliers = int((np.abs(error - np.median(seen)) > 6 * spread_).sum()) if spread_ > 0 else 0
    if outliers:
        lie = "samples of {} lie" if outliers > 1 else "sample of {} lies"
        found.append(f"{outliers} {lie.format(which)} more than six robust standard deviations off.")
    return found


def whiteness_sentence(fit: OutputFit, level: float) -> str:
    """What the test of whiteness says; level: up to which p it is doubted."""
    if fit.whiteness_p is None or not np.isfinite(fit.whiteness_p):
        return "not tested"
    if fit.whiteness_p >= 0.05:
        return "cannot be told from white noise"
    worth = coloured(fit, level)
    return f"structure is left in them: {worth}" if worth else "weak signs of structure"


def coloured(fit: OutputFit, level: float) -> str:
    """How many samples the errors are worth, where they are not white; nothing otherwise.

    Of many samples even a memory that matters to nobody is significant.
    """
    if fit.whiteness_p is None or fit.effective_samples is None:
        return ""
    if not fit.whiteness_p <= level or fit.effective_samples >= WORTH * fit.samples:
        return ""
    return f"{count(round(fit.effective_samples))} effective of {count(fit.samples)} samples"
