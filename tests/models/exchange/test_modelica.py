"""Modelica text: what the compiler flattens is the plant that scipy integrates from the textbook equations."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from backsight.models import InputError, Model, ModelError, compile_model, simulate
from backsight.models.mechanics.translational import Damper

pytest.importorskip("rumoca", reason="Modelica text is an optional extra")

from backsight.models.exchange.modelica import load_modelica

pytestmark = pytest.mark.checkout

FLAT = """
model TwoMass "two masses, a spring and a damper"
  parameter Real m1(unit="kg", min=0.1, max=10) = 1.5 "motor side";
  parameter Real m2(unit="kg") = 2*m1;
  parameter Real k(unit="N/m") = 100;
  parameter Real d = 0.5;
  input Real F(unit="N");
  output Real x(unit="m");
  Real s1(start=0.1), s2, v1, v2;
  Real f;
equation
  der(s1) = v1;
  der(s2) = v2;
  m1*der(v1) = F - f;
  m2*der(v2) = f;
  f = k*(s1 - s2) + (if v1 - v2 > 0 then d else 2*d)*(v1 - v2);
  x = s1;
end TwoMass;
"""

PARTS = """
package Lib
  function square
    input Real x;
    output Real y;
  algorithm
    y := x*x;
  end square;
  connector Flange
    Real phi(unit="rad");
    flow Real tau(unit="N.m");
  end Flange;
  partial model TwoFlanges
    Flange a;
    Flange b;
  end TwoFlanges;
  model Inertia
    extends TwoFlanges;
    parameter Real J(unit="kg.m2", min=0) = 1 "inertia";
    Real phi(unit="rad", stateSelect=StateSelect.prefer);
    Real w(unit="rad/s");
    Real acc;
  equation
    a.phi = phi;
    b.phi = phi;
    w = der(phi);
    acc = der(w);
    J*acc = a.tau + b.tau;
  end Inertia;
  model Spring
    extends TwoFlanges;
    parameter Real c(unit="N.m/rad", min=0) = 1;
  equation
    b.tau = c*(b.phi - a.phi);
    a.tau + b.tau = 0;
  end Spring;
  model Source
    Flange f;
    input Real tau;
  equation
    f.tau = -tau;
  end Source;
  model Drive
    parameter Real c0 = 3;
    Source source;
    Inertia wheels[2](each J=0.5);
    Spring shaft(c=square(c0));
    input Real u;
    output Real y = wheels[2].phi;
  equation
    connect(source.f, wheels[1].a);
    connect(wheels[1].b, shaft.a);
    connect(shaft.b, wheels[2].a);
    source.tau = 2*u;
  end Drive;
