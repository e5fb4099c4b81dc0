"""From trajectories, weights and parameters to a solution: mesh, weights left out, a finer mesh, parameters of most marginal likelihood."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from backsight.ocp import Horizon, Options, Solution, Status
from backsight.ocp.follow import Followed
from backsight.ocp.gauss_newton import FINE

from ..problem import Problem
from ..validation.innovations import innovations, log_likelihood
from .along import exact_forces
from .begun import Begun, followed_by
from .marginal import UNMOVED, Moved, at, marginal, released
from .mesh_error import Checked, refine
from .meshing import Meshed, mesh
from .outcome import Run
from .program import Program, Settings, ended, make_program
from .rest import FrictionLaw, wants_room
from .variances import CLOSE, Choice, Open, choose_weights

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Stds = list[dict[str, float]]

MOVED = 2.0  # factor on a standard deviation, up or down, from which on the mesh is chosen anew
ROUGH = Options(tolerance=1e-3, gauss_newton_iterations=20)  # of a solve on the way
FAR = 0.5  # of a deviation that the last steps moved a parameter: beyond, weights from the data are others there
ALTERNATIONS = 4
ROOMS = 3  # times that room near rest is given anew
FLOORED, LIKELIER = 1.01, 10.0  # times its floor: a noise that lies there; nats that speak for less
FINER = 1.1  # times as many intervals: less does not make a new mesh worth its while


def to_the_end(settings: Settings) -> bool:
    """Whether parameters are to be those of most marginal likelihood."""
    return settings.marginal and settings.options.tolerance <= FINE


@dataclass(frozen=True, kw_only=True)
class Work:
    """What stays the same over all meshes of a run.

    parameters (np_all,): guesses, fixed values and widths; given: place -> std of W; open_outputs: per recording, whose noise nobody gave.
    floor: place -> std of a residual force so small that no machine's balance is as good; noise (H, ny): the same of the outputs, 0 where
    nobody knows. apart: whether parameters are held while trajectories and weights are sought. What acts on a body that no output shows
    would be theirs together with a trajectory, and the weights with them: with parameters from the start of the way weights come out right,
    and parameters of most marginal likelihood at these weights. strengths: place -> of the laws that residual forces have room for near
    rest, where these are those of the solution that it begins at. ceiling: place -> std of a residual force that only a hypothesis has, and
    no output shows: with a larger one it would be another hypothesis, that of any force at all.
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
    strengths: Mapping[int, float]
    ceiling: Mapping[int, float]

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
        if meshed.rigid and all(self.problem.dae.places[k].name in self.problem.weights.W for k in force_std):
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
        if not settings.hasty:
            if begin is None:
                work, choice, stds = work.unfloored(choice, stds, meshed.least_std)
            choice, stds = work.given_room(choice, stds, meshed.least_std)
        checked = Checked(solution=choice.solution)
        if settings.check_mesh:
            checked = refine(choice.solution, partial(work.again, choice), keep=settings.step is not None, say=self.say)
        if checked.solution is not choice.solution:
            choice, stds = work.refined(choice, checked, stds, meshed.least_std)
        moved = self.released(choice.solution) if self.apart else self.moved(choice.solution)
        choice, stds, moved = work.weighed_again(choice, moved, stds, meshed.least_std)
        last = moved.solution
        choice = replace(choice, solution=last, iterations=choice.iterations + last.solved.iterations - choice.solution.solved.iterations)
        return Run(
            choice=choice,
            stds=stds,
            open_outputs=self.open_outputs,
            remeshed=remeshed,
            checked=checked,
            said=moved.said,
            marginal=moved.arrived,
        ), built

    def moved(self, solution: Solution) -> Moved:
        """Parameters of most marginal likelihood from the most probable ones together with a trajectory, or these themselves."""
        last = ended(self.problem, solution, self.say)
        return marginal(Program.at(self.problem, last), last, self.say) if to_the_end(self.settings) else Moved(solution=last)

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
                return replace(moved, far=_apart(solution, moved.solution))
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
        return make_program(self.problem, self.settings, horizons, followed, self.laws, force_std, self.parameters, start, self.strengths)

    def chosen(self, program: Program, least_std: Mapping[int, float], stds: Stds, full: bool = True) -> Choice:
        """The program solved, with weights from the data where nobody gave them; full: to the full tolerance at last."""
        program = program.held if self.apart else program
        return choose_weights(
            lambda decisions, values, newton: program.solve(decisions, values, newton and full, self.say),
            program.start,
            program.values,
            program.transcription,
            program.at_rest,
            Open(
                places=[k for k in program.transcription.soft if k not in self.given],
                outputs=self.open_outputs,
                least_std={k: max(std, self.floor.get(k, 0.0)) for k, std in least_std.items()},
                most_std=self.ceiling,
                least_noise=self.least_noise(stds),
            ),
            self.say,
            hasty=self.settings.hasty,
            hopeless=self.settings.hopeless,
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
        return _after(choice, second), now, True

    def unfloored(self, choice: Choice, stds: Stds, least_std: Mapping[int, float]) -> tuple[Work, Choice, Stds]:
        """The same with less noise than samples seem to show, where V came to lie at its floor and they are far likelier with less.

        What alternates as white noise does may be the answer to an input that steps at every sample.
        """
        lowest = [
            choice.output_factor[h, i] * stds[h][q.name] <= FLOORED * self.noise[h, i]
            for h, names in enumerate(self.open_outputs)
            for i, q in enumerate(self.problem.dae.outputs)
            if q.name in names
        ]
        if not any(lowest) or not choice.solution.solved.status.converged:
            return self, choice, stds
        self.say("less noise than the samples seem to show")
        work, solution, now = replace(self, noise=np.zeros_like(self.noise)), choice.solution, self.in_force(stds, choice)
        t = solution.transcription
        second = work.chosen(work.from_there(choice, solution, _rated(t.horizons, choice), t.degree), least_std, now)
        if not second.solution.solved.status.converged or _log_likelihood(second.solution) < _log_likelihood(solution) + LIKELIER:
            return self, choice, stds
        return work, _after(choice, second), now

    def given_room(self, choice: Choice, stds: Stds, least_std: Mapping[int, float]) -> tuple[Choice, Stds]:
        """The same with room where trajectories have come to rest, if they strain there without it."""
        for _ in range(ROOMS if self.laws else 0):
            solution = choice.solution
            if not solution.solved.status.converged:
                break
            if not wants_room(self.problem, self.laws, solution, followed_by(solution), self.strengths):
                break
            self.say("room where trajectories have come to rest")
            now, t = self.in_force(stds, choice), solution.transcription
            second = self.chosen(self.from_there(choice, solution, _rated(t.horizons, choice), t.degree), least_std, now)
            if not second.solution.solved.status.converged:
                break
            choice, stds = _after(choice, second), now
        return choice, stds

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
            choice, stds = _after(choice, second), now
            moved = again if again.said == (UNMOVED,) else replace(again, said=moved.said)
            if again.far < FAR and np.max(np.abs(change)) < CLOSE:
                break
        else:
            choice = replace(choice, settled=False)
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


def _apart(solution: Solution, other: Solution) -> float:
    """Deviations, of the second one, that the parameter which differs most is from one solution to the other."""
    whole, n = at(other).whole, other.transcription.nlp.trajectory_size  # on a bound or not: that it has come there counts too
    if whole is None:
        return 0.0
    step = (other.solved.decisions - solution.solved.decisions)[n:]
    return float(np.max(np.abs(step) / np.sqrt(whole.parameter_variance)))


def _log_likelihood(solution: Solution) -> float:
    """Of the samples with these parameters, trajectories integrated out, but for a constant; -inf where nobody can tell."""
    n, size = solution.transcription.nlp.trajectory_size, solution.transcription.nlp.size
    found = innovations(replace(solution, solved=replace(solution.solved, on_bound=(*solution.solved.on_bound, *range(n, size)))))
    scale = solution.values.scale[solution.term("samples")]
    return -np.inf if found is None else log_likelihood(found) + float(np.sum(np.log(scale[scale > 0])))


def _after(first: Choice, second: Choice) -> Choice:
    """The second one, with the rounds and iterations of both."""
    return replace(second, rounds=first.rounds + second.rounds, iterations=first.iterations + second.iterations)


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
