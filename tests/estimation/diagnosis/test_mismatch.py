"""The residual forces of the page are those of the estimates, against what was recorded."""

from __future__ import annotations

import numpy as np
import pytest
from concealed_axis import posed, run

from backsight.estimation import Problem, Recording, Weights, smooth
from backsight.estimation.diagnosis.answer.mismatch import mismatches
from backsight.models import Model
from backsight.models.mechanics.planar import Body, World, WorldForce, WorldTorque


def test_a_force_that_lacks_is_seen_against_the_velocity_that_it_follows():
    made = run(1.0, 2e-3, f_c=20.0)
    problem = posed(made, W={"carriage": 0.5})
    result = smooth(problem)
    (found,) = mismatches(result)
    assert (found.place, found.unit, found.recording) == ("carriage", "N", "axis")
    assert found.time == pytest.approx(made.time)
    assert set(found.against) == {"position", "velocity", "F"}
    v, unit = found.against["velocity"]
    assert unit == "m/s"
    assert v == pytest.approx(made.truth["carriage.v"], abs=5e-3)
    assert found.against["position"][0] == pytest.approx(made.truth["carriage.s"], abs=1e-5)
    pushed, unit = found.against["F"]
    assert unit == "N"
    assert pushed[:-1] == pytest.approx(made.inputs["F"][:-1])
    # what balances the axis' own forces under the parameters that were found
    m, d = (result.parameters[name].value for name in ("carriage.m", "friction.d"))
    speed, rate = made.truth["carriage.v"], np.gradient(made.truth["carriage.v"], made.time)
    lacking = (m - 95.109) * rate + (d - 203.5) * speed - 20.0 * np.sign(speed)
    moving = np.abs(speed) > 0.03
    moving[:20] = moving[-20:] = False
    assert np.sqrt(np.mean(lacking[moving] ** 2)) > 3.0
    assert np.corrcoef(found.force[moving], lacking[moving])[0, 1] > 0.9
    assert np.all(found.std > 0)


def pushed() -> Problem:
    """A free body in a horizontal plane, pushed and turned, with a drag that its model lacks; by its closed form."""
    m, d, J, f, tau = 2.0, 1.5, 0.1, (3.0, -2.0), 0.2
    t = np.arange(0.0, 2.0, 0.01)
    way = (t - m / d * (1.0 - np.exp(-d / m * t))) / d
    read = {"x": f[0] * way, "y": f[1] * way, "phi": 0.5 * tau / J * t**2}
    plate = Model(
        name="plate",
        components={
            "world": World(),
            "body": Body(m=m, I=J),
            "push": WorldForce(),
            "turn": WorldTorque(),
        },
        connections=[("body.frame", "push.frame"), ("body.frame", "turn.frame")],
        inputs={"f_x": "push.f_x", "f_y": "push.f_y", "tau": "turn.tau"},
        outputs={"x": "body.x", "y": "body.y", "phi": "body.phi"},
    )
    inputs = {"f_x": np.full_like(t, f[0]), "f_y": np.full_like(t, f[1]), "tau": np.full_like(t, tau)}
    log = Recording(name="run", time=t, inputs=inputs, outputs=read, output_std=dict.fromkeys(read, 1e-4))
    W = {"body.x": 1.0, "body.y": 1.0, "body.phi": 0.1}
    return Problem(model=plate, recordings=[log], weights=Weights(W=W))


def test_the_balances_of_a_body_in_a_plane_are_seen_against_the_motion_of_each():
    found = {m.place: m for m in mismatches(smooth(pushed()))}
    assert {place: set(m.against) for place, m in found.items()} == {
        "body.x": {"position", "velocity", "f_x", "f_y", "tau"},
        "body.y": {"position", "velocity", "f_x", "f_y", "tau"},
        "body.phi": {"angle", "angular velocity", "f_x", "f_y", "tau"},
    }
    t = found["body.x"].time
    for place, f in (("body.x", 3.0), ("body.y", -2.0)):
        v, unit = found[place].against["velocity"]
        assert unit == "m/s"
        assert v == pytest.approx(f / 1.5 * (1.0 - np.exp(-0.75 * t)), abs=0.02)
        assert found[place].force[20:-20] == pytest.approx(-1.5 * v[20:-20], abs=0.15)  # the drag
    turned, unit = found["body.phi"].against["angular velocity"]
    assert unit == "rad/s"
    assert turned == pytest.approx(2.0 * t, abs=0.02)
