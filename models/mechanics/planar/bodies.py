"""Rigid bodies in the plane, held at one frame.

Newton's and Euler's laws about the origin of the frame, h being the first moments in the world's axes and a the gravity of the world:

    m v_x' - h_y omega' - h_x omega^2 = f_x + m a_x              h_x = m_x cos(phi) - m_y sin(phi)
    m v_y' + h_x omega' - h_y omega^2 = f_y + m a_y              h_y = m_x sin(phi) + m_y cos(phi)
    J omega' + h_x v_y' - h_y v_x'    = tau + h_x a_y - h_y a_x

They are linear in the mass m, the first moments m_x, m_y in the body's axes and the second moment J about the frame
(W. Khalil, E. Dombre, Modeling, Identification and Control of Robots, Hermes Penton, 2002, ch. 9).
"""

from __future__ import annotations

from typing import Any

from ...connectors import Frame
from ...language import Component, Equation, Expression, Parameter, Shared, Variable, balance, equal
from .turned import turned
from .world import World


class RigidBody(Component):
    """Base of the rigid bodies: the balances about the frame, in the moments that a subclass gives.

    Variables:  x, y [m], phi [rad] of the frame; v_x, v_y [m/s], omega [rad/s]
    Connectors: frame
    Parameters: m [kg] mass, 1 by default
    Shared:     world, its gravity
    """

    x = Variable("m", state=True, description="position")
    y = Variable("m", state=True, description="position")
    phi = Variable("rad", state=True, description="angle")
    v_x = Variable("m/s", state=True, description="velocity")
    v_y = Variable("m/s", state=True, description="velocity")
    omega = Variable("rad/s", state=True, description="angular velocity")
    frame = Frame()
    world = Shared(World)
    m = Parameter("kg", 1.0, min=0.0, description="mass")

    def moments(self, c: Any) -> tuple[Expression, Expression, Expression]:
        """m_x, m_y [kg.m] in the body's axes and J [kg.m2], about the origin of the frame."""
        raise NotImplementedError(f"{type(self).__name__} declares no moments")

    def equations(self, c: Any) -> dict[str, Equation]:
        m_x, m_y, J = self.moments(c)
        world, frame = c.world, c.frame
        h_x, h_y = turned(m_x, m_y, c.phi)
        a_x, a_y, a_phi = c.der(c.v_x), c.der(c.v_y), c.der(c.omega)
        inertia_x, inertia_y = c.m * a_x - h_y * a_phi - h_x * c.omega**2, c.m * a_y + h_x * a_phi - h_y * c.omega**2
        return {
            "position x": equal(c.x, frame.x),
            "position y": equal(c.y, frame.y),
            "angle": equal(c.phi, frame.phi),
            "velocity x": equal(c.v_x, c.der(c.x)),
            "velocity y": equal(c.v_y, c.der(c.y)),
            "angular velocity": equal(c.omega, c.der(c.phi)),
            "force balance x": balance(inertia_x, frame.f_x, c.m * world.a_x, place="x", unit="N"),
            "force balance y": balance(inertia_y, frame.f_y, c.m * world.a_y, place="y", unit="N"),
            "torque balance": balance(
                J * a_phi + h_x * a_y - h_y * a_x, frame.tau, h_x * world.a_y - h_y * world.a_x, place="phi", unit="N.m"
            ),
        }


class Body(RigidBody):
    """A rigid body by its centre of mass.   m_x = m x_c,  m_y = m y_c,  J = I + m (x_c^2 + y_c^2)

    Variables:  x, y [m], phi [rad] of the frame; v_x, v_y [m/s], omega [rad/s]
    Connectors: frame
    Parameters: m [kg] mass, 1 by default; x_c, y_c [m] centre of mass in the frame, 0 by default; I [kg.m2] moment of inertia about the
                centre of mass, 1 by default
    Shared:     world, its gravity
    """

    x_c = Parameter("m", 0.0, description="centre of mass in the frame")
    y_c = Parameter("m", 0.0, description="centre of mass in the frame")
    I = Parameter("kg.m2", 1.0, min=0.0, description="moment of inertia about the centre of mass")

    def moments(self, c: Any) -> tuple[Expression, Expression, Expression]:
        return c.m * c.x_c, c.m * c.y_c, c.I + c.m * (c.x_c**2 + c.y_c**2)


class MomentBody(RigidBody):
    """A rigid body by its first and second moments about its frame: the dynamics are linear in its parameters.

    Where the origin of the frame stands still, only J (and, under gravity, m_x and m_y) matters to the motion.

    Variables:  x, y [m], phi [rad] of the frame; v_x, v_y [m/s], omega [rad/s]
    Connectors: frame
    Parameters: m [kg] mass, 1 by default; m_x, m_y [kg.m] first moments in the body's axes, 0 by default; J [kg.m2] second moment
                about the origin of the frame, 1 by default
    Shared:     world, its gravity
    """

    m_x = Parameter("kg.m", 0.0, description="first moment: mass times position of its centre")
    m_y = Parameter("kg.m", 0.0, description="first moment: mass times position of its centre")
    J = Parameter("kg.m2", 1.0, min=0.0, description="second moment about the origin of the frame")

    def moments(self, c: Any) -> tuple[Expression, Expression, Expression]:
        return c.m_x, c.m_y, c.J
