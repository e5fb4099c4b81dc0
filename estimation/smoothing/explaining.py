"""Whether a model explains anything at all, in words."""

from __future__ import annotations

from collections.abc import Mapping

from backsight.ocp import Solution
from backsight.ocp.follow import Followed

from ..problem import Free, Problem
from ..results import ResidualSummary
from ..wording import listed
from .along import forces

UNEXPLAINED = 0.5  # of the largest term of a balance: a residual force that large takes the model's part
STRAY = 1e-6  # of a guess, or one over it: what no unit explains
EXPLAINS_NOTHING = "the model explains next to nothing"
MISSING = "Where these are right a force as large as all others is missing: `diagnose` looks for what that is."
ZERO, ENDLESS = "ran to nothing", "grew beyond all measure"


def on_explaining(problem: Problem, solution: Solution, residuals: Mapping[str, ResidualSummary]) -> list[str]:
    """Whether the model explains anything at all, where parameters ended on bounds or ran to nothing; problem: the posed one."""
    t = solution.transcription
    held = [problem.dae.parameters[t.nlp.free[k]].name for k in solution.parameters_on_bounds]
    small, large = ([name for name in names if name not in held] for names in _strays(problem, solution))
    if not (held or small or large):
        return []
    followed = Followed(transcription=t, horizons=t.horizons, decisions=solution.solved.decisions)
    parts = []
    for k, force in forces(problem, followed, solution.parameters).items():
        r = residuals.get(problem.dae.places[k].name)
        if r is not None and r.rms > UNEXPLAINED * force:
            parts.append(f"residual.{r.place}, {r.rms:.3g} {r.unit} rms, is as large as all else in its balance, {force:.3g} {r.unit} rms")
    given = f", and W of {listed(weighed)}, which is given" if (weighed := weighed_places(problem)) else ""
    explains = f"{EXPLAINS_NOTHING}. Check units and signs of inputs and outputs{given}"
    ends = [f"{listed(names)} {how}" for names, how in ((held, "ended on a bound"), (small, ZERO), (large, ENDLESS)) if names]
    remedy = f", and fix one of {listed([*small, *large])}, or W there" if len(small) + len(large) > 1 else ""
    return [f"{listed(parts)}, and {listed(ends)}: {explains}{remedy}. {MISSING}"] if parts else []


def _strays(problem: Problem, solution: Solution) -> tuple[list[str], list[str]]:
    """Parameters that cannot be negative and are next to nothing beside their guesses, and those that are beyond all measure.

    A balance whose terms all shrink, or all grow, stays as true as it was, and where a force of any size may act nothing keeps them.
    """
    sizes = {}
    for i in solution.transcription.nlp.free:
        info, given = problem.dae.parameters[i], problem.parameters.get(problem.dae.parameters[i].name)
        if isinstance(given, Free) and given.guess > 0 and info.minimum >= 0:
            sizes[info.name] = abs(float(solution.parameters[i])) / given.guess
    return [name for name, size in sizes.items() if size < STRAY], [name for name, size in sizes.items() if size > 1.0 / STRAY]


def weighed_places(problem: Problem) -> list[str]:
    """Places whose W is given."""
    return [place.name for place in problem.dae.places if place.name in problem.weights.W]
