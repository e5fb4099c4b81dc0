"""The estimation problem: a model, recordings, what is known of the parameters, and how much each equation and sensor is trusted."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from backsight.models import Dae, Model, compile_model
from backsight.models.augmentation import SHAPES, Shape
from backsight.models.augmentation.delay import delay_name
from backsight.models.augmentation.parameters import case_name
from backsight.models.errors import InputError, suggestion

from . import supposed
from .arguments import check_kind, check_mapping, check_number
from .bounds import excluded
from .delays import asked_for, with_delays
from .recordings.recording import Recording


@dataclass(frozen=True)
class Free:
    """A parameter to be estimated [the parameter's unit]: first guess, bounds, and the standard deviation of what is known beforehand.

    drift: it walks at random, by drift * sqrt(T) in a time T [unit/sqrt(s)]; guess and std are about where it starts, in each recording.
    After a gap in a recording it begins anew, and of where it begins nothing is known.
    per_recording: a constant, but every recording has its own; guess, std and bounds are those of each.
    """

    guess: float
    min: float = -np.inf
    max: float = np.inf
    std: float | None = None
    drift: float | None = None
    per_recording: bool = False

    def __post_init__(self) -> None:
        for name in ("guess", "min", "max"):
            check_number(getattr(self, name), f"Free: {name}")
        for name in ("std", "drift"):
            if getattr(self, name) is not None:
                check_number(getattr(self, name), f"Free: {name}", "give a number, or leave it out")
        if not (np.isfinite(self.guess) and self.min <= self.guess <= self.max and self.min < self.max):
            raise InputError(
                f"Free(guess={self.guess}, min={self.min}, max={self.max}): needs a finite guess with min <= guess <= max and min < max."
            )
        if self.std is not None and not (np.isfinite(self.std) and self.std > 0):
            raise InputError(f"Free(std={self.std}): a standard deviation is positive and finite; leave it out when nothing is known.")
        if self.drift is not None and not (np.isfinite(self.drift) and self.drift > 0):
            raise InputError(f"Free(drift={self.drift}): a rate of drift is positive and finite; leave it out for a constant.")
        if self.drift is not None and self.per_recording:
            raise InputError(
                f"Free(drift={self.drift}, per_recording=True): what drifts starts anew in every recording anyhow; leave per_recording out."
            )

    @property
    def varies(self) -> bool:
        """Whether it is no single number: it drifts, or every recording has its own."""
        return self.drift is not None or self.per_recording


@dataclass(frozen=True)
class Known:
    """What is known of a state [its unit]: a value, exactly or with a standard deviation.

    always: at any time, so also where a recording goes on after a gap, and not only where it starts.
    """

    value: float
    std: float = 0.0
    always: bool = False

    def __post_init__(self) -> None:
        for name in ("value", "std"):
            check_number(getattr(self, name), f"Known: {name}")
        if not (np.isfinite(self.value) and np.isfinite(self.std) and self.std >= 0):
            raise InputError(
                f"Known(value={self.value}, std={self.std}): needs a finite value and a finite std, 0 for exactly; "
                "leave the state out when nothing is known."
            )


@dataclass(frozen=True, kw_only=True)
class Weights:
    """W and V as standard deviations (weight = 1/std^2); what is not named is chosen from the data (`noise.py`).

    W: place -> std of its residual force: white noise of spectral density std^2 * 1 s, [unit of the place]. The place may also be
    "kinematics:<position>": how far the rate of a position may differ from its velocity.
    V: output -> std of its measurement noise [unit of the output]; it overrides the recordings' own. "<output> [<recording>]": of that
    recording only, before all else; one that is not there is no matter, so that weights found with some recordings serve others. Or an
    input -> std of each of its recorded values, and it is estimated as it acted; without one it acted as recorded.
    tau: place -> correlation time [s] of a residual force that is not white; W is then its rms.
    kind: place with a tau -> "ou" (Ornstein-Uhlenbeck, the default) or "matern" (Matern 3/2 of length tau).
    """

    W: Mapping[str, float] = field(default_factory=dict)
    V: Mapping[str, float] = field(default_factory=dict)
    tau: Mapping[str, float] = field(default_factory=dict)
    kind: Mapping[str, Shape] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_mapping(self.kind, "Weights: kind", "give places and words, {'carriage': 'ou'} say")
        object.__setattr__(self, "kind", dict(self.kind))
        for place, kind in self.kind.items():
            if kind not in SHAPES:
                raise InputError(
                    f"Weights(kind={{{place!r}: {kind!r}}}): a coloured residual force is 'ou' or 'matern'; choose one of them."
                )
            if place not in self.tau:
                raise InputError(f"Weights(kind={{{place!r}: {kind!r}}}): a coloured residual force has a correlation time; give tau too.")
        for name, table in (("W", self.W), ("V", self.V), ("tau", self.tau)):
            check_mapping(table, f"Weights: {name}", "give names and numbers, {'carriage': 2.0} say")
            object.__setattr__(self, name, dict(table))
            for key, std in table.items():
                check_number(std, f"Weights: {name} of {key}")
                if not (np.isfinite(std) and std > 0):
                    raise InputError(f"Weights({name}={{{key!r}: {std}}}): needs a positive, finite number.")

    def of_output(self, output: str, recording: str) -> float | None:
        """V of an output in a recording; None where there is none."""
        return self.V.get(case_name(output, recording), self.V.get(output))

    def noise(self, output: str, recording: Recording) -> float | None:
        """The noise that is given of an output in a recording, by V before the recording's own; None where nobody gives it."""
        return self.of_output(output, recording.name) or recording.output_std.get(output)


@dataclass(frozen=True, kw_only=True)
class Problem:
    """Everything `smooth` needs.

    model: a `Model` or its compiled `Dae`. recordings: those with role "fit" are fitted, the others predicted. parameters: name ->
    `Free` or a fixed value; those not named keep the model's value. initial: state -> its value at the start of every recording [SI],
    exactly, or `Known(value, std)`; of the others nothing is known. bounds: state -> (lowest, highest) [SI], infinite where there is none;
    they hold at the knots of the mesh. stands: (recording, part) -> state -> where it is put since nothing tells it (`supposed.py`).
    """

    model: Model | Dae
    recordings: Sequence[Recording]
    parameters: Mapping[str, Free | float] = field(default_factory=dict)
    weights: Weights = field(default_factory=Weights)
    initial: Mapping[str, float | Known] = field(default_factory=dict)
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    stands: Mapping[tuple[str, int], Mapping[str, Known]] = field(default_factory=dict, repr=False)
    declared: Model | Dae | None = field(
        default=None, init=False, repr=False, compare=False
    )  # the model without delays that were asked for

    def __post_init__(self) -> None:
        self._check_kinds()
        undelayed = self.dae
        open_delays = asked_for(self.recordings)
        if open_delays:
            model, recordings = with_delays(self.dae, self.recordings)
            parameters = {**{delay_name(name): Free(0.0, min=0.0) for name in open_delays}, **self.parameters}
            self.__dict__.update(declared=self.model, model=model, recordings=recordings, parameters=parameters, dae=model)
        dae = self.dae
        _check("parameters", self.parameters, [p.name for p in dae.parameters], "parameter", dae)
        places = [p.name for p in dae.places]
        _check("weights.W", self.weights.W, [*places, *supposed.relaxable(dae)], "place", dae)
        noisy = {name: None for name, _ in noise_names(self.weights.V, dae).values()}
        _check("weights.V", noisy, [q.name for q in (*dae.outputs, *dae.inputs)], "output or input", dae)
        _check("weights.tau", self.weights.tau, places, "place", dae)
        for name in self.weights.tau:
            if name not in self.weights.W:
                raise InputError(f"weights: tau of {name} stands without its W, the rms of a coloured residual force; give both.")
        _check("initial", self.initial, [q.name for q in dae.states], "state", dae)
        for name, start in self.initial.items():
            if not isinstance(start, Known) and not np.isfinite(start):
                raise InputError(f"initial: {name} = {start}: needs a finite number.")
        _check("bounds", self.bounds, [q.name for q in dae.states], "state", dae)
        for name, (low, high) in self.bounds.items():
            if not low < high:
                raise InputError(f"bounds: {name} = ({low}, {high}): needs two numbers, the lower one first.")
            if name in self.initial and not low <= (value := self.start[name].value) <= high:
                raise InputError(f"bounds: {name} = ({low:g}, {high:g}): its initial value {value:g} lies outside; move one of them.")
        for out in excluded(undelayed, self.recordings, self.bounds, self._given):
            low, high = self.bounds[out.state]
            raise InputError(f"bounds: {out.state} = ({low:g}, {high:g}): {out.said()}.")
        info = {p.name: p for p in dae.parameters}
        for name, given in self.parameters.items():
            number = given.guess if isinstance(given, Free) else given
            if not info[name].minimum <= number <= info[name].maximum:
                raise InputError(
                    f"parameters: {name} = {number:g} lies outside its physical range "
                    f"{info[name].minimum:g} .. {info[name].maximum:g} {info[name].unit}."
                )
            if isinstance(given, Free) and not max(given.min, info[name].minimum) < min(given.max, info[name].maximum):
                raise InputError(
                    f"parameters: {name} is free between {given.min:g} and {given.max:g}, which leaves one value of its physical range "
                    f"{info[name].minimum:g} .. {info[name].maximum:g} {info[name].unit}; give that as a number, or other bounds."
                )
        if not any(r.role == "fit" for r in self.recordings):
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
            if not recording.pieces:
                raise InputError(f"{recording.name}: no piece between its gaps has two rows and a sample of an output; make gap longer.")

    def _check_kinds(self) -> None:
        """Whether every argument is of the kind that it should be."""
        if isinstance(self.recordings, Recording | Mapping | str) or not isinstance(self.recordings, Iterable):
            raise InputError(f"Problem: recordings is a {type(self.recordings).__name__}; give a list, [recording] even for one.")
        for recording in self.recordings:
            check_kind(recording, Recording, "Problem: one of the recordings", "make them by Recording.read(...) or Recording(...)")
        check_kind(self.weights, Weights, "Problem: weights", "write weights=Weights(W={...})")
        check_mapping(self.parameters, "Problem: parameters", 'give names and values, {"mass.m": Free(3.0)} say')
        for name, value in self.parameters.items():
            if not isinstance(value, Free):
                check_number(value, f"parameters: {name}", "give a number, or Free(guess) to estimate it")
        check_mapping(self.initial, "Problem: initial", 'give states and values, {"mass.v": 0.0} say')
        for name, start in self.initial.items():
            if not isinstance(start, Known):
                check_number(start, f"initial: {name}", "give a number, or Known(value, std=...)")
        check_mapping(self.bounds, "Problem: bounds", 'give states and pairs, {"mass.s": (0.0, 1.0)} say')
        for name, pair in self.bounds.items():
            if isinstance(pair, str) or np.shape(pair) != (2,):
                raise InputError(f"bounds: {name} = {pair!r}: needs two numbers, the lower one first.")
            for bound in pair:
                check_number(bound, f"bounds: {name}", "give two numbers, the lower one first")

    @cached_property
    def dae(self) -> Dae:
        """The compiled model, with residual forces at every balance and at the places named in W."""
        if isinstance(self.model, Dae):
            return self.model
        dae = compile_model(self.model)
        extra = [name for name in self.weights.W if name in {p.name for p in dae.dormant_places}]
        return compile_model(self.model, places=extra) if extra else dae

    @cached_property
    def split(self) -> Problem:
        """The same, with a parameter for every recording where each has its own, and without states that nothing depends on.

        (`supposed.py`.) Itself where there are none.
        """
        return supposed.split(supposed.standing(supposed.lean(self)))

    @cached_property
    def plain(self) -> Problem:
        """What a start is made for: white forces, inputs as recorded, no drift. Itself or `split` where nothing else is supposed."""
        return supposed.plain(self.split)

    @cached_property
    def posed(self) -> Problem:
        """What is solved: all that is supposed beyond the model is in the model. `plain` where nothing else is supposed."""
        return supposed.posed(self.split, self.plain)

    @property
    def _given(self) -> dict[str, float | None]:
        """Parameter -> its value where it is fixed, else None."""
        return {name: None if isinstance(value, Free) else float(value) for name, value in self.parameters.items()}

    @property
    def start(self) -> dict[str, Known]:
        """State -> what is known of it at the start."""
        return {name: value if isinstance(value, Known) else Known(float(value)) for name, value in self.initial.items()}

    def known_at(self, piece: Recording) -> dict[str, Known]:
        """State -> what is known of it at the start of a piece of a recording, and where it is put there."""
        given = {name: known for name, known in self.start.items() if piece.part == 0 or known.always}
        return given | dict(self.stands.get((piece.name, piece.part), {}))

    @cached_property
    def fitted(self) -> tuple[Recording, ...]:
        """Recordings to be fitted, those with gaps in pieces (`Recording.pieces`)."""
        return tuple(piece for r in self.recordings if r.role == "fit" for piece in r.pieces)

    @property
    def free(self) -> tuple[int, ...]:
        """Indices of the free parameters in the model's order."""
        return tuple(i for i, p in enumerate(self.dae.parameters) if isinstance(self.parameters.get(p.name), Free))

    @property
    def known_exactly(self) -> dict[str, float]:
        """State -> its value at the start, where that is certain."""
        return {name: known.value for name, known in self.start.items() if known.std == 0}

    @property
    def varying(self) -> dict[str, Free]:
        """The parameters that drift, or that every recording has of its own."""
        return {name: free for name, free in self.parameters.items() if isinstance(free, Free) and free.varies}

    def parameter_range(self, index: int) -> tuple[float, float]:
        """Least and largest value of a parameter of the model, by its index: the physical ones and, of a free one, its own."""
        info = self.dae.parameters[index]
        given = self.parameters.get(info.name)
        low, high = (given.min, given.max) if isinstance(given, Free) else (-np.inf, np.inf)
        return max(low, info.minimum), min(high, info.maximum)

    def nearest_bound(self, index: int, value: float) -> float:
        """That of a parameter's bounds on which a value of it lies, up to a solver's tolerance."""
        return min(self.parameter_range(index), key=lambda bound: abs(bound - value))

    @property
    def values(self) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """All parameters: guesses, fixed values and the model's own."""
        given = {name: value.guess if isinstance(value, Free) else float(value) for name, value in self.parameters.items()}
        return np.array([given.get(p.name, p.value) for p in self.dae.parameters], dtype=np.float64)


def noise_names(V: Iterable[str], dae: Dae) -> dict[str, tuple[str, str | None]]:
    """What every name in V means: an output or input, and the recording where it is "<output> [<recording>]", else None."""
    outputs = {q.name for q in dae.outputs}
    found = dict[str, tuple[str, str | None]]()
    for name in V:
        output, bracket, recording = name.partition(" [")
        of_one = bracket and name.endswith("]") and output in outputs
        found[name] = (output, recording[:-1]) if of_one else (name, None)
    return found


def _check(argument: str, given: Mapping[str, object], known: Sequence[str], what: str, dae: Dae) -> None:
    for name in given:
        if name not in known:
            raise InputError(f"{argument}: {dae.name} has no {what} {name!r}; {suggestion(name, known)}")
