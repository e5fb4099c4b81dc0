"""Everything that may be missing in a model: laws at its bodies and elements, what inputs and sensors may do, and its fixed parameters."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import Any

import casadi as ca
import numpy as np

from backsight.models import Dae, Model, compile_model
from backsight.models.augmentation.parameters import without_case
from backsight.models.errors import ModelError
from backsight.models.mechanics.rotational import EccentricRack, Gear, GearWithError, Rack
from backsight.models.mechanics.spatial import RigidBody
from backsight.ocp import Horizon, Solution

from ...problem import Free, Problem
from ...smoothing.along import along, times_within
from ...smoothing.begun import followed_by
from ...smoothing.rest import friction_laws, rounding
from ...smoothing.unseen import moving_unseen
from .candidate import Candidate
from .channels import OFF_CENTRE, of_alike, of_input, of_sensor
from .couplings import Behind, of_coupling, of_ideal, of_soft
from .edits import Exchange, Rebuild
from .frames import of_frames
from .laws import AGAINST_GROUND, BETWEEN, FINEST, Motion, between, of_law
from .loads import of_loads
from .motors import Turning, of_motor
from .places import Spot, bodies, elements, free_name, neighbours, of_machine, own_name, sensors, source
from .presliding import of_presliding
from .waves import fine_periods

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

LOOKED_AT = 2000  # places of a recording where motions are looked at
HEARD = 4.0  # mean square of a reading over that of its noise: of less a gain would be one of noise
UNITS = ("N", "N.m")
MASSES = ("m", "J")


def library(problem: Problem, model: Model, solution: Solution, brought: Collection[str] = ()) -> list[Candidate]:
    """All candidates of a model, for how it moved in a solution. brought: its components that were candidates themselves."""
    found = list[Candidate]()
    dae = solution.transcription.dae
    motions, values = _Motions(problem, solution), dict(zip((p.name for p in dae.parameters), solution.parameters.tolist(), strict=True))
    places = {p.name: p.unit for p in dae.places}
    for spot in bodies(model):
        merged = dae.merged_places.get(spot.name, spot.name) != spot.name
        if merged or places.get(spot.name, "N") not in UNITS:
            continue
        motion = motions.of(spot)
        if motion is not None:
            found += [of_law(law, model, spot, motion, brought) for law in AGAINST_GROUND if law.there(spot.kind, motion)]
            found += of_loads(model, spot, motion, motions.size)
            found += of_presliding(model, spot, motion, values, seen=motions.seen(spot)) if spot.name in places else []
    masses = _masses(model, values)
    for spot in elements(model):
        motion = motions.of(spot)
        if motion is not None:
            found += [of_law(law, model, spot, motion) for law in BETWEEN if spot.name == between(law, model, spot)]
            found += of_coupling(model, spot, motion, masses, values) + of_soft(model, spot, motion, masses, values)
    spots = {spot.name: spot for spot in bodies(model)}
    for name, component in model.components.items():
        if isinstance(component, (Gear, Rack)):
            found += of_ideal(model, name, lambda body: motions.of(spots[body]) if body in spots else None, masses, values)
    t = solution.transcription
    interval = float(np.median(np.concatenate([np.diff(h.time) for h in t.horizons])))
    found += _kinematic(model, values) + _uneven(model, values) + of_frames(model, values)
    for name in model.components:
        found += of_motor(model, name, lambda motor: motions.turning(motor, interval), values)
    duration = float(max(h.time[-1] - h.time[0] for h in t.horizons))
    for name in model.inputs:
        k = [q.name for q in dae.inputs].index(name)
        found += of_input(model, name, [h.inputs[:, k] for h in t.horizons], interval, duration)
    for group in _alike(model):
        found += of_alike(model, group, interval, duration)
    heard = {q.name: _heard(t.horizons, i) for i, q in enumerate(dae.outputs)}
    spans = {q.name: _span(t.horizons, i) for i, q in enumerate(dae.outputs) if q.unit == "rad"}
    begin = float(min(h.clock + h.time[0] for h in t.horizons))
    read = [name for name, times in heard.items() if np.isfinite(times)]
    units, owners = {q.name: q.unit for q in dae.outputs}, {name: source(model, model.measured[name].variable) for name in read}
    for name in read:
        others = [o for o in read if o != name and (owners[o], units[o]) == (owners[name], units[name])]
        found += of_sensor(model, name, others, interval, duration, scaled=heard[name] > HEARD, span=spans.get(name), begin=begin)
    return [_said(_absorbing(c, problem, values), problem, model) for c in found] + _fixed(
        problem, model, dae, solution.parameters, brought
    )


def _heard(horizons: Sequence[Horizon], output: int) -> float:
    """Mean square of an output's samples over that of its noise; NaN where there are none."""
    relative = np.concatenate([h.target[:, output] / h.target_std[:, output] for h in horizons])
    sampled = relative[np.isfinite(relative)]
    return float(np.mean(sampled**2)) if len(sampled) else np.nan


