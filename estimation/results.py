"""What `smooth` gives back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from .problem import Weights

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@dataclass(frozen=True, kw_only=True)
class ParameterEstimate:
    """A parameter after the fit.

    std: None when fixed or not determined. identifiable: whether the recordings determine it; None when fixed.
    """

    name: str
    value: float
    std: float | None
    unit: str
    fixed: bool
    identifiable: bool | None = None
    guess: float | None = None

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit not in ("", "1") else ""
        if self.std is None or not self.std > 0:
            return f"{self.value:.6g}{unit}" + (" (fixed)" if self.fixed else " (not determined)")
        digits = max(0, 1 - int(np.floor(np.log10(self.std))))
        return f"{self.value:.{min(digits, 15)}f} ± {self.std:.2g}{unit}"


@dataclass(frozen=True, kw_only=True)
class OutputFit:
    """How well one output is met.

    rms [unit of the output] of measured minus smoothed; fit_percent 100 (1 - |e|/|y - mean y|); whiteness_p of Ljung and Box.
    """

    rms: float
    fit_percent: float | None
    whiteness_p: float | None


@dataclass(frozen=True, kw_only=True)
class SolverFacts:
    """How the solver fared: a sentence, counts and seconds. variables: unknowns of the program."""

    status: str
    converged: bool
    iterations: int
    seconds: float
    build_seconds: float
    variables: int


@dataclass(frozen=True, kw_only=True)
class ResidualSummary:
    """A place's residual force over all recordings: rms [unit] and the equation it belongs to."""

    place: str
    unit: str
    rms: float
    origin: str


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """What the fitted model makes of a recording that it has not seen.

    estimates: t_s, outputs with .measured and states, simulated over the whole recording under its inputs from the start that its first
    `start_s` seconds tell. fit: of every measured output to that. window_rms: output -> rms error [unit] over windows of `window_s`
    seconds, each simulated from the state that the samples before it tell; None where the recording is too short for windows.
    """

    estimates: pd.DataFrame
    fit: dict[str, OutputFit]
    start_s: float
    window_s: float | None = None
    window_rms: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Smoothing:
    """States, residual forces and parameters that explain the recordings best.

    estimates: recording name -> one row per sample: t_s, outputs with .measured and .std, states with .std, residual.<place> with
    .std (SI); a std is inf where the recordings do not determine the value. held_out: recording name -> prediction.
    """

    model: str
    parameters: dict[str, ParameterEstimate]
    estimates: dict[str, pd.DataFrame]
    inputs: dict[str, dict[str, Array]]
    units: Mapping[str, str]
    fit: dict[str, dict[str, OutputFit]]
    weights: Weights
    solver: SolverFacts
    residual_places: dict[str, ResidualSummary]
    notes: tuple[str, ...] = field(default=())
    held_out: dict[str, Prediction] = field(default_factory=dict)

    def __repr__(self) -> str:
        free = ", ".join(f"{p.name} = {p}" for p in self.parameters.values() if not p.fixed)
        return f"Smoothing({self.model}: {free or 'no free parameter'}; {self.solver.status})"
