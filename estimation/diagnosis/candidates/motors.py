"""The library of what is between a circuit and a shaft: a constant that waves with the angle or saturates, and a voltage that is lost.

Teeth and poles make the torque of one current uneven, iron saturates; brushes, and the dead time of an inverter, take a voltage whichever
way it flows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf, pi

from backsight.models import Model
from backsight.models.electrical import EMF, DCMotor, TorqueMotor, TwoPin, UnevenDCMotor, UnevenEMF, UnevenTorqueMotor, VoltageDrop
from backsight.models.language import Component

from .candidate import Candidate
from .couplings import Behind
from .edits import Exchange, Rebuild
from .places import free_name, neighbours, own_name

UNEVEN: dict[type[Component], type[Component]] = {DCMotor: UnevenDCMotor, EMF: UnevenEMF, TorqueMotor: UnevenTorqueMotor}
MOST = 48  # waves in one turn
ROWS = 4.0  # of a recording, that a wave is long at the least at the motor's usual speed
LARGEST = 0.5  # of a wave over the mean
THERE = (0.005, 0.02, 0.08, 0.3)  # of the usual current, at which what is lost is there


@dataclass(frozen=True, kw_only=True)
class Turning:
    """How a motor moved: rms of its current [A] and of its speed [rad/s], interval of the rows [s].

    span: of its angle in the recording in which that is largest [rad].
    """

    current: float
    speed: float
    span: float
    interval: float


def of_motor(model: Model, name: str, moved: Callable[[str], Turning | None], values: Mapping[str, float]) -> list[Candidate]:
    """Of a component; none where it is no motor, or stood still without a current.

    moved: how it did, by its name. values: of the model's parameters; what is not nothing is there already.
    """
    component = model.components[name]
    if type(component) not in (*UNEVEN, *UNEVEN.values()) or (turning := moved(name)) is None or not turning.current > 0:
        return []
    amplitude, b = (values.get(own_name(model, f"{name}.{word}"), 0.0) for word in ("amplitude", "b"))
    drops = isinstance(component, TwoPin) and not any(isinstance(model.components[n], VoltageDrop) for n in neighbours(model, f"{name}.p"))
    return [
        *(_waving(model, name, turning) if not amplitude else ()),
        *((_saturating(model, name),) if not b else ()),
        *((_dropping(model, name, turning),) if drops else ()),
    ]


def _richer(model: Model, name: str) -> Exchange:
    """The edit that gives a motor a constant that is none; the same again where it has that already."""
    component = model.components[name]
    own = {word: value for word, value in component.parameters.items() if f"{name}.{word}" not in model.bindings}
    return Exchange(name=name, component=UNEVEN.get(type(component), type(component))(**own))


def _waving(model: Model, name: str, turning: Turning) -> list[Candidate]:
    """A constant that waves: as many waves in a turn as were seen by half at least, and in more than a few rows each."""
    orders = [n for n in range(1, MOST + 1) if n * turning.span > pi and n * turning.speed * turning.interval * ROWS < 2 * pi]
    amplitude, phase, order = (f"{name}.{word}" for word in ("amplitude", "phase", "order"))
    candidate = Candidate(
        place=name,
        family="actuator",
        physics="torque_ripple",
        edits=(_richer(model, name),),
        strengths=(amplitude,),
        quadrature=phase,
        shapes={order: tuple(float(n) for n in orders)},
        start={amplitude: (0.0, -LARGEST, LARGEST), phase: (0.0, -3 * pi, 3 * pi), order: (1.0, 0.0, inf)},
        named={"amplitude": amplitude, "phase": phase, "order": order},
    )
    return [candidate] if orders else []


def _saturating(model: Model, name: str) -> Candidate:
    """A constant that falls with the current."""
    b = f"{name}.b"
    return Candidate(
        place=name,
        family="electrical",
        physics="magnetic_saturation",
        edits=(_richer(model, name),),
        strengths=(b,),
        one_sided=True,
        start={b: (0.0, 0.0, inf)},
        named={"b": b},
    )


def _dropping(model: Model, name: str, turning: Turning) -> Candidate:
    """A voltage that is lost at a pin of it."""
    lost, currents = free_name(model, f"voltage_drop_{name}"), tuple(share * turning.current for share in THERE)
    edit = Behind(flange=f"{name}.p", coupling=lost, component=VoltageDrop(), turned=True)
    return Candidate(
        place=name,
        family="electrical",
        physics="voltage_drop",
        edits=(Rebuild(edit=edit, said=f"{lost} = {VoltageDrop.__name__}() at {name}.p"),),
        strengths=(f"{lost}.v_d",),
        one_sided=True,
        shapes={f"{lost}.i_0": currents},
        start={f"{lost}.i_0": (currents[0], currents[0] / 10, turning.current)},
        named={"v_d": f"{lost}.v_d", "i_0": f"{lost}.i_0"},
    )
