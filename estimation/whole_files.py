"""Files that are there whole or not at all."""

from __future__ import annotations

import os
import tempfile
import warnings
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


def keep(path: Path, content: bytes) -> None:
    """The same of what is kept for a second run alone: its folder is made, and where it cannot be written that is a warning."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with written_whole(path) as file:
            file.write(content)
    except OSError as error:
        said = f"{path.parent}: a finished part is not kept ({error.strerror or error}); a second run would do it again."
        warnings.warn(said, RuntimeWarning, stacklevel=3)


def permit(path: Path, mode: int) -> None:
    """Give what was made for its owner alone the permissions of any new file (`mode` 0o666) or folder (0o777), less the umask."""
    mask = os.umask(0)
    os.umask(mask)
    path.chmod(mode & ~mask)
