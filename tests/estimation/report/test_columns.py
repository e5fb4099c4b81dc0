"""Columns by role."""

import pandas as pd

from backsight.estimation.report.columns import Columns


def test_columns_are_told_apart_by_their_names() -> None:
    names = "recording t_s x x.measured x.std carriage.s carriage.s.std carriage.v carriage.v.std residual.carriage residual.carriage.std"
    kinds = Columns.of(pd.DataFrame(columns=names.split()))
    assert kinds == Columns(outputs=("x",), states=("carriage.s", "carriage.v"), residuals=("residual.carriage",))
