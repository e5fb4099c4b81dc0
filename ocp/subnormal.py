"""Numbers that are too small to be normal, taken for nothing: with them arithmetic is many times slower, and none of them matters.

What no noise reaches and what is forgotten, as the states of a delay, leaves them by the million in the factors of a matrix along time: its
entries shrink from step to step until they are less than 1e-308. (Intel 64 and IA-32 Architectures Software Developer's Manual, volume 1,
section 10.2.3: flush-to-zero, denormals-are-zeros.)
"""

from __future__ import annotations

import ctypes
import platform
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache

WORDS, MXCSR = 8, 7  # of 32 bits in the floating-point environment of Linux on x86-64, and which of them is the register
FLUSHED = 0x8000 | 0x0040  # results, and arguments


@contextmanager
def flushed() -> Iterator[None]:
    """Subnormal results and arguments are zero in this thread, and what it calls; elsewhere than in Linux on x86-64 nothing is done."""
    library = _library()
    if library is None:
        yield
        return
    before, now = (ctypes.c_uint32 * WORDS)(), (ctypes.c_uint32 * WORDS)()
    library.fegetenv(before)
    ctypes.memmove(now, before, ctypes.sizeof(before))
    now[MXCSR] |= FLUSHED
    library.fesetenv(now)
    try:
        yield
    finally:
        library.fesetenv(before)


@cache
def _library() -> ctypes.CDLL | None:
    """What has the environment's functions, where its layout is known."""
    if sys.platform != "linux" or platform.machine() != "x86_64":
        return None
    for name in (None, "libm.so.6"):
        with suppress(OSError):
            library = ctypes.CDLL(name)
            if hasattr(library, "fegetenv") and hasattr(library, "fesetenv"):
                return library
    return None
