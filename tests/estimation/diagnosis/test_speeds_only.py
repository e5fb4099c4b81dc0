"""A drive of which speeds are measured and no angle: where it stands nobody can tell, and nobody needs to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from speed_slide import posed as slide_posed
from two_inertias import J_2, STEP, B, drive, posed, recorded

from backsight.estimation import Known, diagnose, smooth
from backsight.estimation.diagnosis.search.refit import comparable
from backsight.models.mechanics.rotational import AngleSensor


def test_where_it_stands_is_given_and_said_and_moves_nothing():
    problem = replace(posed(), recordings=[recorded(1, "fit")])
    free, given = smooth(problem), smooth(replace(problem, initial={"motor.phi": Known(5.0, 1e-4)}))
    assert any("where the machine stands as a whole" in note for note in free.notes)
    assert not any("where the machine stands as a whole" in note for note in given.notes)
    for name, true in (("load.J", J_2), ("bearing.d", B)):
        p = free.parameters[name]
        assert abs(p.value - true) < 3 * p.std
        assert given.parameters[name].value == pytest.approx(p.value, rel=1e-6)
        assert given.parameters[name].std == pytest.approx(p.std, rel=1e-3)


def test_nothing_is_missing_and_models_were_compared():
    d = diagnose(posed(), jobs=1)
    assert d.verdict == "none"
    assert not any("No models were compared" in note for note in d.notes)


@pytest.mark.slow
def test_drag_at_the_load_is_found_with_its_number():
    d = diagnose(posed(drag=0.02), jobs=1)
    (finding,) = d.findings
    assert (finding.explanation.place, finding.explanation.physics) == ("load", "quadratic_drag")
    assert finding.explanation.parameters["c"].value == pytest.approx(0.02, rel=0.03)


def test_a_bound_tells_where_it_stands_and_nothing_is_put_anywhere():
    problem = replace(posed(), recordings=[recorded(1, "fit")])
    ((held,),) = (tuple(at) for at in problem.split.stands.values())
    assert replace(problem, bounds={held: (-1e6, 1e6)}).split.stands == {}


def test_every_piece_stands_somewhere_of_which_nothing_is_known():
    """A start that is given is that of the first piece; after the gap nobody knows where the machine is."""
    problem = replace(posed(), recordings=[recorded(1, "fit")])
    ((held,),) = (tuple(at) for at in problem.split.stands.values())
    (whole,) = problem.recordings
    rows = np.r_[:500, 700 : len(whole.time)]
    cut = replace(
        whole,
        time=whole.time[rows],
        inputs={name: u[rows] for name, u in whole.inputs.items()},
        outputs={name: y[rows] for name, y in whole.outputs.items()},
    )
    known = replace(problem, recordings=[cut], initial={held: 5.0})
    assert len(known.fitted) == 2
    assert [key[1] for key in known.split.stands] == [1]
    assert [known.split.known_at(piece)[held].value for piece in known.fitted] == [5.0, 0.0]
    assert comparable(known, smooth(known))


def test_what_is_read_in_one_recording_does_not_tell_where_the_machine_stands_in_another():
    angle = AngleSensor()
    model = replace(
        drive(),
        components={**drive().components, "encoder": angle},
        connections=(*drive().connections, ("encoder.flange", "load.flange")),
        outputs={**drive().outputs, "phi": "encoder.phi"},
    )
    one, other = recorded(1, "fit"), replace(recorded(3, "fit"), name="other")
    phi = np.concatenate([[0.0], np.cumsum(one.outputs["n_2"][:-1]) * STEP])
    read = replace(one, outputs={**one.outputs, "phi": phi}, output_std={"phi": 0.1})
    problem = replace(posed(), model=model, recordings=[read, other])
    assert [key[0] for key in problem.split.stands] == ["other"]
    assert comparable(problem, smooth(problem))


@pytest.mark.slow
def test_a_wave_along_a_way_that_nothing_measures_has_its_size_wherever_recordings_begin():
    (finding,) = diagnose(slide_posed(amplitude=3.0, period=0.1), jobs=1).findings
    said = finding.explanation
    assert (said.place, said.physics) == ("mass", "cogging")
    for name, true in (("amplitude", 3.0), ("period", 0.1)):
        assert abs(said.parameters[name].value - true) < 4 * said.parameters[name].std
    assert said.parameters["phase"].std is None
