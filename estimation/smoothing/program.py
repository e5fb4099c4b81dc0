"""One program of a smoothing run: what it is made of, the numbers in it, and where its solve starts."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from backsight.models.errors import InputError, suggestion
from backsight.ocp import Horizon, Options, ParameterPrior, Solution, Solver, Status, Transcription, transcribe
from backsight.ocp.follow import Followed
from backsight.ocp.gauss_newton import FINE
from backsight.ocp.nlp import Values
from backsight.ocp.readout import read
from backsight.ocp.scaling import scaled

from ..arguments import check_number
from ..problem import Free, Problem
from ..supposed import input_spread
from .initial_guess import start_decisions
from .meshing import FINEST
from .rest import FrictionLaw, open_at_rest, with_room
from .robust import Losses, RobustSolution, solve_robustly
from .until import checked

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

METHODS = ("auto", "spline", "collocation")
TINY = 1e-300


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Numerics of a smoothing run; the defaults choose by themselves.

    method: "spline", "collocation" or "auto". degree: K, by itself 2 for splines and 3 for collocation. step: mesh step [s]; finest: the
    least that is chosen, in sampling intervals. check_mesh:
    whether its error is measured, and mended by a finer one; without, states are as good as weights ask for and nothing is known of the
    error. hasty: weights from the data move on before a solve has ended. weigh: whether weights that nobody gave come from the data;
    without, residual forces have the share of their balances' forces that the start has found. marginal: whether parameters are those of
    most marginal likelihood in the end, not those most probable together with a trajectory. seconds: after which `OutOfTime` is raised.
    supposed: places of bodies that only a hypothesis has and no output shows: their residual forces stay small beside the forces there.
    most: place of a body that no output shows -> std of its residual force that the model without the hypothesis has, and it needs no more.
    hopeless: cost of the first solve above which no weights are sought, but `SolveError` raised.
    widths: name of a friction law's width -> what it is rounded over, where nobody gave it; the others are chosen.
    options: of the solver.
    """

    method: Literal["auto", "spline", "collocation"] = "auto"
    degree: int | None = None
    step: float | None = None
    finest: float = FINEST
    check_mesh: bool = True
    hasty: bool = False
    weigh: bool = True
    marginal: bool = True
    seconds: float = math.inf
    supposed: frozenset[str] = frozenset()
    most: Mapping[str, float] = field(default_factory=dict)
    hopeless: float = math.inf
    widths: Mapping[str, float] = field(default_factory=dict)
    options: Options = field(default_factory=Options)

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InputError(f"Settings(method={self.method!r}): {suggestion(str(self.method), METHODS)}")
        for name, least, said in (
            ("step", TINY, "more than 0"),
            ("finest", TINY, "more than 0"),
            ("seconds", 0, "0 or more"),
        ):
            if (value := getattr(self, name)) is not None:
                check_number(value, f"Settings: {name}")
                if not value >= least:
                    raise InputError(f"Settings({name}={value!r}): it must be {said}.")
        lowest = 1 if self.method == "collocation" else 2
        if self.degree is not None and not (isinstance(self.degree, int) and lowest <= self.degree <= 5):
            raise InputError(f"Settings(degree={self.degree!r}): it must be a whole number from {lowest} to 5 for method {self.method!r}.")
        for name in ("check_mesh", "hasty", "weigh", "marginal"):
            if not isinstance(value := getattr(self, name), bool):
                raise InputError(f"Settings({name}={value!r}): it must be True or False.")


