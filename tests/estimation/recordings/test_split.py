"""Parts of recordings that are held out where nobody said which."""

from __future__ import annotations

import numpy as np
import truths
from examples import OFFSET, D, K, M, compiled, oscillator

from backsight.estimation import Problem, Recording, Settings, Weights, smooth
from backsight.estimation.recordings.split import with_held_out

PLANT, STD = truths.Plant(m=M, d=D, k=K, offset=OFFSET), 1e-3
TRUE = {"mass.m": M, "spring.k": K, "damper.d": D, "offset.f": OFFSET}


def moving(kept: np.ndarray) -> tuple[Recording, np.ndarray]:
    """Rows of nine seconds of the oscillator, which starts at rest, and its position in these rows."""
    rng, time = np.random.default_rng(1), 0.01 * np.arange(900)
    u = 20 * np.sign(np.sin(0.0483 * np.arange(900)))
    x = truths.disturbed(PLANT, time, u, np.zeros(2), 0.05, rng)[:, 0]
    y = x + STD * rng.normal(size=900)
    return Recording(name="run", time=time[kept], inputs={"F": u[kept]}, outputs={"x": y[kept]}, output_std={"x": STD}), x[kept]


def test_the_last_third_of_one_recording_is_held_out_and_the_last_of_several():
    (whole, _), later = moving(np.arange(900)), moving(np.arange(300))[0]
    (fitted, held_out), said = with_held_out([whole])
    assert (fitted.role, held_out.role) == ("fit", "held_out")
    assert np.array_equal(np.concatenate([fitted.time, held_out.time]), whole.time)
    assert held_out.time[0] == 6.0
    assert "t = 6 s" in str(said)
    assert [r.role for r in with_held_out([whole, later])[0]] == ["fit", "held_out"]


def test_what_is_known_of_the_start_is_not_known_of_a_last_third_with_a_gap():
    whole, x = moving(np.r_[0:700, 750:900])
    recordings, _ = with_held_out([whole])
    held_out = recordings[1]
    assert len(held_out.pieces) == 2
    assert [piece.part for piece in held_out.pieces] == [1, 2]
    known = {"mass.s": 0.0, "mass.v": 0.0}
    problem = Problem(
        model=compiled(oscillator()), recordings=recordings, parameters=TRUE, weights=Weights(W={"mass": 0.05}), initial=known
    )
    s = smooth(problem, settings=Settings(check_mesh=False))
    (found,) = s.held_out.values()
    begin = len(whole.time) - len(held_out.time)
    assert abs(x[begin]) > 20 * STD
    assert abs(found.estimates["x"].iloc[0] - x[begin]) < 5 * STD
    assert found.fit["x"].rms < 0.2 * np.std(x)
