"""A gantry table with two axes and a soft spindle: the x-motor drives one side of the slideway directly, the other through the spindle.

    x_1 = r phi_1,  x_2 = r phi_2,  y = r phi_3        x_r = x_1 + (x_2 - x_1) y/b,  y_r = y        alpha = (x_1 - x_2)/b
    T = 1/2 [J_1 phi_1'^2 + J_2 phi_2'^2 + J_3 phi_3'^2 + m_1 x_1'^2 + m_2 x_2'^2 + m_y x_c'^2 + (m_y c^2/12) alpha'^2
             + m_e (x_r'^2 + y_r'^2)],     x_c = (x_1 + x_2)/2,      V = 1/2 k (phi_1 - phi_2)^2
    torques on the wheels:  K_x I_x - tau_c1 sgn(phi_1'),   -tau_c2 sgn(phi_2'),   K_y I_y - tau_c3 sgn(phi_3')

    inputs   I_x, I_y [A] motor currents
    outputs  x_r, y_r [m] position of the end-effector (optical);  ax_r, ay_r [m/s2] its acceleration, in axes that turn with alpha;
             x_m, y_m [m] positions as the motors count them, r phi_1 and r phi_3

        motor_x --> drive_1 --> wheel_1 == belt_1 ==> slide_1 --+
                       |                                        |
                    spindle                                   gantry --> end_effector: reflector x_r, y_r; accelerometer ax_r, ay_r
                       |                                       | |
                    drive_2 --> wheel_2 == belt_2 ==> slide_2 -+ |
        motor_y --> drive_3 --> wheel_3 == belt_3 ===============+       friction_1 .. 3 between each drive and the ground

The end-effector is heavy, so that it couples the axes. The belts are rigid: places where a compliance can enter; a wheel can be replaced by
an eccentric one, which x_m and y_m would not show. Wheel 2 has neither inertia nor friction of its own at first.

Defaults: a report on the identification of an xy-table built for the research of T. Heeren, its case 1; sigmas of the sensors from there.
"""

from ..electrical import TorqueMotor
from ..language import Component, Parameter
from ..mechanics.gantry import Gantry
from ..mechanics.planar import Accelerometer, Body, PointSensor, World
from ..mechanics.rotational import Inertia, Rack, RotationalFixed, RotationalFriction, RotationalSpringDamper
from ..mechanics.translational import Mass, PositionSensor, Rigid
from ..model import Model, Output

POSITION_STD = 5e-5  # [m], optical and at the motors
ACCELERATION_STD = 0.05  # [m/s2]


def xy_table() -> Model:
    """The table with its published parameters: states drive_1 .. 3, phi and omega; places drive_1 .. 3; spindle on request."""
    ends = {1: "gantry.slide_1", 2: "gantry.slide_2", 3: "gantry.carriage"}
    parts: dict[str, Component] = {
        "motor_x": TorqueMotor(K=0.258),
        "motor_y": TorqueMotor(K=0.056),
        "drive_1": Inertia(J=2.33e-3),
        "drive_2": Inertia(J=0.0),
        "drive_3": Inertia(J=2.37e-4),
        "spindle": RotationalSpringDamper(k=0.275),
        "friction_1": RotationalFriction(tau_c=0.473),
        "friction_2": RotationalFriction(tau_c=0.0),
        "friction_3": RotationalFriction(tau_c=0.149),
        **{f"wheel_{i}": Rack() for i in ends},
        **{f"belt_{i}": Rigid() for i in ends},
        "slide_1": Mass(m=3.8),
        "slide_2": Mass(m=3.8),
        "gantry": Gantry(m_y=8.5, b=1.0, c=1.25),
        "end_effector": Body(m=2.3, I=0.0),
        "reflector": PointSensor(),
        "accelerometer": Accelerometer(),
        "scale_x": Rack(),
        "scale_y": Rack(),
        "encoder_x": PositionSensor(),
        "encoder_y": PositionSensor(),
        "world": World(),
        "ground": RotationalFixed(),
    }
    joints = [
        ("motor_x.flange", "drive_1.flange"),
        ("motor_y.flange", "drive_3.flange"),
        ("drive_1.flange", "spindle.flange_a"),
        ("spindle.flange_b", "drive_2.flange"),
        ("slide_1.flange", "gantry.slide_1"),
        ("slide_2.flange", "gantry.slide_2"),
        ("gantry.tool", "end_effector.frame"),
        ("gantry.tool", "reflector.frame"),
        ("gantry.tool", "accelerometer.frame"),
        ("drive_1.flange", "scale_x.wheel"),
        ("scale_x.rack", "encoder_x.flange"),
        ("drive_3.flange", "scale_y.wheel"),
        ("scale_y.rack", "encoder_y.flange"),
    ]
    for i, end in ends.items():
        joints += [
            (f"drive_{i}.flange", f"friction_{i}.flange_a"),
            (f"friction_{i}.flange_b", "ground.flange"),
            (f"drive_{i}.flange", f"wheel_{i}.wheel"),
            (f"wheel_{i}.rack", f"belt_{i}.flange_a"),
            (f"belt_{i}.flange_b", end),
        ]
    return Model(
        name="xy_table",
        description="A gantry with a soft spindle between its two sides, and an end-effector along its slideway",
        components=parts,
        connections=joints,
        inputs={"I_x": "motor_x.i", "I_y": "motor_y.i"},
        outputs={
            "x_r": Output("reflector.x", noise_std=POSITION_STD),
            "y_r": Output("reflector.y", noise_std=POSITION_STD),
            "ax_r": Output("accelerometer.a_x", noise_std=ACCELERATION_STD),
            "ay_r": Output("accelerometer.a_y", noise_std=ACCELERATION_STD),
            "x_m": Output("encoder_x.s", noise_std=POSITION_STD),
            "y_m": Output("encoder_y.s", noise_std=POSITION_STD),
        },
        parameters={"r": Parameter("m", 0.010, min=1e-9, description="radius of the belt wheels")},
        bindings={f"{rack}.r": "r" for rack in (*(f"wheel_{i}" for i in ends), "scale_x", "scale_y")},
    )
