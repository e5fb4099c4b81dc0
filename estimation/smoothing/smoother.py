"""Whole-horizon smoothing: states, residual forces and parameters of all recordings at once.

recordings -> follow the samples -> mesh -> program -> weights left out (iterated) -> a better mesh where it matters -> estimates
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from backsight.models.errors import InputError, SolveError
from backsight.ocp import Horizon, Options, Solution, Status
from backsight.ocp.follow import Followed
from backsight.ocp.ipopt import FINE

from ..arguments import check_kind
from ..holds import with_better_hold
from ..problem import Problem
from ..recordings.gaps import rates_note
from ..results import Smoothing
from ..validation.innovations import innovations, log_likelihood
from .along import RIGID, exact_forces
from .approach import TIGHTEST, approach
from .beforehand import blamed, freed
from .begun import Begun, followed_by
from .delays import settled
from .horizons import check_varies, output_stds, shown_noise
from .initial_guess import balance
from .lifted import lifted, measured_by
from .marginal import UNMOVED, Moved, marginal, released
from .mesh_error import Checked, refine
from .meshing import Meshed, follow_closely, mesh
from .outcome import Run, outcome
from .prediction import predict
from .program import Program, Settings, ended, make_program
from .rest import FrictionLaw, friction_laws, smoothing_widths
from .unseen import moving_unseen, unseen_states
from .variances import CLOSE, LEAST_NOISE, Choice, choose_weights

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Stds = list[dict[str, float]]

MOVED = 2.0  # factor on a standard deviation, up or down, from which on the mesh is chosen anew
ROUGH = Options(tolerance=1e-3, gauss_newton_iterations=20)  # of a solve on the way
FAR = 0.5  # of a deviation that the last steps moved a parameter: beyond, weights from the data are others there
ALTERNATIONS = 4
FINER = 1.1  # times as many intervals: less does not make a new mesh worth its while


def smooth(
    problem: Problem,
    *,
    settings: Settings | None = None,
    begin: Solution | Begun | None = None,
    progress: Callable[[str], None] | None = None,
) -> Smoothing:
    """Smooth the fitted recordings of a problem, and predict those that are held out.

    Weights that the problem leaves out are chosen from the data (`variances.py`). Returns the estimates even when the solver did not
    converge: `solver.converged` tells. settings: numerics (default: chosen). begin: a solution of the same recordings by a model with the
    same states and algebraic variables, or what a solution by another model is for this one (`begun.py`), from whose trajectories, weights
    and mesh it starts; guesses are taken for what they are, where no std makes them more than a start.
    Raises InputError for a problem that cannot be posed, OutOfTime after `settings.seconds`.
    """

    check_kind(problem, Problem, "smooth(...): the problem", "write smooth(Problem(model=..., recordings=[...]))")
    say = progress or (lambda _: None)
    check_varies(problem)
    if (note := rates_note([r for r in problem.recordings if r.role == "fit"])) is not None:
        say(note)
    result = smoothing(problem, settings=settings, begin=begin, progress=progress)
    if result.solver.converged or (plain := freed(problem)) is None:
        return result
    say("without what was given beforehand")
    plain = replace(plain, recordings=[r for r in plain.recordings if r.role == "fit"])
    try:
        without = smoothing(plain, settings=settings, begin=begin, progress=progress)
    except (SolveError, InputError):
        return result
    return replace(result, notes=(blamed(problem, without), *result.notes)) if without.solver.converged else result


def smoothing(
    problem: Problem,
    *,
    settings: Settings | None = None,
    begin: Solution | Begun | None = None,
    progress: Callable[[str], None] | None = None,
) -> Smoothing:
    """`smooth` as a part of something else: the recordings are known to tell something, and nothing is tried when it does not converge."""
    settings, say = settings or Settings(), progress or (lambda _: None)
    if settings.seconds < math.inf:
        settings = replace(settings, options=replace(settings.options, seconds=settings.seconds))
        say = _until(time.monotonic() + settings.seconds, say)

    def once(posed: Problem) -> Smoothing:
        return _smoothed(posed, settings, Begun.at(begin) if isinstance(begin, Solution) else begin, say)

    posed, result = with_better_hold(problem, lambda held: settled(held, once), once)
    if all(r.role == "fit" for r in posed.recordings) or not result.solver.converged:
        return result
    say("predicting what was held out")
    held_out, notes = predict(posed, result, lambda pieces: smoothing(pieces, settings=replace(settings, step=None)))
    return replace(result, held_out=held_out, notes=(*result.notes, *notes))


class OutOfTime(SolveError):
    """A smoothing that has taken as long as it may."""


def _until(end: float, say: Callable[[str], None]) -> Callable[[str], None]:
    """`say`, which comes at every step of the way and raises OutOfTime from then on."""

    def said(line: str) -> None:
        if time.monotonic() > end:
            raise OutOfTime("Stopped at its limit of time.")
        say(line)

    return said


def _smoothed(problem: Problem, settings: Settings, begin: Begun | None, say: Callable[[str], None]) -> Smoothing:
    began = time.perf_counter()
    asked, plain, problem = problem, problem.plain, problem.posed
    stds, open_outputs = output_stds(problem)
    if begin is None:
        say("following the samples")
        followed = follow_closely(plain, stds, settings.step)
    else:
        followed = begin.followed
    laws, parameters = friction_laws(plain), problem.values
    given = {k: problem.weights.W[p.name] for k, p in enumerate(problem.dae.places) if p.name in problem.weights.W}
    start, floor = parameters.copy() if begin is None else begin.start(problem), dict[int, float]()
    if begin is not None:
        exact = exact_forces(problem, followed, start)
        # a place that only this model has gets the share of its forces that an approach ends with
        force_std = {k: begin.force_std.get(problem.dae.places[k].name, TIGHTEST / RIGID * least) for k, least in exact.items()}
        floor = {k: min(std, exact[k]) for k, std in force_std.items()}
    elif plain.free or unseen_states(plain):
        least = {k: plain.weights.W[p.name] for k, p in enumerate(plain.dae.places) if p.name in plain.weights.W}
        begun = approach(plain, followed, laws, start, least, say)
        followed, start, force_std = begun.followed, begun.parameters, begun.force_std
        floor = {k: RIGID * begun.whole[k] for k in force_std}
    else:
        force_std = balance(plain, followed, start).force_std
    if not settings.weigh:
        given = {**force_std, **given}
    for index, width in smoothing_widths(plain, laws, followed, moving_unseen(plain)).items():
        parameters[index] = start[index] = width
    parameters = measured_by(problem, parameters, start)
    work = _Work(
        problem=problem,
        settings=settings,
        laws=laws,
        parameters=parameters,
        given=given,
        open_outputs=tuple(open_outputs),
        say=say,
        floor=floor,
        noise=LEAST_NOISE * shown_noise(problem),
        apart=begin is None and bool(plain.free and unseen_states(plain)) and _to_the_end(settings),
    )
    followed = followed if begin is not None else lifted(problem, plain, followed, start)
    force_std = {**force_std, **given}
    run, build = work.run(followed, stds, force_std, start, begin)
    if work.apart and (UNMOVED in run.said or not run.choice.solution.solved.status.converged):
        say("parameters together with the trajectories")
        run, build = replace(work, apart=False).run(followed, stds, force_std, start, begin)
    build -= began
    return outcome(asked, run, build=build, seconds=time.perf_counter() - began - build)


def _to_the_end(settings: Settings) -> bool:
    """Whether parameters are to be those of most marginal likelihood."""
    return settings.marginal and settings.options.tolerance <= FINE


@dataclass(frozen=True, kw_only=True)
class _Work:
    """What stays the same over all meshes of a run.

    parameters (np_all,): guesses, fixed values and widths; given: place -> std of W; open_outputs: per recording, whose noise nobody gave.
    floor: place -> std of a residual force so small that no machine's balance is as good; noise (H, ny): the same of the outputs, 0 where
    nobody knows. apart: whether parameters are held while trajectories and weights are sought. What acts on a body that no output shows
    would be theirs together with a trajectory, and the weights with them: with parameters from the start of the way weights come out
    right, and parameters of most marginal likelihood at these weights.
    """

    problem: Problem
    settings: Settings
    laws: tuple[FrictionLaw, ...]
    parameters: Array
    given: Mapping[int, float]
    open_outputs: tuple[set[str], ...]
    say: Callable[[str], None]
    floor: Mapping[int, float]
    noise: Array
    apart: bool

    def run(self, followed: Followed, stds: Stds, force_std: dict[int, float], start: Array, begin: Begun | None) -> tuple[Run, float]:
        """All of it from these trajectories, weights and parameters; and when the first program was built [s of `time.perf_counter`]."""
        work, settings = self, self.settings
        if begin is None and settings.step is None and (set(force_std) - set(self.given) or any(self.open_outputs)):
            rough = self.roughly(followed, stds, force_std, start)
            if rough is not None:
                followed, start, stds = followed_by(rough.solution), rough.solution.parameters, self.in_force(stds, rough)
                force_std = _by_place(rough, rough.solution)
                # guesses far too large make forces that are none
                now = exact_forces(self.problem, followed, start)
                work = replace(self, floor={k: min(std, now[k]) for k, std in self.floor.items()})
        if begin is not None and not settings.weigh:  # the same problem but for the model: its evidence is to be compared
            meshed = Meshed(horizons=list(followed.horizons), rigid=False, least_std={})
        else:
            meshed = work.meshed(followed, stds, force_std, start)
        if meshed.rigid and set(self.given) == set(force_std):
            force_std = {}
        program = work.program(meshed.horizons, followed, force_std, start)
        if begin is not None and begin.strange:
            # a stiffness whose spring is not stretched yet tells nothing: trajectories first
            led = program.held.solve(program.start, program.values, False, self.say).solved.decisions
            program = replace(program, start=led) if np.all(np.isfinite(led)) else program
        built = time.perf_counter()

        choice, remeshed = work.chosen(program, meshed.least_std, stds), False
        if settings.step is None and _moved(choice, force_std):
            choice, stds, remeshed = work.on_a_new_mesh(choice, meshed, stds)
        checked = Checked(solution=choice.solution)
        if settings.check_mesh:
            checked = refine(choice.solution, partial(work.again, choice), keep=settings.step is not None, say=self.say)
        if checked.solution is not choice.solution:
            choice, stds = work.refined(choice, checked, stds, meshed.least_std)
        moved = self.released(choice.solution) if self.apart else Moved(solution=ended(self.problem, choice.solution, self.say))
        last = moved.solution
        if _to_the_end(settings):
            moved = moved if self.apart else marginal(Program.at(self.problem, last), last, self.say)
            choice, stds, moved = work.weighed_again(choice, moved, stds, meshed.least_std)
            last = moved.solution
        choice = replace(choice, solution=last, iterations=choice.iterations + last.solved.iterations - choice.solution.solved.iterations)
        run = Run(choice=choice, stds=stds, open_outputs=self.open_outputs, remeshed=remeshed, checked=checked, said=moved.said)
        return run, built

    def released(self, solution: Solution) -> Moved:
        """Parameters of most marginal likelihood at the weights of a solution in which they were held.

        By way of those most probable together with a trajectory, unless that ends where the samples are less likely than here: then these
        are in another valley.
        """
        program, here = Program.at(self.problem, solution), _log_likelihood(solution)
        together = program.solve(program.start, program.values, True, self.say)
        if together.solved.status.converged:
            moved = marginal(Program.at(self.problem, together), together, self.say)
            if UNMOVED not in moved.said and _log_likelihood(moved.solution) > here:
                return moved
        held = released(solution, ())
        moved = marginal(program, held, self.say)
        return moved if UNMOVED in moved.said else replace(moved, said=())  # they were at no mode before

    def meshed(self, followed: Followed, stds: Stds, force_std: dict[int, float], parameters: Array) -> Meshed:
        """Meshes for these weights."""
        found = mesh(
            self.problem, followed, stds, force_std, parameters, self.settings.degree or 2, self.settings.step, self.settings.finest
        )
        self.say(f"mesh of {_intervals(found.horizons)} intervals")
        return found

    def program(self, horizons: Sequence[Horizon], followed: Followed, force_std: dict[int, float], start: Array) -> Program:
        """The program on these meshes, started on these trajectories and parameters."""
        return make_program(self.problem, self.settings, horizons, followed, self.laws, force_std, self.parameters, start)

    def chosen(self, program: Program, least_std: Mapping[int, float], stds: Stds, full: bool = True) -> Choice:
        """The program solved, with weights from the data where nobody gave them; full: to the full tolerance at last."""
        program = program.held if self.apart else program
        return choose_weights(
            lambda decisions, values, newton: program.solve(decisions, values, newton and full, self.say),
            program.start,
            program.values,
            program.transcription,
            program.at_rest,
            [k for k in program.transcription.soft if k not in self.given],
            self.open_outputs,
            {k: max(std, self.floor.get(k, 0.0)) for k, std in least_std.items()},
            self.least_noise(stds),
            self.say,
            hasty=self.settings.hasty,
        )

    def least_noise(self, stds: Stds) -> Array:
        """The smallest factors on these standard deviations of the outputs, (H, ny)."""
        return np.asarray(self.noise / np.array([[table.get(q.name, 1.0) for q in self.problem.dae.outputs] for table in stds]))

    def roughly(self, followed: Followed, stds: Stds, force_std: dict[int, float], start: Array) -> Choice | None:
        """Weights from the data on the mesh of the followed trajectories, which is coarse, to where a fine mesh need not begin."""
        steps = np.concatenate([h.mesh.steps for h in followed.transcription.horizons])
        work = replace(self, settings=replace(self.settings, step=float(np.median(steps)), options=ROUGH))
        meshed = work.meshed(followed, stds, force_std, start)
        program = work.program(meshed.horizons, followed, force_std, start)
        choice = work.chosen(program, meshed.least_std, stds, full=False)
        usable = choice.solution.solved.status.converged or choice.solution.solved.status is Status.ITERATIONS
        return choice if usable and np.all(np.isfinite(choice.solution.solved.decisions)) else None

    def on_a_new_mesh(self, choice: Choice, meshed: Meshed, stds: Stds) -> tuple[Choice, Stds, bool]:
        """The whole once more on the mesh that the chosen weights ask for, if that is finer; else what there is.

        A coarser one would do, but what is there already is no worse.
        """
        solution, now = choice.solution, self.in_force(stds, choice)
        anew = self.meshed(followed_by(solution), now, _by_place(choice, solution), solution.parameters)
        if _intervals(anew.horizons) < FINER * _intervals(meshed.horizons):
            return choice, stds, False
        program = self.program(anew.horizons, followed_by(solution), _by_place(choice, solution), solution.parameters)
        second = self.chosen(program, anew.least_std, now)
        return replace(second, rounds=choice.rounds + second.rounds, iterations=choice.iterations + second.iterations), now, True

    def refined(self, choice: Choice, checked: Checked, stds: Stds, least_std: Mapping[int, float]) -> tuple[Choice, Stds]:
        """What a finer mesh gave; weights from the data once more where the old mesh's error was in them."""
        solution, now = checked.solution, self.in_force(stds, choice)
        iterations = choice.iterations + solution.solved.iterations
        kept = replace(choice, solution=solution, output_factor=np.ones_like(choice.output_factor), iterations=iterations)
        if not (checked.mattered and self.open(solution)):
            return kept, now
        t = solution.transcription
        second = self.chosen(self.from_there(choice, solution, t.horizons, t.degree), least_std, now)
        return (second, now) if second.solution.solved.status.converged else (kept, now)

    def weighed_again(self, choice: Choice, moved: Moved, stds: Stds, least_std: Mapping[int, float]) -> tuple[Choice, Stds, Moved]:
        """Weights from the data at the parameters of most marginal likelihood, where these are far from the first, and these again."""
        if moved.far < FAR or not self.open(moved.solution):
            return choice, stds, moved
        for _ in range(ALTERNATIONS):
            t, now = moved.solution.transcription, self.in_force(stds, choice)
            program = self.from_there(choice, moved.solution, _rated(t.horizons, choice), t.degree)
            second = self.chosen(program.held, least_std, now)
            if not second.solution.solved.status.converged:
                break
            again = marginal(program, released(second.solution, moved.solution.solved.on_bound), self.say)
            change = np.log(np.concatenate([second.force_std / choice.force_std, second.output_factor.ravel()]))
            choice, stds = replace(second, rounds=choice.rounds + second.rounds, iterations=choice.iterations + second.iterations), now
            moved = again if again.said == (UNMOVED,) else replace(again, said=moved.said)
            if again.far < FAR and np.max(np.abs(change)) < CLOSE:
                break
        return choice, stds, moved

    def in_force(self, stds: Stds, choice: Choice) -> Stds:
        """The outputs' standard deviations with the factors that were chosen."""
        factors = [dict(zip((q.name for q in self.problem.dae.outputs), row.tolist(), strict=True)) for row in choice.output_factor]
        return [{name: std * f[name] for name, std in table.items()} for table, f in zip(stds, factors, strict=True)]

    def open(self, solution: Solution) -> bool:
        """Whether there are weights that nobody gave."""
        return bool(set(solution.transcription.soft) - set(self.given) or any(self.open_outputs))

    def from_there(self, choice: Choice, solution: Solution, horizons: Sequence[Horizon], degree: int) -> Program:
        """The program at the weights of a choice on these meshes, with polynomials of this degree, started from a solution."""
        work = replace(self, settings=replace(self.settings, degree=degree))
        return work.program(horizons, followed_by(solution), _by_place(choice, solution), solution.parameters)

    def again(self, choice: Choice, solution: Solution, horizons: list[Horizon], degree: int) -> tuple[Solution, Callable[[], Solution]]:
        """The same problem on other meshes at the same weights, started from a solution, by plain steps; and what ends other losses."""
        if solution is choice.solution:
            horizons = _rated(horizons, choice)
        program = self.from_there(choice, solution, horizons, degree)
        program = program.held if self.apart else program
        found = program.solve(program.start, program.values, False, self.say)
        if program.losses is None:
            return found, lambda: found
        return found, lambda: program.solve(found.solved.decisions, program.values, True, self.say)


