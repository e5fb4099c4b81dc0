"""What `smooth` gives back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from .problem import Weights
from .validation.together import largest_rejected
from .wording import measured

if TYPE_CHECKING:
    from backsight.ocp import Solution

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

DOUBT = 0.01  # chance of what is seen if all hypotheses of a run hold, below which one is doubted aloud
DETERMINED = 0.5  # a parameter counts as identified when its std is below this share of its size
TELLING = 1.2  # factor on a deviation from which on it is said


@dataclass(frozen=True, kw_only=True)
class ParameterEstimate:
    """A parameter after the fit.

    std: None when fixed, not determined or on its bound. identifiable: whether the recordings determine it; None when fixed. on_bound:
    whether it ended on its bound, beyond which the recordings pull it. size: of what may have either sign its nominal size, else 0.
    """

    name: str
    value: float
    std: float | None
    unit: str
    fixed: bool
    identifiable: bool | None = None
    guess: float | None = None
    on_bound: bool = False
    size: float = 0.0

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit not in ("", "1") else ""
        if self.std is None or not self.std > 0:
            if self.fixed or self.on_bound:
                return f"{self.value:.6g}{unit} ({'fixed' if self.fixed else 'on its bound'})"
            return f"{self.value:.3g}{unit} (not determined)"
        if not np.isfinite([self.value, self.std]).all():
            return f"{self.value:.6g} ± {self.std:.2g}{unit}"
        value, std = measured(self.value, self.std)
        untold = "" if self.identifiable is not False else " (not told from 0)" if self.near_zero else " (not determined)"
        return f"{value} ± {std}{unit}{untold}"

    @property
    def near_zero(self) -> bool:
        """Whether it is known to be no larger than a small part of its size or of what was guessed, and not whether it is there at all."""
        if self.identifiable is not False or self.std is None or self.guess is None:
            return False
        return self.std < DETERMINED * max(abs(self.guess), self.size)


@dataclass(frozen=True, kw_only=True)
class Trimmed:
    """A fit without the samples that a robust loss found far off, `outliers` in number; rms and fit_percent as in `OutputFit`."""

    rms: float
    fit_percent: float | None
    outliers: int


@dataclass(frozen=True, kw_only=True)
class OutputFit:
    """How well one output is met.

    rms [unit of the output] of measured minus smoothed; fit_percent 100 (1 - |e|/|y - mean y|). Of the standardised prediction errors
    (`validation/innovations.py`), or of measured minus modelled where nothing was smoothed: whiteness_p and normality_p, chances of what
    is seen if they are white, and normal, of a machine that rests now and then while it moves; effective_samples: how many independent
    ones of `samples` their mean is worth; prediction_rms: 1 where the weights are right; None where nothing was smoothed. trimmed: the
    same fit without its outliers; None where no loss expects any, or none was found.
    """

    rms: float
    fit_percent: float | None
    whiteness_p: float | None
    normality_p: float | None = None
    effective_samples: float | None = None
    samples: int = 0
    prediction_rms: float | None = None
    trimmed: Trimmed | None = None

    @property
    def ordinary(self) -> OutputFit | Trimmed:
        """Whose rms and fit_percent are those of the samples that count in full."""
        return self.trimmed or self

    @property
    def overstated(self) -> float:
        """By how much stated deviations may be too small for what is slow: 1 where the prediction errors are white and of size one."""
        if self.whiteness_p is None or not self.effective_samples or not self.whiteness_p < DOUBT:
            return 1.0
        return (self.prediction_rms or 1.0) * float(np.sqrt(self.samples / self.effective_samples))


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
class Companion:
    """What a residual force goes with most: words for it, the law that would look like it, the correlation and its standard deviation."""

    what: str
    law: str
    correlation: float
    std: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Memory:
    """Of an Ornstein-Uhlenbeck force: correlation time tau [s] and rms [unit of the force]."""

    tau: float
    rms: float


@dataclass(frozen=True, kw_only=True)
class ResidualSummary:
    """A place's residual force over all recordings: rms [unit] and the equation it belongs to.

    Near rest, in a share rest_share of the samples, it stands in for a friction law (`smoothing/rest.py`): rest_rms is of these, rms of
    the others, or of all where there are no others. whiteness_p: chance of its autocorrelation if the force is white; memory: where that
    is small, how long and how large the force is that remembers. follows: what it goes with most, if plainly, with the law that would
    look like that and the correlation with its standard deviation.
    """

    place: str
    unit: str
    rms: float
    origin: str
    whiteness_p: float | None = None
    memory: Memory | None = None
    follows: Companion | None = None
    rest_share: float = 0.0
    rest_rms: float | None = None


def doubted(fit: Mapping[str, Mapping[str, OutputFit]], residuals: Mapping[str, ResidualSummary]) -> float:
    """Up to which p the tests of one run are doubted, so that in all of them together a true hypothesis has the chance DOUBT."""
    tests = [p for outputs in fit.values() for f in outputs.values() for p in (f.whiteness_p, f.normality_p)]
    tests += [r.whiteness_p for r in residuals.values()]
    return largest_rejected((p for p in tests if p is not None and np.isfinite(p)), DOUBT)


@dataclass(frozen=True, kw_only=True)
class Criteria:
    """How well the model explains the samples for the freedom it took (`validation/criteria.py`); None where that is not determined.

    first_states: what the first two gain where as much is known of each first state as one sample tells (`validation/innovations.py`): of
    models with different states only with it they are of one kind.
    """

    log_evidence: float | None
    log_likelihood: float | None
    aic: float
    bic: float
    effective_parameters: float
    samples: int
    first_states: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Profile:
    """Profile likelihood of a parameter: values (n,) in ascending order and the least cost (n,) above the optimum's at each.

    lower, upper: ends of the 95 % interval; None on a side where it is open. limited: sides, of "lower" and "upper", on which a bound
    ended it.
    """

    name: str
    unit: str
    estimate: float
    std: float | None
    values: Array
    cost: Array
    lower: float | None
    upper: float | None
    limited: tuple[str, ...] = ()

    @property
    def asymmetry(self) -> float | None:
        """(upper - estimate) / (estimate - lower); None where a side is open. 1 is what a normal distribution has."""
        if self.lower is None or self.upper is None or not self.estimate > self.lower:
            return None
        return (self.upper - self.estimate) / (self.estimate - self.lower)


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """What the fitted model makes of a recording that it has not seen.

    estimates: t_s, outputs with .measured and states, simulated over the whole recording under its inputs from the start that its first
    `start_s` seconds tell (of the longest piece), and again after every gap; NaN in rows of no piece. fit: of every measured output to
    that, in the rows after those that told a start. window_rms: output -> rms error [unit] over windows of `window_s` seconds, each
    simulated from the state that the samples before it tell; None where the recording is too short for windows. own: of a parameter that
    varies the value with which its longest piece was simulated, which the samples of its start told too.
    """

    estimates: pd.DataFrame
    fit: dict[str, OutputFit]
    start_s: float
    window_s: float | None = None
    window_rms: Mapping[str, float] = field(default_factory=dict)
    own: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Smoothing:
    """States, residual forces and parameters that explain the recordings best.

    parameters: of one that drifts the mean over time, with the mean of its standard deviations, which that of the mean does not exceed; one
    that every recording has of its own is called "<parameter> [<recording>]" in each.
    estimates: recording name -> one row per sample: t_s, outputs with .measured and .std, states with .std, residual.<place> with
    .std (SI), what drifts and measured inputs as they acted, by their names, with .std; a std is inf where the recordings do not determine
    the value. correlation: of the estimated constants that have a deviation, in the order of `parameters`, by name. held_out: recording
    name -> prediction. solution: the solved program behind it, for what goes on from there.
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
    correlation: pd.DataFrame = field(default_factory=pd.DataFrame)
    held_out: dict[str, Prediction] = field(default_factory=dict)
    criteria: Criteria | None = None
    profiles: dict[str, Profile] = field(default_factory=dict)
    solution: Solution | None = field(default=None, repr=False, compare=False)

    def __getstate__(self) -> dict[str, object]:
        # a program is functions of this process
        return {**self.__dict__, "solution": None}

    @property
    def doubted(self) -> float:
        """Up to which p a test of whiteness or normality is doubted: see the function of this name."""
        return doubted(self.fit, self.residual_places)

    @property
    def overstated(self) -> float:
        """The largest factor, over recordings and outputs, by which stated deviations may be too small (`OutputFit.overstated`)."""
        fits, level = [f for outputs in self.fit.values() for f in outputs.values()], self.doubted
        return max((f.overstated for f in fits if f.whiteness_p is not None and f.whiteness_p <= level), default=1.0)

    def covariance(self, parameters: Sequence[str]) -> Array:
        """Of estimated constants, (n, n) [their units]. Raises ValueError where one has no deviation."""
        std = [self.parameters[name].std for name in parameters]
        if None in std:
            raise ValueError(f"{parameters[std.index(None)]}: it has no deviation")
        sizes = np.array(std, dtype=np.float64)
        return np.asarray(self.correlation.loc[list(parameters), list(parameters)].to_numpy(float) * np.outer(sizes, sizes))

    def value(self, parameter: str) -> float:
        """A parameter's value [its unit]; of one that every recording has of its own the mean over them."""
        if parameter in self.parameters:
            return self.parameters[parameter].value
        return float(np.mean([p.value for name, p in self.parameters.items() if name.startswith(f"{parameter} [")]))

    def __repr__(self) -> str:
        free = ", ".join(f"{p.name} = {p}" for p in self.parameters.values() if not p.fixed)
        return f"Smoothing({self.model}: {free or 'no free parameter'}; {self.solver.status})"
