"""Recordings: sound files are read exactly, unsound ones are refused by a message that finds the culprit."""

from __future__ import annotations

import gzip
import io
import re
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from backsight.estimation.recordings.columns import InputColumn, OutputColumn
from backsight.estimation.recordings.recording import Recording
from backsight.estimation.recordings.units import OTHERS, to_si
from backsight.models.errors import InputError

T = np.arange(400) * 0.005
SOUND = pd.DataFrame({"t_s": T, "F_N": np.sin(4 * T), "x_m": 0.1 * np.cos(4 * T)})


def text(frame: pd.DataFrame = SOUND) -> bytes:
    return frame.to_csv(index=False, float_format="%.17g").encode()


def spoiled(line: int, column: int, cell: str) -> bytes:
    """The sound file with one cell replaced; the header is line 1."""
    rows = [row.split(b",") for row in text().splitlines()]
    rows[line - 1][column] = cell.encode()
    return b"\n".join(b",".join(row) for row in rows) + b"\n"


def read(folder: Path, content: bytes, name: str = "record.csv", **options) -> Recording:
    (folder / name).write_bytes(content)
    options = {"time": "t_s", "inputs": {"F": "F_N"}, "outputs": {"x": "x_m"}} | options
    return Recording.read(folder / name, **options)


def refused(folder: Path, content: bytes, *words: str, name: str = "record.csv", **options) -> str:
    with pytest.raises(InputError) as caught:
        read(folder, content, name, **options)
    message = str(caught.value)
    assert "\n" not in message
    for word in (name, *words):
        assert word in message, f"{word!r} is not in {message!r}"
    return message


# ---------------------------------------------------------------- sound files


def test_a_csv_file_is_read_to_the_last_digit(tmp_path):
    recording = read(tmp_path, text())
    assert np.array_equal(recording.time, T)
    assert np.array_equal(recording.inputs["F"], SOUND["F_N"])
    assert np.array_equal(recording.outputs["x"], SOUND["x_m"])
    assert (recording.name, recording.hold, recording.role) == ("record.csv", "zero", "fit")


@pytest.mark.parametrize(
    "content",
    [
        text().replace(b"\n", b"\r\n"),
        b"\xef\xbb\xbf" + text(),
        text().rstrip(b"\n"),
        text() + b"\n\n",
        text().replace(b",", b" , "),
        text().replace(b"x_m", b'"x_m"'),
        text(SOUND.assign(note="a, b", other="text")[["note", "x_m", "other", "t_s", "F_N"]]),
        text(SOUND.assign(note="two\nlines")),
        text(SOUND.assign(**{'a note\nof 3.5" discs\nand more': 1.0})),
    ],
    ids=[
        "CRLF",
        "byte order mark",
        "no last line end",
        "blank lines at the end",
        "blanks",
        "quoted header",
        "other columns",
        "line breaks in cells",
        "line breaks in the header",
    ],
)
def test_harmless_variants_of_csv_read_the_same(tmp_path, content):
    recording = read(tmp_path, content)
    assert np.array_equal(recording.time, T)
    assert np.array_equal(recording.inputs["F"], SOUND["F_N"])
    assert np.array_equal(recording.outputs["x"], SOUND["x_m"])


def test_gzip_parquet_and_mat_files_read_the_same(tmp_path):
    savemat(tmp_path / "source.mat", {k: SOUND[k].to_numpy() for k in SOUND})
    for name, content in (("r.csv.gz", gzip.compress(text())), ("r.mat", (tmp_path / "source.mat").read_bytes())):
        recording = read(tmp_path, content, name)
        assert np.array_equal(recording.outputs["x"], SOUND["x_m"])


def test_a_packed_file_may_be_called_anything(tmp_path):
    (tmp_path / "r.csv.gz").write_bytes(gzip.compress(text()))
    found = Recording.read(tmp_path / "r.csv.gz", name="fit", time="t_s", inputs={"F": "F_N"}, outputs={"x": "x_m"})
    assert found.name == "fit"
    assert np.array_equal(found.outputs["x"], SOUND["x_m"])


