"""A planar manipulator of two degrees of freedom with a closed loop, driven by two torques.

                    joint_4 ____________ link_56
                        /               \\__________
              link_4   /                           \\ joint_5
                      /                            / link_3
         o-----------o----------------------------o
      joint_1     joint_2        link_12       joint_3

    inputs  tau_1, tau_2 [N.m] torques at joints 1 and 2       outputs  theta_1, theta_2 [rad] angles of joints 1 and 2

theta_1 is the angle of link 12 against the base, theta_2 that of link 4 against link 12; the angles of joints 3 and 4 follow from theta_2
through the loop, and joint 5 closes it. The plane is horizontal; `World(tilt=...)` tilts it.

The six parameters P_1 .. P_6 are those that can be told from the motion together; the dynamics are linear in them:

    P_1 = m_12 r_1^2 + I_12,   P_2 = I_3,   P_3 = I_4,   P_4 = m_56,   P_5 = m_56 r_5,   P_6 = m_56 r_5^2 + I_56

I are moments of inertia about the centres of mass, r distances of these from the joints. Defaults of P: the values identified on the
manipulator. Assumed, since not published: the lengths of the links, masses and centres of mass of links 3 and 4, and m_12, r_1, of
which only m_12 r_1 = 0.15 kg.m matters, and only while the plane is tilted.
"""

from math import acos, pi

from ..language import Parameter
from ..mechanics.planar import Body, FixedTranslation, FrameFixed, MomentBody, Revolute, World
from ..mechanics.rotational import AngleSensor, Torque
from ..model import Model

L_1, L_2, L_3, L_4, L_5 = 0.25, 0.25, 0.20, 0.10, 0.22  # m
R_3, R_4 = 0.10, 0.05  # m
M_3, M_4, M_12, M_12_R_1 = 0.25, 0.15, 1.0, 0.15  # kg, kg, kg, kg.m


def five_bar() -> Model:
    """The manipulator: states joint_1.phi, joint_2.phi and their omega; inputs tau_1, tau_2; outputs theta_1, theta_2; P_1 .. P_6."""
    triangle = L_2 - L_4  # at theta_2 = 0 the loop is a triangle with sides l_3, l_5
    theta_3 = acos((L_5**2 + triangle**2 - L_3**2) / (2 * L_5 * triangle))
    theta_4 = pi - acos((L_3**2 + triangle**2 - L_5**2) / (2 * L_3 * triangle))
    return Model(
        name="five_bar",
        description="A planar manipulator with a closed loop of five joints, driven at two of them",
        components={
            "world": World(),
            "base": FrameFixed(),
            "joint_1": Revolute(),
            "joint_2": Revolute(),
            "joint_3": Revolute(),
            "joint_4": Revolute(),
            "joint_5": Revolute(),
            "link_12": MomentBody(m=M_12, m_x=M_12_R_1),
            "link_3": Body(m=M_3, x_c=R_3),
            "link_4": Body(m=M_4, x_c=R_4),
            "link_56": MomentBody(),
            "middle_12": FixedTranslation(r_x=L_1),
            "tip_12": FixedTranslation(r_x=L_1 + L_2),
            "tip_3": FixedTranslation(r_x=L_3),
            "tip_4": FixedTranslation(r_x=L_4),
            "tip_56": FixedTranslation(r_x=L_5),
            "motor_1": Torque(),
            "motor_2": Torque(),
            "encoder_1": AngleSensor(),
            "encoder_2": AngleSensor(),
        },
        connections=(
            ("base.frame", "joint_1.frame_a"),
            ("joint_1.frame_b", "link_12.frame"),
            ("link_12.frame", "middle_12.frame_a"),
            ("link_12.frame", "tip_12.frame_a"),
            ("middle_12.frame_b", "joint_2.frame_a"),
            ("joint_2.frame_b", "link_4.frame"),
            ("link_4.frame", "tip_4.frame_a"),
            ("tip_12.frame_b", "joint_3.frame_a"),
            ("joint_3.frame_b", "link_3.frame"),
            ("link_3.frame", "tip_3.frame_a"),
            ("tip_4.frame_b", "joint_4.frame_a"),
            ("joint_4.frame_b", "link_56.frame"),
            ("link_56.frame", "tip_56.frame_a"),
            ("tip_3.frame_b", "joint_5.frame_a"),
            ("tip_56.frame_b", "joint_5.frame_b"),
            ("motor_1.flange", "joint_1.axis"),
            ("motor_2.flange", "joint_2.axis"),
            ("encoder_1.flange", "joint_1.axis"),
            ("encoder_2.flange", "joint_2.axis"),
        ),
        inputs={"tau_1": "motor_1.tau", "tau_2": "motor_2.tau"},
        outputs={"theta_1": "encoder_1.phi", "theta_2": "encoder_2.phi"},
        parameters={
            "P_1": Parameter("kg.m2", 0.1080, min=0.0, description="second moment of link 12 about joint 1"),
            "P_2": Parameter("kg.m2", 0.005422, min=0.0, description="moment of inertia of link 3"),
            "P_3": Parameter("kg.m2", 0.01029, min=0.0, description="moment of inertia of link 4"),
            "P_4": Parameter("kg", 0.6059, min=0.0, description="mass of link 56"),
            "P_5": Parameter("kg.m", 0.1442, description="first moment of link 56 about joint 4"),
            "P_6": Parameter("kg.m2", 0.04350, min=0.0, description="second moment of link 56 about joint 4"),
        },
        bindings={
            "link_12.J": "P_1",
            "link_3.I": "P_2",
            "link_4.I": "P_3",
            "link_56.m": "P_4",
            "link_56.m_x": "P_5",
            "link_56.J": "P_6",
        },
        states=("joint_1.phi", "joint_2.phi"),
        start={"joint_3.phi": theta_4, "joint_4.phi": theta_3},
        residuals=("joint_1", "joint_2"),
    )
