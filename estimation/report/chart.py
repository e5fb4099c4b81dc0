"""One drawing: panels of curves as the plain data that plotly.js draws, colours and sizes alike on every chart of the page.

Curves carry SI values and a unit; the panel picks the prefix. Grid, text and zero lines take their colours from the page when it is
drawn (light, dark, print), so a chart holds only the mid tones that read on both.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

import numpy as np

from .decimation import packed, packed_time, unpacked
from .quantities import scaled

__all__ = ["COLOURS", "Chart", "Curve", "Panel", "columns", "heat_map", "stack"]

COLOURS = {
    "measured": "#8f8f8f",
    "smoothed": "#2f7fc1",
    "error": "#7a6bb0",
    "input": "#3a9a78",
    "residual": "#d2622a",
    "mean": "#b0307a",
    "noise": "#8f8f8f",
}
Trace = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Values against x (SI). `band`: half width of a shaded 95 % band; `look`: line, wide, thin, step, dots, bars or dashed."""

    name: str
    x: np.ndarray
    y: np.ndarray
    colour: str
    look: str = "line"
    band: np.ndarray | None = None
    legend: bool = True
    error: np.ndarray | None = None


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Curves that share a pair of axes; `height` in px; `x` and `x_unit` are used where panels stand side by side."""

    curves: Sequence[Curve]
    y: str
    y_unit: str
    height: int = 260
    x: str = "time"
    x_unit: str = "s"


@dataclass(frozen=True, kw_only=True)
class Chart:
    """What plotly.js draws (data, layout), the height [px], the sentence under it, and the group whose time axes zoom together."""

    data: list[Trace]
    layout: dict[str, Any]
    height: int
    caption: str
    group: str = ""
    label: str = field(default="chart")

    def figure(self) -> Any:
        """The same as a figure of plotly, to be shown, changed or written to a file."""
        from plotly.graph_objects import Figure

        return Figure(data=unpacked(self.data), layout=self.layout)


def stack(panels: Sequence[Panel], *, caption: str, label: str, group: str = "", x_range: tuple[float, float] | None = None) -> Chart:
    """Panels one above the other over one common axis."""
    gap, heights = 26, [p.height for p in panels]
    total = sum(heights) + gap * (len(panels) - 1)
    x_factor, x_title = _axis(panels[-1].x, panels[-1].x_unit, [c.x for p in panels for c in p.curves])
    data: list[Trace] = []
    named: set[str] = set()
    layout = _layout(total)
    top = float(total)
    for k, panel in enumerate(panels, start=1):
        suffix = str(k) if k > 1 else ""
        y_factor, y_title = _axis(panel.y, panel.y_unit, [c.y for c in panel.curves])
        layout[f"yaxis{suffix}"] = {"title": _title(y_title), "domain": [max(top - panel.height, 0.0) / total, top / total], **_AXIS}
        limits = _limits(panel)
        if limits is not None:
            layout[f"yaxis{suffix}"]["range"] = [limits[0] * y_factor, limits[1] * y_factor]
        top -= panel.height + gap
        for curve in panel.curves:
            show = curve.legend and curve.name not in named
            named.add(curve.name)
            data += _traces(curve, x_factor, y_factor, "x", f"y{suffix}", show=show)
    layout["xaxis"] = {"title": _title(x_title), "anchor": f"y{len(panels) if len(panels) > 1 else ''}", **_AXIS}
    if x_range is not None:
        layout["xaxis"]["range"] = [x_range[0] * x_factor, x_range[1] * x_factor]
    layout["hovermode"] = "x unified" if x_title.startswith("time") else "closest"
    return Chart(data=data, layout=layout, height=total + _MARGIN["t"] + _MARGIN["b"], caption=caption, group=group, label=label)


def columns(panels: Sequence[Panel], *, caption: str, label: str) -> Chart:
    """Panels side by side over one common vertical axis, each with its own horizontal one."""
    height, share, gap = panels[0].height, 1.0 / len(panels), 0.03
    y_factor, y_title = _axis(panels[0].y, panels[0].y_unit, [c.y for p in panels for c in p.curves])
    layout = _layout(height)
    layout["yaxis"] = {"title": _title(y_title), **_AXIS}
    data: list[Trace] = []
    named: set[str] = set()
    for k, panel in enumerate(panels, start=1):
        suffix = str(k) if k > 1 else ""
        x_factor, x_title = _axis(panel.x, panel.x_unit, [c.x for c in panel.curves])
        left, right = (k - 1) * share + (gap / 2 if k > 1 else 0.0), k * share - (gap / 2 if k < len(panels) else 0.0)
        layout[f"xaxis{suffix}"] = {"title": _title(x_title), "domain": [left, right], "anchor": "y", **_AXIS, "nticks": 6, "tickangle": 0}
        for curve in panel.curves:
            data += _traces(curve, x_factor, y_factor, f"x{suffix}", "y", show=curve.legend and curve.name not in named)
            named.add(curve.name)
    layout["hovermode"] = "closest"
    return Chart(data=data, layout=layout, height=height + _MARGIN["t"] + _MARGIN["b"], caption=caption, label=label)


def heat_map(
    values: np.ndarray, columns: Sequence[str], rows: Sequence[str], *, caption: str, label: str, most: float, numbers: bool = False
) -> Chart:
    """Values (rows, columns) as colours from -most, blue, by zero, pale, to most, red; NaN is left empty.

    numbers: they stand in their fields too, also those beyond the colours.
    """
    height = 24 * len(rows) + 40
    shown = np.clip(values, -most, most)
    trace: Trace = {
        "type": "heatmap",
        "z": [[None if not np.isfinite(v) else round(float(v), 3) for v in row] for row in shown],
        "x": [escape(c) for c in columns],
        "y": [escape(r) for r in rows],
        "zmin": -most,
        "zmax": most,
        "colorscale": [[0.0, "#2f7fc1"], [0.5, "#e9e6df"], [1.0, "#d2622a"]],
        "xgap": 1,
        "ygap": 1,
        "hovertemplate": "%{y}, %{x}: %{z}<extra></extra>",
        "colorbar": {"thickness": 12, "outlinewidth": 0},
    }
    if numbers:
        trace["text"] = [[f"{v:.3g}" if np.isfinite(v) else "" for v in row] for row in values]
        trace |= {"texttemplate": "%{text}", "textfont": {"color": "#222"}, "hovertemplate": "%{y}, %{x}: %{text}<extra></extra>"}
    layout = _layout(height)
    layout["margin"] = {**_MARGIN, "l": 150, "b": 150}
    layout["height"] = height + _MARGIN["t"] + 150
    layout["xaxis"] = {"tickangle": -60, "showgrid": False, "type": "category", "tickfont": {"size": 10}}
    layout["yaxis"] = {"autorange": "reversed", "showgrid": False, "type": "category", "automargin": True}
    return Chart(data=[trace], layout=layout, height=layout["height"], caption=caption, label=label)


_MARGIN = {"l": 74, "r": 14, "t": 34, "b": 48}
_GREY = "rgba(140,140,140,0.25)"
_AXIS: dict[str, Any] = {
    "automargin": False,
    "gridcolor": _GREY,
    "zerolinecolor": "rgba(140,140,140,0.6)",
    "zerolinewidth": 1,
    "ticks": "outside",
    "ticklen": 3,
    "tickcolor": _GREY,
    "hoverformat": ".6~g",
    "exponentformat": "power",
    "nticks": 9,
}


def _layout(height: int) -> dict[str, Any]:
    return {
        "height": height + _MARGIN["t"] + _MARGIN["b"],
        "margin": dict(_MARGIN),
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {"family": "system-ui, -apple-system, 'Segoe UI', 'Helvetica Neue', Arial, sans-serif", "size": 12, "color": "#777"},
        "legend": {"orientation": "h", "x": 0, "xanchor": "left", "y": 1, "yanchor": "bottom", "font": {"size": 12}},
        "dragmode": "zoom",
        "bargap": 0.25,
    }


def _title(text: str) -> dict[str, Any]:
    return {"text": escape(text), "standoff": 8, "font": {"size": 12}}


def _axis(name: str, unit: str, values: Sequence[np.ndarray]) -> tuple[float, str]:
    """Factor for the values and the axis title with its unit, always in brackets: "x [mm]", "autocorrelation [1]"."""
    largest = max((float(np.nanmax(np.abs(v))) for v in values if np.isfinite(v).any()), default=0.0)
    factor, shown = scaled(largest, unit)
    return factor, f"{name} [{shown or '1'}]"


def _limits(panel: Panel) -> tuple[float, float] | None:
    """The vertical range of a panel with a band: the curves, and the band unless it would make them small.

    Left out are the widest 2 % of the band (an unknown velocity at the very start) and what is wider than the curve is high.
    """
    if all(c.band is None for c in panel.curves):
        return None
    ends = []
    for c in panel.curves:
        half = c.band if c.band is not None and np.isfinite(c.band).any() else np.zeros_like(c.y)
        height = float(np.nanmax(c.y) - np.nanmin(c.y)) if np.isfinite(c.y).any() else 0.0
        largest = float(np.nanquantile(half, 0.98))
        half = np.minimum(np.where(np.isfinite(half), half, 0.0), min(largest, height) if height > 0 else largest)
        if np.isfinite(c.y).any():
            ends += [float(np.nanmin(c.y - half)), float(np.nanmax(c.y + half))]
    if not ends or not max(ends) > min(ends):
        return None
    margin = 0.06 * (max(ends) - min(ends))
    return min(ends) - margin, max(ends) + margin


def _traces(curve: Curve, x_factor: float, y_factor: float, x_axis: str, y_axis: str, *, show: bool) -> list[Trace]:
    x = packed_time(curve.x * x_factor)
    y = curve.y * y_factor
    name = escape(curve.name)
    base: Trace = {"type": "scatter", "x": x, "xaxis": x_axis, "yaxis": y_axis, "name": name, "legendgroup": name, "showlegend": show}
    line = {"color": curve.colour, "width": 1.4}
    looks: dict[str, Trace] = {
        "line": {"mode": "lines", "line": line},
        "wide": {"mode": "lines", "line": {"color": curve.colour, "width": 4.5}, "opacity": 0.55},
        "thin": {"mode": "lines", "line": {"color": curve.colour, "width": 1}, "opacity": 0.8},
        "step": {"mode": "lines", "line": {**line, "shape": "hv"}},
        "dashed": {"mode": "lines", "line": {"color": curve.colour, "width": 1.2, "dash": "dash"}, "hoverinfo": "skip"},
        "dots": {"mode": "markers", "marker": {"color": curve.colour, "size": 3.5, "opacity": 0.5, "line": {"width": 0}}},
        "joined": {"mode": "lines+markers", "line": {**line, "width": 1.8}, "marker": {"color": curve.colour, "size": 6}},
        "bars": {"type": "bar", "marker": {"color": curve.colour, "line": {"width": 0}}},
    }
    main: Trace = {**base, "y": packed(y), **looks[curve.look]}
    if curve.error is not None:
        main["error_y"] = {"type": "data", "array": packed(curve.error * y_factor), "thickness": 1, "width": 2, "color": curve.colour}
    if curve.band is None:
        return [main]
    around = _outline(curve.x * x_factor, y, np.where(np.isfinite(curve.band), curve.band, 0.0) * y_factor)
    band: Trace = {**base, "x": packed_time(around[0], of=curve.x * x_factor), "y": packed(around[1])}
    band |= {"mode": "lines", "line": {"width": 0}, "showlegend": False, "hoverinfo": "skip", "fill": "toself"}
    return [{**band, "fillcolor": _faint(curve.colour)}, {**main, "name": f"{name}, with its 95 % band"}]


def _outline(x: np.ndarray, y: np.ndarray, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """There and back around y +- half, between its interruptions; a NaN of y ends a piece."""
    parts_x, parts_y = list[np.ndarray](), list[np.ndarray]()
    finite = np.flatnonzero(np.isfinite(y))
    for rows in np.split(finite, np.flatnonzero(np.diff(finite) > 1) + 1) if finite.size else ():
        parts_x += [x[rows], x[rows][::-1], x[rows][:1]]
        parts_y += [(y - half)[rows], (y + half)[rows][::-1], np.array([np.nan])]
    return (np.concatenate(parts_x), np.concatenate(parts_y)) if parts_x else (np.empty(0), np.empty(0))


def _faint(colour: str) -> str:
    r, g, b = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({r},{g},{b},0.22)"
