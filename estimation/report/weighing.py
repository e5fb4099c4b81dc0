"""The page of a weighting study: what is recommended and why, the trade-off, what every weight does, and every setting that was solved."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..weighing.recommendation import LIKELIHOOD, likeliest
from ..wording import chance
from .chart import COLOURS, Chart, Curve, Panel, columns, heat_map, stack
from .document import document, drawn, save
from .quantities import NOTHING, number, pretty, quantity, scaled, uncertain
from .tables import facts, fit_table, parameter_table, prediction_table, table
from .weight_grid import grid_chart

if TYPE_CHECKING:
    from ..weighing import Outcome, Weighing

__all__ = ["balance_chart", "parameter_chart", "trade_off_chart", "write_weighing_report"]

BAND = 1.96  # 95 % of a normal distribution
DECADE = 1.0  # of a balance: colours end there
MANY = 30  # chosen settings, beyond which they have their own figure only
Along = Literal["trade-off", "stage", "chosen"]
TURNED: dict[Along, str] = {"trade-off": "all W", "stage": "what holds the parameters"}
PATHS: dict[Along, str] = {
    "trade-off": "Parameters while all W are turned together, with their 95 % bands.",
    "stage": (
        "Parameters while all that holds them, drift and priors, is tightened by stages, from weak on the right to tight on the left, each "
        "solved from where the one before arrived; with their 95 % bands."
    ),
    "chosen": "Parameters while the chosen weight is turned, with their 95 % bands.",
}


def write_weighing_report(found: Weighing, path: str | Path) -> None:
    """Write the page of a study to `path`: one HTML file that opens without a network."""
    result = found.recommended
    notes = "".join(f"<li>{escape(note)}</li>" for note in found.notes)
    sections = [
        ("found", "What the study found", f"<ul class=notes>{notes}</ul>"),
        ("weights", "Weights", _weights(found)),
        ("trade-off", "Residual forces against readings", drawn(trade_off_chart(found)) + drawn(parameter_chart(found))),
        ("stages", "Parameters held ever more tightly", drawn(parameter_chart(found, "stage"))),
        ("chosen", "Chosen weights", drawn(parameter_chart(found, "chosen")) + drawn(grid_chart(found))),
        ("balance", "Residual balance", drawn(balance_chart(found))),
        ("influence", "What every weight does to the parameters", _moves(found)),
        ("parameters", "Parameters with the recommended weights", parameter_table(result)),
        ("fit", "Fit with the recommended weights", fit_table(result.fit, result) + _predictions(found)),
        ("settings", "All settings", _settings(found)),
        ("solver", "Solver", facts([("settings", str(len(found.outcomes))), ("last solve", result.solver.status)])),
    ]
    page = document(
        title=f"{result.model}: weighting matrices",
        sub="What the data say of W and V, and what hangs on them",
        lead=f"<p class=answer>{escape(found.why)}</p>",
        sections=sections,
    )
    save(page, path)


def trade_off_chart(found: Weighing) -> Chart | None:
    """The L-curve: size of the residual forces against the misfit of the readings while all W are turned together."""
    path = _path(found)
    if len(path) < 2:
        return None
    points = [("all W turned together", path, "smoothed"), ("recommended", [found.best], "residual")]
    through = likeliest(found.outcomes)
    if through is not None and through is not found.best:
        points.append((LIKELIHOOD, [through], "input"))
    curves = []
    for name, outcomes, colour in points:
        x, y = np.array([_size(found, o) for o in outcomes]).T
        curves.append(Curve(name=name, x=x, y=y, colour=COLOURS[colour], look="joined"))
    panel = Panel(
        curves=curves, y="log10 residual force / recommended W", y_unit="", x="log10 misfit / recommended V", x_unit="", height=300
    )
    caption = (
        "L-curve. To the right the residual forces are held down and the readings pay for it; to the left the forces follow the readings' "
        "noise. The curve leads through the weights of greatest likelihood. Both are means over places and outputs, each over what its "
        "recommended weight says."
    )
    return columns([panel], caption=caption, label="trade_off")


def parameter_chart(found: Weighing, group: Along = "trade-off") -> Chart | None:
    """Every estimated parameter with its 95 % band along a path of settings; None where there is no such path.

    group: "trade-off", all W turned together; "stage", all that holds the parameters, from weak to tight; "chosen", one weight that the
    user wanted to see turned.
    """
    path = _path(found, group)
    if len(path) < 2 or not path[0].parameters or (group == "chosen" and len(found.varied) > 1):
        return None
    what = TURNED.get(group) or next(iter(found.varied))
    factor = np.log10([o.setting.factor for o in path])
    units = {p.name: p.unit for p in found.recommended.parameters.values()}
    panels = []
    for name in path[0].parameters:
        value, std = np.array([o.parameters[name] for o in path]).T
        curve = Curve(name=name, x=factor, y=value, colour=COLOURS["smoothed"], look="joined", band=BAND * std, legend=False)
        panels.append(Panel(curves=[curve], y=name, y_unit=units.get(name, ""), x=f"log10 factor on {what}", x_unit="", height=130))
    return stack(panels, caption=PATHS[group], label="parameter_paths" if group == "trade-off" else f"parameter_paths_{group}")


def balance_chart(found: Weighing) -> Chart | None:
    """Of every setting, equation and output, how large what is left over is beside what its weight supposes.

    Without chosen settings where there are more than MANY of them.
    """
    solved = [o for o in found.outcomes if o.converged]
    crowded = sum(o.setting.group == "chosen" for o in solved) > MANY
    solved = [o for o in solved if not (crowded and o.setting.group == "chosen")]
    names = [*dict.fromkeys(n for o in solved for n in o.force), *dict.fromkeys(n for o in solved for n in o.misfit)]
    if not names:
        return None
    values = np.array([[{**o.force, **o.misfit}.get(n, (np.nan, np.nan))[1] for o in solved] for n in names])
    with np.errstate(divide="ignore", invalid="ignore"):
        shown = np.log10(values)
    caption = (
        "Residual balance, log10 of rms over what the weight supposes: zero where a weight is right, red where an equation or a reading "
        "has more left over than that, blue where it has less."
    )
    labels = [o.setting.name for o in solved]
    return heat_map(shown, labels, names, caption=caption, label="balance", most=DECADE)


def _path(found: Weighing, group: Along = "trade-off") -> list[Outcome]:
    """The settings of a path in order, with that of greatest likelihood, which they lead through; none where there is no such path."""
    through, path = likeliest(found.outcomes), [o for o in found.outcomes if o.setting.group == group]
    between = [through] if through and through.setting.factor not in {o.setting.factor for o in path} else []
    return sorted((o for o in (*between, *path) if o.converged), key=lambda o: o.setting.factor) if path else []


def _size(found: Weighing, outcome: Outcome) -> tuple[float, float]:
    """log10 of the mean misfit and of the mean residual force of a setting, over the recommended weights."""
    weights, parts = found.best.weights, []
    for kind, sizes in (("V", outcome.misfit), ("W", outcome.force)):
        ratios = [rms / weights[f"{kind} of {name}"] for name, (rms, _) in sizes.items() if f"{kind} of {name}" in weights]
        parts.append(float(np.log10(np.sqrt(np.mean(np.square(ratios))))) if ratios else float("nan"))
    return parts[0], parts[1]


def _weights(found: Weighing) -> str:
    head = ["weight", "std from the data", "95 %", "chance of as much if there is none", "recommended std", "unit"]
    rows = []
    for label, std in found.best.weights.items():
        component = found.components.get(label)
        if component is None:
            continue
        low, high = component.interval
        known = np.isfinite(low) and np.isfinite(high)
        band = NOTHING if not known else f"up to {number(high, 3)}" if component.may_be_none else f"{number(low, 3)} .. {number(high, 3)}"
        zero = chance(component.p_zero) or NOTHING
        rows.append([label, number(component.std, 4), band, zero, number(std, 4), pretty(component.unit)])
    return table(head, rows, words=(0, 5))


def _moves(found: Weighing) -> str:
    names = list(dict.fromkeys(n for slopes in found.slopes.values() for n in slopes))
    if not names:
        return ""
    rows = []
    for label, slopes in found.slopes.items():
        ends = found.moves.get(label, {})
        for k, times in enumerate(("× 0.1", "× 10")):
            rows.append([label, times, *(number(ends[n][k], 2) if n in ends else NOTHING for n in names)])
        rows.append([label, "slope", *(number(slopes[n], 2) for n in names)])
    text = (
        "By how many of its standard deviations a parameter lies elsewhere with a tenth and with ten times the weight's std, solved anew, "
        "than with the weights of greatest likelihood. "
        "The slope is that to first order, for an e-fold std, of the parameters most probable together with a trajectory: by "
        "differentiation of the conditions of optimality."
    )
    return table(["weight", "its std", *names], rows, words=(0, 1)) + f"<p class=note>{text}</p>"


def _predictions(found: Weighing) -> str:
    return "".join(prediction_table(p, found.recommended.units) for p in found.recommended.held_out.values())


def _settings(found: Weighing) -> str:
    units = {p.name: p.unit for p in found.recommended.parameters.values()}
    names = list(dict.fromkeys(n for o in found.outcomes for n in o.parameters))
    head = ["setting", "log likelihood", "of what was held out", "condition", "steps", *names]
    rows = []
    for o in found.outcomes:
        if not o.converged:
            rows.append([o.setting.name, o.status, *[""] * (len(head) - 2)])
            continue
        values = [_with_deviation(*o.parameters[n], units.get(n, "")) for n in names]
        rows.append([o.setting.name, number(o.log_likelihood, 7), number(o.held_out, 7), f"{o.condition:.1e}", str(o.iterations), *values])
    text = (
        "Log likelihoods have a constant of the mesh in them: they compare settings of this study, and nothing else. Deviations are those "
        "with the weights of the setting."
    )
    return table(head, rows, codes=()) + f"<p class=note>{text}</p>"


def _with_deviation(value: float, std: float, unit: str) -> str:
    if not std > 0:
        return quantity(value, unit)
    factor, shown = scaled(value, unit)
    return f"{' ± '.join(uncertain(value * factor, std * factor))} {shown}".rstrip()
