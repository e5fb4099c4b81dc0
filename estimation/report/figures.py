"""The charts of a report: outputs with their errors, states, inputs, residual forces, autocorrelation of the errors."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from ..recordings.gaps import LONGEST
from ..results import Profile
from ..validation.autocorrelation import autocorrelation
from ..validation.patterns import own_states
from .chart import COLOURS, Chart, Curve, Panel, columns, stack
from .decimation import envelope, spread
from .quantities import quantity

__all__ = ["DOTS", "input_chart", "output_chart", "profile_chart", "residual_chart", "residual_scatter", "state_chart", "whiteness_chart"]

DOTS = 1500  # an SVG circle each: more make a browser stutter, and no eye counts them
LEVEL = 1.9207  # half the 95 % quantile of chi-square with one degree of freedom
BAND = 1.96  # 95 % of a normal distribution


def _curve(
    frame: pd.DataFrame,
    name: str,
    column: str,
    colour: str,
    points: int,
    look: str = "line",
    *,
    band: bool = True,
    legend: bool = True,
) -> Curve:
    time, values = frame["t_s"].to_numpy(float), frame[column].to_numpy(float)
    std = frame[f"{column}.std"].to_numpy(float) if band and f"{column}.std" in frame else None
    banded = [std] if std is not None and np.isfinite(std).any() else []
    x, y, *stds = _drawn(time, values, *banded)
    rows = envelope(y, points)
    half = BAND * stds[0][rows] if stds else None
    return Curve(name=name, x=x[rows], y=y[rows], colour=colour, look=look, band=half, legend=legend)


def own_rows(values: np.ndarray) -> np.ndarray:
    """Row numbers of what is drawn of values (n,), NaN where missing: all of them, but of a sensor slower than the rows its own."""
    seen = np.flatnonzero(np.isfinite(values))
    return seen if len(seen) > 1 and np.median(np.diff(seen)) > 1 else np.arange(len(values))


def _drawn(time: np.ndarray, *values: np.ndarray) -> list[np.ndarray]:
    """Times and values (n,) of the own rows of the first, with a NaN that interrupts the line in every gap."""
    rows = own_rows(values[0])
    steps = np.diff(time[rows])
    gaps = np.flatnonzero(steps > LONGEST * np.median(steps)) if steps.size else np.empty(0, dtype=int)
    middles = (time[rows][gaps] + time[rows][gaps + 1]) / 2
    return [np.insert(time[rows], gaps + 1, middles), *(np.insert(v[rows], gaps + 1, np.nan) for v in values)]


def _lost(time: np.ndarray, seen: np.ndarray) -> int:
    """How many samples are not there between those seen (m,), row numbers, on their own clock; where there are no rows none is missed."""
    if seen.size < 2:
        return 0
    steps, own = np.diff(time), float(np.median(np.diff(time[seen])))
    closed = np.insert(np.cumsum(np.where(steps > LONGEST * max(own, float(np.median(steps))), own, steps)), 0, 0.0)
    return int(np.sum(np.maximum(np.round(np.diff(closed[seen]) / own) - 1.0, 0.0)))


def output_chart(
    frame: pd.DataFrame, output: str, unit: str, noise_std: float | None, *, points: int, group: str, model: str = "smoothed"
) -> Chart:
    """An output as measured and as the model has it, and beneath it their difference with +-2 std of the noise."""
    time = frame["t_s"].to_numpy(float)
    error = frame[f"{output}.measured"].to_numpy(float) - frame[output].to_numpy(float)
    missing = _lost(time, np.flatnonzero(np.isfinite(error)))
    at, error = _drawn(time, error)
    look = "dots" if at.size <= DOTS else _look(frame[f"{output}.measured"].to_numpy(float), error)
    rows = envelope(error, points)
    upper = [
        _curve(frame, "measured", f"{output}.measured", COLOURS["measured"], points, look, band=False),
        _curve(frame, model, output, COLOURS["smoothed"], points),
    ]
    lower = [Curve(name="error", x=at[rows], y=error[rows], colour=COLOURS["error"], legend=False)]
    caption = f"{output}, measured and {model}; beneath it the error, measured − {model}"
    if noise_std is not None and np.isfinite(noise_std):
        ends = np.array([time[0], time[-1]])
        for sign in (1.0, -1.0):
            level = np.full(2, sign * 2 * noise_std)
            lower.append(Curve(name="±2 std of the noise", x=ends, y=level, colour=COLOURS["noise"], look="dashed", legend=sign > 0))
        caption += f", with ±2 std of its noise ({quantity(noise_std, unit)} each)"
    caption += f". {missing} samples are missing." if missing else "."
    panels = [Panel(curves=upper, y=output, y_unit=unit, height=270), Panel(curves=lower, y="error", y_unit=unit, height=150)]
    return stack(panels, caption=caption, label=output, group=group)


def _look(measured: np.ndarray, error: np.ndarray) -> str:
    """A broad line shows behind a curve that it agrees with; noise that can be seen (from sample to sample) is drawn as it is."""
    steps = np.diff(error)
    steps = steps[np.isfinite(steps)]
    if not steps.size:
        return "wide"
    return "wide" if np.sqrt(np.mean(steps**2) / 2) < 0.005 * np.ptp(measured[np.isfinite(measured)]) else "thin"


def state_chart(frame: pd.DataFrame, states: Sequence[str], units: Mapping[str, str], *, points: int, group: str, model: str) -> Chart:
    """Every state over time with its band, one panel each."""
    height = 170 if len(states) <= 4 else 125
    panels = [
        Panel(curves=[_curve(frame, model, s, COLOURS["smoothed"], points, legend=False)], y=s, y_unit=units.get(s, ""), height=height)
        for s in states
    ]
    banded = any(f"{s}.std" in frame for s in states)
    return stack(panels, caption=f"States, {model}{' with their 95 % band' if banded else ''}.", label="states", group=group)


def input_chart(
    time: np.ndarray, inputs: Mapping[str, np.ndarray], units: Mapping[str, str], *, points: int, group: str, hold: str
) -> Chart:
    """What drove the plant, held or joined between samples as the model took it."""
    panels = []
    for name, values in inputs.items():
        rows = envelope(np.asarray(values, dtype=float), points)
        # Only where all rows are drawn does a step tell the truth.
        look = "step" if hold == "zero" and rows.size == time.size else "line"
        curve = Curve(name=name, x=time[rows], y=np.asarray(values)[rows], colour=COLOURS["input"], look=look, legend=False)
        panels.append(Panel(curves=[curve], y=name, y_unit=units.get(f"input.{name}", units.get(name, "")), height=140))
    how = "held from sample to sample" if hold == "zero" else "straight from sample to sample"
    return stack(panels, caption=f"Inputs as recorded, {how}.", label="inputs", group=group)


def residual_chart(frame: pd.DataFrame, place: str, unit: str, *, points: int, group: str) -> Chart:
    """The force that the model does not explain at one place, over time."""
    curve = _curve(frame, f"residual at {place}", f"residual.{place}", COLOURS["residual"], points)
    rms = float(np.sqrt(np.nanmean(frame[f"residual.{place}"].to_numpy(float) ** 2)))
    caption = f"Residual at {place}: what would have to act there beside the model's own forces, {quantity(rms, unit)} rms"
    caption += f"; its 95 % band is ±{quantity(float(np.nanmedian(curve.band)), unit)}." if curve.band is not None else "."
    return stack([Panel(curves=[curve], y=f"residual {place}", y_unit=unit, height=210)], caption=caption, label=place, group=group)


def residual_scatter(
    frame: pd.DataFrame, place: str, unit: str, states: tuple[str, ...], units: Mapping[str, str], *, points: int = DOTS
) -> Chart | None:
    """The residual of a place against the velocity and the position there, with the mean in 25 bins; None without any such state."""
    chosen, own = own_states(place, unit, states, units)
    chosen = chosen[:4]
    if not chosen:
        return None
    w = frame[f"residual.{place}"].to_numpy(float)
    rows = spread(w.size, min(points, DOTS))
    panels = []
    for state in chosen:
        q = frame[state].to_numpy(float)
        centre, mean, deviation = binned(q, w)
        dots = Curve(name="samples", x=q[rows], y=w[rows], colour=COLOURS["residual"], look="dots")
        line = Curve(name="mean of a bin, with its std", x=centre, y=mean, colour=COLOURS["mean"], look="joined", error=deviation)
        curves = [dots, line]
        panels.append(Panel(curves=curves, y=f"residual {place}", y_unit=unit, x=state, x_unit=units.get(state, ""), height=280))
    whose = "the states of that place" if own else f"states of other places, since {place} has none of its own"
    caption = f"Residual at {place} against {whose}."
    caption += " A step at zero speed is dry friction, a slope viscous friction, a slope over position a spring."
    if w.size > rows.size:
        caption += f" One sample in {round(w.size / rows.size)} is drawn; the means are taken over all."
    return columns(panels, caption=caption, label=f"{place}_states")


def profile_chart(profiles: Sequence[Profile]) -> Chart:
    """Cost above the optimum against every profiled parameter, with the 95 % level and the parabola that value and std stand for."""
    panels: list[Panel] = []
    for p in profiles:
        ends = p.values[[0, -1]]
        curves = [Curve(name="profile", x=p.values, y=p.cost, colour=COLOURS["smoothed"], look="joined", legend=not panels)]
        if p.std is not None:
            fine = np.linspace(ends[0], ends[1], 60)
            parabola = ((fine - p.estimate) / p.std) ** 2 / 2
            name = "what ± std supposes"
            shown = parabola <= 1.5 * LEVEL
            curves.append(Curve(name=name, x=fine[shown], y=parabola[shown], colour=COLOURS["mean"], look="thin", legend=not panels))
        curves.append(Curve(name="95 % level", x=ends, y=np.full(2, LEVEL), colour=COLOURS["noise"], look="dashed", legend=not panels))
        panels.append(Panel(curves=curves, y="cost above the optimum", y_unit="", x=p.name, x_unit=p.unit, height=260))
    caption = "Profile likelihood: the least cost with a parameter held, all others free, above that of the optimum."
    return columns(panels, caption=f"{caption} It is below {LEVEL:.2f} within the 95 % interval.", label="profiles")


def binned(q: np.ndarray, w: np.ndarray, bins: int = 25) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centre, mean and standard deviation of w in equal bins of q that hold at least 8 samples and 0.2 % of them.

    Zero is an edge when q changes sign: a bin across it would mix both directions and hide the step of dry friction.
    """
    good = np.isfinite(q) & np.isfinite(w)
    q, w = q[good], w[good]
    if q.size < 8 or not np.ptp(q) > 0:
        empty = np.empty(0)
        return empty, empty, empty
    width = np.ptp(q) / bins
    number = np.floor(q / width).astype(int) if q.min() < 0 < q.max() else np.minimum(((q - q.min()) / width).astype(int), bins - 1)
    number -= number.min()
    count = np.bincount(number)
    sums = [np.bincount(number, weights=values) for values in (q, w, w * w)]
    kept = count >= max(8, 0.002 * q.size)
    centre, mean, square = (total[kept] / count[kept] for total in sums)
    return centre, mean, np.sqrt(np.maximum(square - mean * mean, 0.0))


