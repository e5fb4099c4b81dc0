"""The Radau IIA method: its tableau and its measured order."""

import numpy as np
import pytest

from backsight.models import Model, compile_model
from backsight.models.mechanics.translational import Mass, Spring
from backsight.models.radau import STAGES, Stepper, tableau


def test_the_three_stage_tableau_is_the_published_one() -> None:
    c, a, _ = tableau(3)  # Hairer and Wanner, table IV.5.6
    r = np.sqrt(6.0)
    assert c == pytest.approx([(4 - r) / 10, (4 + r) / 10, 1.0])
    assert a == pytest.approx(
        np.array(
            [
                [(88 - 7 * r) / 360, (296 - 169 * r) / 1800, (-2 + 3 * r) / 225],
                [(296 + 169 * r) / 1800, (88 + 7 * r) / 360, (-2 - 3 * r) / 225],
                [(16 - r) / 36, (16 + r) / 36, 1 / 9],
            ]
        )
    )


def test_the_quadrature_of_five_stages_is_exact_to_degree_eight() -> None:
    c, a, error = tableau(STAGES)
    for degree in range(2 * STAGES - 1):
        assert a[-1] @ c**degree == pytest.approx(1.0 / (degree + 1), rel=1e-12)
    for degree in range(STAGES):  # the error weights vanish on what both quadratures integrate
        assert error @ np.concatenate([[0.0**degree], c**degree]) == pytest.approx(0.0, abs=1e-13)


def test_one_step_is_of_order_nine() -> None:
    model = Model(name="swing", components={"body": Mass(m=1.0)}, connections=[]).insert("body", Spring(k=1.0))
    dae = compile_model(model)
    errors = []
    for h in (2.0, 1.0):
        stepper = Stepper(dae, np.array(dae.parameter_values()), rtol=1e9)  # any error passes: one step
        x, _, _ = stepper.across(np.array([1.0, 0.0]), np.zeros(0), 0.0, h, np.zeros(0), np.zeros(0), np.inf)
        errors.append(np.abs(x - [np.cos(h), -np.sin(h)]).max())
    assert 9.0 < np.log2(errors[0] / errors[1]) < 11.0
