"""The actuator: its equations as published, and its motion against closed forms between events."""

import time
from itertools import pairwise
from typing import Any, Literal

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

from backsight.models import ModelError, compile_model, simulate
from backsight.models.plants import PLANTS, actuator

M, D, F_C, OFFSET = 95.109, 203.50, 20.394, -3.165


def drive(t: np.ndarray) -> np.ndarray:
    """Sines and held steps that stop and reverse the axis several times."""
    steps = np.repeat(np.random.default_rng(7).uniform(-30.0, 30.0, len(t) // 25 + 1), 25)[: len(t)]
    return sum(a * np.sin(2 * np.pi * f * t + i) for i, (f, a) in enumerate(((0.4, 60.0), (1.1, 50.0), (2.9, 30.0)))) + steps


def with_events(t: np.ndarray, force: np.ndarray, x: float) -> np.ndarray:
    """M x'' = F - C sgn(x') - D x' - offset from rest, in closed form between exact stops; sticks while |F - offset| <= C."""
    v, rows = 0.0, []
    for k, (start, end) in enumerate(pairwise([*t, t[-1]])):
        rows.append((x, v))
        left, push = end - start, force[k] - OFFSET
        while left > 0.0 and (v != 0.0 or abs(push) > F_C):
            direction = np.sign(v) if v else np.sign(push)
            final, rate = (push - F_C * direction) / D, D / M
            stop = np.log1p(-v / final) / rate if v and v / final < 0 else np.inf
            step = min(left, stop)
            x += final * step - (v - final) * np.expm1(-rate * step) / rate
            v = 0.0 if step == stop else final + (v - final) * np.exp(-rate * step)
            left -= step
    return np.array(rows).T


def test_the_axis_is_registered_under_its_name() -> None:
    assert PLANTS["actuator"]() == actuator()


def test_names_units_and_defaults_are_the_published_ones() -> None:
    dae = compile_model(actuator())
    assert [(q.name, q.unit) for q in dae.states] == [("carriage.s", "m"), ("carriage.v", "m/s")]
    assert [(q.name, q.unit) for q in (*dae.inputs, *dae.outputs)] == [("F", "N"), ("x", "m")]
    assert {q.name: (q.value, q.unit) for q in dae.parameters if not q.smoothing} == {
        "carriage.m": (M, "kg"),
        "friction.d": (D, "N.s/m"),
        "friction.f_c": (F_C, "N"),
        "offset.f": (OFFSET, "N"),
        "encoder.gain": (1.0, "1"),
        "encoder.bias": (0.0, "m"),
    }
    assert [q.name for q in dae.parameters if q.smoothing] == ["friction.width"]
    assert [(p.name, p.unit, p.kind, p.enabled) for p in dae.places] == [("carriage", "N", "balance", True)]
    assert ("screw", "m", "law", False) in [(p.name, p.unit, p.kind, p.enabled) for p in dae.dormant_places]
    assert (dae.z.shape[0], dae.index, dae.kinematics, dae.invariants.shape[0]) == (0, 0, ((0, 1, 0),), 0)
    assert dae.equations[1].origin == "force balance of carriage"
    assert dae.equations[1].place == 0


def test_its_rows_are_the_textbook_balance_in_newtons() -> None:
    dae = compile_model(actuator())
    rng = np.random.default_rng(1)
    for _ in range(5):
        dx, x, u, w = rng.normal(size=2), rng.normal(size=2) * [1, 1e-3], rng.normal(size=1), rng.normal(size=1)
        residual, output = dae.function()(dx, x, [], u, dae.parameter_values(), w, 0.0)
        friction = D * x[1] + F_C * np.tanh(x[1] / 1e-3)
        assert residual.full()[:, 0] == pytest.approx([dx[0] - x[1], M * dx[1] - (u[0] - friction - OFFSET) - w[0]], rel=1e-12)
        assert float(output) == x[0]


def test_the_residual_enters_its_own_row_only_and_with_weight_minus_one() -> None:
    dae = compile_model(actuator())
    assert ca.DM(ca.jacobian(dae.residual, dae.w)).full().tolist() == [[0.0], [-1.0]]


def test_a_residual_at_the_screw_is_its_wind_up_seen_by_the_encoder() -> None:
    dae = compile_model(actuator(), places=("screw",))
    row = next(i for i, e in enumerate(dae.equations) if e.origin == "rigidity of screw")
    residual, output = dae.function()(
        [0, 0], [0.3, 0], [0.31], [0], dae.parameter_values(), [0.01 if p.name == "screw" else 0 for p in dae.places], 0
    )
    assert float(residual[row]) == pytest.approx(0.0)
    assert float(output) == 0.31


def test_without_coulomb_friction_it_follows_the_matrix_exponential_under_held_forces() -> None:
    t = np.arange(3000) * 0.002
    force = drive(t)
    a = np.array([[0.0, 1.0, 0.0], [0.0, -D / M, 1.0 / M], [0.0, 0.0, 0.0]])
    step = expm(a * 0.002)
    truth = [np.array([0.01, 0.02])]
    for f in force[:-1]:
        truth.append((step @ [*truth[-1], f - OFFSET])[:2])
    began = time.perf_counter()
    run = simulate(compile_model(actuator()), t, {"F": force}, {"friction.f_c": 0.0}, {"carriage.s": 0.01, "carriage.v": 0.02})
    assert time.perf_counter() - began < 20.0  # 0.5 s on a quiet machine
    for name, column in zip(("carriage.s", "carriage.v"), np.array(truth).T, strict=True):
        assert np.abs(run.states[name] - column).max() < 1e-10 * np.ptp(column)
    assert np.array_equal(run.outputs["x"], run.states["carriage.s"])


def test_with_coulomb_friction_it_sticks_and_slips_as_the_event_accurate_solution_does() -> None:
    t = np.arange(3000) * 0.002
    force = drive(t)
    x, v = with_events(t, force, 0.01)
    assert np.sum(v[1:] == 0.0) > 20
    assert np.sum(v[1:] * v[:-1] < 0) >= 2
    run = simulate(compile_model(actuator()), t, {"F": force}, initial={"carriage.s": 0.01})
    assert np.abs(run.states["carriage.s"] - x).max() < 1e-6 * np.ptp(x)
    assert np.abs(run.states["carriage.v"] - v).max() < 1e-6 * np.ptp(v)


QUIET = {"friction.f_c": 0.0, "friction.d": 0.0, "offset.f": 0.0, "screw.d": 0.0}


@pytest.mark.parametrize(("encoder", "side"), [("motor", "motor_mass"), ("carriage", "carriage")])
def test_a_compliant_screw_gives_the_two_mass_resonance_on_either_side(encoder: Literal["motor", "carriage"], side: str) -> None:
    dae = compile_model(actuator(screw="compliant", encoder=encoder))
    values = {q.name: q.value for q in dae.parameters}
    k, nut = values["screw.k"], values["motor_mass.m"]
    assert nut + values["carriage.m"] == pytest.approx(M)
    t = np.linspace(0.0, 0.05, 101)
    run = simulate(dae, t, {"F": 0.0}, QUIET, {"motor_mass.s": 1e-4})
    frequency = np.sqrt(k * (1 / nut + 1 / (M - nut)))
    assert frequency / (2 * np.pi) == pytest.approx(80.0, abs=0.5)
    assert values["screw.d"] / (2 * k / frequency) == pytest.approx(0.02, rel=0.01)
    twist = run.states["motor_mass.s"] - run.states["carriage.s"]
    assert twist == pytest.approx(1e-4 * np.cos(frequency * t), abs=1e-11)
    assert np.array_equal(run.outputs["x"], run.states[f"{side}.s"])


def test_a_compliant_axis_moves_as_the_rigid_one_in_the_long_run() -> None:
    t = np.linspace(0.0, 2.0, 201)
    force = 100.0 * np.sin(2 * np.pi * t)
    rigid, soft = (simulate(compile_model(actuator(screw)), t, {"F": force}) for screw in ("rigid", "compliant"))  # type: ignore[arg-type]
    assert np.abs(rigid.outputs["x"] - soft.outputs["x"]).max() < 2 * 100.0 / 4e6 < 1e-3 * np.ptp(rigid.outputs["x"])  # two wind-ups


def test_a_compliant_screw_has_its_own_states_and_places() -> None:
    dae = compile_model(actuator("compliant"))
    assert [q.name for q in dae.states] == ["motor_mass.s", "motor_mass.v", "carriage.s", "carriage.v"]
    assert [p.name for p in dae.places] == ["motor_mass", "carriage"]
    assert ("screw", "N") in [(p.name, p.unit) for p in dae.dormant_places]


@pytest.mark.parametrize(
    ("arguments", "text"), [({"screw": "soft"}, r"screw='soft'.*'rigid' or"), ({"encoder": "nut"}, r"encoder='nut'.*'motor'")]
)
def test_another_variant_is_refused(arguments: dict[str, Any], text: str) -> None:
    with pytest.raises(ModelError, match=text):
        actuator(**arguments)
