"""Models of recorded machines, declared from components of the library: the plants of `real_sets.py` and `real_diagnoses.py`.

double_pendulum    two links under gravity, a geared drive with friction at either joint
turned_joint       one joint of an arm while the others are held: friction, which may grow with the load, gravity, inertia
flexible_stage     a geared hub that carries a flexible link, whose strain gauge may lag
rigid_stage        the same with a link that does not bend
driven_rotor       a rotor in bearings, and nothing else
oscillator         a mass on a spring and a damper, pushed
flown_body         a quadrotor of which the speeds of the propellers are known, an inertial measurement unit, and cameras that see its pose
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi
from typing import Any

import casadi as ca

from backsight.models import Component, Equation, Model, Parameter, Rotational, SignalInput, Variable, equal
from backsight.models.mechanics.planar import FixedTranslation, FrameFixed, MomentBody, Revolute, World
from backsight.models.mechanics.rotational import (
    AngleSensor,
    ConstantTorque,
    Inertia,
    RotationalFixed,
    RotationalFriction,
    RotationalLoadDependentFriction,
    RotationalRigid,
    RotationalSpringDamper,
    Torque,
)
from backsight.models.mechanics.spatial import Accelerometer, BodyElement, Gyro, RigidBody
from backsight.models.mechanics.translational import Damper, Fixed, Force, Mass, PositionSensor, Spring
from backsight.models.plants.quadrotor import ROTORS
from backsight.models.signals import Lag


class GearedMotor(Component):
    """A motor behind a gear, at the gear's slow side.   flange.tau = -tau,   tau = k i

    Variables:  tau [N.m] torque on the flange
    Signals:    i [A] current (input)
    Connectors: flange
    Parameters: k [N.m/A] torque at the flange per current, 1 by default
    """

    tau = Variable("N.m", description="torque on the flange")
    i = SignalInput("A", description="current")
    flange = Rotational()
    k = Parameter("N.m/A", 1.0, description="torque at the flange per current")

    def equations(self, c: Any) -> dict[str, Equation]:
        return {"motor law": equal(c.tau, c.k * c.i), "torque": equal(c.flange.tau, -c.tau)}


class SpunPropeller(BodyElement):
    """A propeller that turns as fast as it is told.   T = k n^2,   torque = r x force - spin torque_ratio T e_z

    Signals:    n [rad/s] speed (input)
    Connectors: frame, of the body: its centre of mass
    Parameters: k [N.s2] thrust over squared speed, 1e-8 by default; torque_ratio [m] reaction torque over thrust, 0 by default; arm [m] in
                the direction of azimuth [rad] from x towards y, 0 by default; spin [1] sense of rotation about z, 1 or -1, 1 by default
    """

    n = SignalInput("rad/s", description="speed")
    k = Parameter("N.s2", 1e-8, min=0.0, description="thrust over squared speed")
    torque_ratio = Parameter("m", 0.0, min=0.0, description="reaction torque over thrust")
    arm = Parameter("m", 0.0, min=0.0, description="distance from the centre of mass")
    azimuth = Parameter("rad", 0.0, nominal=1.0, description="direction of the arm, from x towards y")
    spin = Parameter("1", 1.0, min=-1.0, max=1.0, description="sense of rotation about z")

    def load(self, c: Any) -> tuple[Any, Any]:
        lift = ca.vertcat(0, 0, -c.k * c.n**2)
        place = c.arm * ca.vertcat(ca.cos(c.azimuth), ca.sin(c.azimuth), 0)
        return lift, ca.cross(place, lift) + c.spin * c.torque_ratio * lift


def double_pendulum(length: float, mass: float) -> Model:
    """Inputs tau_1, tau_2 [N.m] at the joints; outputs q_1 from hanging and q_2 against link 1 [rad].

    length [m] of link 1; mass [kg] of link 2, which only adds m_2 l_1 and m_2 l_1^2 to the moments of link 1. Inertias of the rotors are
    in those of the links.
    """
    return Model(
        name="double_pendulum",
        components={
            "world": World(tilt=pi / 2),
            "base": FrameFixed(),
            "shoulder": Revolute(),
            "link_1": MomentBody(m=1.0, m_y=-0.15, J=0.05),
            "rod_1": FixedTranslation(r_y=-length),
            "elbow": Revolute(),
            "link_2": MomentBody(m=mass, m_y=-0.1, J=0.02),
            "motor_1": Torque(),
            "motor_2": Torque(),
            "friction_1": RotationalFriction(),
            "friction_2": RotationalFriction(),
            "ground": RotationalFixed(),
            "encoder_1": AngleSensor(),
            "encoder_2": AngleSensor(),
        },
        connections=[
            ("base.frame", "shoulder.frame_a"),
            ("shoulder.frame_b", "link_1.frame"),
            ("link_1.frame", "rod_1.frame_a"),
            ("rod_1.frame_b", "elbow.frame_a"),
            ("elbow.frame_b", "link_2.frame"),
            ("motor_1.flange", "shoulder.axis"),
            ("motor_2.flange", "elbow.axis"),
            ("friction_1.flange_a", "shoulder.axis"),
            ("friction_1.flange_b", "ground.flange"),
            ("friction_2.flange_a", "elbow.axis"),
            ("friction_2.flange_b", "ground.flange"),
            ("encoder_1.flange", "shoulder.axis"),
            ("encoder_2.flange", "elbow.axis"),
        ],
        inputs={"tau_1": "motor_1.tau", "tau_2": "motor_2.tau"},
        outputs={"q_1": "encoder_1.phi", "q_2": "encoder_2.phi"},
        residuals=("shoulder", "elbow"),
    )


def turned_joint(gain: float, loaded: bool = False) -> Model:
    """Input i [A]; output q [rad]. A vertical plane, positive angles turn downwards.

    gain [N.m/A] of motor and gear at the joint; loaded: the gear's friction grows with the torque that it transmits.
    """
    teeth = {"teeth": RotationalLoadDependentFriction(mu=0.05, load_width=1.0)} if loaded else {}
    meshing = [("teeth.flange_a", "joint.axis"), ("teeth.flange_b", "ground.flange"), ("motor.tau", "teeth.load")] if loaded else []
    return Model(
        name="turned_joint",
        components={
            "world": World(tilt=pi / 2, direction=pi / 2),
            "base": FrameFixed(),
            "joint": Revolute(),
            "arm": MomentBody(),
            "motor": GearedMotor(k=gain),
            "friction": RotationalFriction(),
            "offset": ConstantTorque(),
            "ground": RotationalFixed(),
            "encoder": AngleSensor(),
            **teeth,
        },
        connections=[
            ("base.frame", "joint.frame_a"),
            ("joint.frame_b", "arm.frame"),
            ("motor.flange", "joint.axis"),
            ("friction.flange_a", "joint.axis"),
            ("friction.flange_b", "ground.flange"),
            ("offset.flange_a", "joint.axis"),
            ("offset.flange_b", "ground.flange"),
            ("encoder.flange", "joint.axis"),
            *meshing,
        ],
        inputs={"i": "motor.i"},
        outputs={"q": "encoder.phi"},
        residuals=("joint",),
    )


def flexible_stage(gain: float, lag: float = 0.0) -> Model:
    """Input i [A]; outputs hub [rad] and the tip's deflection against it [rad].

    gain [N.m/A] of motor and gear at the hub; lag [s] of the strain gauge's filter, 0: none.
    """
    stage = _driven(
        "flexible_stage",
        gain,
        body="hub",
        J=0.1,
        beside={"offset": ConstantTorque(), "link": RotationalSpringDamper(k=30.0), "tip": Inertia(J=0.1)},
        joined=[
            ("hub.flange", "offset.flange_a"),
            ("offset.flange_b", "ground.flange"),
            ("tip.flange", "link.flange_a"),
            ("link.flange_b", "hub.flange"),
        ],
        outputs={"hub": "encoder.phi", "deflection": "link.phi_rel"},
    )
    return stage.insert("sensor:deflection", Lag(tau=lag), name="filter") if lag else stage


def rigid_stage(gain: float) -> Model:
    """Input i [A]; output hub [rad]. The link is rigid, and the place where it might not be."""
    return _driven(
        "rigid_stage",
        gain,
        body="hub",
        J=0.1,
        beside={"link": RotationalRigid(), "tip": Inertia(J=0.1)},
        joined=[("hub.flange", "link.flange_a"), ("link.flange_b", "tip.flange")],
        outputs={"hub": "encoder.phi"},
    )


def driven_rotor(gain: float) -> Model:
    """Input i [A]; output phi [rad]. gain [N.m/A] of the motor."""
    return _driven("driven_rotor", gain, body="rotor", J=1e-5, outputs={"phi": "encoder.phi"})


def oscillator() -> Model:
    """Input u [N]; output y [m]."""
    parts = {"spring": Spring(k=1.0), "damper": Damper(d=1e-4)}
    return Model(
        name="oscillator",
        components={"mass": Mass(m=1e-5), **parts, "ground": Fixed(), "source": Force(), "sensor": PositionSensor()},
        connections=[
            *(("mass.flange", f"{part}.flange_a") for part in parts),
            *((f"{part}.flange_b", "ground.flange") for part in parts),
            ("mass.flange", "source.flange"),
            ("mass.flange", "sensor.flange"),
        ],
        inputs={"u": "source.f"},
        outputs={"y": "sensor.s"},
    )


def flown_body(m: float, inertia: tuple[float, float, float], arm: float) -> Model:
    """Inputs n_1 .. n_4 [rad/s] at the places of `quadrotor`; outputs of its measurement unit, place x, y, z [m] and attitude [rad].

    m [kg]; inertia [kg.m2] about the axes of the body; arm [m].
    """
    shared = {
        "rotor.k": Parameter("N.s2", 1e-8, min=0.0, description="thrust over squared speed"),
        "rotor.torque_ratio": Parameter("m", 0.006, min=0.0, description="reaction torque over thrust"),
    }
    rotors = {name: SpunPropeller(azimuth=azimuth, spin=spin, arm=arm) for name, (azimuth, spin) in ROTORS.items()}
    Ixx, Iyy, Izz = inertia
    parts = {"body": RigidBody(m=m, Ixx=Ixx, Iyy=Iyy, Izz=Izz), **rotors, "accelerometer": Accelerometer(), "gyro": Gyro()}
    return Model(
        name="flown_body",
        components=parts,
        connections=[(f"{part}.frame", "body.frame") for part in parts if part != "body"],
        inputs={f"n_{i}": f"rotor_{i}.n" for i in (1, 2, 3, 4)},
        outputs={f"a{k}": f"accelerometer.a_{k}" for k in "xyz"}
        | {rate: f"gyro.{rate}" for rate in "pqr"}
        | {name: f"body.{name}" for name in ("x", "y", "z", "phi", "theta", "psi")},
        parameters=shared,
        bindings={f"{rotor}.{name.rpartition('.')[2]}": name for rotor in rotors for name in shared},
    )


def _driven(
    name: str,
    gain: float,
    *,
    body: str,
    J: float,
    outputs: Mapping[str, str],
    beside: Mapping[str, Component] | None = None,
    joined: Sequence[tuple[str, str]] = (),
) -> Model:
    """A motor, friction against the ground and an encoder at the inertia that is driven, and what is beside it."""
    return Model(
        name=name,
        components={
            "motor": GearedMotor(k=gain),
            body: Inertia(J=J),
            "friction": RotationalFriction(),
            "ground": RotationalFixed(),
            "encoder": AngleSensor(),
            **(beside or {}),
        },
        connections=[
            ("motor.flange", f"{body}.flange"),
            ("encoder.flange", f"{body}.flange"),
            (f"{body}.flange", "friction.flange_a"),
            ("friction.flange_b", "ground.flange"),
            *joined,
        ],
        inputs={"i": "motor.i"},
        outputs=outputs,
    )