@dataclass(frozen=True, kw_only=True)
class Program:
    """A transcription with its numbers, a start (n + np,) and the bounds (n + np,) of its decisions.

    at_rest (n_soft, N): standard deviations of the residual forces near rest (`rest.py`), which the numbers have. losses: of the samples
    (`robust.py`), None where all are squares.
    """

    transcription: Transcription
    solver: Solver
    values: Values
    start: Array
    lower: Array
    upper: Array
    at_rest: Array
    losses: Losses | None = None

    @classmethod
    def at(cls, problem: Problem, solution: Solution) -> Program:
        """The program of a solution of this problem, with its numbers, started where it ended."""
        t = solution.transcription
        lower, upper = decision_bounds(problem, t)
        return cls(
            transcription=t,
            solver=solution.solver,
            values=solution.unweighted if isinstance(solution, RobustSolution) else solution.values,
            start=solution.solved.decisions,
            lower=lower,
            upper=upper,
            at_rest=np.zeros((len(t.soft), len(t.nlp.steps))),
            losses=Losses.of(problem),
        )

    def resumed(self, solution: Solution) -> Program:
        """The same with the numbers of one of its solutions, its losses among them, started where that ended."""
        if not isinstance(solution, RobustSolution):
            return replace(self, values=solution.values, start=solution.solved.decisions, losses=None)
        losses = Losses(huber=solution.huber, auto=np.zeros_like(solution.huber))
        return replace(self, values=solution.unweighted, start=solution.solved.decisions, losses=losses)

    def solve(self, decisions: Array, values: Values, newton: bool, say: Callable[[str], None]) -> Solution:
        """The program solved from these decisions with these numbers, in the units that they ask for.

        newton: to the full tolerance; squares are not yet ended by Ipopt (`ended`), other losses are.
        """
        if self.losses is None:
            return self._squares(decisions, values, newton, say, False)
        number = [term.name for term in self.transcription.nlp.terms].index("samples")
        return solve_robustly(
            lambda decisions, values, newton: self._squares(decisions, values, newton, say, True),
            lambda decisions, values: self.solver.rows(decisions, values)[number],
            decisions,
            values,
            newton,
            losses=self.losses,
            number=number,
        )

    @property
    def held(self) -> Program:
        """The program with its parameters held where they start."""
        n = self.transcription.nlp.trajectory_size
        lower, upper = self.lower.copy(), self.upper.copy()
        lower[n:] = upper[n:] = self.start[n:]
        return replace(self, lower=lower, upper=upper)

    def _squares(self, decisions: Array, values: Values, newton: bool, say: Callable[[str], None], last_word: bool) -> Solution:
        values, bounds = scaled(self.solver, decisions, values), {"lower": self.lower, "upper": self.upper}
        solved = self.solver.solve(decisions, values, **bounds, newton=newton, last_word=last_word, progress=say, check=checked(say))
        if solved.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        here = self.transcription.nlp.about(values, solved.decisions)
        return Solution(transcription=self.transcription, solver=self.solver, values=here, solved=solved)


def ended(problem: Problem, solution: Solution, say: Callable[[str], None]) -> Solution:
    """The solution with the last word from Ipopt, where plain steps had it and a fine one was asked for.

    Of losses that are no squares every solve is ended (`Program.solve`): the numbers of their solutions are those of deviations.
    """
    fine = solution.solver.options.tolerance <= FINE
    if not (fine and solution.solved.by_steps and solution.solved.status.converged and Losses.of(problem) is None):
        return solution
    lower, upper = decision_bounds(problem, solution.transcription)
    solved = solution.solver.ended(solution.solved, solution.values, lower=lower, upper=upper, progress=say, check=checked(say))
    if solved.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return replace(solution, values=solution.transcription.nlp.about(solution.values, solved.decisions), solved=solved)


def make_program(
    problem: Problem,
    settings: Settings,
    horizons: Sequence[Horizon],
    followed: Followed,
    laws: tuple[FrictionLaw, ...],
    force_std: dict[int, float],
    parameters: Array,
    start: Array,
    strengths: Mapping[int, float] | None = None,
) -> Program:
    """The program over these horizons, started on the followed trajectories.

    parameters (np_all,): what the free ones are measured from, and the values of the others; start (np_all,): where the free ones start.
    strengths: place -> of the laws that its residual force has room for near rest, where these are not to be the model's own.
    """
    t = _transcribe(problem, horizons, force_std, settings)
    return _numbered(problem, t, Solver(t.nlp, settings.options), followed, laws, force_std, parameters, start, strengths=strengths)


def renewed(
    program: Program,
    problem: Problem,
    followed: Followed,
    laws: tuple[FrictionLaw, ...],
    force_std: dict[int, float],
    parameters: Array,
    start: Array,
    room: Array | None = None,
) -> Program:
    """The program with other numbers and another start, as `make_program` would make it; the places and the priors stay the same ones.

    room (n_soft, N): what residual forces near rest have at least (`at_rest` of a program on this mesh).
    """
    return _numbered(problem, program.transcription, program.solver, followed, laws, force_std, parameters, start, room)


