"""Connectors: the pairs of potential and flow through which components meet.

Signs, for all components: a flow is positive *into* the component (a force acting on a mass from outside is positive at its flange). An
element with two flanges measures flange_a minus flange_b, and its through force enters at flange_a and leaves at flange_b:

    s_rel = flange_a.s - flange_b.s,    flange_a.f = f,    flange_b.f = -f

so a spring, damper or friction between a body (flange_a) and ground (flange_b) takes the force f from the body.
"""

from .language import Connector, Pair


class Translational(Connector):
    """Flange of a part that slides along one line: position s [m], force f [N]."""

    pairs = (Pair("s", "m", "f", "N", "force balance"),)


class Rotational(Connector):
    """Flange of a part that turns about one axis: angle phi [rad], torque tau [N.m]."""

    pairs = (Pair("phi", "rad", "tau", "N.m", "torque balance"),)


class Planar(Connector):
    """Point of a part that moves in a plane: position x, y [m], force f_x, f_y [N]."""

    pairs = (Pair("x", "m", "f_x", "N", "force balance x"), Pair("y", "m", "f_y", "N", "force balance y"))


class Frame(Connector):
    """Axes fixed to a rigid part that moves in a plane: origin x, y [m], angle phi [rad], force f_x, f_y [N], torque tau [N.m].

    Positions, angles, forces and torques are those of the world; the torque is about the origin of the frame.
    """

    pairs = (
        Pair("x", "m", "f_x", "N", "force balance x"),
        Pair("y", "m", "f_y", "N", "force balance y"),
        Pair("phi", "rad", "tau", "N.m", "torque balance"),
    )


class BodyFrame(Connector):
    """Axes fixed to a rigid body in space: velocity u, v, w [m/s], rates p, q, r [rad/s]; force f_x, f_y, f_z [N], torque tau_x, .. [N.m].

    All along the axes of the body; the velocity is that of the origin, and the torque is about it. The attitude is no potential: what
    needs it (gravity, wind) sees it as `Shared(RigidBody)`.
    """

    pairs = (
        Pair("u", "m/s", "f_x", "N", "force balance x"),
        Pair("v", "m/s", "f_y", "N", "force balance y"),
        Pair("w", "m/s", "f_z", "N", "force balance z"),
        Pair("p", "rad/s", "tau_x", "N.m", "torque balance x"),
        Pair("q", "rad/s", "tau_y", "N.m", "torque balance y"),
        Pair("r", "rad/s", "tau_z", "N.m", "torque balance z"),
    )


class Electrical(Connector):
    """Pin of an electrical part: voltage v [V] against the ground of the circuit, current i [A]."""

    pairs = (Pair("v", "V", "i", "A", "current balance"),)
