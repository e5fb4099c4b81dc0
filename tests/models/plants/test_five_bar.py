"""The five-bar manipulator against the minimal-coordinate equations of its report, written here by hand."""

from functools import cache

import casadi as ca
import numpy as np
import pytest

from backsight.models import Dae, ModelError, compile_model, simulate
from backsight.models.mechanics.planar import World
from backsight.models.mechanics.rotational import RotationalFriction
from backsight.models.plants import PLANTS
from backsight.models.plants.five_bar import five_bar

P = {"P_1": 0.1080, "P_2": 0.005422, "P_3": 0.01029, "P_4": 0.6059, "P_5": 0.1442, "P_6": 0.04350}
OTHERS = {"P_1": 0.15, "P_2": 0.008, "P_3": 0.02, "P_4": 0.5, "P_5": 0.11, "P_6": 0.05}
L1, L2, L3, L4, L5, R3, R4, M3, M4 = 0.25, 0.25, 0.20, 0.10, 0.22, 0.10, 0.05, 0.25, 0.15


@cache
def plant() -> Dae:
    return compile_model(five_bar())


def angles(theta_2: ca.SX) -> tuple[ca.SX, ca.SX]:
    """theta_3 of link 56 and theta_4 of link 3, against link 12."""
    square = L4**2 + L2**2 - 2 * L2 * L4 * ca.cos(theta_2)
    aim, d = ca.atan(-L4 * ca.sin(theta_2) / (L2 - L4 * ca.cos(theta_2))), ca.sqrt(square)
    return aim + ca.acos((square - L3**2 + L5**2) / (2 * L5 * d)), aim + ca.acos((square + L3**2 - L5**2) / (-2 * L3 * d))


