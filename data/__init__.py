"""Bundled recordings, their cards and the studies that go with them; `generators` holds the programs that wrote them."""

from importlib.resources import files
from pathlib import Path

__all__ = ["path", "studies"]


def _folder() -> Path:
    return Path(str(files("backsight.data")))


def path(name: str) -> Path:
    """Where the bundled file `name` (for example "axis_fit.csv.gz") lies on this machine.

    Raises FileNotFoundError, which lists what is bundled, when there is no such file.
    """
    found = _folder() / name
    if Path(name).name != name or not found.is_file():
        bundled = ", ".join(sorted(p.name for p in _folder().iterdir() if p.is_file() and p.suffix in {".gz", ".csv", ".toml", ".md"}))
        raise FileNotFoundError(f"no bundled file {name!r}: choose one of {bundled}")
    return found


def studies() -> dict[str, Path]:
    """The bundled study files by name, without their suffix: {"demo": .../demo.toml}."""
    return {p.stem: p for p in sorted(_folder().glob("*.toml"))}
