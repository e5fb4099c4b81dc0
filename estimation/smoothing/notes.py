"""What a smoothing run has to say beside its numbers: how every weight came about, what is open, where the numerics end."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from backsight.models import ModelError, SolveError
from backsight.models.analysis.identifiability import identifiability
from backsight.models.errors import InputError
from backsight.ocp import Solution

from ..problem import Free, Problem
from ..recordings.gaps import gap_note, lost_note, rates_note, seconds_note
from ..results import DOUBT, TELLING, OutputFit, ResidualSummary, doubted
from ..supposed import INPUT, left_out
from ..wording import listed, per_root_bandwidth, probability
from .agreement import MISLEAD, contradictions, far_below, loose_weights, nothing_there, too_sharp
from .beforehand import contradicted
from .clock import clock_notes
from .dead import on_dead_inputs, on_dead_outputs
from .explaining import on_explaining, weighed_places
from .horizons import shown_noise
from .marginal import UNMOVED
from .mesh_error import allowed
from .on_bounds import OnBounds
from .outliers import outlier_notes
from .rest import near_rest
from .suppositions import colour, noise_notes, pulled_notes, supposed_notes, unpulled_notes
from .undetermined import REMEDY, hardly_told, open_combinations, open_where_it_stopped
from .unseen import unseen_states

if TYPE_CHECKING:
    from .outcome import Run

Errors = Mapping[str, Mapping[str, np.ndarray[tuple[int, ...], np.dtype[np.float64]]]]

OFF = 1.25  # factor between prediction errors and what the weights promise
STRANGE, SURE = 30.0, 3.0  # times a guess, and deviations of it from zero, from which on a unit may be wrong
FEW = 3.0  # numbers for every unknown that an estimate needs at least
FAR = 3.0  # times an output's noise in the model, or a third of it, is worth a word
SILENT = "no force can be told from none there; the data would take less than std {}, the least tried: deviations may be too large."


def notes(
    problem: Problem,
    run: Run,
    bounds: OnBounds | None,
    fit: Mapping[str, Mapping[str, OutputFit]],
    residuals: Mapping[str, ResidualSummary],
    estimates: Mapping[str, pd.DataFrame],
    errors: Errors,
) -> tuple[str, ...]:
    """Notes on a run, a sentence or two each, first those beside which the others mean little.

    errors: recording -> output -> standardised prediction errors (n,).
    """
    if not run.choice.solution.solved.status.converged:
        return _without_an_answer(problem, run, bounds, fit, residuals)
    (shown, white), silent = shown_noise(problem), nothing_there(problem, run)
    misled, low = (
        {which: note for which, note in said.items() if not _borne_out(fit.get(which[0], {}).get(which[1]))}
        for said in (too_sharp(problem, run, shown), far_below(problem, run, shown))
    )
    doubts, loose, level = contradictions(problem, run, white), loose_weights(problem, run), doubted(fit, residuals)
    return (
        *misled.values(),
        *on_explaining(problem.posed, run.choice.solution, residuals),
        *_on_nothing_settled(run),
        *pulled_notes(problem.posed, run.choice.solution, bounds),
        *doubts,
        *low.values(),
        *contradicted(problem, run.choice.solution),
        *clock_notes(problem, estimates),
        *noise_notes(problem, estimates),
        *_on_far_ones(problem.posed, run.choice.solution),
        *_on_few(problem),
        *_on_rates(problem),
        *(note for r in problem.recordings for said in (gap_note, lost_note) if (note := said(r))),
        *on_dead_inputs(problem),
        *on_dead_outputs(problem),
        *_on_ranges(problem),
        *_on_the_start(problem.plain, run),
        *_on_forces(problem, run, silent),
        *supposed_notes(problem),
        *_on_the_answer(problem.posed, run, bounds),
        *run.said,
        *_on_what_is_left_out(problem),
        *_on_outputs(problem, run),
        *outlier_notes(problem, run.choice.solution, errors),
        *loose,
        *on_errors(fit, misled, level),
        *on_residuals(residuals, set(residuals) if misled or doubts or loose else silent, level),
    )


def _without_an_answer(
    problem: Problem,
    run: Run,
    bounds: OnBounds | None,
    fit: Mapping[str, Mapping[str, OutputFit]],
    residuals: Mapping[str, ResidualSummary],
) -> tuple[str, ...]:
    """Where a solve stopped its numbers say little: what may have kept it from arriving, the most telling first."""
    solution = run.choice.solution
    t = solution.transcription
    held = [t.dae.parameters[t.nlp.free[k]].name for k in solution.parameters_on_bounds]
    where = f" Where it stopped, {listed(held)} lay on {'a bound' if len(held) == 1 else 'bounds'}." if held else ""
    weights = f", leave out W of {listed(weighed)}, so that the data choose it" if (weighed := weighed_places(problem)) else ""
    return (
        *too_sharp(problem, run, shown_noise(problem)[0]).values(),
        *_on_rates(problem),
        *(note for r in problem.recordings for said in (gap_note, lost_note) if (note := said(r))),
        *on_dead_inputs(problem),
        *on_dead_outputs(problem),
        *_on_ranges(problem),
        *outlier_notes(problem, solution, {}),
        *(_on_structure(problem) or open_where_it_stopped(problem.posed, solution, bounds, fit)),
        *on_explaining(problem.posed, solution, residuals),
        *_on_the_start(problem.plain, run),
        f"No estimate: what is written is where the solver stopped.{where} Look at the plots of what was measured and modelled; check "
        f"units and signs, give guesses within a factor of three, fix what is known, and V where a sensor's noise is known{weights}.",
    )


def _on_structure(problem: Problem) -> list[str]:
    """What no recording of these outputs can tell: a solve that goes astray along it does not arrive."""
    names = [problem.dae.parameters[i].name for i in problem.free]
    guesses = dict(zip((p.name for p in problem.dae.parameters), problem.values.tolist(), strict=True))
    try:
        found = identifiability(problem.dae, parameters=names, values=guesses) if names else None
    except (InputError, ModelError, SolveError):
        return []
    if found is None or not found.unidentifiable:
        return []
    return [f"No recording of {listed(found.outputs)} can tell all that is free: {'; '.join(found.sentences())}. {REMEDY}."]


def _on_nothing_settled(run: Run) -> list[str]:
    """Neither weights nor parameters came to where the data want them: both are where the way ended."""
    if run.choice.settled or UNMOVED not in run.said:
        return []
    what = "Weights from the data had not settled, and no steps led from them to the most likely parameters."
    return [f"{what} {MISLEAD} Give W or V of what is known."]


def _on_few(problem: Problem) -> list[str]:
    """Fewer numbers than deviations mean anything for."""
    posed = problem.posed
    count = sum(int(np.isfinite(y).sum()) for piece in posed.fitted for y in piece.outputs.values())
    starts = sum(len(posed.dae.states) - sum(known.std == 0 for known in posed.known_at(piece).values()) for piece in posed.fitted)
    unknown = len(posed.free) + starts
    if count >= FEW * unknown:
        return []
    what = f"{len(posed.free)} parameters and {starts} first values of states"
    return [f"Only {count} numbers were measured for {unknown} unknowns, {what}: estimates and deviations mean little."]


def _on_rates(problem: Problem) -> list[str]:
    fitted = [r for r in problem.recordings if r.role == "fit"]
    note = rates_note(fitted) or seconds_note(fitted)
    return [] if note is None else [note]


def _on_ranges(problem: Problem) -> list[str]:
    """Bounds that a user gave beyond those that a parameter has by its nature, and so do not hold."""
    found = []
    for info in problem.dae.parameters:
        given = problem.parameters.get(info.name)
        if not isinstance(given, Free):
            continue
        for word, asked, own in (("min", given.min, info.minimum), ("max", given.max, info.maximum)):
            if np.isfinite(asked) and (asked < own if word == "min" else asked > own):
                found.append(f"{info.name}: {word} = {asked:g} is beyond its physical {own:g} {info.unit}, which holds.")
    return found


def on_errors(fit: Mapping[str, Mapping[str, OutputFit]], misled: Collection[tuple[str, str]] = (), level: float = DOUBT) -> list[str]:
    """What the prediction errors of every output say of the stated deviations; not of those `misled`, whose V is wrong.

    level: up to which p they are doubted.
    """
    found, crooked = list[str](), dict[str, float]()
    for recording, outputs in fit.items():
        for name, f in outputs.items():
            if (recording, name) in misled:
                continue
            which = f"{name} of {recording}" if len(fit) > 1 else name
            if f.whiteness_p is not None and f.effective_samples is not None and f.whiteness_p <= level:
                worth = f"{f.effective_samples:.0f} effective of {f.samples} samples"
                size = f.overstated
                said = "may be too large" if size < 1.0 / TELLING else "are too small" if size > TELLING else "hardly suffer, values may"
                times = f", for what is slow about {size:.2g} times, or more" if size > TELLING else ""
                found.append(
                    f"{which}: its prediction errors are not white ({probability(f.whiteness_p)}, {worth}): something is left out or "
                    f"weighed wrongly; stated deviations {said}{times}."
                )
            if f.prediction_rms is not None and not 1.0 / OFF < f.prediction_rms < OFF:
                found.append(
                    f"{which}: its prediction errors are {f.prediction_rms:.2g} times what V and W promise: "
                    f"{'too much' if f.prediction_rms < 1 else 'too little'} noise is supposed."
                )
            if f.normality_p is not None and f.normality_p <= level:
                crooked[which] = f.normality_p
    if crooked:
        whose, p = "its" if len(crooked) == 1 else "their", probability(max(crooked.values()))
        why = "outliers, coarse steps of the sensor, or friction that sticks"
        found.append(f"{listed([*crooked])}: {whose} prediction errors are not normal ({p}): {why}.")
    return found


def _borne_out(fit: OutputFit | None) -> bool:
    """Whether samples are predicted as well as V and W promise: what alternates in them then is the answer to an input that does."""
    if fit is None or fit.whiteness_p is None or fit.prediction_rms is None:
        return False
    return fit.whiteness_p >= DOUBT and fit.prediction_rms < OFF


def on_residuals(residuals: Mapping[str, ResidualSummary], silent: Collection[str] = (), level: float = DOUBT) -> list[str]:
    """What every residual force looks like, but at the places `silent`, where it is none, noise of a sensor, or weighed wrongly."""
    found = []
    for place, r in residuals.items():
        if place in silent:
            continue
        if r.follows is not None:
            f = r.follows
            found.append(
                f"residual.{place} follows {f.what} (r = {f.correlation:.2f} ± {f.std:.2g}), as {f.law} would make it: "
                "parameters may be off by more than their deviations."
            )
        elif r.whiteness_p is not None and r.whiteness_p <= level:
            m, p = r.memory, probability(r.whiteness_p)
            W = "a W with a tau" if m is None else f'W = {{ "{place}" = {{ std = {m.rms:.2g}, tau = {m.tau:.2g} }} }}'
            found.append(
                f"residual.{place} is not white ({p}): a force with a memory{f' of about {m.tau:.2g} s' if m else ''} "
                f"acts there. Stated deviations take it for white and may be too small; with {W} they do not."
            )
    return found


def _on_the_start(problem: Problem, run: Run) -> list[str]:
    dae, found = problem.dae, []
    parameters = run.choice.solution.parameters
    widths = {
        info.name: f"{parameters[i]:.3g} {info.unit}"
        for i, info in enumerate(dae.parameters)
        if info.smoothing and info.name not in problem.parameters and parameters[i] != info.value
    }
    if widths:
        were = "was" if len(widths) == 1 else "were"
        found.append(
            f"{listed([*widths])} {were} chosen: {listed([*widths.values()])}, one percent of the rms velocity there, or less where it "
            "rests."
        )
    unseen = unseen_states(problem)
    if unseen and problem.free:
        found.append(f"No output shows {', '.join(unseen)}: it started from the model at the guesses, on which the answer may depend.")
    return found


def _on_forces(problem: Problem, run: Run, silent: Collection[str]) -> list[str]:
    dae, choice, found = problem.posed.dae, run.choice, []
    t = choice.solution.transcription
    if not t.soft and dae.places:
        found.append("W leaves the residual forces no room: every balance was made to hold exactly.")
    alike = dict[str, list[tuple[str, str]]]()
    for k, s in zip(t.soft, choice.force_std, strict=True):
        place = dae.places[k]
        std = f"{s:.3g} {place.unit if place.name in problem.weights.tau else per_root_bandwidth(place.unit)}"
        if place.name in problem.weights.W:
            alike.setdefault(f"std {{}} as given{colour(problem, place.name)}.", []).append((place.name, std))
        elif place in problem.dae.places:
            end = "" if choice.settled else "; it had not settled"
            shown = f"std {{}} from what the fit leaves over, iterated {choice.rounds} times{end}."
            alike.setdefault(SILENT if place.name in silent else shown, []).append((place.name, std))
    found += _of_several("W", alike)
    if run.remeshed:
        found.append(
            "The weights from the data moved far from the first ones: the mesh was chosen anew for them, and they once more on it."
        )
    return found


def _on_what_is_left_out(problem: Problem) -> list[str]:
    found, names = list[str](), [problem.dae.states[g.state].name for g in left_out(problem)]
    if names:
        found.append(f"No equation and no output depends on {listed(names)}: they are told from an arbitrary start.")
    units = {q.name: q.unit for q in problem.dae.states}
    if stands := sorted({f"{name} = {at.value:g} {units[name]}" for of in problem.split.stands.values() for name, at in of.items()}):
        found.append(f"No equation and no output tells where the machine stands as a whole: it starts at {listed(stands)}.")
    return found


def _on_the_answer(problem: Problem, run: Run, bounds: OnBounds | None) -> list[str]:
    dae, found, solution = problem.dae, [], run.choice.solution
    if solution.curvature is None:
        found.append("The solver ended on no minimum: no deviations are given.")
    found += open_combinations(problem, solution, bounds) + hardly_told(problem, solution, bounds)
    found += unpulled_notes(problem, solution, bounds)
    share = _share_with_room(solution)
    if share > 0:
        found.append(
            f"Near rest, in {100 * share:.1f} % of the mesh, a friction law is least certain: the residual force has as much room "
            "more there as the law is strong, and these stretches say hardly anything about the parameters."
        )
    if run.checked.unchecked:
        found.append(
            f"By how much smaller time steps would move the answer was not measured ({run.checked.unchecked}), though the forces vary from "
            "step to step by enough to ask. For a shorter range of the recording it can be."
        )
    for name, error in run.checked.error.items():
        if error > allowed(solution, name):
            unit = "noise" if name in {q.name for q in dae.outputs} else "deviation"
            found.append(
                f"The mesh itself moves {name} by about {error:.2g} of its {unit}, and no deviation includes that: give W more room, or a "
                "smaller step."
            )
    return found


def _on_far_ones(problem: Problem, solution: Solution) -> list[str]:
    """Parameters that cannot be negative and are plainly another size than their guess: a unit that is wrong makes a good fit too."""
    found, t = [], solution.transcription
    if solution.curvature is None:
        return []
    for k, i in enumerate(t.nlp.free):
        info, value, variance = t.dae.parameters[i], float(solution.parameters[i]), float(solution.curvature.parameter_variance[k])
        given = problem.parameters.get(info.name)
        if not isinstance(given, Free) or given.guess <= 0 or info.minimum < 0 or not 0 < SURE * np.sqrt(variance) < value:
            continue
        times = value / given.guess
        if max(times, 1 / times) > STRANGE:
            more = f"{times:.2g} times above" if times > 1 else f"{1 / times:.2g} times below"
            found.append(f"{info.name} {more} its guess, {given.guess:g} {info.unit}")
    return [f"{listed(found)}: are time, inputs, outputs and guesses in the units that they are said to have?"] if found else []


def _on_outputs(problem: Problem, run: Run) -> list[str]:
    found, alike = list[str](), dict[str, list[tuple[str, str]]]()
    for i, q in enumerate(problem.dae.outputs):
        recordings = [k for k, table in enumerate(run.stds) if q.name in table]
        if not recordings:
            continue
        said: dict[tuple[str, str], list[str]] = {}
        given = [k for k in recordings if _noise_is_given(problem, k, q.name)]
        told = [*given, *(k for k in recordings if q.name in run.open_outputs[k])]
        for k in recordings:
            rule = "as given" if k in given else f"as {'elsewhere' if told else 'the model supposes'}, for it is constant here"
            if q.name in run.open_outputs[k]:
                end = "" if run.choice.settled else "; it had not settled"
                rule = f"from the samples' differences, then from what the fit leaves over{end}"
            said.setdefault((f"{run.noise(k, q.name, i):.3g} {q.unit}", rule), []).append(problem.fitted[k].title)
        if len(said) > 1:
            parts = (f"std {std} {rule} ({listed(names)})" for (std, rule), names in said.items())
            found.append(f"V of {q.name}: {'; '.join(parts)}.")
        for std, rule in [*said] if len(said) == 1 else ():
            alike.setdefault(f"std {{}} {rule}.", []).append((q.name, std))
        chosen = [run.noise(k, q.name, i) for k in recordings if q.name in run.open_outputs[k]]
        if q.noise_std and chosen and abs(np.log(chosen[0] / q.noise_std)) > np.log(FAR):
            found.append(
                f"The noise of {q.name}, {chosen[0]:.3g} {q.unit}, is {chosen[0] / q.noise_std:.2g} times what the model itself supposes, "
                f"{q.noise_std:.3g} {q.unit}: look at its residuals."
            )
    return _of_several("V", alike) + found


def _of_several(letter: str, alike: Mapping[str, Sequence[tuple[str, str]]]) -> list[str]:
    """A sentence for all weights of which the same can be said: what that is -> their names and deviations, in words."""
    return [f"{letter} of {listed([n for n, _ in of])}: {words.format(listed([std for _, std in of]))}" for words, of in alike.items()]


def _noise_is_given(problem: Problem, number: int, output: str) -> bool:
    """Whether the recording or V says the noise of an output in a fitted recording, by its number."""
    return problem.weights.noise(output, problem.fitted[number]) is not None


def _share_with_room(solution: Solution) -> float:
    t = solution.transcription
    std = t.force_std_at(solution.values)[[i for i, k in enumerate(t.soft) if not t.dae.places[k].name.startswith(INPUT)]]
    return float(np.mean(np.any(near_rest(std), axis=0))) if std.size else 0.0
