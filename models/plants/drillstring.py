"""Rotary drilling with stick-slip: an electric motor turns a rotary table, a long soft string, and the bit at its end.

    L I' = V - R I - n Km Omega_r                       Omega_r, Omega_b   angular velocities of rotary table and bottom hole assembly (BHA)
    J_c Omega_r' = n Km I - B_r Omega_r - k_s dphi      dphi               twist of the string
    dphi' = Omega_r - Omega_b
    J_b Omega_b' = k_s dphi - B_b Omega_b + T_bit       T_bit = -tau_sl sgn(Omega_b); at rest it holds up to tau_st

    input  V [V] motor voltage          outputs  I_m [A] motor current, Omega_r [rad/s]

        source V --> ammeter I_m --> motor =(gear n)= rotary_table --> string --> bha == bit --> borehole
                                                           |
                                                  tachometer Omega_r

Defaults: the scale model of a report on the estimation of drillstring parameters (KSEPL, 1992, appendix B). The absolute angles do not
matter, and are no states. Appendix A of the report has the drive of a real rig instead of the amplifier: `drive="rectifier"`.
"""

from typing import Any, Literal

from ..electrical import CurrentSensor, DCMotor, ElectricalGround, TwoPin, Voltage
from ..errors import ModelError
from ..language import Component, Equation, Parameter, SignalInput, Variable, equal, law
from ..mechanics.rotational import AngularVelocitySensor, Gear, RotationalFixed, Rotor, StickSlip, TorsionString
from ..model import Model

STIFFNESS, INERTIA, DAMPING = 0.0868, 0.0529, 0.001  # k_s [N.m/rad], J_b [kg.m2], B_b [N.m.s/rad] of the scale model


class RectifierDrive(TwoPin):
    """A thyristor drive: a PI circuit sends current until the motor voltage is what the reference asks for.

        i_m = K_p e + K_i x,   x' = e,   e = V_r - K_mv v_m - K_str i_m             v_m, i_m to the motor, out of p

    The last term is the soft torque feedback: the table yields to the torque of the string (report, eq. A3 and section 2.5).

    Variables:  x [V.s] integral of the error (state); v [V], i [A] from p to n
    Signals:    V_r [V] reference (input)
    Connectors: p, n
    Parameters: K_p [A/V] 1 by default, K_i [A/(V.s)] 10 by default, K_mv [1] 1 by default: not in the report, chosen for the scale model;
                K_str [ohm] 0 by default (absent)
    """

    x = Variable("V.s", state=True, description="integral of the voltage error")
    V_r = SignalInput("V", description="reference voltage")
    K_p = Parameter("A/V", 1.0, min=1e-9, description="proportional gain")
    K_i = Parameter("A/(V.s)", 10.0, min=0.0, description="integral gain")
    K_mv = Parameter("1", 1.0, min=1e-9, description="gain of the voltage feedback")
    K_str = Parameter("ohm", 0.0, min=0.0, description="soft torque feedback of the current")

    def equations(self, c: Any) -> dict[str, Equation]:
        error = c.V_r - c.K_mv * c.v + c.K_str * c.i  # i enters at p: the motor's current is -i
        return {
            **super().equations(c),
            "integral": equal(c.der(c.x), error),
            "PI circuit": law(-c.i, c.K_p * error + c.K_i * c.x, unit="A"),
        }


def drillstring(sections: int = 1, drive: Literal["voltage", "rectifier"] = "voltage") -> Model:
    """The drillstring: states motor.i, rotary_table.omega, string.dphi, bha.omega; places motor, rotary_table, bha; string on request.

    sections  strings in series, named string_1, section_1, string_2, .. when there are more than one. They share the stiffness of the
              string (P k_s each, so that the static twist stays the same), and with the BHA its inertia and damping (J_b/P, B_b/P each)
    drive     "voltage": an amplifier, input V;  "rectifier": the `RectifierDrive`, with state source.x and input V_r

    Raises ModelError for a number of sections below one and for another drive.
    """
    if isinstance(sections, bool) or not isinstance(sections, int) or sections < 1:
        raise ModelError(f"drillstring(sections={sections!r}): a whole number of one or more is needed")
    if drive not in ("voltage", "rectifier"):
        raise ModelError(f"drillstring(drive={drive!r}): the drive is 'voltage' or 'rectifier'; choose one of them")
    parts, joints = _string(sections)
    source: Component = Voltage() if drive == "voltage" else RectifierDrive()
    return Model(
        name="drillstring",
        description="A rotary table that turns a bit through a soft string: torsional oscillations and stick-slip",
        components={
            "source": source,
            "ammeter": CurrentSensor(),
            "motor": DCMotor(L=0.116, R=22.0, Km=11.0),
            "earth": ElectricalGround(),
            "gear": Gear(ratio=1.0),
            "rotary_table": Rotor(J=0.3, d=0.03),
            "tachometer": AngularVelocitySensor(),
            **parts,
            "bha": Rotor(J=INERTIA / sections, d=DAMPING / sections),
            "bit": StickSlip(tau_sl=0.4, tau_st=0.6),
            "borehole": RotationalFixed(),
        },
        connections=(
            ("source.p", "ammeter.p"),
            ("ammeter.n", "motor.p"),
            ("motor.n", "source.n"),
            ("source.n", "earth.pin"),
            ("motor.flange", "gear.flange_a"),
            ("gear.flange_b", "rotary_table.flange"),
            ("tachometer.flange", "rotary_table.flange"),
            *joints,
            ("bha.flange", "bit.flange_a"),
            ("bit.flange_b", "borehole.flange"),
        ),
        inputs={"V": "source.v"} if drive == "voltage" else {"V_r": "source.V_r"},
        outputs={"I_m": "ammeter.i", "Omega_r": "tachometer.omega"},
    )


def _string(sections: int) -> tuple[dict[str, Component], list[tuple[str, str]]]:
    """Strings and the inertias between them, from the rotary table to the BHA."""
    names = ["string"] if sections == 1 else [f"string_{i + 1}" for i in range(sections)]
    parts: dict[str, Component] = {}
    joints, above = [], "rotary_table"
    for i, name in enumerate(names):
        below = "bha" if i == sections - 1 else f"section_{i + 1}"
        parts[name] = TorsionString(k=STIFFNESS * sections)
        if below != "bha":
            parts[below] = Rotor(J=INERTIA / sections, d=DAMPING / sections)
        joints += [(f"{above}.flange", f"{name}.flange_a"), (f"{name}.flange_b", f"{below}.flange")]
        above = below
    return parts, joints
