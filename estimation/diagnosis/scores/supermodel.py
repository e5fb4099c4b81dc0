"""The base model with all candidates in it at once, without effect: one compilation for all score tests.

A component at strength nothing changes no equation, so any number of them may stand in one model. Candidates that bring states of their own
change what the trajectory is; they have no score of this kind, and are fitted.

An input or an output that would read otherwise, u + a (changed(u) - u), has the difference as a further input of the model, and a as its
strength (`channels.py` has what may change). So has a force that remembers how the machine moved (`presliding.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from backsight.models import Dae, Model, ParameterInfo, compile_model
from backsight.models.augmentation.extension import extended
from backsight.models.dae import Quantity
from backsight.models.errors import InputError, ModelError
from backsight.ocp import Horizon, Solution

from ...problem import Problem
from ...smoothing.along import along
from ...smoothing.begun import followed_by
from ..candidates.candidate import Candidate, Signal
from ..candidates.edits import Insert
from ..evidence.offsets import with_those_of
from .enlarged import Enlarged
from .score import Columns, Linearised

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """A candidate seen at one shape: parameter -> value, and its columns. whole: of what sets in, the look at it if it acts all along."""

    candidate: Candidate
    shape: dict[str, float]
    columns: Columns
    whole: Look | None = None


def looked_at(problem: Problem, model: Model, base: Linearised, candidates: Sequence[Candidate]) -> list[Look]:
    """All candidates that have a score, at all their shapes."""
    found = list[Look]()
    plain = [c for c in candidates if c.edits and c.strengths and not c.signals]
    carried = {name for c in plain if c.wave is None for name in c.strengths}
    waves = [c.wave is not None and c.wave[0] in carried for c in plain]
    still, waving = ([c for c, own in zip(plain, waves, strict=True) if own is side] for side in (False, True))
    found += _of_components(problem, model, base, still, waving)
    freed = [c for c in candidates if not c.edits and c.strengths and not c.signals]
    if freed:
        found += _of_parameters(base, freed)
    signals = [c for c in candidates if c.signals]
    if signals:
        found += _of_signals(base, signals)
    return found


def _of_components(problem: Problem, model: Model, base: Linearised, candidates: list[Candidate], waving: list[Candidate]) -> list[Look]:
    dae, usable = _together(problem, model, base, candidates)
    if not usable:
        return []
    names = [p.name for p in dae.parameters]
    strengths = [name for c in usable for name in c.strengths]
    at = dict(zip(strengths, range(len(strengths)), strict=True))
    parameters = _values(dae, base.solution)
    enlarged = Enlarged(base, dae, [names.index(n) for n in strengths], base.solution.transcription.horizons, parameters)
    found, turns = list[Look](), max(_turns(c) for c in usable)
    for c in waving:
        carrier, position = c.wave or ("", "")
        if carrier in at and position in dae.variables and not ca.depends_on(dae.variables[position], ca.vertcat(dae.dx, dae.z, dae.w)):
            (grid,) = c.shapes.values()
            waves = enlarged.waves(parameters, at[carrier], dae.variables[position], [2 * np.pi / period for period in grid])
            found += [Look(candidate=c, shape=_shape(c, turn), columns=one) for turn, one in enumerate(waves)]
    for turn in range(turns):
        here = [c for c in usable if turn < _turns(c)]
        shapes = {c.strengths: _shape(c, turn) for c in here}
        parts: dict[tuple[str, ...], list[Columns]] = {c.strengths: [] for c in here}
        for phase in (0.0, np.pi / 2) if any(c.quadrature for c in here) else (0.0,):
            now = parameters.copy()
            for c in here:
                for name, value in shapes[c.strengths].items():
                    now[names.index(name)] = value
                if c.quadrature:
                    now[names.index(c.quadrature)] = phase
            columns = enlarged.columns(now)
            for c in here:
                if c.quadrature or phase == 0.0:
                    parts[c.strengths].append(columns.taken([at[n] for n in c.strengths]))
        found += [Look(candidate=c, shape=shapes[c.strengths], columns=Columns.joined(parts[c.strengths])) for c in here]
    return found


def _turns(c: Candidate) -> int:
    return max((len(grid) for grid in c.shapes.values()), default=1)


def _shape(c: Candidate, turn: int) -> dict[str, float]:
    return {name: grid[turn] for name, grid in c.shapes.items()}


def _together(problem: Problem, model: Model, base: Linearised, candidates: list[Candidate]) -> tuple[Dae, list[Candidate]]:
    """One model with all of them; those that cannot be there, bring states, or move a residual force elsewhere are left out."""
    t = base.solution.transcription
    own, soft = [q.name for q in t.dae.states], {t.dae.places[k].name for k in t.soft}
    asked = _extra(problem, model)

    def compiled(some: list[Candidate]) -> Dae | None:
        try:
            edited = model
            for c in some:
                edited = c.edited(edited)
            dae = _as_posed(problem, with_those_of(problem, compile_model(edited, places=asked)))
        except (ModelError, InputError):  # what the problem names may be gone
            return None
        return dae if [q.name for q in dae.states] == own and soft <= {place.name for place in dae.places} else None

    def with_those_of_them(there: list[Candidate], some: list[Candidate]) -> list[Candidate]:
        """What is there, with those of some others that can be there together; by halves, for most of them can."""
        if not some or compiled([*there, *some]) is not None:
            return [*there, *some]
        half = len(some) // 2
        return with_those_of_them(with_those_of_them(there, some[:half]), some[half:]) if half else there

    dae, usable = compiled(candidates), candidates
    if dae is None:  # what only comes in leaves the rest of a model as it is
        usable = [c for c in candidates if all(isinstance(edit, Insert) for edit in c.edits) or compiled([c]) is not None]
        dae = compiled(usable)
    if dae is None:
        usable = with_those_of_them([], usable)
        dae = compiled(usable)
    return (dae, usable) if dae is not None else (t.dae, [])


def _as_posed(problem: Problem, dae: Dae) -> Dae:
    """A larger model with all that the problem supposes beyond its own: coloured forces, noisy inputs, drifts, parameters of recordings."""
    return replace(problem, model=dae, parameters=problem.varying).posed.dae


def _extra(problem: Problem, model: Model) -> list[str]:
    """Laws whose residual force the study asks for."""
    dormant = {p.name for p in compile_model(model).dormant_places}
    return [name for name in problem.weights.W if name in dormant]


def _values(dae: Dae, solution: Solution) -> Array:
    """Parameters of a larger model: those of the solution, and of the new components what they have."""
    t = solution.transcription
    known = dict(zip((p.name for p in t.dae.parameters), solution.parameters.tolist(), strict=True))
    return np.array([known.get(p.name, p.value) for p in dae.parameters])


def _of_parameters(base: Linearised, candidates: list[Candidate]) -> list[Look]:
    """Parameters of the base model that are fixed."""
    dae = base.solution.transcription.dae
    names = [p.name for p in dae.parameters]
    usable = [c for c in candidates if all(n in names for n in c.strengths)]
    strengths = [n for c in usable for n in c.strengths]
    parameters, horizons = base.solution.parameters, base.solution.transcription.horizons
    enlarged = Enlarged(base, dae, [names.index(n) for n in strengths], horizons, parameters, exact=True)
    still, turned = enlarged.columns(parameters), parameters.copy()
    turned[[names.index(c.quadrature) for c in usable if c.quadrature]] = np.pi / 2
    flat = parameters.copy()
    flat[[names.index(c.quadrature) for c in usable if c.quadrature]] = 0.0
    both = [enlarged.columns(flat), enlarged.columns(turned)] if any(c.quadrature for c in usable) else []
    first, found = 0, list[Look]()
    for c in usable:
        at = range(first, first + len(c.strengths))
        columns = Columns.joined([part.taken(at) for part in both]) if c.quadrature else still.taken(at)
        found.append(Look(candidate=c, shape={}, columns=columns))
        first += len(c.strengths)
    return found


def _of_signals(base: Linearised, candidates: list[Candidate]) -> list[Look]:
    """Inputs and outputs that read otherwise, and forces that follow from the motion."""
    t = base.solution.transcription
    dae = t.dae
    wanted = [(c, signal) for c in candidates for signal in c.signals]
    factors = [ca.SX.sym(f"a_{i}") for i in range(len(wanted))]
    inputs, outputs, places = ([q.name for q in kind] for kind in (dae.inputs, dae.outputs, dae.places))
    acting, output, forces, added = ca.SX(dae.u), ca.SX(dae.output), ca.SX(dae.w), list[ca.SX]()
    for (_, signal), a in zip(wanted, factors, strict=True):
        for of in signal.of:
            what, _, name = of.partition(":")
            to, names = {"input": (acting, inputs), "sensor": (output, outputs), "force": (forces, places)}[what]
            added.append(ca.SX.sym(f"changed_{len(added)}"))
            to[names.index(name)] += a * added[-1]
    old = ca.SX.sym("u_recorded", dae.u.shape[0])
    acting = ca.substitute(acting, dae.u, old)
    larger = extended(
        replace(dae, output=output),
        old=ca.vertcat(dae.u, dae.w),
        new=ca.vertcat(acting, forces),
        inputs=[(more, Quantity(name=f"changed {i}", unit="")) for i, more in enumerate(added)],
        parameters=[
            (a, ParameterInfo(name=f"a {i}", unit="1", value=0.0, minimum=-np.inf, maximum=np.inf, nominal=1.0))
            for i, a in enumerate(factors)
        ],
    )
    larger = replace(larger, u=ca.vertcat(old, *added))
    horizons = tuple(_with_signals(base, number, [s for _, s in wanted]) for number in range(len(t.horizons)))
    count = len(dae.parameters)
    parameters = np.concatenate([base.solution.parameters, np.zeros(len(wanted))])
    enlarged = Enlarged(base, larger, list(range(count, count + len(wanted))), horizons, parameters)
    columns = enlarged.columns(parameters)
    return [Look(candidate=c, shape=dict(s.start), columns=columns.taken([i])) for i, (c, s) in enumerate(wanted)]


def _with_signals(base: Linearised, number: int, signals: list[Signal]) -> Horizon:
    t = base.solution.transcription
    horizon, dae = t.horizons[number], t.dae
    inputs, outputs = [q.name for q in dae.inputs], [q.name for q in dae.outputs]
    modelled = base.solution.outputs(number)
    columns, seen = [], dict[str, Array]()
    for signal in signals:
        for of in signal.of:
            what, _, name = of.partition(":")
            if what == "input":
                values = horizon.inputs[:, inputs.index(name)]
                columns.append(signal.changed(horizon.changes, values) - values)
            elif what == "sensor":
                values = modelled[outputs.index(name)]
                change = signal.changed(horizon.time, values) - values
                columns.append(np.interp(horizon.changes, horizon.time, change))
            else:
                if signal.seen not in seen:
                    followed, times = followed_by(base.solution), np.clip(horizon.changes, horizon.time[0], horizon.time[-1])
                    found = along(dae, dae.variables[signal.seen], followed, number, times, base.solution.parameters)
                    seen[signal.seen] = found.ravel()
                columns.append(signal.changed(horizon.changes, seen[signal.seen]))
    return replace(horizon, inputs=np.column_stack([horizon.inputs, *columns]))
