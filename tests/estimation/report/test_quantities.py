"""Numbers and units as they are printed."""

import pytest

from backsight.estimation.report.quantities import count, number, percent, pretty, quantity, scaled, uncertain


@pytest.mark.parametrize(
    ("value", "std", "shown"),
    [
        (95.01312, 0.0213, ("95.013", "0.021")),
        (199.87, 3.4, ("199.9", "3.4")),
        (-3.0, 0.5, ("−3.00", "0.50")),
        (1234.0, 56.0, ("1234", "56")),
        (123456.0, 780.0, ("123460", "780")),
        (5.0, None, ("5", "–")),
        (5.0, 0.0, ("5", "0")),
        (float("nan"), 0.1, ("–", "0.1")),
        (None, None, ("–", "–")),
    ],
)
def test_a_value_is_rounded_to_two_digits_of_its_deviation(value: float, std: float | None, shown: tuple[str, str]) -> None:
    assert uncertain(value, std) == shown


@pytest.mark.parametrize(
    ("unit", "shown"), [("N.s/m", "N·s/m"), ("kg.m2", "kg·m²"), ("m/s2", "m/s²"), ("rad", "rad"), ("1", ""), ("", ""), ("s-1", "s⁻¹")]
)
def test_a_unit_is_written_with_dots_and_raised_exponents(unit: str, shown: str) -> None:
    assert pretty(unit) == shown


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [
        (1.04e-6, "m", "1.04 µm"),
        (0.0123, "N.m", "12.3 mN·m"),
        (0.15, "m", "0.15 m"),
        (2.5e4, "N", "25 kN"),
        (2.5e-4, "kg", "0.00025 kg"),
        (3e-6, "m2", "3.00·10⁻⁶ m²"),
        (1e-6, "m", "1 µm"),
        (999.96e-6, "m", "1000 µm"),
        (0.001, "s", "1 ms"),
        (0.02, "samples", "0.02 samples"),
        (float("nan"), "m", "–"),
        (None, "m", "–"),
        (0.0, "m", "0 m"),
    ],
)
def test_a_quantity_takes_the_prefix_that_reads_best(value: float | None, unit: str, shown: str) -> None:
    assert quantity(value, unit) == shown


def test_the_factor_of_a_prefix_brings_the_value_back() -> None:
    for power in range(-13, 12):
        factor, unit = scaled(3.0 * 10.0**power, "m")
        back = {"pm": 1e-12, "nm": 1e-9, "µm": 1e-6, "mm": 1e-3, "m": 1.0, "km": 1e3, "Mm": 1e6, "Gm": 1e9}[unit]
        assert factor * back == pytest.approx(1.0)


def test_percentages_show_what_is_missing_to_a_hundred() -> None:
    assert percent(99.99871) == "99.9987 %"
    assert percent(87.23) == "87.2 %"
    assert percent(-12.0) == "−12.0 %"
    assert percent(None) == percent(float("nan")) == "–"
    assert percent(100.0) == "100.0000000 %"


def test_numbers_count_and_powers_of_ten() -> None:
    assert number(1.5e-9) == "1.500·10⁻⁹"
    assert number(-12345.0) == "−12340"
    assert number(float("inf")) == "∞"
    assert count(1_234_567) == "1\u202f234\u202f567"
