"""A recording: what a plant was given and what its sensors said, at the times they said it.

    rec = Recording.read("run.csv", time="t_s", inputs={"F": "u_force_N"}, outputs={"x": OutputColumn("q_mm", std=2e-6, unit="mm")})

The input of row k holds from t_k to t_(k+1); the outputs of row k are taken at t_k with that input already acting.
A missing sample of an output is NaN. Nothing is filtered, resampled or assumed to be uniform in time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from backsight.models.errors import InputError

from ..wording import number
from .columns import LOSSES, InputColumn, Loss, OutputColumn, check_delay, check_limits, cut, late_inputs, sensor_columns
from .delay import sampled
from .drive import Drive
from .gaps import runs
from .samples import check_clock, check_samples
from .table import Table, read_table
from .units import to_si

Array = np.ndarray[tuple[int], np.dtype[np.float64]]


@dataclass(frozen=True, kw_only=True)
class Recording:
    """Samples of inputs and outputs over time, in SI units, checked when made.

    name         what to call it, the file's name as the study gives it
    time         (n,) s, strictly increasing, as recorded
    inputs       name of the model's input -> (n,)
    outputs      name of the model's output -> (n,), NaN where a sample is missing
    output_std   name of an output -> standard deviation of its noise, None: to be estimated
    output_loss  name of an output -> "square" (where none is given), "huber" or "auto", see `OutputColumn`
    limits       name of an input -> least and greatest value that the actuator can do; commands beyond are cut off there
    open_delays  names of outputs that lag by an unknown time, or "inputs" if those act late: a free parameter `delay:<output>` or
                 `delay:inputs`, one for all recordings, which all have to name it
    advanced     such a name -> seconds by which its samples were moved back already
    hold         "zero": an input keeps its value until the next row; "linear": it runs straight to the next row's
    open_hold    whether smoothing may find out which of the two it is; `hold` serves all else
    role         "fit": to estimate from; "held_out": to test on
    clock_std    s: standard deviation by which the time stamps of samples are off; one counts for as much less as its output moves
    gap          s: rows further apart are pieces, each fitted with a start of its own (None: 20 usual intervals, see `gaps.py`)
    drive        the inputs on a clock of their own, where they change between the rows (None: they change at the rows only)
    part         0 where it starts as a recording and for its first piece, 1 for what follows the first gap, ...; one that starts in the
                 midst of another has 1 itself, and its pieces count on from there

    Raises InputError where time does not increase, a value is not finite, or lengths differ.
    """

    name: str
    time: Array
    inputs: Mapping[str, Array]
    outputs: Mapping[str, Array]
    output_std: Mapping[str, float | None] = field(default_factory=dict)
    output_loss: Mapping[str, Loss] = field(default_factory=dict)
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    open_delays: tuple[str, ...] = ()
    advanced: Mapping[str, float] = field(default_factory=dict)
    hold: Literal["zero", "linear"] = "zero"
    open_hold: bool = False
    role: Literal["fit", "held_out"] = "fit"
    clock_std: float = 0.0
    gap: float | None = None
    drive: Drive | None = None
    part: int = 0

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "time", _column(self.time, f"{self.name}: time"))
        check_limits(self.limits, self.inputs, self.name)
        inputs = {name: _column(values, f"{self.name}: input {name}") for name, values in self.inputs.items()}
        put(self, "inputs", {name: _column(cut(u, self.limits.get(name)), name) for name, u in inputs.items()})
        if self.drive is not None:
            put(self, "drive", replace(self.drive, inputs={n: cut(u, self.limits.get(n)) for n, u in self.drive.inputs.items()}))
        put(self, "outputs", {name: _column(values, f"{self.name}: output {name}") for name, values in self.outputs.items()})
        put(self, "output_std", {name: self.output_std.get(name) for name in self.outputs})
        put(self, "output_loss", {name: self.output_loss.get(name, "square") for name in self.outputs})
        for name, loss in self.output_loss.items():
            check_word(loss, LOSSES, where=f"{self.name}: loss of output {name}")
        check_word(self.hold, ("zero", "linear"), where=f"{self.name}: hold")
        check_word(self.role, ("fit", "held_out"), where=f"{self.name}: role")
        for kind, columns in (("input", self.inputs), ("output", self.outputs)):
            for name, values in columns.items():
                if values.shape != self.time.shape:
                    raise InputError(
                        f"{self.name}: {kind} {name} has {values.size} values and the time has {self.time.size}; one per row is needed"
                    )
        for name, std in self.output_std.items():
            if std is not None and not (np.isfinite(std) and std > 0):
                rule = "it must be positive; leave it out where nobody knows it, then it is chosen from the data"
                raise InputError(f"{self.name}: std of output {name} is {std}; {rule}")
        if not (np.isfinite(self.clock_std) and self.clock_std >= 0):
            raise InputError(f"{self.name}: clock_std is {self.clock_std}; it is a time in seconds, 0 where time stamps are exact")
        check_samples(self.name, self.time, self.inputs, self.outputs)
        if self.gap is not None and not self.gap > self.sampling:
            rule = f"it must be longer than the sampling interval, {number(self.sampling)} s"
            raise InputError(f"{self.name}: gap = {number(self.gap)} s would cut between all rows; {rule}")

    @classmethod
    def read(
        cls,
        path: str | Path,
        *,
        time: str | InputColumn,
        inputs: Mapping[str, str | InputColumn],
        outputs: Mapping[str, str | OutputColumn],
        std: Mapping[str, float] | None = None,
        range: tuple[float, float] | None = None,
        every: int = 1,
        hold: Literal["zero", "linear", "auto"] = "zero",
        role: Literal["fit", "held_out"] = "fit",
        clock_std: float = 0.0,
        gap: float | None = None,
        name: str | None = None,
        units: Mapping[str, str] | None = None,
    ) -> Recording:
        """The recording in a csv, csv.gz, parquet, mat or MDF (mf4) file.

        time, inputs, outputs   columns of the file; inputs and outputs by the name of the model's signal (MDF: names of channels)
        std      standard deviations of outputs whose column says none, SI
        range    keep the rows from range[0] to range[1], seconds of the recorded time
        every    of those rows keep rows 0, every, 2 every, ...; between them the inputs act as recorded
        hold     see above; "auto": as smoothing finds by the evidence of both
        clock_std  see above
        gap      rows further apart [s] are pieces with starts of their own (default: 20 usual intervals, see `gaps.py`)
        name     what to call it, in results and in messages (default: the file's name)
        units    SI unit of each of the model's signals, into which columns with a unit are converted (default: SI base units)

        Raises InputError naming file, line (the header is line 1), column, value and remedy.
        """
        path = Path(path)
        label = name or path.name
        clock = InputColumn(time) if isinstance(time, str) else time
        for k, c in inputs.items():
            if not isinstance(c, (str, InputColumn)):
                raise InputError(f"{label}: the column of input {k} is {c!r}; give its name, or InputColumn(name, unit=...)")
        drives = {k: InputColumn(c) if isinstance(c, str) else c for k, c in inputs.items()}
        sensors = sensor_columns(outputs, std or {}, label)
        wanted = [c.column for c in (*drives.values(), *sensors.values())]
        check_word(hold, ("zero", "linear", "auto"), where=f"{label}: hold")
        between: Literal["zero", "linear"] = "linear" if hold == "linear" else "zero"
        table = read_table(path, clock.column, wanted, label=label, held={c.column: between for c in drives.values()})

        t = _time(table, clock, label)
        inside, rows = _kept_rows(t, range, every, label, clock.column)
        converted: dict[str, Array] = {}
        limits = {k: c.limits for k, c in drives.items() if c.limits is not None}
        check_limits(limits, drives, label)
        for signal, column in (*drives.items(), *sensors.items()):
            values = table.columns[column.column]
            if column.unit is not None:
                where = f'{label}: column "{column.column}" of {signal}'
                values = to_si(values, column.unit, (units or {}).get(signal), where=where)
            converted[signal] = cut(values, limits.get(signal))
        driven, sensed = {k: converted[k] for k in drives}, {k: converted[k] for k in sensors}
        known = {k: c.delay for k, c in sensors.items() if c.delay != "estimate" and c.delay != 0.0}
        for signal, delay in known.items():
            check_delay(delay, signal, t, label)
        columns = {k: f'column "{c.column}"' for k, c in (*drives.items(), *sensors.items())}
        for chosen in (inside,) if every == 1 else (inside, rows):  # inputs act between the kept rows too, outputs are needed on these
            ours = {k: u[chosen] for k, u in driven.items()}, {k: y[chosen] for k, y in sensed.items()}
            check_samples(label, t[chosen], *ours, columns=columns, row=_called(table, chosen))
        rows_kept, pushed, read, drive = sampled(t, rows, driven, sensed, known, between, gap)
        noise = {k: c.std for k, c in sensors.items()}
        loss = {k: c.loss for k, c in sensors.items()}
        return cls(
            name=label,
            time=rows_kept,
            inputs=pushed,
            outputs=read,
            output_std=noise,
            output_loss=loss,
            limits=limits,
            open_delays=(*late_inputs(drives, label), *(k for k, c in sensors.items() if c.delay == "estimate")),
            hold=between,
            open_hold=hold == "auto",
            role=role,
            clock_std=clock_std,
            gap=gap,
            drive=drive,
        )

    @property
    def sampling(self) -> float:
        """Median interval between rows, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def input_sampling(self) -> float:
        """Median time for which a recorded value of the inputs acts, s."""
        return float(np.median(np.diff(self.time if self.drive is None else self.drive.time)))

    @property
    def pieces(self) -> tuple[Recording, ...]:
        """The recording between its gaps, without what nothing can be learned from: a row alone, or rows without a sample of an output."""
        found = runs(self)
        if len(found) == 1:
            return (self,)
        counted = enumerate(found, start=self.part)
        return tuple(self._piece(rows, part) for part, rows in counted if rows.stop - rows.start > 1 and self._sampled(rows))

    def _sampled(self, rows: slice) -> list[str]:
        return [name for name, y in self.outputs.items() if np.isfinite(y[rows]).any()]

    def _piece(self, rows: slice, part: int) -> Recording:
        inputs = {name: u[rows] for name, u in self.inputs.items()}
        outputs = {name: self.outputs[name][rows] for name in self._sampled(rows)}
        return replace(self, time=self.time[rows], inputs=inputs, outputs=outputs, gap=np.inf, part=part)

    @property
    def title(self) -> str:
        """The name, and of a piece after a gap also where it starts."""
        return self.name if not self.part else f"{self.name} from t = {number(self.time[0])} s"


def check_word(word: str, allowed: Sequence[str], *, where: str) -> None:
    """Raise InputError unless `word` is one of the allowed ones."""
    if word not in allowed:
        raise InputError(f'{where} is "{word}"; it must be ' + " or ".join(f'"{a}"' for a in allowed))


def _column(values: Any, where: str) -> Array:
    """An own, read-only copy as a flat array of float64; where: what it is, for the error."""
    try:
        column = np.array(values, dtype=np.float64).ravel()
    except (TypeError, ValueError) as error:
        raise InputError(f"{where} is no array of numbers: {error}") from error
    column.flags.writeable = False
    return column


def _time(table: Table, clock: InputColumn, label: str) -> Array:
    t = table.columns[clock.column]
    if t.size < 2:
        count = "one row" if t.size else "a header but no rows"
        raise InputError(f"{label}: {count}; a recording needs at least two rows")
    if clock.unit is not None:
        t = to_si(t, clock.unit, "s", where=f'{label}: time column "{clock.column}"')
    check_clock(t, label, f'time column "{clock.column}"', table.row)
    return t


def _called(table: Table, rows: np.ndarray) -> Callable[[int], str]:
    """What to call the k-th of these rows in a message."""
    return lambda k: table.row(int(rows[k]))


def _kept_rows(t: Array, span: Sequence[float] | None, every: int, label: str, column: str) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the rows inside `span`, and of those that are kept, one in `every`."""
    if isinstance(every, bool) or not isinstance(every, int) or every < 1:
        raise InputError(f"{label}: every is {every}; it is a whole number from 1 on (1 keeps every row)")
    rows = np.arange(t.size)
    recorded = f'"{column}" runs from {number(t[0])} to {number(t[-1])} s'
    if span is not None:
        if len(span) != 2 or not all(np.isfinite(s) for s in span) or span[0] >= span[1]:
            raise InputError(f"{label}: range is {list(span)}; it must be two times [from, to] in seconds, the earlier one first")
        rows = rows[(t >= span[0]) & (t <= span[1])]
        if rows.size < 2:
            raise InputError(f"{label}: range {list(span)} holds {'one row' if rows.size else 'no row'}; {recorded}")
    kept = rows[::every]
    if kept.size < 2:
        raise InputError(f"{label}: every = {every} leaves one row of {rows.size}; make it smaller")
    return rows, kept
