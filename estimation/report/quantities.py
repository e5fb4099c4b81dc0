"""Numbers and units as an engineer writes them: 95.011 ± 0.027 kg, 1.04 µm, N·s/m."""

import math
import re

import numpy as np

from ..wording import percentage

__all__ = ["count", "number", "percent", "pretty", "quantity", "scaled", "uncertain"]

NOTHING = "–"
_PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
_PREFIXABLE = re.compile(r"(m|N|s|A|V|W|J|Pa|Hz|rad|H|F)(?![A-Za-z0-9^*])")
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def pretty(unit: str) -> str:
    """The unit with middle dots and raised exponents: "kg.m2/s2" is kg·m²/s²; a pure number has none."""
    text = re.sub(r"(?<=[A-Za-z0-9)])[.*](?=[A-Za-z(])", "·", unit.strip()).replace("sqrt(s)", "√s")
    text = re.sub(r"(?<=[A-Za-z)])(?:\^|\*\*)?(-?\d+)", lambda found: found[1].translate(_SUPERSCRIPT), text)
    return "" if text in {"1", "-"} else text


def scaled(largest: float, unit: str) -> tuple[float, str]:
    """Factor and unit that bring values up to `largest` [unit] into a readable range: (1e6, "µm") for 2e-6 m.

    Values between 0.1 and 10 000 stay as they are, and so do units that take no prefix (kg, m², pure numbers) and times above 1 ms.
    """
    size = abs(largest)
    if not (np.isfinite(size) and size > 0) or 0.1 <= size < 1e4 or not _PREFIXABLE.match(unit) or (unit == "s" and size >= 0.1):
        return 1.0, pretty(unit)
    power = min(max(3 * math.floor(math.log10(size) / 3 + 1e-12), -12), 9)
    return 10.0**-power, _PREFIXES[power] + pretty(unit)


def number(value: float | None, digits: int = 4) -> str:
    """`digits` significant digits; a dash for what is missing; powers of ten written out."""
    if value is None or math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value != 0 and not 1e-4 <= abs(value) < 1e6:
        mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
        return f"{mantissa}·10{str(int(exponent)).translate(_SUPERSCRIPT)}".replace("-", "−")
    text = f"{value:.{digits}g}"
    if "e" in text:
        text = f"{float(text):.0f}"
    return text.replace("-", "−")


def count(n: int) -> str:
    """A whole number with thin spaces between the thousands: 10 001."""
    return f"{n:,}".replace(",", "\u202f")


def quantity(value: float | None, unit: str, digits: int = 3) -> str:
    """A value with its unit, prefixed where that reads better: 1.04 µm."""
    if value is None or not np.isfinite(value):
        return number(value)
    factor, shown = scaled(value, unit)
    return f"{number(value * factor, digits)} {shown}".rstrip()


def uncertain(value: float | None, std: float | None) -> tuple[str, str]:
    """Value and standard deviation to the same decimals, two digits of the deviation: ("95.011", "0.027")."""
    if value is None or std is None or not (np.isfinite(value) and np.isfinite(std) and std > 0):
        return number(value, 6), number(std, 2)
    std = float(f"{std:.1e}")
    decimals = 1 - math.floor(math.log10(std))
    if decimals < 0 or decimals > 8 or abs(value) >= 1e7:
        digits = max(2, 2 + math.floor(math.log10(abs(value))) - math.floor(math.log10(std))) if value else 2
        return number(value, min(digits, 12)), number(std, 2)
    return f"{value:.{decimals}f}".replace("-", "−"), f"{std:.{decimals}f}"


def percent(share: float | None) -> str:
    """A percentage (already times 100) with as many nines as it takes to see what is missing to 100: 99.9989 %."""
    if share is None or not np.isfinite(share):
        return NOTHING
    return percentage(share).replace("-", "−")
