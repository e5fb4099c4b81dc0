"""The closed loop of a concealed machine, in any coordinates, with friction that sticks; and how strong what it conceals is.

    M(q) v' = f(t, q, v) + D u(t) + w + sum of concealed forces - friction        q' = v                    (`stick_slip.py`)

u acts as `acting.py` says, w is a coloured disturbance held over each row. States of first order (a current, a bristle's deflection)
are velocities of coordinates that matter to nothing. Strength of a concealed effect: what the machine without it, its parameters true,
lacks on the true motion, row by row, is M_0 a - f_0 - D u_commanded + friction_0; its rms over that of the force at the place.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Protocol, TypeVar

import numpy as np

from ..run import Conditions, Sensors, clock
from ..stick_slip import Dynamics, Friction, accelerations, advance
from .acting import Actuation, InputFault
from .effects import Effect
from .sensing import SensorFault

__all__ = ["Control", "Machine", "Setting", "Trace", "operate", "shares"]

Fault = TypeVar("Fault", InputFault, SensorFault)
OWN = 0.1  # noise of the sensors that the control has of its own, over that of the recorded ones


class Machine(ABC):
    """A machine in n coordinates; the first ones are those of the machine without structure of its own, named after their forces."""

    places: ClassVar[tuple[str, ...]]
    inputs: ClassVar[tuple[str, ...]]
    outputs: ClassVar[tuple[str, ...]]

    @property
    def substeps(self) -> int:
        """Of the integration in a row."""
        return 1

    @property
    @abstractmethod
    def start(self) -> np.ndarray:
        """q (n,) at rest."""

    @property
    @abstractmethod
    def friction(self) -> Friction:
        """Of the n coordinates."""

    @abstractmethod
    def equations(self, q: np.ndarray, v: np.ndarray, /) -> tuple[np.ndarray, np.ndarray]:
        """M (n, n) and f (n,) without inputs and friction."""

    @abstractmethod
    def drive(self, u: np.ndarray, /) -> np.ndarray:
        """D u (n,)."""

    @abstractmethod
    def read(self, q: np.ndarray, v: np.ndarray, a: np.ndarray, /) -> np.ndarray:
        """The outputs without noise."""

    def plain(self, motion: np.ndarray, /) -> np.ndarray:
        """Those (places, rows) of q, v or a (n, rows) that the machine without structure of its own has."""
        return motion[: len(self.places)]

    def load(self, _q: np.ndarray, _v: np.ndarray, u: np.ndarray, /) -> np.ndarray:
        """The force at each place (places,)."""
        return self.drive(u)[: len(self.places)]


class Control(Protocol):
    """What turns readings into commands, row by row."""

    def command(self, k: int, readings: np.ndarray) -> np.ndarray:
        """u of row k."""


@dataclass(frozen=True, kw_only=True)
class Setting:
    """How a machine is run: `Conditions` (its process is white), and a coloured force: place -> rms, with correlation time tau [s]."""

    conditions: Conditions
    coloured: Mapping[str, float]
    tau: float = 0.05


@dataclass(frozen=True, kw_only=True)
class Trace:
    """time (n,), commands (n, inputs), what acted, q, v, a (n, coordinates), clean outputs (n, outputs) and the errors of the readings.

    jumps (n, outputs): of the outputs where a row begins; what jumps between two rows, as at a late command, is not among them.
    """

    time: np.ndarray
    commands: np.ndarray
    acted: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    clean: np.ndarray
    jumps: np.ndarray
    sensors: Sensors

    def recorded(self, names: tuple[str, ...], effects: tuple[Effect, ...]) -> dict[str, np.ndarray]:
        """Readings (n,) of the outputs, with the faults of their sensors."""
        clean, jumps = (dict(zip(names, of.T, strict=True)) for of in (self.clean, self.jumps))
        faults = sensor_faults(effects)
        true = {o: faults[o].read(o, self.time, clean, jumps) if o in faults else clean[o] for o in names}
        return {o: np.array([self.sensors.read(o, k, float(y)) for k, y in enumerate(true[o])]) for o in names}


def input_faults(effects: tuple[Effect, ...], names: tuple[str, ...]) -> dict[int, InputFault]:
    """Input's number -> fault, with the onset of its effect."""
    return {names.index(u): _begun(f, e) for e in effects for u, f in e.inputs.items()}


def sensor_faults(effects: tuple[Effect, ...]) -> dict[str, SensorFault]:
    """Output -> fault, with the onset of its effect."""
    return {o: _begun(f, e) for e in effects for o, f in e.sensors.items()}


def _begun(fault: Fault, effect: Effect) -> Fault:
    return fault if effect.onset is None else replace(fault, onset=effect.onset)