end Lib;
"""


def write(folder: Path, text: str, name: str = "plant.mo") -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.fixture
def drive(tmp_path: Path) -> Model:
    return load_modelica(write(tmp_path, PARTS), "Lib.Drive")


def test_a_flat_class_moves_as_its_equations_say(tmp_path: Path) -> None:
    dae = compile_model(load_modelica(write(tmp_path, FLAT), "TwoMass"))
    t = np.linspace(0, 2, 41)
    force = np.sign(np.sin(5 * t))
    found = simulate(dae, t, {"F": force})

    def rhs(u: float, m1: float = 1.5, m2: float = 3.0, k: float = 100.0, d: float = 0.5):  # type: ignore[no-untyped-def]
        def f(_: float, q: np.ndarray) -> list[float]:  # type: ignore[type-arg]
            rate = q[2] - q[3]
            pull = k * (q[0] - q[1]) + (d if rate > 0 else 2 * d) * rate
            return [q[2], q[3], (u - pull) / m1, pull / m2]

        return f

    state, x = np.array([0.1, 0, 0, 0]), [0.1]
    for k in range(len(t) - 1):
        state = solve_ivp(rhs(force[k]), (t[k], t[k + 1]), state, rtol=1e-11, atol=1e-13, max_step=1e-3).y[:, -1]
        x.append(state[0])
    assert_allclose(found.outputs["x"], x, atol=1e-8)


def test_parameters_keep_unit_bounds_text_and_dependent_ones_follow(tmp_path: Path) -> None:
    dae = compile_model(load_modelica(write(tmp_path, FLAT), "TwoMass"))
    known = {p.name: p for p in dae.parameters}
    assert set(known) == {"m1", "k", "d"}
    m1 = known["m1"]
    assert (m1.unit, m1.minimum, m1.maximum, m1.value, m1.description) == ("kg", 0.1, 10.0, 1.5, "motor side")
    heavy = simulate(dae, np.linspace(0, 1, 11), {"F": 0.0}, {"m1": 3.0, "k": 0.0, "d": 0.0}, {"TwoMass.v1": 1.0})
    assert heavy.outputs["x"][-1] == pytest.approx(1.1, rel=1e-9)


def test_components_keep_their_names_balances_and_connections(drive: Model) -> None:
    dae = compile_model(drive)
    assert {"source", "wheels_1", "wheels_2", "shaft", "Drive"} == set(drive.components)
    assert [q.name for q in dae.states] == ["wheels_1.phi", "wheels_1.w", "wheels_2.phi", "wheels_2.w"]
    assert [(p.name, p.unit) for p in dae.places] == [("wheels_1", "N.m"), ("wheels_2", "N.m")]
    assert ("wheels_1.b", "shaft.a") in drive.connections
    assert {p.name: p.value for p in dae.parameters} == {"c0": 3.0, "wheels_1.J": 0.5, "wheels_2.J": 0.5}


def test_the_parts_move_as_two_inertias_and_a_shaft(drive: Model) -> None:
    t = np.linspace(0, 3, 61)
    found = simulate(compile_model(drive), t, {"u": 1.0})
    J, c, tau = 0.5, 9.0, 2.0
    omega = np.sqrt(2 * c / J)  # the sum moves freely, the difference swings
    mean, half = tau * t**2 / (4 * J), tau / (2 * J) * (1 - np.cos(omega * t)) / omega**2
    assert_allclose(found.outputs["y"], mean - half, atol=1e-9)


def test_components_of_the_library_are_inserted_at_modelica_flanges(drive: Model) -> None:
    from backsight.models.mechanics.rotational import RotationalDamper

    braked = compile_model(drive.insert("wheels_2.b", RotationalDamper(d=2.0), name="brake"))
    end = simulate(braked, np.linspace(0, 60, 121), {"u": 1.0}).states["wheels_2.w"][-1]
    assert end == pytest.approx(1.0, rel=1e-6)  # the torque of the motor over the damping
    with pytest.raises(ModelError, match="Damper has Translational flanges, the place is Rotational"):
        drive.insert("wheels_2.b", Damper())


def test_a_modelica_model_is_pickled_with_its_equations(drive: Model) -> None:
    copy = pickle.loads(pickle.dumps(drive))
    assert copy == drive
    assert str(compile_model(copy).residual) == str(compile_model(drive).residual)


def test_an_origin_tells_the_line_of_the_text(drive: Model) -> None:
    origins = [e.origin for e in compile_model(drive).equations]
    line = next(k for k, text in enumerate(PARTS.splitlines(), start=1) if "J*acc" in text)
    assert f"J*acc = a.tau + b.tau (line {line}) of wheels_1" in origins


@pytest.mark.parametrize(
    ("text", "name", "error", "match"),
    [
        (FLAT, "", InputError, r'"plant\.mo" names no class; write "plant\.mo:Class"'),
        (FLAT, "Nope", ModelError, r"plant\.mo: .*Nope"),
        ("model Bad\n Real x\nequation x = 1;\nend Bad;", "Bad", ModelError, r"plant\.mo: "),
        ("model Bad\n Real x; Real y;\nequation x = 1;\nend Bad;", "Bad", ModelError, r"unbalanced model: 1 equations, 2 unknowns"),
        (
            "model Bad\n Real x(start=1); discrete Real c;\nequation der(x) = -x;\n when x < 0.5 then c = pre(c) + 1; end when;\nend Bad;",
            "Bad",
            ModelError,
            r"Modelica class 'Bad' has when chains: only continuous equations are supported",
        ),
        (
            "model Bad\n Real x(start=1); Boolean b;\nequation der(x) = -x; b = x > 0.5;\nend Bad;",
            "Bad",
            ModelError,
            r"'b' is discrete; only continuous Real variables are supported",
        ),
        (
            "model Bad\n Real x; Real y[2];\nequation der(x) = -x; y = {x, 2*x};\nend Bad;",
            "Bad",
            ModelError,
            r"'y = \{x, 2\*x\} \(line 3\)' is an equation of arrays; write it with scalars",
        ),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(tmp_path: Path, text: str, name: str, error: type[Exception], match: str) -> None:
    with pytest.raises(error, match=match):
        compile_model(load_modelica(write(tmp_path, text), name))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r'"none\.mo:A": there is no file'):
        load_modelica(tmp_path / "none.mo", "A")


TURNED = """
package Turned
  connector Pin
    Real v(unit="V");
    flow Real i(unit="A");
  end Pin;
  connector Flange
    Real phi(unit="rad");
    flow Real tau(unit="N.m");
  end Flange;
  model Inertia
    Flange a, b;
    parameter Real J = 1;
    Real phi(start=0), w(start=0), acc;
  equation
    phi = a.phi;
    phi = b.phi;
    w = der(phi);
    acc = der(w);
    a.tau + b.tau = J*acc;
  end Inertia;
  model Pair
    Inertia one, two(phi(start=0.7), w(start=2));
    output Real y = one.phi;
  equation
    connect(one.b, two.a);
  end Pair;
  model Inductor
    Pin p, n;
    parameter Real L = 2;
    Real v, i;
  equation
    v = p.v - n.v;
    p.i + n.i = 0;
    i = p.i;
    L*der(i) = v;
  end Inductor;
  model Source
    Pin p, n;
    input Real u;
  equation
    p.v - n.v = u;
    p.i + n.i = 0;
  end Source;
  model Ground
    Pin p;
  equation
    p.v = 0;
  end Ground;
  model Circuit
    Ground ground;
    Source source;
    Inductor coil;
    input Real u;
    output Real y = coil.i;
  equation
    connect(source.p, coil.p);
    connect(source.n, coil.n);
    connect(source.n, ground.p);
    source.u = u;
  end Circuit;
  model Second
    parameter Real m = -2;
    Real x(start=1), v, s(start=0), r;
    input Real F(unit="N");
    output Real y = x;
  equation
    v = der(x);
    0 = F - x - 2*der(v);
    r = der(s);
    F = m*der(r);
  end Second;