def _span(horizons: Sequence[Horizon], output: int) -> float:
    """Between the least and the largest sample of an output."""
    samples = np.concatenate([h.target[:, output] for h in horizons])
    return float(np.ptp(samples[np.isfinite(samples)])) if np.isfinite(samples).any() else 0.0


def _alike(model: Model) -> list[list[str]]:
    """Inputs that drive the same of parts of one kind."""
    groups: dict[tuple[type, str], list[str]] = {}
    for name, path in model.inputs.items():
        owner, _, word = path.partition(".")
        groups.setdefault((type(model.components[owner]), word), []).append(name)
    return [names for names in groups.values() if len(names) > 1]


def _absorbing(c: Candidate, problem: Problem, there: dict[str, float]) -> Candidate:
    """The candidate, taking over only what the model has: a strength that is fixed at nothing is none."""
    own = {n: by for n, by in c.absorbs.items() if isinstance(problem.parameters.get(n), Free) or there.get(n, 0.0) != 0.0}
    return c if own == c.absorbs else replace(c, absorbs=own)


def _said(c: Candidate, problem: Problem, model: Model) -> Candidate:
    """A mass that is added where the study says that there is none is a number of the study that is wrong."""
    if c.physics != "added_mass" or not c.edits or c.place not in model.components:
        return c
    word = c.strengths[0].rpartition(".")[2]
    given = problem.parameters.get(own_name(model, f"{c.place}.{word}"))
    return replace(c, stated=True) if not isinstance(given, Free) and given == 0.0 else c


def _masses(model: Model, values: dict[str, float]) -> dict[str, float]:
    """Component -> its mass or moment of inertia."""
    paths = {name: f"{name}.{word}" for name, c in model.components.items() for word in MASSES if word in c.declared_parameters}
    return {name: values[told] for name, path in paths.items() if (told := own_name(model, path)) in values}


def _kinematic(model: Model, values: Mapping[str, float]) -> list[Candidate]:
    """Wheels that are not round. values: of the model's parameters."""
    found, reading = [], sensors(model)
    for name, component in model.components.items():
        ends = {
            end.partition(".")[0]
            for pair in model.connections
            for end in pair
            if name in (pair[0].partition(".")[0], pair[1].partition(".")[0])
        }
        if type(component) is not Rack or ends & reading:
            continue
        wheel = EccentricRack(r=component.parameters["r"]) if f"{name}.r" not in model.bindings else EccentricRack()
        drive = next(
            (e.partition(".")[0] for pair in model.connections if f"{name}.wheel" in pair for e in pair if not e.startswith(f"{name}.")),
            name,
        )
        farthest = OFF_CENTRE * abs(values.get(own_name(model, f"{name}.r"), inf))
        found.append(
            Candidate(
                place=drive,
                family="periodic",
                physics="eccentricity",
                edits=(Exchange(name=name, component=wheel),),
                strengths=(f"{name}.amplitude",),
                quadrature=f"{name}.phase",
                start={f"{name}.amplitude": (0.0, -farthest, farthest), f"{name}.phase": (0.0, -3 * np.pi, 3 * np.pi)},
                named={"amplitude": f"{name}.amplitude", "phase": f"{name}.phase"},
            )
        )
    return found


