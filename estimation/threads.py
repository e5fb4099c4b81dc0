"""Threads of the linear algebra library: one, unless the user says otherwise in the environment.

Matrices are as small as a plant: threads only wait for each other, the longer the busier the machine, and two processes with two each
are slower than one. The library reads the environment when it is loaded, so this imports nothing.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

NAMES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def use_one() -> list[str]:
    """One from now on, here and in what is started; gives the names that the user had left open."""
    added = [name for name in NAMES if name not in os.environ]
    os.environ.update(dict.fromkeys(added, "1"))
    return added


@contextmanager
def one_each() -> Iterator[None]:
    """One in every process that is started now."""
    added = use_one()
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)
