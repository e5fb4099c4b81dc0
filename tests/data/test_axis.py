"""The generator of the bundled recordings against closed forms and balances, and the bundled files against the generator."""

import ast
import gzip
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.signal import savgol_filter

import backsight.data
from backsight.data.generators import axis
from backsight.data.generators.run import Run
from backsight.data.generators.servo import Encoder, Servo, Tracking
from backsight.data.generators.sliding import Body, Motion, advance, respond

BODY = Body(m=95.0, d=200.0, f_c=20.0)


@pytest.fixture(scope="module")
def fit() -> Run:
    return axis.record("axis_fit")


def test_without_coulomb_friction_the_motion_is_the_exponential_of_the_textbook() -> None:
    force, v0, t = 60.0, -0.4, 0.7
    body = Body(m=95.0, d=200.0, f_c=0.0)
    tau, v_end = body.m / body.d, force / body.d
    moved = advance(body, Motion(x=0.1, v=v0), force, t)
    assert moved.v == pytest.approx(v_end + (v0 - v_end) * np.exp(-t / tau), rel=1e-9)
    assert moved.x == pytest.approx(0.1 + v_end * t + (v0 - v_end) * tau * (1 - np.exp(-t / tau)), rel=1e-9)


def test_the_terminal_velocity_balances_force_and_friction() -> None:
    for force in (50.0, -50.0):
        settled = advance(BODY, Motion(), force, 20.0)
        assert force - BODY.f_c * np.sign(force) == pytest.approx(BODY.d * settled.v, rel=1e-9)


def test_a_coasting_body_stops_after_the_distance_of_the_closed_form_and_stays() -> None:
    v0, tau = 0.3, BODY.m / BODY.d
    distance = tau * (v0 - BODY.f_c / BODY.d * np.log1p(BODY.d * v0 / BODY.f_c))
    stopped = advance(BODY, Motion(v=v0), 0.0, 5.0)
    assert stopped.v == 0.0
    assert stopped.x == pytest.approx(distance, rel=1e-9)
    x, v = respond(BODY, np.zeros(5_000), 1e-3, Motion(v=v0))
    assert x[-1] == pytest.approx(distance, rel=1e-9), "the stop does not depend on the sampling"
    assert not v[-1]


def test_a_resting_body_does_not_move_until_the_force_exceeds_the_coulomb_friction() -> None:
    assert advance(BODY, Motion(x=0.2), 0.999 * BODY.f_c, 10.0) == Motion(x=0.2, v=0.0)
    assert advance(BODY, Motion(x=0.2), -BODY.f_c, 10.0) == Motion(x=0.2, v=0.0)
    assert advance(BODY, Motion(x=0.2), 1.001 * BODY.f_c, 10.0).v > 0
    assert advance(BODY, Motion(x=0.2), -1.001 * BODY.f_c, 10.0).v < 0


def test_a_reversal_within_one_sample_joins_two_closed_forms() -> None:
    v0, force, h = 0.01, -120.0, 0.05
    tau, (down, up) = BODY.m / BODY.d, ((force - BODY.f_c) / BODY.d, (force + BODY.f_c) / BODY.d)
    t_stop = tau * np.log(1 - v0 / down)
    x_stop = down * t_stop + (v0 - down) * tau * (1 - np.exp(-t_stop / tau))
    rest = h - t_stop
    reversed_ = advance(BODY, Motion(v=v0), force, h)
    assert 0 < t_stop < h
    assert reversed_.v == pytest.approx(up * (1 - np.exp(-rest / tau)), rel=1e-9)
    assert reversed_.x == pytest.approx(x_stop + up * (rest - tau * (1 - np.exp(-rest / tau))), rel=1e-8)


def test_the_work_of_the_force_is_kinetic_energy_and_friction_heat() -> None:
    h, n = 1e-3, 4_000
    t = np.arange(n) * h
    forces = 150.0 * np.sin(2 * np.pi * 1.3 * t) + 40.0 * np.sin(2 * np.pi * 3.1 * t + 1)
    x, v = respond(BODY, forces, h, Motion())
    work = forces @ np.diff(x)
    path = np.abs(np.diff(x)).sum()  # misses only the way there and back inside the few samples of a reversal
    viscous = BODY.d * h * ((v[1:] ** 2 + v[1:] * v[:-1] + v[:-1] ** 2) / 3).sum()
    energy = 0.5 * BODY.m * v[-1] ** 2
    assert (np.diff(np.sign(v)) != 0).sum() >= 8, "a record without reversals would prove little"
    assert energy + BODY.f_c * path + viscous == pytest.approx(work, rel=2e-6)


def test_the_encoder_reads_whole_steps_within_half_a_step() -> None:
    readings = np.array([Encoder(resolution=1e-6, noise_std=0.0).read(x, 5.0) for x in np.linspace(-1e-4, 1e-4, 977)])
    assert np.abs(readings - np.linspace(-1e-4, 1e-4, 977)).max() <= 0.5e-6 + 1e-12
    assert np.allclose(readings / 1e-6, np.round(readings / 1e-6), atol=1e-6)


