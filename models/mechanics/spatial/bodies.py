"""The rigid body in space: Newton's and Euler's laws in the axes of the body, about its centre of mass.

    position' = R nu                                              nu = (u, v, w) [m/s], omega = (p, q, r) [rad/s], in body axes
    phi'   = p + tan(theta) (q sin(phi) + r cos(phi))             R = R_z(psi) R_y(theta) R_x(phi), body to earth; e_z points down
    theta' = q cos(phi) - r sin(phi)
    psi'   = (q sin(phi) + r cos(phi)) / cos(theta)
    m (nu' + omega x nu)        = f + m g R^T e_z - D nu          D       = diag(drag_u, drag_v, drag_w)
    I omega' + omega x I omega  = tau - D_omega I omega           D_omega = diag(drag_p, drag_q, drag_r)

B. L. Stevens, F. L. Lewis, Aircraft Control and Simulation, 2nd ed., 2003, ch. 2, with the drag of M. Back, Grey-box Modelling of a
Quadrotor Using Closed-loop Data, Linkoping University, 2015, eqs. 4.16 and 4.27. The angles are singular at theta = +-pi/2.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from ...connectors import BodyFrame
from ...language import Component, Equation, Parameter, Variable, balance, equal
from .rotation import gravity, rotation, velocities


class RigidBody(Component):
    """A rigid body under gravity, held at a frame in its centre of mass.   m (nu' + omega x nu) = f + m g R^T e_z - D nu

    Variables:  x, y, z [m] position in earth axes, z down; u, v, w [m/s] velocity in body axes; phi, theta, psi [rad] roll, pitch, yaw;
                p, q, r [rad/s] rates in body axes
    Connectors: frame
    Parameters: m [kg] mass, 1 by default; Ixx, Iyy, Izz [kg.m2] moments of inertia, 1 by default; Ixy, Ixz, Iyz [kg.m2] off-diagonal
                elements of the inertia tensor (Ixy = - int x y dm), 0 by default; g [m/s2] gravity, 9.81 by default;
                drag_u, drag_v, drag_w [N.s/m], drag_p, drag_q, drag_r [1/s], 0 by default (absent)
    Places:     f_x, f_y, f_z [N] and tau_x, tau_y, tau_z [N.m] behind the body's name: forces and torques in body axes. An element is
                inserted at the name itself, which is the frame: `model.insert("body", LinearDrag(d=0.4))`
    """

    x = Variable("m", state=True, description="position north")
    y = Variable("m", state=True, description="position east")
    z = Variable("m", state=True, description="position down")
    u = Variable("m/s", state=True, description="velocity forward")
    v = Variable("m/s", state=True, description="velocity to the right")
    w = Variable("m/s", state=True, description="velocity down, in body axes")
    phi = Variable("rad", state=True, description="roll angle")
    theta = Variable("rad", state=True, description="pitch angle")
    psi = Variable("rad", state=True, description="yaw angle")
    p = Variable("rad/s", state=True, description="roll rate")
    q = Variable("rad/s", state=True, description="pitch rate")
    r = Variable("rad/s", state=True, description="yaw rate")
    frame = BodyFrame()
    m = Parameter("kg", 1.0, min=0.0, description="mass")
    Ixx = Parameter("kg.m2", 1.0, min=0.0, description="moment of inertia about x")
    Iyy = Parameter("kg.m2", 1.0, min=0.0, description="moment of inertia about y")
    Izz = Parameter("kg.m2", 1.0, min=0.0, description="moment of inertia about z")
    Ixy = Parameter("kg.m2", 0.0, description="off-diagonal element of the inertia tensor")
    Ixz = Parameter("kg.m2", 0.0, description="off-diagonal element of the inertia tensor")
    Iyz = Parameter("kg.m2", 0.0, description="off-diagonal element of the inertia tensor")
    g = Parameter("m/s2", 9.81, description="gravity")
    drag_u = Parameter("N.s/m", 0.0, min=0.0, description="drag along x over velocity")
    drag_v = Parameter("N.s/m", 0.0, min=0.0, description="drag along y over velocity")
    drag_w = Parameter("N.s/m", 0.0, min=0.0, description="drag along z over velocity")
    drag_p = Parameter("1/s", 0.0, min=0.0, description="drag about x over angular momentum")
    drag_q = Parameter("1/s", 0.0, min=0.0, description="drag about y over angular momentum")
    drag_r = Parameter("1/s", 0.0, min=0.0, description="drag about z over angular momentum")

    def equations(self, c: Any) -> dict[str, Equation]:
        nu, omega = velocities(c)
        inertia = ca.blockcat([[c.Ixx, c.Ixy, c.Ixz], [c.Ixy, c.Iyy, c.Iyz], [c.Ixz, c.Iyz, c.Izz]])
        turning = c.q * ca.sin(c.phi) + c.r * ca.cos(c.phi)
        way = rotation(c.phi, c.theta, c.psi) @ nu
        kinematics = {
            **{f"velocity {axis}": equal(c.der(s), way[i]) for i, (axis, s) in enumerate((("x", c.x), ("y", c.y), ("z", c.z)))},
            "roll": equal(c.der(c.phi), c.p + ca.tan(c.theta) * turning),
            "pitch": equal(c.der(c.theta), c.q * ca.cos(c.phi) - c.r * ca.sin(c.phi)),
            "yaw": equal(c.der(c.psi), turning / ca.cos(c.theta)),
        }
        held = {f"{word} of the frame": equal(own, held) for word, own, held in zip("uvwpqr", _six(c), _six(c.frame), strict=True)}
        force, torque = (c.frame.f_x, c.frame.f_y, c.frame.f_z), (c.frame.tau_x, c.frame.tau_y, c.frame.tau_z)
        inertial = c.m * (c.der(nu) + ca.cross(omega, nu))
        weight, drag = c.m * gravity(c), ca.vertcat(c.drag_u, c.drag_v, c.drag_w) * nu
        spin = inertia @ omega
        gyroscopic, damping = ca.cross(omega, spin), ca.vertcat(c.drag_p, c.drag_q, c.drag_r) * spin
        turned = inertia @ c.der(omega) + gyroscopic
        forces = {
            f"force balance {axis}": balance(inertial[i], force[i], weight[i], -drag[i], place=f"f_{axis}", unit="N")
            for i, axis in enumerate("xyz")
        }
        torques = {
            f"torque balance {axis}": balance(turned[i], torque[i], -damping[i], place=f"tau_{axis}", unit="N.m")
            for i, axis in enumerate("xyz")
        }
        return {**held, **kinematics, **forces, **torques}


def _six(frame: Any) -> tuple[Any, ...]:
    return frame.u, frame.v, frame.w, frame.p, frame.q, frame.r