def _log_likelihood(solution: Solution) -> float:
    """Of the samples with these parameters, trajectories integrated out, but for a constant; -inf where nobody can tell."""
    n, size = solution.transcription.nlp.trajectory_size, solution.transcription.nlp.size
    found = innovations(replace(solution, solved=replace(solution.solved, on_bound=(*solution.solved.on_bound, *range(n, size)))))
    return -np.inf if found is None else log_likelihood(found)


def _by_place(choice: Choice, solution: Solution) -> dict[int, float]:
    """Place -> std of its residual force."""
    return dict(zip(solution.transcription.soft, choice.force_std.tolist(), strict=True))


def _rated(horizons: Sequence[Horizon], choice: Choice) -> list[Horizon]:
    """The horizons with the chosen factors on their outputs' standard deviations."""
    return [replace(h, target_std=h.target_std * f) for h, f in zip(horizons, choice.output_factor, strict=True)]


def _intervals(horizons: Sequence[Horizon]) -> int:
    return sum(h.mesh.count for h in horizons)


def _moved(choice: Choice, force_std: Mapping[int, float]) -> bool:
    """Whether a standard deviation ended further than MOVED from the one that the mesh was chosen for."""
    if choice.solution.solved.status not in (Status.SOLVED, Status.ACCEPTABLE, Status.ITERATIONS):
        return False
    first = np.array([force_std[k] for k in choice.solution.transcription.soft])
    factors = np.concatenate([choice.force_std / first, choice.output_factor.ravel()])
    return bool(np.any(np.abs(np.log(factors)) > np.log(MOVED)))