end Turned;
"""


def residual_gains(model: Model) -> dict[str, float]:
    """Place -> d row / d(the derivatives in it) over d row / d w, by sign: -1 where it reads inertia - forces - w."""
    import casadi as ca

    dae = compile_model(model)
    rows = dict(zip((e.place for e in dae.equations), ca.vertsplit(dae.residual), strict=True))
    found = {}
    for k, place in enumerate(dae.places):
        inertia = ca.sum2(ca.jacobian(rows[k], dae.dx))
        w = ca.jacobian(rows[k], dae.w[k])
        found[place.name] = float(ca.Function("s", [dae.p], [ca.sign(inertia) * w])(dae.parameter_values()))
    return found


@pytest.mark.parametrize(("name", "places"), [("Pair", ["one"]), ("Circuit", ["coil"]), ("Second", ["Second.v", "Second.r"])])
def test_residuals_are_forces_whichever_way_round_the_balance_is_written(tmp_path: Path, name: str, places: list[str]) -> None:
    gains = residual_gains(load_modelica(write(tmp_path, TURNED), f"Turned.{name}"))
    assert sorted(gains) == sorted(places)
    assert set(gains.values()) == {-1.0}


def test_a_balance_has_the_unit_of_its_terms_or_none(tmp_path: Path) -> None:
    path = write(tmp_path, TURNED)
    units = {n: [p.unit for p in compile_model(load_modelica(path, f"Turned.{n}")).places] for n in ("Pair", "Circuit", "Second")}
    assert units == {"Pair": ["N.m"], "Circuit": [""], "Second": ["N", "N"]}


def test_start_values_of_rigidly_joined_parts_count(tmp_path: Path) -> None:
    dae = compile_model(load_modelica(write(tmp_path, TURNED), "Turned.Pair"))
    assert sorted(q.start for q in dae.states) == [0.7, 2.0]
    assert simulate(dae, [0.0, 1.0], {}).outputs["y"] == pytest.approx([0.7, 2.7])


def test_initial_equations_with_numbers_are_start_values(tmp_path: Path) -> None:
    text = """
    model Swing
      parameter Real v0 = 5;
      Real x(start=1, fixed=true), v;
      input Real u; output Real y;
    initial equation
      v0 = v;
    equation
      der(x) = v; der(v) = u - x; y = x;
    end Swing;"""
    t = np.linspace(0, 2, 5)
    found = simulate(compile_model(load_modelica(write(tmp_path, text), "Swing")), t, {"u": 0.0})
    assert_allclose(found.outputs["y"], np.cos(t) + 5 * np.sin(t), atol=1e-9)


LOOPS = """
package Loops
  model Chain
    parameter Integer n = 3;
    parameter Real g = 2;
    Real z[n];
    input Real u;
  equation
    for i in 1:n loop
      der(z[i]) = (if i > 1 then z[i-1] else u) - g*i*z[i];
    end for;
  end Chain;
  model Four
    Chain chain(n=4);
    input Real u; output Real y;
  equation
    chain.u = u; y = chain.z[4];
  end Four;
  model Weights
    parameter Real a[3] = {1, -2, 0.5};
    parameter Real B[2,2] = {{1, 2}, {3, 4}};
    parameter Boolean twice = true;
    parameter Integer k = 3;
    Real z[3](start={1, 2, 3});
    input Real u; output Real y;
  equation
    for i in 1:3 loop der(z[i]) = a[i]*u*k; end for;
    y = z[1] + 10*z[2] + 100*z[3] + B[2,1] + (if twice then u else 0);
  end Weights;
