"""The command `backsight`: each verb is one call of the Python API.

Exit status: 0 done; 1 an error of this program; 2 bad input, nothing written; 3 no convergence, what there is is written
and marked; 130 interrupted,
by SIGINT or SIGTERM. A failure is one line on standard error that begins `error:`.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from ..threads import use_one
from .interrupt import remembered, said

MOST_ITERATIONS = 10  # Gauss-Newton steps for a sample
DONE, FAULT, BAD_INPUT, NO_CONVERGENCE, INTERRUPTED = 0, 1, 2, 3, 130
UsageError: type[Exception] = typer.BadParameter.__mro__[1]  # typer's own base of all mistakes on the command line

app = typer.Typer(
    name="backsight",
    help="Estimate the states, the parameters and the missing physics of a mechanical plant from its recordings.",
    add_completion=False,
    no_args_is_help=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

StudyArgument = Annotated[Path, typer.Argument(metavar="STUDY", help="The study file (TOML).")]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="DIR",
        help="Folder of the results; without it one named after the study, and after the command for simulate, track, weigh and diagnose.",
    ),
]
Estimates = Annotated[
    Path | None,
    typer.Option(
        "--estimates",
        metavar="DIR",
        help="Results of smooth or diagnose: the parameters estimated there, and the model repaired there, take the place of the study's.",
    ),
]
Profiles = Annotated[
    list[str] | None,
    typer.Option("--profile", metavar="NAME", help="Profile likelihood of this parameter, with its 95 % interval; may be repeated."),
]
Varied = Annotated[
    list[str] | None,
    typer.Option(
        "--vary",
        metavar="LABEL=FACTORS",
        help='Solve with these factors on the std of a weight too: "W of carriage=0.1,1,10"; repeated, with all combinations.',
    ),
]
Jobs = Annotated[int, typer.Option("--jobs", metavar="N", help="Processes for independent pieces of work.")]
AllJobs = Annotated[
    int | None, typer.Option("--jobs", metavar="N", help="Processes for independent pieces of work (default: one for every processor).")
]
Seconds = Annotated[
    float | None,
    typer.Option("--seconds", metavar="S", min=1.0, help="The search ends after so long with what it has; the proof comes after it (840)."),
]
Scheduler = Annotated[str | None, typer.Option("--scheduler", metavar="ADDRESS", help="Do them on this Dask cluster instead.")]
Stdin = Annotated[bool, typer.Option("--stdin", help="Read rows from standard input as they come, and write an estimate for each.")]
State = Annotated[
    Path | None,
    typer.Option("--state", metavar="FILE", help="With --stdin: go on from this file if it is there, and leave the state there."),
]
RealTime = Annotated[bool, typer.Option("--real-time", help="One Gauss-Newton step for every sample (default: until it converges).")]
Jit = Annotated[bool, typer.Option("--jit/--no-jit", help="Compile the model with the C compiler, once, where there is one.")]
Verbose = Annotated[bool, typer.Option("--verbose", help="Say on standard error what is being done, a line for every stage.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")]
Json = Annotated[bool, typer.Option("--json", help="Print result.json on standard output, and nothing else.")]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit status; no exception leaves, but for BACKSIGHT_TRACEBACK=1.

    arguments: those of the process by itself, which then has nothing else to do: a Ctrl-C that comes after the last word is ignored.
    """
    use_one()
    try:
        with warnings.catch_warnings(), remembered(last=arguments is None):
            if not sys.warnoptions:
                warnings.simplefilter("ignore")
            status = app(args=None if arguments is None else list(arguments), prog_name="backsight", standalone_mode=False)
        if status == INTERRUPTED:  # typer has caught it
            raise KeyboardInterrupt
        return status if isinstance(status, int) else DONE
    except KeyboardInterrupt:
        sys.stderr.write(f"{said()}\n")
        return INTERRUPTED
    except Exception as error:
        return _report(error)
    finally:
        _flush()


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context, version: Annotated[bool, typer.Option("--version", help="Print the version.", is_eager=True)] = False
) -> None:
    if version:
        from importlib.metadata import version as installed

        typer.echo(f"backsight {installed('backsight')}")
        raise typer.Exit(DONE)
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
        raise typer.Exit(DONE)


@app.command()
def demo(out: Out = None, jobs: Jobs = 1, scheduler: Scheduler = None, quiet: Quiet = False, json: Json = False) -> int:
    """Run the built-in study: what does the model of a gantry table leave out?"""
    from .commands import Options, run_demo

    return run_demo(Options(out=out, jobs=jobs, scheduler=scheduler, quiet=quiet, json=json))


@app.command()
def models(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help='A plant, "file.py:function", "file.mo:Class", a library or a component.')
    ] = None,
    fmu: Annotated[Path | None, typer.Option("--fmu", metavar="FILE", help="Write it as an FMU 3.0 for model exchange instead.")] = None,
    json: Json = False,
) -> int:
    """List plants and components, or print one: of a plant its equations, parameters, signals, places, and what its outputs can tell."""
    from .commands import print_models, write_fmu

    return print_models(name, json=json) if fmu is None else write_fmu(name, fmu)


