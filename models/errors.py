"""The errors of this project, drawn once.

    BacksightError
    ├── ModelError   a declaration: unconnected, unbalanced, singular, unknown name   (also a ValueError)
    ├── InputError   what the user handed in: study, recording, argument              (also a ValueError)
    └── SolveError   a solver that did not arrive

A message says which argument, as it was typed; the rule; the value seen; the remedy.
"""

from collections.abc import Iterable
from difflib import get_close_matches


class BacksightError(Exception):
    """Anything this package refuses or could not do."""


class ModelError(BacksightError, ValueError):
    """A model that is declared wrongly: a name, a connection, a balance of equations and unknowns."""


class InputError(BacksightError, ValueError):
    """A study, a recording or an argument that cannot be used."""


class SolveError(BacksightError):
    """A solver that stopped before its answer."""


class OutOfTime(SolveError):
    """A smoothing that has taken as long as it may."""


def suggestion(name: str, known: Iterable[str]) -> str:
    """The remedy for an unknown name: the nearest known one, or the list of all."""
    names = list(known)
    if not names:
        return "there are none"
    near = get_close_matches(name, names, n=1, cutoff=0.55)
    if not near:
        tails = {other.rsplit(".", 1)[-1]: other for other in names}
        near = [tails[tail] for tail in get_close_matches(name.rsplit(".", 1)[-1], list(tails), n=1, cutoff=0.8)]
    return f"did you mean '{near[0]}'?" if near else "known: " + ", ".join(names)
