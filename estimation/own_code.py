"""A name for the code of this program: what was computed by other code, and kept, counts as not there."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

from backsight import models, ocp

HERE = Path(__file__).parent
FOLDERS = {"models": Path(models.__file__).parent, "ocp": Path(ocp.__file__).parent}


@lru_cache
def code_of(*parts: str) -> str:
    """The version of the package and the text of these folders of it: "models", "ocp", or one of the estimation, such as "smoothing".

    "" is the estimation itself without its folders.
    """
    found = hashlib.sha256(version("backsight").encode())
    for part in parts:
        folder = FOLDERS.get(part, HERE / part)
        for path in sorted(folder.rglob("*.py") if part else folder.glob("*.py")):
            found.update(path.relative_to(folder).as_posix().encode() + path.read_bytes())
    return found.hexdigest()