def kinetic_energy(p: dict[str, float], theta_2: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """f_1, f_2, f_3 of T = f_1 theta_1'^2 + f_2 theta_2'^2 + f_3 theta_1' theta_2' (eq. 3.2), with the combinations A_1 .. A_8."""
    t3, t4 = angles(theta_2)
    a1 = p["P_1"] + M3 * (L1 + L2) ** 2 + M3 * R3**2 + p["P_2"] + M4 * (L1**2 + R4**2) + p["P_3"] + p["P_4"] * (L1**2 + L4**2) + p["P_6"]
    a2, a3, a4, a5 = M4 * L1 * R4 + p["P_4"] * L1 * L4, p["P_5"] * L1, M3 * (L1 + L2) * R3, p["P_5"] * L4
    a6, a7, a8 = M4 * R4**2 + p["P_3"] + p["P_4"] * L4**2, p["P_6"], M3 * R3**2 + p["P_2"]
    rate_3 = L4 / L5 * ca.sin(t4 - theta_2) / ca.sin(t3 - t4)  # d theta_3 / d theta_2
    rate_4 = L4 / L3 * ca.sin(t3 - theta_2) / ca.sin(t3 - t4)
    c2, c3, c4, c23 = ca.cos(theta_2), ca.cos(t3), ca.cos(t4), ca.cos(theta_2 - t3)
    f1 = a1 / 2 + a2 * c2 + a3 * c3 + a4 * c4 + a5 * c23
    f2 = a6 / 2 + a7 / 2 * rate_3**2 + a8 / 2 * rate_4**2 + a5 * c23 * rate_3
    f3 = a6 + a2 * c2 + a5 * c23 + (a7 + a3 * c3 + a5 * c23) * rate_3 + (a8 + a4 * c4) * rate_4
    return f1, f2, f3


def truth(p: dict[str, float]) -> ca.Function:
    """(theta_1, theta_2, theta_1', theta_2', tau_1, tau_2) -> accelerations, energy (eqs. 3.3 and 3.4)."""
    theta_2, v1, v2, tau = ca.SX.sym("theta_2"), ca.SX.sym("v1"), ca.SX.sym("v2"), ca.SX.sym("tau", 2)
    f1, f2, f3 = kinetic_energy(p, theta_2)
    d1, d2, d3 = (ca.jacobian(f, theta_2) for f in (f1, f2, f3))
    mass = ca.blockcat([[2 * f1, f3], [f3, 2 * f2]])
    rest = ca.vertcat(2 * d1 * v1 * v2 + d3 * v2**2, -d1 * v1**2 + d2 * v2**2)
    energy = f1 * v1**2 + f2 * v2**2 + f3 * v1 * v2
    return ca.Function("truth", [ca.SX.sym("theta_1"), theta_2, v1, v2, tau], [ca.solve(mass, tau - rest), energy])


def accelerations(dae: Dae, p: dict[str, float], q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Of joints 1 and 2, from the rows of the model with the loop closed by the report's formulas."""
    order = [q.name for q in dae.states]
    x, rates = ca.SX.sym("x", 4), ca.SX.sym("a", 2)
    at = {name: x[i] for i, name in enumerate(order)}
    dx = [at[name.replace("phi", "omega")] if name.endswith("phi") else rates[int(name[6]) - 1] for name in order]
    t3, t4 = angles(at["joint_2.phi"])
    loop = {"joint_3.phi": t4, "joint_4.phi": t3 - at["joint_2.phi"]}
    z = ca.vertcat(*(loop[s.name] for s in dae.algebraics))
    rows = dae.function()(ca.vertcat(*dx), x, z, dae.u, dae.parameter_values(p), 0, 0)[0]
    dynamic = ca.vertcat(*(rows[i] for i, e in enumerate(dae.equations) if e.place is not None))
    rest = ca.vertcat(*(rows[i] for i, e in enumerate(dae.equations) if e.place is None))
    solved = -ca.solve(ca.jacobian(dynamic, rates), ca.substitute(dynamic, rates, 0))
    both = ca.Function("both", [x, dae.u], [solved, rest])
    values = {"joint_1.phi": q[0], "joint_2.phi": q[1], "joint_1.omega": v[0], "joint_2.omega": v[1]}
    found, closed = both([values[name] for name in order], tau)
    assert np.abs(closed.full()).max() < 1e-14
    return np.asarray(found.full()[:, 0])


def trajectory(lambda_1: float, k_0: float, lambda_2: float, w: float, t: float) -> tuple[np.ndarray, np.ndarray]:
    """Eqs. 3.5 and 3.6, and their rates."""
    shape, rate = np.cos(w * t) - np.cos(3 * w * t) / 9, -w * np.sin(w * t) + w * np.sin(3 * w * t) / 3
    return np.array([lambda_1 * (shape - 8 / 9), k_0 + lambda_2 * shape]), rate * np.array([lambda_1, lambda_2])


def test_the_plant_is_registered_under_its_name() -> None:
    assert PLANTS["five_bar"]() == five_bar()


def test_names_places_and_defaults_are_the_published_ones() -> None:
    dae = plant()
    assert {q.name: q.unit for q in dae.states} == {
        "joint_1.phi": "rad",
        "joint_1.omega": "rad/s",
        "joint_2.phi": "rad",
        "joint_2.omega": "rad/s",
    }
    assert [(q.name, q.unit) for q in (*dae.inputs, *dae.outputs)] == [
        ("tau_1", "N.m"),
        ("tau_2", "N.m"),
        ("theta_1", "rad"),
        ("theta_2", "rad"),
    ]
    parameters = {q.name: q.value for q in dae.parameters}
    assert {name: parameters[name] for name in P} == P
    assert parameters["world.tilt"] == 0.0
    assert [(p.name, p.unit, p.enabled) for p in dae.places] == [("joint_1", "N.m", True), ("joint_2", "N.m", True)]
    assert {"joint_3", "joint_4", "joint_5"} <= {p.name for p in dae.dormant_places}
    assert {"world", "link_12", "link_3", "link_4", "link_56"} <= set(five_bar().components)


def test_the_loop_leaves_two_angles_to_solve_for_and_no_invariant() -> None:
    dae = plant()
    assert [q.name for q in dae.algebraics] == ["joint_3.phi", "joint_4.phi"]
    assert (dae.index, dae.invariants.shape[0], len(dae.kinematics)) == (3, 0, 2)
    slopes = ca.DM(ca.jacobian(dae.residual, dae.w)).full()
    assert [row.tolist() for row, e in zip(slopes, dae.equations, strict=True) if e.place is not None] == [[-1.0, 0.0], [0.0, -1.0]]
    assert np.count_nonzero(slopes) == 2


def test_the_rows_of_the_joints_are_linear_in_the_six_parameters() -> None:
    dae = plant()
    six = ca.vertcat(*(dae.p[[q.name for q in dae.parameters].index(name)] for name in P))
    second = ca.jacobian(ca.jacobian(dae.residual, six), six)
    rng = np.random.default_rng(2)
    value = ca.Function("second", [dae.dx, dae.x, dae.z, dae.p], [second])(
        rng.normal(size=4), rng.normal(size=4), [1.8, 1.1], dae.parameter_values()
    )
    assert np.abs(value.full()).max(initial=0.0) == 0.0


@pytest.mark.parametrize("p", [P, OTHERS])
@pytest.mark.parametrize(
    ("lambda_1", "k_0", "lambda_2", "w"), [(0.2, 0.0, 0.196, 0.5), (0.295, -0.262, 0.295, 1.0), (0.3, -0.262, 0.295, 2.0)]
)
def test_it_accelerates_as_the_minimal_coordinate_equations_say(
    lambda_1: float, k_0: float, lambda_2: float, w: float, p: dict[str, float]
) -> None:
    dae, exact, rng = plant(), truth(p), np.random.default_rng(3)
    for k, t in enumerate(np.linspace(0.0, np.pi / w, 6)):
        q, v = trajectory(lambda_1, k_0, lambda_2, w, t)
        if k % 2:
            v = rng.uniform(-3.0, 3.0, 2)
        tau = rng.uniform(-1.0, 1.0, 2)
        expected = exact(*q, *v, tau)[0].full()[:, 0]
        assert accelerations(dae, p, q, v, tau) == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_without_torque_it_keeps_its_energy() -> None:
    t = np.linspace(0.0, 2.0, 101)
    rest = {"tau_1": 0.0, "tau_2": 0.0}
    run = simulate(plant(), t, rest, initial={"joint_2.phi": 0.1, "joint_1.omega": 2.0, "joint_2.omega": -1.0})
    columns = [run.states[f"joint_{i}.{word}"] for word in ("phi", "omega") for i in (1, 2)]
    energy = [float(truth(P)(*(c[k] for c in columns), [0, 0])[1]) for k in range(0, 101, 5)]
    assert np.ptp(columns[1]) > 0.1
    assert energy == pytest.approx(np.full(21, energy[0]), rel=1e-8)


def test_torques_move_it_along_the_trajectory_they_were_made_for() -> None:
    t = np.linspace(0.0, np.pi / 2, 201)
    along = (0.3, -0.262, 0.295, 2.0)
    exact, step = truth(P), 1e-4
    torque = []
    for now in t:
        q, v = trajectory(*along, now)
        a = (trajectory(*along, now + step)[1] - trajectory(*along, now - step)[1]) / (2 * step)
        none, first, second = (exact(*q, *v, tau)[0].full()[:, 0] for tau in ([0, 0], [1, 0], [0, 1]))
        torque.append(np.linalg.solve(np.column_stack([first - none, second - none]), a - none))
    start, _ = trajectory(*along, 0.0)
    inputs = dict(zip(("tau_1", "tau_2"), np.array(torque).T, strict=True))
    run = simulate(plant(), t, inputs, initial={"joint_1.phi": start[0], "joint_2.phi": start[1]}, hold="linear")
    wanted = np.array([trajectory(*along, now)[0] for now in t]).T
    assert np.ptp(wanted, axis=1).min() > 0.5
    assert run.outputs["theta_1"] == pytest.approx(wanted[0], abs=1e-4)
    assert run.outputs["theta_2"] == pytest.approx(wanted[1], abs=1e-4)


def test_on_a_tilted_table_link_12_alone_would_hang_by_its_first_moment() -> None:
    tilt = 0.05
    dae = compile_model(five_bar().replace("world", World(tilt=tilt, direction=0.0)))
    level = plant()
    values = dae.parameter_values()
    q1, q2 = 0.4, 0.2
    t3, t4 = (float(ca.evalf(a)) for a in angles(ca.SX(q2)))
    order = {q.name: i for i, q in enumerate(dae.states)}
    x = np.zeros(4)
    x[[order["joint_1.phi"], order["joint_2.phi"]]] = q1, q2
    z = [{"joint_3.phi": t4, "joint_4.phi": t3 - q2}[s.name] for s in dae.algebraics]
    rows = [
        d.function()(np.zeros(4), x, z, [0, 0], v, [0, 0], 0)[0].full()[:, 0] for d, v in ((dae, values), (level, level.parameter_values()))
    ]
    weight = rows[0] - rows[1]
    # potential -a sum(m x): along x the first moments of links 12, 3, 4 and 56
    q = ca.SX.sym("q", 2)
    t3, t4 = angles(q[1])
    x_3 = M3 * ((L1 + L2) * ca.cos(q[0]) + R3 * ca.cos(q[0] + t4))
    x_4 = M4 * (L1 * ca.cos(q[0]) + R4 * ca.cos(q[0] + q[1]))
    x_56 = P["P_4"] * (L1 * ca.cos(q[0]) + L4 * ca.cos(q[0] + q[1])) + P["P_5"] * ca.cos(q[0] + t3)
    potential = -9.81 * np.sin(tilt) * (0.15 * ca.cos(q[0]) + x_3 + x_4 + x_56)
    expected = ca.Function("g", [q], [ca.gradient(potential, q)])([q1, q2]).full()[:, 0]
    places = [i for name in ("joint_1", "joint_2") for i, e in enumerate(dae.equations) if e.origin.endswith(f"axis of {name}")]
    assert weight[places] == pytest.approx(expected, rel=1e-9)


def test_friction_can_be_inserted_at_every_joint() -> None:
    model = five_bar()
    for i in range(1, 6):
        model = model.insert(f"joint_{i}", RotationalFriction(d=0.01 * i))
    initial = {"joint_2.phi": 0.1, "joint_1.omega": 1.0, "joint_2.omega": 0.5}
    quiet = {"tau_1": 0.0, "tau_2": 0.0}
    damped, bare = (simulate(dae, [0.0], quiet, initial=initial) for dae in (compile_model(model), plant()))
    q = [0.0, 0.1, 1.0, 0.5]
    t3, t4 = angles(theta := ca.SX.sym("theta"))
    rates = ca.Function("rates", [theta], [ca.jacobian(t3, theta), ca.jacobian(t4, theta)])(0.1)
    r3, r4 = (float(r) * 0.5 for r in rates)
    joint_rates = [1.0, 0.5, r4, r3 - 0.5, r3 - r4]
    power = -sum(0.01 * (i + 1) * rate**2 for i, rate in enumerate(joint_rates))
    lost = [damped.derivatives[f"joint_{i}.omega"][0] - bare.derivatives[f"joint_{i}.omega"][0] for i in (1, 2)]
    f1, f2, f3 = (float(ca.Function("f", [theta], [f])(q[1])) for f in kinetic_energy(P, theta))
    momenta = [2 * f1 * 1.0 + f3 * 0.5, 2 * f2 * 0.5 + f3 * 1.0]
    assert np.dot(momenta, lost) == pytest.approx(power, rel=1e-9)  # d/dt of the kinetic energy at given q, v


def test_a_residual_at_a_link_is_refused_in_favour_of_its_joint() -> None:
    with pytest.raises(ModelError, match=r"place 'link_4.phi' has no residual of its own: it moves with 'joint_2'"):
        compile_model(five_bar(), places=["link_4.phi"])
