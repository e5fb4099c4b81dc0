"""Concealed cases of the quadrotor."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from ..generators.concealed.acting import InputFault
from ..generators.concealed.effects import Effect, laws
from ..generators.concealed.quadrotor import CONDITIONS, Craft, fly, shares, stick
from ..generators.concealed.sensing import SensorFault
from ..generators.quadrotor import Pilot, rotation, with_values
from ..generators.run import clock
from .case import CLEAN, Bench, Case, Taken, Values, conditions, same, wrong

__all__ = ["BENCH"]

Told = Mapping[str, tuple[float, str]]
INPUTS, ROTORS = tuple(f"u_{i}" for i in (1, 2, 3, 4)), tuple(f"rotor_{i}" for i in (1, 2, 3, 4))
PILOT = Pilot()
HORIZONTAL = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0])


def body(physics: str, told: Told, *rivals: tuple[str, str], **how: Any) -> Effect:
    """An effect on the body."""
    return Effect(place="body", physics=physics, parameters=told, rivals=rivals, **how)


def drag(d: float) -> Effect:
    rivals = (*same("viscous_friction", "body"), *same("linear_drag", *ROTORS))
    return body("linear_drag", {"d": (d, "N.s/m")}, *rivals, force=lambda _t, _q, v: -d * HORIZONTAL * v)


def quadratic(c: float) -> Effect:
    return body("quadratic_drag", {"c": (c, "N.s2/m2")}, force=lambda _t, _q, v: -c * float(np.hypot(v[0], v[1])) * HORIZONTAL * v)


def wind(force: float, onset: float | None = None) -> Effect:
    """A force that is constant in the axes of the earth."""
    push = force * np.array([0.8, 0.6, 0.0])

    def acting(_t: float, q: np.ndarray, _v: np.ndarray) -> np.ndarray:
        return np.concatenate([rotation(q[3:7]).T @ push, np.zeros(3)])

    rivals = (("body", "external_force"), ("world", "constant_force"))
    return body("constant_force", {"f": (force, "N")}, *rivals, force=acting, onset=onset)


def off_centre(x: float, y: float) -> Effect:
    rivals = (
        *same("added_mass", "body"),
        *same("gravity", "body"),
        *same("constant_force", "body"),
        *same("input_gain", *(f"input:{u}" for u in INPUTS), *ROTORS),
    )
    return body("coupling", {"x": (x, "m"), "y": (y, "m")}, *rivals, structure={"x": x, "y": y})


def inertia(J: float) -> Effect:
    """The speed of a rotor is no signal, so that its inertia cannot be told in kg m2."""
    return body("rotor_inertia", {}, *same("rotor_inertia", *ROTORS), ("body", "coupling"), structure={"J_r": J})


def weak_rotor(number: int, gain: float, onset: float | None = None) -> Effect:
    place, faults = f"rotor_{number}", {f"u_{number}": InputFault(gain=gain)}
    rivals = ((f"input:u_{number}", "input_gain"), ("body", "coupling"))
    return Effect(place=place, physics="input_gain", parameters={"gain": (gain, "1")}, rivals=rivals, inputs=faults, onset=onset)


def late(delay: float) -> Effect:
    places = (*(f"input:{u}" for u in INPUTS), *ROTORS)
    rivals = (*same("input_delay", *places), *same("input_lag", *places))
    faults = dict.fromkeys(INPUTS, InputFault(delay=delay))
    return Effect(place="input:u_1", physics="input_delay", parameters={"delay": (delay, "s")}, rivals=rivals, inputs=faults)


def slow_down(tau: float) -> Effect:
    places = (*(f"input:{u}" for u in INPUTS), *ROTORS)
    rivals = same("asymmetric_lag", *places)
    return Effect(
        place="rotor_1", physics="asymmetric_lag", parameters={"tau_down": (tau, "s")}, rivals=rivals, structure={"tau_down": tau}
    )


def sensor(output: str, physics: str, told: Told, *rivals: tuple[str, str], **fault: Any) -> Effect:
    faults = {output: SensorFault(**fault)}
    return Effect(place=f"sensor:{output}", physics=physics, parameters=told, rivals=rivals, sensors=faults)


def turned(angle: float) -> Effect:
    """The accelerometer, about the body's x axis."""
    faults = {"ay": SensorFault(angle=angle, other="az"), "az": SensorFault(angle=-angle, other="ay")}
    rivals = (*same("sensor_misalignment", "sensor:az", "accelerometer"), *same("sensor_bias", "sensor:ay"))
    return Effect(place="sensor:ay", physics="sensor_misalignment", parameters={"angle": (angle, "rad")}, rivals=rivals, sensors=faults)


