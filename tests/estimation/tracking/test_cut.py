"""What ends of a margin, against samples and quadrature."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm, truncnorm

from backsight.estimation.tracking.cut import Cut

CASES = [(0.5, 0.8, 0.4), (1.0, 0.3, 0.5), (2.0, 0.5, 0.4), (0.1, 2.0, 0.3), (-0.2, 0.4, 0.3)]


@pytest.mark.parametrize(("margin", "fall", "std"), CASES)
def test_without_noise_it_is_what_lies_between_none_and_the_fall(margin: float, fall: float, std: float) -> None:
    cut = Cut(margin=margin, fall=fall, std=std, noise=0.0)
    inside = truncnorm(-margin / std, (fall - margin) / std, loc=margin, scale=std)
    lasted = 1 - norm.cdf(0, margin, std)
    assert cut.mass == pytest.approx((norm.cdf(fall, margin, std) - norm.cdf(0, margin, std)) / lasted, rel=1e-9)
    assert cut.share * fall == pytest.approx(inside.mean(), rel=1e-6)
    move, ratio = cut.ends(inside.mean() - margin)
    assert margin + move == pytest.approx(inside.mean(), rel=1e-9)
    assert ratio * std == pytest.approx(inside.std(), rel=1e-6)


@pytest.mark.parametrize(("margin", "fall", "std"), CASES)
def test_both_parts_together_are_the_whole(margin: float, fall: float, std: float) -> None:
    cut = Cut(margin=margin, fall=fall, std=std, noise=0.0)
    mass = norm.cdf(fall, margin, std) - norm.cdf(0, margin, std)
    (move, ratio), (rest, wide) = cut.ends(cut.share * fall - margin), cut.rest()
    assert mass * move + (1 - mass) * rest == pytest.approx(0.0, abs=1e-9)
    square = mass * (move**2 + (ratio * std) ** 2) + (1 - mass) * (rest**2 + (wide * std) ** 2)
    assert square == pytest.approx(std**2, rel=1e-9)


def test_where_all_is_noise_the_past_says_nothing() -> None:
    cut = Cut(margin=0.2, fall=0.1, std=1e-9, noise=0.5)
    assert cut.mass == pytest.approx(norm.cdf(-0.1 / 0.5), rel=1e-6)
    assert cut.ends(-0.2) == pytest.approx((0.0, 1.0), abs=1e-6)
    assert cut.rest() == pytest.approx((0.0, 1.0), abs=1e-6)


def test_a_margin_far_below_its_noise_ends_for_certain() -> None:
    """Without the noise it could not have lasted; with it it will not."""
    assert Cut(margin=-0.04, fall=0.009, std=0.002, noise=0.015).mass > 0.9
    assert Cut(margin=-1.0, fall=0.01, std=0.01, noise=0.0).mass == pytest.approx(1.0)
    assert Cut(margin=1.0, fall=0.01, std=0.01, noise=0.0).mass == 0.0


def test_a_margin_that_rises_ends_by_its_noise_only() -> None:
    assert Cut(margin=0.2, fall=-0.1, std=0.3, noise=0.0).mass == 0.0
    assert Cut(margin=0.2, fall=-0.1, std=1e-9, noise=0.5).mass == pytest.approx(norm.cdf(-0.3 / 0.5), rel=1e-6)


def test_what_a_step_ends_ends_at_once_and_with_what_is_missing() -> None:
    """A margin of 0.3 +- 0.2 that falls by 0.5 at once and by 0.1 on the way: nearly all ends in the step."""
    cut = Cut(margin=0.3, fall=0.6, std=0.2, noise=0.0, jump=0.5)
    inside = truncnorm(-1.5, 1.5, loc=0.3, scale=0.2)
    assert cut.share < 1e-5
    assert cut.left == pytest.approx(inside.mean() - 0.5, rel=1e-6)
    late = Cut(margin=0.9, fall=0.6, std=0.2, noise=0.0, jump=0.1)
    begun = truncnorm(-4.5, -1.5, loc=0.9, scale=0.2).mean()
    assert late.left == 0.0
    assert late.share == pytest.approx((begun - 0.1) / 0.5, rel=1e-6)


def test_breakaway_of_a_load_that_grows_is_dated_as_samples_date_it() -> None:
    """A level of N(1, 0.1^2) under a load that grows by 0.02 a step, with 0.03 of noise anew in each: intervals chained as in a bank."""
    rng, steps = np.random.default_rng(1), np.arange(100)
    level, fall, noise = 1.0 + 0.1 * rng.standard_normal(20000), 0.02, 0.03
    negative = level[:, None] - fall * (steps + 1) + noise * rng.standard_normal((20000, 100)) < 0
    truth = np.bincount(np.argmax(negative, axis=1), minlength=100) / 20000
    mean, std, left, found, levels = 1.0, 0.1, 1.0, np.zeros(100), np.zeros(100)
    for k in steps:
        cut = Cut(margin=mean - fall * k, fall=fall, std=std, noise=noise)
        found[k], left = left * cut.mass, left * (1 - cut.mass)
        levels[k] = mean + cut.ends(cut.share * fall - (mean - fall * k))[0]
        move, ratio = cut.rest()
        mean, std = mean + move, std * ratio
    assert found.sum() == pytest.approx(1.0, abs=1e-3)
    assert 0.5 * np.abs(found - truth).sum() < 0.12
    assert found @ steps == pytest.approx(truth @ steps, abs=1.0)
    assert found @ levels == pytest.approx(1.0, abs=0.03)
