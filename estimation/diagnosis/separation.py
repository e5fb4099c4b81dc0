"""What would tell two explanations apart: one more sensor, or more recordings of this kind.

Where a acts with strengths a*, and b is fitted in its place with trajectory, parameters and forces free, these nats stay that only a
explains (G of `score.py`):

    1/2 a*' (G_aa - G_ab G_bb^+ G_ba) a*

They grow in proportion to the length of recordings of one kind. A sensor that was not there, with derivatives C of its readings over their
noise, adds C'C to the Hessian in K: one factorisation tells the nats with it, whatever it would read. One that tells what an input does
shuts out that this input did something else: 1/2 a*' G_aa a* stay then.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from backsight.models.dae import Quantity
from backsight.ocp import ParameterPrior, Solution, transcribe
from backsight.ocp.readout import read

from .score import Columns, Linearised, Scores
from .screen import HOLD_AT_REST, Screened, inverse_root, seen

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

ENOUGH = 10.0  # nats from which two explanations are told apart beyond doubt
LONGER = 30.0  # times as long: nobody records more than that
MANY = 2  # sensors that are named
ROUGH = 0.01  # noise of a sensor of a unit that no output has, over the deviation of what it reads
GAINED = 2.0  # times the nats: a sensor that brings less is not what tells
NOTHING = "neither a sensor of one more state nor more of such recordings, but a machine that moves otherwise"


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """One that was not there: of what, its noise in that unit, and derivatives (n, unknowns) of its readings over it."""

    of: str
    noise: float
    unit: str
    rows: sp.csc_matrix

    @property
    def words(self) -> str:
        """A sensor of carriage.s with noise of 2e-06 m."""
        unit = f" {self.unit}" if self.unit not in ("", "1") else ""
        return f"a sensor of {self.of} with noise of {self.noise:.2g}{unit}"


def separating(base: Linearised, best: Screened, rivals: Sequence[Screened], states: Collection[str]) -> str:
    """What would tell an explanation from every one of its rivals, or that nothing of that kind would; "" where they are told as it is.

    states: of the model, for one may have a sensor of each.
    """
    if not rivals:
        return ""
    told = Told(base, best, rivals)
    now = min(told.nats)
    if now >= ENOUGH:
        return ""
    found = [(told.shut_out(name), f"a sensor of what {name} really does") for name in told.at("input")]
    for sensor in sensors(base.solution, states, told.at("sensor")):
        found.append((min(told.with_sensor(sensor)), sensor.words))
    good = sorted((f for f in found if f[0] >= max(ENOUGH, GAINED * now)), key=lambda f: -f[0])[:MANY]
    said = [f"{words} ({nats:.3g} nats)" for nats, words in good]
    if now * LONGER >= ENOUGH:
        said.append(f"{ENOUGH / now:.2g} times as much of such recordings")
    return " or ".join(said) or NOTHING


class Told:
    """An explanation beside its rivals. nats: that only it explains, beside each of them."""

    def __init__(self, base: Linearised, best: Screened, rivals: Sequence[Screened]) -> None:
        self._all, self._strengths = [best, *rivals], best.estimate
        at_rest = any(s.candidate.family in HOLD_AT_REST for s in self._all)
        joined = Columns.joined([s.look.columns for s in self._all])
        self._base, self._columns = seen(base, joined, at_rest)
        self._scores = self._base.scores(self._columns)
        self.nats = self._apart(self._scores)

    def at(self, kind: str) -> list[str]:
        """The inputs, or the sensors, that one of the explanations is about."""
        places = (s.candidate.place.partition(":") for s in self._all)
        return list(dict.fromkeys(name for what, _, name in places if what == kind))

    def with_sensor(self, sensor: Sensor) -> list[float]:
        """The nats with one more sensor."""
        return self._apart(self._base.with_rows(sensor.rows).scores(self._columns))

    def shut_out(self, name: str) -> float:
        """The least of the nats where it is known what an input does."""
        n, here = len(self._strengths), [s.candidate.place == f"input:{name}" for s in self._all]
        alone = 0.5 * float(self._strengths @ self._scores.G[:n, :n] @ self._strengths)
        return min(alone if one is not here[0] else nats for one, nats in zip(here[1:], self.nats, strict=True))

    def _apart(self, scores: Scores) -> list[float]:
        a, first, found = self._strengths, len(self._strengths), list[float]()
        own = slice(0, first)
        for s in self._all[1:]:
            at = slice(first, first + len(s.look.columns))
            first = at.stop
            common = a @ scores.G[own, at] @ inverse_root(scores.G[at, at], scores.plain[at])
            found.append(max(0.5 * float(a @ scores.G[own, own] @ a - common @ common), 0.0))
        return found


def sensors(solution: Solution, states: Collection[str], outputs: Collection[str] = ()) -> list[Sensor]:
    """Of these states, where no output reads them alone, and second ones of these outputs."""
    t = solution.transcription
    dae = t.dae
    motion, readings = ca.vertcat(dae.x, dae.dx, dae.z, dae.u), ca.vertsplit(dae.output)
    read_alone = {at[0] for y in readings if len(at := ca.jacobian_sparsity(y, motion).get_col()) == 1}
    noise = [float(np.nanmedian(np.concatenate([h.target_std[:, i] for h in t.horizons]))) for i in range(len(readings))]
    of_unit = {q.unit: n for q, n in reversed(list(zip(dae.outputs, noise, strict=True))) if np.isfinite(n) and n > 0}
    at_samples = [read(t, n, solution.solved.decisions, solution.parameters).x for n in range(len(t.horizons))]
    spread = np.std(np.hstack(at_samples), axis=1)
    wanted = list[tuple[Quantity, Any, float]]()
    for i, q in enumerate(dae.states):
        if q.name in states and i not in read_alone:
            wanted.append((q, dae.x[i], of_unit.get(q.unit, ROUGH * (float(spread[i]) or q.nominal))))
    again = {q.name: (replace(q, name=f"{q.name} again"), y, n) for q, y, n in zip(dae.outputs, readings, noise, strict=True)}
    wanted += [again[name] for name in outputs if name in again]
    if not wanted:
        return []
    C = _derivatives(solution, [q for q, _, _ in wanted], ca.vertcat(*(e for _, e, _ in wanted)))
    return [Sensor(of=q.name, noise=s, unit=q.unit, rows=sp.csc_matrix(C[k :: len(wanted)] / s)) for k, (q, _, s) in enumerate(wanted)]


def _derivatives(solution: Solution, quantities: Sequence[Quantity], expression: Any) -> sp.csc_matrix:
    """Of an expression of the model at the samples, in the unknowns; rows sample by sample."""
    t, count = solution.transcription, len(quantities)
    unread = [replace(h, target=np.zeros((len(h.time), count)), target_std=np.ones((len(h.time), count))) for h in t.horizons]
    nlp = transcribe(
        replace(t.dae, output=expression, outputs=tuple(quantities)),
        unread,
        free=t.nlp.free,
        prior=ParameterPrior(mean=np.zeros(len(t.nlp.free)), std=np.full(len(t.nlp.free), np.inf)),
        force_std={k: float(std) for k, std in zip(t.soft, t.force_std, strict=True)},
        method=t.method,
        degree=t.degree,
    ).nlp
    decisions = solution.solved.decisions
    values = nlp.about(replace(nlp.values(solution.parameters), unit=solution.values.unit), decisions)
    number = next(k for k, term in enumerate(nlp.terms) if term.name == "samples")
    return nlp.evaluated.jacobian([nlp.evaluated.linearised(number, values.scaled(decisions), values)])
