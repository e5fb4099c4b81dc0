"""Recordings as files that are bundled: packed so that equal rows are equal bytes, and the program that writes them."""

import argparse
import gzip
import io
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

__all__ = ["main", "packed", "written"]


def packed(lines: Iterable[str], level: int = 9) -> bytes:
    """Lines of a CSV file, gzipped with neither a name nor a date."""
    buffer = io.BytesIO()
    with gzip.GzipFile(filename="", mode="wb", compresslevel=level, fileobj=buffer, mtime=0) as file:
        file.write(("\n".join(lines) + "\n").encode("ascii"))
    return buffer.getvalue()


def written(folder: Path, contents: Mapping[str, bytes]) -> list[Path]:
    """Write files into a folder; their paths."""
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    return [folder / name for name in contents]


def main(name: str, about: str, seed: int, write: Callable[[Path, int], object]) -> None:
    """The command line of a module of that name that writes bundled files; about: its docstring, seed: theirs."""
    parser = argparse.ArgumentParser(prog=f"python -m backsight.data.generators.{name}", description=about.splitlines()[0])
    parser.add_argument("--seed", type=int, default=seed, help="seed of every random number (default: that of the bundled files)")
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[1], help="folder to write to (default: the bundled files' own)")
    arguments = parser.parse_args()
    write(arguments.out, arguments.seed)