@pytest.mark.checkout
def test_parquet_files_read_the_same(tmp_path):
    pytest.importorskip("pyarrow")
    SOUND.astype({"x_m": "float64"}).to_parquet(tmp_path / "source.parquet")
    recording = read(tmp_path, (tmp_path / "source.parquet").read_bytes(), "r.parquet")
    assert np.array_equal(recording.outputs["x"], SOUND["x_m"])


def test_parquet_without_pyarrow_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    refused(tmp_path, b"PAR1", "pip install backsight[io]", name="r.parquet")


@pytest.mark.parametrize("cell", ["", "nan", "NaN", "  "])
def test_an_empty_cell_or_nan_in_an_output_is_a_missing_sample(tmp_path, cell):
    recording = read(tmp_path, spoiled(101, 2, cell))
    assert np.flatnonzero(np.isnan(recording.outputs["x"])).tolist() == [99]


def test_time_may_jitter_have_gaps_and_start_anywhere(tmp_path):
    t = T + 1.7e9 + 1e-4 * np.sin(np.arange(400))
    recording = read(tmp_path, text(SOUND.assign(t_s=t)[(T < 0.8) | (T > 0.95)]))
    assert np.array_equal(recording.time, t[(T < 0.8) | (T > 0.95)])


def test_range_keeps_the_rows_between_its_ends_and_every_thins_those(tmp_path):
    recording = read(tmp_path, text(), range=(0.5, 1.0), every=10)
    assert np.array_equal(recording.time, T[100:201:10])
    assert np.array_equal(recording.inputs["F"], SOUND["F_N"][100:201:10])


def test_a_bad_input_value_outside_the_range_does_no_harm(tmp_path):
    assert read(tmp_path, spoiled(5, 1, "nan"), range=(0.5, 1.0)).time.size == 101
    refused(tmp_path, spoiled(150, 1, "nan"), "line 150", "F_N", range=(0.5, 1.0))


