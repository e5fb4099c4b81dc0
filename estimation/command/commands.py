"""What the verbs of the command do: read the study, call the API, write the folder, print a summary."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..study.study import Study
from ..workers import check_workers
from .diagnosis_json import repaired_code, result_of_diagnosis
from .interrupt import check, kept
from .output import REPAIRED, json_text, results_folder, write_estimates, write_result
from .result_json import (
    estimated_parameters,
    repaired_model,
    result_of_simulation,
    result_of_smoothing,
    result_of_tracking,
    result_of_weighing,
)
from .terminal import console, diagnosis_table, parameter_table, simulation_table, tracking_table, weight_table

if TYPE_CHECKING:
    from ..diagnosis import Diagnosis
    from ..results import Smoothing

DONE, NO_CONVERGENCE = 0, 3
Progress = Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class Options:
    """What every verb takes: the folder of the results, where to work, what to print."""

    out: Path | None = None
    jobs: int = 1
    scheduler: str | None = None
    verbose: bool = False
    quiet: bool = False
    json: bool = False


def run_demo(options: Options) -> int:
    """Find what the model of the bundled study leaves out."""
    bundled = Path(str(files("backsight.data"))) / "demo.toml"
    return _diagnose(Study.read(bundled, label="demo.toml"), options.out or Path("backsight_demo"), options, command="demo")


def run_smooth(path: Path, options: Options, profiled: Sequence[str] = ()) -> int:
    """Smooth a study, and profile the parameters named."""
    return _smooth(Study.read(path), options.out or _named_after(path), options, command="smooth", profiled=profiled)


def run_simulate(path: Path, options: Options, estimates: Path | None = None) -> int:
    """Simulate a study, with the parameters estimated in the results folder `estimates` where one is given.

    Of a diagnosis that found something it is the repaired model that is simulated.
    """
    from ..report import write_simulation_report
    from ..simulation import simulate_study

    study = Study.read(path)
    repaired = None if estimates is None else repaired_model(estimates)
    study = study if repaired is None else study.of(repaired)
    estimated = {} if estimates is None else estimated_parameters(estimates, study.dae, every=repaired is not None)
    out = options.out or _named_after(path, "_simulated")
    with results_folder(out) as folder, _progress(options) as say:
        answer = simulate_study(study, estimated, jobs=options.jobs, scheduler=options.scheduler, progress=say)
        say("writing the report")
        result = result_of_simulation(answer, study.dae, {r.name: r.role for r in study.recordings})
        write_result(result, folder / "result.json")
        write_estimates(answer.estimates, folder / "estimates.csv")
        listed = {name: (p["value"], p["unit"]) for name, p in result["parameters"].items()}
        page = folder / "report.html"
        write_simulation_report(answer.estimates, study.recordings, page, model=answer.model, units=answer.units, parameters=listed)
    _say(options, result, lambda: simulation_table(answer), out)
    return DONE


def run_stream(path: Path, options: Options, state: Path | None, iterations: int, *, jit: bool = True) -> int:
    """Track rows that come in on standard input."""
    from .stream import stream, write_stream_result

    check_workers(options.jobs, options.scheduler)
    study, began = Study.read(path), time.perf_counter()
    warn = None if options.quiet else sys.stderr
    with _progress(options) as say, results_folder(options.out) if options.out else nullcontext() as folder:
        say("reading the study")
        estimator = stream(study, state=state, iterations=iterations, jit=jit, as_json=options.json, say=say, warn=warn)
        if folder is not None:
            write_stream_result(estimator, folder, began)
    return DONE


def run_track(path: Path, options: Options, iterations: int, *, jit: bool = True) -> int:
    """Track a study's recordings with a moving horizon."""
    from ..report import write_tracking_report
    from ..tracking import track
    from ..tracking.estimator import SAMPLES

    check_workers(options.jobs, options.scheduler)
    study, out = Study.read(path), options.out or _named_after(path, "_tracked")
    with results_folder(out) as folder, _progress(options) as say:
        say("reading the study")
        samples = study.horizon()
        problem = study.problem()
        shortest = min(len(r.time) for r in problem.fitted)
        answer = track(problem, samples=samples or min(SAMPLES, shortest), iterations=iterations, jit=jit, progress=say)
        say("writing the report")
        result = result_of_tracking(answer)
        write_result(result, folder / "result.json")
        write_estimates(answer.estimates, folder / "estimates.csv")
        write_tracking_report(answer, folder / "report.html", recordings=problem.recordings)
    _say(options, result, lambda: tracking_table(answer), out)
    return DONE


