"""Ctrl-C, or SIGTERM, that is not lost and comes at no wrong moment.

A KeyboardInterrupt that is raised inside a destructor or a callback of a library is printed away or turned into a status there.
So the command remembers that it was asked to stop, and asks again before anything is written. While old results are exchanged for new
ones it is remembered only.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

_asked, _held = threading.Event(), threading.Event()
_results: list[Path] = []
_kept: list[Path] = []
SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def remembered(*, last: bool = False) -> Iterator[None]:
    """Within the block an interrupt is raised as KeyboardInterrupt, and remembered for `check`.

    last: nothing comes after the block but the end of the process. Then Ctrl-C is ignored from there on: all is said and written, and
    it would only be printed as a fault of whatever the interpreter clears away just then.
    """
    _results.clear()
    _kept.clear()
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def ask(_signal: int, _frame: FrameType | None) -> None:
        _asked.set()
        if not _held.is_set():
            raise KeyboardInterrupt

    _asked.clear()
    before = [signal.signal(which, ask) for which in SIGNALS]
    try:
        yield
    finally:
        with held():
            after = [signal.SIG_IGN if last and which is signal.SIGINT else handler for which, handler in zip(SIGNALS, before, strict=True)]
            for which, handler in zip(SIGNALS, after, strict=True):
                signal.signal(which, handler)
            _asked.clear()


@contextmanager
def held() -> Iterator[None]:
    """Within the block an interrupt is remembered and not raised."""
    _held.set()
    try:
        yield
    finally:
        _held.clear()


def check() -> None:
    """Raise KeyboardInterrupt if one was asked for since the command began."""
    if _asked.is_set():
        raise KeyboardInterrupt


def written(out: Path) -> None:
    """Remember that there are results in `out` now, should an interrupt come after all."""
    _results.append(out)


def kept(path: Path) -> None:
    """Remember the file or folder where finished parts are kept, from which the same command goes on."""
    _kept.append(path)


def said() -> str:
    """What an interrupted command left behind."""
    if not _results and _kept and _kept[-1].exists():
        return f"interrupted: what is finished is kept in {_kept[-1]}; the same command goes on from there"
    return f"interrupted: the results are in {_results[-1]}" if _results else "interrupted: nothing was written"
