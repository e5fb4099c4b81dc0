"""A study of the weights as it comes out of `weigh`, written down by hand: for the tests of what is made of one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from shaken import PLANT, TRUE, driven

from backsight.estimation import Free, Problem, Recording, Weighing
from backsight.estimation.weighing.components import Component
from backsight.estimation.weighing.recommendation import LIKELIHOOD, RULE
from backsight.estimation.weighing.setting import Group, Outcome, Setting

CANDIDATES = (LIKELIHOOD, "as smooth chooses them", RULE)


def outcome(
    name: str, group: Group = "weight", *, factor: float = 1.0, varied: str = "", value: float = 1.0, std: float = 0.5, **told: object
) -> Outcome:
    """Of a setting that converged: a parameter p, and q, which nothing tells."""
    given: dict[str, object] = {
        "setting": Setting(name=name, group=group, theta=(0.0,), varied=varied, factor=factor),
        "converged": True,
        "status": "converged",
        "iterations": 1,
        "seconds": 0.0,
        "weights": {"W of mass": 1.0, "V of x": 1e-3},
        "parameters": {"p": (value, std), "q": (1.0, np.inf)},
        "misfit": {"x": (1e-3, 1.0)},
        "force": {"mass": (1.0, 1.0)},
        "arrived": True,
    }
    return Outcome(**(given | told))  # type: ignore[arg-type]


def candidates(**of: dict[str, object]) -> list[Outcome]:
    """Those of LIKELIHOOD, FIRST and RULE; of: "likelihood", "first", "rule" -> what is otherwise."""
    return [outcome(name, "candidate", **of.get(key, {})) for name, key in zip(CANDIDATES, ("likelihood", "first", "rule"), strict=True)]


def weighing(outcomes: list[Outcome], *, chosen: str = LIKELIHOOD, component: Component | None = None, force: float = 100.0) -> Weighing:
    """With these settings; component: W of mass."""
    time, u = driven(30)
    run = Recording(name="run", time=time, inputs={"F": u}, outputs={"x": 0.0 * u})
    return Weighing(
        recommended=None,  # type: ignore[arg-type]
        chosen=chosen,
        why="Recommended.",
        components={"W of mass": component or Component(std=1.0, log_std=0.1, unit="N.sqrt(s)", p_zero=1e-3)},
        correlation={},
        moves={},
        slopes={},
        state_slopes={},
        outcomes=tuple(outcomes),
        forces={"mass": force},
        arrived=True,
        notes=(),
        problem=Problem(model=PLANT, recordings=[run], parameters=TRUE | {"damper.d": Free(1.0)}),
    )


def lost(one: Outcome) -> Outcome:
    """The same without convergence."""
    return replace(one, converged=False, status="limit of iterations", parameters={}, misfit={}, force={})
