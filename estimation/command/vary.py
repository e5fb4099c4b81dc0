"""Weights that are to be turned, as they are written on the command line: --vary "W of drive_1=0.1,1,10"."""

from __future__ import annotations

from collections.abc import Sequence

from backsight.models.errors import InputError

LIKE = '--vary "W of carriage=0.1,1,10"'


def varied(asked: Sequence[str]) -> dict[str, list[float]]:
    """Label of a weight -> factors on its std. Raises InputError for what is not written so, or written twice."""
    found = dict[str, list[float]]()
    for text in asked:
        label, equals, factors = (part.strip() for part in text.rpartition("="))
        if not (label and equals):
            raise InputError(f'--vary "{text}": needs the label of a weight and factors on its std, as in {LIKE}')
        if label in found:
            raise InputError(f'--vary "{text}": "{label}" is there twice; give all its factors at once, as in {LIKE}')
        found[label] = [_number(text, word) for word in factors.split(",")] if factors else []
    return found


def _number(text: str, word: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise InputError(f'--vary "{text}": "{word.strip()}" is no number; factors stand with commas between them, as in {LIKE}') from None