end Loops;
"""


def test_every_round_of_a_loop_is_an_equation(tmp_path: Path) -> None:
    dae = compile_model(load_modelica(write(tmp_path, LOOPS), "Loops.Four"))
    found = simulate(dae, np.linspace(0, 1, 11), {"u": 1.0})
    truth = solve_ivp(
        lambda _, z: [(z[i - 1] if i else 1.0) - 2 * (i + 1) * z[i] for i in range(4)], (0, 1), np.zeros(4), rtol=1e-11, atol=1e-13
    )
    assert found.outputs["y"][-1] == pytest.approx(truth.y[3, -1], rel=1e-8)


def test_arrays_of_numbers_are_parameters_and_whole_and_logical_numbers_are_constants(tmp_path: Path) -> None:
    dae = compile_model(load_modelica(write(tmp_path, LOOPS), "Loops.Weights"))
    assert {p.name: p.value for p in dae.parameters} == {
        "a_1": 1.0,
        "a_2": -2.0,
        "a_3": 0.5,
        "B_1_1": 1.0,
        "B_1_2": 2.0,
        "B_2_1": 3.0,
        "B_2_2": 4.0,
    }
    end = simulate(dae, [0.0, 1.0], {"u": 1.0}).outputs["y"][-1]
    assert end == pytest.approx((1 + 3) + 10 * (2 - 6) + 100 * (3 + 1.5) + 3 + 1)


def test_parameters_without_a_unit_are_asked_about(tmp_path: Path) -> None:
    from backsight.models.analysis.identifiability import identifiability

    model = load_modelica(
        write(tmp_path, "model A\n parameter Real k = 2; Real x; input Real u; output Real y;\nequation der(x) = k*u; y = x;\nend A;"), "A"
    )
    assert str(identifiability(model)) == "k can be told from y"


def test_an_origin_is_the_text_of_the_equation_and_not_of_a_functions_default(tmp_path: Path) -> None:
    text = """package P
  function f
    input Real x; input Real k = 2; output Real y;
  algorithm
    y := k*x;
  end f;
  model M
    Real x; input Real u; output Real y = x;
  equation
    der(x) = u - f(x);
  end M;
end P;"""
    origins = [e.origin for e in compile_model(load_modelica(write(tmp_path, text), "P.M")).equations]
    assert origins == ["der(x) = u - f(x) (line 10) of M"]


@pytest.mark.parametrize(
    ("declared", "equation", "match"),
    [
        ("parameter Real k;", "der(x) = k*u;", r"Modelica class 'B': parameter 'k' has no value; give it one"),
        ("parameter Integer k;", "der(x) = k*u;", r"Modelica class 'B': parameter 'k' has no value; give it one"),
        ("Real z_1; Real z[2];", "der(x) = u; z_1 = 1; z[1] = 2; z[2] = 3;", r"'z_1' and 'z' would both be called 'z_1' here; rename"),
        ("parameter Real A[2] = fill(1, 2);", "der(x) = A[1]*u;", r"values are not written element by element for the array 'A'"),
        ("", "der(x) = mod(x, 2) - u;", r"B of B: 'der\(x\) = mod\(x, 2\) - u \(line 4\)': the Modelica function mod\(\) is not supported"),
        ("", "der(x) = u; initial equation x^2 = 4;", r"the initial equation 'x\^2 = 4 \(line 4\)' is not supported; write the value"),
        ("", "der(x) = u; initial equation der(x) = 0;", r"the initial equation 'der\(x\) = 0 \(line 4\)' is not supported"),
    ],
)
def test_what_would_be_filled_in_dropped_or_confused_is_refused(tmp_path: Path, declared: str, equation: str, match: str) -> None:
    text = f"model B\n {declared}\n Real x; input Real u; output Real y = x;\nequation {equation}\nend B;"
    with pytest.raises(ModelError, match=match):
        compile_model(load_modelica(write(tmp_path, text), "B"))


TROLLEY = """
model Trolley
  parameter Real M(unit="kg") = 10;
  parameter Real m(unit="kg") = 5;
  parameter Real L(unit="m") = 1.5;
  input Real F(unit="N");
  output Real x = s;
  Real s, v, p(start=0.2), w;
equation
  v = der(s);
  w = der(p);
  (M + m)*der(v) + m*L*cos(p)*der(w) - m*L*sin(p)*w^2 = F;
  L*der(w) + cos(p)*der(v) + 9.81*sin(p) = 0;
end Trolley;
"""


def test_two_balances_may_hold_the_same_derivative(tmp_path: Path) -> None:
    dae = compile_model(load_modelica(write(tmp_path, TROLLEY), "Trolley"))
    assert len({p.name for p in dae.places}) == 2
    t = np.linspace(0, 3, 31)
    run = simulate(dae, t, {"F": 0.0})
    momentum = 15 * run.states["Trolley.v"] + 5 * 1.5 * np.cos(run.states["Trolley.p"]) * run.states["Trolley.w"]
    assert_allclose(momentum, 0.0, atol=1e-9)
