"""Lags and delays of signals against SciPy's integrator and against shifts; faults without strength, and with it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from backsight.estimation.diagnosis.candidates.channels import lagged, late, of_alike, of_input, of_sensor
from backsight.estimation.diagnosis.candidates.places import source
from backsight.models import compile_model
from backsight.models.plants import PLANTS, actuator, five_bar
from backsight.models.signals import Lag

EVEN = 0.01 * np.arange(200)
UNEVEN = np.cumsum(0.01 * (1 + 0.6 * np.sin(np.arange(200.0) ** 2)))
CLOCKS = pytest.mark.parametrize("time", [EVEN, UNEVEN], ids=["even", "uneven"])


def wave(t: np.ndarray) -> np.ndarray:
    return 3.0 + np.sin(4.0 * t) + 0.4 * np.cos(9.0 * t)


def steps(time: np.ndarray) -> np.ndarray:
    return np.diff(time, append=2 * time[-1] - time[-2])


@CLOCKS
@pytest.mark.parametrize("tau", [0.003, 0.05])
def test_a_held_input_that_lags_has_the_mean_that_an_integrator_finds(time, tau):
    values, y, means = wave(time) + np.sign(np.sin(7 * time)), None, []
    for u, h in zip(values, steps(time), strict=True):
        y = values[0] if y is None else y
        done = solve_ivp(lambda _, s, u=u: [(u - s[0]) / tau, s[0]], (0.0, h), [y, 0.0], rtol=1e-10, atol=1e-12)
        y, area = done.y[:, -1]
        means.append(area / h)
    assert lagged(time, values, tau) == pytest.approx(np.array(means), abs=1e-6)


@CLOCKS
def test_a_reading_that_lags_follows_what_it_reads(time):
    tau = 0.04
    done = solve_ivp(lambda t, y: (wave(t) - y) / tau, (time[0], time[-1]), [wave(time[0])], t_eval=time, rtol=1e-9, atol=1e-11)
    assert lagged(time, wave(time), tau, held=False) == pytest.approx(done.y[0], abs=5e-3)  # held, it would be 3e-2 off


@CLOCKS
@pytest.mark.parametrize("delay", [0.002, 0.0137, 0.05])
def test_a_held_input_that_is_late_has_the_mean_of_what_was_held_then(time, delay):
    values = wave(time) + np.sign(np.sin(7 * time))

    def held(t: float) -> float:
        return float(values[max(np.searchsorted(time, t, side="right") - 1, 0)])

    for k in (0, 1, 5, 77, 198):
        h = steps(time)[k]
        jumps = [t for t in time + delay if time[k] < t < time[k] + h]
        mean = quad(lambda t: held(t - delay), time[k], time[k] + h, points=jumps or None)[0] / h
        assert late(time, values, delay)[k] == pytest.approx(mean, abs=1e-6)


@CLOCKS
def test_a_reading_that_is_late_is_an_earlier_one(time):
    found = late(time, wave(time), 0.03, held=False)
    assert found[10:] == pytest.approx(wave(time[10:] - 0.03), abs=3e-3)
    assert found[0] == wave(time[0])


def test_a_delay_of_whole_rows_is_a_shift():
    values = np.random.default_rng(0).standard_normal(200)
    for held in (True, False):
        assert late(EVEN, values, 0.03, held)[3:] == pytest.approx(values[:-3])
        assert late(EVEN, values, 0.03, held)[:3] == pytest.approx(values[0])


@pytest.mark.slow
@pytest.mark.parametrize(("plant", "signal", "other"), [(actuator, "F", "x"), (five_bar, "tau_1", "theta_1")])
def test_faults_without_strength_change_nothing_and_with_it_what_their_name_says(plant, signal, other):
    model = plant()
    base = compile_model(model)
    rng = np.random.default_rng(0)
    at = [rng.standard_normal(n) / 3 for n in (base.dx.shape[0], base.x.shape[0], base.z.shape[0], base.u.shape[0])]
    p, w, t = np.array(base.parameter_values()), np.zeros(base.w.shape[0]), 0.7
    u = [q.name for q in base.inputs].index(signal)
    y = [q.name for q in base.outputs].index(other)

    def told(dae, values, inputs):
        known = dict(zip((q.name for q in base.parameters), p, strict=True)) | values
        full = [known.get(q.name, q.value) for q in dae.parameters]
        return [np.asarray(part).ravel() for part in dae.function()(*at[:3], inputs, full, w, t)]

    plain = told(base, {}, at[3])
    faults = [*of_input(model, signal, [EVEN], 0.01, 2.0), *of_sensor(model, other, [], 0.01, 2.0)]
    assert {c.physics for c in faults if not c.strengths} == {
        "input_lag", "input_delay", "input_saturation", "input_dead_zone", "sensor_lag", "sensor_delay",
    }  # fmt: skip
    for c in faults:
        if not c.strengths:
            assert c.signals
            continue
        dae = compile_model(c.edited(model))
        for a, b in zip(told(dae, {}, at[3]), plain, strict=True):
            assert a == pytest.approx(b, abs=1e-12), c.title
        residual, output = told(dae, {c.strengths[0]: 0.3}, at[3])
        expected = {"input_gain": 0.3 * at[3][u], "input_offset": at[3][u] + 0.3}.get(c.physics)
        if expected is not None:
            moved = at[3].copy()
            moved[u] = expected
            assert residual == pytest.approx(told(base, {}, moved)[0], abs=1e-12)
        else:
            right = {"sensor_gain": 0.3 * plain[1][y], "sensor_bias": plain[1][y] + 0.3, "sensor_drift": plain[1][y] + 0.3 * t}[c.physics]
            assert output[y] == pytest.approx(right)
            assert residual == pytest.approx(plain[0])


def test_an_input_that_is_nothing_has_no_faults():
    assert of_input(actuator(), "F", [np.zeros(5)], 0.01, 1.0) == []


def test_a_turned_sensor_reads_a_part_of_the_other_one():
    model = five_bar()
    c = next(c for c in of_sensor(model, "theta_1", ["theta_2"], 0.01, 1.0) if c.physics == "sensor_misalignment")
    base, dae = compile_model(model), compile_model(c.edited(model))
    rng = np.random.default_rng(0)
    at = [rng.standard_normal(n) for n in (base.dx.shape[0], base.x.shape[0], base.z.shape[0], base.u.shape[0])]
    w = np.zeros(base.w.shape[0])
    _, plain = base.function()(*at, base.parameter_values(), w, 0.0)
    _, same = dae.function()(*at, dae.parameter_values(), w, 0.0)
    _, turned = dae.function()(*at, dae.parameter_values({c.strengths[0]: 0.2}), w, 0.0)
    assert np.asarray(same) == pytest.approx(np.asarray(plain))
    assert float(turned[0]) == pytest.approx(float(plain[0]) + 0.2 * float(plain[1]))
    assert float(turned[1]) == pytest.approx(float(plain[1]))


def test_two_sensors_that_are_turned_together_read_one_vector_in_turned_axes():
    model, angle = PLANTS["xy_table"](), 0.2
    faults = [c for c in of_sensor(model, "ax_r", ["ay_r"], 0.01, 1.0) if c.physics == "sensor_misalignment"]
    c = faults[1]
    assert not any("angle" in path for c in of_sensor(model, "ay_r", ["ax_r"], 0.01, 1.0) for path in c.strengths)  # once for the two
    base, dae = compile_model(model), compile_model(c.edited(model))
    rng, first = np.random.default_rng(0), [q.name for q in base.outputs].index("ax_r")
    at = [rng.standard_normal(n) for n in (base.dx.shape[0], base.x.shape[0], base.z.shape[0], base.u.shape[0])]
    w = np.zeros(base.w.shape[0])
    _, plain = (np.asarray(y).ravel() for y in base.function()(*at, base.parameter_values(), w, 0.0))
    _, turned = (np.asarray(y).ravel() for y in dae.function()(*at, dae.parameter_values({c.strengths[0]: angle}), w, 0.0))
    second = [q.name for q in base.outputs].index("ay_r")
    read = complex(turned[first], turned[second])
    assert read == pytest.approx(complex(plain[first], plain[second]) * np.exp(-1j * angle))
    others = [k for k in range(len(plain)) if k not in (first, second)]
    assert turned[others] == pytest.approx(plain[others])


def test_a_sensor_comes_of_its_component_whatever_blocks_are_between():
    model = PLANTS["xy_table"]()
    read = model.measured["ax_r"].variable
    owner = read.partition(".")[0]
    assert source(model, read) == owner
    c = next(c for c in of_sensor(model, "ax_r", ["ay_r"], 0.01, 1.0) if any("angle" in path for path in c.strengths))
    edited = c.edited(model).insert("sensor:ay_r", Lag(tau=0.1), "slow")
    assert edited.measured["ay_r"].variable.partition(".")[0] == "slow"
    assert [source(edited, edited.measured[name].variable) for name in ("ax_r", "ay_r")] == [owner, owner]


def test_saturation_and_dead_zone_are_looked_at_as_they_are():
    faults = {c.physics: c for c in of_input(actuator(), "F", [np.array([-4.0, 1.0, 0.1, 3.0])], 0.01, 1.0)}
    u = np.array([-4.0, 1.0, 0.1, 3.0])
    half = next(s for s in faults["input_saturation"].signals if next(iter(s.start.values())) == 2.0)
    assert half.changed(EVEN[:4], u).tolist() == [-2.0, 1.0, 0.1, 2.0]
    zone = faults["input_dead_zone"].signals[-1]
    (width,) = zone.start.values()
    assert zone.changed(EVEN[:4], u) == pytest.approx(np.sign(u) * np.maximum(np.abs(u) - width, 0.0))


def test_inputs_of_parts_of_one_kind_may_be_late_together():
    model = PLANTS["quadrotor"]()
    lag, delay = of_alike(model, ["u_1", "u_2", "u_3", "u_4"], 0.01, 10.0)
    assert (lag.physics, delay.physics, lag.place) == ("input_lag", "input_delay", "input:u_1")
    assert delay.size == 1
    for c, block in ((lag, "lag"), (delay, "delay")):
        edited = c.edited(model)
        (path,) = c.start
        assert [edited.bindings[f"input_{block}_u_{i}.{path.rpartition('.')[2]}"] for i in (1, 2, 3, 4)] == [path] * 4
        assert path in {p.name for p in compile_model(edited).parameters}
        assert all(s.of == tuple(f"input:u_{i}" for i in (1, 2, 3, 4)) for s in c.signals)
        assert c.unit(model, path, {}) == "s"
        left = of_alike(edited, ["u_1", "u_2", "u_3", "u_4"], 0.01, 10.0)
        assert c.physics not in {o.physics for o in left}


def test_an_angle_may_be_read_from_a_disk_that_is_not_centred():
    model = PLANTS["five_bar"]()
    found = {c.physics: c for c in of_sensor(model, "theta_1", [], 0.01, 10.0, span=1.0)}
    c = found["eccentricity"]
    assert (c.place, c.family) == ("sensor:theta_1", "sensor")
    assert {*c.strengths, c.quadrature} <= {p.name for p in compile_model(c.edited(model)).parameters}
    assert "eccentricity" not in {c.physics for c in of_sensor(model, "theta_1", [], 0.01, 10.0)}
    _, low, high = c.start[c.strengths[0]]
    assert -low == high < 0.5  # rad: what turns to and fro by as much is no disk that is hardly off


def test_an_angle_may_be_read_over_teeth_that_are_uneven_where_half_a_wave_of_them_was_seen():
    model = PLANTS["five_bar"]()
    found = [c for c in of_sensor(model, "theta_1", [], 0.01, 10.0, span=1.1) if c.physics == "kinematic_error"]
    assert len(found) == 6  # three a turn .. eight
    assert len({edit.words for c in found for edit in c.edits}) == len(found)  # what is kept of their fits is told apart
    c = found[0]
    dae = compile_model(c.edited(model))
    values = {p.name: p.value for p in dae.parameters}
    assert values[c.named["period"]] == pytest.approx(2 * np.pi / 3)
    _, _, most = c.start[c.strengths[0]]
    assert most * 3 < 1.0  # what is read turns the same way as what turns


def test_no_wave_is_offered_of_which_next_to_nothing_was_seen():
    model = PLANTS["five_bar"]()
    assert all(c.physics != "kinematic_error" for c in of_sensor(model, "theta_1", [], 0.01, 10.0, span=0.3))
