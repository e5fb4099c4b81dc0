"""Whether recordings hold anything from which a parameter could be learned."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from backsight.models.errors import InputError

from ..wording import number
from .recording import Recording

Array = np.ndarray[tuple[int], np.dtype[np.float64]]


def check_excitation(recordings: Sequence[Recording], *, label: str) -> None:
    """Raise InputError when no input ever changes and no output moves beyond its noise, in any of the recordings.

    A constant input alone will do where the plant still moves: a motor that starts, a pendulum let go.
    """
    if any(np.ptp(u) > 0.0 for recording in recordings for u in recording.inputs.values()):
        return
    if any(_moves(y) for recording in recordings for y in recording.outputs.values()):
        return
    seen = ", ".join(f"{name} = {number(u[0])} throughout {r.name}" for r in recordings for name, u in r.inputs.items())
    raise InputError(
        f"{label}: every input is constant ({seen or 'there is no input'}) and no output moves, so no parameter can be identified; "
        "use a recording with excitation, or fix the parameters"
    )


def _moves(y: Array) -> bool:
    """Whether a signal varies by more than white noise would: y_k = n_k has std(y) = std(second differences)/sqrt(6)."""
    y = y[np.isfinite(y)]
    if y.size < 4:
        return bool(np.ptp(y) > 0.0)
    noise = float(np.std(np.diff(y, 2))) / np.sqrt(6.0)
    return bool(np.std(y) > 3.0 * noise + 1e-12 * np.max(np.abs(y)))
