"""Concealed cases of the axis."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ..generators.concealed.acting import InputFault
from ..generators.concealed.actuator import CONDITIONS, Axis, position
from ..generators.concealed.effects import Coulomb, Effect, Law, Wrench, laws, on
from ..generators.concealed.rig import Control, Machine
from .case import CLEAN, Case, RigBench, Values, same, wrong

__all__ = ["BENCH"]

SOFT = 0.4  # gains of the control with an elastic screw


def friction(physics: str, parameters: Mapping[str, tuple[float, str]], rivals: tuple[tuple[str, str], ...] = (), **how: Any) -> Effect:
    """Friction of the carriage, wherever along the rigid screw it is placed."""
    others = (*same(physics, "friction", "screw"), *rivals)
    return Effect(place="carriage", physics=physics, parameters=parameters, rivals=others, **how)


def at(law: Law) -> Wrench:
    """The law as a force on the carriage."""
    return on(0, 1, law)


def coulomb(level: float) -> Effect:
    return friction("coulomb_friction", {"f_c": (level, "N")}, values={"friction.f_c": level}, absent=("friction.f_c",))


def stribeck(v: Values, more: float, v_s: float) -> Effect:
    told = {"f_s": (v["friction.f_c"] + more, "N"), "v_s": (v_s, "m/s")}
    return friction("stribeck_friction", told, friction=(Coulomb(i=0, level=more),), force=at(laws.stribeck(more, v_s)))


V_0 = 0.0254  # m/s: c of the logarithmic law is told at one inch per second, where the literature has it


def logarithmic(s: float) -> Effect:
    b, c, v_dead = 5.0 * s, 46.0 * s, 1e-3
    level = c + b * np.log(v_dead)
    told = {"b": (b, "N"), "c": (c + b * np.log(V_0), "N")}
    return friction(
        "logarithmic_friction",
        told,
        friction=(Coulomb(i=0, level=level),),
        force=at(laws.logarithmic(b, v_dead)),
        values={"friction.f_c": 0.0},
        absent=("friction.f_c",),
    )


def asymmetric(v: Values, share: float) -> Effect:
    d = v["friction.d"]
    told = {"d_plus": (d * (1 + share), "N.s/m"), "d_minus": (d * (1 - share), "N.s/m")}
    return friction("asymmetric_friction", told, force=at(laws.asymmetric_viscous(d * share, -d * share)))


def cogging(amplitude: float, period: float, phase: float = 0.0) -> Effect:
    rivals = (("screw", "cogging"), ("input:F", "cogging"), ("input:F", "torque_ripple"), ("motor", "cogging"), ("screw", "eccentricity"))
    told = {"amplitude": (amplitude, "N"), "period": (period, "m")}
    return Effect(place="carriage", physics="cogging", parameters=told, rivals=rivals, force=at(laws.cogging(amplitude, period, phase)))


def screw(physics: str, told: Mapping[str, tuple[float, str]], **structure: Any) -> Effect:
    rivals = (("carriage", physics), ("screw", "compliance"), ("screw", "backlash"))
    return Effect(place="screw", physics=physics, parameters=told, rivals=rivals, structure=structure)


def constant(f: float) -> Effect:
    rivals = (
        ("offset", "constant_force"),
        ("carriage", "external_force"),
        ("carriage", "gravity"),
        ("carriage", "asymmetric_friction"),
        ("friction", "asymmetric_friction"),
        ("input:F", "input_offset"),
        ("offset", "offset.f"),
        ("offset", "wrong_parameter"),
    )
    law = at(laws.constant(f))
    return Effect(place="carriage", physics="constant_force", parameters={"f": (f, "N")}, rivals=rivals, force=law)


def late(physics: str, **fault: Any) -> Effect:
    told = {"delay" if physics == "input_delay" else "tau": (next(iter(fault.values())), "s")}
    rivals = (("input:F", "input_lag"), ("input:F", "input_delay"), ("sensor:x", "sensor_delay"), ("sensor:x", "sensor_lag"))
    return Effect(place="input:F", physics=physics, parameters=told, rivals=rivals, inputs={"F": InputFault(**fault)})


def command(physics: str, parameter: str, value: float, unit: str, onset: float | None = None) -> Effect:
    fault = InputFault(**{parameter: value})
    return Effect(place="input:F", physics=physics, parameters={parameter: (value, unit)}, inputs={"F": fault}, onset=onset)


def potential(physics: str, told: Mapping[str, tuple[float, str]], law: Law) -> Effect:
    return Effect(place="carriage", physics=physics, parameters=told, rivals=same(physics, "screw"), force=at(law))


def unknown(law: Law, *rivals: tuple[str, str]) -> Effect:
    others = (("carriage", "external_force"), ("screw", "unknown_physics"), *rivals)
    return Effect(place="carriage", physics="unknown_physics", rivals=others, force=at(law))


def wavy(v: Values, s: float) -> Effect:
    level = 0.6 * s * v["friction.f_c"]
    wave = Coulomb(i=0, level=level, factor=lambda x: float(np.sin(2 * np.pi * x / 0.12)))
    return friction("position_dependent_friction", {"period": (0.12, "m")}, friction=(wave,))


LATE = ("undecided", "sensor")
FAULTY = (
    Case(kind="coulomb", effects=lambda d: (coulomb(15 * d.size),), core=True),
    Case(kind="coulomb", effects=lambda d: (coulomb(2.5 * d.size),), strength="weak", motions=("multisine", "trapezoids")),
    Case(kind="stribeck", effects=lambda d: (stribeck(d.values, 45 * d.size, 0.07),), motions=("steps", "multisine"), size=0.7),
    Case(kind="stribeck", effects=lambda d: (stribeck(d.values, 18 * d.size, 0.03),), strength="weak", core=True),
    Case(kind="logarithmic", effects=lambda d: (logarithmic(d.size),), base={"friction.d": 60.0}),
    Case(kind="asymmetric_viscous", effects=lambda d: (asymmetric(d.values, 0.3 * d.size),), motions=("trapezoids", "multisine", "chirp")),
    Case(
        kind="asymmetric_viscous", effects=lambda d: (asymmetric(d.values, 0.09 * d.size),), strength="weak", motions=("steps", "multisine")
    ),
    Case(kind="cogging", effects=lambda d: (cogging(16 * d.size, 0.02),), motions=("multisine", "steps")),
    Case(kind="cogging", effects=lambda d: (cogging(5 * d.size, 0.012, 1.0),), strength="weak", core=True),
    Case(
        kind="backlash",
        effects=lambda d: (screw("backlash", {"gap": (1e-4 * d.size, "m")}, k=1e6, gap=1e-4 * d.size),),
        also=("undecided",),
    ),
    Case(
        kind="backlash_behind",
        effects=lambda d: (screw("backlash", {"gap": (3e-4 * d.size, "m")}, k=1e6, gap=3e-4 * d.size, encoder="carriage"),),
        also=("undecided", "input"),
        motions=("multisine", "steps"),
    ),
    Case(
        kind="compliance",
        effects=lambda d: (screw("compliance", {"k": (1e6 / d.size, "N/m")}, k=1e6 / d.size, d_s=300.0),),
        also=("undecided",),
    ),
    Case(
        kind="compliance_behind",
        effects=lambda d: (screw("compliance", {"k": (1e6 / d.size, "N/m")}, k=1e6 / d.size, d_s=300.0, encoder="carriage"),),
        also=("undecided", "input", "sensor"),
        motions=("steps", "trapezoids"),
    ),
    Case(kind="input_saturation", effects=lambda d: (command("input_saturation", "limit", 170 / d.size, "N"),), verdict="input"),
    Case(kind="input_dead_zone", effects=lambda d: (command("input_dead_zone", "width", 14 * d.size, "N"),), verdict="input"),
    Case(kind="input_lag", effects=lambda d: (late("input_lag", tau=0.010 * d.size),), verdict="input", also=LATE, core=True),
    Case(kind="input_delay", effects=lambda d: (late("input_delay", delay=0.0053 * d.size),), verdict="input", also=LATE),
    Case(kind="input_delay", effects=lambda d: (late("input_delay", delay=0.0006 * d.size),), strength="weak", verdict="input", also=LATE),
    Case(
        kind="quadratic_drag",
        effects=lambda d: (potential("quadratic_drag", {"c": (280 * d.size, "N.s2/m2")}, laws.quadratic_drag(280 * d.size)),),
        motions=("multisine", "trapezoids"),
    ),
    Case(kind="spring", effects=lambda d: (potential("spring", {"k": (180 * d.size, "N/m")}, laws.spring(180 * d.size)),)),
    Case(
        kind="spring",
        effects=lambda d: (potential("spring", {"k": (50 * d.size, "N/m")}, laws.spring(50 * d.size)),),
        strength="weak",
        motions=("multisine", "steps"),
    ),
    Case(
        kind="cubic_spring", effects=lambda d: (potential("cubic_spring", {"k3": (2e4 * d.size, "N/m3")}, laws.spring(0.0, 2e4 * d.size)),)
    ),
    Case(
        kind="end_stop",
        effects=lambda d: (potential("end_stop", {"x": (0.09, "m"), "k": (2e3 * d.size, "N/m")}, laws.end_stop(0.09, 2e3 * d.size)),),
    ),
    Case(kind="constant_force", effects=lambda d: (constant(13 * d.size),), also=("undecided", "input", "parameter")),
    Case(kind="position_dependent_friction", effects=lambda d: (wavy(d.values, d.size),), motions=("multisine", "steps")),
    Case(
        kind="presliding",
        effects=lambda d: (
            friction(
                "presliding_friction",
                {"sigma_0": (9e4 / d.size, "N/m")},
                structure={"sigma_0": 9e4 / d.size},
                rivals=(("carriage", "stick_slip"),),
            ),
        ),
        motions=("steps", "multisine"),
        size=0.5,
    ),
    Case(
        kind="coulomb+cogging", effects=lambda d: (coulomb(14 * d.size), cogging(10 * d.size, 0.025)), motions=("multisine", "trapezoids")
    ),
    Case(
        kind="asymmetric+cubic_spring",
        effects=lambda d: (
            asymmetric(d.values, 0.25 * d.size),
            potential("cubic_spring", {"k3": (1.5e4 * d.size, "N/m3")}, laws.spring(0.0, 1.5e4 * d.size)),
        ),
    ),
    Case(kind="wrong:carriage.m", effects=wrong("carriage.m", 1.15), strength="parameter", verdict="parameter", core=True),
    Case(kind="wrong:friction.d", effects=wrong("friction.d", 0.85), strength="parameter", verdict="parameter"),
    Case(
        kind="onset:coulomb",
        effects=lambda d: (
            friction("coulomb_friction", {"f_c": (14 * d.size, "N")}, friction=(Coulomb(i=0, level=14 * d.size),), onset=5.0),
        ),
    ),
    Case(
        kind="onset:input_gain",
        effects=lambda d: (command("input_gain", "gain", 1 - 0.13 * d.size, "1", onset=6.0),),
        verdict="input",
        motions=("multisine", "trapezoids"),
    ),
    Case(
        kind="unknown:whirl", effects=lambda d: (unknown(laws.whirl(120 * d.size, 0.05)),), verdict="unknown_physics", also=("undecided",)
    ),
    Case(
        kind="unknown:chirp",
        effects=lambda d: (unknown(laws.chirp(20 * d.size, 1.0, 0.8)),),
        verdict="unknown_physics",
        also=("undecided",),
        motions=("multisine", "steps"),
    ),
    Case(
        kind="unknown:bumps",
        effects=lambda d: (unknown(laws.bumps(40 * d.size, np.array([1.1, 2.9, 4.2, 6.6, 7.4, 9.1]), 0.08)),),
        verdict="unknown_physics",
        also=("undecided",),
    ),
)


class Rack(RigBench):
    """The axis of the suite."""

    plant = "actuator"
    base: ClassVar[Mapping[str, float]] = {"carriage.m": 95.0, "friction.d": 200.0, "friction.f_c": 20.0, "offset.f": 0.0}
    absent = ("offset.f",)
    order = ("carriage.m", "friction.d", "friction.f_c", "offset.f")
    inputs = ("F",)
    conditions = CONDITIONS
    force: ClassVar[Mapping[str, float]] = {"carriage": 130.0}
    cases = (*CLEAN, *FAULTY)

    def machine(self, values: Values, structure: Mapping[str, Any]) -> Machine:
        """The axis."""
        v = values
        return Axis(m=v["carriage.m"], d=v["friction.d"], f_c=v["friction.f_c"], f_0=v["offset.f"], m_m=30.0, **structure)

    def control(self, machine: Machine, case: Case, motion: str, time: np.ndarray, step: float, rng: np.random.Generator) -> Control:
        """The position of the encoder, with softer gains behind an elastic screw."""
        return position(motion, time, step, case.size, rng, SOFT if machine.substeps > 1 and machine.start.size > 1 else 1.0)


BENCH = Rack()
