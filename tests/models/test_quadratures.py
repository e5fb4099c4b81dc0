"""States that nothing depends on: found, left out, and integrated afterwards."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from backsight.models import Trajectory, compile_model, simulate
from backsight.models.plants import actuator, quadrotor
from backsight.models.quadratures import ignorable, integrated, without_ignorable

HOVER = 0.7


def flight(times: np.ndarray) -> Trajectory:
    dae = compile_model(quadrotor())
    inputs = {f"u_{i}": HOVER + 0.02 * np.sin((1 + i / 3) * times) for i in (1, 2, 3, 4)}
    start = {f"rotor_{i}.thrust": 3.7 for i in (1, 2, 3, 4)} | {"body.u": 1.0, "body.r": 0.3}
    return simulate(dae, times, inputs, initial=start)


def test_a_craft_without_position_sensors_does_not_need_its_place_and_heading() -> None:
    dae = compile_model(quadrotor())
    assert {dae.states[g.state].name for g in ignorable(dae)} == {"body.x", "body.y", "body.z", "body.psi"}
    lean = without_ignorable(dae)
    assert [q.name for q in lean.states] == [q.name for q in dae.states if q.name not in ("body.x", "body.y", "body.z", "body.psi")]
    assert lean.residual.shape[0] == len(lean.equations) == len(lean.states) + len(lean.algebraics)
    assert lean.function()(1, 1, 0, 1, dae.parameter_values(), 0, 0)[0].is_regular()


def test_what_is_known_or_looked_at_is_kept_with_all_that_it_needs() -> None:
    dae = compile_model(quadrotor())
    assert {dae.states[g.state].name for g in ignorable(dae, {"body.x"})} == {"body.y", "body.z"}  # the heading turns x
    assert {dae.states[g.state].name for g in ignorable(dae, {"body.psi"})} == {"body.x", "body.y", "body.z"}


def test_a_position_whose_rate_is_a_state_stays() -> None:
    dae = compile_model(actuator())
    assert without_ignorable(dae) is dae


def test_the_model_without_them_moves_alike_and_they_follow_from_it() -> None:
    dae, times = compile_model(quadrotor()), np.linspace(0.0, 2.0, 201)
    run, gone = flight(times), ignorable(dae)
    x = np.array([np.zeros(201) if k in {g.state for g in gone} else run.states[q.name] for k, q in enumerate(dae.states)])
    found = integrated(dae, gone, times[::2], x)
    for g, value in zip(gone, found, strict=True):
        name = dae.states[g.state].name
        assert np.ptp(run.states[name]) > 0.01
        assert value == pytest.approx(run.states[name][::2], abs=2e-6), name


def test_the_quadrature_has_order_four() -> None:
    """psi' = (q sin(phi) + r cos(phi))/cos(theta) along motions that are written down, against SciPy."""
    dae = compile_model(quadrotor())
    gone = ignorable(dae)

    def along(t: np.ndarray) -> np.ndarray:
        x = np.zeros((len(dae.states), t.size))
        for name, value in {"phi": 0.4 * np.sin(3 * t), "theta": 0.3 * np.cos(2 * t), "q": np.sin(t), "r": 1 + np.cos(4 * t)}.items():
            x[[q.name for q in dae.states].index(f"body.{name}")] = value
        return x

    def rate(t: float, _: object) -> float:
        phi, theta = 0.4 * np.sin(3 * t), 0.3 * np.cos(2 * t)
        return float((np.sin(t) * np.sin(phi) + (1 + np.cos(4 * t)) * np.cos(phi)) / np.cos(theta))

    end = solve_ivp(rate, (0.0, 2.0), [0.0], rtol=1e-11, atol=1e-12).y[0, -1]
    psi = [dae.states[g.state].name for g in gone].index("body.psi")
    errors = [abs(integrated(dae, gone, np.linspace(0, 2, n + 1), along(np.linspace(0, 2, 2 * n + 1)))[psi, -1] - end) for n in (20, 40)]
    assert errors[1] < errors[0] / 12
