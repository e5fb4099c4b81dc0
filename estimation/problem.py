"""The estimation problem: a model, recordings, what is known of the parameters, and how much each equation and sensor is trusted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from backsight.models import Dae, Model, compile_model
from backsight.models.errors import InputError, suggestion

from .recordings.recording import Recording


@dataclass(frozen=True)
class Free:
    """A parameter to be estimated [the parameter's unit]: first guess, bounds, and the standard deviation of what is known beforehand."""

    guess: float
    min: float = -np.inf
    max: float = np.inf
    std: float | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.guess) and self.min <= self.guess <= self.max and self.min < self.max):
            raise InputError(
                f"Free(guess={self.guess}, min={self.min}, max={self.max}): needs a finite guess with min <= guess <= max and min < max."
            )
        if self.std is not None and not (np.isfinite(self.std) and self.std > 0):
            raise InputError(f"Free(std={self.std}): a standard deviation is positive and finite; leave it out when nothing is known.")


@dataclass(frozen=True, kw_only=True)
class Weights:
    """W and V as standard deviations (weight = 1/std^2); what is not named is chosen from the data (`noise.py`).

    W: place -> std of its residual force: white noise of spectral density std^2 * 1 s, [unit of the place].
    V: output -> std of its measurement noise [unit of the output]; it overrides the recording's own.
    tau: place -> correlation time [s] of a residual force that is not white.
    """

    W: Mapping[str, float] = field(default_factory=dict)
    V: Mapping[str, float] = field(default_factory=dict)
    tau: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, table in (("W", self.W), ("V", self.V), ("tau", self.tau)):
            object.__setattr__(self, name, dict(table))
            for key, std in table.items():
                if not (np.isfinite(std) and std > 0):
                    raise InputError(f"Weights({name}={{{key!r}: {std}}}): needs a positive, finite number.")


@dataclass(frozen=True, kw_only=True)
class Problem:
    """Everything `smooth` needs.

    model: a `Model` or its compiled `Dae`. recordings: those with role "fit" are fitted, the others predicted. parameters: name ->
    `Free` or a fixed value; those not named keep the model's value. initial: known initial states [SI]; of the others nothing is known.
    """

    model: Model | Dae
    recordings: Sequence[Recording]
    parameters: Mapping[str, Free | float] = field(default_factory=dict)
    weights: Weights = field(default_factory=Weights)
    initial: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        dae = self.dae
        _check("parameters", self.parameters, [p.name for p in dae.parameters], "parameter", dae)
        _check("weights.W", self.weights.W, [p.name for p in dae.places], "place", dae)
        _check("weights.V", self.weights.V, [q.name for q in dae.outputs], "output", dae)
        _check("weights.tau", self.weights.tau, [p.name for p in dae.places], "place", dae)
        _check("initial", self.initial, [q.name for q in dae.states], "state", dae)
        for name, start in self.initial.items():
            if not np.isfinite(start):
                raise InputError(f"initial: {name} = {start}: needs a finite number.")
        if self.weights.tau:
            raise InputError(
                f"weights: tau of {', '.join(self.weights.tau)}: this version knows white residual forces only; leave tau out."
            )
        info = {p.name: p for p in dae.parameters}
        for name, value in self.parameters.items():
            number = value.guess if isinstance(value, Free) else value
            if not info[name].minimum <= number <= info[name].maximum:
                raise InputError(
                    f"parameters: {name} = {number:g} lies outside its physical range "
                    f"{info[name].minimum:g} .. {info[name].maximum:g} {info[name].unit}."
                )
        if not self.fitted:
            raise InputError('Problem(recordings=...) needs at least one recording with role="fit".')
        names = [r.name for r in self.recordings]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(
                f"recordings: more than one is called {twice[0]!r}; give each a name of its own: Recording.read(..., name=...)."
            )
        for recording in self.recordings:
            missing = [q.name for q in dae.inputs if q.name not in recording.inputs]
            if missing:
                raise InputError(
                    f"{recording.name}: input {', '.join(missing)} of {dae.name} is not recorded; name its column under inputs."
                )
            _check(f"{recording.name}: outputs", recording.outputs, [q.name for q in dae.outputs], "output", dae)
            if recording.role == "fit" and not any(np.isfinite(y).any() for y in recording.outputs.values()):
                raise InputError(f"{recording.name}: no output has a value; nothing can be estimated from it.")

    @cached_property
    def dae(self) -> Dae:
        """The compiled model, with residual forces at every balance and at the places named in W."""
        if isinstance(self.model, Dae):
            return self.model
        dae = compile_model(self.model)
        extra = [name for name in self.weights.W if name in {p.name for p in dae.dormant_places}]
        return compile_model(self.model, places=extra) if extra else dae

    @property
    def fitted(self) -> tuple[Recording, ...]:
        """Recordings to be fitted."""
        return tuple(r for r in self.recordings if r.role == "fit")

    @property
    def free(self) -> tuple[int, ...]:
        """Indices of the free parameters in the model's order."""
        return tuple(i for i, p in enumerate(self.dae.parameters) if isinstance(self.parameters.get(p.name), Free))

    @property
    def values(self) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """All parameters: guesses, fixed values and the model's own."""
        given = {name: value.guess if isinstance(value, Free) else float(value) for name, value in self.parameters.items()}
        return np.array([given.get(p.name, p.value) for p in self.dae.parameters], dtype=np.float64)


def _check(argument: str, given: Mapping[str, object], known: Sequence[str], what: str, dae: Dae) -> None:
    for name in given:
        if name not in known:
            raise InputError(f"{argument}: {dae.name} has no {what} {name!r}; {suggestion(name, known)}")
