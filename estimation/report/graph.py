"""A drawing of a model as inline SVG: its components as boxes with what joins them, inputs from the left, places marked.

Layers by the distance from the inputs; within a layer boxes are ordered by the mean position of their neighbours (K. Sugiyama, S. Tagawa,
M. Toda, IEEE Trans. SMC 11, 1981), swept a few times to and fro. What is fixed to the ground gets a sign of its own, not a line across
the page.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

from backsight.models.model import GROUNDS

if TYPE_CHECKING:
    from backsight.models import Model

__all__ = ["Mark", "drawing"]

WIDTH, HEIGHT, ACROSS, DOWN = 126, 40, 64, 34  # of a box, and between boxes [px]
MARGIN, SWEEPS, LETTERS = 14, 6, 15
LEAST = 0.6  # of its size, to which a drawing shrinks before it scrolls
STYLES = {
    "guilty": ("var(--warn)", "2.6", "", "var(--warn)"),
    "rival": ("var(--warn)", "1.6", "5 3", "none"),
    "new": ("var(--accent)", "2", "", "var(--accent)"),
    "": ("var(--soft)", "1", "", "none"),
}


@dataclass(frozen=True)
class Mark:
    """What is said of a place: "guilty", "rival" or, of what a repair put in, "new", or "" for no frame; a line of text beneath its box."""

    kind: str = ""
    text: str = ""


@dataclass(frozen=True)
class _Graph:
    """Nodes with their second line, edges between them, and those that are grounded. "input:F", "sensor:x": signals."""

    nodes: Mapping[str, str]
    edges: tuple[tuple[str, str], ...]
    grounded: frozenset[str]

    @classmethod
    def of(cls, model: Model, marks: Mapping[str, Mark]) -> _Graph:
        """Of a model; what nothing is joined to, as a world that only has its gravity, is left out where nothing is said of it."""
        grounds = {name for name, c in model.components.items() if isinstance(c, tuple(GROUNDS.values()))}
        nodes = {f"input:{name}": "input" for name in model.inputs}
        nodes |= {name: type(c).__name__ for name, c in model.components.items() if name not in grounds}
        nodes |= {f"sensor:{name}": "output" for name in model.outputs}
        pairs = [(f"input:{name}", variable) for name, variable in model.inputs.items()]
        pairs += [*model.connections, *((output.variable, f"sensor:{name}") for name, output in model.measured.items())]
        ends = [(_owner(a), _owner(b)) for a, b in pairs]
        held = {a if b in grounds else b for a, b in ends if a in grounds or b in grounds}
        edges = dict.fromkeys(tuple(pair) for pair in ends if pair[0] != pair[1] and not grounds & set(pair))
        joined = {end for pair in edges for end in pair} | held | marks.keys()
        kept = {name: second for name, second in nodes.items() if name in joined} or nodes
        return cls(kept, tuple((a, b) for a, b in edges), frozenset(held - grounds))

    def neighbours(self, node: str) -> list[str]:
        return [b if a == node else a for a, b in self.edges if node in (a, b)]


def drawing(model: Model, marks: Mapping[str, Mark], *, caption: str) -> str:
    """The model's components as a figure; marks: place (a component, input:F, sensor:x) -> what is said of it."""
    graph = _Graph.of(model, marks)
    at = _placed(graph)
    width = max(x for x, _ in at.values()) + WIDTH + 2 * MARGIN
    height = max(y for _, y in at.values()) + HEIGHT + 20 + MARGIN
    lines = "".join(_line(at[a], at[b]) for a, b in graph.edges)
    boxes = "".join(_box(node, graph, at[node], marks.get(node, Mark())) for node in graph.nodes)
    label = escape(f"components of {model.name} and how they are joined", quote=True)
    return (
        f'<figure><div class=wide><svg viewBox="0 0 {width} {height}" width="{width}" height="{height}" role="img" aria-label="{label}" '
        f'style="max-width:100%;min-width:{LEAST * width:g}px;height:auto;font:12px system-ui,sans-serif">{lines}{boxes}</svg></div>'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def _placed(graph: _Graph) -> dict[str, tuple[float, float]]:
    """Upper left corners of the boxes."""
    layers = _ordered(graph, _layers(graph))
    tallest = max(len(layer) for layer in layers)
    return {
        node: (MARGIN + k * (WIDTH + ACROSS), MARGIN + (i + (tallest - len(layer)) / 2) * (HEIGHT + DOWN))
        for k, layer in enumerate(layers)
        for i, node in enumerate(layer)
    }


def _layers(graph: _Graph) -> list[list[str]]:
    """Nodes by their distance from the inputs; what no input reaches starts anew from its first component."""
    depth: dict[str, int] = {}
    front = [node for node in graph.nodes if node.startswith("input:")]
    rest = iter(graph.nodes)
    while len(depth) < len(graph.nodes):
        front = front or [next(node for node in rest if node not in depth)]
        depth |= dict.fromkeys(front, 0)
        while front:
            found = [n for node in front for n in graph.neighbours(node) if n not in depth]
            for node in front:
                depth |= {n: depth[node] + 1 for n in graph.neighbours(node) if n not in depth}
            front = list(dict.fromkeys(found))
    return [[node for node in graph.nodes if depth[node] == k] for k in range(max(depth.values()) + 1)]


def _ordered(graph: _Graph, layers: list[list[str]]) -> list[list[str]]:
    """The same layers, every node near its neighbours in those beside it."""
    for sweep in range(SWEEPS):
        place = {node: i - len(layer) / 2 for layer in layers for i, node in enumerate(layer)}
        order = range(len(layers)) if sweep % 2 == 0 else reversed(range(len(layers)))
        for k in order:
            beside = {node for j in (k - 1, k + 1) if 0 <= j < len(layers) for node in layers[j]}

            def mean(node: str, beside: set[str] = beside, place: Mapping[str, float] = place) -> float:
                near = [place[n] for n in graph.neighbours(node) if n in beside]
                return sum(near) / len(near) if near else place[node]

            layers[k] = sorted(layers[k], key=mean)
            place |= {node: i - len(layers[k]) / 2 for i, node in enumerate(layers[k])}
    return layers


def _line(a: tuple[float, float], b: tuple[float, float]) -> str:
    (left, right) = (a, b) if a[0] <= b[0] else (b, a)
    if a[0] == b[0]:  # in one layer: along its right side
        x, bend = a[0] + WIDTH, 26
        y1, y2 = a[1] + HEIGHT / 2, b[1] + HEIGHT / 2
        path = f"M{x:g} {y1:g}C{x + bend:g} {y1:g} {x + bend:g} {y2:g} {x:g} {y2:g}"
    else:
        x1, y1, x2, y2 = left[0] + WIDTH, left[1] + HEIGHT / 2, right[0], right[1] + HEIGHT / 2
        middle = (x1 + x2) / 2
        path = f"M{x1:g} {y1:g}C{middle:g} {y1:g} {middle:g} {y2:g} {x2:g} {y2:g}"
    return f'<path d="{path}" fill="none" stroke="var(--soft)" stroke-width="1.2"/>'


def _box(node: str, graph: _Graph, at: tuple[float, float], mark: Mark) -> str:
    (x, y), (stroke, thick, dashes, fill) = at, STYLES[mark.kind]
    signal = ":" in node
    name, second = (node.partition(":")[2], graph.nodes[node])
    name = name if signal else node
    dash = f' stroke-dasharray="{dashes}"' if dashes else ""
    middle = x + WIDTH / 2
    shape = f'x="{x:g}" y="{y:g}" width="{WIDTH}" height="{HEIGHT}" rx="{HEIGHT / 2 if signal else 4:g}"'
    parts = [
        f'<g><title>{escape(f"{node} ({second})")}</title><rect {shape} fill="var(--paper)"/>',
        f'<rect {shape} fill="{fill}" fill-opacity="0.14" stroke="{stroke}" stroke-width="{thick}"{dash}/>',
        _text(middle, y + 17, name, "600", "var(--ink)"),
        _text(middle, y + 31, second, "400", "var(--soft)"),
    ]
    if node in graph.grounded:
        parts.append(_ground(x + 16, y + HEIGHT))
    if mark.text:
        parts.append(_text(middle, y + HEIGHT + 15, mark.text, "400", STYLES[mark.kind][0], 30))
    return "".join(parts) + "</g>"


def _ground(x: float, y: float) -> str:
    ticks = "".join(f"M{x - 8 + 5 * k:g} {y + 8:g}l-4 5" for k in range(4))
    return f'<path d="M{x:g} {y:g}v8M{x - 10:g} {y + 8:g}h20{ticks}" fill="none" stroke="var(--soft)" stroke-width="1.1"/>'


def _text(x: float, y: float, text: str, weight: str, colour: str, most: int = LETTERS) -> str:
    shown = text if len(text) <= most else f"{text[: most - 1]}…"
    return f'<text x="{x:g}" y="{y:g}" text-anchor="middle" font-weight="{weight}" fill="{colour}">{escape(shown)}</text>'


def _owner(path: str) -> str:
    return path.partition(".")[0]
