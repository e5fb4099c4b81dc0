"""How inputs act between samples, told from the recording."""

from __future__ import annotations

import numpy as np
import pytest
import truths
from examples import OFFSET, D, K, M, compiled, oscillator

from backsight.estimation import Free, Problem, Recording, Smoothing, Weights, smooth
from backsight.models.errors import InputError

PLANT, STD = truths.Plant(m=M, d=D, k=K, offset=OFFSET), 1e-3
FREE = {"mass.m": Free(3.0), "spring.k": Free(30.0), "damper.d": Free(1.0), "offset.f": Free(0.0)}


def recorded(hold: str, *, ask: bool = True) -> Recording:
    """Six seconds at 20 Hz under a force that changes within a few samples."""
    rng, n = np.random.default_rng(4), 120
    time = 0.05 * np.arange(n)
    u, start = 25 * np.sin(5 * time + 2 * np.sin(time)), np.array([0.02, -0.1])
    x = truths.linearly_driven(PLANT, time, u, start) if hold == "linear" else truths.motion(PLANT, time, u, start)
    y = x[:, 0] + STD * rng.normal(size=n)
    return Recording(name="run", time=time, inputs={"F": u}, outputs={"x": y}, output_std={"x": STD}, open_hold=ask)


def fitted(recording: Recording) -> Smoothing:
    return smooth(Problem(model=compiled(oscillator()), recordings=[recording], parameters=FREE, weights=Weights(W={"mass": 0.05})))


@pytest.mark.parametrize(("hold", "said"), [("zero", "held from sample to sample"), ("linear", "straight from sample to sample")])
def test_the_hold_that_made_the_recording_is_found(hold, said):
    s = fitted(recorded(hold))
    note = next(n for n in s.notes if n.startswith("Inputs of run"))
    assert said in note
    assert "hardly" not in note
    for name, true in (("mass.m", M), ("spring.k", K), ("damper.d", D)):
        assert abs(s.parameters[name].value - true) < 3.5 * s.parameters[name].std


def test_a_recording_that_says_its_hold_is_not_asked():
    s = fitted(recorded("zero", ask=False))
    assert not any("Inputs of" in n for n in s.notes)


def test_a_file_leaves_its_hold_open_by_a_word(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t,F,x\n" + "\n".join(f"{0.1 * k},{k % 2},{0.1 * k}" for k in range(10)) + "\n")
    columns = {"time": "t", "inputs": {"F": "F"}, "outputs": {"x": "x"}}
    r = Recording.read(path, **columns, hold="auto")
    assert (r.hold, r.open_hold) == ("zero", True)
    assert not Recording.read(path, **columns, hold="linear").open_hold
    with pytest.raises(InputError, match='hold is "cubic"; it must be "zero" or "linear" or "auto"'):
        Recording.read(path, **columns, hold="cubic")
