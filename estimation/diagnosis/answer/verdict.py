"""What `diagnose` answers: what is missing, where, how sure that is, what else it could be, and what could not have been seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import nan
from typing import TYPE_CHECKING, Literal

import numpy as np

from .repaired import as_declared

if TYPE_CHECKING:
    from backsight.models import Model

    from ...problem import Problem
    from ...results import Smoothing

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
EVERYWHERE = "whole record"  # the regime of what acts wherever the machine moves
FEWEST = 3  # blocks that can refute a repair
REFUTED = 0.1  # chance that windows are predicted as much worse, or worse still, by a model that is as good
HARDLY = 1.0  # percent: what is fitted anew without an effect may be worse by as much elsewhere
DOUBTED = 0.1  # chance that windows are predicted as much better, or better still, by a model that is no better

Key = tuple[str, ...]  # place, physics, the parameters that are wrong, and whether they change
CHANGES = "from some time on"
Class = Literal["none", "parameter", "sensor", "input", "missing_physics", "unknown_physics", "undecided"]


@dataclass(frozen=True, kw_only=True)
class Strength:
    """A number of a finding with its standard deviation (None where the recordings do not tell it) and unit."""

    value: float
    std: float | None
    unit: str


def keyed(place: str, physics: str, subject: tuple[str, ...], *, changes: bool) -> Key:
    """What an explanation is, whatever its numbers are. changes: a parameter is another one from some time on, and not wrong all along."""
    return (place, physics, *subject, *((CHANGES,) if changes else ()))


def titled(place: str, physics: str, *subject: str) -> str:
    """The key of an explanation in words: what it is, and where, or of which parameters."""
    if subject and subject[-1] == CHANGES:
        return f"change of {', '.join(subject[:-1])}"
    return f"{physics.replace('_', ' ')} {', '.join(subject) or f'at {place}'}"


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """One explanation of the mismatch: a member of the library at a place. gap: log evidence that it lacks against the one chosen.

    subject: the parameters of the model that are said to be wrong, of which a component has several. given: whether it says that a number
    of the study itself is wrong, also one that is nothing. changes: they are others from some time on, and not all along.
    """

    place: str
    family: str
    physics: str
    subject: tuple[str, ...] = ()
    given: bool = False
    changes: bool = False
    gap: float = 0.0
    parameters: Mapping[str, Strength] = field(default_factory=dict)

    @property
    def key(self) -> Key:
        """What it is, whatever its numbers are."""
        return keyed(self.place, self.physics, self.subject, changes=self.changes)

    @property
    def where(self) -> str:
        """The place, or what is wrong there."""
        return ", ".join(self.subject) or self.place

    @property
    def words(self) -> str:
        """coulomb friction at drive_2; wrong parameter drive_2.J."""
        return titled(*self.key)


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One effect that the model left out.

    explanation: what it is, with its parameters. p_value: chance of as much evidence anywhere in the library if nothing were missing;
    NaN of what no score tells of. gain: log evidence over the model without it. regime: where it acts, in words; onset: time from which
    on it does [s], None from the start; until: to which, None to the end. share: rms of its force over that of the forces at its place.
    alternatives: explanations that were refused, with their gaps, best first. rivals: those that these recordings cannot tell from it, and
    separates: what would tell them apart. change: the edit of the model, in words of code. described: what a force without a name goes
    with, in words.
    """

    explanation: Explanation
    p_value: float
    gain: float
    change: str
    regime: str = EVERYWHERE
    onset: float | None = None
    until: float | None = None
    share: float | None = None
    alternatives: tuple[Explanation, ...] = ()
    rivals: tuple[Explanation, ...] = ()
    separates: str = ""
    described: str = ""


@dataclass(frozen=True, kw_only=True)
class Undetectable:
    """The least strength of an effect that these recordings would have shown [unit], inf where they show none."""

    place: str
    physics: str
    parameter: str
    strength: float
    unit: str


