"""A quadrotor in X configuration: a rigid body with four propellers on arms of equal length, and an inertial measurement unit.

    m (nu' + omega x nu) = R^T m g e_z - T e_z - D nu,   I omega' = M - omega x I omega - D_omega I omega          body axes, z down
    T_i' = (2/tau) (gain sqrt(T_i) u_i - T_i),           T = T_1 + T_2 + T_3 + T_4
    M = (arm/sqrt(2) T_phi, arm/sqrt(2) T_theta, torque_ratio T_psi)
    T_phi = T_1 - T_2 - T_3 + T_4,   T_theta = T_1 + T_2 - T_3 - T_4,   T_psi = -T_1 + T_2 - T_3 + T_4

                 x
        rotor_1 \\ ^ / rotor_2         rotors 1 and 3 turn about +z (clockwise seen from above), 2 and 4 against it
                 \\|/
                 /+\\---> y
        rotor_4 /   \\ rotor_3

    inputs   u_1 .. u_4 commands of the motors, 0 to 1
    outputs  ax, ay, az [m/s2] accelerometer: all forces but gravity over the mass, in body axes;  p, q, r [rad/s] gyro

It hovers at u = sqrt(m g)/(2 gain). Near hover vertical, roll, pitch and yaw are each a chain of two lags, of the rotors with the time
constant tau, and of the body: there only the product of their gains can be told, and the root of the thrust at full command stays fixed.

Equations: M. Back, Grey-box Modelling of a Quadrotor Using Closed-loop Data, Linkoping University, 2015, eq. 4.37. Its parameters are
estimates of lumped gains; the defaults here are those of a quadrotor of its size: 1.5 kg, 0.6 m from motor to motor, hovering at u = 0.70.
"""

from math import pi

from ..language import Component, Parameter
from ..mechanics.spatial import Accelerometer, Gyro, Propeller, RigidBody
from ..model import Model

ROTORS = {
    "rotor_1": (-pi / 4, 1.0),
    "rotor_2": (pi / 4, -1.0),
    "rotor_3": (3 * pi / 4, 1.0),
    "rotor_4": (-3 * pi / 4, -1.0),
}  # azimuth, spin


def quadrotor() -> Model:
    """The quadrotor: states body.x .. body.r and rotor_1.thrust .. rotor_4.thrust; inputs u_1 .. u_4; outputs ax, ay, az, p, q, r.

    Places: body.f_x, f_y, f_z [N], body.tau_x, tau_y, tau_z [N.m], and rotor_1 .. rotor_4 [N].
    """
    parts: dict[str, Component] = {
        "body": RigidBody(m=1.5, Ixx=0.015, Iyy=0.015, Izz=0.028, drag_w=0.3, drag_p=0.5, drag_q=0.5, drag_r=0.2),
        **{name: Propeller(azimuth=azimuth, spin=spin) for name, (azimuth, spin) in ROTORS.items()},
        "accelerometer": Accelerometer(),
        "gyro": Gyro(),
    }
    shared = {
        "rotor.tau": Parameter("s", 0.05, min=1e-9, description="time constant of the speed of the rotors"),
        "rotor.gain": Parameter("sqrt(N)", 2.74, min=0.0, description="root of the thrust of a rotor at full command"),
        "rotor.torque_ratio": Parameter("m", 0.016, min=0.0, description="reaction torque of a rotor over its thrust"),
        "arm": Parameter("m", 0.30, min=0.0, description="distance of the rotors from the centre of mass"),
    }
    return Model(
        name="quadrotor",
        description="A rigid body with four propellers, near hover or not, and an inertial measurement unit",
        components=parts,
        connections=tuple((f"{part}.frame", "body.frame") for part in parts if part != "body"),
        inputs={f"u_{i}": f"rotor_{i}.u" for i in (1, 2, 3, 4)},
        outputs={
            "ax": "accelerometer.a_x",
            "ay": "accelerometer.a_y",
            "az": "accelerometer.a_z",
            "p": "gyro.p",
            "q": "gyro.q",
            "r": "gyro.r",
        },
        parameters=shared,
        bindings={f"{rotor}.{name.rpartition('.')[2]}": name for rotor in ROTORS for name in shared},
    )
