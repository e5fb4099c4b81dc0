"""One prismatic axis driven by a force through a screw: the electromechanical actuator, and the EMPS axis.

    m v' = F - d v - f_c sgn(v) - offset          s' = v

    input  F [N] force of the motor              output  x [m] position, on the motor's side of the screw

        motor F --> [screw, rigid] --> carriage m == friction (d, f_c), offset (f) --> ground
                |
             encoder x

Defaults: the EMPS axis as published by A. Janot, M. Gautier, M. Brunot, "Data set and reference models of EMPS", Workshop on Nonlinear
System Identification Benchmarks, 2019: 95.109 kg, 203.50 N.s/m, 20.394 N, -3.165 N. The screw is rigid: it is the place where a
compliance can enter.

With a compliant screw the force acts on a mass of its own, m_m, the motor's inertia as the carriage feels it:

    m_m v_m' = F - f,    f = k (s_m - s) + d_s (v_m - v),    m v' = f - d v - f_c sgn(v) - offset

Assumed, since not published: how the mass is shared, and the screw, whose mode lies at 80 Hz with a damping ratio of 2 %.
"""

from typing import Literal

from ..errors import ModelError
from ..language import Component
from ..mechanics.translational import ConstantForce, Fixed, Force, Friction, Mass, PositionSensor, Rigid, SpringDamper
from ..model import Model

MASS, MOTOR_MASS = 95.109, 20.0  # [kg] in all, and of that the share of the motor
STIFFNESS, DAMPING = 4e6, 318.0  # [N/m], [N.s/m] of the compliant screw


def actuator(screw: Literal["rigid", "compliant"] = "rigid", encoder: Literal["motor", "carriage"] = "motor") -> Model:
    """The axis with its published parameters: states carriage.s, carriage.v; input F; output x; places carriage; screw on request.

    screw    "rigid", or "compliant": with a `motor_mass` before it, whose s and v are states too and whose balance is a place
    encoder  the side of the screw on which x is measured

    Raises ModelError for another word.
    """
    if screw not in ("rigid", "compliant"):
        raise ModelError(f"actuator(screw={screw!r}): the screw is 'rigid' or 'compliant'; choose one of them")
    if encoder not in ("motor", "carriage"):
        raise ModelError(
            f"actuator(encoder={encoder!r}): the encoder is on the side of the 'motor' or of the 'carriage'; choose one of them"
        )
    rigid = screw == "rigid"
    drive: dict[str, Component] = (
        {"screw": Rigid()} if rigid else {"motor_mass": Mass(m=MOTOR_MASS), "screw": SpringDamper(k=STIFFNESS, d=DAMPING)}
    )
    return Model(
        name="actuator",
        description=f"One prismatic axis: a carriage with friction, driven by a force through a {screw} screw",
        components={
            "motor": Force(),
            **drive,
            "encoder": PositionSensor(),
            "carriage": Mass(m=MASS if rigid else MASS - MOTOR_MASS),
            "friction": Friction(d=203.50, f_c=20.394),
            "offset": ConstantForce(f=-3.165),
            "ground": Fixed(),
        },
        connections=(
            ("motor.flange", "screw.flange_a"),
            *(() if rigid else (("motor_mass.flange", "screw.flange_a"),)),
            ("encoder.flange", "screw.flange_a" if encoder == "motor" else "carriage.flange"),
            ("screw.flange_b", "carriage.flange"),
            ("carriage.flange", "friction.flange_a"),
            ("carriage.flange", "offset.flange_a"),
            ("friction.flange_b", "ground.flange"),
            ("offset.flange_b", "ground.flange"),
        ),
        inputs={"F": "motor.f"},
        outputs={"x": "encoder.s"},
    )
