"""Events: contact, play, friction that sticks and breaks away, against closed forms and event-accurate references written here."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from backsight.models import (
    Component,
    Equation,
    Model,
    Parameter,
    SolveError,
    Variable,
    balance,
    compile_model,
    equal,
    simulate,
)
from backsight.models.simulation.events import first_crossing
from backsight.models.simulation.radau import STAGES, tableau

Array = NDArray[np.float64]
NODES = np.concatenate([[0.0], tableau(STAGES)[0]])


class Body(Component):
    """m v' = u - force(c): a body under a law that a test writes."""

    s = Variable("m", state=True)
    v = Variable("m/s", state=True)
    u = Variable("N")
    m = Parameter("kg", 1.0, min=0.0)
    k = Parameter("N/m", 100.0)
    d = Parameter("N.s/m", 0.0)
    f = Parameter("N", 2.0)
    f_s = Parameter("N", 3.0)
    width = Parameter("m/s", 1e-3, min=1e-12, smoothing=True)

    def force(self, c: Any) -> Any:
        raise NotImplementedError

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"velocity": equal(c.der(c.s), c.v), "force balance": balance(c.m * c.der(c.v), c.u - self.force(c))}


def body(force: Callable[[Any], Any], **values: float) -> Any:
    kind = type("Own", (Body,), {"force": lambda _, c: force(c)})
    return compile_model(Model(name="own", components={"a": kind(**values)}, inputs={"u": "a.u"}, outputs={"s": "a.s"}))


# --- contact


def bounce(t: Array, height: float, k: float, g: float) -> Array:
    """A ball of 1 kg dropped on a spring at s = 0: parabolas and arcs of a sine, without loss."""
    w = np.sqrt(k)
    v, fall = np.sqrt(2 * g * height), np.sqrt(2 * height / g)
    contact = 2 / w * (np.pi - np.arctan(v * w / g))
    since = np.mod(t - fall, contact + 2 * v / g)
    depth = g / k * (1 - np.cos(w * since)) + v / w * np.sin(w * since)
    up = since - contact
    flying = np.where(since < contact, -depth, v * up - g * up**2 / 2)
    return np.where(t < fall, height - g * t**2 / 2, flying)


CONTACTS = {
    "fmin": lambda c: c.k * ca.fmin(c.s, 0),
    "fabs": lambda c: c.k * (c.s - ca.fabs(c.s)) / 2,
    "if_else": lambda c: ca.if_else(c.s < 0, c.k * c.s, 0),
    "rounded": lambda c: c.k * (c.s - ca.sqrt(c.s**2 + c.width**2)) / 2,
}


@pytest.mark.parametrize("law", list(CONTACTS))
def test_a_ball_that_bounces_on_a_stiff_spring_follows_the_closed_form(law: str) -> None:
    g, k, height = 9.81, 1e6, 0.1
    t = np.linspace(0.0, 3.0, 301)
    run = simulate(body(CONTACTS[law], k=k), t, {"u": -g}, initial={"a.s": height})
    truth = bounce(t, height, k, g)
    assert run.states["a.s"] == pytest.approx(truth, abs=2e-8)
    times = [e.time for e in run.events]
    v = np.sqrt(2 * g * height)
    period = 2 / np.sqrt(k) * (np.pi - np.arctan(v * np.sqrt(k) / g)) + 2 * v / g
    impacts = np.sqrt(2 * height / g) + period * np.arange(11)
    assert times[::2] == pytest.approx(impacts[impacts < 3.0], abs=1e-8)
    assert {(e.kind, e.component) for e in run.events} == {("switch", "a")}
    assert [e.sign for e in run.events[:4]] in ([-1, 1, -1, 1], [1, -1, 1, -1])


def test_a_contact_that_is_not_smooth_beyond_zero_is_entered_all_the_same() -> None:
    """Hertz: k max(-s, 0)^1.5, no number for a body in the air."""
    g, k, height = 9.81, 1e5, 0.05
    t = np.linspace(0.0, 0.5, 51)
    run = simulate(body(lambda c: -c.k * ca.fmax(-c.s, 0) ** 1.5, k=k), t, {"u": -g}, initial={"a.s": height})
    energy = run.states["a.v"] ** 2 / 2 + g * run.states["a.s"] + 2 / 5 * k * np.maximum(-run.states["a.s"], 0) ** 2.5
    assert energy == pytest.approx(g * height, rel=1e-7)
    assert len(run.events) >= 4