def test_the_servo_holds_its_force_limit_and_settles_on_a_ramp() -> None:
    servo = Servo(k_p=1e5, k_d=1e3, lag=0.004, limit=50.0, resolution=0.01, step=1e-3)
    assert servo.command(Tracking(reading=0.0), 0.0, 1.0, 0.0)[0] == 50.0
    assert servo.command(Tracking(reading=0.0), 0.0, -1.0, 0.0)[0] == -50.0
    tracking = Tracking(reading=0.0)
    for k in range(1, 200):
        force, tracking = servo.command(tracking, 0.2e-3 * k, 0.2e-3 * k, 0.2)
    assert tracking.velocity == pytest.approx(0.2, rel=1e-9)
    assert abs(force) <= servo.resolution


def test_the_recorded_reading_is_the_position_with_noise_of_one_micrometre(fit: Run) -> None:
    noise = fit.outputs["x"] - fit.truth["carriage.s"]
    assert noise.std() == pytest.approx(np.sqrt(1 + 1 / 12) * 1e-6, rel=0.03)
    assert abs(noise.mean()) < 5e-8
    assert np.abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.03


def test_the_record_reverses_often_at_several_speeds_and_hardly_rests(fit: Run) -> None:
    moving = fit.truth["carriage.v"][fit.truth["carriage.v"] != 0]
    assert (np.diff(np.sign(moving)) != 0).sum() >= 19
    assert all(np.any(np.abs(np.abs(fit.truth["carriage.v"]) - speed) < 0.1 * speed) for speed in (0.02, 0.06, 0.12, 0.25, 0.40))
    assert 0 < (fit.truth["carriage.v"] == 0).sum() < 100
    assert np.abs(fit.inputs["F"]).max() <= axis.SERVO.limit


@pytest.mark.parametrize("name", ["axis_fit.csv.gz", "axis_held_out.csv.gz"])
def test_a_least_squares_on_the_bundled_file_finds_all_four_values_within_one_percent(name: str) -> None:
    """Smoothed derivatives, reversals left out, impulses over 25 ms: the classical method, with none of the generator's code."""
    table = pd.read_csv(backsight.data.path(name))
    x, force, h, block = table["x_m"].to_numpy(), table["F_N"].to_numpy(), 1e-3, 25
    # 7 ms windows keep the corners of the bang-bang motion sharp; the impulse form does without the acceleration.
    v = savgol_filter(x, 7, 2, deriv=1, delta=h)
    # F acts from its row to the next one: the sums below run over whole holding intervals.
    rows = np.arange(block, len(x) - 2 * block, block)
    one_way = np.array([abs(np.sign(v[i - 5 : i + block + 5]).sum()) == block + 10 and np.abs(v[i : i + block]).min() > 2e-3 for i in rows])
    rows = rows[one_way]
    momentum, way = v[rows + block] - v[rows], x[rows + block] - x[rows]
    matrix = np.column_stack([momentum, way, np.sign(way) * block * h, np.full(rows.size, block * h)])
    impulse = np.array([force[i : i + block].sum() * h for i in rows])
    found = np.linalg.lstsq(matrix, impulse, rcond=None)[0]
    assert found == pytest.approx([95.0, 200.0, 20.0, -3.0], rel=0.01)


@pytest.mark.slow
def test_the_same_seed_writes_the_same_bytes_as_the_bundled_file(fit: Run) -> None:
    bundled = backsight.data.path("axis_fit.csv.gz").read_bytes()
    # Compressors differ between builds of zlib, the text does not.
    assert gzip.decompress(axis.compressed(fit)) == gzip.decompress(bundled)
    assert axis.compressed(fit) == axis.compressed(axis.record("axis_fit"))
    assert bundled[4:8] == b"\0\0\0\0", "a date in the header would change the bytes"


@pytest.mark.slow
def test_the_bundled_held_out_file_and_card_are_what_the_generator_writes(tmp_path: Path) -> None:
    for written in axis.write(tmp_path):
        old, new = backsight.data.path(written.name).read_bytes(), written.read_bytes()
        assert (gzip.decompress(old) == gzip.decompress(new)) if written.suffix == ".gz" else (old == new)
        assert len(old) < 300_000


def test_another_seed_makes_another_record_of_the_same_machine(fit: Run) -> None:
    other = axis.record("axis_fit", seed=1, samples=200)
    assert not np.array_equal(other.outputs["x"], fit.outputs["x"][:200])


def test_the_generator_shares_no_code_with_the_project() -> None:
    for file in Path(axis.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            modules = (
                [a.name for a in node.names]
                if isinstance(node, ast.Import)
                else [node.module or ""]
                if isinstance(node, ast.ImportFrom)
                else []
            )
            assert not any("backsight" in m or "casadi" in m for m in modules), file
            assert not (isinstance(node, ast.ImportFrom) and node.level > 1), file


def test_a_file_that_is_not_bundled_is_refused_with_the_list_of_those_that_are() -> None:
    with pytest.raises(FileNotFoundError, match="axis_fit"):
        backsight.data.path("axis_fitt.csv.gz")
    with pytest.raises(FileNotFoundError):
        backsight.data.path("../pyproject.toml")
