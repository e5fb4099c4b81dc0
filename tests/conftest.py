"""What all tests share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

os.environ["COLUMNS"] = "160"  # rich folds its tables by it; messages must not depend on the terminal


@pytest.fixture(scope="session", autouse=True)
def _cache(tmp_path_factory):
    """Compiled stages are not left in the user's cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session")
def checkout() -> Path:
    """The project's root; tests that look at its files are skipped where only the installed package is at hand."""
    root = Path(__file__).resolve().parent.parent
    if not (root / "Makefile").is_file():
        pytest.skip("no checkout here, only the installed package")
    return root
