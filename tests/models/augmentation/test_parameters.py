"""Parameters that drift or differ from case to case."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from examples import K, M, oscillator, stiffening

from backsight.models import Dae, InputError, compile_model, simulate
from backsight.models.augmentation import by_case, drifting
from backsight.models.plants import actuator, five_bar

PLANT = compile_model(oscillator())
T = np.linspace(0.0, 1.0, 21)
U = np.sin(7 * T)
CASES = ("monday", "tuesday")


def moved(dae: Dae, parameters: dict[str, float], inputs: dict[str, np.ndarray] | None = None, **initial: float) -> np.ndarray:
    run = simulate(dae, T, {"F": U, **(inputs or {})}, parameters, {"mass.s": 0.1, **initial})
    return run.states["mass.s"]


def test_left_alone_a_drifting_parameter_is_a_constant_of_the_value_that_it_starts_from():
    dae = drifting(PLANT, "spring.k")
    assert moved(dae, {"spring.k": 1.0}, **{"spring.k": 80.0}) == pytest.approx(moved(PLANT, {"spring.k": 80.0}), abs=1e-9)


@pytest.mark.parametrize("case", CASES)
def test_in_each_case_the_value_of_that_case_acts_and_no_other(case):
    dae = by_case(by_case(PLANT, "spring.k", CASES), "mass.m", CASES)
    inputs = {f"case:{other}": np.full(T.shape, float(other == case)) for other in CASES}
    values = {"spring.k [monday]": 80.0, "spring.k [tuesday]": 30.0, "mass.m [monday]": 1.0, "mass.m [tuesday]": 3.0, "spring.k": 7.0}
    k, m = (80.0, 1.0) if case == "monday" else (30.0, 3.0)
    assert moved(dae, values, inputs) == pytest.approx(moved(PLANT, {"spring.k": k, "mass.m": m}), abs=1e-9)


def test_what_the_model_had_comes_first_and_the_parameter_keeps_its_entry():
    walk, cases = drifting(PLANT, "spring.k"), by_case(by_case(PLANT, "spring.k", CASES), "mass.m", CASES)
    info = next(p for p in PLANT.parameters if p.name == "spring.k")
    q = walk.states[-1]
    assert (q.name, q.unit, q.nominal, q.start) == (info.name, info.unit, info.nominal, K)
    assert walk.parameters == PLANT.parameters
    assert walk.states[:-1] == cases.states == PLANT.states
    assert cases.parameters[: len(PLANT.parameters)] == PLANT.parameters
    assert [q.name for q in cases.inputs] == ["F", "case:monday", "case:tuesday"]


def test_only_a_drifting_parameter_has_noise():
    walk = drifting(PLANT, "mass.m")
    assert [(p.name, p.unit) for p in walk.places] == [("mass", "N"), ("parameter:mass.m", "kg/s")]
    residual = walk.function()([0, 0, 0.3], [0, 0, M], [], 0, walk.parameter_values(), [0.0, 0.1], 0)[0]
    assert float(residual[-1]) == pytest.approx(0.2)
    assert by_case(PLANT, "mass.m", CASES).places == PLANT.places


def test_what_was_written_in_the_parameter_is_now_written_in_the_state():
    dae = drifting(compile_model(stiffening()), "friction.f_c")
    at = dae.probe("friction.flange.f")
    names = [q.name for q in dae.states]
    x = np.zeros(len(names))
    x[names.index("mass.v")], x[names.index("friction.f_c")] = 10.0, 3.0
    assert float(at(0, x, 0, 0, dae.parameter_values(), 0, 0)) == pytest.approx(3.0)


@pytest.mark.parametrize("change", [drifting, lambda dae, name: by_case(dae, name, CASES)])
def test_it_says_what_cannot_vary(change):
    with pytest.raises(InputError, match=r"no such parameter; did you mean 'spring\.k'\?"):
        change(PLANT, "spring.kk")
    for once in (drifting(PLANT, "spring.k"), by_case(PLANT, "spring.k", CASES)):
        with pytest.raises(InputError, match="stands for the parameter already"):
            change(once, "spring.k")
    axis = compile_model(actuator())
    width = next(p.name for p in axis.parameters if p.smoothing)
    with pytest.raises(InputError, match="rounds a corner"):
        change(axis, width)


@pytest.mark.parametrize("cases", [(), ("monday", "monday")])
def test_cases_are_named_once(cases):
    with pytest.raises(InputError, match="at least one case, and each once"):
        by_case(PLANT, "spring.k", cases)


def test_a_length_of_a_closed_loop_cannot_drift_but_may_differ_between_cases():
    dae = compile_model(five_bar())
    rows = [dae.residual[r] for r, e in enumerate(dae.equations) if e.place is None]
    held = ca.vertcat(dae.invariants, *rows)
    length = next(q.name for i, q in enumerate(dae.parameters) if q.unit == "m" and ca.depends_on(held, dae.p[i]))
    with pytest.raises(InputError, match="differentiated as if it were constant"):
        drifting(dae, length)
    assert by_case(dae, length, CASES).parameters[-1].name == f"{length} [tuesday]"
    assert drifting(dae, "P_1").states[-1].name == "P_1"
