"""How the cost of compiling a model grows with its size: `python tests/benchmarks/compile.py`.

A chain of masses joined by springs and dampers, a train of inertias on rigid gears (all on one coordinate), and the actuator. Every line:
equations of the flat model, states, and the seconds for flattening, for elimination and for the rest (index, singularity, assembly). The
exponents are those of power laws between a line and the one above it, in the order of the seconds. The machine may be busy: ratios in one
run are what to look at.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

sys.path.insert(0, str(Path(__file__).parents[1]))

from chains import gear_train, mass_chain

from backsight.models import Model
from backsight.models.compilation import compiler
from backsight.models.compilation.eliminate import Eliminator, Reduced
from backsight.models.compilation.flat import FlatModel
from backsight.models.compilation.flatten import flatten
from backsight.models.plants import actuator

FAMILIES: dict[str, tuple[Callable[[int], Model], tuple[int, ...]]] = {
    "masses": (mass_chain, (10, 100, 500)),
    "gears": (gear_train, (10, 100, 500)),
    "actuator": (lambda _: actuator(), (1,)),
}


def measure(model: Model) -> tuple[int, int, list[float]]:
    """Equations, states, and the seconds of flattening, of elimination, of the rest and of all."""
    flattening = eliminating = 0.0
    equations = 0

    def flattened(model: Model) -> FlatModel:
        nonlocal flattening
        began = time.perf_counter()
        flat = flatten(model)
        flattening += time.perf_counter() - began
        return flat

    class Timed(Eliminator):
        def __init__(self, flat: FlatModel, *arguments: Any, **options: Any) -> None:
            nonlocal equations, eliminating
            equations = len(flat.equations)
            began = time.perf_counter()
            super().__init__(flat, *arguments, **options)
            eliminating += time.perf_counter() - began

        def run(self) -> Reduced:
            nonlocal eliminating
            began = time.perf_counter()
            reduced = super().run()
            eliminating += time.perf_counter() - began
            return reduced

    began = time.perf_counter()
    with patch.object(compiler, "flatten", flattened), patch.object(compiler, "Eliminator", Timed):
        dae = compiler.compile_model(model)
    total = time.perf_counter() - began
    return equations, len(dae.states), [flattening, eliminating, total - flattening - eliminating, total]


def main() -> None:
    """Print the table."""
    print("model       size  equations  states  flatten s  eliminate s  rest s  total s   exponents")
    for name, (build, sizes) in FAMILIES.items():
        before: tuple[int, list[float]] | None = None
        for size in sizes:
            equations, states, seconds = measure(build(size))
            line = (
                f"{name:8s} {size:7d} {equations:10d} {states:7d} {seconds[0]:10.3f} {seconds[1]:12.3f} {seconds[2]:7.3f} {seconds[3]:8.3f}"
            )
            if before is not None:
                pairs = zip(seconds, before[1], strict=True)
                line += "   " + " ".join(f"{math.log(now / then) / math.log(size / before[0]):.2f}" for now, then in pairs)
            print(line, flush=True)
            before = size, seconds


if __name__ == "__main__":
    sys.exit(main())
