"""What tells the outcomes of one study from those of another, and what does not."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from shaken import DEVIATION, DT, FORCE_STD, MEAN, PLANT, STD, TRUE, driven, simulated

from backsight.estimation import Free, Known, Problem, Recording, Weights, smooth
from backsight.estimation.smoothing.robust import Losses
from backsight.estimation.smoothing.smoother import Settings
from backsight.estimation.weighing import identity
from backsight.estimation.weighing.setting import Stand
from backsight.estimation.weighing.turned import turned

WIDE = 1e6  # deviations so wide that twice as wide moves nothing


def posed(**changed: object) -> Problem:
    time, u = driven(60)
    run = Recording(name="run", time=time, inputs={"F": u}, outputs={"x": simulated(1, n=60)}, output_std={"x": STD})
    common = {
        "model": PLANT,
        "recordings": [run],
        "parameters": TRUE | {"damper.d": Free(1.0, min=0.0, max=50.0, std=WIDE)},
        "weights": Weights(W={"mass": FORCE_STD}),
        "initial": {"mass.s": Known(MEAN[0], DEVIATION[0]), "mass.v": Known(MEAN[1], WIDE)},
        "bounds": {"mass.s": (-9.0, 9.0)},
    }
    return Problem(**(common | changed))  # type: ignore[arg-type]


def stand(problem: Problem, held_out: Problem | None = None) -> Stand:
    fitted, other = (
        None if p is None else turned(p, smooth(p, settings=Settings(step=DT / 2, marginal=False))) for p in (problem, held_out)
    )
    assert fitted is not None
    return Stand(fitted=fitted, held_out=other, start=fitted.program.start)


def name(**changed: object) -> str:
    return stand(posed(**changed)).identity


def free(**changed: object) -> dict[str, Free | float]:
    return TRUE | {"damper.d": Free(**({"guess": 1.0, "min": 0.0, "max": 50.0, "std": WIDE} | changed))}  # type: ignore[arg-type]


def known(speed: Known) -> dict[str, Known]:
    return {"mass.s": Known(MEAN[0], DEVIATION[0]), "mass.v": speed}


@pytest.fixture(scope="module")
def here() -> Stand:
    return stand(posed())


def test_the_same_problem_smoothed_again_is_the_same_study(here):
    assert name() == here.identity


@pytest.mark.slow
def test_in_another_process_too(here):
    code = "import runpy, sys; sys.path[:0] = sys.argv[2:]; print(runpy.run_path(sys.argv[1])['name']())"
    found = subprocess.run([sys.executable, "-c", code, __file__, *sys.path], check=True, capture_output=True, text=True)
    assert found.stdout.strip() == here.identity


@pytest.mark.parametrize(
    "changed",
    [
        {"parameters": free(max=40.0)},
        {"parameters": free(min=0.1)},
        {"parameters": free(std=2 * WIDE)},
        {"parameters": free(std=None)},
        {"parameters": free() | {"mass.m": TRUE["mass.m"] * (1 + 1e-5)}},
        {"parameters": free() | {"offset.f": Free(TRUE["offset.f"])}},
        {"initial": known(Known(MEAN[1], 2 * WIDE))},
        {"initial": known(Known(MEAN[1] + 0.01 * WIDE, WIDE))},
        {"initial": {"mass.s": Known(MEAN[0], DEVIATION[0])}},
        {"bounds": {"mass.s": (-9.0, 8.0)}},
        {"bounds": {}},
        {"weights": Weights(W={"mass": FORCE_STD * (1 + 1e-5)})},
        {"recordings": [replace(posed().recordings[0], output_loss={"x": "huber"})]},
        {"recordings": [replace(posed().recordings[0], hold="linear")]},
    ],
    ids=lambda changed: repr(changed)[:90],
)
def test_what_an_outcome_hangs_on_tells_studies_apart(here, changed):
    assert name(**changed) != here.identity


def test_so_does_where_the_solves_begin_as_far_as_they_see_it(here):
    """Also on a machine that moves by micrometres: what counts is a decision's own deviation."""
    unit = here.fitted.program.values.unit
    for k in (0, len(unit) // 2, len(unit) - 1):
        moved = unit * (np.arange(len(unit)) == k)
        assert replace(here, start=here.start + 0.1 * moved).identity != here.identity
    grid = identity.GRID * 2.0 ** np.frexp(unit)[1]
    middle = np.round(here.start / grid) * grid
    assert replace(here, start=middle + 0.3 * grid).identity == replace(here, start=middle - 0.3 * grid).identity == here.identity


def test_a_study_in_which_only_losses_or_what_terms_refer_to_differ_is_another(here):
    """Of the numbers themselves, where no start gives them away."""
    program = here.fitted.program
    samples = np.ones((1, 60), dtype=bool)
    own = identity.identity(here.fitted, None, here.start)
    values = program.values
    estimated = np.isin(np.arange(len(values.parameters)), program.transcription.nlp.free)
    for other in (
        replace(program, losses=Losses(huber=samples, auto=samples)),
        replace(program, values=replace(values, parameters=values.parameters * np.where(estimated, 1.01, 1.0))),
        replace(program, values=replace(values, parameters=values.parameters * np.where(estimated, 1.0, 1.01))),
        replace(program, solver=replace(program.solver, options=replace(program.solver.options, max_iterations=7))),
    ):
        assert identity.identity(replace(here.fitted, program=other), None, here.start) != own


def test_what_was_held_out_counts_as_what_was_fitted_does(here):
    held = stand(posed(), posed())
    assert held.identity != here.identity
    assert stand(posed(), posed(initial=known(Known(MEAN[1], 2 * WIDE)))).identity != held.identity


def test_outcomes_of_another_code_are_not_those_of_this_one(here, monkeypatch):
    before = here.identity
    monkeypatch.setattr(identity, "code_of", lambda *_: "another")
    assert here.identity != before
