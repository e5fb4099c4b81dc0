"""Concealed cases of the drillstring."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ..generators.concealed.acting import InputFault
from ..generators.concealed.drillstring import CONDITIONS, Rig, speed
from ..generators.concealed.effects import Coulomb, Effect, Law, Wrench, laws
from ..generators.concealed.rig import Control, Machine
from ..generators.concealed.sensing import SensorFault
from ..generators.drillstring import with_values
from .case import CLEAN, Case, RigBench, Values, same, wrong

__all__ = ["BENCH"]

TABLE, BIT = 1, 2
Told = Mapping[str, tuple[float, str]]


def turning(i: int, law: Law) -> Wrench:
    """The law as a torque on the table or the bit; the bit's and the table's angles count from the start."""

    def force(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        out = np.zeros(q.size)
        out[i] = -law(t, float(q[i]), float(v[i]))
        return out

    return force


def stick_slip(sliding: float, breakaway: float) -> Effect:
    told = {"tau_sl": (sliding, "N.m"), "tau_st": (breakaway, "N.m")}
    values = {"bit.tau_sl": sliding, "bit.tau_st": breakaway}
    rivals = (
        *same("stick_slip", "bit"),
        *same("coulomb_friction", "bha", "bit"),
        *same("stribeck_friction", "bha", "bit"),
    )
    return Effect(place="bha", physics="stick_slip", parameters=told, rivals=rivals, values=values, absent=tuple(values))


def table(tau: float, onset: float | None = None) -> Effect:
    told = {"tau_c": (tau, "N.m")}
    friction = (Coulomb(i=TABLE, level=tau),)
    return Effect(
        place="rotary_table",
        physics="coulomb_friction",
        parameters=told,
        friction=friction,
        onset=onset,
        rivals=same("coulomb_friction", "motor"),
    )


def harder(tau: float, onset: float) -> Effect:
    rivals = (
        *same("coulomb_friction", "bit"),
        *same("stick_slip", "bha", "bit"),
        *same("stribeck_friction", "bha", "bit"),
        ("bha", "external_force"),
    )
    told = {"tau_c": (tau, "N.m")}
    return Effect(
        place="bha", physics="coulomb_friction", parameters=told, friction=(Coulomb(i=BIT, level=tau),), onset=onset, rivals=rivals
    )


def section(k: float) -> Effect:
    rivals = (("bha", "compliance"), ("string", "added_mass"), ("string", "coupling"), ("rotary_table", "compliance"))
    return Effect(place="string", physics="compliance", parameters={"k": (k, "N.m/rad")}, rivals=rivals, structure={"k_1": k, "J_s": 0.012})


def damping(d: float) -> Effect:
    rivals = same("viscous_friction", "string")
    return Effect(place="string", physics="damping", parameters={"d": (d, "N.m.s/rad")}, rivals=rivals, structure={"d": d})


def drag(place: str, i: int, c: float) -> Effect:
    told = {"c": (c, "N.m.s2/rad2")}
    return Effect(place=place, physics="quadratic_drag", parameters=told, force=turning(i, laws.quadratic_drag(c)))


def asymmetric(v: Values, plus: float, minus: float) -> Effect:
    d = v["rotary_table.d"]
    told = {"d_plus": (d + plus, "N.m.s/rad"), "d_minus": (d + minus, "N.m.s/rad")}
    law = turning(TABLE, laws.asymmetric_viscous(plus, minus))
    return Effect(place="rotary_table", physics="asymmetric_friction", parameters=told, force=law)


def sensor(output: str, physics: str, told: Told, *rivals: tuple[str, str], **fault: Any) -> Effect:
    faults = {output: SensorFault(**fault)}
    return Effect(place=f"sensor:{output}", physics=physics, parameters=told, rivals=rivals, sensors=faults)


def command(physics: str, parameter: str, value: float, unit: str, *rivals: tuple[str, str], onset: float | None = None) -> Effect:
    faults = {"V": InputFault(**{parameter: value})}
    return Effect(place="input:V", physics=physics, parameters={parameter: (value, unit)}, rivals=rivals, inputs=faults, onset=onset)


def unknown(place: str, i: int, law: Law) -> Effect:
    return Effect(place=place, physics="unknown_physics", rivals=((place, "external_force"),), force=turning(i, law))


GAIN_I = (("motor", "motor.R"), ("motor", "wrong_parameter"))
OFFSET = (("input:V", "input_offset"), ("motor", "constant_force"))
SENSOR, NOT_SURE = ("undecided", "sensor"), ("undecided",)
FAULTY = (
    Case(kind="stick_slip", effects=lambda d: (stick_slip(0.22 * d.size, 0.30 * d.size),), motions=("slow", "steps"), core=True),
    Case(
        kind="stick_slip", effects=lambda d: (stick_slip(0.005 * d.size, 0.006 * d.size),), strength="weak", motions=("multisine", "steps")
    ),
    Case(kind="coulomb_table", effects=lambda d: (table(0.09 * d.size),), motions=("steps", "multisine"), core=True),
    Case(kind="coulomb_table", effects=lambda d: (table(0.011 * d.size),), strength="weak", motions=("multisine", "slow"), both=True),
    Case(kind="second_string_section", effects=lambda d: (section(0.7 / d.size),), motions=("multisine", "steps"), also=NOT_SURE),
    Case(kind="string_damping", effects=lambda d: (damping(0.030 * d.size),), motions=("steps", "multisine")),
    Case(kind="string_damping", effects=lambda d: (damping(0.007 * d.size),), strength="weak", motions=("multisine", "steps"), core=True),
    Case(kind="quadratic_drag_bit", effects=lambda d: (drag("bha", BIT, 2e-3 * d.size),), motions=("multisine", "steps")),
    Case(
        kind="asymmetric_table",
        effects=lambda d: (asymmetric(d.values, 0.04 * d.size, -0.02 * d.size),),
        motions=("multisine", "steps"),
        both=True,
    ),
    Case(kind="wrong:motor.R", effects=wrong("motor.R", 1.15), strength="parameter", verdict="parameter", also=SENSOR, core=True),
    Case(
        kind="wrong:motor.Km",
        effects=wrong("motor.Km", 0.85),
        strength="parameter",
        verdict="parameter",
        also=SENSOR,
        motions=("multisine", "steps"),
    ),
    Case(kind="wrong:string.k", effects=wrong("string.k", 1.15), strength="parameter", verdict="parameter"),
    Case(
        kind="sensor_gain:I_m",
        effects=lambda d: (sensor("I_m", "sensor_gain", {"gain": (1 + 0.12 * d.size, "1")}, *GAIN_I, gain=1 + 0.12 * d.size),),
        verdict="sensor",
        also=("undecided", "parameter"),
        motions=("multisine", "steps"),
    ),
    Case(
        kind="sensor_bias:Omega_r",
        effects=lambda d: (sensor("Omega_r", "sensor_bias", {"bias": (0.25 * d.size, "rad/s")}, *OFFSET, bias=0.25 * d.size),),
        verdict="sensor",
        also=("undecided", "input"),
    ),
    Case(
        kind="sensor_lag:Omega_r",
        effects=lambda d: (
            sensor("Omega_r", "sensor_lag", {"tau": (0.12 * d.size, "s")}, ("sensor:Omega_r", "sensor_delay"), tau=0.12 * d.size),
        ),
        verdict="sensor",
        motions=("steps", "multisine"),
    ),
    Case(
        kind="input_offset",
        effects=lambda d: (
            command("input_offset", "offset", 4.0 * d.size, "V", ("sensor:Omega_r", "sensor_bias"), ("motor", "constant_force")),
        ),
        verdict="input",
        also=("undecided", "sensor", "missing_physics"),
    ),
    Case(
        kind="input_gain",
        effects=lambda d: (command("input_gain", "gain", 1 - 0.09 * d.size, "1"),),
        verdict="input",
        also=NOT_SURE,
        motions=("multisine", "steps"),
    ),
    Case(
        kind="input_delay",
        effects=lambda d: (command("input_delay", "delay", 0.05 * d.size, "s", ("input:V", "input_lag")),),
        strength="weak",
        verdict="input",
        also=NOT_SURE,
        motions=("steps", "trapezoids"),
    ),
    Case(kind="onset:coulomb_table", effects=lambda d: (table(0.12 * d.size, onset=20.0),), motions=("multisine", "steps")),
    Case(kind="onset:harder_rock", effects=lambda d: (harder(0.12 * d.size, onset=18.0),), motions=("steps", "multisine")),
    Case(
        kind="coulomb_table+string_damping",
        effects=lambda d: (table(0.09 * d.size), damping(0.012 * d.size)),
        motions=("multisine", "steps"),
    ),
    Case(
        kind="unknown:chirp_table",
        effects=lambda d: (unknown("rotary_table", TABLE, laws.chirp(0.12 * d.size, 0.2, 0.04)),),
        verdict="unknown_physics",
        also=NOT_SURE,
    ),
    Case(
        kind="unknown:bumps_bit",
        effects=lambda d: (unknown("bha", BIT, laws.bumps(0.25 * d.size, np.array([5.0, 8.0, 14.0, 19.0, 27.0, 30.0, 36.0]), 0.4)),),
        verdict="unknown_physics",
        also=NOT_SURE,
        motions=("multisine", "steps"),
    ),
)


class Rack(RigBench):
    """The drillstring of the suite."""

    plant = "drillstring"
    base: ClassVar[Mapping[str, float]] = {
        "rotary_table.J": 0.3,
        "rotary_table.d": 0.03,
        "string.k": 0.0868,
        "bha.J": 0.0529,
        "bha.d": 1e-3,
        "bit.tau_sl": 0.4,
        "bit.tau_st": 0.6,
    }
    known: ClassVar[Mapping[str, float]] = {"motor.L": 0.116, "motor.R": 22.0, "motor.Km": 11.0}
    order = (
        "motor.L", "motor.R", "motor.Km", "rotary_table.J", "rotary_table.d", "string.k", "bha.J", "bha.d", "bit.tau_sl", "bit.tau_st"
    )  # fmt: skip
    inputs = ("V",)
    conditions = CONDITIONS
    force: ClassVar[Mapping[str, float]] = {"rotary_table": 0.8, "bha": 0.45}
    cases = (*CLEAN, *FAULTY)

    def machine(self, values: Values, structure: Mapping[str, Any]) -> Machine:
        """The drillstring."""
        return Rig(string=with_values(values), **structure)

    def control(self, machine: Machine, case: Case, motion: str, time: np.ndarray, step: float, rng: np.random.Generator) -> Control:
        """The speed of the table."""
        del machine
        return speed(motion, time, step, case.size, rng, case.both)


BENCH = Rack()
