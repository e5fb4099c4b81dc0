"""The sentences of the answer."""

import pytest

from backsight.estimation.report.answer import whiteness_sentence


@pytest.mark.parametrize(
    ("p", "r", "said"),
    [
        (None, None, "not tested"),
        (float("nan"), None, "not tested"),
        (0.3, {1: 0.02}, "cannot be told from white noise"),
        (0.02, None, "weak signs of structure"),
        (1e-9, None, "structure is left in the errors"),
        (1e-9, {1: 0.01, 2: -0.055}, "weak signs of structure, largest autocorrelation −0.055 at lag 2"),
        (1e-9, {1: 0.7, 2: 0.4}, "structure is left in the errors, largest autocorrelation 0.7 at lag 1"),
        (1e-9, {}, "structure is left in the errors"),
    ],
)
def test_whiteness_is_judged_by_significance_and_by_size(p: float | None, r: dict[int, float] | None, said: str) -> None:
    assert whiteness_sentence(p, r) == said
