"""What pushes and turns a rigid body in space: drag, given forces, added mass; all in the axes of the body.

They carry no residual of their own: a force that they do not explain is that of the body's balance.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from ...connectors import BodyFrame
from ...language import Component, Equation, Parameter, Shared, SignalInput, equal
from .bodies import RigidBody
from .rotation import Vector, rotation, specific_force, velocities


class BodyElement(Component):
    """Base of the elements with one frame: the force and torque on the body that a subclass gives.   frame.f = -force, frame.tau = -torque

    Connectors: frame
    """

    frame = BodyFrame()

    def load(self, c: Any) -> tuple[Vector, Vector]:
        """Force [N] and torque about the origin of the frame [N.m] on the body, in its axes."""
        raise NotImplementedError(f"{type(self).__name__} declares no load")

    def equations(self, c: Any) -> dict[str, Equation]:
        force, torque = self.load(c)
        frame = c.frame
        return {
            "force x": equal(frame.f_x, -force[0]),
            "force y": equal(frame.f_y, -force[1]),
            "force z": equal(frame.f_z, -force[2]),
            "torque x": equal(frame.tau_x, -torque[0]),
            "torque y": equal(frame.tau_y, -torque[1]),
            "torque z": equal(frame.tau_z, -torque[2]),
        }


class Drag(BodyElement):
    """Base of the drags: they depend on the velocity against the air.   nu_rel = nu - R^T wind

    Connectors: frame
    Parameters: wind_x, wind_y, wind_z [m/s] velocity of the air in earth axes (north, east, down), 0 by default (absent)
    Shared:     body, its attitude
    """

    body = Shared(RigidBody)
    wind_x = Parameter("m/s", 0.0, nominal=1.0, description="velocity of the air north")
    wind_y = Parameter("m/s", 0.0, nominal=1.0, description="velocity of the air east")
    wind_z = Parameter("m/s", 0.0, nominal=1.0, description="velocity of the air down")

    def air_velocity(self, c: Any) -> Vector:
        """Velocity of the body against the air, in its axes."""
        wind = ca.vertcat(c.wind_x, c.wind_y, c.wind_z)
        return velocities(c.frame)[0] - rotation(c.body.phi, c.body.theta, c.body.psi).T @ wind


class LinearDrag(Drag):
    """Drag in proportion to the velocity, such as that of rotors in their plane.   force = -diag(d, d, d_z) nu_rel

    R. C. Leishman, J. C. Macdonald, R. W. Beard, T. W. McLain, Quadrotors and accelerometers, IEEE Control Systems Magazine 34(1), 2014.

    Connectors: frame
    Parameters: d [N.s/m] along x and y, 0 by default (absent); d_z [N.s/m] along z, 0 by default (absent);
                wind_x, wind_y, wind_z [m/s] velocity of the air in earth axes, 0 by default (absent)
    Shared:     body, its attitude
    """

    d = Parameter("N.s/m", 0.0, min=0.0, description="drag over velocity along x and y")
    d_z = Parameter("N.s/m", 0.0, min=0.0, description="drag over velocity along z")

    def load(self, c: Any) -> tuple[Vector, Vector]:
        return -ca.vertcat(c.d, c.d, c.d_z) * self.air_velocity(c), ca.SX.zeros(3)


class DragMoment(Drag):
    """Torque in proportion to the velocity across the rotors, whose discs it tilts.   torque = (-c_x v_rel, c_y u_rel, 0)

    Blades that advance bear more than those that retreat, and drag that acts above the centre of mass does the same: it turns the body
    away from where it flies.

    G. M. Hoffmann, H. Huang, S. L. Waslander, C. J. Tomlin, Quadrotor helicopter flight dynamics and control: theory and experiment, AIAA
    Guidance, Navigation and Control Conference, 2007.

    Connectors: frame
    Parameters: c_x, c_y [N.s] torque about x over velocity along y, and about y over that along x, 0 by default (absent);
                wind_x, wind_y, wind_z [m/s] velocity of the air in earth axes, 0 by default (absent)
    Shared:     body, its attitude
    """

    c_x = Parameter("N.s", 0.0, description="torque about x over velocity along y")
    c_y = Parameter("N.s", 0.0, description="torque about y over velocity along x")

    def load(self, c: Any) -> tuple[Vector, Vector]:
        nu = self.air_velocity(c)
        return ca.SX.zeros(3), ca.vertcat(-c.c_x * nu[1], c.c_y * nu[0], 0)


class QuadraticDrag(Drag):
    """Drag in proportion to the squared speed, against the velocity.   force = -c |nu| nu,   nu = diag(1, 1, share_z) nu_rel

    The corner at rest is rounded:   |nu| = sqrt(nu^2 + width^2). A flat body, or one of which the drag along z is known, has a share_z
    of 0.

    Connectors: frame
    Parameters: c [N.s2/m2], 0 by default (absent); share_z of the velocity along z that counts, 1 by default: drag alike all around;
                width [m/s] smoothing, 1e-3 by default;
                wind_x, wind_y, wind_z [m/s] velocity of the air in earth axes, 0 by default (absent)
    Shared:     body, its attitude
    """

    c = Parameter("N.s2/m2", 0.0, min=0.0, description="drag over squared speed")
    share_z = Parameter("1", 1.0, min=0.0, description="share of the velocity along z that counts")
    width = Parameter("m/s", 1e-3, min=1e-12, description="rounding of the speed at rest", smoothing=True)

    def load(self, c: Any) -> tuple[Vector, Vector]:
        nu = ca.vertcat(1, 1, c.share_z) * self.air_velocity(c)
        return -c.c * ca.sqrt(ca.sumsqr(nu) + c.width**2) * nu, ca.SX.zeros(3)


class AddedMass(BodyElement):
    """A point mass fixed to the body, which its mass and inertia do not count.   force = -m s(r),   torque = r x force

    s(r) is the specific force at its place r = (x, y, z).

    Connectors: frame
    Parameters: m [kg], 0 by default (absent); x, y, z [m] place in the frame, 0 by default
    Shared:     body, its attitude and gravity
    """

    body = Shared(RigidBody)
    m = Parameter("kg", 0.0, min=0.0, description="mass")
    x = Parameter("m", 0.0, description="place in the frame")
    y = Parameter("m", 0.0, description="place in the frame")
    z = Parameter("m", 0.0, description="place in the frame")

    def load(self, c: Any) -> tuple[Vector, Vector]:
        r = ca.vertcat(c.x, c.y, c.z)
        force = -c.m * specific_force(c, r)
        return force, ca.cross(r, force)


class MassOffset(BodyElement):
    """The centre of mass of a body off the origin of its frame.   force = -m (s(r) - s(0)),   torque = -r x m s(r)

    s(r) is the specific force at r = (x, y, z); the mass itself, at the origin, is the body's.

    Connectors: frame
    Parameters: m [kg] mass of the body, 1 by default; x, y, z [m] its centre in the frame, 0 by default (absent)
    Shared:     body, its attitude and gravity
    """

    body = Shared(RigidBody)
    m = Parameter("kg", 1.0, min=0.0, description="mass of the body")
    x = Parameter("m", 0.0, description="centre of mass in the frame")
    y = Parameter("m", 0.0, description="centre of mass in the frame")
    z = Parameter("m", 0.0, description="centre of mass in the frame")

    def load(self, c: Any) -> tuple[Vector, Vector]:
        r = ca.vertcat(c.x, c.y, c.z)
        there, here = specific_force(c, r), specific_force(c, ca.SX.zeros(3))
        return -c.m * (there - here), -c.m * ca.cross(r, there)


class BodyForce(BodyElement):
    """A force source in the axes of the body, at the origin of its frame.   force = (f_x, f_y, f_z)

    Signals:    f_x, f_y, f_z [N] force on the body
    Connectors: frame
    """

    f_x = SignalInput("N", description="force along x on the body")
    f_y = SignalInput("N", description="force along y on the body")
    f_z = SignalInput("N", description="force along z on the body")

    def load(self, c: Any) -> tuple[Vector, Vector]:
        return ca.vertcat(c.f_x, c.f_y, c.f_z), ca.SX.zeros(3)


class BodyTorque(BodyElement):
    """A torque source in the axes of the body.   torque = (tau_x, tau_y, tau_z)

    Signals:    tau_x, tau_y, tau_z [N.m] torque on the body
    Connectors: frame
    """

    tau_x = SignalInput("N.m", description="torque about x on the body")
    tau_y = SignalInput("N.m", description="torque about y on the body")
    tau_z = SignalInput("N.m", description="torque about z on the body")

    def load(self, c: Any) -> tuple[Vector, Vector]:
        return ca.SX.zeros(3), ca.vertcat(c.tau_x, c.tau_y, c.tau_z)


class ConstantBodyForce(BodyElement):
    """A constant force and torque in the axes of the body.   force = (f_x, f_y, f_z),   torque = (tau_x, tau_y, tau_z)

    Connectors: frame
    Parameters: f_x, f_y, f_z [N], tau_x, tau_y, tau_z [N.m], 0 by default (absent)
    """

    f_x = Parameter("N", 0.0, description="force along x on the body")
    f_y = Parameter("N", 0.0, description="force along y on the body")
    f_z = Parameter("N", 0.0, description="force along z on the body")
    tau_x = Parameter("N.m", 0.0, description="torque about x on the body")
    tau_y = Parameter("N.m", 0.0, description="torque about y on the body")
    tau_z = Parameter("N.m", 0.0, description="torque about z on the body")

    def load(self, c: Any) -> tuple[Vector, Vector]:
        return ca.vertcat(c.f_x, c.f_y, c.f_z), ca.vertcat(c.tau_x, c.tau_y, c.tau_z)


class ConstantForce(BodyElement):
    """A constant level force in the axes of the earth, as of a wind.   force = f R^T (cos(direction), sin(direction), 0)

    Connectors: frame
    Parameters: f [N], 0 by default (absent); direction [rad] from north to east, 0 by default
    Shared:     body, its attitude
    """

    body = Shared(RigidBody)
    f = Parameter("N", 0.0, description="force on the body")
    direction = Parameter("rad", 0.0, description="its direction, from north to east")

    def load(self, c: Any) -> tuple[Vector, Vector]:
        there = ca.vertcat(ca.cos(c.direction), ca.sin(c.direction), 0)
        return c.f * rotation(c.body.phi, c.body.theta, c.body.psi).T @ there, ca.SX.zeros(3)
