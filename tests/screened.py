"""A candidate with a score, where only these matter."""

from __future__ import annotations

import numpy as np

from backsight.estimation.diagnosis.candidates.candidate import Candidate
from backsight.estimation.diagnosis.scores.score import Columns
from backsight.estimation.diagnosis.scores.screen import Screened
from backsight.estimation.diagnosis.scores.supermodel import Look


def screened(place: str, physics: str, gain: float, size: int = 1) -> Screened:
    """One of `size` strengths of 1, with deviations of 1."""
    c = Candidate(place=place, family="friction", physics=physics, strengths=tuple(f"{physics}.{i}" for i in range(size)))
    nothing = Columns(squares=np.zeros((0, size)), multiplied=np.zeros((0, size)))
    return Screened(look=Look(candidate=c, shape={}, columns=nothing), gain=gain, estimate=np.ones(size), std=np.ones(size), freedom=size)
