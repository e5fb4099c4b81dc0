"""Finished parts of a diagnosis, one file each: what was interrupted goes on where it stopped.

The files are pickles of this program for itself; they lie in a folder of its own and are named after everything that they hang on.
"""

from __future__ import annotations

import hashlib
import pickle
import time
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from backsight.models.errors import OutOfTime

from ...own_code import code_of
from ...problem import Problem
from ...results import Smoothing
from ...whole_files import keep
from ..candidates.candidate import Candidate

CODE = ("", "models", "ocp", "recordings", "smoothing", "validation", "diagnosis")  # that a part goes through; "": what all have in common
DIGITS = 9  # of a number that tells one part from another


class Keep:
    """Parts of one diagnosis in a folder; None keeps nothing. A file that cannot be read counts as not there."""

    def __init__(self, folder: Path | None, problem: Problem) -> None:
        self.folder, self._problem = folder, _of_problem(problem) if folder else ""

    def name(self, what: str, candidate: Candidate | None = None, start: Mapping[str, float] | None = None) -> str:
        """Of a part: the problem, what came before, the candidate's edits and where its fit starts."""
        edits = [(edit.words, *(getattr(edit, name, None) for name in ("time", "until"))) for edit in candidate.edits] if candidate else []
        numbers = {k: f"{v:.{DIGITS}g}" for k, v in sorted((start or {}).items())}
        own = repr((code_of(*CODE), self._problem, what, candidate.key if candidate else "", edits, numbers))
        return hashlib.sha256(own.encode()).hexdigest()[:32]

    def get(self, name: str) -> Any:
        """The part, None where there is none."""
        if self.folder is None:
            return None
        try:
            return pickle.loads((self.folder / f"{name}.part").read_bytes())
        except (OSError, pickle.UnpicklingError, EOFError, AttributeError, ImportError, IndexError, RuntimeError):
            return None

    def put(self, name: str, part: object) -> None:
        """Keep it, whole or not at all."""
        if self.folder is not None:
            keep(self.folder / f"{name}.part", pickle.dumps(part))

    def smoothed(self, name: str, smoothing: Callable[[], Smoothing], seconds: float = inf) -> Smoothing | None:
        """A smoothing with its solution, which a result alone leaves behind in a file; None where it ran out of time.

        seconds: after which its solver stops where it is. What the clock may have left so is not kept: another run, on a machine that has
        nothing else to do, may come to rest.
        """
        part, began = self.get(name), time.monotonic()
        if part is None:
            try:
                result = smoothing()
            except OutOfTime:
                return None
            part = result, result.solution
            if result.solver.converged or time.monotonic() - began < seconds:
                self.put(name, part)
        found: Smoothing = replace(part[0], solution=part[1])
        return found


def _of_problem(problem: Problem) -> str:
    """What tells a problem from others: its equations, with the numbers of its model, recordings, parameters and weights."""
    found = hashlib.sha256(problem.dae.function().serialize().encode())
    found.update(repr((problem.dae.parameters, problem.dae.states, problem.dae.inputs, problem.dae.outputs, problem.dae.places)).encode())
    for r in problem.recordings:
        drive = {} if r.drive is None else {"drive": r.drive.time, **r.drive.inputs}
        for name, array in (("time", r.time), *r.inputs.items(), *r.outputs.items(), *drive.items()):
            found.update(name.encode() + np.ascontiguousarray(array).tobytes())
        found.update(repr([getattr(r, f.name) for f in fields(r) if f.name not in ("time", "inputs", "outputs", "drive")]).encode())
    found.update(repr((problem.parameters, problem.weights, problem.initial, problem.bounds)).encode())
    return found.hexdigest()