def test_the_gap_of_a_drive_is_crossed_as_an_event_accurate_reference_crosses_it() -> None:
    """Two inertias with play between them: k dead-zone(phi_1 - phi_2), a torque that reverses every half second."""

    class Drive(Component):
        phi_1, phi_2 = Variable("rad", state=True), Variable("rad", state=True)
        w_1, w_2 = Variable("rad/s", state=True), Variable("rad/s", state=True)
        tau = Variable("N.m")
        gap = Parameter("rad", 0.02)

        def equations(self, c: Any) -> dict[str, Equation]:
            twist = c.phi_1 - c.phi_2
            torque = 500.0 * (ca.fmax(twist - c.gap / 2, 0) + ca.fmin(twist + c.gap / 2, 0))
            return {
                "r1": equal(c.der(c.phi_1), c.w_1),
                "r2": equal(c.der(c.phi_2), c.w_2),
                "motor": balance(0.01 * c.der(c.w_1), c.tau - 0.02 * c.w_1 - torque, place="motor"),
                "load": balance(0.05 * c.der(c.w_2), torque - 0.01 * c.w_2),
            }

    t = np.linspace(0.0, 2.0, 41)
    tau = np.where(np.floor(t / 0.5 + 1e-9) % 2 == 0, 0.4, -0.4)
    dae = compile_model(Model(name="drive", components={"a": Drive()}, inputs={"tau": "a.tau"}))
    run = simulate(dae, t, {"tau": tau})

    def law(twist: float, mode: int) -> float:
        return 500.0 * (twist - mode * 0.01) if mode else 0.0

    q, mode, answer = np.zeros(4), 0, [np.zeros(4)]
    for (now, then), torque in zip(pairwise(t.tolist()), tau.tolist(), strict=False):
        while now < then:

            def rate(_: float, q: Array, m: int = mode, torque: float = torque) -> list[float]:
                between = law(q[0] - q[1], m)
                return [q[2], q[3], (torque - 0.02 * q[2] - between) / 0.01, (between - 0.01 * q[3]) / 0.05]

            edges: list[Any] = [lambda _, q, e=e: q[0] - q[1] - e for e in ((-0.01, 0.01) if mode == 0 else (mode * 0.01,))]
            for edge, sign in zip(edges, (-1, 1) if mode == 0 else (-mode,), strict=True):
                edge.terminal, edge.direction = True, sign
            part = solve_ivp(rate, (now, then), q, method="DOP853", rtol=1e-12, atol=1e-14, events=edges)
            now, q = float(part.t[-1]), part.y[:, -1]
            if part.status == 1:
                mode = 0 if mode else (-1 if len(part.t_events[0]) else 1)
        answer.append(q)
    truth = np.array(answer).T
    for name, row in zip(("phi_1", "phi_2", "w_1", "w_2"), truth, strict=True):
        assert run.states[f"a.{name}"] == pytest.approx(row, abs=1e-8 * np.ptp(row))
    assert len(run.events) > 20


def test_a_force_that_acts_only_between_two_corners_a_moment_apart_is_not_missed() -> None:
    """A damped contact on both sides of s = 0: it lets go where k s + d v = 0 and takes hold at s = 0, 30 us later.

    A step of 1 ms over both sees the same straight line on either side, and an integrator without events is wrong by 4e-6 at any tolerance.
    """

    def law(c: Any) -> Any:
        q = c.k * c.s + c.d * c.v
        return ca.if_else(c.s > 0, ca.fmax(q, 0), ca.fmin(q, 0))

    start, velocity = 1.3e-5, -2.5e-3
    t = np.linspace(0.0, 0.01, 11)
    run = simulate(body(law, k=1e4, d=0.3), t, {"u": -0.05}, initial={"a.s": start, "a.v": velocity})

    now, q, edge = 0.0, np.array([start, velocity]), 1e4
    for force, corner in ((1.0, (1e4, 0.3)), (0.0, (1.0, 0.0)), (1.0, None)):

        def rate(_: float, y: Array, force: float = force) -> list[float]:
            return [y[1], -0.05 - force * (edge * y[0] + 0.3 * y[1])]

        def crossing(_: float, y: Array, corner: tuple[float, float] = corner or (0.0, 0.0)) -> float:
            return float(corner[0] * y[0] + corner[1] * y[1])

        crossing.terminal = True  # type: ignore[attr-defined]
        part = solve_ivp(rate, (now, 0.01), q, method="DOP853", rtol=1e-13, atol=1e-18, events=crossing if corner else None)
        now, q = float(part.t[-1]), part.y[:, -1]
    assert run.states["a.v"][-1] == pytest.approx(q[1], rel=1e-10)
    assert run.states["a.s"][-1] == pytest.approx(q[0], rel=1e-9)


