"""A Gaussian of state and parameters through stages, samples and switches, against dense Gaussians and samples."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from backsight.data.generators.drillstring import Drillstring
from backsight.models import compile_model
from backsight.models.plants import drillstring
from backsight.models.simulation.phases import Phases
from backsight.ocp.moving.belief import Belief, Flow
from backsight.ocp.moving.stage import Stage

H, TORQUE, NOISE, VOLTAGE = 0.05, 0.02, 1e-3, 15.0
FREE = ("string.k", "bit.tau_sl")


def flow(phase: int, free: tuple[str, ...] = ()) -> Flow:
    dae = compile_model(drillstring())
    names, values = [p.name for p in dae.parameters], np.array([p.value for p in dae.parameters])
    within = Phases(dae, values).within([phase])
    soft = tuple(k for k, place in enumerate(dae.places) if place.name == "bha")
    indices = tuple(sorted(names.index(name) for name in free))
    stage = Stage(within.dae, indices, values, soft, 2)
    return Flow(stage, within.margins, np.tile([-np.inf, np.inf], (len(free), 1)), np.array([TORQUE]) / np.sqrt(H))


def stages(count: int, outputs: int) -> list[np.ndarray]:
    none = np.zeros(outputs)
    return [np.concatenate([[H / count, k * H / count, VOLTAGE, VOLTAGE], none, [1 / TORQUE], none]) for k in range(count)]


def moved(flow: Flow, belief: Belief, count: int = 16) -> Belief:
    for d in stages(count, flow.stage.dae.output.shape[0]):
        belief = flow.over(belief, d)
    return belief


def spread(seed: int, n: int) -> Belief:
    rng = np.random.default_rng(seed)
    scale = np.array([0.05, 0.1, 0.5, 0.3, 0.005, 0.02])[:n]
    mean = np.array([0.4, 1.3, 5.0, 3.0, 0.0868, 0.4])[:n]
    return Belief(mean=mean, root=np.tril(rng.normal(size=(n, n))) * scale[:, None])


def test_a_linear_phase_is_the_dense_kalman_filter() -> None:
    string, belief = Drillstring(), spread(1, 4)
    A, b = string.sliding, string.drive(1, VOLTAGE, np.zeros(3))
    E = expm(H * np.block([[A, b[:, None]], [np.zeros((1, 5))]]))
    G, Q = np.array([0, 0, 0, 1 / string.J_b]), np.zeros((4, 4))
    for s in (np.arange(400) + 0.5) * H / 400:
        column = expm(A * s) @ G * TORQUE
        Q += np.outer(column, column) * H / 400
    mean, P = E[:4, :4] @ belief.mean + E[:4, 4], E[:4, :4] @ belief.root @ belief.root.T @ E[:4, :4].T + Q
    found = moved(flow(1), belief)
    assert found.mean == pytest.approx(mean, rel=1e-5)
    assert found.root @ found.root.T == pytest.approx(P, rel=1e-4, abs=1e-7)

    outputs = flow(1).stage.dae.output.shape[0]
    newest = np.concatenate([[H, VOLTAGE], np.full(outputs, 0.41), [1 / NOISE] + [0.0] * (outputs - 1)])
    after, likelihood = flow(1).sampled(found, newest)
    S = P[0, 0] + NOISE**2
    K = P[:, 0] / S
    assert after.mean == pytest.approx(mean + K * (0.41 - mean[0]), rel=1e-5)
    assert after.root @ after.root.T == pytest.approx(P - np.outer(K, P[0]), rel=1e-3, abs=1e-7)
    assert likelihood == pytest.approx(-0.5 * (0.41 - mean[0]) ** 2 / S - 0.5 * np.log(S / NOISE**2), rel=1e-3)


def test_parameters_come_along_with_the_derivatives_of_the_course() -> None:
    own, belief = flow(1, FREE), spread(2, 6)
    small = Belief(mean=belief.mean, root=1e-3 * belief.root)
    found, string = moved(own, small), Drillstring()

    def end(y: np.ndarray) -> np.ndarray:
        other = Drillstring(k=float(y[4]), tau_sl=float(y[5]))
        E = expm(H * np.block([[other.sliding, other.drive(1, VOLTAGE, np.zeros(3))[:, None]], [np.zeros((1, 5))]]))
        return np.concatenate([E[:4, :4] @ y[:4] + E[:4, 4], y[4:]])

    Phi = np.column_stack([(end(small.mean + 1e-5 * e) - end(small.mean - 1e-5 * e)) / 2e-5 for e in np.eye(6)])
    quiet = Phi @ small.root @ small.root.T @ Phi.T
    noisy = found.root @ found.root.T
    assert found.mean == pytest.approx(end(small.mean), rel=1e-5)
    assert noisy[2:3, 4:] == pytest.approx(quiet[2:3, 4:], rel=1e-4)
    assert noisy[3, 3] == pytest.approx(quiet[3, 3] + TORQUE**2 * H / string.J_b**2, rel=1e-2)


def test_what_is_reshaped_along_one_direction_goes_on_elsewhere_by_regression() -> None:
    belief, J = spread(3, 4), np.array([0.3, -1.0, 0.2, 0.5])
    P = belief.root @ belief.root.T
    found = belief.reshaped(J, 0.7, 0.25)
    Q, s = found.root @ found.root.T, float(J @ P @ J)
    assert J @ (found.mean - belief.mean) == pytest.approx(0.7)
    across = Q @ J
    assert float(across @ J) == pytest.approx(0.0625 * s)
    # what is independent of J x stays as it was: the conditional mean and variance of all given J x
    assert across / float(across @ J) == pytest.approx(P @ J / s)
    assert Q - np.outer(across, across) / float(across @ J) == pytest.approx(P - np.outer(P @ J, P @ J) / s, abs=1e-12)


def test_a_switch_at_an_uncertain_instant_spreads_as_samples_do() -> None:
    """A body of -8 m/s2 that stops where its velocity is zero: where it comes to rest, from the state at the mean instant."""
    rng, deceleration = np.random.default_rng(4), -8.0
    mean, P = np.array([1.0, 0.0]), np.array([[0.04, 0.006], [0.006, 0.01]])
    x = rng.multivariate_normal(mean, P, size=200000)
    rests = x[:, 0] - 0.5 * x[:, 1] ** 2 / deceleration
    belief = Belief(mean=mean, root=np.linalg.cholesky(P))
    found = belief.switched(np.array([0.0, -deceleration]), np.array([0.0, 1.0]), deceleration)
    assert found.std[1] == pytest.approx(0.0, abs=1e-12)
    assert found.std[0] == pytest.approx(np.std(rests), rel=0.02)


def test_margins_know_how_far_residual_forces_move_them() -> None:
    """A stuck bit: the torque of the string over the range of the law, and the mean torque over a sample that adds to it."""
    here = flow(0).at(Belief(mean=np.array([0.1, 1.3, 5.0, 0.0]), root=np.diag([0.0, 0.0, 0.2, 0.0])), np.array([VOLTAGE]), 0.0)
    assert here.g * 1.2 == pytest.approx([0.6 - 0.434, 0.6 + 0.434], rel=1e-4)
    assert here.std * 1.2 == pytest.approx([0.0868 * 0.2] * 2, rel=1e-4)
    assert here.noise * 1.2 == pytest.approx([TORQUE / np.sqrt(H)] * 2, rel=1e-4)
    assert here.rate[3] == pytest.approx(0.0, abs=1e-12)