TOO_SMALL = "too small to matter"  # why an effect was refused that does less than what matters


@dataclass(frozen=True, kw_only=True)
class Tried:
    """A candidate that was fitted.

    predicted: its gain by the score [nats]. fitted: the gain in log evidence after the fit, None where it failed. refused: why it was.
    """

    explanation: Explanation
    predicted: float
    fitted: float | None = None
    refused: str = ""


@dataclass(frozen=True, kw_only=True)
class Mismatch:
    """The residual force at a place, where the evidence is largest: time (n,), force (n,) and std (n,) of it, and what it may hang on.

    against: "time", "position", "velocity", "load", ... with its unit -> values (n,). recording: its name.
    """

    place: str
    unit: str
    recording: str
    time: Array
    force: Array
    std: Array
    against: Mapping[str, tuple[Array, str]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Of one output on what was held out: rms of the windowed prediction error, horizon [s] -> rms [unit]."""

    unit: str
    windows: Mapping[float, float]


@dataclass(frozen=True, kw_only=True)
class HeldOut:
    """The proof on recordings that the fit has not seen: base model refitted (before) against the repaired one (after), if there is one.

    improvement_percent: of the windowed prediction errors, geometric mean over outputs and horizons. p_value: one-sided, over blocks.
    force: place -> rms of the residual force (before, after). attainable_percent: of what forces that are free at every place would take
    from the errors (arithmetic mean over outputs and horizons), None where that is next to nothing. role: "held_out", or "last third" of
    the only recording. repaired: whether there is a repaired model; without, after is before, and gain and chance are NaN.
    """

    before: Mapping[str, Errors]
    after: Mapping[str, Errors]
    improvement_percent: float
    p_value: float
    blocks: int
    recordings: tuple[str, ...]
    role: str
    force: Mapping[str, tuple[float, float, str]] = field(default_factory=dict)
    attainable_percent: float | None = None
    repaired: bool = True

    @property
    def unrepaired(self) -> HeldOut:
        """Of the base model alone: what it predicts. There is no gain."""
        force = {place: (first, first, unit) for place, (first, _, unit) in self.force.items()}
        alone = replace(self, repaired=False, after=self.before, force=force)
        return replace(alone, improvement_percent=nan, p_value=nan, attainable_percent=None)

    @property
    def refuting(self) -> bool:
        """Whether the repaired model predicts worse, beyond what chance would do."""
        return self.improvement_percent < 0 and self.blocks >= FEWEST and self.p_value > 1.0 - REFUTED

    @property
    def doubtful(self) -> bool:
        """Whether chance alone might have the repaired model predict as much better, as far as there are blocks that tell."""
        return self.improvement_percent < 0 or self._by_chance

    @property
    def untold(self) -> bool:
        """Whether there are blocks that tell, and by these it predicts better by next to nothing, or as chance would have it."""
        return self._by_chance or (self.blocks >= FEWEST and not self.improvement_percent >= HARDLY)

    @property
    def _by_chance(self) -> bool:
        return self.blocks >= FEWEST and not self.p_value <= DOUBTED


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """The answer. before: the model as declared, smoothed; after: with the findings in it (the same where there are none).

    tried: every candidate, round by round, best first. mismatch: the residual forces before and after the repair. seed: as it was given.
    repaired: the problem with the findings in its model; `model` has the numbers that were found, too.
    """

    verdict: Class
    findings: tuple[Finding, ...]
    before: Smoothing
    after: Smoothing
    repaired: Problem
    held_out: HeldOut | None
    undetectable: tuple[Undetectable, ...]
    tried: tuple[Tried, ...]
    mismatch: tuple[Mismatch, ...] = ()
    seconds: float = 0.0
    seed: int = 0
    notes: tuple[str, ...] = ()

    @property
    def model(self) -> Model:
        """The model with the findings in it and all parameters as they were estimated: to simulate, to write as code, to export."""
        return as_declared(self.repaired.model, {name: p.value for name, p in self.after.parameters.items()})
