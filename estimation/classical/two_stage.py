"""The two-stage method for recordings from a closed loop whose controller is unknown.

    1   u(k) = sum_j s_j r(k - j) + rest       every input on the past of the references, on their clock: a long FIR or ARX model
        u^(k) = simulated from r alone         free of the noise that the controller feeds back
    2   the plant from u^ to y, by a method that needs an input that is not correlated with the noise

y = G u + v = G u^ + (v + G (u - u^)), and the bracket is not correlated with u^, whatever the controller: where a direct method with a
wrong noise model is biased, this one is not, at the price of the larger noise (P. M. J. Van den Hof, R. J. P. Schrama, Automatica 29,
1993; M. Back, Grey-box Modelling of a Quadrotor Using Closed-loop Data, Linkoping University, 2015, section 2.5). The controller may be
nonlinear, but what the first stage keeps of it is the linear part. The standard deviations are those of the second stage: they leave out
what the coefficients of the first are uncertain by, a share of about coefficients/samples of the noise in the input.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from scipy.signal import lfilter

from backsight.models.errors import InputError, suggestion

from ..problem import Problem
from ..recordings.delay import between_rows
from ..recordings.drive import Drive, drive_of
from ..recordings.gaps import gap_limit
from ..recordings.recording import Recording
from ..wording import listed
from .armax import Armax, Orders, armax
from .prediction_error import prediction_error
from .result import Baseline
from .sampling import uniform_step

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Column = np.ndarray[tuple[int], np.dtype[np.float64]]
SHARE = 0.1  # of the samples: most coefficients of the first stage


def two_stage(
    problem: Problem,
    *,
    references: Sequence[str],
    order: int = 50,
    first: Literal["fir", "arx"] = "fir",
    second: Callable[[Problem], Baseline] = prediction_error,
) -> Baseline:
    """A baseline from recordings in closed loop.

    references  what drives the loop from outside: further inputs of the recordings, beside those of the plant
    order       coefficients of the first stage for every reference, from lag zero on; "arx" has as many of the input's own past
    first       "fir", or "arx" for loops that take longer to settle than `order` samples
    second      the method of the second stage; it must not model the noise (by itself prediction_error, which simulates)

    Pieces between gaps have first stages of their own; those too short for one are left out. So is what is known of the start: the rows
    there are the past of the first stage. Raises InputError for unequal steps, unknown references, an order too long for the recording or
    for what the reference excites.
    """
    if not references:
        raise InputError("two_stage(references=[]): needs the name of at least one recorded reference; without one use prediction_error.")
    if first not in ("fir", "arx"):
        raise InputError(f'two_stage(first={first!r}): the first stage is "fir" or "arx".')
    if isinstance(order, bool) or not isinstance(order, int) or order < 1:
        raise InputError(f"two_stage(order={order!r}): needs a whole number from 1 on.")
    own = [q.name for q in problem.dae.inputs]
    recordings, said, short = list[Recording](), list[str](), list[str]()
    for recording in (r for r in problem.recordings if r.role == "fit"):
        _check(recording, references, own)
        pieces = _long_enough(recording, order * len(references) * (1 if first == "fir" else 2))
        short += sorted({piece.title for piece in recording.pieces} - {piece.title for piece in pieces})
        parts = [_explained(piece, own, references, order, first) for piece in pieces]
        said += [text for _, texts in parts for text in texts]
        recordings.append(_joined(recording, [part for part, _ in parts]))
    held_out = [r for r in problem.recordings if r.role != "fit"]
    always = {name: known for name, known in problem.start.items() if known.always}
    found = second(replace(problem, recordings=[*recordings, *held_out], initial=always))
    notes = [f"First stage ({first}, {order} coefficients): variance of the input that the references explain: {'; '.join(said)}."]
    if short:
        notes.append(f"Too short for a first stage, and left out: {listed(short)}.")
    return replace(found, method=f"two_stage, {found.method}", notes=(*notes, *found.notes))


def _check(recording: Recording, references: Sequence[str], own: Sequence[str]) -> None:
    others = [name for name in recording.inputs if name not in own]
    for name in references:
        if name not in others:
            raise InputError(
                f"two_stage(references=..): {recording.name} has no reference {name!r} among its inputs beside those of the plant; "
                f"{suggestion(name, others)}"
            )


def _long_enough(recording: Recording, count: int) -> list[Recording]:
    """The pieces whose inputs tell so many coefficients; raises InputError where none does."""
    lengths = [len(drive_of(piece).time) for piece in recording.pieces]
    if count > SHARE * max(lengths):
        where = " between gaps" if len(lengths) > 1 else ""
        raise InputError(
            f"{recording.name}: {max(lengths)} samples of the inputs{where} are too few for a first stage of {count} coefficients; lower "
            'order, or use first = "arx".'
        )
    return [piece for piece, length in zip(recording.pieces, lengths, strict=True) if count <= SHARE * length]


def _explained(
    piece: Recording, own: Sequence[str], references: Sequence[str], order: int, first: Literal["fir", "arx"]
) -> tuple[Recording, list[str]]:
    """A piece from where its first stage has the whole past, under the inputs that the references explain, and how much that is."""
    drive, inputs, said = drive_of(piece), dict[str, Column](), list[str]()
    uniform_step(piece, "two_stage", drive.time)
    for name in own:
        inputs[name] = _driven(_first_stage(piece.title, drive, name, references, order, first)).ravel()[order:]
        recorded = drive.inputs[name][order:]
        said.append(f"{name} of {piece.title} {100 * (1 - np.var(recorded - inputs[name]) / (np.var(recorded) or 1.0)):.1f} %")
    return _with_inputs(piece, Drive(drive.time[order:], inputs)), said


def _first_stage(title: str, drive: Drive, name: str, references: Sequence[str], order: int, first: str) -> Armax:
    """The input as the output of a difference equation that the references drive, on the clock of both."""
    inputs = {r: drive.inputs[r] for r in references}
    series = Recording(name=title, time=drive.time, inputs=inputs, outputs={name: drive.inputs[name]})
    orders = Orders(na=0 if first == "fir" else order, nb=order, nk=0, offset=True)
    found = armax(series, output=name, orders=orders)
    if np.any(np.abs(np.roots(found.A)) >= 1.0):
        raise InputError(f'{title}: the first stage for {name} is not stable with order = {order}; change it, or use first = "fir".')
    return found


def _driven(model: Armax) -> Array:
    """Its output from the references alone, from the mean of the input as if it had been there for long."""
    drive = np.full(len(model.recording.time), model.offset)
    for b, name in zip(model.B, model.inputs, strict=True):
        drive = drive + np.asarray(lfilter(b, [1.0], model.recording.inputs[name]))
    past = len(model.A) - 1
    level = float(np.mean(model.recording.outputs[model.output]))
    start = -level * np.cumsum(model.A[:0:-1])[::-1]
    return np.asarray(lfilter([1.0], model.A, drive, zi=start)[0] if past else drive, dtype=np.float64)


def _with_inputs(recording: Recording, drive: Drive) -> Recording:
    """Its rows from where these inputs begin, under them."""
    there = recording.time >= drive.time[0]
    time, outputs = recording.time[there], {name: y[there] for name, y in recording.outputs.items()}
    if recording.drive is None:
        return replace(recording, time=time, inputs=drive.inputs, outputs=outputs)
    return replace(recording, time=time, inputs=between_rows(drive, time, recording.hold), outputs=outputs, drive=drive)


def _joined(recording: Recording, parts: Sequence[Recording]) -> Recording:
    """The parts of a recording as one, in which they are pieces as before; of a single one its start is still no recording's."""
    if len(parts) == 1:
        return parts[0]
    samples = [{name: np.full(len(part.time), np.nan) for name in recording.outputs} | dict(part.outputs) for part in parts]
    drives = [part.drive for part in parts if part.drive is not None]
    return replace(
        recording,
        time=np.concatenate([part.time for part in parts]),
        inputs={name: np.concatenate([part.inputs[name] for part in parts]) for name in parts[0].inputs},
        outputs={name: np.concatenate([outputs[name] for outputs in samples]) for name in recording.outputs},
        gap=gap_limit(recording),
        drive=_in_turn(drives) if drives else None,
    )


def _in_turn(drives: Sequence[Drive]) -> Drive:
    inputs = {name: np.concatenate([d.inputs[name] for d in drives]) for name in drives[0].inputs}
    return Drive(np.concatenate([d.time for d in drives]), inputs)
