"""Friction of sliding bodies against solutions by hand; the simulation sharpens the corners."""

import numpy as np
import pytest
from one_dimensional import Alone, T, body_with, run_body, sharp
from scipy.integrate import simpson, solve_ivp

from backsight.models import Component, Model, compile_model, simulate
from backsight.models.mechanics.translational import (
    AsymmetricFriction,
    DahlFriction,
    Fixed,
    Friction,
    LoadDependentFriction,
    LoadFriction,
    LogarithmicFriction,
    LuGreFriction,
    Mass,
    PositionDependentFriction,
    Speed,
    Spring,
    StickSlip,
    StribeckFriction,
)
from backsight.models.signals import Constant

MASS = 2.0


def test_viscous_friction_is_a_damper() -> None:
    assert run_body(Friction(d=6.0), v=3.0).states["body.v"] == pytest.approx(3.0 * np.exp(-3.0 * T), rel=1e-9)


def test_coulomb_friction_stops_a_body_after_the_distance_of_constant_deceleration() -> None:
    result = run_body(Friction(f_c=4.0), v=3.0)  # 2 m/s2: stops after 1.5 s, 2.25 m
    moving = np.minimum(T, 1.5)
    assert result.states["body.s"] == pytest.approx(3.0 * moving - moving**2, abs=2.25e-6)
    assert result.states["body.v"] == pytest.approx(3.0 - 2.0 * moving, abs=3e-6)


@pytest.mark.parametrize(
    "element",
    [Friction(f_c=4.0), StribeckFriction(f_c=2.0, f_s=4.0), AsymmetricFriction(f_plus=4.0, f_minus=2.0), LoadFriction(mu=0.2, load=20.0)],
)
def test_a_force_below_friction_at_rest_does_not_move_a_body(element: Component) -> None:
    assert np.abs(run_body(element, force=3.9).states["body.s"]).max() < 1e-6
    assert run_body(element, force=4.1).states["body.s"][-1] > 0.05


def test_friction_only_takes_power_from_a_body_and_as_much_as_its_energy_loses() -> None:
    base = body_with(Friction(d=1.5, f_c=4.0))
    model = Model(
        name="body",
        components=base.components,
        connections=base.connections,
        inputs=base.inputs,
        outputs={"f": "element.f", "v": "element.v_rel"},
    )
    t = np.linspace(0.0, 2.0, 2001)
    result = simulate(compile_model(model), t, {"F": 0.0}, {"element.width": 0.1}, {"body.v": -2.0})
    power = result.outputs["f"] * result.outputs["v"]
    assert power.min() >= 0.0
    lost = 0.5 * 2.0 * (4.0 - result.states["body.v"][-1] ** 2)
    assert simpson(power, x=t) == pytest.approx(lost, rel=1e-9)


GENERATOR = np.random.default_rng(2)
S, V = GENERATOR.uniform(-1.0, 1.0, 400), GENERATOR.choice([-1.0, 1.0], 400) * 10 ** GENERATOR.uniform(-6.0, 0.5, 400)
SIGN = np.sign(V)


@pytest.mark.parametrize(
    ("element", "expected"),
    [
        (StribeckFriction(d=2.0, f_c=3.0, f_s=5.0, v_s=0.3), 2 * V + SIGN * (3 + 2 * np.exp(-((V / 0.3) ** 2)))),
        (LogarithmicFriction(b=2.0, c=15.0), SIGN * (15 + 2 * np.log(np.abs(V) / 0.0254)) * (np.abs(V) >= 2.54e-5)),
        (AsymmetricFriction(d_plus=2.0, d_minus=5.0, f_plus=3.0, f_minus=1.0), np.where(V > 0, 2 * V + 3, 5 * V - 1)),
        (
            PositionDependentFriction(d=1.0, f_c=3.0, amplitude=0.6, period=0.25, phase=0.4),
            V + 3 * SIGN * (1 + 0.6 * np.sin(8 * np.pi * S + 0.4)),
        ),
        (LoadFriction(mu=0.2, load=30.0), 6 * SIGN),
        (StickSlip(f_sl=2.0, f_st=3.0), 2 * SIGN),
    ],
    ids=lambda x: type(x).__name__,
)
def test_a_moving_body_feels_the_textbook_law(element: Component, expected: np.ndarray) -> None:
    assert Alone(sharp(element)).at(S, V)[0] == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_friction_under_a_load_follows_what_it_is_told() -> None:
    alone = Alone(sharp(LoadDependentFriction(mu=0.2)))
    load = np.linspace(-50.0, 50.0, 21)
    assert alone.at(0.0, 0.5, load=load)[0] == pytest.approx(0.2 * np.abs(load), abs=1e-6)
    assert alone.at(0.0, -0.5, load=load)[0] == pytest.approx(-0.2 * np.abs(load), abs=1e-6)


def test_a_load_may_come_from_a_signal_or_from_the_force_of_an_element() -> None:
    told = body_with(Spring(k=8.0)).insert("body", LoadDependentFriction(mu=0.5), name="rubbing")
    by_block = Model(
        name="block",
        components={**told.components, "weight": Constant(value=6.0)},
        connections=[*told.connections, ("weight.y", "rubbing.load")],
        inputs=told.inputs,
    ).replace("element", Spring(k=0.0))
    result = simulate(compile_model(by_block), T, {"F": 0.0}, initial={"body.v": 3.0})  # 1.5 m/s2: stands after 2 s
    assert result.states["body.v"] == pytest.approx(3.0 - 1.5 * T, abs=1e-5)
    by_element = told.connect("element.f", "rubbing.load")
    result = simulate(compile_model(by_element), T, {"F": 0.0}, initial={"body.s": 1.0})
    arrive = np.pi / 2 / np.sqrt((1 - 0.5) * 8.0 / MASS)  # back towards the middle friction takes half of the spring's force
    near = arrive >= T
    assert result.states["body.s"][near] == pytest.approx(np.cos(np.sqrt(2.0) * T[near]), abs=1e-5)


