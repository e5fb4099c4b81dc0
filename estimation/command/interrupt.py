"""Ctrl-C that is not lost.

A KeyboardInterrupt that is raised inside a destructor or a callback of a library is printed away or turned into a status there.
So the command remembers that it was asked to stop, and asks again before anything is written.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_asked = threading.Event()


@contextmanager
def remembered() -> Iterator[None]:
    """Within the block an interrupt is raised as ever, and remembered for `check`."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def ask(_signal: int, _frame: FrameType | None) -> None:
        _asked.set()
        raise KeyboardInterrupt

    _asked.clear()
    before = signal.signal(signal.SIGINT, ask)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def check() -> None:
    """Raise KeyboardInterrupt if one was asked for since the command began."""
    if _asked.is_set():
        raise KeyboardInterrupt
