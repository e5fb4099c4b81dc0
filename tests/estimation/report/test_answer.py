"""The sentences of the answer."""

import pytest

from backsight.estimation.report.answer import whiteness_sentence
from backsight.estimation.results import OutputFit


@pytest.mark.parametrize(
    ("p", "effective", "said"),
    [
        (None, None, "not tested"),
        (float("nan"), None, "not tested"),
        (0.3, 2000.0, "cannot be told from white noise"),
        (0.02, 900.0, "weak signs of structure"),
        (1e-9, None, "weak signs of structure"),
        (1e-9, 1950.0, "weak signs of structure"),
        (1e-9, 312.4, "structure is left in them: 312 effective of 2\u202f000 samples"),
    ],
)
def test_whiteness_is_judged_by_significance_and_by_size(p: float | None, effective: float | None, said: str) -> None:
    fit = OutputFit(rms=1.0, fit_percent=99.0, whiteness_p=p, effective_samples=effective, samples=2000)
    assert whiteness_sentence(fit, 0.01) == said
