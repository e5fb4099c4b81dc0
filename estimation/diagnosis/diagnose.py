"""The search for what a model leaves out.

    smooth the base model -> score all candidates -> fit the best -> keep one that the evidence, its size and its numbers bear out -> again

and then the proof on what was held out. Everything is judged with trajectories, parameters and the weights that nobody gave chosen anew.
"""

from __future__ import annotations

import pickle
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import nan
from pathlib import Path

import numpy as np

from backsight.models import Model
from backsight.models.errors import InputError, SolveError

from ..problem import Problem
from ..recordings.split import with_held_out
from ..results import Smoothing
from ..smoothing.smoother import smooth
from ..workers import workers
from .candidates import Candidate
from .keep import Keep
from .library import library
from .mismatch import mismatches
from .proof import prove
from .refit import Fitted, begun, evidence, fitted, settled
from .regimes import Regime, regime
from .score import Linearised
from .screen import Screen, Screened, screen
from .shares import FLOOR, Sizes, limits
from .supermodel import looked_at
from .verdict import Class, Diagnosis, Explanation, Finding, Strength, Tried, Undetectable

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Progress = Callable[[str], None]

Judged = tuple[Candidate, Screened | None, Fitted]

SURE = 0.05  # chance of as much anywhere in the library if nothing is missing, at most
CLEAR = 6.0  # nats of evidence that an effect has to bring
RIVAL = 3.0  # nats within which two explanations cannot be told apart
FITTED, EACH, MOST = 4, 1, 6  # candidates that are fitted in a round: the best, of every other place, in all
WORTH, WORTH_ELSEWHERE = 0.5, 0.2  # of the best one's gain, at least
EFFECTS = 4
SPREAD = 0.3  # standard deviation of a strength over the largest one
NEAR = 0.5  # of the largest left-over share of forces: what is fitted without a score is so at places with that much
SAME = 0.99999  # correlation of two effects of which one fit stands for both
UNEXPLAINED = 0.5  # of the left-over variance: a repair that leaves more than this is none


