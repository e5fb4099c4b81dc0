"""One setting of the weights: what a study asks for, and what came of it."""

from __future__ import annotations

import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from backsight.ocp import Solution

from ..smoothing.on_bounds import on_bounds
from .identity import identity
from .kkt import gauss_newton
from .likelihood import likelihood, summit
from .turned import Turned

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Group = Literal["candidate", "trade-off", "weight", "stage", "chosen"]

KEPT = 1  # studies that a worker keeps ready


@dataclass(frozen=True, kw_only=True)
class Setting:
    """Log factors theta (F,) on the study's weights.

    group: "candidate" for the recommendation; "trade-off", all W together; "weight", one alone; "stage", all that holds the parameters;
    "chosen", those that the user wants to see turned.
    varied: the weight that is turned, if it is one; factor: on its std, or on those of all that are turned.
    """

    name: str
    group: Group
    theta: tuple[float, ...]
    varied: str = ""
    factor: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a setting gave; everything in SI, and nothing that JSON cannot keep.

    weights: label -> std. parameters: name -> (value, std), of most marginal likelihood, NaN where the data do not tell it, which held_out
    supposes; all else is of the most probable parameters together with a trajectory, as is the likelihood of the weights. misfit, force:
    output -> rms of measured less modelled, place -> rms of the residual force away from rest, each with the balance of its rows: the root
    of their squares over what the weight supposes of them, 1 where the two agree.
    log_likelihood: of the fitted recordings, held_out: of the others, each but for a constant of the mesh; NaN where it is none.
    condition: of the KKT matrix. arrived: whether the parameters are those of most marginal likelihood; where steps to them led nowhere
    they are the most probable ones together with a trajectory.
    """

    setting: Setting
    converged: bool
    status: str
    iterations: int
    seconds: float
    weights: Mapping[str, float]
    parameters: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    misfit: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    force: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    cost: float = float("nan")
    log_likelihood: float = float("nan")
    held_out: float = float("nan")
    condition: float = float("nan")
    arrived: bool = False


@dataclass(frozen=True, kw_only=True)
class Stand:
    """What all settings of a study share: the fitted recordings and, with parameters that it takes from them, those held out.

    start (n + np,): decisions that a solve starts from.
    """

    fitted: Turned
    held_out: Turned | None
    start: Array

    @property
    def identity(self) -> str:
        """A name for all that its outcomes hang on."""
        return identity(self.fitted, self.held_out, self.start)

    def outcomes(self, chain: Sequence[Setting]) -> list[Outcome]:
        """The settings solved, one from where the one before arrived."""
        found, start = list[Outcome](), self.start
        for setting in chain:
            solution = self.fitted.solved(np.array(setting.theta), start)
            found.append(self._outcome(setting, solution))
            start = solution.solved.decisions if found[-1].converged else start
        return found

    def _outcome(self, setting: Setting, solution: Solution) -> Outcome:
        theta, turned, solved = np.array(setting.theta), self.fitted, solution.solved
        common: dict[str, Any] = {
            "setting": setting,
            "status": solved.status.value,
            "iterations": solved.iterations,
            "seconds": solved.seconds,
            "weights": turned.stds(theta),
        }
        if not solved.status.converged or solution.curvature is None:
            return Outcome(converged=False, **common)
        moved = summit(turned, solution)
        told, solution = moved.solution, moved.solution if turned.bent else solution
        weighed = likelihood(turned, theta, solution)
        return Outcome(
            converged=True,
            parameters=_parameters(turned, told),
            misfit=_misfits(turned, solution, weighed.ratio),
            force=_forces(turned, solution, weighed.ratio),
            cost=solved.cost,
            log_likelihood=weighed.value,
            held_out=self.score(theta, told),
            condition=gauss_newton(solution).condition,
            arrived=moved.arrived,
            **common,
        )

    def score(self, theta: Array, solution: Solution) -> float:
        """Log likelihood of what was held out, with the weights theta and the parameters of a solution."""
        if self.held_out is None:
            return float("nan")
        stds = self.fitted.stds(theta)
        own = [np.log(stds.get(w.label, w.std) / w.std) for w in self.held_out.weights]
        there = self.held_out.with_parameters(values_of(solution)).solved(np.array(own))
        return likelihood(self.held_out, np.array(own), there).value if there.solved.status.converged else float("nan")


def solve(blob: bytes, chain: Sequence[Setting]) -> list[Outcome]:
    """A chain of settings of a pickled `Stand`, in a worker."""
    return _stand(blob).outcomes(chain)


@lru_cache(maxsize=KEPT)
def _stand(blob: bytes) -> Stand:
    stand: Stand = pickle.loads(blob)
    return stand


def values_of(solution: Solution) -> dict[str, float]:
    """All parameters of the model by name."""
    return dict(zip((p.name for p in solution.transcription.dae.parameters), solution.parameters.tolist(), strict=True))


def _parameters(turned: Turned, solution: Solution) -> dict[str, tuple[float, float]]:
    t, n = solution.transcription, solution.transcription.nlp.trajectory_size
    bounds = on_bounds(solution, turned.program.lower[n:], turned.program.upper[n:], marginal=True)
    curvature = solution.curvature if bounds is None else bounds
    variance = np.full(len(t.nlp.free), np.nan) if curvature is None else curvature.parameter_variance
    values = solution.parameters
    return {t.dae.parameters[i].name: (float(values[i]), float(np.sqrt(v))) for i, v in zip(t.nlp.free, variance, strict=True)}


def _misfits(turned: Turned, solution: Solution, ratio: Array) -> dict[str, tuple[float, float]]:
    number = solution.term("samples")
    found = {}
    for w, balance in zip(turned.weights, ratio.tolist(), strict=True):
        if w.is_noise:
            r, scale = solution.rows[number][w.row], solution.values.scale[number][w.row]
            there = scale > 0
            found[w.name] = float(np.sqrt(np.mean((r[there] / scale[there]) ** 2))), balance
    return found


def _forces(turned: Turned, solution: Solution, ratio: Array) -> dict[str, tuple[float, float]]:
    """Rms of the means over the mesh's intervals."""
    t = solution.transcription
    if not t.soft:
        return {}
    rows, std = solution.rows[solution.term(t.force_term)], t.force_std_at(solution.values)
    moving, steps, found = turned.moving, t.nlp.steps, {}
    for w, balance in zip(turned.weights, ratio.tolist(), strict=True):
        if not w.is_noise and w.row >= 0:
            here, r = moving[w.row], rows[w.row]
            mean = r * std[w.row] / np.sqrt(steps)
            found[w.name] = float(np.sqrt(np.average(mean[here] ** 2, weights=steps[here]))), balance
    return found