def test_a_body_at_rest_on_a_corner_makes_no_events() -> None:
    run = simulate(body(lambda c: c.k * ca.fmin(c.s, 0)), np.linspace(0.0, 1.0, 11), {"u": 0.0})
    assert run.events == ()


# --- friction


def test_a_body_under_coulomb_friction_stops_at_the_hand_calculated_point_and_stays_there() -> None:
    for law in (lambda c: c.f * ca.sign(c.v), lambda c: c.f * ca.tanh(c.v / c.width)):
        run = simulate(body(law), np.array([0.0, 0.5, 2.0, 1e4]), {"u": 1.5}, initial={"a.v": 1.0})  # v' = 1.5 - 2 until rest at t = 2
        assert run.states["a.s"] == pytest.approx([0.0, 0.5 - 0.5**2 / 4, 1.0, 1.0], abs=1e-12)
        assert run.states["a.v"][1:] == pytest.approx([0.75, 0.0, 0.0], abs=1e-12)
        (event,) = run.events
        assert (event.kind, event.component, event.sign) == ("stick", "a", 0)
        assert event.time == pytest.approx(2.0, abs=1e-11)


def test_the_force_of_a_body_at_rest_is_the_applied_one() -> None:
    class Measured(Body):
        held = Variable("N")

        def force(self, c: Any) -> Any:
            return c.held

        def equations(self, c: Any) -> dict[str, Equation]:
            return {**super().equations(c), "law": equal(c.held, c.f * ca.tanh(c.v / c.width))}

    dae = compile_model(Model(name="m", components={"a": Measured()}, inputs={"u": "a.u"}, outputs={"f": "a.held"}))
    t, u = np.linspace(0.0, 1.0, 11), np.linspace(-1.9, 1.9, 11)
    for hold in ("zero", "linear"):
        run = simulate(dae, t, {"u": u}, hold=hold)  # type: ignore[arg-type]
        assert run.outputs["f"] == pytest.approx(u, abs=1e-12)
        assert run.states["a.s"].tolist() == [0.0] * 11


def test_a_force_that_rises_through_the_breakaway_sets_the_body_going_at_that_moment() -> None:
    """A ramp of 1 N/s against f = 2 N: v' = t - 2 from t = 2 on."""
    t = np.linspace(0.0, 4.0, 9)
    run = simulate(body(lambda c: c.f * ca.tanh(c.v / c.width)), t, {"u": t}, hold="linear")
    assert run.states["a.v"] == pytest.approx(np.maximum(t - 2.0, 0) ** 2 / 2, abs=1e-10)
    assert [(e.kind, e.sign) for e in run.events] == [("slip", 1)]
    assert run.events[0].time == pytest.approx(2.0, abs=1e-10)


def test_friction_that_depends_on_the_direction_holds_between_its_two_levels() -> None:
    def law(c: Any) -> Any:
        return ca.if_else(c.v > 0, 1.0, -3.0)

    run = simulate(body(law), [0.0, 1.0, 2.0, 3.0, 4.0], {"u": [0.9, -2.9, 1.5, -4.0, 0.0]})
    # 1.5 - 1 N for a second; then -4 - 1 N for 0.1 s until rest, and -4 + 3 N for the other 0.9 s
    assert run.states["a.v"] == pytest.approx([0.0, 0.0, 0.0, 0.5, -0.9], abs=1e-12)
    assert run.states["a.s"][-1] == pytest.approx(0.5 / 2 + 0.5 * 0.1 / 2 - 0.9**2 / 2, abs=1e-12)
    assert [(e.kind, e.sign) for e in run.events] == [("slip", 1), ("reverse", -1)]
    assert [e.time for e in run.events] == pytest.approx([2.0, 3.1], abs=1e-11)


