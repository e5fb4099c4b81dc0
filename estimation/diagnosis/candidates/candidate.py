"""What an explanation of a mismatch is made of: an edit of the model, and the parameters in which its strength and its shape stand."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from backsight.models import Model

from ..answer.verdict import Key, keyed, titled
from .edits import Alike, Change, Edit, Exchange, Insert, Since, sets_in

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Kind = tuple[Key, bool]

FARTHEST = 30.0  # times what it is: no number changes by more
SLOWEST, FASTEST = 1e-4, 200.0  # rates of what changes little by little, times the time that it takes: a ramp, and next to at once
ORDER = ("parameter", "sensor", "actuator")  # families that explain before physics that was left out does, where all explain as much


@dataclass(frozen=True, kw_only=True)
class Signal:
    """How inputs or an output would read, or what force would act, if it were otherwise.

    of: ("input:F",), ("sensor:x",), or ("force:carriage",); changed(time, values) (n,): what is there instead of the recorded input or the
    modelled output at unit strength; of a force what acts more, by the variable `seen` of the model at the rows. start: parameter of the
    edit -> where its fit starts.
    """

    of: tuple[str, ...]
    changed: Callable[[Array, Array], Array]
    start: Mapping[str, float] = field(default_factory=dict)
    seen: str = ""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A member of the library at a place.

    edits: give the model its component, without effect while the strengths are what they are there. strengths: parameters in which the
    effect is linear; one_sided: physics does not let them be negative. shapes: parameter -> values at which the effect is looked at, all of
    one length. quadrature: a phase; the effect is looked at with it zero and pi/2. start: further parameters that are free in a fit
    -> (guess, least, largest). absorbs: parameter of the base model -> the strengths that take its part over; it is then nothing, and
    stays what it is where there are none. without: strength -> its value there, where no component that comes in tells it.
    named: parameter of the finding -> that of the model. signals: looked at instead of strengths, where the component has a memory.
    ratio: parameter that stands for the two strengths of a quadrature over what the strength absorbs. wave: (strength, position): the
    effect is that strength's times a sine of 2 pi position over the one shape; no component is needed to look at it. larger: two strengths
    of which the first is the larger one, or it is no such effect. dear: no score tells of it, it has to be fitted. later: as start, of
    those that lead a fit astray while the others are far off: free when it is kept. rounded: parameter -> that of which it is a share, and
    the share, by what that was found to be when it is kept. beside: parameter of the base model -> factor of it where a fit starts, so that
    both together are what it was alone; if it is free. stated: a number that the study itself gives, doubted before one of the model; also
    a mass that it says is nothing. grows: of what is looked at as a signal, parameters that the score is a factor on, the strength first.
    change: what a parameter of the model, that is looked at from some time on alone, changes by then; its name.
    """

    place: str
    family: str
    physics: str
    edits: tuple[Edit, ...] = ()
    strengths: tuple[str, ...] = ()
    one_sided: bool = False
    shapes: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    quadrature: str | None = None
    start: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    absorbs: Mapping[str, str] = field(default_factory=dict)
    without: Mapping[str, float] = field(default_factory=dict)
    named: Mapping[str, str] = field(default_factory=dict)
    signals: tuple[Signal, ...] = ()
    ratio: str | None = None
    wave: tuple[str, str] | None = None
    larger: tuple[str, str] | None = None
    dear: bool = False
    later: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    rounded: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    beside: Mapping[str, float] = field(default_factory=dict)
    stated: bool = False
    grows: tuple[str, ...] = ()
    change: str = ""

    @property
    def all_shape(self) -> bool:
        """Whether it is looked at as a signal that is there as a whole, whatever its numbers: none of them is a factor on it."""
        return bool(self.signals) and not self.grows

    @property
    def rank(self) -> int:
        """Place of its family in the order of explanations; a mass that the study says is nothing is a parameter of it that is wrong.

        That a number of the machine is another one later comes last: what is added then, or acts then, is physics.
        """
        if self.changes:
            return len(ORDER) + 1
        if self.stated:
            return 0
        return ORDER.index(self.family) if self.family in ORDER else len(ORDER)

    def replaces(self, other: Candidate) -> bool:
        """Whether nothing is left of another one where this one is: its component is exchanged, or all its strengths are taken over."""
        own = set(other.strengths or other.named.values())
        return self.exchanges(other) or (bool(own) and own <= set(self.absorbs))

    def with_all_of(self, others: Iterable[Candidate], parameters: Mapping[str, object]) -> Candidate:
        """The same with all that others, which it takes over wholly, brought of these parameters, as they are: where a spring rested."""
        gone = [o for o in others if not self.exchanges(o) and self.replaces(o)]
        dead = {n: "" for o in gone for n in (*o.start, *o.later) if n in parameters and n not in self.absorbs}
        return replace(self, absorbs={**self.absorbs, **dead}) if dead else self

    def exchanges(self, other: Candidate) -> bool:
        """Whether the component that another one brought, or put in the place of the declared one, is exchanged for one of another kind."""
        components = {path.partition(".")[0] for path in other.named.values()}
        kinds = {e.name: type(e.component) for e in other.edits if isinstance(e, Exchange)}
        gone = {e.name for e in self.edits if isinstance(e, Exchange) and kinds.get(e.name) is not type(e.component)}
        return bool(other.edits) and bool(components) and components <= gone

    def instead_of(self, other: Candidate) -> Candidate:
        """The same in a model that has neither, of one whose component it exchanges: what brings that goes before, its place is that one's.

        What the other one left free, and the new component has, is still free.
        """
        new = {e.name: e.component.declared_parameters for e in self.edits if isinstance(e, Exchange)}
        put = tuple(edit for edit in other.edits if not (isinstance(edit, Exchange) and edit.name in new))

        def stays(path: str) -> bool:
            name, _, word = path.rpartition(".")
            return name not in new or word in new[name]

        had = {path: given for path, given in {**other.start, **other.later}.items() if stays(path)}
        return replace(self, place=other.place, edits=(*put, *self.edits), start={**had, **self.start})

    @property
    def size(self) -> int:
        """How many parameters it brings, less those that it takes the place of; a time when it sets in, or ends, is one."""
        times = (self.onset is not None) + (self.until is not None)
        return len({*self.strengths, *self.start}) - len(self.absorbs) + times

    def bounds(self, name: str) -> tuple[float, float]:
        """Least and largest value of a parameter, as it and the component that it comes with have them.

        Of what takes over a law of the model, whose strength comes on top, those of the component say nothing.
        """
        _, low, high = self.start.get(name, (0.0, -np.inf, np.inf))
        if any(name in names.split() for names in self.absorbs.values()):
            return low, high
        owner, _, word = name.partition(".")
        for part in (e.component for e in self.edits if isinstance(e, Insert) and e.name == owner):
            if (declared := part.declared_parameters.get(word)) is not None:
                low, high = max(low, declared.min), min(high, declared.max)
        return low, high

    def neutral(self, name: str) -> float:
        """The value of a parameter at which there is no effect."""
        if name in self.without:
            return self.without[name]
        if self.signals:
            return 0.0
        if not self.edits:
            return self.start[name][0] if name in self.start else 0.0
        owner, _, word = name.partition(".")
        parts = [e.component for e in self.edits if isinstance(e, Insert) and e.name == owner]
        return float(parts[0].parameters.get(word, 0.0)) if parts else 0.0

    @property
    def subject(self) -> tuple[str, ...]:
        """The parameters of the model that it says are wrong, or change: a component has several."""
        changed = tuple(change.path for change in self.changes)
        return changed or (self.strengths if self.family == "parameter" else ())

    @property
    def key(self) -> Key:
        """What it is, whatever its numbers are."""
        return keyed(self.place, self.physics, self.subject, changes=bool(self.changes))

    @property
    def kind(self) -> Kind:
        """What it is, and whether it sets in at some time, whenever that is."""
        return self.key, self.onset is not None

    @property
    def title(self) -> str:
        """stribeck friction at carriage."""
        return titled(*self.key)

    def edited(self, model: Model) -> Model:
        """The model with it."""
        for edit in self.edits:
            model = edit(model)
        return model

    def since(self, time: float | None, until: float | None = None) -> Candidate | None:
        """The same from a time [s] on; None without one, and for what no strengths tell, of components that come in or of one parameter.

        until: to which.
        """
        if time is not None and self.change and not self.edits:
            return self._changing(time, until)
        own = {name.partition(".")[0] for name in self.strengths} <= {*self.brought}
        if time is None or not self.strengths or self.signals or self.absorbs or not own:
            return None
        onset = Since(time=time, before=tuple((name, self.neutral(name)) for name in self.strengths), until=until)
        return replace(self, edits=(*self.edits, onset))

    def dated(self, time: float, until: float | None) -> Candidate:
        """What sets in, from another time on [s], and until another."""
        return replace(self, edits=tuple(replace(e, time=time, until=until) if sets_in(e) else e for e in self.edits))

    def slowly(self, time: float, until: float, recorded: float) -> Candidate:
        """A parameter of the model that changes little by little between two times [s]: from a ramp to what is over at once.

        recorded: so much of that time was [s].
        """
        slow = self._changing(time, until, gradual=True)
        (edit,) = slow.changes
        rate = (1.0 / recorded, SLOWEST / (until - time), FASTEST / recorded)
        return replace(slow, start={**slow.start, edit.rate: rate}, named={**slow.named, "rate": edit.rate})

    def _changing(self, time: float, until: float | None, *, gradual: bool = False) -> Candidate:
        """A parameter of the model that is another one from a time [s] on, or until another, or little by little."""
        (path,) = self.strengths
        value, least, most = self.start[path]
        far = FARTHEST * abs(value)
        return replace(
            self,
            edits=(Change(path=path, time=time, name=self.change, least=least, most=most, until=until, gradual=gradual),),
            strengths=(self.change,),
            start={self.change: (0.0, max(least - most, -far), min(most - least, far))},
            named={f"change of {path}": self.change},
        )

    @property
    def changes(self) -> tuple[Change, ...]:
        """Parameters of the model that are others from a time on."""
        return tuple(e for e in self.edits if isinstance(e, Change))

    @property
    def onset(self) -> float | None:
        """The time from which on it acts [s], None from the start; of what changes little by little none is told."""
        return next((e.time for e in self.edits if sets_in(e)), None)

    @property
    def until(self) -> float | None:
        """The time until which it acts [s], None to the end."""
        return next((e.until for e in self.edits if sets_in(e)), None)

    @property
    def of_reading(self) -> bool:
        """Whether its strength is a share of what sensors read."""
        return self.physics in ("sensor_gain", "sensor_misalignment")

    @property
    def brought(self) -> list[str]:
        """Names of the components that come in."""
        parts = [part for e in self.edits for part in (e.parts if isinstance(e, Alike) else (e,))]
        return [part.name for part in parts if isinstance(part, Insert)]

    @property
    def exchanged(self) -> list[str]:
        """Names of the components that another one takes the place of."""
        return [e.name for e in self.edits if isinstance(e, Exchange)]

    def unit(self, model: Model, path: str, signals: Mapping[str, str]) -> str:
        """Of a parameter of the model with it. signals: input or output -> its unit."""
        edited = self.edited(model)
        owner, _, word = path.partition(".")
        if path in edited.parameters:
            return self.said(edited.parameters[path].unit, signals)
        declared = edited.components[owner].declared_parameters if owner in edited.components else {}
        return self.said(declared[word].unit if word in declared else "", signals)

    def said(self, unit: str, signals: Mapping[str, str]) -> str:
        """The unit of a parameter: that of the signal where a block leaves it to that, and of a rate of it where it says "/s"."""
        signal = signals.get(self.place.partition(":")[2], "")
        if not (signal and unit.startswith("/")):
            return unit or signal
        per = re.fullmatch(rf"(.*){unit}(\d?)", signal)
        return f"{per[1]}{unit}{int(per[2] or 1) + 1}" if per else signal + unit

    @property
    def sent(self) -> Candidate:
        """As another process needs it: what the score looks at are functions of this one."""
        return replace(self, signals=())
