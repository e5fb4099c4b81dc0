"""The tables of a report as HTML: parameters, fit, weights, facts. Every cell is escaped here."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from ..wording import chance, per_root_bandwidth
from .answer import whiteness_sentence
from .quantities import NOTHING, count, number, percent, pretty, quantity, uncertain

if TYPE_CHECKING:
    from ..results import Criteria, OutputFit, Prediction, Profile, Smoothing

__all__ = [
    "correlation_table",
    "criteria_facts",
    "facts",
    "fit_table",
    "parameter_table",
    "prediction_table",
    "profile_table",
    "table",
    "weight_table",
]


def table(head: Sequence[str], rows: Iterable[Sequence[str]], *, words: Sequence[int] = (0,), codes: Sequence[int] = (0,)) -> str:
    """An HTML table of plain strings; the columns `words` are set to the left, those in `codes` as names."""

    def cell(tag: str, k: int, text: str) -> str:
        inner = f"<code>{escape(text)}</code>" if tag == "td" and k in codes and text else escape(text)
        return f"<{tag}{'' if k in words else ' class=n'}>{inner}</{tag}>"

    header = "".join(cell("th", k, text) for k, text in enumerate(head))
    body = "".join("<tr>" + "".join(cell("td", k, text) for k, text in enumerate(row)) + "</tr>\n" for row in rows)
    return f"<div class=wide><table><thead><tr>{header}</tr></thead>\n<tbody>{body}</tbody></table></div>"


def parameter_table(result: Smoothing) -> str:
    """Name, value, std, relative std, unit, guess if there was one, estimated or fixed, identifiable."""
    guessed = any(p.guess is not None for p in result.parameters.values())
    head = ["parameter", "value", "std", "unit", "std / value", *(["guess"] if guessed else []), "role", "identifiable"]
    rows = []
    for name, p in sorted(result.parameters.items(), key=lambda item: item[1].fixed):
        value, std = uncertain(p.value, p.std)
        share = number(100 * p.std / abs(p.value), 2) + " %" if p.std is not None and np.isfinite(p.std) and p.value else NOTHING
        known = NOTHING if p.fixed or p.identifiable is None else "on its bound" if p.on_bound else "yes" if p.identifiable else "no"
        guess = [number(p.guess, 6)] if guessed else []
        rows.append([name, value, NOTHING if p.fixed else std, pretty(p.unit), share, *guess, "fixed" if p.fixed else "estimated", known])
    return table(head, rows, words=(0, 3, len(head) - 2, len(head) - 1))


def correlation_table(result: Smoothing) -> str:
    """Correlations of the estimated parameters, the half below the diagonal; nothing where there is but one."""
    names, matrix = [str(name) for name in result.correlation], result.correlation.to_numpy()
    if len(names) < 2:
        return ""
    below = [[f"{r:z.2f}".replace("-", "−") if k < i else "" for k, r in enumerate(row[:-1])] for i, row in enumerate(matrix)]
    return table(["correlation", *names[:-1]], [[name, *row] for name, row in zip(names, below, strict=True)][1:])


def fit_table(fit: Mapping[str, Mapping[str, OutputFit]], result: Smoothing) -> str:
    """Recording, output, rms error, fit, whiteness p with a sentence; where a loss left outliers out their number, and both with them."""
    rows, robust = [], any(f.trimmed for outputs in fit.values() for f in outputs.values())
    for name, outputs in fit.items():
        for output, f in outputs.items():
            p = chance(f.whiteness_p) or NOTHING
            unit, left = result.units.get(output, ""), [NOTHING, NOTHING]
            if f.trimmed is not None:
                left = [count(f.trimmed.outliers), f"{quantity(f.rms, unit)} ({percent(f.fit_percent)})"]
            size = [quantity(f.ordinary.rms, unit), percent(f.ordinary.fit_percent)]
            rows.append([name, output, *size, *(left if robust else []), p, whiteness_sentence(f, result.doubted)])
    apart = ["outliers left out", "with them"] if robust else []
    head = ["recording", "output", "rms error", "fit", *apart, "whiteness p", "the prediction errors"]
    return table(head, rows, words=(0, 1, len(head) - 1), codes=(0, 1))


def profile_table(profiles: Mapping[str, Profile]) -> str:
    """Parameter, estimate, its 95 % interval, how lopsided that is, and what ends it."""
    rows = []
    for name, p in profiles.items():
        ends = [number(p.lower, 6) if p.lower is not None else "open", number(p.upper, 6) if p.upper is not None else "open"]
        bound = f"a bound, at the {' and '.join(p.limited)} end" if p.limited else NOTHING
        rows.append([name, number(p.estimate, 6), *ends, pretty(p.unit), number(p.asymmetry, 3), bound])
    return table(["parameter", "value", "95 % from", "to", "unit", "upper / lower", "ended by"], rows, words=(0, 4, 6))


def criteria_facts(c: Criteria) -> str:
    """Evidence, AIC and BIC in the order of their weight."""
    pairs = [
        ("log evidence", number(c.log_evidence, 9)),
        ("log likelihood, trajectories integrated out", number(c.log_likelihood, 9)),
        ("AIC of the samples beside the trajectories", number(c.aic, 9)),
        ("BIC of the same", number(c.bic, 9)),
        ("effective parameters", number(c.effective_parameters, 5)),
    ]
    return facts(pairs)


def prediction_table(prediction: Prediction, units: Mapping[str, str]) -> str:
    """Output, rms error and fit over the whole recording, rms error over windows."""
    rows = []
    for output, f in prediction.fit.items():
        ahead = prediction.window_rms.get(output)
        unit = units.get(output, "")
        rows.append([output, quantity(f.rms, unit), percent(f.fit_percent), NOTHING if ahead is None else quantity(ahead, unit)])
    window = "" if prediction.window_s is None else f" over {quantity(prediction.window_s, 's')}"
    return table(["output", "rms error, whole recording", "fit", f"rms error{window}"], rows) if rows else ""


def weight_table(result: Smoothing) -> str:
    """The standard deviations in force: of every residual force (a density, with its correlation time if it has one) and every output."""
    rows = []
    for place, std in result.weights.W.items():
        summary = result.residual_places.get(place)
        unit = summary.unit if summary is not None else result.units.get(f"residual.{place}", "")
        tau, weighed = result.weights.tau.get(place), unit
        if tau is None:
            kind, weighed = "white, of spectral density std²", per_root_bandwidth(unit)
        else:
            kind = f"Ornstein–Uhlenbeck, that rms, correlation time {quantity(tau, 's')}"
        used = quantity(summary.rms, unit) if summary is not None else NOTHING
        rows.append(["W", place, quantity(std, weighed), used, f"residual force, {kind}" + (f"; {summary.origin}" if summary else "")])
    for name, std in result.weights.V.items():
        output, _, of = name.partition(" [")
        unit = result.units.get(output, "")
        met = [f[output].ordinary.rms for recording, f in result.fit.items() if output in f and of in ("", f"{recording}]")]
        used = quantity(float(np.sqrt(np.mean(np.square(met)))), unit) if met else NOTHING
        rows.append(["V", name, quantity(std, unit), used, "noise of the output, white from sample to sample"])
    return table(["", "of", "std", "rms found", "meaning"], rows, words=(0, 1, 4), codes=(1,))


def facts(pairs: Iterable[tuple[str, str]]) -> str:
    """A list of names and values."""
    return "<dl>" + "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in pairs) + "</dl>"
