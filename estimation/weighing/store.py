"""Finished settings of a study, one small file each: what was interrupted goes on where it stopped."""

from __future__ import annotations

import json
from dataclasses import asdict, fields
from hashlib import sha256
from pathlib import Path
from typing import Any

from ..whole_files import written_whole
from .setting import Outcome, Setting


class Store:
    """Outcomes of one study in a folder; None keeps them for this run only.

    study: what they belong to; others in the same folder are left alone, and a file that cannot be read counts as not there.
    """

    def __init__(self, folder: Path | None, study: str) -> None:
        self.folder, self.study = folder, study

    def get(self, setting: Setting) -> Outcome | None:
        """What was kept of a setting."""
        try:
            return _outcome(json.loads(self._path(self.folder, setting).read_text(encoding="utf-8"))) if self.folder else None
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def put(self, outcome: Outcome) -> None:
        """Keep it, whole or not at all."""
        if self.folder is None:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        with written_whole(self._path(self.folder, outcome.setting)) as file:
            file.write(json.dumps(asdict(outcome)).encode())

    def _path(self, folder: Path, setting: Setting) -> Path:
        key = sha256(json.dumps([self.study, setting.name, setting.theta]).encode()).hexdigest()[:24]
        return folder / f"{key}.json"


def _outcome(kept: dict[str, Any]) -> Outcome:
    names = {f.name for f in fields(Outcome)}
    if kept.keys() != names:
        raise KeyError("another version")
    setting = Setting(**{**kept["setting"], "theta": tuple(kept["setting"]["theta"])})
    pairs = {key: {name: tuple(pair) for name, pair in kept[key].items()} for key in ("parameters", "misfit", "force")}
    return Outcome(**{**kept, **pairs, "setting": setting})