def _numbered(
    problem: Problem,
    transcription: Transcription,
    solver: Solver,
    followed: Followed,
    laws: tuple[FrictionLaw, ...],
    force_std: dict[int, float],
    parameters: Array,
    start: Array,
    room: Array | None = None,
    strengths: Mapping[int, float] | None = None,
) -> Program:
    first = start_decisions(transcription, followed, start)
    values = _with_prior(problem, transcription, _with_fine_input(transcription, first, start, transcription.nlp.values(parameters)))
    knots = [h.mesh.knots for h in transcription.horizons]
    at_rest = open_at_rest(problem, laws, followed, knots, transcription.soft, start, strengths)
    at_rest = at_rest if room is None else np.maximum(at_rest, room)
    std, made = np.array([force_std[k] for k in transcription.soft]), transcription.force_std
    values = transcription.with_force_std(values, with_room(std, at_rest) / made[:, None] * input_spread(problem, transcription))
    lower, upper = decision_bounds(problem, transcription)
    return Program(
        transcription=transcription,
        solver=solver,
        values=values,
        start=first,
        lower=lower,
        upper=upper,
        at_rest=at_rest,
        losses=Losses.of(problem),
    )


def _transcribe(problem: Problem, horizons: Sequence[Horizon], force_std: dict[int, float], settings: Settings) -> Transcription:
    prior = _prior(problem)
    # without residual forces every balance is a constraint, which is what collocation is for
    method = settings.method if settings.method != "auto" else "spline" if force_std else "collocation"
    degree = settings.degree or (2 if method == "spline" else 3)
    return transcribe(problem.dae, horizons, free=problem.free, prior=prior, force_std=force_std, method=method, degree=degree)


def _prior(problem: Problem) -> ParameterPrior:
    free = [problem.parameters[problem.dae.parameters[i].name] for i in problem.free]
    known = [f.std if isinstance(f, Free) and f.std is not None else np.inf for f in free]
    return ParameterPrior(mean=problem.values[list(problem.free)], std=np.array(known, dtype=np.float64))


def _with_prior(problem: Problem, transcription: Transcription, values: Values) -> Values:
    """The numbers with what the problem knows of the parameters, which is what the program was made for or the same of other values."""
    prior, terms = _prior(problem), transcription.nlp.terms
    known = np.isfinite(prior.std)
    is_prior = [term.name == "parameter prior" for term in terms]
    target = tuple(prior.mean[known][:, None] if there else y for there, y in zip(is_prior, values.target, strict=True))
    scale = tuple(1.0 / prior.std[known][:, None] if there else s for there, s in zip(is_prior, values.scale, strict=True))
    return replace(values, target=target, scale=scale)


def _with_fine_input(transcription: Transcription, decisions: Array, parameters: Array, values: Values) -> Values:
    """Targets less what the input's fine structure adds to the outputs between the knots: the polynomials need not follow it.

    It is a small share of the noise (`meshing.py` sees to that), so the first trajectory and parameters are good enough to compute it.
    """
    parts = [read(transcription, k, decisions, parameters).moved_outputs for k in range(len(transcription.horizons))]
    moved = np.hstack(parts)
    targets = tuple(y - moved if t.name == "samples" else y for t, y in zip(transcription.nlp.terms, values.target, strict=True))
    return replace(values, target=targets)


def decision_bounds(problem: Problem, transcription: Transcription) -> tuple[Array, Array]:
    """Bounds of all decisions: parameters within their own and the physical ones, states at the knots, known initial states fixed."""
    nlp, dae = transcription.nlp, problem.dae
    lower, upper = np.full(nlp.size, -np.inf), np.full(nlp.size, np.inf)
    for k, i in enumerate(problem.free):
        lower[nlp.trajectory_size + k], upper[nlp.trajectory_size + k] = problem.parameter_range(i)
    states = nlp.interpolation.states
    for i, q in enumerate(dae.states):
        if q.name in problem.bounds:
            knots = nlp.index[[i, i - states]]  # at both ends of every interval
            lower[knots], upper[knots] = problem.bounds[q.name]
    for start, horizon in zip(transcription.starts, transcription.horizons, strict=True):
        known = horizon.initial_std == 0
        lower[start[known]] = upper[start[known]] = horizon.initial[known]
    return lower, upper
