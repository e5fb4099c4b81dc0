"""The drillstring: the transfer functions printed in its report, its energies, and its stick-slip against a solution with exact events."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import cumulative_simpson, solve_ivp
from scipy.signal import cont2discrete, ss2tf

from backsight.models import ModelError, compile_model, simulate
from backsight.models.analysis.linearise import StateSpace, linearise
from backsight.models.plants import PLANTS, drillstring

Array = NDArray[np.float64]
STATES = ["motor.i", "rotary_table.omega", "string.dphi", "bha.omega"]
L, R, KM, J_C, B_R, K_S, J_B, B_B, TAU_SL, TAU_ST = 0.116, 22.0, 11.0, 0.3, 0.03, 0.0868, 0.0529, 0.001, 0.4, 0.6
FREE = {"bit.tau_sl": 0.0, "bit.tau_st": 0.0}


def textbook(x: Array, volts: float, bit: float = 0.0) -> Array:
    i, omega_r, dphi, omega_b = x
    twist = K_S * dphi
    return np.array(
        [
            (volts - R * i - KM * omega_r) / L,
            (KM * i - B_R * omega_r - twist) / J_C,
            omega_r - omega_b,
            (twist - B_B * omega_b + bit) / J_B,
        ]
    )


def columns(mapping: Any, names: list[str] = STATES) -> Array:
    return np.array([mapping[name] for name in names])


def test_the_drillstring_is_registered_under_its_name() -> None:
    assert PLANTS["drillstring"]() == drillstring()


def test_names_units_and_defaults_are_the_published_ones() -> None:
    dae = compile_model(drillstring())
    assert [(q.name, q.unit) for q in dae.states] == list(zip(STATES, ["A", "rad/s", "rad", "rad/s"], strict=True))
    assert [(q.name, q.unit) for q in (*dae.inputs, *dae.outputs)] == [("V", "V"), ("I_m", "A"), ("Omega_r", "rad/s")]
    values = {p.name: p.value for p in dae.parameters}
    expected = {
        "motor.L": L,
        "motor.R": R,
        "motor.Km": KM,
        "gear.ratio": 1.0,
        "rotary_table.J": J_C,
        "rotary_table.d": B_R,
        "string.k": K_S,
    }
    expected |= {"bha.J": J_B, "bha.d": B_B, "bit.tau_sl": TAU_SL, "bit.tau_st": TAU_ST}
    assert {name: values[name] for name in expected} == expected
    assert [(p.name, p.unit) for p in dae.places] == [("motor", "V"), ("rotary_table", "N.m"), ("bha", "N.m")]
    assert {"string", "bit"} <= {p.name for p in dae.dormant_places}
    assert (len(dae.algebraics), dae.index, dae.invariants.shape[0]) == (0, 0, 0)
    assert [p.name for p in compile_model(drillstring(), places=("string",)).places] == ["motor", "rotary_table", "string", "bha"]


def current_of_voltage(system: StateSpace, rate: float) -> tuple[Array, Array]:
    """Numerator and denominator in 1/z of I_m over V for a voltage held between samples, by scipy."""
    a, b, c, d, _ = cont2discrete((system.A, system.B, system.C[:1], system.D[:1]), 1 / rate)
    numerator, denominator = ss2tf(a, b, c, d)
    return numerator[0, 1:], denominator[1:]


@pytest.mark.parametrize(
    ("rate", "a", "b"),
    [
        (20, [-2.3503, 1.7085, -0.3557, 0.0001], [0.0208, -0.0621, 0.0619, -0.0206]),
        (10, [-2.1069, 1.2474, -0.1262, 0.0000], [0.0076, -0.0223, 0.0220, -0.0073]),
    ],
)
def test_a_slipping_bit_has_the_printed_transfer_function(rate: float, a: list[float], b: list[float]) -> None:
    # the last coefficient is exp(trace(A)/rate), 6e-9 at 10 Hz; the report prints 0.0001 there
    numerator, denominator = current_of_voltage(linearise(compile_model(drillstring()), parameters=FREE), rate)
    assert denominator == pytest.approx(a, abs=5.1e-5)
    assert numerator == pytest.approx(b, abs=5.1e-5)


def test_a_stuck_bit_has_the_printed_transfer_function() -> None:
    system = linearise(compile_model(drillstring()), {"bha.omega": 0.0})
    numerator, denominator = current_of_voltage(system, 10)
    assert denominator == pytest.approx([-1.1251, 0.1265, 0.0, 0.0], abs=5.1e-5)  # and a pole of the bit that holds
    assert 100 * numerator == pytest.approx([0.7574, -1.4854, 0.7343, 0.0], abs=5.1e-3)


def test_a_sliding_bit_moves_as_a_free_one_about_its_working_point() -> None:
    dae = compile_model(drillstring())
    sliding = linearise(dae, {"bha.omega": 3.0})
    assert sliding.poles == pytest.approx(linearise(dae, parameters=FREE).poles, rel=1e-8)


def test_other_gears_load_the_motor_with_their_ratio() -> None:
    fast = linearise(compile_model(drillstring().with_values(gear={"ratio": 2.0})), parameters=FREE)
    direct = linearise(compile_model(drillstring().with_values(motor={"Km": 2 * KM})), parameters=FREE)
    np.testing.assert_allclose(fast.A, direct.A, rtol=1e-12)


def test_what_the_amplifier_gives_is_stored_or_lost_in_copper_and_bearings() -> None:
    t = np.linspace(0.0, 4.0, 4001)
    run = simulate(compile_model(drillstring()), t, {"V": 40.0}, FREE, {"bha.omega": -2.0, "string.dphi": 4.0})
    late = t >= 0.3  # the current has risen, in L/R = 5 ms
    i, omega_r, dphi, omega_b = columns(run.states)[:, late]
    stored = (L * i**2 + J_C * omega_r**2 + K_S * dphi**2 + J_B * omega_b**2) / 2
    power = 40.0 * i - R * i**2 - B_R * omega_r**2 - B_B * omega_b**2
    assert stored - stored[0] == pytest.approx(cumulative_simpson(power, x=t[late], initial=0.0), abs=1e-9 * stored.max())


def with_events(t: Array, volts: float) -> tuple[Array, Array]:
    """From rest: the bit sticks until the string twists it loose, and slips until it stands. States, and whether it sticks."""
    x, now, stuck = np.zeros(4), 0.0, True
    states, sticks = np.empty((4, len(t))), np.empty(len(t), dtype=bool)
    while now < t[-1]:
        sign = np.sign(x[2])

        def moves(_: float, x: Array, stuck: bool = stuck, sign: float = sign) -> Array:
            rate = textbook(x, volts, -sign * TAU_SL)
            rate[3] = 0.0 if stuck else rate[3]
            return rate

        def ends(s: float, x: Array, stuck: bool = stuck, sign: float = sign, began: float = now) -> float:
            return abs(K_S * x[2]) - TAU_ST if stuck else sign * x[3] + (1e-9 if s == began else 0.0)

        ends.terminal, ends.direction = True, 1.0 if stuck else -1.0  # type: ignore[attr-defined]
        inside = (t >= now) & (t <= t[-1])
        piece = solve_ivp(moves, (now, t[-1]), x, events=ends, dense_output=True, rtol=1e-10, atol=1e-12, method="DOP853")
        inside = (t >= now) & (t <= piece.t[-1])
        states[:, inside], sticks[inside] = piece.sol(t[inside]), stuck
        x, now, stuck = piece.y[:, -1].copy(), float(piece.t[-1]), not stuck
        if stuck:
            x[3] = 0.0
    return states, sticks


def test_at_low_speed_the_bit_sticks_and_slips_as_the_event_accurate_solution_does() -> None:
    t = np.linspace(0.0, 30.0, 1501)
    truth, sticks = with_events(t, 13.0)
    assert np.count_nonzero(np.diff(sticks.astype(int))) >= 4
    run = simulate(compile_model(drillstring()), t, {"V": 13.0})
    states = columns(run.states)
    assert np.all(np.abs(states - truth).max(axis=1) < 1e-3 * np.ptp(truth, axis=1))
    assert np.abs(states[3, sticks]).max() < 1e-3


def test_sections_in_series_are_the_printed_chain() -> None:
    count = 3
    inertia, damping, stiffness = J_B / count, B_B / count, count * K_S
    size = 2 + 2 * count
    chain = np.zeros((size, size))  # I, Omega_r, then dphi_p and Omega_p of each section
    chain[0, :2], chain[1, :3] = [-R / L, -KM / L], [KM / J_C, -B_R / J_C, -stiffness / J_C]
    for p in range(count):
        twist, speed, above = 2 + 2 * p, 3 + 2 * p, 1 + 2 * p
        chain[twist, [above, speed]] = 1.0, -1.0
        chain[speed, [twist, speed]] = stiffness / inertia, -damping / inertia
        if p + 1 < count:
            chain[speed, twist + 2] = -stiffness / inertia
    system = linearise(compile_model(drillstring(count)), parameters=FREE)
    assert [q.name for q in system.states[2:]] == [
        "string_1.dphi",
        "section_1.omega",
        "string_2.dphi",
        "section_2.omega",
        "string_3.dphi",
        "bha.omega",
    ]
    np.testing.assert_allclose(system.A, chain, rtol=1e-12)


def test_the_rectifier_drive_has_the_transfer_function_of_the_report() -> None:
    k_p, k_i, k_mv = 0.7, 6.0, 0.9
    model = drillstring(drive="rectifier").with_values(source={"K_p": k_p, "K_i": k_i, "K_mv": k_mv}, rotary_table={"J": 1e12})
    system = linearise(compile_model(model), parameters=FREE)
    numerator, denominator = system.transfer_function("V_r", "I_m")
    a_1, a_2 = 1 / (k_p * L * k_mv) + R / L + k_i / k_p, k_i * R / (k_p * L)
    b_1, b_2 = 1 / (L * k_mv), k_i / (k_p * L * k_mv)
    s = 1j * np.array([0.3, 3.0, 30.0, 300.0])
    expected = (b_1 * s + b_2) / (s**2 + a_1 * s + a_2)
    assert np.abs(np.polyval(numerator, s) / np.polyval(denominator, s) / expected - 1).max() < 1e-6


def test_a_stiff_drive_holds_the_speed_and_soft_torque_feedback_dampens_the_string() -> None:
    def damping(resistance: float) -> float:
        dae = compile_model(drillstring(drive="rectifier"))
        poles = linearise(dae, parameters={**FREE, "source.K_str": resistance}).poles
        [string] = [p for p in poles if p.imag > 0.5]
        return float(-string.real / abs(string))

    stiff = damping(0.0)
    assert stiff < 0.02
    assert damping(300.0) > 3 * stiff
    run = simulate(compile_model(drillstring(drive="rectifier")), [0.0, 30.0, 60.0, 200.0], {"V_r": 30.0}, FREE)
    i, omega = run.outputs["I_m"][-1], run.outputs["Omega_r"][-1]
    assert R * i + KM * omega == pytest.approx(30.0, rel=1e-6)


@pytest.mark.parametrize(
    ("arguments", "text"), [({"sections": 0}, r"sections=0"), ({"drive": "scr"}, r"drive='scr'.*'voltage' or 'rectifier'")]
)
def test_a_wrong_variant_is_refused(arguments: dict[str, Any], text: str) -> None:
    with pytest.raises(ModelError, match=text):
        drillstring(**arguments)
