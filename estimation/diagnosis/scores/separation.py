"""What would tell two explanations apart: one more sensor, or more recordings of this kind.

Where a acts with strengths a*, and b is fitted in its place with trajectory, parameters and forces free, these nats stay that only a
explains (G of `score.py`):

    1/2 a*' (G_aa - G_ab G_bb^+ G_ba) a*

over the inflation of a's score (`screen.py`). They grow in proportion to the length of recordings of one kind. A sensor that was not
there, in whose readings no strength stands, with derivatives C over its noise, adds C'C to the Hessian in K: one factorisation tells the
nats with it, whatever it would read. One of an input as it acts shuts out that this input did something else, and 1/2 a*' G_aa a* stay;
where a is a fault of that input it reads this, and how well hangs on the sensor.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from backsight.models import Dae
from backsight.models.dae import Quantity
from backsight.ocp import Solution
from backsight.ocp.readout import read

from .enlarged import transcribed_as
from .score import Columns, Linearised, Scores
from .screen import HOLD_AT_REST, Screened, inverse_root, seen

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

ENOUGH = 10.0  # nats from which two explanations are told apart beyond doubt
LONGER = 30.0  # times as long: nobody records more than that
MANY = 2  # sensors that are named
ROUGH = 0.01  # noise of a sensor of a unit that no output has, over the deviation of what it reads
GAINED = 2.0  # times the nats: a sensor that brings less is not what tells
READ = ("m/s", "rad/s", "A", "V")  # units of states of which there are sensors, beside the positions of bodies
NOTHING = f"neither a sensor of one more state nor {LONGER:g} times as much of such recordings"


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


def separating(
    base: Linearised, best: Screened, rivals: Sequence[Screened], states: Collection[str], strengths: Array | None = None
) -> str:
    """What would tell an explanation from every one of its rivals, or that nothing of that kind would.

    "" where there is nothing to tell: by these scores they are told as it is, or an effect so small is not seen at all. states: of which
    there may be sensors. strengths: of the best, as fitted; by default those of its score.
    """
    if not rivals:
        return ""
    told = Told(base, best, rivals, strengths)
    now = min(told.nats)
    if now >= ENOUGH or told.alone < ENOUGH:
        return ""
    said = [words for name in told.at("input") if (words := told.of_input(name))]
    found = [(min(told.with_sensor(sensor)), sensor.words) for sensor in sensors(base.solution, states, told.at("sensor"))]
    good = sorted((f for f in found if f[0] >= max(ENOUGH, GAINED * now)), key=lambda f: -f[0])[:MANY]
    said += [f"{words} ({nats:.3g} nats)" for nats, words in good]
    if now * LONGER >= ENOUGH and best.candidate.onset is None:
        said.append(f"recordings {_rounded_up(ENOUGH / now)} times as long in all")
    return " or ".join(said) or NOTHING


def measurable(dae: Dae) -> list[str]:
    """The states of which there may be sensors: positions of bodies, velocities, currents and voltages."""
    positions = {i for i, _, _ in dae.kinematics}
    return [q.name for i, q in enumerate(dae.states) if i in positions or q.unit in READ]


def _rounded_up(factor: float) -> str:
    """Two digits, no less."""
    digit = 10.0 ** (np.floor(np.log10(factor)) - 1)
    return f"{np.ceil(factor / digit * (1 - 1e-9)) * digit:.2g}"


class Told:
    """An explanation beside its rivals. nats: that only it explains, beside each of them; alone: beside none."""

    def __init__(self, base: Linearised, best: Screened, rivals: Sequence[Screened], strengths: Array | None = None) -> None:
        self._all, self._strengths = [best, *rivals], best.estimate if strengths is None else strengths
        at_rest = any(s.candidate.family in HOLD_AT_REST for s in self._all)
        self._base, self._columns = seen(base, Columns.joined([s.look.columns for s in self._all]), at_rest)
        scores, n = self._base.scores(self._columns), len(self._strengths)
        self.nats = self._apart(scores)
        self.alone = 0.5 * float(self._strengths @ scores.G[:n, :n] @ self._strengths) / best.inflation

    def at(self, kind: str) -> list[str]:
        """The inputs, or the sensors, that one of the explanations is about."""
        places = (s.candidate.place.partition(":") for s in self._all)
        return list(dict.fromkeys(name for what, _, name in places if what == kind))

    def with_sensor(self, sensor: Sensor) -> list[float]:
        """The nats with one more sensor."""
        return self._apart(self._base.scores(self._columns, sensor.rows))

    def of_input(self, name: str) -> str:
        """A sensor of an input as it acts, if that would tell; with the nats, where they do not hang on the sensor."""
        best, *rivals = (s.candidate.place == f"input:{name}" for s in self._all)
        if not (best or all(rivals)):
            return ""
        return f"a sensor of {name} as it acts" + ("" if best else f" ({self.alone:.3g} nats)")

    def _apart(self, scores: Scores) -> list[float]:
        a, first, found = self._strengths, len(self._strengths), list[float]()
        own = slice(0, first)
        for s in self._all[1:]:
            at = slice(first, first + len(s.look.columns))
            first = at.stop
            common = a @ scores.G[own, at] @ inverse_root(scores.G[at, at], scores.plain[at])
            whole = 0.5 * float(a @ scores.G[own, own] @ a - common @ common)
            found.append(max(whole, 0.0) / self._all[0].inflation)
        return found


def sensors(solution: Solution, states: Collection[str], outputs: Collection[str] = ()) -> list[Sensor]:
    """Of these states, where no recorded output reads them alone, and second ones of these outputs; at the rows that have samples."""
    t = solution.transcription
    dae = t.dae
    sampled = np.concatenate([np.isfinite(h.target) for h in t.horizons])
    given = np.concatenate([np.broadcast_to(h.target_std, h.target.shape) for h in t.horizons])
    motion, readings = ca.vertcat(dae.x, dae.dx, dae.z, dae.u), ca.vertsplit(dae.output)
    noise = [float(np.median(std[there])) if there.any() else np.nan for std, there in zip(given.T, sampled.T, strict=True)]
    recorded = [(y, q, s, there) for y, q, s, there in zip(readings, dae.outputs, noise, sampled.T, strict=True) if there.any()]
    read_alone = {at[0] for y, *_ in recorded if len(at := ca.jacobian_sparsity(y, motion).get_col()) == 1}
    of_unit = {q.unit: s for _, q, s, _ in reversed(recorded)}
    spread = np.std(np.hstack([read(t, n, solution.solved.decisions, solution.parameters).x for n in range(len(t.horizons))]), axis=1)
    wanted = list[tuple[Quantity, Any, float, Any]]()
    for i, q in enumerate(dae.states):
        if q.name in states and i not in read_alone:
            wanted.append((q, dae.x[i], of_unit.get(q.unit, ROUGH * (float(spread[i]) or q.nominal)), sampled.any(axis=1)))
    wanted += [(replace(q, name=f"{q.name} again"), y, s, there) for y, q, s, there in recorded if q.name in outputs]
    if not wanted:
        return []
    C = _derivatives(solution, [q for q, *_ in wanted], ca.vertcat(*(e for _, e, *_ in wanted)))
    return [
        Sensor(of=q.name, noise=s, unit=q.unit, rows=sp.csc_matrix(C[k :: len(wanted)][there] / s))
        for k, (q, _, s, there) in enumerate(wanted)
    ]


def _derivatives(solution: Solution, quantities: Sequence[Quantity], expression: Any) -> sp.csc_matrix:
    """Of an expression of the model at the samples, in the unknowns; rows sample by sample."""
    t, count = solution.transcription, len(quantities)
    unread = [replace(h, target=np.zeros((len(h.time), count)), target_std=np.ones((len(h.time), count))) for h in t.horizons]
    nlp = transcribed_as(t, replace(t.dae, output=expression, outputs=tuple(quantities)), unread).nlp
    decisions = solution.solved.decisions
    values = nlp.about(replace(nlp.values(solution.parameters), unit=solution.values.unit), decisions)
    number = next(k for k, term in enumerate(nlp.terms) if term.name == "samples")
    return nlp.evaluated.jacobian([nlp.evaluated.linearised(number, values.scaled(decisions), values)])