def _uneven(model: Model, values: Mapping[str, float]) -> list[Candidate]:
    """Gears that wave once or twice per turn of either side, but where there are only sensors behind them. values: as above.

    What waves is put behind the gear, so that the angle of the side that has the states tells that of the other.
    """
    found, reading = [], sensors(model)
    gears = [name for name, component in model.components.items() if type(component) is Gear]
    own = _states(model) if gears else []
    for name in gears:
        flanges = [f"{name}.{flange}" for flange in model.components[name].declared_connectors]
        if any(neighbours(model, flange) - {name} <= reading for flange in flanges):
            continue
        wave = free_name(model, f"{name}_error")
        ways = [Behind(flange=flanges[1], coupling=wave, component=GearWithError(), turned=turned) for turned in (True, False)]
        edit = next((way for way in ways if _states(way(model)) == own), None)
        if edit is None:
            continue
        turns = abs(values.get(own_name(model, f"{name}.ratio"), model.components[name].parameters["ratio"]))
        amplitude, phase, order = (f"{wave}.{word}" for word in ("amplitude", "phase", "order"))
        found.append(
            Candidate(
                place=name,
                family="transmission",
                physics="kinematic_error",
                edits=(Rebuild(edit=edit, said=f"{wave} = {GearWithError.__name__}() behind {name}"),),
                strengths=(amplitude,),
                quadrature=phase,
                shapes={order: tuple(sorted({1.0, 2.0, turns, 2.0 * turns}))},
                start={
                    amplitude: (0.0, -OFF_CENTRE, OFF_CENTRE),
                    phase: (0.0, -3 * np.pi, 3 * np.pi),
                    order: (1.0, 0.0, inf),
                },
                named={"amplitude": amplitude, "phase": phase, "order": order},
            )
        )
    return found


def _states(model: Model) -> list[str]:
    """Names of its states; none where it cannot be compiled, for it names some that it does not have."""
    try:
        return [q.name for q in compile_model(model).states]
    except ModelError:
        return []


def _fixed(problem: Problem, model: Model, dae: Dae, values: Array, brought: Collection[str]) -> list[Candidate]:
    """Every parameter of the machine that was taken for known."""
    reading = sensors(model)
    found = []
    for info, value in zip(dae.parameters, values, strict=True):
        owner = info.name.partition(".")[0]
        given = problem.parameters.get(without_case(info.name))  # one that every recording has of its own is given once
        if isinstance(given, Free) or info.smoothing or value == 0 or owner in {*reading, *brought} or info.unit == "rad":
            continue
        if given is None and not of_machine(info.name, model):
            continue
        size = abs(float(value))
        found.append(
            Candidate(
                place=owner,
                family="parameter",
                physics="wrong_parameter",
                strengths=(info.name,),
                start={info.name: (float(value), max(info.minimum, float(value) - 0.9 * size), min(info.maximum, float(value) + 9 * size))},
                named={info.name: info.name},
                stated=given is not None,
            )
        )
    return found + _tilting(model, found)


def _tilting(model: Model, single: Sequence[Candidate]) -> list[Candidate]:
    """Both moments of inertia about the axes that a body in space tilts about: computed, not weighed, they are wrong together."""
    by_name, found = {c.strengths[0]: c for c in single}, list[Candidate]()
    for name, component in model.components.items():
        if isinstance(component, RigidBody):
            about = dict.fromkeys(own_name(model, f"{name}.{word}") for word in ("Ixx", "Iyy"))
            both = [by_name[path] for path in about if path in by_name]
            if len(both) == 2:
                x, y = both
                start, named = {**x.start, **y.start}, {**x.named, **y.named}
                found.append(replace(x, strengths=(*x.strengths, *y.strengths), start=start, named=named, stated=x.stated or y.stated))
    return found


