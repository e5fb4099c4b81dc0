"""How large the forces are along trajectories."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from examples import soft_drive

from backsight.estimation import Problem, Recording, smooth
from backsight.estimation.smoothing.along import along, forces, shown_of_ways, times_within
from backsight.estimation.smoothing.begun import followed_by
from backsight.estimation.smoothing.horizons import output_stds
from backsight.estimation.smoothing.meshing import follow_closely
from backsight.models import Model
from backsight.models.mechanics.rotational import AngleSensor, Inertia, Rack, Torque
from backsight.models.mechanics.translational import Mass, PositionSensor, SpringDamper
from backsight.models.plants import actuator, quadrotor

A, OMEGA, M, D = 0.1, 2 * np.pi, 95.0, 200.0


def followed(mass: float):
    """An axis that swings A sin(omega t), sampled without noise."""
    t = np.linspace(0.0, 4.0, 2001)
    recording = Recording(name="swing", time=t, inputs={"F": 0.0 * t}, outputs={"x": A * np.sin(OMEGA * t)}, output_std={"x": 1e-6})
    given = {"carriage.m": mass, "friction.d": D, "friction.f_c": 0.0, "offset.f": 0.0}
    problem = Problem(model=actuator(), recordings=[recording], parameters=given)
    stds, _ = output_stds(problem)
    return problem, follow_closely(problem, stds, None)


def two_encoders(t: np.ndarray, phi: dict[str, np.ndarray], std: dict[str, float]):
    """A motor and a load with a soft shaft between them and an encoder at either, that move so."""
    drive = soft_drive()
    connections = (*drive.connections, ("far.flange", "load.flange"))
    outputs = {"phi_1": "encoder.phi", "phi_2": "far.phi"}
    model = replace(drive, components={**drive.components, "far": AngleSensor()}, connections=connections, outputs=outputs)
    output_std = {name: std[name] for name in phi}
    recording = Recording(name="swing", time=t, inputs={"tau": 0.0 * t}, outputs=phi, output_std=output_std)
    problem = Problem(model=model, recordings=[recording])
    return problem, follow_closely(problem, output_stds(problem)[0], None)


@pytest.mark.parametrize("mass", [M, 1.0])
def test_the_largest_term_of_a_balance_counts(mass):
    problem, trajectories = followed(mass)
    inertia, drag = mass * A * OMEGA**2 / np.sqrt(2), D * A * OMEGA / np.sqrt(2)
    assert forces(problem, trajectories, problem.values)[0] == pytest.approx(max(inertia, drag), rel=0.01)


def test_of_what_varies_the_mean_is_no_part():
    problem, trajectories = followed(M)
    inertia = M * A * OMEGA**2 / np.sqrt(2)
    assert forces(problem, trajectories, problem.values, varying=True)[0] == pytest.approx(inertia, rel=0.01)
    hung = problem.values.copy()
    hung[[p.name for p in problem.dae.parameters].index("offset.f")] = 5 * inertia
    assert forces(problem, trajectories, hung)[0] == pytest.approx(5 * inertia, rel=0.01)
    assert forces(problem, trajectories, hung, varying=True)[0] == pytest.approx(inertia, rel=0.01)


def test_short_pieces_count_as_long_as_they_are():
    horizons = [SimpleNamespace(time=np.array([0.0, end])) for end in (10.0, 0.1, 5.0)]
    times = times_within(horizons, 100)  # type: ignore[arg-type]
    assert [len(t) for t in times] == [100, 1, 50]
    assert all(t[0] > 0.0 and t[-1] < h.time[-1] for t, h in zip(times, horizons, strict=True))


def test_an_expression_is_evaluated_along_the_trajectory():
    problem, trajectories = followed(M)
    times = np.linspace(0.5, 3.5, 50)
    v = along(problem.dae, problem.dae.x[1], trajectories, 0, times, problem.values)
    np.testing.assert_allclose(v[0], A * OMEGA * np.cos(OMEGA * times), atol=1e-3 * A * OMEGA)


@pytest.mark.parametrize("sampled", [True, False])
def test_of_a_way_the_sensor_that_moves_most_in_its_deviations_shows_most(sampled):
    """Two bodies that swing against each other; the second moves half as far as the first, and is sampled ten times better, or not."""
    t = np.linspace(0.0, 2.0, 2001)
    phi = {"phi_1": 0.02 * np.sin(OMEGA * t), "phi_2": -0.01 * np.sin(OMEGA * t)}
    phi = phi if sampled else {"phi_1": phi["phi_1"]}
    std = {"phi_1": 1e-5, "phi_2": 1e-6}
    problem, trajectories = two_encoders(t, phi, std)
    shown = shown_of_ways(problem.dae, "motor.omega", trajectories, problem.values)
    assert shown == pytest.approx(0.5 / 1e-6 if sampled else 1.0 / 1e-5, rel=0.01)


def test_a_sensor_of_another_body_shows_nothing_of_a_way():
    """The second body swings ten times as far as the first, at another pace, and is sampled as well."""
    t = np.linspace(0.0, 4.0, 4001)
    phi = {"phi_1": 0.002 * np.sin(OMEGA * t), "phi_2": 0.02 * np.sin(3 * OMEGA * t)}
    problem, trajectories = two_encoders(t, phi, dict.fromkeys(phi, 1e-6))
    assert shown_of_ways(problem.dae, "motor.omega", trajectories, problem.values) == pytest.approx(1e6, rel=0.01)


@pytest.mark.parametrize("turned", [0.0, 100.0])
def test_a_shaft_that_turns_bears_its_twist_and_not_its_angle(turned):
    """Two bodies that swing against each other, a hundred radians from where they began or not."""
    t = np.linspace(0.0, 2.0, 2001)
    phi = {"phi_1": turned + 0.02 * np.sin(OMEGA * t), "phi_2": turned - 0.01 * np.sin(OMEGA * t)}
    problem, trajectories = two_encoders(t, phi, dict.fromkeys(phi, 1e-6))
    sizes = forces(problem, trajectories, problem.values)
    assert list(sizes.values()) == pytest.approx([40.0 * 0.03 / np.sqrt(2)] * 2, rel=0.01)  # k times the twist


@pytest.mark.parametrize("turned", [0.0, 100.0])
def test_a_belt_behind_a_wheel_bears_what_it_is_stretched_and_not_its_stiffness_times_where_the_wheel_is(turned):
    """The wheel's radius stands in the belt's force beside an angle that says nothing of it."""
    t, r, k, far = np.linspace(0.0, 2.0, 2001), 0.02, 5e4, 1e-4
    swing = np.sin(OMEGA * t)
    motion = {"phi": turned + 0.5 * swing, "s": r * (turned + 0.5 * swing) - far * swing}
    recording = Recording(name="swing", time=t, inputs={"tau": 0.0 * t}, outputs=motion, output_std={"phi": 1e-7, "s": 1e-9})
    model = Model(
        name="belt",
        components={
            "source": Torque(), "motor": Inertia(J=1e-6), "wheel": Rack(r=r), "belt": SpringDamper(k=k, d=0.0), "mass": Mass(m=1e-3),
            "encoder": AngleSensor(), "scale": PositionSensor(),
        },
        connections=[
            ("source.flange", "motor.flange"), ("motor.flange", "encoder.flange"), ("motor.flange", "wheel.wheel"),
            ("wheel.rack", "belt.flange_a"), ("belt.flange_b", "mass.flange"), ("mass.flange", "scale.flange"),
        ],
        inputs={"tau": "source.tau"},
        outputs={"phi": "encoder.phi", "s": "scale.s"},
    )  # fmt: skip
    problem = Problem(model=model, recordings=[recording])
    followed = follow_closely(problem, output_stds(problem)[0], None)
    for how in ({"taut": True}, {"borne": True}, {"net": True}):
        sizes = forces(problem, followed, problem.values, **how)
        assert list(sizes.values()) == pytest.approx([r * k * far / np.sqrt(2), k * far / np.sqrt(2)], rel=0.01)


def test_net_forces_are_without_those_that_cancel():
    """Four rotors carry 15 N, each at an arm of .3 m; what turns the body is what it is turned by, and nothing of these."""
    t, swing = np.linspace(0.0, 1.0, 101), 0.1
    still = np.zeros(len(t))
    outputs = {"ax": still, "ay": still, "az": still - 9.81, "p": swing * np.sin(OMEGA * t), "q": still, "r": still}
    inputs = {f"u_{k}": np.full(len(t), 0.7) for k in range(1, 5)}
    recording = Recording(name="hover", time=t, inputs=inputs, outputs=outputs, output_std=dict.fromkeys(outputs, 1e-3))
    problem = Problem(model=quadrotor(), recordings=[recording], parameters={"rotor.gain": float(np.sqrt(1.5 * 9.81 / 4) / 0.7)})
    solution = smooth(problem).solution
    assert solution is not None
    p = solution.parameters
    inertia = p[[q.name for q in problem.dae.parameters].index("body.Ixx")]
    names = [problem.dae.places[k].name for k in solution.transcription.soft]
    whole, net = (dict(zip(names, forces(problem.posed, followed_by(solution), p, net=net).values(), strict=True)) for net in (False, True))
    assert net["body.tau_x"] == pytest.approx(inertia * swing * OMEGA / np.sqrt(2), rel=0.1)
    assert whole["body.tau_x"] > 10 * net["body.tau_x"]
    assert net["rotor_1"] > 1.0
