"""What a concealed case is: a machine, what is hidden in it, how it is excited and recorded, and which answers are right."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal

import numpy as np

from ..generators.concealed.effects import Effect
from ..generators.concealed.rig import Control, Machine, Setting, operate, shares
from ..generators.run import Conditions, clock

__all__ = ["CLEAN", "Bench", "Case", "Drawn", "RigBench", "Taken", "Values", "conditions", "same", "wrong"]

Values = Mapping[str, float]
Effects = Callable[["Drawn"], tuple[Effect, ...]]
Places = tuple[tuple[str, str], ...]


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """What was drawn for a case: true base values, and a size about 1, which every concealed strength follows and vanishes with."""

    values: Values
    size: float


@dataclass(frozen=True, kw_only=True)
class Case:
    """One case of a plant.

    effects     what is concealed, of what was drawn
    verdict     the class of the right answer; also: others that are right, where recordings cannot tell
    base        true values that differ from those usual for the plant
    motions     excitations: all but the last to fit, the last held out
    size        of the motions; rows: step between rows, as a factor; noise: factor; jitter: share of a step
    quantised   sensors round to steps as coarse as their noise; coloured: rms of a coloured force over the usual force at every place
    both        a machine that turns usually does so in one direction only: in both
    core        whether it belongs to the small suite
    """

    kind: str
    effects: Effects = lambda _drawn: ()
    strength: Literal["none", "strong", "weak", "parameter"] = "strong"
    verdict: str = "missing_physics"
    also: tuple[str, ...] = ()
    base: Mapping[str, float] = field(default_factory=dict)
    motions: tuple[str, ...] = ("trapezoids", "steps")
    size: float = 1.0
    rows: float = 1.0
    noise: float = 1.0
    jitter: float = 0.0
    quantised: bool = False
    coloured: float = 0.0
    both: bool = False
    core: bool = False


@dataclass(frozen=True, kw_only=True)
class Taken:
    """One recording: columns (n,), and place -> strength of what is concealed, as `rig.shares` has it."""

    time: np.ndarray
    inputs: Mapping[str, np.ndarray]
    outputs: Mapping[str, np.ndarray]
    clean: Mapping[str, np.ndarray]
    shares: Mapping[str, float]


class Bench(ABC):
    """A plant of the suite: values of a usual machine, what a study says of it, and how a case is recorded.

    base        true values, drawn anew for every case about these
    known       what the study takes for granted, rightly; absent: what is zero in the study, and in the machine unless it is concealed
    order       of the parameters in the study
    force       usual rms force at the places
    """

    plant: ClassVar[str]
    base: ClassVar[Mapping[str, float]]
    known: ClassVar[Mapping[str, float]] = {}
    absent: ClassVar[tuple[str, ...]] = ()
    order: ClassVar[tuple[str, ...]]
    inputs: ClassVar[tuple[str, ...]]
    conditions: ClassVar[Conditions]
    force: ClassVar[Mapping[str, float]]
    cases: ClassVar[tuple[Case, ...]]

    @abstractmethod
    def take(self, true: Values, plain: Values, effects: tuple[Effect, ...], case: Case, motion: str, seed: list[int]) -> Taken:
        """One recording of a machine with these true values and effects; `plain`: the values of the machine without them."""


class RigBench(Bench):
    """A plant that runs in the `rig`."""

    @abstractmethod
    def machine(self, values: Values, structure: Mapping[str, Any]) -> Machine:
        """The machine with these values and this structure."""

    @abstractmethod
    def control(self, machine: Machine, case: Case, motion: str, time: np.ndarray, step: float, rng: np.random.Generator) -> Control:
        """What makes it follow the motion."""

    def take(self, true: Values, plain: Values, effects: tuple[Effect, ...], case: Case, motion: str, seed: list[int]) -> Taken:
        """One recording; noise and jitter of its clock have a stream of random numbers, the motion another."""
        machine = self.machine(true, {name: value for e in effects for name, value in e.structure.items()})
        setting = conditions(case, self.conditions, self.force)
        time = clock(setting.conditions, np.random.default_rng([*seed, 0]))
        control = self.control(machine, case, motion, time, setting.conditions.step, np.random.default_rng([*seed, 1]))
        trace = operate(machine, control, setting, effects, np.random.default_rng([*seed, 0]))
        return Taken(
            time=trace.time,
            inputs=dict(zip(machine.inputs, trace.commands.T, strict=True)),
            outputs=trace.recorded(machine.outputs, effects),
            clean=dict(zip(machine.outputs, trace.clean.T, strict=True)),
            shares=shares(self.machine(plain, {}), machine, trace),
        )


def conditions(case: Case, usual: Conditions, force: Mapping[str, float]) -> Setting:
    """The conditions under which a case is recorded."""
    noise = {output: case.noise * std for output, std in usual.noise.items()}
    rounding = {output: float(f"{2 * std:.1g}") for output, std in noise.items()} if case.quantised else {}
    changed = replace(usual, step=usual.step * case.rows, noise=noise, resolution=rounding, jitter=case.jitter)
    return Setting(conditions=changed, coloured={place: case.coloured * rms for place, rms in force.items()})


def same(physics: str, *places: str) -> Places:
    """The same physics at other places, which stand for one another."""
    return tuple((place, physics) for place in places)


def wrong(name: str, factor: float) -> Effects:
    """A parameter that the study takes for granted, too large by this factor."""

    def effects(drawn: Drawn) -> tuple[Effect, ...]:
        return (Effect(place=name.rpartition(".")[0] or name, physics=name, fixed={name: drawn.values[name] * factor}),)

    return effects


CLEAN = (
    Case(kind="clean:plain", strength="none", verdict="none", core=True),
    Case(kind="clean:plain_2", strength="none", verdict="none", motions=("multisine", "trapezoids", "steps")),
    Case(kind="clean:quantised", strength="none", verdict="none", motions=("trapezoids", "multisine"), quantised=True),
    Case(kind="clean:coloured", strength="none", verdict="none", motions=("multisine", "trapezoids"), coloured=0.005, core=True),
    Case(kind="clean:jitter", strength="none", verdict="none", motions=("steps", "multisine"), jitter=0.3),
    Case(kind="clean:fast_sampling", strength="none", verdict="none", motions=("multisine", "steps"), rows=0.5),
    Case(kind="clean:slow_sampling", strength="none", verdict="none", rows=2.0),
    Case(kind="clean:low_noise", strength="none", verdict="none", motions=("trapezoids", "multisine"), noise=0.2),
    Case(kind="clean:weak_excitation", strength="none", verdict="none", motions=("slow", "multisine"), size=0.4),
)
