"""Electrical parts: lumped elements, sources, sensors, and the motors that turn current into torque."""

from .elements import Capacitor, ElectricalGround, Inductor, Resistor, TwoPin, VoltageDrop
from .sensors import CurrentSensor, VoltageSensor
from .sources import Current, Voltage
from .transmission import EMF, DCMotor, TorqueMotor
from .uneven import UnevenDCMotor, UnevenEMF, UnevenTorqueMotor

__all__ = [
    "EMF",
    "Capacitor",
    "Current",
    "CurrentSensor",
    "DCMotor",
    "ElectricalGround",
    "Inductor",
    "Resistor",
    "TorqueMotor",
    "TwoPin",
    "UnevenDCMotor",
    "UnevenEMF",
    "UnevenTorqueMotor",
    "Voltage",
    "VoltageDrop",
    "VoltageSensor",
]
