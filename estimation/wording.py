"""Words that messages share: lists of names, and numbers as a person would write them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def quoted(names: Iterable[str], *, last: str = "and") -> str:
    """`"a", "b" and "c"`."""
    words = [f'"{name}"' for name in names]
    return words[0] if len(words) == 1 else f" {last} ".join([", ".join(words[:-1]), words[-1]]) if words else "none"


def number(value: float) -> str:
    """Nine digits at most, without trailing zeros."""
    return f"{value:.9g}"


def per_root_bandwidth(unit: str) -> str:
    """Unit of the deviation of a white force whose values have this unit: the root of its spectral density."""
    if unit.endswith("/s"):
        return f"{unit.removesuffix('/s')}/sqrt(s)"
    return "sqrt(s)" if unit in ("", "1") else f"{unit}.sqrt(s)"


def listed(words: Sequence[str]) -> str:
    """a, b and c."""
    return " and ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else "".join(words)
