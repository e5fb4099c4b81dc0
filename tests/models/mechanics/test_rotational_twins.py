"""Turning components and their sliding twins, which have tests by hand: the same laws in other units."""

from __future__ import annotations

import numpy as np
import pytest
from one_dimensional import SLIDING, TURNING, UNITS, WORDS, Alone, twin

from backsight.models import Component
from backsight.models.mechanics import rotational as r
from backsight.models.mechanics import translational as t

ELEMENTS: list[Component] = [
    t.Friction(d=2.0, f_c=3.0, width=0.2),
    t.StribeckFriction(d=0.2, f_c=3.0, f_s=5.0, v_s=0.3, width=0.2),
    t.LogarithmicFriction(b=2.0, c=15.0, v0=0.5, v_dead=0.1, width=0.05),
    t.AsymmetricFriction(d_plus=2.0, d_minus=1.0, f_plus=4.0, f_minus=3.0, width=0.2),
    t.PositionDependentFriction(d=0.3, f_c=2.0, amplitude=0.6, period=0.7, phase=0.7, width=0.2),
    t.LoadFriction(mu=0.3, load=20.0, width=0.2),
    t.LoadDependentFriction(mu=0.3, load_width=2.0, width=0.2),
    t.StickSlip(f_sl=2.0, f_st=3.0, width=0.2),
    t.DahlFriction(sigma_0=40.0, f_c=2.0, d=0.1, width=0.2),
    t.LuGreFriction(sigma_0=40.0, sigma_1=3.0, f_c=2.0, f_s=3.0, v_s=0.2, d=0.4, width=0.2),
    t.Spring(k=30.0, s_rel0=0.2),
    t.CubicSpring(k=3.0, k3=20.0, s_rel0=0.2),
    t.Damper(d=2.0),
    t.SpringDamper(k=30.0, d=2.0),
    t.Drag(d=0.5, c=2.0),
    t.EndStop(x=0.3, k=50.0, d=8.0, width=0.05),
    t.LowerEndStop(x=-0.3, k=50.0, d=8.0, width=0.05),
    t.Cogging(amplitude=2.0, period=0.3, phase=0.4),
    t.Backlash(gap=0.6, k=50.0, d=8.0, width=0.05),
]
OF_THEIR_OWN = {  # with tests of their own
    *(r.Inertia, r.AddedInertia, r.Rotor, r.RotationalFixed, r.RotationalRigid, r.TorsionString, r.Gear, r.GearWithError, r.Rack),
    *(r.EccentricRack, r.Torque, r.ConstantTorque, r.Angle, r.AngularSpeed, r.AngularAcceleration, r.AngleSensor, r.AngularVelocitySensor),
    *(r.AngularAccelerationSensor, r.TorqueSensor, r.RotationalPowerSensor, r.RotationalElement, r.TurningElement, r.EccentricWeight),
}


def test_every_turning_component_is_a_twin_or_has_tests_of_its_own() -> None:
    assert {type(twin(element)) for element in ELEMENTS} | OF_THEIR_OWN == TURNING
    assert {type(element) for element in ELEMENTS} <= SLIDING


@pytest.mark.parametrize("element", ELEMENTS, ids=lambda x: type(x).__name__)
def test_a_turning_element_has_the_law_of_the_sliding_one(element: Component) -> None:
    generator = np.random.default_rng(4)
    s, v, z, load = generator.uniform(-1.0, 1.0, (4, 300)) * np.array([[1.0], [1.0], [0.1], [9.0]])
    sliding, turning = Alone(element).at(s, v, z, load), Alone(twin(element)).at(s, v, z, load)
    assert np.ptp(sliding[0]) > 1.0
    for one, other in zip(sliding, turning, strict=True):
        assert one == pytest.approx(other, rel=1e-13)


@pytest.mark.parametrize("element", ELEMENTS, ids=lambda x: type(x).__name__)
def test_a_turning_element_has_the_parameters_of_the_sliding_one_in_its_own_units(element: Component) -> None:
    ours, theirs = element.declared_parameters, twin(element).declared_parameters
    assert [WORDS.get(name, name) for name in ours] == list(theirs)
    for one, other in zip(ours.values(), theirs.values(), strict=True):
        assert other.unit == ("rad" if one.description.startswith("phase") else UNITS[one.unit])
        assert (one.min, one.max, one.smoothing) == (other.min, other.max, other.smoothing)
