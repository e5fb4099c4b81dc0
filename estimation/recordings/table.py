"""Named columns of numbers out of a csv, csv.gz, parquet, mat or mf4 file.

A csv file is read by pandas' parser at full speed; only when it refuses, or when a row has another number of cells than
the header, is the file gone through again slowly to say which line, column and value is to blame.
"""

from __future__ import annotations

import csv
import gzip
import io
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from backsight.models.errors import InputError, suggestion

from ..wording import quoted
from .culprit import Blame, first_bad_cell, first_uneven_row, line_of_row

Array = np.ndarray[tuple[int], np.dtype[np.float64]]
MISSING = ("", "nan", "NaN", "NAN", "Nan", "-nan", "-NaN")
SUFFIXES = (".csv", ".csv.gz", ".parquet", ".mat", ".mf4", ".mdf")


@dataclass(frozen=True, kw_only=True)
class Table:
    """Columns of float64, a missing cell being NaN, and how to call a row in a message."""

    columns: Mapping[str, Array]
    row: Callable[[int], str]


def read_table(
    path: Path, clock: str, wanted: Sequence[str], *, label: str, held: Mapping[str, Literal["zero", "linear"]] | None = None
) -> Table:
    """The columns `clock`, the time, and `wanted` of a file; `label` is the file's name as the user typed it, for messages.

    held: those of `wanted` that are inputs, and what they do between their samples: needed where every column has times of its own.

    Raises InputError naming file, line, column, value and remedy.
    """
    name = path.name.lower()
    readers: dict[str, Callable[[bytes, list[str], str], Table]] = {
        ".csv": _read_csv,
        ".csv.gz": partial(_read_csv, packed=True),
        ".parquet": _read_parquet,
        ".mat": _read_mat,
    }
    reader = next((read for suffix, read in readers.items() if name.endswith(suffix)), None)
    if not name.endswith(SUFFIXES):
        raise InputError(f"{label}: this type of file cannot be read; recordings are {', '.join(SUFFIXES)}")
    try:
        if path.is_dir():
            raise InputError(f"{label}: this is a folder; name the recording's file in it")
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{label}: no such file in {path.parent.resolve()}; {_neighbours(path)}") from None
    except OSError as error:
        raise InputError(f"{label}: cannot be read ({error.strerror or error}); check the file's permission") from None
    if not data:
        raise InputError(f"{label}: the file is empty; a header and at least two rows are needed")
    if reader is None:
        from .mdf import read_mdf  # beside the others: it needs an extra of its own

        return read_mdf(data, clock, [column for column in dict.fromkeys(wanted) if column != clock], held or {}, label)
    return reader(data, list(dict.fromkeys([clock, *wanted])), label)


def _neighbours(path: Path) -> str:
    try:
        files = sorted(p.name for p in path.parent.iterdir() if p.name.lower().endswith(SUFFIXES))
    except OSError:
        return "that folder cannot be opened either"
    return suggestion(path.name, files) if files else "there is no recording in that folder"


def _read_csv(data: bytes, wanted: list[str], label: str, packed: bool = False) -> Table:
    import pandas as pd

    text = _decoded(_unpacked(data, label, packed), label)
    rest = io.StringIO(text, newline="")  # what follows the header, which takes several lines where a quoted name holds a line break
    try:
        header = [cell.strip() for cell in next(csv.reader(rest))]
    except (StopIteration, csv.Error):
        header = []
    if not any(header):
        raise InputError(f"{label}, line 1: no column names; the first line must be a header")
    indices = _indices(header, wanted, label)
    uneven = first_uneven_row(text, len(header))
    if uneven is not None:
        raise InputError(f"{label}, {uneven.where}: {uneven.value}; every row needs as many cells as the header")
    try:
        frame = pd.read_csv(
            rest,
            header=None,
            usecols=indices,
            names=range(len(header)),
            dtype=np.float64,
            na_values=list(MISSING),
            keep_default_na=False,
            skipinitialspace=True,
            skip_blank_lines=True,
            engine="c",
        )
    except pd.errors.EmptyDataError:
        raise InputError(f"{label}: a header but no rows; at least two are needed") from None
    except (ValueError, pd.errors.ParserError) as error:
        blame = first_bad_cell(text, dict(zip(wanted, indices, strict=True)), MISSING)
        raise InputError(f"{label}, {_accuse(blame)}" if blame else f"{label}: {error}") from None
    columns = {name: frame[i].to_numpy() for name, i in zip(wanted, indices, strict=True)}
    return Table(columns=columns, row=lambda k: f"line {line_of_row(text, k)}")


def _unpacked(data: bytes, label: str, packed: bool) -> bytes:
    """The bytes themselves, or what they were before gzip."""
    if not packed:
        if data[:2] == b"\x1f\x8b":
            raise InputError(f"{label}: this file is packed by gzip; name it .csv.gz")
        return data
    try:
        return gzip.decompress(data)
    except gzip.BadGzipFile:
        raise InputError(f"{label}: this is not a gzip file; if it holds plain text, name it .csv") from None
    except (EOFError, zlib.error, OSError):
        raise InputError(f"{label}: the gzip file is cut short or damaged; copy or pack it again") from None


