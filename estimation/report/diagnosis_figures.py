"""The charts of a diagnosis: the residual force at a place over time and against what it hangs on, and prediction before and after."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .chart import COLOURS, Chart, Curve, Panel, columns, stack
from .decimation import envelope, spread
from .figures import BAND, DOTS, binned

if TYPE_CHECKING:
    from ..diagnosis import Diagnosis, HeldOut, Mismatch

__all__ = ["held_out_charts", "mismatch_chart", "mismatch_scatter", "window_chart"]

POINTS = 6000  # of a curve
WIDE = 2.0  # times the force: a band that is wider tells of one sample alone, and hides the rest
ABREAST = 4  # panels side by side, and outputs drawn
SIDES = (("model as declared", COLOURS["residual"]), ("with the repair", COLOURS["smoothed"]))


def mismatch_chart(chosen: Sequence[Mismatch], times: Sequence[float], *, label: str) -> Chart:
    """The residual force of one place over time, before the repair and, where there is a second one, after.

    times: at which the effect sets in, or ends [s].
    """
    curves = []
    for m, (name, colour) in zip(chosen[: len(SIDES)], SIDES, strict=False):
        rows, half = envelope(m.force, POINTS), BAND * np.where(np.isfinite(m.std), m.std, 0.0)
        told = float(np.median(half)) < WIDE * float(np.sqrt(np.nanmean(chosen[0].force ** 2)))
        curves.append(Curve(name=name, x=m.time[rows], y=m.force[rows], colour=colour, band=half[rows] if told else None))
    first = chosen[0]
    seen = first.force[np.isfinite(first.force)]
    ends = np.array([seen.min(), seen.max()]) if seen.size else np.zeros(2)
    for k, time in enumerate(times):
        curves.append(Curve(name="sets in, or ends", x=np.full(2, time), y=ends, colour=COLOURS["mean"], look="dashed", legend=k == 0))
    caption = f"What the model does not explain at {first.place}: the force that would have to act there"
    caption += ", with its 95 % band." if any(c.band is not None for c in curves) else "."
    if times:
        caption += " Dashed: when the effect sets in, or ends."
    return stack([Panel(curves=curves, y=f"force at {first.place}", y_unit=first.unit, height=230)], caption=caption, label=label)


def mismatch_scatter(chosen: Sequence[Mismatch], *, label: str) -> Chart | None:
    """The same force before the repair against position, velocity, load: its samples and their mean in bins."""
    first = chosen[0]
    panels, drawn = [], 0
    for name, (q, unit) in [pair for pair in first.against.items() if pair[0] != "time"][:ABREAST]:
        rows = spread(q.size, DOTS)
        drawn = rows.size
        centre, mean, deviation = binned(q, first.force)
        dots = Curve(name="samples", x=q[rows], y=first.force[rows], colour=COLOURS["residual"], look="dots")
        line = Curve(name="mean of a bin, with its std", x=centre, y=mean, colour=COLOURS["mean"], look="joined", error=deviation)
        panels.append(Panel(curves=[dots, line], y=f"force at {first.place}", y_unit=first.unit, x=name, x_unit=unit, height=280))
    if not panels:
        return None
    caption = f"The force at {first.place} that the model as declared does not explain, against what it may hang on. A step at zero speed "
    caption += (
        "is dry friction, a slope viscous friction, a slope over position a spring, a wave over position an eccentric wheel or cogging."
    )
    if first.force.size >= 2 * drawn:
        caption += f" One sample in {round(first.force.size / drawn)} is drawn; the means are taken over all."
    return columns(panels, caption=caption, label=label)


def window_chart(held: HeldOut) -> Chart | None:
    """Rms of the prediction error against how far ahead, of the outputs that gain most."""
    shown = [name for name in held.before if len(held.before[name].windows) > 1 and name in held.after]

    def gain(name: str) -> float:
        before, after = held.before[name].windows, held.after[name].windows
        return float(np.nanmean([np.log(after[s] / before[s]) for s in before if after.get(s, 0) > 0 and before[s] > 0] or [0.0]))

    panels = []
    for name in sorted(shown, key=gain)[:ABREAST]:
        curves = []
        sides = [(held.before[name], SIDES[0]), (held.after[name], SIDES[1])] if held.repaired else [(held.before[name], SIDES[0])]
        for errors, (word, colour) in sides:
            spans = np.array([0.0, *errors.windows])
            rms = np.array([np.nan, *errors.windows.values()])
            curves.append(Curve(name=word, x=spans, y=rms, colour=colour, look="joined"))
        panels.append(Panel(curves=curves, y=name, y_unit=held.before[name].unit, x="ahead", x_unit="s", height=150))
    if not panels:
        return None
    more = len(shown) - len(panels)
    caption = "Rms error of windows that are predicted, against how far they reach"
    those = f"the {len(panels)} outputs that gain most" if held.repaired else f"{len(panels)} outputs"
    caption += f"; {those} of {len(shown)}." if more > 0 else "."
    return stack(panels, caption=caption, label="windows")


def held_out_charts(found: Diagnosis) -> list[Chart]:
    """Whole held-out recordings as measured and as both models predict them, where smoothing has predicted them."""
    charts: list[Chart] = []
    for name, after in found.after.held_out.items():
        before = found.before.held_out.get(name)
        if before is None:
            continue
        outputs = [o for o in after.fit if o in before.estimates]
        panels, time = [], after.estimates["t_s"].to_numpy(float)
        for output in outputs[:ABREAST]:
            measured = after.estimates[f"{output}.measured"].to_numpy(float)
            rows = envelope(measured, POINTS)
            curves = [Curve(name="measured", x=time[rows], y=measured[rows], colour=COLOURS["measured"], look="wide")]
            for side, (word, colour) in zip((before, after), SIDES, strict=True):
                y, t = side.estimates[output].to_numpy(float), side.estimates["t_s"].to_numpy(float)
                rows = envelope(y, POINTS)
                curves.append(Curve(name=word, x=t[rows], y=y[rows], colour=colour))
            panels.append(Panel(curves=curves, y=output, y_unit=found.after.units.get(output, ""), height=200))
        if panels:
            caption = f"{name}, simulated as a whole from the start that its first {after.start_s:.3g} s tell, with the inputs alone."
            charts.append(stack(panels, caption=caption, label=f"held_out_{len(charts)}"))
    return charts