def whiteness_chart(frame: pd.DataFrame, outputs: Sequence[str], *, label: str) -> Chart | None:
    """Autocorrelation of every output's error over 1 to at most 60 lags, with the 95 % bounds of white noise."""
    panels, time = [], frame["t_s"].to_numpy(float)
    for output in outputs:
        error = frame[f"{output}.measured"].to_numpy(float) - frame[output].to_numpy(float)
        rows = own_rows(error)
        error, n = error[rows], int(np.isfinite(error).sum())
        if n < 8:
            continue
        lags = np.arange(1, min(60, n // 4) + 1)
        r = autocorrelation(error, int(lags[-1]))[1:]
        bound, ends = 1.96 / np.sqrt(n), np.array([0.5, lags[-1] + 0.5])
        step = quantity(float(np.median(np.diff(time[rows]))), "s")
        curves = [Curve(name=f"error of {output}", x=lags, y=r, colour=COLOURS["error"], look="bars", legend=False)]
        for sign in (1.0, -1.0):
            level = np.full(2, sign * bound)
            curves.append(
                Curve(name="95 % bounds of white noise", x=ends, y=level, colour=COLOURS["noise"], look="dashed", legend=sign > 0)
            )
        panels.append(Panel(curves=curves, y=f"autocorrelation {output}", y_unit="", x=f"lag of {step}", x_unit="samples", height=170))
    if not panels:
        return None
    caption = (
        "Autocorrelation of measured − smoothed. A fit bends towards its samples, so some bars go beyond the dashed"
        " lines even where the model is right; whether the prediction errors are white is in the table."
    )
    return stack(panels, caption=caption, label=label)