def _decoded(data: bytes, label: str) -> str:
    """Text from UTF-8 with or without a byte order mark, lines ended by a bare newline."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise InputError(f"{label}: the text is encoded as UTF-16; save it as UTF-8")
    zero = data.find(b"\0")
    if zero >= 0:
        raise InputError(f"{label}, line {data.count(10, 0, zero) + 1}: a zero byte, so this is no text; a csv file is wanted here")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        byte = data[error.start]
        raise InputError(f"{label}, line {line}: byte 0x{byte:02x} is not UTF-8; save the file with the encoding UTF-8") from None
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def _indices(header: list[str], wanted: list[str], label: str) -> list[int]:
    """Where the wanted columns stand in the header."""
    for name in wanted:
        if header.count(name) > 1:
            places = quoted(str(i + 1) for i, cell in enumerate(header) if cell == name)
            raise InputError(f'{label}, line 1: the column "{name}" occurs more than once (columns {places}); rename one of them')
        if name not in header:
            if len(header) == 1 and any(mark in header[0] for mark in ";\t"):
                mark = "semicolons" if ";" in header[0] else "tabs"
                raise InputError(
                    f'{label}, line 1: no column "{name}", the cells are separated by {mark}; '
                    "save the file with commas between cells and a point as decimal separator"
                )
            raise InputError(f'{label}, line 1: no column "{name}"; {suggestion(name, [cell for cell in header if cell])}')
    return [header.index(name) for name in wanted]


def _accuse(blame: Blame) -> str:
    value = blame.value if len(blame.value) <= 40 else blame.value[:37] + "..."
    remedy = (
        "write it with a decimal point"
        if "," in value
        else "write a number, or leave the cell of an output empty where the sample is missing"
    )
    return f'{blame.where}, column "{blame.column}": "{value}" is not a number; {remedy}'


def _read_parquet(data: bytes, wanted: list[str], label: str) -> Table:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise InputError(
            f"{label}: parquet files need pyarrow; install it by `pip install backsight[io]`, or save the recording as csv"
        ) from None
    try:
        file = pq.ParquetFile(pa.BufferReader(data))
        _indices(list(file.schema_arrow.names), wanted, label)
        table = file.read(columns=wanted)
    except (pa.ArrowException, OSError) as error:
        raise InputError(f"{label}: this is no readable parquet file ({str(error).splitlines()[0].rstrip('.')}); write it again") from None
    return _from_arrays({name: table.column(name).to_numpy() for name in wanted}, label)


def _read_mat(data: bytes, wanted: list[str], label: str) -> Table:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        source: Any = io.BytesIO(data)  # scipy's stubs know of paths only
        content = loadmat(source)
    except NotImplementedError:
        raise InputError(f"{label}: this mat file is of version 7.3; save it in MATLAB with the option -v7") from None
    except (MatReadError, ValueError, TypeError, OSError, EOFError, KeyError, IndexError, zlib.error, OverflowError, MemoryError) as error:
        reason = str(error).splitlines()[0].rstrip(".") if str(error) else type(error).__name__
        raise InputError(f"{label}: this is no readable mat file ({reason}); save it again") from None
    names = [name for name in content if not name.startswith("__")]
    for name in wanted:
        if name not in names:
            raise InputError(f'{label}: no variable "{name}"; {suggestion(name, names)}')
        check_kind(content[name], name, label)
        if np.ndim(content[name]) > 2 or min(np.shape(content[name]), default=1) > 1:
            shape = " x ".join(map(str, np.shape(content[name])))
            raise InputError(f'{label}: the variable "{name}" is an array of {shape}; a column of numbers is wanted')
    return _from_arrays({name: np.ravel(content[name]) for name in wanted}, label)


def _from_arrays(arrays: Mapping[str, np.ndarray], label: str) -> Table:
    """Typed columns: only real numbers will do, all of one length."""
    lengths = {name: len(values) for name, values in arrays.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f'"{name}" {n}' for name, n in lengths.items())
        raise InputError(f"{label}: columns of unequal length ({listed}); all need the same number of rows")
    for name, values in arrays.items():
        check_kind(values, name, label)
    return Table(columns={name: np.asarray(v, dtype=np.float64) for name, v in arrays.items()}, row=lambda k: f"row {k + 1}")


def check_kind(values: np.ndarray, name: str, label: str) -> None:
    """Raise InputError unless these are real numbers."""
    kinds = {"M": "dates", "m": "durations", "c": "complex numbers", "U": "text", "S": "text"}
    sound = values.dtype.kind in "fiub" or (values.dtype.kind == "O" and all(isinstance(v, (int, float, type(None))) for v in values.flat))
    if not sound:
        seen = kinds.get(values.dtype.kind, "something else")
        raise InputError(f'{label}: the column "{name}" holds {seen}; numbers are wanted (the time in seconds)')
