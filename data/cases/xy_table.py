"""Concealed cases of the gantry table."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ..generators.concealed.acting import InputFault
from ..generators.concealed.effects import Coulomb, Effect, Law, Wrench, laws
from ..generators.concealed.rig import Control, Machine
from ..generators.concealed.sensing import SensorFault
from ..generators.concealed.xy_table import CONDITIONS, Gantry, position
from ..generators.xy_table import Table, with_values
from .case import CLEAN, Case, RigBench, Values, same, wrong

__all__ = ["BENCH"]

R = Table().r


def wheel(i: int, law: Law) -> Wrench:
    """The law of an angle and an angular velocity, as a torque on wheel i; for as many coordinates as there are."""

    def force(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        out = np.zeros(q.size)
        out[i] = -law(t, float(q[i]) / R, float(v[i]) / R) / R
        return out

    return force


def drive(number: int, physics: str, told: Mapping[str, tuple[float, str]], *rivals: tuple[str, str], **how: Any) -> Effect:
    """An effect at a wheel."""
    others = (*same(physics, f"friction_{number}"), *rivals)
    return Effect(place=f"drive_{number}", physics=physics, parameters=told, rivals=others, **how)


def coulomb(number: int, tau: float) -> Effect:
    name = f"friction_{number}.tau_c"
    return drive(number, "coulomb_friction", {"tau_c": (tau, "N.m")}, values={name: tau}, absent=(name,))


def viscous(number: int, d: float) -> Effect:
    rivals = same("damping", f"drive_{number}") + same("linear_drag", f"drive_{number}")
    told = {"d": (d, "N.m.s/rad")}
    return drive(number, "viscous_friction", told, *rivals, values={f"friction_{number}.d": d})


def asymmetric(number: int, plus: float, minus: float) -> Effect:
    told = {"d_plus": (plus, "N.m.s/rad"), "d_minus": (minus, "N.m.s/rad")}
    return drive(number, "asymmetric_friction", told, force=wheel(number - 1, laws.asymmetric_viscous(plus, minus)))


def stribeck(v: Values, number: int, more: float, v_s: float) -> Effect:
    told = {"tau_s": (v[f"friction_{number}.tau_c"] + more, "N.m"), "v_s": (v_s, "rad/s")}
    extra = Coulomb(i=number - 1, level=more / R)
    return drive(number, "stribeck_friction", told, friction=(extra,), force=wheel(number - 1, laws.stribeck(more, v_s)))


def belt(number: int, k: float) -> Effect:
    rivals = (*same("compliance", f"belt_{number}"), (f"slide_{number}", "compliance"))
    structure = {"belt": number - 1, "k_b": k, "d_b": 60.0}
    return Effect(place=f"drive_{number}", physics="compliance", parameters={"k": (k, "N/m")}, rivals=rivals, structure=structure)


def eccentric(e: float) -> Effect:
    rivals = (*same("eccentricity", "drive_1", "wheel_1", "belt_1"), *same("kinematic_error", "wheel_1", "belt_1"))
    return Effect(place="drive_1", physics="kinematic_error", parameters={"amplitude": (e, "m")}, rivals=rivals, structure={"e": e})


def spindle(physics: str, told: Mapping[str, tuple[float, str]], **how: Any) -> Effect:
    return Effect(place="spindle", physics=physics, parameters=told, **how)


def inertia(J: float) -> Effect:
    rivals = (*same("rotor_inertia", "drive_2"), *same("drive_2.J", "drive_2"), *same("wrong_parameter", "drive_2"))
    return Effect(place="drive_2", physics="added_mass", rivals=rivals, values={"drive_2.J": J}, absent=("drive_2.J",))


def sensor(output: str, physics: str, told: Mapping[str, tuple[float, str]], *rivals: tuple[str, str], **fault: Any) -> Effect:
    return Effect(
        place=f"sensor:{output}",
        physics=physics,
        parameters=told,
        rivals=rivals,
        sensors={output: SensorFault(**fault)},
    )


def turned(angle: float) -> Effect:
    faults = {"ax_r": SensorFault(angle=angle, other="ay_r"), "ay_r": SensorFault(angle=-angle, other="ax_r")}
    rivals = (*same("sensor_misalignment", "sensor:ay_r", "accelerometer"),)
    return Effect(place="sensor:ax_r", physics="sensor_misalignment", parameters={"angle": (angle, "rad")}, rivals=rivals, sensors=faults)


def command(name: str, physics: str, parameter: str, value: float, unit: str, onset: float | None = None) -> Effect:
    rivals = tuple((f"input:{name}", other) for other in ("input_lag", "input_delay")) if physics in ("input_lag", "input_delay") else ()
    faults = {name: InputFault(**{parameter: value})}
    place = f"input:{name}"
    return Effect(place=place, physics=physics, parameters={parameter: (value, unit)}, rivals=rivals, inputs=faults, onset=onset)


def ripple(amplitude: float, period: float) -> Effect:
    told = {"amplitude": (amplitude, "N.m"), "period": (period, "rad")}
    rivals = (("drive_1", "cogging"), ("drive_1", "torque_ripple"), ("input:I_x", "cogging"), ("motor_x", "torque_ripple"))
    law = wheel(0, laws.cogging(amplitude, period, 0.4))
    return Effect(place="input:I_x", physics="torque_ripple", parameters=told, rivals=rivals, force=law)


def unknown(number: int, law: Law) -> Effect:
    return Effect(
        place=f"drive_{number}", physics="unknown_physics", rivals=((f"drive_{number}", "external_force"),), force=wheel(number - 1, law)
    )


def gain(output: str, value: float) -> Effect:
    return sensor(output, "sensor_gain", {"gain": (value, "1")}, gain=value)


NOT_SURE = ("undecided",)
FAULTY = (
    Case(kind="coulomb_drive_2", effects=lambda d: (coulomb(2, 0.030 * d.size),), core=True),
    Case(kind="coulomb_drive_2", effects=lambda d: (coulomb(2, 0.007 * d.size),), strength="weak", motions=("multisine", "steps")),
    Case(kind="viscous_drive_2", effects=lambda d: (viscous(2, 1.2e-3 * d.size),), motions=("multisine", "trapezoids")),
    Case(kind="viscous_drive_1", effects=lambda d: (viscous(1, 2e-3 * d.size),), strength="weak"),
    Case(kind="eccentric_wheel", effects=lambda d: (eccentric(2.5e-3 * d.size),), motions=("trapezoids", "multisine")),
    Case(kind="slide_belt_elasticity", effects=lambda d: (belt(1, 40e3 / d.size),), motions=("steps", "trapezoids")),
    Case(kind="tool_belt_elasticity", effects=lambda d: (belt(3, 30e3 / d.size),), motions=("trapezoids", "multisine")),
    Case(
        kind="asymmetric_y_friction", effects=lambda d: (asymmetric(3, 2.4e-3 * d.size, 0.8e-3 * d.size),), motions=("multisine", "chirp")
    ),
    Case(kind="asymmetric_y_friction", effects=lambda d: (asymmetric(3, 5e-4 * d.size, 1e-4 * d.size),), strength="weak"),
    Case(
        kind="spindle_damping",
        effects=lambda d: (
            spindle(
                "damping",
                {"d": (4e-3 * d.size, "N.m.s/rad")},
                rivals=same("viscous_friction", "spindle"),
                values={"spindle.d": 4e-3 * d.size},
            ),
        ),
        motions=("multisine", "steps"),
        core=True,
    ),
    Case(
        kind="cubic_spindle",
        effects=lambda d: (spindle("cubic_spring", {"k3": (0.05 * d.size, "N.m/rad3")}, structure={"k_3": 0.05 * d.size}),),
        motions=("trapezoids", "multisine"),
    ),
    Case(kind="inertia_drive_2", effects=lambda d: (inertia(2e-4 * d.size),), also=("parameter",), motions=("steps", "multisine")),
    Case(kind="stribeck_y", effects=lambda d: (stribeck(d.values, 3, 0.06 * d.size, 4.0),), motions=("multisine", "steps")),
    Case(kind="sensor_gain:x_r", effects=lambda d: (gain("x_r", 1 + 0.08 * d.size),), verdict="sensor", core=True),
    Case(kind="sensor_gain:x_r", effects=lambda d: (gain("x_r", 1 + 0.025 * d.size),), verdict="sensor", strength="weak"),
    Case(kind="sensor_gain:x_m", effects=lambda d: (gain("x_m", 1 - 0.06 * d.size),), verdict="sensor", motions=("multisine", "steps")),
    Case(
        kind="sensor_bias:ax_r",
        effects=lambda d: (sensor("ax_r", "sensor_bias", {"bias": (0.4 * d.size, "m/s2")}, bias=0.4 * d.size),),
        verdict="sensor",
        motions=("multisine", "trapezoids"),
    ),
    Case(
        kind="sensor_delay:x_r",
        effects=lambda d: (
            sensor("x_r", "sensor_delay", {"delay": (0.0163 * d.size, "s")}, ("sensor:x_r", "sensor_lag"), delay=0.0163 * d.size),
        ),
        verdict="sensor",
    ),
    Case(
        kind="sensor_lag:ay_r",
        effects=lambda d: (
            sensor("ay_r", "sensor_lag", {"tau": (0.004 * d.size, "s")}, ("sensor:ay_r", "sensor_delay"), tau=0.004 * d.size),
        ),
        verdict="sensor",
        motions=("multisine", "steps"),
    ),
    Case(
        kind="sensor_drift:y_r",
        effects=lambda d: (
            sensor("y_r", "sensor_drift", {"rate": (2.5e-4 * d.size, "m/s")}, ("sensor:y_m", "sensor_drift"), rate=2.5e-4 * d.size),
        ),
        verdict="sensor",
        strength="weak",
    ),
    Case(kind="sensor_misalignment", effects=lambda d: (turned(0.08 * d.size),), verdict="sensor", motions=("multisine", "trapezoids")),
    Case(
        kind="torque_ripple:I_x",
        effects=lambda d: (ripple(0.11 * d.size, 2 * np.pi / 7),),
        verdict="input",
        also=("missing_physics", "undecided"),
    ),
    Case(kind="input_dead_zone:I_y", effects=lambda d: (command("I_y", "input_dead_zone", "width", 0.3 * d.size, "A"),), verdict="input"),
    Case(
        kind="input_saturation:I_x",
        effects=lambda d: (command("I_x", "input_saturation", "limit", 5.0 / d.size, "A"),),
        verdict="input",
        motions=("multisine", "trapezoids"),
    ),
    Case(
        kind="input_delay:I_x",
        effects=lambda d: (command("I_x", "input_delay", "delay", 0.0027 * d.size, "s"),),
        verdict="input",
        also=NOT_SURE,
        motions=("trapezoids", "chirp"),
    ),
    Case(kind="wrong:drive_1.J", effects=wrong("drive_1.J", 0.85), strength="parameter", verdict="parameter", core=True),
    Case(
        kind="wrong:spindle.k", effects=wrong("spindle.k", 1.15), strength="parameter", verdict="parameter", motions=("multisine", "steps")
    ),
    Case(kind="wrong:friction_3.tau_c", effects=wrong("friction_3.tau_c", 0.85), strength="parameter", verdict="parameter"),
    Case(
        kind="coulomb_drive_2+sensor_gain:x_r",
        effects=lambda d: (coulomb(2, 0.025 * d.size), gain("x_r", 1 + 0.06 * d.size)),
        also=("sensor",),
        motions=("multisine", "steps"),
    ),
    Case(
        kind="asymmetric_y+spindle_damping",
        effects=lambda d: (
            asymmetric(3, 2.4e-3 * d.size, 0.8e-3 * d.size),
            spindle("damping", {"d": (3e-3 * d.size, "N.m.s/rad")}, values={"spindle.d": 3e-3 * d.size}),
        ),
    ),
    Case(
        kind="onset:coulomb_drive_2",
        effects=lambda d: (
            drive(2, "coulomb_friction", {"tau_c": (0.04 * d.size, "N.m")}, friction=(Coulomb(i=1, level=0.04 * d.size / R),), onset=4.0),
        ),
    ),
    Case(
        kind="onset:input_gain:I_y",
        effects=lambda d: (command("I_y", "input_gain", "gain", 1 - 0.12 * d.size, "1", onset=4.4),),
        verdict="input",
        motions=("multisine", "steps"),
    ),
    Case(
        kind="unknown:whirl_drive_2",
        effects=lambda d: (unknown(2, laws.whirl(2e-3 * d.size, 1.5)),),
        verdict="unknown_physics",
        also=NOT_SURE,
        motions=("multisine", "trapezoids"),
    ),
    Case(
        kind="unknown:chirp_drive_3",
        effects=lambda d: (unknown(3, laws.chirp(0.02 * d.size, 2.0, 1.2)),),
        verdict="unknown_physics",
        also=NOT_SURE,
    ),
)


class Rack(RigBench):
    """The gantry of the suite."""

    plant = "xy_table"
    base: ClassVar[Mapping[str, float]] = {
        "spindle.k": 0.42,
        "drive_1.J": 2.1e-3,
        "drive_3.J": 2.2e-4,
        "friction_1.tau_c": 0.38,
        "friction_3.tau_c": 0.13,
        "spindle.d": 0.0,
        "drive_2.J": 0.0,
        "friction_2.tau_c": 0.0,
    }
    absent = ("spindle.d", "drive_2.J", "friction_2.tau_c")
    order = (
        "spindle.k", "spindle.d", "drive_1.J", "drive_2.J", "drive_3.J", "friction_1.tau_c", "friction_2.tau_c", "friction_3.tau_c"
    )  # fmt: skip
    inputs = ("I_x", "I_y")
    conditions = CONDITIONS
    force: ClassVar[Mapping[str, float]] = {"drive_1": 80.0, "drive_2": 24.0, "drive_3": 15.0}  # N
    cases = (*CLEAN, *FAULTY)

    def machine(self, values: Values, structure: Mapping[str, Any]) -> Machine:
        """The gantry."""
        return Gantry(table=with_values(values), **structure)

    def control(self, machine: Machine, case: Case, motion: str, time: np.ndarray, step: float, rng: np.random.Generator) -> Control:
        """The positions of the motors."""
        del machine
        return position(motion, time, step, case.size, rng)


BENCH = Rack()
