"""One prismatic axis driven by a force through a screw: the electromechanical actuator, and the EMPS axis.

    m v' = F - d v - f_c sgn(v) - offset          s' = v

    input  F [N] force of the motor              output  x [m] position, on the motor's side of the screw

        motor F --> [screw, rigid] --> carriage m == friction (d, f_c), offset (f) --> ground
                |
             encoder x

Defaults: the EMPS axis as published by A. Janot, M. Gautier, M. Brunot, "Data set and reference models of EMPS", Workshop on Nonlinear
System Identification Benchmarks, 2019: 95.109 kg, 203.50 N.s/m, 20.394 N, -3.165 N. The screw is rigid: it is the place where a
compliance can enter.
"""

from ..mechanics.translational import ConstantForce, Fixed, Force, Friction, Mass, PositionSensor, Rigid
from ..model import Model


def actuator() -> Model:
    """The axis with its published parameters: states carriage.s, carriage.v; input F; output x; places carriage, screw."""
    return Model(
        name="actuator",
        description="One prismatic axis: a carriage with friction, driven by a force through a rigid screw",
        components={
            "motor": Force(),
            "screw": Rigid(),
            "encoder": PositionSensor(),
            "carriage": Mass(m=95.109),
            "friction": Friction(d=203.50, f_c=20.394),
            "offset": ConstantForce(f=-3.165),
            "ground": Fixed(),
        },
        connections=(
            ("motor.flange", "screw.flange_a"),
            ("encoder.flange", "screw.flange_a"),
            ("screw.flange_b", "carriage.flange"),
            ("carriage.flange", "friction.flange_a"),
            ("carriage.flange", "offset.flange_a"),
            ("friction.flange_b", "ground.flange"),
            ("offset.flange_b", "ground.flange"),
        ),
        inputs={"F": "motor.f"},
        outputs={"x": "encoder.s"},
    )
