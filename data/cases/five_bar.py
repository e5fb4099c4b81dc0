"""Concealed cases of the five-bar arm."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ..generators.concealed.acting import InputFault
from ..generators.concealed.effects import Coulomb, Effect, Law, Wrench, laws, on
from ..generators.concealed.five_bar import CONDITIONS, LINKS, Joints, position
from ..generators.concealed.rig import Control, Machine
from ..generators.concealed.sensing import SensorFault
from ..generators.five_bar import with_values
from .case import CLEAN, Case, RigBench, Values, same, wrong

__all__ = ["BENCH"]

Told = Mapping[str, tuple[float, str]]


def joint(number: int, physics: str, told: Told, *rivals: tuple[str, str], **how: Any) -> Effect:
    """An effect in a joint."""
    return Effect(place=f"joint_{number}", physics=physics, parameters=told, rivals=rivals, **how)


def at(number: int, law: Law) -> Wrench:
    """The law as a torque at the joint."""
    return on(number - 1, 2, law)


def coulomb(number: int, tau: float, onset: float | None = None) -> Effect:
    return joint(number, "coulomb_friction", {"tau_c": (tau, "N.m")}, friction=(Coulomb(i=number - 1, level=tau),), onset=onset)


def stribeck(number: int, tau_c: float, more: float, v_s: float) -> Effect:
    told = {"tau_c": (tau_c, "N.m"), "tau_s": (tau_c + more, "N.m"), "v_s": (v_s, "rad/s")}
    friction = (Coulomb(i=number - 1, level=tau_c + more),)
    return joint(number, "stribeck_friction", told, friction=friction, force=at(number, laws.stribeck(more, v_s)))


def viscous(number: int, d: float) -> Effect:
    rivals = (*same("damping", f"joint_{number}"), *same("linear_drag", f"joint_{number}"))
    return joint(number, "viscous_friction", {"d": (d, "N.m.s/rad")}, *rivals, force=at(number, laws.viscous(d)))


def asymmetric(number: int, plus: float, minus: float) -> Effect:
    told = {"d_plus": (plus, "N.m.s/rad"), "d_minus": (minus, "N.m.s/rad")}
    return joint(number, "asymmetric_friction", told, force=at(number, laws.asymmetric_viscous(plus, minus)))


def drag(number: int, c: float) -> Effect:
    return joint(number, "quadratic_drag", {"c": (c, "N.m.s2/rad2")}, force=at(number, laws.quadratic_drag(c)))


def spring(number: int, k: float) -> Effect:
    return joint(number, "spring", {"k": (k, "N.m/rad")}, ("world", "gravity"), force=at(number, laws.spring(k)))


def cubic(number: int, k3: float) -> Effect:
    return joint(number, "cubic_spring", {"k3": (k3, "N.m/rad3")}, force=at(number, laws.spring(0.0, k3)))


def tilted(tilt: float) -> Effect:
    rivals = same("gravity", "joint_1", *LINKS)
    return Effect(place="world", physics="gravity", parameters={"tilt": (tilt, "rad")}, rivals=rivals, structure={"tilt": tilt})


def load(mass: float, x: float, y: float) -> Effect:
    """A mass beside the line of link 56; on it, it would be one of the base parameters. Only its moment across can be told."""
    places = (*LINKS[1:], "link_12", "joint_2")
    rivals = (*same("added_mass", *places), *same("coupling", *places))
    return Effect(place="link_56", physics="added_mass", rivals=rivals, structure={"mass": mass, "x": x, "y": y})


def command(number: int, physics: str, parameter: str, value: float, unit: str, onset: float | None = None) -> Effect:
    name = f"tau_{number}"
    rivals = tuple((f"input:{name}", other) for other in ("input_lag", "input_delay")) if physics in ("input_lag", "input_delay") else ()
    faults, told = {name: InputFault(**{parameter: value})}, {parameter: (value, unit)}
    return Effect(place=f"input:{name}", physics=physics, parameters=told, rivals=rivals, inputs=faults, onset=onset)


def sensor(number: int, physics: str, told: Told, *rivals: tuple[str, str], **fault: Any) -> Effect:
    name = f"theta_{number}"
    faults = {name: SensorFault(**fault)}
    return Effect(place=f"sensor:{name}", physics=physics, parameters=told, rivals=rivals, sensors=faults)


def unknown(number: int, law: Law) -> Effect:
    return joint(number, "unknown_physics", {}, (f"joint_{number}", "external_force"), force=at(number, law))


NOT_SURE = ("undecided",)
FAULTY = (
    Case(kind="joint_1_coulomb", effects=lambda d: (coulomb(1, 0.055 * d.size),), motions=("steps", "multisine"), core=True),
    Case(kind="joint_1_coulomb", effects=lambda d: (coulomb(1, 0.015 * d.size),), strength="weak", motions=("multisine", "trapezoids")),
    Case(kind="joint_2_coulomb", effects=lambda d: (coulomb(2, 0.018 * d.size),), motions=("trapezoids", "multisine")),
    Case(kind="joint_1_viscous", effects=lambda d: (viscous(1, 0.11 * d.size),), motions=("multisine", "steps")),
    Case(kind="joint_2_viscous", effects=lambda d: (viscous(2, 0.006 * d.size),), strength="weak", core=True),
    Case(
        kind="joint_1_stribeck", effects=lambda d: (stribeck(1, 0.03 * d.size, 0.06 * d.size, 0.15),), motions=("trapezoids", "multisine")
    ),
    Case(kind="joint_2_asymmetric", effects=lambda d: (asymmetric(2, 0.035 * d.size, 0.010 * d.size),), motions=("multisine", "steps")),
    Case(kind="joint_2_quadratic_drag", effects=lambda d: (drag(2, 0.018 * d.size),), motions=("multisine", "trapezoids")),
    Case(kind="tilted_table", effects=lambda d: (tilted(0.012 * d.size),), motions=("trapezoids", "multisine"), core=True),
    Case(kind="tilted_table", effects=lambda d: (tilted(0.004 * d.size),), strength="weak", motions=("multisine", "steps")),
    Case(
        kind="added_mass",
        effects=lambda d: (load(0.20 * d.size, 0.05, 0.12),),
        also=("undecided", "parameter"),
        motions=("multisine", "steps"),
    ),
    Case(kind="joint_1_spring", effects=lambda d: (spring(1, 0.22 * d.size),), motions=("trapezoids", "multisine")),
    Case(kind="joint_2_cubic_spring", effects=lambda d: (cubic(2, 0.8 * d.size),), motions=("multisine", "trapezoids")),
    Case(
        kind="amplifier_saturation",
        effects=lambda d: (command(1, "input_saturation", "limit", 0.8 / d.size, "N.m"),),
        verdict="input",
        motions=("steps", "multisine"),
    ),
    Case(
        kind="amplifier_dead_zone",
        effects=lambda d: (command(2, "input_dead_zone", "width", 0.018 * d.size, "N.m"),),
        verdict="input",
        motions=("multisine", "steps"),
    ),
    Case(
        kind="input_gain:tau_2",
        effects=lambda d: (command(2, "input_gain", "gain", 1 - 0.11 * d.size, "1"),),
        verdict="input",
        also=NOT_SURE,
    ),
    Case(
        kind="input_lag:tau_1",
        effects=lambda d: (command(1, "input_lag", "tau", 0.010 * d.size, "s"),),
        verdict="input",
        also=(*NOT_SURE, "sensor"),
    ),
    Case(
        kind="encoder_gain:theta_2",
        effects=lambda d: (sensor(2, "sensor_gain", {"gain": (1 + 0.09 * d.size, "1")}, gain=1 + 0.09 * d.size),),
        verdict="sensor",
        also=NOT_SURE,
        motions=("multisine", "trapezoids"),
    ),
    Case(
        kind="encoder_delay:theta_1",
        effects=lambda d: (
            sensor(1, "sensor_delay", {"delay": (0.035 * d.size, "s")}, ("sensor:theta_1", "sensor_lag"), delay=0.035 * d.size),
        ),
        verdict="sensor",
        also=NOT_SURE,
    ),
    Case(
        kind="encoder_eccentricity:theta_1",
        effects=lambda d: (
            sensor(
                1,
                "eccentricity",
                {"amplitude": (0.12 * d.size, "rad")},
                ("joint_1", "eccentricity"),
                ("sensor:theta_1", "sensor_gain"),
                ("sensor:theta_1", "kinematic_error"),
                amplitude=0.12 * d.size,
                phase=0.8,
            ),
        ),
        verdict="sensor",
        also=("undecided", "missing_physics"),
        motions=("multisine", "steps"),
    ),
    Case(kind="wrong:P_1", effects=wrong("P_1", 1.15), strength="parameter", verdict="parameter", core=True),
    Case(kind="wrong:P_4", effects=wrong("P_4", 0.85), strength="parameter", verdict="parameter", motions=("multisine", "steps")),
    Case(
        kind="joint_1_coulomb+tilted_table",
        effects=lambda d: (coulomb(1, 0.05 * d.size), tilted(0.012 * d.size)),
        motions=("multisine", "trapezoids"),
    ),
    Case(
        kind="joint_2_viscous+joint_1_spring",
        effects=lambda d: (viscous(2, 0.018 * d.size), spring(1, 0.2 * d.size)),
        motions=("trapezoids", "steps"),
    ),
    Case(kind="onset:joint_2_coulomb", effects=lambda d: (coulomb(2, 0.024 * d.size, onset=5.0),), motions=("multisine", "trapezoids")),
    Case(
        kind="onset:input_gain:tau_1",
        effects=lambda d: (command(1, "input_gain", "gain", 1 - 0.14 * d.size, "1", onset=4.5),),
        verdict="input",
        motions=("steps", "multisine"),
    ),
    Case(
        kind="unknown:whirl_joint_1",
        effects=lambda d: (unknown(1, laws.whirl(0.22 * d.size, 0.25)),),
        verdict="unknown_physics",
        also=NOT_SURE,
        motions=("multisine", "trapezoids"),
    ),
    Case(
        kind="unknown:chirp_joint_2",
        effects=lambda d: (unknown(2, laws.chirp(0.026 * d.size, 0.8, 0.6)),),
        verdict="unknown_physics",
        also=NOT_SURE,
    ),
)


class Rack(RigBench):
    """The arm of the suite."""

    plant = "five_bar"
    base: ClassVar[Mapping[str, float]] = {"P_1": 0.108, "P_2": 0.005422, "P_3": 0.01029, "P_4": 0.6059, "P_5": 0.1442, "P_6": 0.0435}
    order = ("P_1", "P_2", "P_3", "P_4", "P_5", "P_6")
    inputs = ("tau_1", "tau_2")
    conditions = CONDITIONS
    force: ClassVar[Mapping[str, float]] = {"joint_1": 0.5, "joint_2": 0.17}
    cases = (*CLEAN, *FAULTY)

    def machine(self, values: Values, structure: Mapping[str, Any]) -> Machine:
        """The arm."""
        return Joints(arm=with_values(values), **structure)

    def control(self, machine: Machine, case: Case, motion: str, time: np.ndarray, step: float, rng: np.random.Generator) -> Control:
        """The angles of the joints."""
        del machine
        return position(motion, time, step, case.size, rng)


BENCH = Rack()
