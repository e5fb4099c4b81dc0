"""The tables that the command prints: no two numbers that differ look alike."""

from __future__ import annotations

import io
from dataclasses import replace

import pytest
from diagnoses import diagnosis
from rich.console import Console

from backsight.estimation.command.terminal import _size, diagnosis_table
from backsight.estimation.results import OutputFit, Trimmed


@pytest.mark.parametrize(
    ("percent", "shown"),
    [
        (99.99731, "99.9973 %"),
        (99.9999, "99.99990 %"),
        (99.834, "99.83 %"),
        (72.16, "72.2 %"),
        (-1489.73, "-1489.7 %"),
        (None, "no variation to explain"),
    ],
)
def test_a_fit_near_a_hundred_percent_shows_what_is_missing_to_it(percent, shown):
    fit = OutputFit(rms=1.25e-4, fit_percent=percent, whiteness_p=None)
    assert _size(fit, "m") == f"rms 0.000125 m ({shown})"


def test_outliers_that_a_loss_left_out_do_not_count_in_what_is_shown_and_are_counted():
    fit = OutputFit(rms=0.3, fit_percent=-12.0, whiteness_p=None, trimmed=Trimmed(rms=1.25e-4, fit_percent=99.83, outliers=12))
    assert _size(fit, "m") == "rms 0.000125 m (99.83 %) without 12 outliers"


def printed(found) -> str:
    file = io.StringIO()
    Console(file=file, width=200).print(diagnosis_table(found))
    return file.getvalue()


def test_the_parameters_stand_beside_each_other_as_declared_and_with_what_was_found():
    found = diagnosis()
    rows = {line.split()[0]: line for line in printed(found).splitlines() if line}
    before, after = (r.parameters["carriage.m"] for r in (found.before, found.after))
    assert str(before) != str(after)
    assert rows["carriage.m"].index(str(before)) < rows["carriage.m"].index(str(after))
    assert "fitted as declared" in rows["parameter"]
    assert "fitted with what was found" in rows["parameter"]
    assert "friction.width" not in rows  # fixed in both


def test_where_nothing_was_found_they_stand_there_once():
    said = printed(replace(diagnosis(), verdict="none", findings=(), after=diagnosis().before))
    assert said.count(str(diagnosis().before.parameters["carriage.m"])) == 1
    assert "with what was found" not in said