def run_weigh(path: Path, options: Options, vary: Mapping[str, Sequence[float]] | None = None) -> int:
    """Study the weights of a study, and turn those that are to `vary`, label -> factors.

    Finished settings stay in a hidden folder beside the results until these are written.
    """
    from ..report import write_weighing_report
    from ..weighing import weigh

    check_workers(options.jobs, options.scheduler)
    study, out = Study.read(path), options.out or _named_after(path, "_weighed")
    keep = _beside(out, "settings")
    with results_folder(out) as folder, _progress(options) as say:
        say("reading the study")
        kept(keep)
        found = weigh(study.problem(), vary=vary, jobs=options.jobs, scheduler=options.scheduler, keep=keep, progress=say)
        say("writing the report")
        result = result_of_weighing(found)
        write_result(result, folder / "result.json")
        write_estimates(found.recommended.estimates, folder / "estimates.csv")
        write_weighing_report(found, folder / "report.html")
    shutil.rmtree(keep, ignore_errors=True)
    _say(options, result, lambda: weight_table(found), out)
    return DONE if found.recommended.solver.converged else NO_CONVERGENCE


def run_diagnose(path: Path, options: Options, seconds: float | None = None) -> int:
    """Find what a study's model leaves out, in a search of so many seconds.

    Finished parts stay in a hidden folder beside the results until these are written.
    """
    return _diagnose(Study.read(path), options.out or _named_after(path, "_diagnosed"), options, command="diagnose", seconds=seconds)


def _diagnose(study: Study, out: Path, options: Options, *, command: str, seconds: float | None = None) -> int:
    from ..diagnosis import diagnose
    from ..diagnosis.diagnose import SEARCH
    from ..report import write_diagnosis_report

    check_workers(options.jobs, options.scheduler)
    keep = _beside(out, "parts")
    with results_folder(out) as folder, _progress(options) as say:
        say("reading the study")
        kept(keep)
        problem = replace(study.problem(), model=study.model)
        limit = SEARCH if seconds is None else seconds
        found: Diagnosis = diagnose(problem, jobs=options.jobs, scheduler=options.scheduler, keep=keep, seconds=limit, progress=say)
        say("writing the report")
        code, unwritten = repaired_code(found, out)
        found = replace(found, notes=(*found.notes, *unwritten))
        result = result_of_diagnosis(found) | {"command": command, "repaired_model": REPAIRED if code else None}
        if code:
            (folder / REPAIRED).write_text(code, encoding="utf-8")
        write_result(result, folder / "result.json")
        write_estimates(found.after.estimates, folder / "estimates.csv")
        write_diagnosis_report(found, folder / "report.html")
    shutil.rmtree(keep, ignore_errors=True)
    _say(options, result, lambda: diagnosis_table(found), out)
    return _converged(found.after, out)


def print_models(name: str | None, *, json: bool) -> int:
    """The list of plants and libraries, or all about one of them, or about one component."""
    from backsight.models.errors import InputError

    from .catalogue import LIBRARIES, catalogue, declared, description, details, explained, library, meant

    components = library(name) if name else []
    if name and not components and (near := meant(name)):
        raise InputError(f'models: "{name}" is no plant, library or component; {near}')
    if components:
        sys.stdout.write(json_text({"components": declared(components)}) if json else explained(components))
    elif name:
        sys.stdout.write(json_text(details(name)) if json else description(name))
    elif json:
        sys.stdout.write(json_text({"models": catalogue(), "libraries": {n: [kind.__name__ for _, kind in library(n)] for n in LIBRARIES}}))
    else:
        sys.stdout.write("".join(f"{n:14s} {text}\n" for n, text in catalogue().items()))
        sys.stdout.write("\nComponents to make others of:\n")
        sys.stdout.write("".join(f"{n:14s} {', '.join(kind.__name__ for _, kind in library(n))}\n" for n in LIBRARIES))
    return DONE


