"""The folder of results: nothing is written until everything is there, and old results stay until then."""

from __future__ import annotations

import json
import math
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from backsight.models.errors import InputError

from ..whole_files import permit
from .interrupt import check, held, written

if TYPE_CHECKING:
    import pandas as pd

REPAIRED = "repaired_model.py"
FILES = ("result.json", "estimates.csv", "report.html", REPAIRED)


@contextmanager
def results_folder(out: Path) -> Iterator[Path]:
    """A folder to write into, which becomes `out` when the block ends without an exception and vanishes otherwise.

    It is made at once, so that an `out` that cannot be written is an InputError before the work is done. Results that
    `out` already holds are exchanged at the end, all or none, by renames that no interrupt divides; other files in it are left alone.
    """
    base = _existing(out)
    try:
        with held():
            partial = Path(tempfile.mkdtemp(prefix=".backsight-", dir=base))
    except OSError as error:
        raise InputError(f"--out {out}: {base} cannot be written to ({error.strerror or error}); choose another folder") from None
    try:
        yield partial
        with held():
            check()
            try:
                _move(partial, out, base)
                written(out)
            except OSError as error:
                raise InputError(f"--out {out}: the results cannot be written ({error.strerror or error})") from error
    finally:
        try:
            _vanish(partial)
        except KeyboardInterrupt:  # just before it is held
            _vanish(partial)
            raise


def _vanish(folder: Path) -> None:
    with held():
        shutil.rmtree(folder, ignore_errors=True)


def write_result(result: Mapping[str, Any], path: Path) -> None:
    """result.json: two spaces of indent, null for what is not a finite number."""
    path.write_text(json_text(result), encoding="utf-8")


def json_text(result: Mapping[str, Any]) -> str:
    """The same as text."""
    return json.dumps(_plain(result), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def write_estimates(estimates: Mapping[str, pd.DataFrame], path: Path) -> None:
    """estimates.csv: the tables below one another; a column `recording` comes first where there are several."""
    import pandas as pd

    frames = list(estimates.values())
    if len(frames) > 1:
        named = [frame.assign(recording=name) for name, frame in estimates.items()]
        joined = pd.concat(named, ignore_index=True)
        joined = joined[["recording", *(c for c in joined.columns if c != "recording")]]
    else:
        joined = frames[0]
    joined.to_csv(path, index=False)


def _existing(out: Path) -> Path:
    """The folder itself where it exists, else the nearest one above it. Raises InputError where a file is in the way."""
    for folder in (out, *out.parents):
        try:
            if folder.is_dir():
                return folder
            if folder.exists() or folder.is_symlink():
                where = "it" if folder == out else str(folder)
                raise InputError(f"--out {out}: {where} is a file, not a folder; choose another name")
        except OSError as error:
            raise InputError(f"--out {out}: {error.strerror or error}; choose another folder") from None
    raise InputError(f"--out {out}: no such place; choose another folder")


def _move(partial: Path, out: Path, base: Path) -> None:
    if base != out:
        out.parent.mkdir(parents=True, exist_ok=True)
        permit(partial, 0o777)
        try:
            partial.rename(out)
            return
        except OSError:
            if not out.is_dir():
                raise
        # another run has made it meanwhile: what it wrote is exchanged as old results are
    fresh = {path.name for path in partial.iterdir()}
    former = partial / ".former"
    former.mkdir()
    moves = [(out / name, former / name) for name in sorted(fresh | set(FILES)) if (out / name).exists()]
    moves += [(partial / name, out / name) for name in sorted(fresh)]
    for k, (old, new) in enumerate(moves):
        try:
            old.rename(new)
        except OSError:
            for there, back in reversed(moves[:k]):
                back.rename(there)
            raise


def _plain(value: Any) -> Any:
    """Nothing but dicts, lists, text, numbers, true, false and null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_plain(inner) for inner in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int, str)) else str(value)
