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
    """The project's root, for tests that look at its files."""
    return Path(__file__).resolve().parent.parent


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """They are not run where only the installed package is at hand."""
    for item in items:
        if "checkout" in getattr(item, "fixturenames", ()):
            item.add_marker("checkout")
