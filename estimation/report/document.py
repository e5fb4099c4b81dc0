"""The frame of a page: one HTML file with everything in it, and a policy that lets the browser load nothing from elsewhere."""

import json
import os
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path

from .chart import Chart
from .script import SCRIPT
from .style import CSS

__all__ = ["POINTS", "document", "drawn", "points_per_curve", "save"]

POINTS = 210_000  # of all curves of a page together: 2.3 MB beside the 4.8 MB of the drawing library
LARGEST, SMALLEST = 12_000, 200  # points of one curve
_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"


def points_per_curve(curves: int) -> int:
    """How many points each of so many curves may have for the page to stay below 8 MB and quick to draw."""
    return max(SMALLEST, min(LARGEST, POINTS // max(curves, 1)))


def drawn(chart: Chart | None) -> str:
    """The chart as a figure with its caption: plain data in the page, drawn by the page's script."""
    if chart is None:
        return ""
    # "<" as an escape: no text inside the data can end the script element.
    data = json.dumps({"data": chart.data, "layout": chart.layout}, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    group = f' data-group="{escape(chart.group)}"' if chart.group else ""
    return (
        f'<figure data-chart="{escape(chart.label)}"{group}><div class=plot style="height:{chart.height}px"></div>'
        f'<figcaption>{escape(chart.caption)}</figcaption><script type="application/json">{data}</script></figure>'
    )


def document(*, title: str, sub: str, lead: str, sections: Sequence[tuple[str, str, str]]) -> str:
    """The page: title and line beneath it (plain text), lead (HTML), sections as (anchor, heading in plain text, HTML)."""
    kept = [(anchor, heading, body) for anchor, heading, body in sections if body]
    contents = "".join(f'<a href="#{escape(anchor)}">{escape(heading)}</a>' for anchor, heading, _ in kept)
    bodies = "".join(f'<section id="{escape(anchor)}"><h2>{escape(heading)}</h2>\n{body}</section>\n' for anchor, heading, body in kept)
    library = (files("plotly") / "package_data" / "plotly.min.js").read_text(encoding="utf-8").replace("</script", "<\\/script")
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{_POLICY}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{escape(title)}</title>
<style>{CSS}</style>
</head>
<body><main>
<header><h1>{escape(title)}</h1><p class=sub>{escape(sub)}</p></header>
{lead}
<nav>{contents}</nav>
<noscript><p>The charts of this page are drawn by its own script; with scripts switched off only words and tables are shown.</p></noscript>
{bodies}</main>
<script>{library}</script>
<script>{SCRIPT}</script>
</body>
</html>
"""


def save(page: str, path: str | Path) -> None:
    """Write the page in one stroke: a reader never sees half of it, and an interrupted run leaves the old one."""
    path = Path(path)
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        draft.write_text(page, encoding="utf-8")
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)