def test_a_body_sticks_up_to_the_breakaway_force_and_then_slides_under_the_lower_one() -> None:
    stick_slip = StickSlip(f_sl=2.0, f_st=3.0)
    held = run_body(stick_slip, force=2.99)
    assert np.all(np.abs(held.states["body.v"]) < 1e-8)  # the width of a simulation
    assert np.all(np.abs(run_body(stick_slip, force=2.99, width=0.01).states["body.v"]) < 0.01)
    loose = run_body(stick_slip, force=3.01)
    assert loose.states["body.v"] == pytest.approx(1.01 / MASS * T, abs=1e-5)


def test_a_body_pulled_by_a_spring_sticks_and_slips_with_the_period_of_the_textbook() -> None:
    k, pull, slide, stick = 50.0, 0.2, 2.0, 3.0
    omega, excess = np.sqrt(k / MASS), (stick - slide) / k
    slip = 2 * (np.pi - np.arctan(excess * omega / pull)) / omega  # until the body stands; then the spring is stretched anew by 2 excess
    period = slip + 2 * excess / pull
    model = Model(
        name="pulled",
        components={
            "puller": Speed(),
            "spring": Spring(k=k),
            "body": Mass(m=MASS),
            "floor": StickSlip(f_sl=slide, f_st=stick),
            "ground": Fixed(),
        },
        connections=[
            ("puller.flange", "spring.flange_a"),
            ("spring.flange_b", "body.flange"),
            ("body.flange", "floor.flange_a"),
            ("floor.flange_b", "ground.flange"),
        ],
        inputs={"v": "puller.v"},
    )
    t = np.linspace(0.0, 3 * period, 301)
    result = simulate(compile_model(model), t, {"v": pull}, initial={"puller.s": stick / k})
    phase = np.minimum(t % period, slip)
    stretch = excess * np.cos(omega * phase) + pull / omega * np.sin(omega * phase) + slide / k + pull * (t % period - phase)
    assert result.states["body.s"] == pytest.approx(stick / k + pull * t - stretch, abs=2e-4)


def pushed(element: Component, speed: float, t: np.ndarray) -> np.ndarray:
    """The force of an element between a flange that moves at a given speed and ground."""
    model = Model(
        name="pushed",
        components={"drive": Speed(), "element": element, "ground": Fixed()},
        connections=[("drive.flange", "element.flange_a"), ("element.flange_b", "ground.flange")],
        inputs={"v": "drive.v"},
        outputs={"f": "element.f"},
    )
    return simulate(compile_model(model), t, {"v": speed}).outputs["f"]


def test_presliding_of_dahl_approaches_coulomb_friction_exponentially_with_the_way() -> None:
    way = 0.01 * T
    expected = 4.0 * (1 - np.exp(-1000.0 * way / 4.0))
    assert pushed(DahlFriction(sigma_0=1000.0, f_c=4.0), 0.01, T) == pytest.approx(expected, abs=1e-8)


def test_a_small_force_swings_a_body_on_its_bristles() -> None:
    result = run_body(LuGreFriction(sigma_0=800.0, f_c=4.0, f_s=5.0), force=1e-4, t=T)
    assert result.states["body.s"] == pytest.approx(1e-4 / 800.0 * (1 - np.cos(20.0 * T)), abs=1e-9)


@pytest.mark.parametrize("speed", [1e-3, 0.02, -0.5])
def test_steady_sliding_on_bristles_is_the_friction_of_stribeck(speed: float) -> None:
    element = LuGreFriction(sigma_0=1e4, sigma_1=20.0, f_c=4.0, f_s=6.0, v_s=0.02, d=1.5)
    expected = np.sign(speed) * (4.0 + 2.0 * np.exp(-((speed / 0.02) ** 2))) + 1.5 * speed
    assert pushed(element, speed, np.linspace(0.0, 10.0, 11))[-1] == pytest.approx(expected, rel=1e-6)


def test_a_body_on_bristles_moves_as_scipy_integrates_the_published_equations() -> None:
    sigma_0, f_c, f_s, v_s = 1e3, 2.0, 3.0, 0.05
    t = np.linspace(0.0, 2.0, 401)

    def rate(_: float, x: np.ndarray) -> list[float]:
        s, v, z = x
        g = f_c + (f_s - f_c) * np.exp(-((v / v_s) ** 2))
        return [v, (-20.0 * s - sigma_0 * z) / MASS, v - sigma_0 * abs(v) * z / g]

    truth = solve_ivp(rate, (0.0, 2.0), [1.0, 0.0, 0.0], t_eval=t, rtol=1e-10, atol=1e-12, max_step=1e-2).y
    model = body_with(LuGreFriction(sigma_0=sigma_0, f_c=f_c, f_s=f_s, v_s=v_s)).insert("body", Spring(k=20.0), name="spring")
    result = simulate(compile_model(model), t, {"F": 0.0}, initial={"body.s": 1.0})
    assert result.states["body.s"] == pytest.approx(truth[0], abs=1e-6)
    assert result.states["element.z"] == pytest.approx(truth[2], abs=1e-8)


def test_slow_bristles_are_damped_as_given() -> None:
    element = LuGreFriction(sigma_0=1000.0, sigma_1=30.0, f_c=2.0, f_s=3.0, v_s=0.1)
    force, rate = Alone(sharp(element)).at(0.0, 1e-6, z=1e-3)
    assert force == pytest.approx(1000.0 * 1e-3 + 30.0 * rate, rel=1e-6)