@app.command()
def simulate(
    study: StudyArgument,
    estimates: Estimates = None,
    out: Out = None,
    jobs: Jobs = 1,
    scheduler: Scheduler = None,
    verbose: Verbose = False,
    quiet: Quiet = False,
    json: Json = False,
) -> int:
    """Run the model under the recorded inputs, beside the recording."""
    from .commands import Options, run_simulate

    return run_simulate(study, Options(out=out, jobs=jobs, scheduler=scheduler, verbose=verbose, quiet=quiet, json=json), estimates)


@app.command()
def smooth(
    study: StudyArgument,
    profile: Profiles = None,
    out: Out = None,
    jobs: Jobs = 1,
    scheduler: Scheduler = None,
    verbose: Verbose = False,
    quiet: Quiet = False,
    json: Json = False,
) -> int:
    """Estimate states, residual forces and parameters, with their uncertainties, from whole recordings."""
    from .commands import Options, run_smooth

    return run_smooth(study, Options(out=out, jobs=jobs, scheduler=scheduler, verbose=verbose, quiet=quiet, json=json), profile or ())


@app.command()
def track(
    study: StudyArgument,
    stdin: Stdin = False,
    state: State = None,
    real_time: RealTime = False,
    jit: Jit = True,
    out: Out = None,
    jobs: Jobs = 1,
    scheduler: Scheduler = None,
    verbose: Verbose = False,
    quiet: Quiet = False,
    json: Json = False,
) -> int:
    """Estimate on-line, with a moving horizon: one estimate per sample, from the samples up to it."""
    from .commands import Options, run_stream, run_track

    options = Options(out=out, jobs=jobs, scheduler=scheduler, verbose=verbose, quiet=quiet, json=json)
    iterations = 1 if real_time else MOST_ITERATIONS
    if stdin:
        return run_stream(study, options, state, iterations, jit=jit)
    if state is not None:
        raise typer.BadParameter("--state goes with --stdin, the rows of which it goes on with")
    return run_track(study, options, iterations, jit=jit)


@app.command()
def weigh(
    study: StudyArgument,
    vary: Varied = None,
    out: Out = None,
    jobs: AllJobs = None,
    scheduler: Scheduler = None,
    verbose: Verbose = False,
    quiet: Quiet = False,
    json: Json = False,
) -> int:
    """Study the weighting matrices: which W and V the data want, and what hangs on them."""
    from .commands import Options, run_weigh
    from .vary import varied

    options = Options(out=out, jobs=_all_of(jobs), scheduler=scheduler, verbose=verbose, quiet=quiet, json=json)
    return run_weigh(study, options, varied(vary or ()))


@app.command()
def diagnose(
    study: StudyArgument,
    out: Out = None,
    jobs: AllJobs = None,
    scheduler: Scheduler = None,
    verbose: Verbose = False,
    quiet: Quiet = False,
    json: Json = False,
    seconds: Seconds = None,
) -> int:
    """Find what the model leaves out: where it is, what it is, how sure that is, and what could not have been seen."""
    from .commands import Options, run_diagnose

    options = Options(out=out, jobs=_all_of(jobs), scheduler=scheduler, verbose=verbose, quiet=quiet, json=json)
    return run_diagnose(study, options, seconds)


def _all_of(jobs: int | None) -> int:
    """Processes that were asked for, without a number one for every processor."""
    return (os.cpu_count() or 1) if jobs is None else jobs


def _report(error: Exception) -> int:
    """Say in one line what went wrong, and return the status that means it."""
    if os.environ.get("BACKSIGHT_TRACEBACK") == "1":
        import traceback

        traceback.print_exception(error)
    from backsight.models.errors import InputError, ModelError, SolveError  # brings CasADi along: a second that --help need not wait

    if isinstance(error, (InputError, ModelError)):
        return _fail(str(error), BAD_INPUT)
    if isinstance(error, SolveError):
        return _fail(str(error), NO_CONVERGENCE)
    if isinstance(error, UsageError) or hasattr(error, "format_message"):
        message = error.format_message() if hasattr(error, "format_message") else str(error)
        return _fail(f"{message.rstrip('.')}; see backsight --help", BAD_INPUT)
    if isinstance(error, MemoryError):
        return _fail("out of memory; use a shorter range or a larger every", FAULT)
    kind = type(error).__name__
    return _fail(f"{kind}: {error} (this is a fault of backsight; BACKSIGHT_TRACEBACK=1 shows where it happened)", FAULT)


def _fail(message: str, status: int) -> int:
    sys.stderr.write(f"error: {' '.join(message.split())}\n")
    return status


def _flush() -> None:
    """Write what is left to write; a reader that has gone away is no fault of ours."""
    try:
        sys.stdout.flush()
    except (BrokenPipeError, ValueError):
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - the interpreter flushes it at exit
