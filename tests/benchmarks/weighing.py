"""A study of the weights of the xy-table with one worker and with two: `python tests/benchmarks/weighing.py`.

Twelve weights: of three balances, of six sensors, of two measured currents, and of the drift of a friction level.
Prints seconds, settings solved and those that arrived, and the speed-up of two workers over one in the same run.
"""

from __future__ import annotations

import time

from backsight.data.generators import xy_table
from backsight.estimation import Free, Problem, Recording, Weights, weigh
from backsight.models import compile_model
from backsight.models.plants import PLANTS

FREE = ("spindle.k", "drive_1.J", "drive_3.J", "friction_1.tau_c", "friction_3.tau_c")


def study(jobs: int) -> float:
    """Seconds of a study with so many workers."""
    model, run = PLANTS["xy_table"](), xy_table.record(seed=1)
    recording = Recording(name="run", time=run.time, inputs=run.inputs, outputs=run.outputs, output_std=run.noise)
    values = {p.name: p.value for p in compile_model(model).parameters if p.name in FREE}
    began = time.perf_counter()
    found = weigh(
        Problem(
            model=model,
            recordings=[recording],
            parameters={name: Free(value, drift=1e-3 if name == "friction_1.tau_c" else None) for name, value in values.items()},
            weights=Weights(V={"I_x": 1e-2, "I_y": 1e-2}),
        ),
        jobs=jobs,
    )
    seconds, arrived = time.perf_counter() - began, sum(o.converged for o in found.outcomes)
    settings = f"{len(found.outcomes)} settings of {len(found.components)} weights, {arrived} arrived"
    print(f"{jobs} worker{'s' * (jobs > 1)}: {seconds:6.1f} s; {settings}", flush=True)
    return seconds


def main() -> None:
    """One after the other, so that neither disturbs the other."""
    two, one = study(2), study(1)
    print(f"two workers over one: {one / two:.2f}")


if __name__ == "__main__":
    main()
