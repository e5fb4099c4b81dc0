"""A study file: which model, which recordings, what is known about the parameters. TOML in, a `Problem` out.

    study = Study.read("axis.toml")
    result = smooth(study.problem())

Everything the file says is checked against the model and the recordings before any work is done; what cannot be used is
an InputError of one sentence that names the file, the line, the key as it was typed, the value and the remedy.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf, isclose, isfinite, nextafter
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from backsight.models import Dae, Model
from backsight.models.augmentation.delay import INPUTS, delay_info
from backsight.models.augmentation.parameters import case_name
from backsight.models.dae import ParameterInfo
from backsight.models.errors import InputError, suggestion

from ..bounds import excluded
from ..recordings.columns import InputColumn, OutputColumn
from ..recordings.excitation import check_excitation, told_at_rest
from ..recordings.recording import Recording
from ..recordings.rows import RowReader
from ..recordings.units import check_unit
from ..wording import number, quoted
from .errors import dotted, no_signal, place, sentence
from .model_source import compiled, load_model
from .schema import FreeParameter, InitialTable, InputTable, OutputTable, RecordingTable, StudyFile, WeightTable

if TYPE_CHECKING:
    from ..problem import Problem, Weights


@dataclass(frozen=True)
class Study:
    """A study file that has been read and understood; models and recordings are loaded when first asked for.

    path    where it stands; the files it names are looked for beside it
    label   what it is called in messages
    text    its text
    file    its tables and keys
    """

    path: Path
    label: str
    text: str = field(repr=False)
    file: StudyFile

    @classmethod
    def read(cls, path: str | Path, *, label: str | None = None) -> Study:
        """The study in a TOML file, called `label` in messages (default: the path as given).

        Raises InputError for a file that is missing, is no TOML, or says what no study can say.
        """
        label, path = label or str(path), Path(path)
        try:
            text = path.read_bytes().decode("utf-8-sig").replace("\r\n", "\n")
        except FileNotFoundError:
            near = sorted(p.name for p in path.parent.glob("*.toml")) if path.parent.is_dir() else []
            remedy = suggestion(path.name, near) if near else "there is no study (*.toml) in that folder"
            raise InputError(f"{label}: no such study; {remedy}") from None
        except UnicodeDecodeError as error:
            line = path.read_bytes().count(b"\n", 0, error.start) + 1
            raise InputError(
                f"{label}, line {line}: byte 0x{error.object[error.start]:02x} is not UTF-8; save the study as UTF-8"
            ) from None
        except OSError as error:
            raise InputError(f"{label}: cannot be read ({error.strerror or error})") from None
        try:
            tables = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise InputError(f"{label}: this is not TOML: {_spelt_out(error, text)}") from None
        try:
            return cls(path, label, text, StudyFile.model_validate(tables))
        except ValidationError as error:
            raise InputError(sentence(error, label, text)) from None

    def of(self, model: str) -> Study:
        """The same of another model, named as `model` of a study would name it, with that model's own numbers."""
        return replace(self, file=self.file.model_copy(update={"model": model, "parameters": {}}))

    @cached_property
    def model(self) -> Model | Dae:
        """The model that the study names."""
        return load_model(self.file.model, self.path.parent, label=self._at("model"))

    @cached_property
    def dae(self) -> Dae:
        """Its equations, with a residual at every place that the study weighs."""
        label = f'{self._at("model")}: model = "{self.file.model}"'
        dae = compiled(self.model, label=label)
        dormant = {p.name for p in dae.dormant_places}
        asked = tuple(name for name in self.file.weights.W if name in dormant)
        return compiled(self.model, label=label, places=asked) if asked else dae

    @cached_property
    def recordings(self) -> tuple[Recording, ...]:
        """The recordings in SI units, in the order of the file."""
        if not self.file.recording:
            raise InputError(f'{self.label}: there is no recording; add a table [[recording]] with file = "run.csv"')
        self._check_signals()
        self._check_units()
        self._check_repeated()
        return tuple(self._recording(entry) for entry in self.file.recording)

    def values(self) -> dict[str, float]:
        """Every parameter of the model that the study names, the guess standing for one that is to be estimated."""
        self._check_parameters()
        own = {p.name for p in self.dae.parameters}
        given = {name: entry for name, entry in self.file.parameters.items() if name in own}
        return {name: entry.guess if isinstance(entry, FreeParameter) else float(entry) for name, entry in given.items()}

    def initial(self) -> dict[str, float]:
        """The known initial values of states, however well they are known."""
        self._check_states("initial", self.file.initial)
        return {name: entry.value if isinstance(entry, InitialTable) else float(entry) for name, entry in self.file.initial.items()}

    def horizon(self) -> int | None:
        """Samples of the moving horizon, None where the study leaves it open; it must fit into every fitted recording."""
        if self.file.horizon is None:
            return None
        samples = self.file.horizon.samples
        for recording in self.recordings:
            if recording.role == "fit" and samples > recording.time.size:
                where = self._at("horizon", "samples")
                raise InputError(
                    f"{where}: horizon, samples = {samples} is longer than {recording.name} with {recording.time.size} rows; shorten it"
                )
        return samples

    @property
    def streamed(self) -> RecordingTable:
        """The recording whose columns rows have that come in one by one: the first that is to be fitted."""
        for entry in self.file.recording:
            if entry.role == "fit":
                return entry
        raise InputError(f'{self.label}: no recording has role = "fit"; rows that come in are read as its columns say')

    def rows(self, header: str, *, label: str) -> RowReader:
        """A reader of rows under a header, with the columns of `streamed`."""
        self._check_signals()
        self._check_units()
        entry = self.streamed
        return RowReader(
            header,
            time=_input(entry.time),
            inputs={name: _input(column) for name, column in entry.inputs.items()},
            outputs={name: _output(column) for name, column in entry.outputs.items()},
            units={q.name: q.unit for q in (*self.dae.inputs, *self.dae.outputs)},
            label=label,
        )

    def problem(self) -> Problem:
        """The estimation problem. Raises InputError where it cannot be posed."""
        from ..problem import Free, Known, Problem

        self._check_parameters()
        weights = self._weights()
        initial: dict[str, float | Known] = dict(self.initial())
        tables = {name: entry for name, entry in self.file.initial.items() if isinstance(entry, InitialTable)}
        initial |= {name: Known(entry.value, entry.std) for name, entry in tables.items()}
        self._check_bounds()
        recordings = self.recordings
        self._check_excluded()
        self._check_noise()
        fitted = [recording for recording in recordings if recording.role == "fit"]
        if not fitted:
            raise InputError(f'{self.label}: no recording has role = "fit"; at least one is needed to estimate from')
        if not any(recording.outputs for recording in fitted):
            outputs = quoted((q.name for q in self.dae.outputs), last="or")
            raise InputError(f"{self._at('recording', 0, 'outputs')}: no output to fit: give a column for {outputs} under outputs")
        info = self._parameters
        parameters: dict[str, Free | float] = {}
        for name, entry in self.file.parameters.items():
            if isinstance(entry, FreeParameter):
                # bounds that the study leaves out are the physical ones; those beyond them stay, for a note to say that they do not hold
                low = entry.min if isfinite(entry.min) else info[name].minimum
                high = entry.max if isfinite(entry.max) else info[name].maximum
                parameters[name] = Free(float(entry.guess), low, high, entry.std, entry.drift, entry.per_recording)
            else:
                parameters[name] = float(entry)
        free = [name for name, value in parameters.items() if isinstance(value, Free)]
        if free:
            check_excitation(fitted, label=self.label, told=lambda: told_at_rest(self.dae, free, self.values(), fitted))
        # a law's residual force is switched on by compiling the model anew with its place
        dormant = {p.name for p in self.dae.dormant_places}
        model = self.model if dormant & set(weights.W) else self.dae
        bounds = {name: (entry.min, entry.max) for name, entry in self.file.bounds.items()}
        try:
            return Problem(model=model, recordings=recordings, parameters=parameters, weights=weights, initial=initial, bounds=bounds)
        except InputError as error:
            raise InputError(f"{self.label}: {error}") from error

    # ---------------------------------------------------------------- what the file says, against the model

    def _at(self, *path: str | int) -> str:
        return place(self.label, self.text, path)

    def _known(self, name: str, known: Iterable[str], *path: str | int, what: str) -> None:
        names = list(known)
        if name not in names:
            remedy = (no_signal(name) if what in ("input", "output") else None) or suggestion(name, names)
            raise InputError(f'{self._at(*path)}: unknown {what} "{name}"; {remedy}')

    @cached_property
    def _parameters(self) -> dict[str, ParameterInfo]:
        """The parameters that the study may name: those of the model, and the delays that its recordings ask for."""
        tables = [e for r in self.file.recording for e in r.outputs.items()] + [
            (INPUTS, e) for r in self.file.recording for e in r.inputs.values()
        ]
        late = {name for name, entry in tables if not isinstance(entry, str) and entry.delay == "estimate"}
        return {p.name: p for p in (*self.dae.parameters, *map(delay_info, sorted(late)))}

    def _check_parameters(self) -> None:
        info = self._parameters
        for name, entry in self.file.parameters.items():
            self._known(name, info, "parameters", name, what="parameter")
            value = entry.guess if isinstance(entry, FreeParameter) else float(entry)
            low, high, unit = info[name].minimum, info[name].maximum, info[name].unit
            if not low <= value <= high:
                said = f"guess = {number(value)}" if isinstance(entry, FreeParameter) else f"= {number(value)}"
                bound = f"min {number(low)}" if value < low else f"max {number(high)}"
                raise InputError(
                    f'{self._at("parameters", name)}: "{name}" {said}: it cannot be {"below" if value < low else "above"} {bound} {unit}'
                )
            if isinstance(entry, FreeParameter) and not max(entry.min, low) < min(entry.max, high):
                bound = f"max = {number(entry.max)}" if value == low else f"min = {number(entry.min)}"
                rule = f"{bound} leaves nothing but {number(value)} {unit} of its physical range, {number(low)} .. {number(high)}"
                raise InputError(f'{self._at("parameters", name)}: "{name}": {rule}; give that as a bare number, or another bound')

    def _check_states(self, table: str, names: Iterable[str]) -> None:
        for name in names:
            self._known(name, [q.name for q in self.dae.states], table, name, what="state")

    def _check_bounds(self) -> None:
        self._check_states("bounds", self.file.bounds)
        initial = self.initial()
        for name, entry in self.file.bounds.items():
            if name in initial and not entry.min <= initial[name] <= entry.max:
                where = f'{self._at("bounds", name)}: bounds, "{name}"'
                bound = f"min = {number(entry.min)}" if initial[name] < entry.min else f"max = {number(entry.max)}"
                raise InputError(f"{where}: its initial value {number(initial[name])} lies outside ({bound}); move one of them")

    def _check_excluded(self) -> None:
        """Bounds within which a column has no sample that shows the state itself."""
        bounds = {name: (entry.min, entry.max) for name, entry in self.file.bounds.items()}
        given = {name: None if isinstance(entry, FreeParameter) else float(entry) for name, entry in self.file.parameters.items()}
        for out in excluded(self.dae, self.recordings, bounds, given):
            low, high = bounds[out.state]
            bound = f"min = {number(low)}" if out.below else f"max = {number(high)}"
            entry = next(e for e in self.file.recording if self._name(e) == out.recording).outputs[out.output]
            column = entry if isinstance(entry, str) else entry.column
            where = f'{self._at("bounds", out.state)}: bounds, "{out.state}", {bound} {out.unit}'
            raise InputError(f"{where}: {out.said(column)}")

    def _check_noise(self) -> None:
        """One output, one V: that under weights would hold, and that of the column would be lost."""
        for k, entry in enumerate(self.file.recording):
            for name, column in entry.outputs.items():
                for key in (case_name(name, self._name(entry)), name):
                    if key not in self.file.weights.V or isinstance(column, str) or column.std is None:
                        continue
                    other = self.file.weights.V[key].deviation
                    if not isclose(other, column.std, rel_tol=1e-9):
                        where = f"{self._at('weights', 'V', key)}: weights, V, {key}, std is {number(other)}"
                        line = self._at("recording", k, "outputs", name, "std").removeprefix(f"{self.label}, ")
                        said = f"std of {name} in outputs of {self._name(entry)} is {number(column.std)} ({line})"
                        raise InputError(f"{where}, and {said}; leave one out")

    def _weights(self) -> Weights:
        from ..problem import Weights, noise_names
        from ..supposed import relaxable

        table: WeightTable = self.file.weights
        places = [p.name for p in (*self.dae.places, *self.dae.dormant_places)]
        for name in table.W:
            self._known(name, [*places, *relaxable(self.dae)], "weights", "W", name, what="place")
        for key, (name, recording) in noise_names(table.V, self.dae).items():
            self._known(name, [q.name for q in (*self.dae.outputs, *self.dae.inputs)], "weights", "V", key, what="output or input")
            if recording is not None:
                self._known(recording, map(self._name, self.file.recording), "weights", "V", key, what="recording")
        return Weights(
            W={name: weight.deviation for name, weight in table.W.items()},
            V={name: weight.deviation for name, weight in table.V.items()},
            tau={name: weight.tau for name, weight in table.W.items() if weight.tau is not None},
            kind={name: weight.kind for name, weight in table.W.items() if weight.kind is not None},
        )

    def _check_signals(self) -> None:
        inputs, outputs = [q.name for q in self.dae.inputs], [q.name for q in self.dae.outputs]
        for k, entry in enumerate(self.file.recording):
            for name in entry.inputs:
                self._known(name, inputs, "recording", k, "inputs", name, what="input")
            for name in entry.outputs:
                self._known(name, outputs, "recording", k, "outputs", name, what="output")
            for name in inputs:
                if name not in entry.inputs:
                    remedy = f'add {name} = "column" to inputs of {entry.file}'
                    raise InputError(f'{self._at("recording", k, "inputs")}: the input "{name}" of {self.dae.name} has no column; {remedy}')

    def _check_units(self) -> None:
        si = {q.name: q.unit for q in (*self.dae.inputs, *self.dae.outputs)}
        for k, entry in enumerate(self.file.recording):
            self._check_unit(entry.time, "s", "recording", k, "time")
            for name, driven in entry.inputs.items():
                self._check_unit(driven, si[name], "recording", k, "inputs", name)
            for name, sensed in entry.outputs.items():
                self._check_unit(sensed, si[name], "recording", k, "outputs", name)

    def _check_unit(self, column: InputTable | OutputTable | str, expected: str, *path: str | int) -> None:
        if not isinstance(column, str) and column.unit is not None:
            where = f'{self._at(*path, "unit")}: {dotted(path)}, column "{column.column}"'
            check_unit(column.unit, expected, where=where)

    def _check_repeated(self) -> None:
        """The same rows may not be used twice, least of all for fitting and for testing."""
        seen: list[RecordingTable] = []
        for k, entry in enumerate(self.file.recording):
            for other in seen:
                if _same_file(self.path.parent, entry.file, other.file) and _overlap(entry.range, other.range):
                    how = f'as "{other.role}" and as "{entry.role}"' if entry.role != other.role else f'twice as "{entry.role}"'
                    remedy = "name another file, or ranges that do not overlap"
                    raise InputError(f"{self._at('recording', k, 'file')}: {entry.file} is used {how}; {remedy}")
            seen.append(entry)

    def _until(self, entry: RecordingTable) -> float:
        """Where its range ends; a row on which another range of the same file begins belongs to that one alone."""
        _, end = entry.range or (-inf, inf)
        others = [other for other in self.file.recording if other.range and _same_file(self.path.parent, entry.file, other.file)]
        return nextafter(end, -inf) if any(other.range and other.range[0] == end for other in others) else end

    def _name(self, entry: RecordingTable) -> str:
        """What its recording is called: by its file, and by its range where that tells it from others of the same file."""
        files = [other.file for other in self.file.recording]
        span = f" [{number(entry.range[0])}, {number(entry.range[1])}]" if entry.range and files.count(entry.file) > 1 else ""
        return entry.file + span

    def _recording(self, entry: RecordingTable) -> Recording:
        return Recording.read(
            self.path.parent / entry.file,
            name=self._name(entry),
            time=_input(entry.time),
            inputs={name: _input(column) for name, column in entry.inputs.items()},
            outputs={name: _output(column) for name, column in entry.outputs.items()},
            range=(entry.range[0], self._until(entry)) if entry.range else None,
            every=entry.every,
            hold=entry.hold,
            clock_std=entry.clock_std or 0.0,
            gap=entry.gap,
            role=entry.role,
            units={q.name: q.unit for q in (*self.dae.inputs, *self.dae.outputs)},
        )


def _input(entry: InputTable | str) -> InputColumn:
    if isinstance(entry, str):
        return InputColumn(entry)
    limits = (entry.limits[0], entry.limits[1]) if entry.limits else None
    return InputColumn(entry.column, entry.unit, delay=entry.delay or 0.0, limits=limits)


def _output(entry: OutputTable | str) -> OutputColumn:
    if isinstance(entry, str):
        return OutputColumn(entry)
    return OutputColumn(entry.column, std=entry.std, unit=entry.unit, delay=entry.delay, loss=entry.loss)


def _same_file(folder: Path, one: str, other: str) -> bool:
    return (folder / one).resolve() == (folder / other).resolve()


def _overlap(one: list[float] | None, other: list[float] | None) -> bool:
    return one is None or other is None or (one[0] < other[1] and other[0] < one[1])


def _spelt_out(error: tomllib.TOMLDecodeError, text: str) -> str:
    """TOML's own message with the position in plain words."""
    message = str(error).rstrip(".")
    return message.replace("end of document", f"line {text.count(chr(10)) + 1}, the end of the file")