def write_fmu(name: str | None, path: Path) -> int:
    """One model as an FMU."""
    from backsight.models.errors import InputError
    from backsight.models.exchange import export_fmu

    from ..study.model_source import compiled, load_model

    if name is None:
        raise InputError(f"--fmu {path}: no model is named; write backsight models NAME --fmu {path}")
    written = export_fmu(compiled(load_model(name, Path(), label="models"), label=f"models {name}"), path)
    sys.stdout.write(f"{written}\n")
    return DONE


def _smooth(study: Study, out: Path, options: Options, *, command: str, profiled: Sequence[str] = ()) -> int:
    from ..report import write_report
    from ..smoothing.profile import check_names, profile
    from ..smoothing.smoother import smooth

    check_workers(options.jobs, options.scheduler)
    with results_folder(out) as folder, _progress(options) as say:
        say("reading the study")
        problem = study.problem()
        check_names(problem, profiled)
        answer: Smoothing = smooth(problem, progress=say)
        if profiled and answer.solver.converged:
            answer = replace(answer, profiles=profile(problem, answer, profiled, progress=say))
        if study.file.horizon is not None:
            answer = replace(answer, notes=(*answer.notes, "[horizon] is for a moving horizon: here whole recordings were smoothed."))
        say("writing the report")
        result = result_of_smoothing(answer, command=command)
        write_result(result, folder / "result.json")
        write_estimates(answer.estimates, folder / "estimates.csv")
        write_report(answer, folder / "report.html", recordings=problem.recordings)
    _say(options, result, lambda: parameter_table(answer), out)
    return _converged(answer, out)


def _converged(answer: Smoothing, out: Path) -> int:
    """The status that means it, with a line on standard error where it did not."""
    if answer.solver.converged:
        return DONE
    sys.stderr.write(f"error: no convergence: {answer.solver.status.rstrip('.')}; what there is, is in {out}, marked\n")
    return NO_CONVERGENCE


def _named_after(study: Path, ending: str = "") -> Path:
    """The folder beside the study that has its name without .toml, and this ending."""
    return study.with_name(f"{study.stem}{ending or ('' if study.suffix else '_results')}")


def _beside(out: Path, ending: str) -> Path:
    """The hidden folder beside that of the results, also where this is the one that the command runs in: its own name counts, not a dot."""
    place = out.resolve()
    return place.parent / f".{place.name}.{ending}"


@contextmanager
def _progress(options: Options) -> Iterator[Progress]:
    """What is being done, on standard error: while it is a terminal in a line that changes, or in lines that stay."""
    screen = console(stderr=True)
    if options.verbose and not options.quiet:
        yield _lines()
        return
    if options.quiet or not screen.is_terminal:
        yield lambda _: check()
        return
    with screen.status("starting") as status:

        def say(text: str) -> None:
            check()
            status.update(text)

        yield say


def _lines() -> Progress:
    """Writes a line for every stage; of what is said again and again, as by the solver, the first."""
    last, began = "", time.monotonic()

    def say(text: str) -> None:
        nonlocal last
        check()
        stage = " ".join(text.split()[:2])
        if stage != last:
            sys.stderr.write(f"{time.monotonic() - began:8.1f} s  {text}\n")
            sys.stderr.flush()
        last = stage

    return say


def _say(options: Options, result: dict[str, Any], table: Callable[[], Any], out: Path) -> None:
    if options.json:
        sys.stdout.write(json_text(result))
    elif not options.quiet:
        screen = console()
        screen.print(table())
        for note in result.get("notes", ()):
            screen.print(f"- {note}", soft_wrap=True, highlight=False, markup=False)
        written = "report.html" if (out / "report.html").exists() else "result.json"
        screen.print(f"results: {out / written}", soft_wrap=True, highlight=False, markup=False)
