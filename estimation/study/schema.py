"""The tables and keys of a study file, and what kind of value each takes."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, field_validator, model_validator

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class Part(BaseModel):
    """Any table: unknown keys are errors, numbers are numbers and text is text."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


def _kind(value: Any) -> str:
    return "<table>" if isinstance(value, (dict, BaseModel)) else "<plain>"


class FreeParameter(Part):
    """An estimated parameter: `{ guess = 80.0, min = 1.0, max = 1e3, std = 5.0 }`.

    It may drift, `drift = 0.1` [unit/sqrt(s)], or be every recording's own, `per_recording = true`.
    """

    guess: Finite
    min: float = float("-inf")
    max: float = float("inf")
    std: Positive | None = None
    drift: Positive | None = None
    per_recording: bool = False

    @model_validator(mode="after")
    def _ordered(self) -> FreeParameter:
        if not self.min < self.max:
            raise ValueError(
                f"min = {self.min:g} is not below max = {self.max:g}; exchange them, or give a bare number to fix the parameter"
            )
        if not self.min <= self.guess <= self.max:
            bound = f"min = {self.min:g}" if self.guess < self.min else f"max = {self.max:g}"
            raise ValueError(f"guess = {self.guess:g} lies outside its bounds ({bound}); move one of them")
        if self.drift is not None and self.per_recording:
            raise ValueError(f"drift = {self.drift:g} starts anew in every recording anyhow; leave per_recording out")
        return self


def _word(value: Any) -> str:
    return "<word>" if isinstance(value, str) else "<number>"


DelayEntry = Annotated[
    Annotated[Annotated[float, Field(ge=0, allow_inf_nan=False)], Tag("<number>")] | Annotated[Literal["estimate"], Tag("<word>")],
    Discriminator(_word),
]


class InputTable(Part):
    """Where an input is recorded: `{ column = "u_kN", unit = "kN", limits = [-500, 500] }`; limits in SI, beyond which no command acts.

    delay = "estimate": all inputs act late by a free parameter.
    """

    column: str
    unit: str | None = None
    delay: Literal["estimate"] | None = None
    limits: Annotated[list[Finite], Field(min_length=2, max_length=2)] | None = None


class OutputTable(Part):
    """Where an output is recorded: `{ column = "q_mm", std = 2e-6, unit = "mm", delay = 0.001, loss = "huber" }`; std in SI.

    delay = "estimate" makes the delay a free parameter.
    """

    column: str
    std: Positive | None = None
    unit: str | None = None
    delay: DelayEntry = 0.0
    loss: Literal["square", "huber", "auto"] = "square"


class Weight(Part):
    """How far a residual may go: `{ std = 2.0 }` or `{ weight = 0.25 }` (1/std²).

    With its correlation time `tau` in seconds it is coloured, of rms std and of the kind "ou" (Ornstein-Uhlenbeck) or "matern" (3/2).
    """

    std: Positive | None = None
    weight: Positive | None = None
    tau: Positive | None = None
    kind: Literal["ou", "matern"] | None = None

    @model_validator(mode="after")
    def _one_size(self) -> Weight:
        if (self.std is None) == (self.weight is None):
            raise ValueError("give either std or weight (= 1/std^2)" + (", not both" if self.std is not None else ""))
        if self.kind is not None and self.tau is None:
            raise ValueError(f'kind = "{self.kind}" is that of a residual with a correlation time; give tau in seconds too')
        return self

    @property
    def deviation(self) -> float:
        """The standard deviation, however it was given."""
        return self.std if self.std is not None else float(self.weight or 1.0) ** -0.5


class WeightTable(Part):
    """`[weights]`: W per place, V per output, "<output> [<recording>]" or input."""

    W: dict[str, Weight] = {}
    V: dict[str, Weight] = {}

    @field_validator("V")
    @classmethod
    def _white(cls, value: dict[str, Weight]) -> dict[str, Weight]:
        for name, weight in value.items():
            if weight.tau is not None:
                raise ValueError(f'tau of "{name}": the noise of a sensor is white; tau belongs to W')
        return value


class InitialTable(Part):
    """What is known of a state at the start: `{ value = 0.0, std = 0.1 }`; without std exactly."""

    value: Finite
    std: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0


class BoundTable(Part):
    """Where a state stays: `{ min = 0.0, max = 0.3 }`, or one of them."""

    min: float = float("-inf")
    max: float = float("inf")

    @model_validator(mode="after")
    def _ordered(self) -> BoundTable:
        if not self.min < self.max:
            raise ValueError(f"min = {self.min:g} is not below max = {self.max:g}; exchange them")
        return self


class Horizon(Part):
    """`[horizon]`: how many samples the moving horizon sees."""

    samples: Annotated[int, Field(gt=1)]


InputEntry = Annotated[Annotated[InputTable, Tag("<table>")] | Annotated[str, Tag("<plain>")], Discriminator(_kind)]
OutputEntry = Annotated[Annotated[OutputTable, Tag("<table>")] | Annotated[str, Tag("<plain>")], Discriminator(_kind)]
InitialEntry = Annotated[Annotated[InitialTable, Tag("<table>")] | Annotated[Finite, Tag("<plain>")], Discriminator(_kind)]
ParameterEntry = Annotated[Annotated[FreeParameter, Tag("<table>")] | Annotated[Finite, Tag("<plain>")], Discriminator(_kind)]


class RecordingTable(Part):
    """`[[recording]]`: a file, its columns, and which of its rows are used for what."""

    file: str
    role: Literal["fit", "held_out"] = "fit"
    time: InputEntry
    range: Annotated[list[Finite], Field(min_length=2, max_length=2)] | None = None
    every: Annotated[int, Field(ge=1)] = 1
    hold: Literal["zero", "linear", "auto"] = "zero"
    clock_std: Positive | None = None
    gap: Positive | None = None
    inputs: dict[str, InputEntry] = {}
    outputs: dict[str, OutputEntry] = {}

    @field_validator("range")
    @classmethod
    def _forwards(cls, value: list[float] | None) -> list[float] | None:
        if value is not None and value[0] >= value[1]:
            raise ValueError(f"{value} runs backwards; give two times in seconds, the earlier one first")
        return value


class StudyFile(Part):
    """The whole file."""

    model: str
    parameters: dict[str, ParameterEntry] = {}
    recording: list[RecordingTable] = []
    weights: WeightTable = WeightTable()
    horizon: Horizon | None = None
    initial: dict[str, InitialEntry] = {}
    bounds: dict[str, BoundTable] = {}

    @field_validator("parameters", "initial", "bounds", mode="before")
    @classmethod
    def _flat(cls, value: Any) -> Any:
        """`carriage.m = 80.0` without quotes is a table in a table to TOML; it means what "carriage.m" means."""
        if not isinstance(value, dict):
            return value
        flat: dict[str, Any] = {}
        own = FreeParameter.model_fields.keys() | InitialTable.model_fields.keys()
        for name, entry in value.items():
            if isinstance(entry, dict) and entry and "." not in name and not entry.keys() & own:
                flat.update({f"{name}.{key}": inner for key, inner in entry.items()})
            else:
                flat[name] = entry
        return flat
