"""Vectors and rotations of the spatial parts: axes of the body are x forward, y right, z down; earth axes have z down, too."""

from __future__ import annotations

from typing import Any

import casadi as ca

Vector = Any  # a casadi SX column of three
Matrix = Any


def rotation(phi: Any, theta: Any, psi: Any) -> Matrix:
    """R (3, 3) from body to earth axes by the angles of roll phi, pitch theta and yaw psi [rad].   R = R_z(psi) R_y(theta) R_x(phi)

    T. I. Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2011, section 2.2.
    """
    sin_phi, cos_phi, sin_theta, cos_theta, sin_psi, cos_psi = (f(a) for a in (phi, theta, psi) for f in (ca.sin, ca.cos))
    about_x = ca.blockcat([[1, 0, 0], [0, cos_phi, -sin_phi], [0, sin_phi, cos_phi]])
    about_y = ca.blockcat([[cos_theta, 0, sin_theta], [0, 1, 0], [-sin_theta, 0, cos_theta]])
    about_z = ca.blockcat([[cos_psi, -sin_psi, 0], [sin_psi, cos_psi, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def velocities(frame: Any) -> tuple[Vector, Vector]:
    """nu = (u, v, w) and omega = (p, q, r) of a body or a frame."""
    return ca.vertcat(frame.u, frame.v, frame.w), ca.vertcat(frame.p, frame.q, frame.r)


def gravity(body: Any) -> Vector:
    """Gravity in the axes of the body [m/s2].   g R^T e_z"""
    return body.g * rotation(body.phi, body.theta, body.psi)[2, :].T


def specific_force(c: Any, r: Vector) -> Vector:
    """What an accelerometer at r [m] feels, in the axes of the body [m/s2]; `c` has a `frame` and sees the `body`.

    nu' + omega x nu + omega' x r + omega x (omega x r) - g R^T e_z
    """
    nu, omega = velocities(c.frame)
    return c.der(nu) + ca.cross(omega, nu) + ca.cross(c.der(omega), r) + ca.cross(omega, ca.cross(omega, r)) - gravity(c.body)
