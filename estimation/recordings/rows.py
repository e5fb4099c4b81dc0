"""Rows of text that come one by one: what a recording's columns say, for whoever cannot wait for the end of the file.

A row that cannot be read in part is not lost: its missing cells are missing samples, and what was wrong is said.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from backsight.models.errors import InputError, suggestion

from .columns import InputColumn, OutputColumn
from .table import MISSING
from .units import to_si

DELIMITERS = ",;\t"


@dataclass(frozen=True, kw_only=True)
class Row:
    """time [s], inputs and outputs [SI], NaN where missing; wrong: what could not be read, in words. time is NaN where that could not."""

    time: float
    inputs: Mapping[str, float]
    outputs: Mapping[str, float]
    wrong: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Cell:
    """Where a signal's number stands in a row, and number -> factor * number + offset in SI."""

    place: int
    column: str
    factor: float
    offset: float


class RowReader:
    """Reads rows under a header; the columns as `Recording.read` takes them, units: SI unit of every signal of the model."""

    def __init__(
        self,
        header: str,
        *,
        time: InputColumn,
        inputs: Mapping[str, InputColumn],
        outputs: Mapping[str, OutputColumn],
        units: Mapping[str, str],
        label: str,
    ) -> None:
        self.delimiter = max(DELIMITERS, key=header.count) if any(d in header for d in DELIMITERS) else ","
        self.names = [name.strip() for name in self._cells(header.removeprefix("\ufeff"))]
        self.label, self.number = label, 1
        for name, column in outputs.items():
            if column.delay not in (0.0, "estimate"):
                remedy = 'write delay = "estimate", or shift the samples before they are sent'
                raise InputError(f"{label}: output {name} has delay = {column.delay:g}, which rows that come in now cannot have; {remedy}")
        self._time = self._cell("time", time.column, time.unit, "s")
        self._inputs = {name: self._cell(name, c.column, c.unit, units.get(name)) for name, c in inputs.items()}
        self._outputs = {name: self._cell(name, c.column, c.unit, units.get(name)) for name, c in outputs.items()}

    def read(self, line: str) -> Row:
        """The next row."""
        self.number += 1
        cells, wrong = self._cells(line), list[str]()
        if len(cells) != len(self.names):
            wrong.append(f"{self.label}, line {self.number}: {len(cells)} cells under a header of {len(self.names)}")
        return Row(
            time=self._value(cells, self._time, wrong),
            inputs={name: self._value(cells, cell, wrong) for name, cell in self._inputs.items()},
            outputs={name: self._value(cells, cell, wrong) for name, cell in self._outputs.items()},
            wrong=tuple(wrong),
        )

    def _cells(self, line: str) -> list[str]:
        return next(csv.reader([line.rstrip("\r\n")], delimiter=self.delimiter), [])

    def _cell(self, signal: str, column: str, unit: str | None, si: str | None) -> _Cell:
        if column not in self.names:
            raise InputError(f'{self.label}: the header has no column "{column}" of {signal}; {suggestion(column, self.names)}')
        ends = np.array([0.0, 1.0])
        if unit is not None:
            ends = to_si(ends, unit, si, where=f'{self.label}: column "{column}" of {signal}')
        return _Cell(self.names.index(column), column, float(ends[1] - ends[0]), float(ends[0]))

    def _value(self, cells: Sequence[str], cell: _Cell, wrong: list[str]) -> float:
        text = cells[cell.place].strip() if cell.place < len(cells) else ""
        if text in MISSING:
            return math.nan
        try:
            value = cell.factor * float(text) + cell.offset
        except ValueError:
            value = math.inf
        if math.isfinite(value):
            return value
        wrong.append(f'{self.label}, line {self.number}: column "{cell.column}" is "{text}", no finite number; taken as missing')
        return math.nan
