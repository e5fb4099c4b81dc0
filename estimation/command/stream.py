"""`track --stdin`: rows in on standard input, an estimate out for each, flushed."""

from __future__ import annotations

import io
import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from backsight.models.errors import InputError

from ..recordings.rows import Row, RowReader
from ..study.study import Study
from .interrupt import check, held, kept
from .output import json_text

if TYPE_CHECKING:
    from ..tracking import Estimate, Estimator


LATE = 5  # rows in sequence whose time has passed: the clock


def stream(
    study: Study, *, state: Path | None, iterations: int, jit: bool, as_json: bool, say: Callable[[str], None], warn: TextIO | None
) -> Estimator:
    """Track the rows of standard input to its end and return the estimator; warn: where unreadable cells are told.

    state: a file that the estimator resumes from, if it is there, and that its state is written to at the end and when it is interrupted.
    """
    if state is not None and not os.access(state if state.exists() else state.absolute().parent, os.W_OK):
        raise InputError(f"--state {state}: it cannot be written; choose another file")
    estimator, every = _estimator(study, state, iterations, jit, say), study.streamed.every
    if isinstance(sys.stdin, io.TextIOWrapper):
        sys.stdin.reconfigure(errors="replace")  # a byte that is no text makes an unreadable cell, and no end
    lines = iter(sys.stdin)
    header = next(lines, "")
    if not header.strip():
        raise InputError("standard input: it is empty; send a header and then one row after the other")
    reader = study.rows(header, label="standard input")
    out = sys.stdout
    if not as_json:
        out.write(",".join([*_columns(estimator), "outcome"]) + "\n")
        out.flush()
    with _kept(estimator, state):
        late = 0
        for row in _rows(reader, lines):
            check()
            estimator.rows += math.isfinite(row.time) or every == 1
            number = estimator.rows - 1
            if warn is not None and row.wrong:
                warn.write("".join(f"warning: {wrong}\n" for wrong in row.wrong))
                warn.flush()
            late = late + 1 if _late(estimator, row) else 0
            if warn is not None and late == LATE:
                newest = estimator.newest or 0.0
                what = f"its time {row.time:.9g} s is before {newest:.9g} s, that of the newest estimate, for the {LATE}th time in a row"
                warn.write(f"warning: row {number + 1}: {what}; where the clock has started anew, start anew without the old --state\n")
                warn.flush()
            with held():  # a step is done whole or not at all
                text = _line(estimator, row, as_json) if number % every == 0 else _between(estimator, row)
            try:
                out.write(text)
                out.flush()
            except BrokenPipeError:  # who listened has gone
                break
    return estimator


def _late(estimator: Estimator, row: Row) -> bool:
    return math.isfinite(row.time) and estimator.newest is not None and row.time < estimator.newest


def _estimator(study: Study, state: Path | None, iterations: int, jit: bool, say: Callable[[str], None]) -> Estimator:
    from ..problem import Free
    from ..tracking import Estimator, resumed
    from ..tracking.estimator import SAMPLES

    problem = study.problem()
    # rows that come in are of one machine
    constants = {name: replace(p, per_recording=False) if isinstance(p, Free) else p for name, p in problem.parameters.items()}
    problem = replace(problem, parameters=constants)
    if state is not None and state.exists():
        estimator, samples = resumed(problem, state, jit=jit), study.horizon()
        if samples is not None and samples != estimator.samples:
            was = f"was made with a horizon of {estimator.samples} samples and the study says {samples}"
            raise InputError(f"--state {state}: it {was}; remove it to start anew")
        estimator.iterations = iterations
        return estimator
    say("finding what the study leaves open")
    samples = study.horizon()
    return Estimator(problem, samples=SAMPLES if samples is None else samples, iterations=iterations, jit=jit, progress=say)


@contextmanager
def _kept(estimator: Estimator, state: Path | None) -> Iterator[None]:
    from ..tracking import save

    try:
        yield
    finally:
        if state is not None:
            with held():
                save(estimator, state)
                kept(state)


def _rows(reader: RowReader, lines: Iterator[str]) -> Iterator[Row]:
    for line in lines:
        if line.strip():
            yield reader.read(line)


def _columns(estimator: Estimator) -> list[str]:
    from ..tracking.estimate import columns

    return columns(estimator.names)


def _between(estimator: Estimator, row: Row) -> str:
    """Of a row that `every` leaves out the inputs count."""
    if math.isfinite(row.time):
        estimator.hold(row.time, row.inputs)
    return ""


def _line(estimator: Estimator, row: Row, as_json: bool) -> str:
    """The estimate of a row; one without a time changes nothing and is answered with the newest estimate."""
    from ..tracking import Outcome, Sample

    names = _columns(estimator)
    if math.isfinite(row.time):
        found: Estimate | None = estimator.update(Sample(time=row.time, inputs=row.inputs, outputs=row.outputs))
    else:
        found = None if estimator.estimate is None else replace(estimator.estimate, outcome=Outcome.LATE)
    values = [math.nan] * len(names) if found is None else found.row()
    word = Outcome.LATE.word if found is None else found.outcome.word
    if as_json:
        return json.dumps({name: v if math.isfinite(v) else None for name, v in zip(names, values, strict=True)} | {"outcome": word}) + "\n"
    return ",".join("" if math.isnan(v) else repr(v) for v in values) + f",{word}\n"


def write_stream_result(estimator: Estimator, folder: Path, began: float) -> None:
    """result.json of what was tracked from standard input."""
    from ..tracking.track import summary
    from .result_json import result_of_tracking

    answer = summary(estimator, {}, {}, build=0.0, seconds=time.perf_counter() - began)
    (folder / "result.json").write_text(json_text(result_of_tracking(answer)), encoding="utf-8")
