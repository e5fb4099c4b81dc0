"""What a concealed case is: a machine, what is hidden in it, how it is excited and recorded, and which answers are right."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol

import numpy as np

from ..generators.concealed.effects import Effect
from ..generators.concealed.rig import Setting
from ..generators.run import Conditions

__all__ = ["CLEAN", "Bench", "Case", "Taken", "clean", "conditions", "same", "wrong"]

Effects = Callable[[Mapping[str, float], float], tuple[Effect, ...]]
Places = tuple[tuple[str, str], ...]


@dataclass(frozen=True, kw_only=True)
class Case:
    """One case of a plant.

    effects     of the true base values and a size about 1, which every concealed strength follows; it vanishes with it
    verdict     the class of the right answer; also: others that are right, where recordings cannot tell
    base        true values that differ from those usual for the plant
    motions     excitations: all but the last to fit, the last held out
    size        of the motions; rows: step between rows, as a factor; noise: factor; jitter: share of a step
    quantised   sensors round to steps as coarse as their noise; coloured: rms of a coloured force over the usual force at every place
    both        a machine that turns usually does so in one direction only: in both
    core        whether it belongs to the small suite
    """

    kind: str
    effects: Effects = lambda _values, _size: ()
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


class Bench(Protocol):
    """A plant of the suite: values of a usual machine, what a study estimates of it, and how a case is recorded."""

    plant: str
    base: Mapping[str, float]  # true values, drawn anew for every case about these
    known: Mapping[str, float]  # of these: what the study takes for granted, rightly, drawn or not
    absent: tuple[str, ...]  # what is zero in the study, and in the machine unless it is concealed
    order: tuple[str, ...]  # of the parameters in the study
    inputs: tuple[str, ...]
    conditions: Conditions
    force: Mapping[str, float]  # usual rms force at the places
    cases: tuple[Case, ...]

    def take(
        self, true: Mapping[str, float], plain: Mapping[str, float], effects: tuple[Effect, ...], case: Case, motion: str, seed: list[int]
    ) -> Taken:
        """One recording of a machine with these true values and effects; `plain`: the values of the machine without them."""


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

    def effects(values: Mapping[str, float], _size: float) -> tuple[Effect, ...]:
        return (Effect(place=name.rpartition(".")[0] or name, physics=name, fixed={name: values[name] * factor}),)

    return effects


def clean(slow: float = 2.0, fast: float = 0.5, motions: tuple[str, str] = ("trapezoids", "steps")) -> tuple[Case, ...]:
    """The nine clean cases of a plant."""
    one, other = motions
    return (
        Case(kind="clean:plain", strength="none", verdict="none", motions=motions, core=True),
        Case(kind="clean:plain_2", strength="none", verdict="none", motions=("multisine", other)),
        Case(kind="clean:quantised", strength="none", verdict="none", motions=(one, "multisine"), quantised=True),
        Case(kind="clean:coloured", strength="none", verdict="none", motions=("multisine", one), coloured=0.005, core=True),
        Case(kind="clean:jitter", strength="none", verdict="none", motions=(other, "multisine"), jitter=0.3),
        Case(kind="clean:fast_sampling", strength="none", verdict="none", motions=("multisine", other), rows=fast),
        Case(kind="clean:slow_sampling", strength="none", verdict="none", motions=(one, other), rows=slow),
        Case(kind="clean:low_noise", strength="none", verdict="none", motions=(one, "multisine"), noise=0.2),
        Case(kind="clean:weak_excitation", strength="none", verdict="none", motions=("slow", "multisine"), size=0.4),
    )


CLEAN = clean()
