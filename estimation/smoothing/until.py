"""A limit of time that every line of progress keeps, and every evaluation of a solver."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from backsight.models.errors import OutOfTime
from backsight.ocp.oracle import no_check


@dataclass(frozen=True)
class Until:
    """`say`, which comes at every step of the way and raises OutOfTime from `end` on [s of `time.monotonic`]; `check` without a word."""

    end: float
    say: Callable[[str], None]

    def __call__(self, line: str) -> None:
        self.check()
        self.say(line)

    def check(self) -> None:
        if time.monotonic() > self.end:
            raise OutOfTime("Stopped at its limit of time.")


def checked(say: Callable[[str], None]) -> Callable[[], None]:
    """What a solver calls while it is at it, of what tells of progress."""
    return say.check if isinstance(say, Until) else no_check
