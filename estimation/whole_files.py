"""Files that are there whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any


@contextmanager
def written_whole(path: Path) -> Iterator[IO[Any]]:
    """A file beside `path` to write bytes to, which takes its place at the end; where anything goes wrong `path` stays as it was.

    Raises OSError where it cannot be written.
    """
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}-")
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
        permit(Path(name), 0o666)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def permit(path: Path, mode: int) -> None:
    """Give what was made for its owner alone the permissions of any new file (`mode` 0o666) or folder (0o777), less the umask."""
    mask = os.umask(0)
    os.umask(mask)
    path.chmod(mode & ~mask)