def unknown(axis: int, function: Callable[[float, np.ndarray, np.ndarray], float], place: str = "body") -> Effect:
    """A force or torque of the body along `axis` (0..5) as a function of t, q and v."""

    def acting(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        out = np.zeros(6)
        out[axis] = function(t, q, v)
        return out

    return Effect(place=place, physics="unknown_physics", rivals=((place, "external_force"),), force=acting)


def chirp(amplitude: float) -> Callable[[float, np.ndarray, np.ndarray], float]:
    law = laws.chirp(amplitude, 0.3, 0.05)
    return lambda t, _q, _v: law(t, 0.0, 0.0)


NOT_SURE = ("undecided",)
FAULTY = (
    Case(kind="linear_rotor_drag", effects=lambda d: (drag(0.9 * d.size),), motions=("steps", "multisine"), core=True),
    Case(kind="linear_rotor_drag", effects=lambda d: (drag(0.25 * d.size),), strength="weak", motions=("multisine", "trapezoids")),
    Case(kind="quadratic_drag", effects=lambda d: (quadratic(0.7 * d.size),), motions=("trapezoids", "multisine")),
    Case(
        kind="off_centre_mass",
        effects=lambda d: (off_centre(1.0e-3 * d.size, -0.6e-3 * d.size),),
        also=("undecided", "input"),
        motions=("multisine", "steps"),
        core=True,
    ),
    Case(
        kind="input_delay",
        effects=lambda d: (late(0.0127 * d.size),),
        strength="weak",
        verdict="input",
        also=("undecided", "missing_physics", "sensor"),
        motions=("multisine", "steps"),
    ),
    Case(
        kind="asymmetric_lag",
        effects=lambda d: (slow_down(d.values["rotor.tau"] * (1 + 0.8 * d.size)),),
        verdict="input",
        also=("undecided", "missing_physics"),
        motions=("multisine", "steps"),
    ),
    Case(
        kind="weak_rotor",
        effects=lambda d: (weak_rotor(2, 1 - 0.05 * d.size),),
        verdict="input",
        also=("undecided", "missing_physics"),
        motions=("steps", "multisine"),
        core=True,
    ),
    Case(
        kind="weak_rotor",
        effects=lambda d: (weak_rotor(4, 1 - 0.015 * d.size),),
        strength="weak",
        verdict="input",
        also=("undecided", "missing_physics"),
        motions=("multisine", "steps"),
    ),
    Case(
        kind="accelerometer_bias",
        effects=lambda d: (sensor("ax", "sensor_bias", {"bias": (0.35 * d.size, "m/s2")}, ("body", "constant_force"), bias=0.35 * d.size),),
        verdict="sensor",
        also=("undecided", "missing_physics"),
    ),
    Case(
        kind="accelerometer_misalignment",
        effects=lambda d: (turned(0.05 * d.size),),
        verdict="sensor",
        also=("undecided", "missing_physics"),
        motions=("multisine", "steps"),
    ),
    Case(
        kind="gyro_bias",
        effects=lambda d: (sensor("q", "sensor_bias", {"bias": (0.05 * d.size, "rad/s")}, ("body", "constant_force"), bias=0.05 * d.size),),
        verdict="sensor",
        also=("undecided", "missing_physics"),
        motions=("steps", "multisine"),
    ),
    Case(kind="constant_wind", effects=lambda d: (wind(1.2 * d.size),), also=("undecided", "sensor"), motions=("multisine", "trapezoids")),
    Case(kind="rotor_inertia", effects=lambda d: (inertia(2e-5 * d.size),), motions=("trapezoids", "multisine")),
    Case(kind="wrong:body.Ixx", effects=wrong("body.Ixx", 1.15), strength="parameter", verdict="parameter", motions=("multisine", "steps")),
    Case(
        kind="wrong:rotor.tau",
        effects=wrong("rotor.tau", 1.15),
        strength="parameter",
        verdict="parameter",
        motions=("trapezoids", "multisine"),
    ),
    Case(
        kind="drag+weak_rotor",
        effects=lambda d: (drag(0.8 * d.size), weak_rotor(3, 1 - 0.05 * d.size)),
        also=("undecided", "input"),
        motions=("multisine", "steps"),
    ),
    Case(
        kind="onset:weak_rotor",
        effects=lambda d: (weak_rotor(1, 1 - 0.06 * d.size, onset=20.0),),
        verdict="input",
        also=("undecided", "missing_physics"),
        motions=("multisine", "steps"),
    ),
    Case(
        kind="onset:gust",
        effects=lambda d: (wind(1.6 * d.size, onset=18.0),),
        also=("undecided", "sensor", "unknown_physics"),
        motions=("steps", "multisine"),
    ),
    Case(
        kind="unknown:chirp_pitch",
        effects=lambda d: (unknown(4, chirp(0.003 * d.size)),),
        verdict="unknown_physics",
        also=NOT_SURE,
        motions=("multisine", "steps"),
    ),
    Case(
        kind="unknown:aerodynamic_roll",
        effects=lambda d: (unknown(3, lambda _t, _q, w: 0.001 * d.size * w[0] * np.sin(3 * w[1])),),
        verdict="unknown_physics",
        also=NOT_SURE,
        motions=("steps", "multisine"),
    ),
)


class Rack(Bench):
    """The quadrotor of the suite."""

    plant = "quadrotor"
    base: ClassVar[Mapping[str, float]] = {
        "body.Ixx": 0.016,
        "body.Iyy": 0.017,
        "body.Izz": 0.029,
        "body.drag_w": 0.33,
        "body.drag_p": 0.55,
        "body.drag_q": 0.55,
        "body.drag_r": 0.35,
        "rotor.tau": 0.055,
        "rotor.gain": 3.1,
    }
    known: ClassVar[Mapping[str, float]] = {"body.m": 1.5, "rotor.torque_ratio": 0.018, "arm": 0.3}
    order = (
        "body.m", "body.Ixx", "body.Iyy", "body.Izz", "body.drag_w", "body.drag_p", "body.drag_q", "body.drag_r",
        "rotor.tau", "rotor.gain", "rotor.torque_ratio", "arm",
    )  # fmt: skip
    inputs = INPUTS
    conditions = CONDITIONS
    force: ClassVar[Mapping[str, float]] = {
        "body.f_x": 4.0,
        "body.f_y": 4.0,
        "body.f_z": 14.7,
        "body.tau_x": 0.05,
        "body.tau_y": 0.05,
        "body.tau_z": 0.02,
    }
    cases = (*CLEAN, *FAULTY)

    def take(self, true: Values, plain: Values, effects: tuple[Effect, ...], case: Case, motion: str, seed: list[int]) -> Taken:
        """One recording."""
        structure = {name: value for e in effects for name, value in e.structure.items()}
        setting = conditions(case, self.conditions, self.force)
        time = clock(setting.conditions, np.random.default_rng([*seed, 0]))
        craft = replace(Craft(craft=with_values(true)), **structure)
        moves = stick(motion, time, case.size, PILOT, np.random.default_rng([*seed, 1]))
        trace = fly(craft, PILOT, moves, setting, effects, np.random.default_rng([*seed, 0]))
        return Taken(
            time=trace.time,
            inputs=dict(zip(self.inputs, trace.commands.T, strict=True)),
            outputs=trace.recorded(craft.outputs, effects),
            clean=dict(zip(craft.outputs, trace.clean.T, strict=True)),
            shares=shares(Craft(craft=with_values(plain)), trace) | self.thrusts(trace.commands, trace.acted),
        )

    def thrusts(self, commands: np.ndarray, acted: np.ndarray) -> dict[str, float]:
        """Share of each rotor's thrust that its command is off by, under both its names."""
        off = np.sqrt(((acted**2 - commands**2) ** 2).mean(axis=0) / (commands**4).mean(axis=0))
        return {name: float(off[i]) for names in (ROTORS, [f"input:{u}" for u in INPUTS]) for i, name in enumerate(names)}


BENCH = Rack()