def disturbance(setting: Setting, places: tuple[str, ...], n: int, time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Ornstein-Uhlenbeck forces (rows, n), held from row to row."""
    out, keep = np.zeros((time.size, n)), np.exp(-setting.conditions.step / setting.tau)
    for i, place in enumerate(places):
        x, draws = 0.0, rng.standard_normal(time.size)
        rms = setting.coloured.get(place, 0.0)
        for k in range(time.size if rms else 0):
            x = keep * x + rms * np.sqrt(1 - keep**2) * draws[k]
            out[k, i] = x
    return out


def operate(machine: Machine, control: Control, setting: Setting, effects: tuple[Effect, ...], rng: np.random.Generator) -> Trace:
    """Run it from rest; the effects' values and structure are in the machine already."""
    time = clock(setting.conditions, rng)
    rows, q, v = time.size, machine.start, np.zeros_like(machine.start)
    sensors, held = Sensors(setting.conditions, rows, rng), disturbance(setting, machine.places, q.size, time, rng)
    actuation = Actuation(input_faults(effects, machine.inputs), np.zeros(len(machine.inputs)))
    record = [np.empty((rows, k)) for k in (len(machine.inputs), len(machine.inputs), q.size, q.size, q.size, len(machine.outputs))]
    commands, acted, qs, vs, accs, clean = record
    jumps = np.zeros_like(clean)
    for k in range(rows):
        seen = machine.read(q, v, np.zeros_like(q))
        commands[k] = control.command(k, seen + OWN * np.array([sensors.error[o][k] for o in machine.outputs]))
        end = time[k + 1] if k + 1 < rows else time[k] + setting.conditions.step
        acting = [e for e in effects if e.acts(time[k])]
        friction = sticking(machine.friction, acting)
        for piece, (t, until, u) in enumerate(actuation.pieces(time[k], end, commands[k])):
            dynamics = _dynamics(machine, u, held[k], acting)
            if piece == 0:
                qs[k], vs[k], acted[k] = q, v, u(t)
                accs[k] = accelerations(dynamics, friction, t, q, v)
                clean[k] = machine.read(q, v, accs[k])
            if k + 1 < rows:
                q, v = advance(dynamics, friction, t, q, v, until - t, machine.substeps)
        if k + 1 < rows:
            jumps[k + 1] = -machine.read(q, v, accelerations(dynamics, friction, end, q, v))
    jumps[1:] += clean[1:]
    return Trace(time=time, commands=commands, acted=acted, q=qs, v=vs, a=accs, clean=clean, jumps=jumps, sensors=sensors)


def _dynamics(machine: Machine, u: Callable[[float], np.ndarray], held: np.ndarray, effects: list[Effect]) -> Dynamics:
    forces = [e.force for e in effects if e.force is not None]

    def dynamics(t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        M, f = machine.equations(q, v)
        f = f + machine.drive(u(t)) + held
        for force in forces:
            f = f + force(t, q, v)
        return M, f

    return dynamics


def sticking(friction: Friction, effects: list[Effect]) -> Friction:
    """The machine's friction with that of the effects; ValueError where some depends on the position and none does not."""
    more = [c for e in effects for c in e.friction]
    if not more:
        return friction
    level = np.zeros_like(friction.sliding)
    for c in more:
        level[c.i] += c.level if c.factor is None else 0.0
    sliding, breakaway = friction.sliding + level, friction.breakaway + level
    waves = [(c.i, c.level / sliding[c.i], c.factor) for c in more if c.factor is not None and sliding[c.i]]
    if len(waves) < sum(c.factor is not None for c in more):
        raise ValueError("friction that depends on the position needs some beside it that does not")

    def factor(_t: float, q: np.ndarray) -> np.ndarray:
        out = np.ones_like(level)
        for i, share, wave in waves:
            out[i] += share * wave(float(q[i]))
        return out

    return Friction(sliding=sliding, breakaway=breakaway, factor=factor if waves else None)


def shares(plain: Machine, machine: Machine, trace: Trace) -> dict[str, float]:
    """Place -> rms of what the plain machine lacks on the motion of the trace over the rms force there; rows at rest do not count."""
    q, v, a = (machine.plain(motion.T).T for motion in (trace.q, trace.v, trace.a))
    lacking, load, level = np.zeros_like(v), np.zeros_like(v), plain.friction
    for k in range(trace.time.size):
        M, f = plain.equations(q[k], v[k])
        lacking[k] = M @ a[k] - f - plain.drive(trace.commands[k]) + level.sliding * np.sign(v[k])
        load[k] = plain.load(q[k], v[k], trace.commands[k])
    lacking[(v == 0) & level.acts] = 0.0
    rms = np.sqrt((lacking**2).mean(axis=0)) / np.sqrt((load**2).mean(axis=0))
    return dict(zip(plain.places, rms.tolist(), strict=True))