class _Motions:
    """How bodies and elements moved."""

    def __init__(self, problem: Problem, solution: Solution) -> None:
        self._solution, self._followed = solution, followed_by(solution)
        plain = problem.plain
        self._unseen = {plain.dae.places[k].name for k in moving_unseen(plain)}
        self._laws = {law.velocity: problem.dae.parameters[law.width].name for law in friction_laws(problem)}

    def of(self, spot: Spot) -> Motion | None:
        """None where the model has no such motion."""
        position, velocity = self._named(self._solution.transcription.dae, spot)
        if velocity is None:
            return None
        moved = self._course(velocity)
        rms = float(np.sqrt(np.mean(moved**2)))
        where = np.zeros(1) if position is None else self._course(position)
        if not rms > 0:
            return None
        fine = self._fine(spot.name, position) if len(spot.flanges) == 1 and position is not None else ()
        sharp = self._width(velocity) or rounding(moved, resting=self.seen(spot))
        return Motion(v_rms=rms, low=float(where.min()), high=float(where.max()), fine=fine, sharp=sharp)

    def seen(self, spot: Spot) -> bool:
        """Whether an output shows how a body moves."""
        return spot.name not in self._unseen

    def size(self, name: str) -> float:
        """Rms of a variable of the model along the trajectories; 0 where it has none of that name."""
        variables = self._solution.transcription.dae.variables
        return self.size_of(variables[name]) if name in variables else 0.0

    def size_of(self, expression: Any) -> float:
        """The same of an expression of the model."""
        return float(np.sqrt(np.nanmean(self._course(expression) ** 2)))

    def turning(self, motor: str, interval: float) -> Turning | None:
        """How a motor turned, read at intervals [s]; None where the model has no such motion."""
        dae = self._solution.transcription.dae
        current, angle = (dae.variables.get(f"{motor}.{word}") for word in ("i", "flange.phi"))
        if current is None or angle is None:
            return None
        span = max(float(np.ptp(phi)) for phi in self._courses(angle))
        speed = self.size_of(ca.jtimes(angle, dae.x, dae.dx))
        return Turning(current=self.size_of(current), speed=speed, span=span, interval=interval)

    def _course(self, expression: Any) -> Array:
        """A scalar of the model along the trajectories of all recordings."""
        return np.concatenate(self._courses(expression))

    def _courses(self, expression: Any) -> list[Array]:
        """The same, of each of them."""
        t, found = self._solution.transcription, list[Array]()
        for number, times in enumerate(times_within(t.horizons, LOOKED_AT)):
            found.append(along(t.dae, expression, self._followed, number, times, self._solution.parameters).ravel())
        return found

    def _width(self, velocity: Any) -> float | None:
        """That of a law which the model has there: another one with another width would tell from it what is no difference."""
        dae, parameters = self._solution.transcription.dae, self._solution.parameters
        names = [p.name for p in dae.parameters]
        for own, width in self._laws.items():
            if own in dae.variables and _equal(dae, dae.variables[own], velocity):
                return float(parameters[names.index(width)])
        return None

    def _fine(self, place: str, position: Any) -> tuple[float, ...]:
        """Periods at which the residual force of a place waves along the way of the longest recording."""
        t = self._solution.transcription
        k = next((k for k, p in enumerate(t.dae.places) if p.name == place and k in t.soft), None)
        if k is None:
            return ()
        number = max(range(len(t.horizons)), key=lambda n: len(t.horizons[n].time))
        times = (t.horizons[number].time[1:] + t.horizons[number].time[:-1]) / 2
        with_memory = t.dae.variables.get(f"residual.{place}")  # of a coloured force its row has only the noise
        left = t.dae.undisturbed(t.dae.residual[t.dae.rows_of([k])]) if with_memory is None else with_memory
        where, force = along(t.dae, ca.vertcat(position, left), self._followed, number, times, self._solution.parameters)
        told = np.isfinite(where) & np.isfinite(force)
        return fine_periods(where[told], force[told], FINEST) if told.sum() > 1 else ()

    def _named(self, dae: Dae, spot: Spot) -> tuple[object | None, object | None]:
        variables = dae.variables
        words = (
            ((("s", "v"),) if spot.kind == "translational" else (("phi", "omega"),))
            if len(spot.flanges) == 1
            else (("s_rel", "v_rel"), ("phi_rel", "omega_rel"), ("dphi", "omega_rel"), ("flange_b.s", None), ("flange_b.phi", None))
        )
        for where, rate in words:
            if rate is not None and f"{spot.name}.{rate}" in variables:
                return variables.get(f"{spot.name}.{where}"), variables[f"{spot.name}.{rate}"]
            if rate is not None and where.endswith("_rel") and (position := variables.get(f"{spot.name}.{where}")) is not None:
                return position, ca.jtimes(position, dae.x, dae.dx)  # of a spring, which declares no rate
            if rate is None and f"{spot.name}.{where}" in variables:
                return variables[f"{spot.name}.{where}"], variables[f"{spot.name}.{where}"]
        return None, None


def _equal(dae: Dae, one: Any, other: Any) -> bool:
    """Whether two expressions of a model have one value at any states."""
    motion = ca.vertcat(dae.dx, dae.x, dae.z)
    both = ca.Function("both", [motion, dae.u, dae.p, dae.w, dae.t], [one, other])
    at = np.random.default_rng(0).standard_normal((motion.shape[0], 3))
    values = [both(x, 0, [q.value for q in dae.parameters], 0, 0) for x in at.T]
    return all(np.allclose(np.asarray(a), np.asarray(b), rtol=1e-12, atol=0.0) for a, b in values)
