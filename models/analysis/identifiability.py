"""Which parameters and states the outputs can tell at all: structural local identifiability and observability.

The outputs of a generic experiment (random initial states x(0), inputs and parameter values) have the sensitivities

    S = [dy(t_k)/dx(0)   dy(t_k)/dp]          exact derivatives, columns scaled to length one

A parameter is locally identifiable, and a state observable, when no change of the others imitates it: when leaving its column out lowers
the rank of S. The null space of S holds the changes that leave no trace. Rank and null space are those of almost all experiments, so a
few draws suffice and the largest rank counts. This is the observability rank condition of R. Hermann and A. J. Krener (IEEE Trans.
Automatic Control 22, 1977) with parameters as constant states (A. F. Villaverde, A. Barreiro, A. Papachristodoulou, PLoS Comput. Biol. 12,
2016), by the numerical sensitivities that J. D. Stigter and J. Molenaar (Automatica 58, 2015) use in place of Lie derivatives.

Local and generic: isolated other solutions (a sign) and inputs that excite too little are not seen. Rounded laws are taken with unknown
widths, so that what only a rounding would tell does not count.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from ..compilation.compiler import compile_model
from ..dae import Dae
from ..errors import InputError, SolveError, suggestion
from ..model import Model
from .null_space import Direction, Rank, directions, rank_of, together
from .sensitivity import Array, Experiment, Laboratory

EXPERIMENTS = ((0.0, 1.0), (0.5, 10.0), (1.0, 1.0))  # sharpness of the rounded laws and vigour of the motion
FROM_DRAWINGS = ("m", "rad", "1", "m/s2")  # units of lengths, angles, ratios and gravity: usually known, and asked for by name when not
WEAK = 1e-6  # of its own effect: what the others leave of a parameter's effect when it can hardly be told


@dataclass(frozen=True, kw_only=True, eq=False)
class Identifiability:
    """The verdict on each parameter asked about and each state, for the outputs named.

    identifiable  parameter -> whether the outputs determine it, locally and generically
    margin        parameter -> share of its effect on the outputs that the others cannot imitate: 1 alone, 0 not identifiable
    known         parameters that were taken as known: those that were not asked about
    directions    joint changes of unidentifiable parameters that leave no trace
    observable    state -> whether the outputs determine it when all parameters are known
    entangled     states that are observable only when some unidentifiable parameter is known
    clear         False where singular values leave no clear gap: then the verdict is on what can be told in practice
    gap           smallest singular value that counts, and largest that does not, over the largest one
    seconds       that it took
    """

    model: str
    outputs: tuple[str, ...]
    identifiable: Mapping[str, bool]
    margin: Mapping[str, float]
    known: tuple[str, ...]
    directions: tuple[Direction, ...]
    observable: Mapping[str, bool]
    entangled: tuple[str, ...]
    clear: bool
    gap: tuple[float, float]
    seconds: float

    @property
    def unidentifiable(self) -> tuple[str, ...]:
        """Parameters that the outputs do not determine."""
        return tuple(name for name, told in self.identifiable.items() if not told)

    @property
    def unobservable(self) -> tuple[str, ...]:
        """States that the outputs do not determine even when all parameters are known."""
        return tuple(name for name, seen in self.observable.items() if not seen)

    @property
    def weak(self) -> tuple[str, ...]:
        """Identifiable parameters that others imitate so well that recordings will hardly tell."""
        return tuple(name for name, told in self.identifiable.items() if told and self.margin[name] < WEAK)

    def sentences(self) -> list[str]:
        """The verdict in words, one finding each."""
        outputs = ", ".join(self.outputs)
        lines = together(self.directions)
        if not self.identifiable:
            lines.append("no parameter was asked about" + (f"; name some of {', '.join(self.known)}" if self.known else ""))
        pivots = [d.pivot for d in self.directions]
        others = [name for d in self.directions for name in d.changes if name not in pivots]
        if others:
            lines.append(f"with {', '.join(pivots)} known, these can be told too: {', '.join(dict.fromkeys(others))}")
        silent = [name for name in self.unidentifiable if not any(name in d.changes for d in self.directions)]
        if silent:
            lines.append(f"without effect on the outputs: {', '.join(silent)}")
        if self.identifiable and not lines:
            count = len(self.identifiable)
            who = f"all {count} parameters" if count > 1 else next(iter(self.identifiable))
            lines.append(f"{who} can be told from {outputs}")
        if self.weak:
            lines.append(f"practically hard to tell: {', '.join(self.weak)}")
        if self.unobservable:
            how = f"from {outputs}" if outputs else "without an output"
            lines.append(f"unobservable {how}: {', '.join(self.unobservable)}")
        if self.entangled:
            lines.append(f"observable only when the unidentifiable parameters are known: {', '.join(self.entangled)}")
        if not self.clear:
            lines.append(
                f"the rank is not clear (relative singular values {self.gap[0]:.1e} and {self.gap[1]:.1e}): practically hard to tell"
            )
        return lines

    def __str__(self) -> str:
        return "\n".join(self.sentences())


def identifiability(
    model: Model | Dae,
    outputs: Collection[str] | None = None,
    parameters: Collection[str] | None = None,
    values: Mapping[str, float] | None = None,
    seed: int = 0,
) -> Identifiability:
    """Which of the `parameters`, and which initial states, the `outputs` determine when the inputs are known and rich enough.

    outputs     names of the outputs at hand; all of the model's by default
    parameters  names of those to be told apart, the others are known; by default all but smoothing widths, those that are absent (0), and
                what drawings say: lengths, angles, ratios, gravity
    values      parameter values around which to look, replacing the defaults. One that is 0 stays 0 and is judged by its first-order effect
    seed        of the random experiments

    Raises InputError for an unknown name, ModelError for a model that cannot be compiled, SolveError where no experiment near the start
    values can be integrated.
    """
    began = time.perf_counter()
    dae = compile_model(model) if isinstance(model, Model) else model
    rows = _indices("outputs", outputs, [q.name for q in dae.outputs], dae.name)
    names = [q.name for q in dae.parameters]
    _indices("values", values, names, dae.name)
    numbers = np.array(dae.parameter_values(values))
    asked = _indices("parameters", parameters, names, dae.name)
    if parameters is None:
        asked = [i for i, q in enumerate(dae.parameters) if not q.smoothing and numbers[i] != 0.0 and q.unit not in FROM_DRAWINGS]
    nuisance = [i for i, q in enumerate(dae.parameters) if q.smoothing and i not in asked]
    nx, count = dae.x.shape[0], dae.x.shape[0] + len(asked)
    columns = [*asked, *nuisance]
    laboratory, rng = Laboratory(dae, columns, numbers), np.random.default_rng(seed)
    draws = _draws(dae, laboratory, rng, rows, columns)
    rank = draws[0][0]
    told = [rank.lowered_without(i) for i in range(count)]
    by_state = rank_of(rank.columns[:, :nx])
    observable = [by_state.lowered_without(i) for i in range(nx)]
    asked_names = [names[i] for i in asked]
    states = [q.name for q in dae.states]
    hidden = [i for i in range(len(asked)) if not told[nx + i]]
    zero = [names[i] for i in asked if numbers[i] == 0.0]
    found = directions([(r, _sizes(dae, e, asked)) for r, e in draws], asked_names, hidden, states, zero)
    return Identifiability(
        model=dae.name,
        outputs=tuple(dae.outputs[i].name for i in rows),
        identifiable=dict(zip(asked_names, told[nx:], strict=True)),
        margin={name: rank.margin(nx + k) if told[nx + k] else 0.0 for k, name in enumerate(asked_names)},
        known=tuple(q.name for i, q in enumerate(dae.parameters) if i not in asked and not q.smoothing),
        directions=found,
        observable=dict(zip(states, observable, strict=True)),
        entangled=tuple(name for name, alone, jointly in zip(states, observable, told[:nx], strict=True) if alone and not jointly),
        clear=rank.clear,
        gap=(rank.kept, rank.dropped),
        seconds=time.perf_counter() - began,
    )


def _draws(
    dae: Dae, laboratory: Laboratory, rng: np.random.Generator, rows: list[int], columns: list[int]
) -> list[tuple[Rank, Experiment]]:
    """Experiments of the largest rank, the one that tells best first."""
    found: list[tuple[Rank, Experiment, tuple[float, float]]] = []

    def draw(setting: tuple[float, float]) -> None:
        experiment = laboratory.experiment(rng, *setting)
        found.append((rank_of(_matrix(dae, experiment, rows, columns)), experiment, setting))
        found.sort(key=lambda one: (one[0].number, one[0].kept), reverse=True)

    for number, setting in enumerate(EXPERIMENTS):
        try:
            draw(setting)
        except SolveError:
            if not found and number == len(EXPERIMENTS) - 1:
                raise
        if found and found[0][0].deficiency == 0 and found[0][0].kept > WEAK:
            break
    if found[0][0].deficiency and sum(rank.number == found[0][0].number for rank, _, _ in found) < 2:
        draw(found[0][2])  # null spaces have to be compared
    return [(rank, experiment) for rank, experiment, _ in found if rank.number == found[0][0].number]


def _matrix(dae: Dae, experiment: Experiment, rows: list[int], columns: list[int]) -> Array:
    """Sensitivities of the outputs to x(0) and to relative changes of parameters, every output with the same weight, as a triangle."""
    sizes = np.concatenate([[q.nominal for q in dae.states], _sizes(dae, experiment, columns)])
    blocks = [experiment.slopes[i] * sizes for i in rows]
    if experiment.constraint.size:
        blocks += list((experiment.constraint * sizes)[:, None, :])
    weighted = [block / (np.linalg.norm(block) or 1.0) for block in blocks]
    stacked = np.vstack([*weighted, np.zeros((len(sizes), len(sizes)))])
    return np.asarray(scipy.linalg.qr(stacked, mode="r")[0][: len(sizes)], dtype=np.float64)


def _sizes(dae: Dae, experiment: Experiment, columns: list[int]) -> Array:
    """The values of parameters, so that their changes become relative; the nominal size of those that are zero."""
    return np.array([experiment.values[i] or dae.parameters[i].nominal for i in columns])


def _indices(argument: str, chosen: Collection[str] | None, names: list[str], model: str) -> list[int]:
    if chosen is None:
        return list(range(len(names)))
    for name in chosen:
        if name not in names:
            raise InputError(f"{argument}: model '{model}' has no '{name}'; {suggestion(name, names)}")
    return [i for i, name in enumerate(names) if name in chosen]
