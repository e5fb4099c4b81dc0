"""Which columns of a table of estimates are what."""

from dataclasses import dataclass

import pandas as pd

__all__ = ["Columns"]


@dataclass(frozen=True, kw_only=True)
class Columns:
    """The columns of a table of estimates by their role; a `.std` column belongs to the column before the dot."""

    outputs: tuple[str, ...]
    states: tuple[str, ...]
    residuals: tuple[str, ...]

    @classmethod
    def of(cls, frame: pd.DataFrame) -> "Columns":
        names = [str(c) for c in frame.columns]
        known = set(names)
        plain = [c for c in names if c not in {"t_s", "recording", "outcome"} and not c.endswith((".std", ".measured"))]
        outputs = tuple(c for c in plain if f"{c}.measured" in known)
        residuals = tuple(c for c in plain if c.startswith("residual."))
        return cls(outputs=outputs, residuals=residuals, states=tuple(c for c in plain if c not in outputs and c not in residuals))
