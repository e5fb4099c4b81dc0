"""One table of several methods on the same recordings: parameters with deviations, and what each predicts of recordings held out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from backsight.models import BacksightError
from backsight.models.errors import InputError

from ..arguments import check_kind
from ..problem import Problem
from ..results import Smoothing
from ..smoothing.prediction import predict
from ..smoothing.smoother import smooth
from .result import Baseline


def compare(
    problem: Problem, methods: Sequence[Callable[[Problem], Baseline] | Baseline], smoothing: Smoothing | None = None
) -> pd.DataFrame:
    """The smoother and classical methods side by side.

    methods    functions of the problem, functools.partial(filtered_least_squares, cutoff=40.0) say, or what they gave back
    smoothing  the smoother's result; None: it is made

    Returns one row per method, the smoother's first, with a column for every free parameter and `<parameter>.std`; of fitted recordings
    `<recording>.<output>.rms`, each method's own prediction; of those held out `<recording>.<output>.simulated` over all of it and
    `<recording>.<output>.ahead` over windows, both from starts that the smoother finds with the method's parameters and the smoother's
    weights, so that nothing but the parameters differs; `note`, why a method or a prediction is missing. All in SI units.
    """
    check_kind(problem, Problem, "compare(...): the problem", "write compare(Problem(...), [methods])")
    for method in methods:
        if not (isinstance(method, Baseline) or callable(method)):
            raise InputError(f"compare(...): the method {method!r} is no function of a problem, nor what one gave back.")
    own = {q.name for q in problem.dae.inputs}
    plain = replace(
        problem,
        recordings=[replace(r, inputs={name: u for name, u in r.inputs.items() if name in own}) for r in problem.recordings],
    )
    result = smooth(plain) if smoothing is None else smoothing
    free = [problem.dae.parameters[i].name for i in problem.free]
    rows: dict[str, dict[str, float | str]] = {"smooth": _row(plain, result, result, free)}
    for method in methods:
        name = method.method if isinstance(method, Baseline) else _called(method)
        try:
            found = method if isinstance(method, Baseline) else method(problem)
        except BacksightError as error:
            rows[_new(name, rows)] = {"note": str(error)}
            continue
        rows[_new(found.method, rows)] = _row(plain, result, found, free)
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("method").fillna({"note": ""})


def _row(problem: Problem, smoothing: Smoothing, found: Smoothing | Baseline, free: Sequence[str]) -> dict[str, float | str]:
    row: dict[str, float | str] = {}
    for name in free:
        estimate = found.parameters[name]
        row |= {name: estimate.value, f"{name}.std": np.nan if estimate.std is None else estimate.std}
    row |= {f"{recording}.{output}.rms": fit.rms for recording, outputs in found.fit.items() for output, fit in outputs.items()}
    widths = {p.name for p in problem.dae.parameters if p.smoothing}
    if isinstance(found, Smoothing) and found.held_out:
        held_out, notes = found.held_out, found.notes
    else:
        taken = smoothing.parameters | {name: p for name, p in found.parameters.items() if name not in widths}
        held_out, notes = predict(problem, replace(smoothing, parameters=taken), smooth)
    for recording, prediction in held_out.items():
        row |= {f"{recording}.{output}.simulated": fit.rms for output, fit in prediction.fit.items()}
        row |= {f"{recording}.{output}.ahead": rms for output, rms in prediction.window_rms.items()}
    row["note"] = " ".join(text for text in notes if "could not be predicted" in text)
    return row


def _called(method: Callable[[Problem], Baseline]) -> str:
    return str(getattr(getattr(method, "func", method), "__name__", "method"))


def _new(name: str, rows: dict[str, dict[str, float | str]]) -> str:
    """The name, numbered where it is there already."""
    count = sum(row == name or row.startswith(f"{name} (") for row in rows)
    return name if not count else f"{name} ({count + 1})"
