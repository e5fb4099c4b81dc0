"""Finished settings of a study and answers to its doubts, one small file each: what was interrupted goes on where it stopped."""

from __future__ import annotations

import json
from dataclasses import asdict, fields
from hashlib import sha256
from pathlib import Path
from typing import Any

from ..whole_files import keep
from .setting import Outcome, Setting

ANSWER = "doubt"


class Store:
    """Outcomes of one study in a folder; None keeps them for this run only.

    study: what they belong to; others in the same folder are left alone, and a file that cannot be read counts as not there.
    """

    def __init__(self, folder: Path | None, study: str) -> None:
        self.folder, self.study = folder, study

    def get(self, setting: Setting) -> Outcome | None:
        """What was kept of a setting."""
        try:
            return _outcome(self._read(setting.name, setting.theta))
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def put(self, outcome: Outcome) -> None:
        """Keep it, whole or not at all."""
        self._write(asdict(outcome), outcome.setting.name, outcome.setting.theta)

    def answer(self, label: str) -> tuple[float, float] | None:
        """What was kept of the doubt about a weight."""
        try:
            kept = self._read(ANSWER, label)
            return float(kept["p"]), float(kept["limit"])
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def put_answer(self, label: str, told: tuple[float, float]) -> None:
        """Keep it, whole or not at all."""
        self._write({ANSWER: label, "p": told[0], "limit": told[1]}, ANSWER, label)

    def _read(self, *what: Any) -> Any:
        """Raises OSError where there is none, ValueError where it is torn."""
        if self.folder is None:
            raise FileNotFoundError
        return json.loads(self._path(self.folder, what).read_text(encoding="utf-8"))

    def _write(self, part: Any, *what: Any) -> None:
        if self.folder is not None:
            keep(self._path(self.folder, what), json.dumps(part).encode())

    def _path(self, folder: Path, what: tuple[Any, ...]) -> Path:
        key = sha256(json.dumps([self.study, *what]).encode()).hexdigest()[:24]
        return folder / f"{key}.json"


def _outcome(kept: dict[str, Any]) -> Outcome:
    names = {f.name for f in fields(Outcome)}
    if kept.keys() != names:
        raise KeyError("another version")
    setting = Setting(**{**kept["setting"], "theta": tuple(kept["setting"]["theta"])})
    pairs = {key: {name: tuple(pair) for name, pair in kept[key].items()} for key in ("parameters", "misfit", "force")}
    return Outcome(**{**kept, **pairs, "setting": setting})
