"""A name for all that the outcomes of a study hang on: the numbers of its programs, and the code that solves them.

What was given stands as it is; what was computed is rounded, so that another order of summation is no other study:

    decisions, targets -> whole GRIDs of a deviation,        scales and stds -> DIGITS significant digits
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

import numpy as np

from ..own_code import code_of
from .turned import TOLERANCE, Turned

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

GRID = TOLERANCE  # what a solve leaves open anyhow
DIGITS = 6
CODE = ("", "ocp", "smoothing", "weighing")  # that a solve goes through; a model is told by its equations


def identity(fitted: Turned, held_out: Turned | None, start: Array) -> str:
    """Of a study of these programs whose solves begin at decisions `start` (n + np,)."""
    found = hashlib.sha256(code_of(*CODE).encode())
    for turned, begin in ((fitted, start), (held_out, held_out.program.start if held_out else start)):
        for part in ("nothing",) if turned is None else _parts(turned, begin):
            found.update(f"{part.dtype}{part.shape}".encode() + part.tobytes() if isinstance(part, np.ndarray) else repr(part).encode())
    return found.hexdigest()[:16]


def _parts(turned: Turned, start: Array) -> Iterator[object]:
    """The numbers of one program, in an order that is always the same."""
    program = turned.program
    t, values, losses = program.transcription, program.values, program.losses
    n, free, dae = t.nlp.trajectory_size, list(t.nlp.free), t.dae
    yield dae.function().serialize()
    yield [[(q.name, q.unit) for q in kind] for kind in (dae.states, dae.outputs, dae.places, dae.parameters)]
    yield t.method, t.degree, t.soft, t.nlp.free, program.solver.options, TOLERANCE
    for h in t.horizons:
        yield from (h.clock, h.hold, h.mesh.knots, h.time, h.changes, np.ascontiguousarray(h.inputs), np.ascontiguousarray(h.target))
    yield from (program.lower, program.upper)
    yield _on_grid(start, values.unit)
    yield _on_grid(values.parameters[free], values.unit[n:])  # where terms refer to them
    yield _significant(np.delete(values.parameters, free))
    yield _significant(t.force_std)
    for term, target, scale in zip(t.nlp.terms, values.target, values.scale, strict=True):
        yield term.name, term.equality
        if not term.equality:  # a solve scales its equations anew
            with np.errstate(invalid="ignore"):
                yield np.round(np.nan_to_num(target * scale) / GRID) + 0.0
            yield _significant(scale)
    yield None if losses is None else (losses.huber.tobytes(), losses.auto.tobytes())
    yield turned.bent
    yield [(w.label, w.unit, w.row, w.is_noise, f"{w.std:.{DIGITS}g}") for w in turned.weights], sorted(turned.coloured.items())


def _on_grid(decisions: Array, unit: Array) -> Array:
    """Decisions in whole GRIDs of their units, which are deviations, these as powers of two: rounding is left no say in them."""
    return np.asarray(np.round(np.ldexp(decisions, -np.frexp(unit)[1]) / GRID) + 0.0, dtype=np.float64)  # and -0 is 0


def _significant(numbers: Array) -> Array:
    share, power = np.frexp(numbers)
    return np.asarray(np.ldexp(np.round(share, DIGITS), power) + 0.0, dtype=np.float64)
