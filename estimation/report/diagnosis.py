"""The page of a diagnosis: the verdict, what is missing and where, the proof, and what could not have been seen."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from ..diagnosis.words import sentence
from .document import document, save
from .tables import parameter_table

if TYPE_CHECKING:
    from ..diagnosis import Diagnosis

__all__ = ["write_diagnosis_report"]


def write_diagnosis_report(found: Diagnosis, path: str | Path) -> None:
    """Write the page of a diagnosis to `path`: one HTML file that opens without a network."""
    page = document(
        title=f"{found.after.model}: what the model leaves out",
        sub="",
        lead=f"<p class=answer>{escape(sentence(found))}</p>",
        sections=[("parameters", "Parameters with the findings in the model", parameter_table(found.after))],
    )
    save(page, path)