def stick_slip_reference(t: Array, k: float, f: float, f_s: float, belt: float) -> tuple[Array, Array, list[float]]:
    """A unit mass on a spring, pulled at speed `belt`: m y'' = k (belt t - y) - friction(y'), in exact pieces.

    Sliding (y' > 0): y = y_s + (y_0 - y_s) cos + ..., the spring's stretch e = belt t - y obeying e'' = -k e + f; stuck: e' = belt.
    """
    w = np.sqrt(k)
    e, rate, now, stuck = 0.0, belt, 0.0, True
    pieces, changes = [], []
    while now <= t[-1]:
        if stuck:
            end = now + (f_s - k * e) / (k * belt)
            pieces.append((now, end, True, e, rate))
            e, rate = f_s / k, belt
        else:  # e = f/k + a cos w tau + b sin w tau until e' = belt again
            a, b = e - f / k, rate / w
            speed = lambda tau, a=a, b=b: belt - w * (-a * np.sin(w * tau) + b * np.cos(w * tau))  # noqa: E731
            grid = np.linspace(1e-6 / w, 2 * np.pi / w, 400)
            i = next(i for i in range(len(grid) - 1) if speed(grid[i]) > 0 >= speed(grid[i + 1]))
            tau = brentq(speed, grid[i], grid[i + 1], xtol=1e-15, rtol=1e-14)
            end = now + tau
            pieces.append((now, end, False, e, rate))
            e, rate = f / k + a * np.cos(w * tau) + b * np.sin(w * tau), belt
        changes.append(end)
        now, stuck = end, not stuck
    y, v = np.empty_like(t), np.empty_like(t)
    for i, at in enumerate(t):
        start, _, held, e, rate = next(p for p in pieces if p[0] <= at <= p[1])
        tau = at - start
        if held:
            y[i], v[i] = belt * at - (e + belt * tau), 0.0
        else:
            a, b = e - f / k, rate / w
            stretch = f / k + a * np.cos(w * tau) + b * np.sin(w * tau)
            y[i], v[i] = belt * at - stretch, belt - w * (-a * np.sin(w * tau) + b * np.cos(w * tau))
    return y, v, [c for c in changes if c < t[-1]]


def test_stick_slip_with_breakaway_follows_the_exact_pieces() -> None:
    """Rounded as such laws are: a level that peaks at |v| = width, times tanh(8 v/width)."""

    def law(c: Any) -> Any:
        s = c.v / c.width
        level = c.f + (c.f_s - c.f) * s**2 * ca.exp(1 - s**2)
        return level * ca.tanh(8 * c.v / c.width) - c.k * (0.1 * c.time - c.s)

    peak = 3.0 * np.tanh(8.0)  # of the rounded law, at s = 1 but for 1e-7
    t = np.linspace(0.0, 4.0, 401)
    dae = body(law, k=100.0)
    run = simulate(dae, t, {"u": 0.0})
    y, v, changes = stick_slip_reference(t, 100.0, 2.0, peak, 0.1)
    assert run.states["a.s"] == pytest.approx(y, abs=1e-6 * np.ptp(y))
    assert run.states["a.v"] == pytest.approx(v, abs=1e-6 * np.ptp(v))
    assert [e.kind for e in run.events] == ["slip" if i % 2 == 0 else "stick" for i in range(len(run.events))]
    assert [e.time for e in run.events] == pytest.approx(changes, abs=1e-6)
    assert len(changes) > 10