def diagnose(
    problem: Problem,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    keep: Path | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Diagnosis:
    """Find what the model of a problem leaves out, name it, put it into the model, and prove the gain on what was held out.

    jobs: processes of this machine; scheduler: address of a Dask cluster instead. keep: a folder where finished fits stay, so that an
    interrupted diagnosis goes on. seed: goes into the results; nothing is drawn yet. Raises InputError where the problem cannot be smoothed
    at all, or its model is not made of components.
    """
    began, say = time.perf_counter(), progress or (lambda _: None)
    if not isinstance(problem.model, Model):
        raise InputError("diagnose: the model is a compiled Dae, which has no places to put components at; give the Model itself.")
    recordings, split = with_held_out(problem.recordings)
    posed = replace(problem, recordings=[r for r in recordings if r.role == "fit"])
    with workers(jobs, scheduler) as pool:
        kept = Keep(keep, posed)
        first = _smoothed(posed, kept, say)
        if not first.solver.converged:
            raise InputError(
                f"diagnose: the model as it is could not be smoothed ({first.solver.status.rstrip('.')}); give better guesses."
            )
        search = _Search(problem=posed, model=problem.model, result=first, say=say, pool=pool, kept=kept)
        search.run()
    verdict = search.verdict()
    notes = [split] if split else []
    held_out = None
    if search.findings and search.model is not problem.model:
        say("proof on what was held out")
        pair = (replace(posed, recordings=recordings), first), (replace(search.problem, recordings=recordings), search.result)
        try:
            held_out = prove(*pair, role="held_out" if split is None else "last third", progress=say)
        except (SolveError, InputError) as error:
            notes.append(f"What was held out could not be predicted: {error}")
    return Diagnosis(
        verdict=verdict,
        findings=tuple(search.findings),
        before=first,
        after=search.result,
        repaired=replace(search.problem, model=search.model, recordings=recordings),
        held_out=held_out,
        undetectable=tuple(search.undetectable),
        tried=tuple(search.tried),
        mismatch=(*mismatches(first), *(mismatches(search.result) if search.findings else ())),
        seconds=time.perf_counter() - began,
        seed=seed,
        notes=(*notes, *search.notes),
    )


def _smoothed(problem: Problem, kept: Keep, say: Progress) -> Smoothing:
    """The model as it is."""
    say("the model as it is")
    name = kept.name("the model as it is")
    part = kept.get(name)
    if part is None:
        result = smooth(problem, progress=say)
        part = result, result.solution
        kept.put(name, part)
    first: Smoothing = replace(part[0], solution=part[1])
    return first


@dataclass
class _Search:
    """What the search has found so far: the problem with it, its model and its smoothing."""

    problem: Problem
    model: Model
    result: Smoothing
    say: Progress
    pool: Executor
    kept: Keep
    findings: list[Finding] = field(default_factory=list)
    tried: list[Tried] = field(default_factory=list)
    undetectable: list[Undetectable] = field(default_factory=list)
    first_left: dict[str, float] = field(default_factory=dict)
    left: dict[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    named: list[set[str]] = field(default_factory=list)

    def run(self) -> None:
        """Rounds, until nothing more is found."""
        for number in range(EFFECTS + 1):
            self.say(f"round {number + 1}: scores")
            if self.result.solution is None:
                raise ValueError("a smoothed model has its solution")
            base = Linearised(self.result.solution)
            candidates = library(self.problem, self.model, base.solution)
            looks = looked_at(self.problem, self.model, base, candidates)
            found = screen(base, looks)
            sizes = Sizes(self.problem, self.result, base)
            self.left = sizes.left
            if not number:
                self.first_left = sizes.left
            if number == EFFECTS or not self._round(base, found, sizes, candidates):
                self._limits(found, sizes)
                return

    def _round(self, base: Linearised, found: Screen, sizes: Sizes, candidates: Sequence[Candidate]) -> bool:
        """Fits the best candidates and keeps one; whether there was one."""
        now = evidence(self.problem, self.result)
        fits = self._fits([(s.candidate, s) for s in _chosen(found, sizes)])
        if not self._explains(fits, now) and max(sizes.left.values(), default=0.0) > FLOOR:
            most = max(sizes.left.values())
            fits += self._fits([(c, None) for c in candidates if c.dear and sizes.left.get(c.place, most) >= NEAR * most])
        fits.sort(key=lambda f: (-f[2].evidence, f[0].rank))
        self._remember(fits, now)
        good = [(c, s, f) for c, s, f in fits if f.evidence - now > CLEAR and _sound(c, f)]
        if not good:
            return False
        best = min((f for f in good if good[0][2].evidence - f[2].evidence < RIVAL), key=lambda f: (f[0].rank, f[0].size, -f[2].evidence))
        self._keep(base, best, fits, found, sizes, now)
        return True

    def _fits(self, wanted: list[tuple[Candidate, Screened | None]]) -> list[Judged]:
        """The candidates fitted, side by side."""
        if not wanted:
            return []
        values = {p.name: p.value for p in self.result.parameters.values()}
        blob = pickle.dumps((settled(self.problem, self.result), self.model, self.result.solution))
        starts = [begun(c, s, values) for c, s in wanted]
        before = repr((sorted(values.items()), [f.change for f in self.findings]))
        names = [self.kept.name(before, c, start) for (c, _), start in zip(wanted, starts, strict=True)]
        found = {name: part for name in names if (part := self.kept.get(name)) is not None}
        futures = {
            name: self.pool.submit(fit, blob, c.sent, start)
            for name, (c, _), start in zip(names, wanted, starts, strict=True)
            if name not in found
        }
        fits = list[Judged]()
        for (c, s), name in zip(wanted, names, strict=True):
            self.say(f"fit {len(fits) + 1} of {len(wanted)}: {c.title}")
            if name not in found:
                found[name] = futures[name].result()
                self.kept.put(name, found[name])
            fits.append((c, s, found[name]))
        return fits

    def _explains(self, fits: list[Judged], now: float) -> bool:
        """Whether one of the fits leaves less than half of the left-over variance at the worst place."""
        worst = max(self.left, key=lambda p: self.left[p], default="")
        for c, _, f in fits:
            if f.evidence - now > CLEAR and _sound(c, f) and f.result is not None and worst in f.result.residual_places:
                before = self.result.residual_places[worst].rms
                if f.result.residual_places[worst].rms ** 2 < (1.0 - UNEXPLAINED) * before**2:
                    return True
        return False

    def _remember(self, fits: list[Judged], now: float) -> None:
        for c, s, f in fits:
            explanation = Explanation(place=c.place, family=c.family, physics=c.physics, parameters=_strengths(c, f))
            gained = f.evidence - now if np.isfinite(f.evidence) else None
            self.tried.append(Tried(explanation=explanation, predicted=s.gain if s else 0.0, fitted=gained, refused=f.failed))

    def _keep(
        self,
        base: Linearised,
        best: Judged,
        fits: list[Judged],
        found: Screen,
        sizes: Sizes,
        now: float,
    ) -> None:
        c, s, f = best
        if f.problem is None or f.model is None or f.whole is None:
            raise ValueError(f"{c.title} has no fit")
        rivals, others = list[Explanation](), list[Explanation]()
        for d, _, g in fits:
            if d.key == c.key:
                continue
            gap = f.evidence - g.evidence
            e = Explanation(place=d.place, family=d.family, physics=d.physics, gap=float(gap), parameters=_strengths(d, g))
            if gap < RIVAL and _sound(d, g) and (d.size <= c.size or gap < 0):
                rivals.append(e)
            elif np.isfinite(gap):
                others.append(e)
        if s is not None:
            rivals += [
                Explanation(place=o.candidate.place, family=o.candidate.family, physics=o.candidate.physics)
                for o in found.found
                if o.candidate.key != c.key
                and o.candidate.key not in {(r.place, r.physics) for r in rivals + others}
                and found.alike(s, o) > SAME
            ]
        acts = regime(base, s.look) if s is not None else Regime(words="whole record", onset=None)
        share = max(sizes.shares(s.look, s.estimate).values(), default=0.0) if s is not None else None
        gone = {name.partition(".")[0] for name in c.absorbs}
        self.findings = [old for old, names in zip(self.findings, self.named, strict=True) if not names & gone]
        self.named = [names for names in self.named if not names & gone]
        self.named.append({path.partition(".")[0] for path in c.named.values()})
        self.findings.append(
            Finding(
                explanation=Explanation(place=c.place, family=c.family, physics=c.physics, parameters=_strengths(c, f)),
                p_value=found.chance(s.gain) if s is not None else nan,
                gain=float(f.evidence - now),
                change="; ".join(_change(c, f)),
                share=share,
                regime=acts.words,
                onset=acts.onset,
                alternatives=tuple(others),
                rivals=tuple(rivals),
            )
        )
        self.problem, self.model, self.result = f.problem, f.model, f.whole

    def _limits(self, found: Screen, sizes: Sizes) -> None:
        units = {p.name: p.unit for s in found.found for p in _declared(s.candidate)}
        skipped = {(f.explanation.place, f.explanation.physics) for f in self.findings}
        self.undetectable = limits(found, sizes, units, skipped)
        self._unexplained(sizes)

    def _unexplained(self, sizes: Sizes) -> None:
        """What is left over and matters: a finding without a name, or a note beside those that have one."""
        worst, share = max(sizes.left.items(), key=lambda item: item[1], default=("", 0.0))
        if share <= FLOOR:
            return
        summary = self.result.residual_places[worst]
        if self._explained() >= UNEXPLAINED:
            force = f"{summary.rms:.3g} {summary.unit} rms, {100 * share:.2g} % of the forces there"
            self.notes.append(f"Unexplained at {worst}: a force of {force}.")
            return
        rms = Strength(value=summary.rms, std=None, unit=summary.unit)
        self.findings.insert(
            0,
            Finding(
                explanation=Explanation(place=worst, family="unknown", physics="unknown_physics", parameters={"rms": rms}),
                p_value=nan,
                gain=0.0,
                change="",
                share=share,
                alternatives=tuple(t.explanation for t in self.tried[:3]),
            ),
        )

    def _explained(self) -> float:
        """Share of the variance of the left-over forces that mattered at first and is explained now, of the place where that is most."""
        parts = [1.0 - (self.left.get(p, 0.0) / was) ** 2 for p, was in self.first_left.items() if was > FLOOR]
        return max(parts, default=1.0 if self.findings else 0.0)

    def verdict(self) -> Class:
        """One word for what was found."""
        if not self.findings:
            return "none"
        first = self.findings[0]
        if first.explanation.physics == "unknown_physics":
            return "unknown_physics"
        if first.explanation.family == "parameter":
            return "parameter"  # what explains as much by more is no reason to doubt a number that was given
        kinds = {_class(first.explanation.family)} | {_class(r.family) for r in first.rivals}
        return kinds.pop() if len(kinds) == 1 else "undecided"


def _class(family: str) -> Class:
    classes: dict[str, Class] = {"parameter": "parameter", "sensor": "sensor", "actuator": "input"}
    return classes.get(family, "missing_physics")


def _chosen(found: Screen, sizes: Sizes) -> list[Screened]:
    """The candidates worth a fit: unlikely by chance, large enough to matter, and not one that a better one stands for.

    The best of all, and the best of every place: what no output shows at once is scored less well than it fits.
    """
    worth = list[Screened]()
    for s in found.found:
        if found.chance(s.gain) > SURE or (s.candidate.family != "sensor" and not _matters(s, sizes)):
            continue
        same = next((k for k, o in enumerate(worth) if found.alike(o, s) > SAME), None)
        if same is not None:
            if (s.candidate.rank, s.candidate.size) < (worth[same].candidate.rank, worth[same].candidate.size):
                worth[same] = s
        elif not _simpler(s, found.found):
            worth.append(s)
    most = max((s.gain for s in worth), default=0.0)
    chosen = [s for s in worth if s.gain >= WORTH * most][:FITTED]
    places = Counter(s.candidate.place for s in chosen)
    for s in worth:
        if s not in chosen and s.gain >= WORTH_ELSEWHERE * most and places[s.candidate.place] < EACH and len(chosen) < MOST:
            chosen.append(s)
            places[s.candidate.place] += 1
    return chosen


def _simpler(s: Screened, others: Sequence[Screened]) -> bool:
    """Whether a candidate at the same place gains as much with fewer parameters. What is beyond it, a later round will tell."""
    c = s.candidate
    return any(
        o.candidate.place == c.place and o.candidate.size < c.size and s.gain - o.gain < RIVAL * (c.size - o.candidate.size) for o in others
    )


def _matters(s: Screened, sizes: Sizes) -> bool:
    return max(sizes.shares(s.look, s.estimate).values(), default=0.0) > FLOOR / 2


def _sound(c: Candidate, f: Fitted) -> bool:
    """Whether its strengths are told, to less than SPREAD of the largest."""
    if f.result is None:
        return False
    found = [f.result.parameters[n] for n in (c.strengths or tuple(c.start)) if n in f.result.parameters]
    told = [p for p in found if p.std is not None]
    if not told:
        return False
    largest = max(abs(p.value - c.neutral(p.name)) for p in told)
    return max(p.std or 0.0 for p in told) < SPREAD * largest


def _strengths(c: Candidate, f: Fitted) -> dict[str, Strength]:
    if f.result is None:
        return {}
    return {
        word: Strength(value=p.value, std=p.std, unit=p.unit)
        for word, path in c.named.items()
        if (p := f.result.parameters.get(path)) is not None
    }


def _change(c: Candidate, f: Fitted) -> list[str]:
    said = [edit.words for edit in c.edits]
    values = {} if f.result is None else {p: f.result.parameters[p].value for p in c.named.values() if p in f.result.parameters}
    said += [f"{name} = {value:.6g}" for name, value in values.items()]
    return said + [f"{name} = 0" for name in c.absorbs]


def _declared(c: Candidate) -> list[_Unit]:
    found = []
    for edit in c.edits:
        component = getattr(edit, "component", None)
        if component is not None:
            name = getattr(edit, "name", "")
            found += [_Unit(name=f"{name}.{w}", unit=p.unit) for w, p in component.declared_parameters.items()]
    return found


@dataclass(frozen=True, kw_only=True)
class _Unit:
    name: str
    unit: str


def fit(blob: bytes, candidate: Candidate, start: dict[str, float]) -> Fitted:
    """A candidate's fit, in a worker."""
    problem, model, solution = _shared(blob)
    return fitted(problem, model, solution, candidate, start)


@lru_cache(maxsize=1)
def _shared(blob: bytes) -> tuple:  # type: ignore[type-arg]
    found: tuple = pickle.loads(blob)  # type: ignore[type-arg]
    return found
