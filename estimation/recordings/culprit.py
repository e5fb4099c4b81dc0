"""The slow second look at a csv file: which line, which column, which value."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Blame:
    """Where a csv file goes wrong ("line 102"), and what stands there."""

    where: str
    column: str
    value: str


def first_uneven_row(text: str, columns: int) -> Blame | None:
    """The first row whose number of cells is not the header's; None when there is none.

    Blank lines at the end are no rows. Without quotes the commas between line ends are counted as bytes, all at once.
    """
    body = text.rstrip("\n ")
    if '"' in body:
        reader = csv.reader(io.StringIO(body, newline=""))
        start = 1
        for cells in reader:
            if len(cells) != columns:
                return _uneven(start, len(cells) if any(cells) else 0, columns)
            start = reader.line_num + 1
        return None
    data = np.frombuffer(body.encode(), dtype=np.uint8)
    ends = np.append(np.flatnonzero(data == ord("\n")), len(data))
    commas = np.diff(np.searchsorted(np.flatnonzero(data == ord(",")), ends), prepend=0)
    lengths = np.diff(ends, prepend=-1) - 1
    bad = np.flatnonzero((commas != columns - 1) | (lengths == 0))
    if len(bad) == 0:
        return None
    return _uneven(int(bad[0]) + 1, int(commas[bad[0]]) + 1 if lengths[bad[0]] else 0, columns)


def _uneven(line: int, found: int, wanted: int) -> Blame:
    return Blame(where=f"line {line}", column="", value=f"{found} cells where the header has {wanted}" if found else "the line is empty")


def first_bad_cell(text: str, columns: Mapping[str, int], missing: Sequence[str]) -> Blame | None:
    """The first cell, row by row, of the given columns (name -> index) that is not a number."""
    reader = csv.reader(io.StringIO(text, newline=""))
    next(reader)
    start = reader.line_num + 1
    for cells in reader:
        for name, index in columns.items():
            cell = cells[index].strip() if index < len(cells) else ""
            if cell not in missing and not _is_number(cell):
                return Blame(where=f"line {start}", column=name, value=cell)
        start = reader.line_num + 1
    return None


def line_of_row(text: str, row: int) -> int:
    """The line where a row begins, counted from 1; rows count from 0, below the header."""
    reader = csv.reader(io.StringIO(text, newline=""))
    for _ in range(row + 1):
        next(reader)
    return reader.line_num + 1


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell and cell.isascii()
