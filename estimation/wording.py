"""Words that messages share: lists of names, and numbers as a person would write them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import floor, isfinite, log10

SHORT, LONG = 1e-4, 1e9  # values below and above are written with their power of ten
LEAST_P = 1e-12  # a smaller chance is not spelt out
PLAIN = 1e6  # deviations from which on both are


def quoted(names: Iterable[str], *, last: str = "and") -> str:
    """`"a", "b" and "c"`."""
    words = [f'"{name}"' for name in names]
    return words[0] if len(words) == 1 else f" {last} ".join([", ".join(words[:-1]), words[-1]]) if words else "none"


def capitalised(words: str) -> str:
    """With a capital letter in front, and all others as they are: names keep theirs."""
    return words[:1].upper() + words[1:]


def number(value: float) -> str:
    """Nine digits at most, without trailing zeros."""
    return f"{value:.9g}"


def measured(value: float, std: float) -> tuple[str, str]:
    """A value and its deviation (above 0), which has two digits; the value ends where that does, but has two digits where it has more."""
    rounded = float(f"{std:.1e}")
    order, decimals = floor(log10(abs(value))) if value else 0, 1 - floor(log10(rounded))
    deviation = f"{rounded:.0f}" if 10.0 <= rounded < PLAIN else f"{rounded:#.2g}"
    digits = f"{value:.{min(max(decimals + order, 1), 11)}e}"
    if not (value == 0 or SHORT <= abs(value) < LONG) or rounded >= PLAIN:
        return digits, deviation
    return f"{value:.{min(decimals, 15)}f}" if decimals >= 0 else f"{float(digits):.0f}", deviation


def chance(p: float | None) -> str:
    """0.012, < 1e-12; nothing where there is none."""
    return "" if p is None or not isfinite(p) else f"{p:.2g}" if p > LEAST_P else f"< {LEAST_P:g}"


def probability(p: float | None) -> str:
    """p = 0.012, p < 1e-12; nothing where there is none."""
    said = chance(p)
    return f"p {said}" if said.startswith("<") else f"p = {said}" if said else ""


def percentage(share: float) -> str:
    """A percentage with as many nines as it takes to see what is missing to 100: 99.9989 %."""
    missing = abs(100.0 - share)
    decimals = 1 if missing >= 1 else min(7, 1 - floor(log10(max(missing, 1e-7))))
    return f"{share:.{decimals}f} %"


def per_root_bandwidth(unit: str) -> str:
    """Unit of the deviation of a white force whose values have this unit: the root of its spectral density."""
    if unit.endswith("/s"):
        return f"{unit.removesuffix('/s')}/sqrt(s)"
    return "sqrt(s)" if unit in ("", "1") else f"{unit}.sqrt(s)"


def listed(words: Sequence[str]) -> str:
    """a, b and c."""
    return " and ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else "".join(words)
