"""Edits of a model: each is called with one and gives another, and has words for what it does, as code."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeGuard

from backsight.models import Model
from backsight.models.language import Component, Parameter


@dataclass(frozen=True, kw_only=True)
class Insert:
    """A component at a place (`Model.insert`). joined: pairs of signals to connect."""

    place: str
    component: Component
    name: str
    joined: tuple[tuple[str, str], ...] = ()

    def __call__(self, model: Model) -> Model:
        edited = model.insert(self.place, self.component, self.name)
        for a, b in self.joined:
            edited = edited.connect(a, b)
        return edited

    @property
    def words(self) -> str:
        """name = Component() at place."""
        return f"{self.name} = {type(self.component).__name__}() at {self.place}"


@dataclass(frozen=True, kw_only=True)
class Exchange:
    """A component in the place of another (`Model.replace`)."""

    name: str
    component: Component

    def __call__(self, model: Model) -> Model:
        return model.replace(self.name, self.component)

    @property
    def words(self) -> str:
        """name = Component() instead of the old one."""
        return f"{self.name} = {type(self.component).__name__}()"


@dataclass(frozen=True, kw_only=True)
class Rebuild:
    """Any other edit, by a function of the model. said: what it does, as code."""

    edit: Callable[[Model], Model]
    said: str

    def __call__(self, model: Model) -> Model:
        return self.edit(model)

    @property
    def words(self) -> str:
        """What it does."""
        return self.said


def _when(time: float, until: float | None) -> str:
    """From 4.1 s on."""
    return f"from {time:.7g} s on" if until is None else f"from {time:.7g} s to {until:.7g} s"


@dataclass(frozen=True, kw_only=True)
class Since:
    """Parameters that have their values from a time [s] on, or until another (`Model.since`). before: parameter -> what it is else."""

    time: float
    before: tuple[tuple[str, float], ...]
    until: float | None = None

    def __call__(self, model: Model) -> Model:
        for path, value in self.before:
            model = model.since(path, self.time, value, until=self.until)
        return model

    @property
    def words(self) -> str:
        """f_c from 3.2 s on."""
        return f"{', '.join(path for path, _ in self.before)} {_when(self.time, self.until)}"


@dataclass(frozen=True, kw_only=True)
class Change:
    """A parameter that is larger by a new one, `name`, from a time [s] on, or until another (`Model.changing`).

    least, most: what it may be then. gradual: it changes little by little until that time, and not back then.
    """

    path: str
    time: float
    name: str
    least: float
    most: float
    until: float | None = None
    gradual: bool = False

    def __call__(self, model: Model) -> Model:
        rate = 1.0 / (self.until - self.time) if self.gradual and self.until is not None else None
        return model.changing(self.path, self.time, self.name, until=self.until, rate=rate)

    @property
    def rate(self) -> str:
        """The parameter that says how fast, of what changes little by little."""
        return f"{self.name}_rate"

    @property
    def words(self) -> str:
        """load.m + load_m_change from 4.1 s on."""
        return f"{self.path} + {self.name} {'little by little ' if self.gradual else ''}{_when(self.time, self.until)}"


@dataclass(frozen=True, kw_only=True)
class Alike:
    """Several parts of one kind, edited alike, with one parameter of the model for all of them.

    parameter: its name, and its value there. word: what it is in each of the parts.
    """

    parts: tuple[Insert | Exchange, ...]
    parameter: str
    word: str
    value: float

    def __call__(self, model: Model) -> Model:
        for part in self.parts:
            model = part(model)
        bound = {f"{part.name}.{self.word}": self.parameter for part in self.parts}
        return replace(
            model,
            parameters={**model.parameters, self.parameter: replace(self._declared(), default=self.value)},
            bindings={**model.bindings, **bound},
        )

    @property
    def words(self) -> str:
        """All of them."""
        return "; ".join(part.words for part in self.parts)

    def _declared(self) -> Parameter:
        return self.parts[0].component.declared_parameters[self.word]


Edit = Insert | Exchange | Rebuild | Alike | Since | Change


def sets_in(edit: Edit) -> TypeGuard[Since | Change]:
    """Whether an edit begins to act at once at some time."""
    return isinstance(edit, Since) or (isinstance(edit, Change) and not edit.gradual)
