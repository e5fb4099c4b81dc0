"""How long the things take that a user waits for: `make bench`.

Each line: what, median and spread of its runs in seconds. Times depend on the machine, so nothing here passes or fails.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import numpy as np
import pandas as pd

from backsight.estimation.recordings.recording import Recording
from backsight.estimation.smoothing.smoother import smooth
from backsight.estimation.study.study import Study
from backsight.models import compile_model, simulate
from backsight.models.plants import PLANTS


def timed(what: str, call: Callable[[], object], runs: int = 5) -> None:
    """Run `call` a few times and print its median time, the fastest and the slowest."""
    seconds = []
    for _ in range(runs):
        began = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - began)
    print(f"{what:60s} {statistics.median(seconds):8.3f} s   ({min(seconds):.3f} to {max(seconds):.3f}, {runs} runs)", flush=True)


def start(*arguments: str) -> Callable[[], object]:
    """A call that starts the command in a process of its own."""
    code = "import sys; from backsight.estimation.command.cli import main; sys.exit(main())"
    return lambda: subprocess.run([sys.executable, "-c", code, *arguments], check=True, stdout=subprocess.DEVNULL)


def main() -> None:
    """All of them, the quick ones first."""
    timed("backsight --help", start("--help"))
    timed("backsight models", start("models"))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.csv"
        t = np.arange(250_000) * 1e-3
        pd.DataFrame({"t_s": t, "F_N": np.sin(t), "x_m": np.cos(t)}).to_csv(path, index=False)
        timed("read a csv of 250 000 rows", lambda: Recording.read(path, time="t_s", inputs={"F": "F_N"}, outputs={"x": "x_m"}))
    for name, plant in PLANTS.items():
        timed(f"compile {name}", lambda plant=plant: compile_model(plant()), runs=3)
    dae, t = compile_model(PLANTS["actuator"]()), np.arange(10_000) * 1e-3
    timed("simulate the actuator, 10 000 samples", lambda: simulate(dae, t, {"F": 60 * np.sin(4 * t)}), runs=3)
    study = Path(str(files("backsight.data"))) / "demo.toml"
    timed("read and check the bundled study", lambda: Study.read(study).problem(), runs=3)
    problem = Study.read(study).problem()
    timed(f"smooth it ({problem.fitted[0].time.size} samples)", lambda: smooth(problem), runs=3)


if __name__ == "__main__":
    main()