@pytest.mark.parametrize("every", [1, 10])
@pytest.mark.parametrize(("place", "value"), [(1, "nan"), (1, ""), (2, "inf")])
def test_a_bad_value_is_one_whether_its_row_is_kept_or_not(tmp_path, every, place, value):
    """Between the rows that are kept the inputs act as recorded, so there has to be a record of them."""
    assert read(tmp_path, spoiled(5, place, value), range=(0.5, 1.0), every=every).time.size == -(-101 // every)
    refused(tmp_path, spoiled(156, place, value), "line 156", range=(0.5, 1.0), every=every)


def test_an_output_of_which_no_kept_row_has_a_sample_is_named(tmp_path):
    thin = text(SOUND.assign(x_m=SOUND["x_m"].where(np.arange(T.size) % 10 == 5)))
    refused(tmp_path, thin, 'column "x_m"', "no number in any row", every=10)


@pytest.mark.parametrize(
    ("unit", "expected", "factor"),
    [
        ("mm", "m", 1e-3),
        ("deg", "rad", np.pi / 180),
        ("rpm", "rad/s", 2 * np.pi / 60),
        ("rev/s", "rad/s", 2 * np.pi),
        ("kN", "N", 1e3),
        ("mN.m", "N.m", 1e-3),
        ("g0", "m/s2", 9.80665),
        ("m/s^2", "m/s2", 1.0),
        ("kg.cm2", "kg.m2", 1e-4),
        ("inch", None, 0.0254),
        ("mA", "A", 1e-3),
    ],
)
def test_columns_are_converted_to_the_units_of_the_model(tmp_path, unit, expected, factor):
    units = {"x": expected} if expected else {}
    recording = read(tmp_path, text(), outputs={"x": OutputColumn("x_m", std=1e-5, unit=unit)}, units=units)
    np.testing.assert_allclose(recording.outputs["x"], factor * SOUND["x_m"], rtol=1e-12)
    assert recording.output_std == {"x": 1e-5}


def test_a_deviation_may_stand_beside_a_column_that_says_none(tmp_path):
    recording = read(tmp_path, text(), outputs={"x": OutputColumn("x_m", unit="mm"), "y": "x_m"}, std={"x": 1e-6})
    assert recording.output_std == {"x": 1e-6, "y": None}


def test_inputs_and_the_time_may_have_units_too(tmp_path):
    recording = read(tmp_path, text(SOUND.assign(t_s=1e3 * T)), time=InputColumn("t_s", "ms"), inputs={"F": InputColumn("F_N", "kN")})
    np.testing.assert_allclose(recording.time, T, atol=1e-15)
    np.testing.assert_allclose(recording.inputs["F"], 1e3 * SOUND["F_N"])


@pytest.mark.parametrize("unit", ["furlongz", "kg", "m//", ""])
def test_a_unit_that_does_not_fit_names_column_unit_and_expected_unit(tmp_path, unit):
    message = refused(tmp_path, text(), "x_m", f'"{unit}"', outputs={"x": OutputColumn("x_m", unit=unit)}, units={"x": "m"})
    assert "converted to m" in message or "not known" in message


@pytest.mark.parametrize(
    ("unit", "expected", "remedy"),
    [
        ("g", "m/s2", 'write "g0", standard gravity'),
        ("g", "N", 'write one of "N", "mN", "kN", "kgf" or "lbf"'),
        ("Nm", "N.m", 'write "N.m"'),
        ("U/min", "rad/s", 'write "rpm"'),
        ("milisec", "s", 'write one of "s", "ms"'),
        ("furlongz", "Pa", 'write it as in "mm"'),
    ],
)
def test_a_unit_that_does_not_fit_has_a_remedy(tmp_path, unit, expected, remedy):
    refused(tmp_path, text(), f'"{unit}"', remedy, outputs={"x": OutputColumn("x_m", unit=unit)}, units={"x": expected})


BY_HAND = {
    "mm": 1e-3, "um": 1e-6, "in": 0.0254, "mrad": 1e-3, "deg": np.pi / 180, "rev": 2 * np.pi, "ms": 1e-3, "us": 1e-6, "min": 60, "h": 3600,
    "mm/s": 1e-3, "m/min": 1 / 60, "km/h": 1 / 3.6, "deg/s": np.pi / 180, "rev/s": 2 * np.pi, "rpm": 2 * np.pi / 60, "mm/s2": 1e-3,
    "g0": 9.80665, "deg/s2": np.pi / 180, "rev/s2": 2 * np.pi, "mN": 1e-3, "kN": 1e3, "kgf": 9.80665, "lbf": 0.45359237 * 9.80665,
    "N.mm": 1e-3, "mN.m": 1e-3, "kN.m": 1e3, "lbf.in": 0.45359237 * 9.80665 * 0.0254, "mA": 1e-3, "kA": 1e3, "mV": 1e-3, "kV": 1e3,
}  # fmt: skip


def test_the_units_that_messages_name_are_understood():
    found = {unit: to_si(np.ones(1), unit, si, where="")[0] for si, units in OTHERS.items() for unit in units}
    assert found == pytest.approx(BY_HAND, rel=1e-12)


def test_the_readme_lists_the_units_that_messages_name(checkout):
    rows = re.findall(r"^\| `([^`]+)` \| (`.+`) \|$", (checkout / "estimation/study/README.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert {si: tuple(others.strip("`").split("`, `")) for si, others in rows if si in OTHERS} == OTHERS


@pytest.mark.parametrize("unit", ["Hz", "1/min", "1/s", "count/s"])
def test_what_counts_is_not_taken_for_radians(tmp_path, unit):
    refused(tmp_path, text(), f'"{unit}"', '"rev/s" or "rad/s"', outputs={"x": OutputColumn("x_m", unit=unit)}, units={"x": "rad/s"})


def test_a_delay_that_is_a_multiple_of_the_sampling_shifts_samples_untouched(tmp_path):
    recording = read(tmp_path, text(), outputs={"x": OutputColumn("x_m", delay=0.015)})
    assert np.array_equal(recording.outputs["x"][:-3], SOUND["x_m"][3:])
    assert np.isnan(recording.outputs["x"][-3:]).all()


def test_with_any_other_delay_the_samples_keep_times_of_their_own(tmp_path):
    delay = 0.0072
    late = SOUND.assign(x_m=np.cos(4 * (T - delay)))
    recording = read(tmp_path, text(late), outputs={"x": OutputColumn("x_m", delay=delay)})
    np.testing.assert_allclose(recording.time, (T - delay)[2:], atol=1e-12)
    np.testing.assert_allclose(recording.outputs["x"], np.cos(4 * recording.time), atol=1e-12)


def test_a_delay_loses_no_sample_but_those_of_before_a_piece(tmp_path):
    kept = (T < 0.5) | (T > 0.95)
    holes = SOUND.assign(x_m=np.where(np.arange(400) == 50, np.nan, SOUND["x_m"]))[kept]
    recording = read(tmp_path, text(holes), outputs={"x": OutputColumn("x_m", delay=0.002)})
    there = kept.copy()
    there[[0, 50, int(np.flatnonzero(T > 0.95)[0])]] = False
    np.testing.assert_allclose(recording.time, T[there] - 0.002, atol=1e-12)
    np.testing.assert_array_equal(recording.outputs["x"], SOUND["x_m"][there])


def test_a_quarter_of_a_million_rows_are_read_at_the_pace_of_pandas(tmp_path):
    t = np.arange(250_000) * 1e-3
    content = text(pd.DataFrame({"t_s": t, "F_N": np.sin(t), "x_m": np.cos(t)}))
    ratios = []
    for _ in range(3):
        began = time.perf_counter()
        assert read(tmp_path, content).time.size == 250_000
        between = time.perf_counter()
        pd.read_csv(io.BytesIO(content))
        ratios.append((between - began) / (time.perf_counter() - between))
    assert min(ratios) < 30.0  # nine on a quiet machine; row by row in Python it would be hundreds


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(-1e50, 1e50), min_size=2, max_size=20))
def test_whatever_number_is_written_comes_back(tmp_path_factory, values):
    frame = pd.DataFrame({"t_s": np.arange(len(values), dtype=float), "F_N": values, "x_m": values})
    recording = read(tmp_path_factory.mktemp("any"), text(frame))
    assert np.array_equal(recording.inputs["F"], values)


# ---------------------------------------------------------------- unsound files


@pytest.mark.parametrize(
    ("column", "cell", "words"),
    [
        (0, "nan", ("line 101", "t_s", "missing")),
        (0, "", ("line 101", "t_s", "missing")),
        (0, "inf", ("line 101", "t_s", "inf")),
        (0, "12:00:01", ("line 101", "t_s", "12:00:01")),
        (0, "0.0", ("line 101", "t_s", "runs back")),
        (0, "0.49", ("line 101", "t_s", "repeats 0.49")),
        (1, "nan", ("line 101", "F_N", "input F", "missing")),
        (1, "", ("line 101", "F_N", "input F", "missing")),
        (1, "-inf", ("line 101", "F_N", "-inf")),
        (1, "off", ("line 101", "F_N", '"off"')),
        (2, "inf", ("line 101", "x_m", "output x", "inf")),
        (2, "broken", ("line 101", "x_m", '"broken"')),
        (2, '"0,25"', ("line 101", "x_m", '"0,25"', "decimal point")),
        (2, "1e300", ("line 101", "x_m", "1e+300", "too large")),
        (2, "0x1F", ("line 101", "x_m", '"0x1F"')),
        (2, "1_000", ("line 101", "x_m", '"1_000"')),
        (2, "TRUE", ("line 101", "x_m", '"TRUE"')),
        (2, "1e-5,7", ("line 101", "4 cells", "3")),
        (2, "x" * 500, ("line 101", "x_m", "xxx...")),
    ],
)
def test_a_bad_cell_is_named_by_line_column_and_value(tmp_path, column, cell, words):
    assert len(refused(tmp_path, spoiled(101, column, cell), *words)) < 400


def test_lines_are_counted_right_after_cells_with_line_breaks(tmp_path):
    content = b't_s,F_N,x_m,note\n0,1,1,"a\nb"\n1,1,off,c\n'
    refused(tmp_path, content, "line 4", "x_m", '"off"')
    refused(tmp_path, content.replace(b"off", b"inf"), "line 4", "x_m", "inf")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b'"t\n[s]",F,x\n0,1,1\n1,1,off\n', ("line 4", '"x"', '"off"')),
        (b'"t\n[s]",F,x\n0,1,1\n2,1,1\n1,1,1\n', ("line 5", "runs back from 2.0 to 1.0")),
        (b'"t\n[s]",F,x\n0,1,1\n1,inf,1\n', ("line 4", "input F", "inf")),
        (b'"t\n[s]",F,x\n0,1,1\n1,1,1,1\n', ("line 4", "4 cells")),
    ],
)
def test_lines_are_counted_right_below_a_header_of_two_lines(tmp_path, content, words):
    (tmp_path / "record.csv").write_bytes(content)
    with pytest.raises(InputError) as caught:
        Recording.read(tmp_path / "record.csv", time="t\n[s]", inputs={"F": "F"}, outputs={"x": "x"})
    assert all(word in str(caught.value) for word in words), caught.value


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", ("empty",)),
        (b"\n\n", ("line 1", "column names")),
        (b"t_s,F_N,x_m\n", ("no rows",)),
        (b"t_s,F_N,x_m\n0,1,2\n", ("one row", "at least two")),
        (text().replace(b"x_m", b"pos"), ("line 1", '"x_m"')),
        (text().replace(b"x_m", b"x_mm"), ('"x_m"', "did you mean 'x_mm'")),
        (text(SOUND.assign(other=1.0)).replace(b"other", b"x_m"), ('"x_m"', "more than once")),
        (SOUND.to_csv(index=False, sep=";", decimal=",").encode(), ("semicolons", "decimal")),
        (SOUND.to_csv(index=False, sep="\t").encode(), ("tabs",)),
        (text().replace(b"x_m", b"x_\xe4"), ("line 1", "0xe4", "UTF-8")),
        (text().decode().encode("utf-16"), ("UTF-16", "UTF-8")),
        (bytes(np.random.default_rng(4).integers(0, 256, 5000, dtype=np.uint8)), ("line",)),
        (gzip.compress(text()), (".csv.gz",)),
        (text(SOUND.assign(x_m=np.nan)), ("x_m", "no number")),
        (text(SOUND.assign(t_s=0.0)), ("t_s", "repeats 0.0")),
        (text().replace(b"\n", b"\n\n", 3), ("line 2", "empty")),
        (text()[: text().rindex(b",")], ("line 401", "2 cells", "3")),
    ],
)
def test_a_bad_file_is_refused_by_one_sentence(tmp_path, content, words):
    refused(tmp_path, content, *words)


@pytest.mark.parametrize(
    ("name", "content", "word"),
    [
        ("r.csv.gz", gzip.compress(text())[:-200], "cut short"),
        ("r.csv.gz", text(), "not a gzip file"),
        ("r.mat", b"MATLAB 5.0 not really", "mat file"),
        ("r.mat", b"rubbish" * 100, "mat file"),
        ("r.xyz", text(), ".parquet"),
    ],
)
def test_a_damaged_or_unknown_type_of_file_is_named(tmp_path, name, content, word):
    refused(tmp_path, content, word, name=name)


@pytest.mark.checkout
def test_damaged_parquet_is_named(tmp_path):
    pytest.importorskip("pyarrow")
    refused(tmp_path, b"PAR1 not really PAR1", "parquet", name="r.parquet")


def test_a_mat_file_of_version_7_3_is_refused_with_the_way_out(tmp_path):
    """Such a file is HDF5 behind a header of 128 bytes that says so (MathWorks, MAT-File Level 5 File Format, 1-6)."""
    header = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM"
    refused(tmp_path, header + bytes(512), "version 7.3", "-v7", name="record.mat")


def test_mat_variables_must_be_columns_of_one_length(tmp_path):
    for variables, word in (
        ({"t_s": T, "F_N": T, "x_m": np.ones((3, 3))}, "3 x 3"),
        ({"t_s": T, "F_N": T, "x_m": T[:9]}, "unequal length"),
        ({"t_s": T, "F_N": T, "x_mm": T}, "did you mean 'x_mm'"),
        ({"t_s": T, "F_N": T, "x_m": T * 1j}, "complex"),
        ({"t_s": T, "F_N": T, "x_m": "text"}, "text"),
        ({"t_s": ["a", "b"], "F_N": [1, 2], "x_m": [1, 2]}, "text"),
    ):
        savemat(tmp_path / "source.mat", variables)
        refused(tmp_path, (tmp_path / "source.mat").read_bytes(), word, name="r.mat")


def test_a_missing_file_names_its_nearest_neighbour_and_a_folder_is_no_recording(tmp_path):
    (tmp_path / "record_1.csv").write_bytes(text())
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(InputError, match=r"record_2\.csv: no such file.*did you mean 'record_1\.csv'"):
        Recording.read(tmp_path / "record_2.csv", time="t_s", inputs={}, outputs={})
    with pytest.raises(InputError, match=r"folder\.csv: this is a folder"):
        Recording.read(tmp_path / "folder.csv", time="t_s", inputs={}, outputs={})


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"range": (50.0, 60.0)}, ("range", "[50.0, 60.0]", "0 to 1.995")),
        ({"range": (1.5, 0.5)}, ("range", "earlier one first")),
        ({"range": (1.0, 1.001)}, ("range", "one row")),
        ({"range": (1.0,)}, ("range", "two times")),
        ({"range": (0.0, float("nan"))}, ("range", "two times")),
        ({"every": 0}, ("every is 0",)),
        ({"every": 1000}, ("every = 1000", "smaller")),
        ({"hold": "cubic"}, ("hold", '"cubic"', '"linear"')),
        ({"role": "training"}, ("role", '"training"', '"held_out"')),
        ({"std": {"x": -1.0}}, ("std", "x", "-1.0")),
        ({"outputs": {"x": InputColumn("x_m", "mm")}}, ("column of output x is InputColumn", "OutputColumn(name")),
        ({"outputs": {"x": 3}}, ("column of output x is 3", "OutputColumn(name")),
        ({"inputs": {"F": 3}}, ("column of input F is 3", "InputColumn(name")),
        ({"outputs": {"x": OutputColumn("x_m", std=1e-5)}, "std": {"x": 1e-6}}, ("std of x is given twice", "1e-06", "1e-05")),
        ({"outputs": {"x": OutputColumn("x_m", delay=-0.1)}}, ("delay", "-0.1")),
        ({"outputs": {"x": OutputColumn("x_m", delay=7.0)}}, ("delay", "1.995")),
    ],
)
def test_an_unusable_option_is_named_with_its_value(tmp_path, options, words):
    refused(tmp_path, text(), *words, **options)


# ---------------------------------------------------------------- recordings made from arrays


def test_a_recording_cannot_be_changed_from_outside():
    time_axis = T.copy()
    recording = Recording(name="bench", time=time_axis, inputs={"F": T}, outputs={"x": T})
    time_axis[0] = 99.0
    assert recording.time[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        recording.time[0] = 1.0
    with pytest.raises(AttributeError):
        recording.name = "other"  # type: ignore[misc]


@pytest.mark.parametrize(
    ("parts", "word"),
    [
        ({"time": T[::-1]}, "row 2"),
        ({"inputs": {"F": T[:-1]}}, "input F has 399 values"),
        ({"inputs": {"F": np.where(T[7] == T, np.nan, T)}}, "row 8"),
        ({"outputs": {"x": np.where(T[7] == T, np.inf, T)}}, "row 8"),
        ({"output_std": {"x": 0.0}}, "std of output x is 0.0; it must be positive; leave it out"),
        ({"time": T[:1], "inputs": {}, "outputs": {}}, "one row"),
    ],
)
def test_arrays_are_checked_like_files(parts, word):
    with pytest.raises(InputError, match=word):
        Recording(**({"name": "bench", "time": T, "inputs": {"F": T}, "outputs": {"x": T}} | parts))


def test_a_deviation_of_an_output_that_is_not_read_is_refused(tmp_path):
    (tmp_path / "run.csv").write_text("t,u,y\n0,1,2\n0.1,1,2\n0.2,1,3\n")
    with pytest.raises(InputError, match=r"run.csv: std of 'X': no such output is read; .*x"):
        Recording.read(tmp_path / "run.csv", time="t", inputs={"F": "u"}, outputs={"x": "y"}, std={"X": 1e-3})