def test_two_frictions_in_series_stick_and_slip_on_their_own() -> None:
    """A plate on the ground (3 N) and a block on the plate (1 N), 1 kg each; the block is pushed with 5 N, then let go."""

    class Stack(Component):
        s_1, v_1, s_2, v_2 = (Variable(unit, state=True) for unit in ("m", "m/s", "m", "m/s"))
        u = Variable("N")
        width = Parameter("m/s", 1e-3, min=1e-12, smoothing=True)

        def equations(self, c: Any) -> dict[str, Equation]:
            below, between = 3.0 * ca.tanh(c.v_1 / c.width), 4.0 * ca.tanh((c.v_2 - c.v_1) / c.width)
            return {
                "r1": equal(c.der(c.s_1), c.v_1),
                "r2": equal(c.der(c.s_2), c.v_2),
                "plate": balance(c.der(c.v_1), between - below, place="plate"),
                "block": balance(c.der(c.v_2), c.u - between),
            }

    dae = compile_model(Model(name="stack", components={"a": Stack()}, inputs={"u": "a.u"}))
    run = simulate(dae, [0.0, 1.0, 2.0, 5.0], {"u": [4.5, 8.0, 0.0, 0.0]})
    # 0..1: both together, v' = (4.5 - 3)/2; 1..2: block 8 - 4, plate 4 - 3; then block -4, plate 4 - 3 until equal; then together -1.5
    assert run.states["a.v_1"][:3] == pytest.approx([0.0, 0.75, 1.75], abs=1e-12)
    assert run.states["a.v_2"][:3] == pytest.approx([0.0, 0.75, 4.75], abs=1e-12)
    equal_after = 3.0 / 5.0
    v = 1.75 + equal_after
    rest = 2.0 + equal_after + v / 1.5
    ends = [(e.kind, e.time) for e in run.events if e.time > 2.0]
    assert [kind for kind, _ in ends] == ["stick", "stick"]
    assert [time for _, time in ends] == pytest.approx([2.0 + equal_after, rest], abs=1e-10)
    assert [run.states[name][-1] for name in ("a.v_1", "a.v_2")] == pytest.approx([0.0, 0.0], abs=1e-16)


def test_two_frictions_on_one_rigid_body_hold_together_what_neither_holds_alone() -> None:
    def law(c: Any) -> Any:
        return c.f * ca.tanh(c.v / c.width) + c.f_s * ca.tanh(2 * c.v / c.width)

    run = simulate(body(law), [0.0, 1.0, 2.0], {"u": [4.9, 5.5, 0.0]})
    assert run.states["a.v"] == pytest.approx([0.0, 0.0, 0.5], abs=1e-11)
    assert [e.kind for e in run.events] == ["slip"]


def test_a_width_that_is_given_keeps_the_law_smooth_and_without_events() -> None:
    dae = body(lambda c: c.f * ca.tanh(c.v / c.width))
    run = simulate(dae, [0.0, 10.0], {"u": 1.0}, {"a.width": 0.5})
    assert run.events == ()
    assert run.states["a.v"][-1] == pytest.approx(0.5 * np.arctanh(0.5), rel=1e-6)


def test_a_touch_without_contact_is_no_trap() -> None:
    """s = t^2/2 - t + 1/2 touches the stop at t = 1 with no speed."""
    t = np.linspace(0.0, 2.0, 21)
    run = simulate(body(lambda c: c.k * ca.fmin(c.s, 0)), t, {"u": 1.0}, initial={"a.s": 0.5, "a.v": -1.0})
    assert run.states["a.s"] == pytest.approx((t - 1) ** 2 / 2, abs=1e-9)


def test_a_relay_that_chatters_is_refused_with_the_time_and_the_law() -> None:
    class Relay(Component):
        y = Variable("1", state=True, start=1.0)
        e = Variable("1")

        def equations(self, c: Any) -> dict[str, Equation]:
            return {"error": equal(c.e + c.e**3, c.y), "drive": equal(c.der(c.y), -ca.sign(c.e))}

    with pytest.raises(SolveError, match=r"stopped at t = 1 s: the law that switches at 'relay\.e' of 'relay' = 0"):
        simulate(compile_model(Model(name="m", components={"relay": Relay()})), [0.0, 2.0])


# --- where a polynomial crosses


def test_the_first_crossing_is_the_first_zero_after_a_positive_value() -> None:
    dip = (NODES - 0.31) * (NODES - 0.42) * (3.0 - NODES)  # positive at all nodes but between two of them
    late = 0.9 - NODES
    found = first_crossing(np.array([late, dip]), np.ones(2))
    assert found is not None
    assert found[1] == 1
    assert found[0] == pytest.approx(0.31, abs=1e-13)


def test_a_function_that_leaves_zero_upwards_does_not_cross_and_downwards_crosses_at_once() -> None:
    assert first_crossing(np.array([NODES**2 - 1e-16]), np.ones(1)) is None
    assert first_crossing(np.array([-(NODES**2)]), np.ones(1)) == (0.0, 0)
