"""An hour of rows through `backsight track --stdin`: `python tests/studies/long_stream.py [--hours 1]`.

A simulated axis at 100 Hz under a proportional controller with square and sine references; 2 % of the positions are missing, 0.1 % are
wrong by millimetres, and time stamps jitter. The rows are made and sent as fast as they are taken. Printed: estimates by outcome, memory
of the process along the way, latency, and how far the estimates are from the truth in their own deviations.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

MASS, DAMPING, FRICTION, OFFSET = 95.0, 200.0, 20.0, -3.0
NOISE, FORCE_STD, STEP, FINE, WIDTH = 1e-5, 0.4, 0.01, 10, 1e-3
STUDY = f"""model = "actuator"
[parameters]
"carriage.m" = {MASS}
"friction.d" = {DAMPING}
"friction.f_c" = {{ guess = 8.0, min = 0.0 }}
"offset.f" = {{ guess = 1.0 }}
[[recording]]
file = "log.csv"
time = "t"
inputs = {{ F = "F" }}
outputs = {{ x = {{ column = "x", std = {NOISE} }} }}
[weights]
W = {{ "carriage" = {{ std = {FORCE_STD} }} }}
[horizon]
samples = 50
"""


def rows(count: int, seed: int) -> Iterator[tuple[str, float]]:
    """A row as text, and the true velocity: semi-implicit steps of a millisecond, the force held between the rows."""
    rng = np.random.default_rng(seed)
    s = v = t = 0.0
    for k in range(count):
        wanted = 0.05 * np.sign(np.sin(0.7 * t)) + 0.02 * np.sin(5.1 * t)
        force = float(np.clip(4000.0 * (wanted - s) - 600.0 * v, -150.0, 150.0))
        read = s + NOISE * rng.standard_normal()
        chance = rng.random()
        if chance < 0.001:
            read += float(rng.choice([-1, 1]) * rng.uniform(1e-3, 2e-2))
        text = "" if 0.001 <= chance < 0.021 and k else repr(float(read))
        yield f"{t!r},{force!r},{text}\n", v
        h = STEP * (1 + 0.2 * (rng.random() - 0.5)) / FINE
        push = FORCE_STD / np.sqrt(h) * rng.standard_normal(FINE)
        for w in push:
            v += h * (force + w - DAMPING * v - FRICTION * np.tanh(v / WIDTH) - OFFSET) / MASS
            s += h * v
        t += FINE * h


def memory(process: int) -> float:
    """Resident memory of a process, MB."""
    for line in Path(f"/proc/{process}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return float(line.split()[1]) / 1024
    return float("nan")


def main() -> None:
    """Send the rows, read the estimates, print what came of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--hours", type=float, default=1.0, help="length of the stream (default: 1)")
    count = int(parser.parse_args().hours * 3600 / STEP)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "study.toml").write_text(STUDY)
        (folder / "log.csv").write_text("t,F,x\n" + "".join(text for text, _ in rows(2000, seed=1)))
        code = "import sys; from backsight.estimation.command.cli import main; sys.exit(main(sys.argv[1:]))"
        command = [sys.executable, "-c", code, "track", str(folder / "study.toml"), "--stdin", "--out", str(folder / "out")]
        began, truth = time.perf_counter(), np.zeros(count)
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
            source, sink = process.stdin, process.stdout
            assert source is not None
            assert sink is not None

            def send() -> None:
                source.write("t,F,x\n")
                for k, (text, velocity) in enumerate(rows(count, seed=0)):
                    truth[k] = velocity
                    source.write(text)
                source.close()

            threading.Thread(target=send, daemon=True).start()
            heading = sink.readline().rstrip().split(",")
            v, v_std, f, f_std = (heading.index(c) for c in ("carriage.v", "carriage.v.std", "friction.f_c", "friction.f_c.std"))
            outcomes, z, last = Counter[str](), np.full(count, np.nan), [0.0, 0.0]
            for k, line in enumerate(sink):
                cells = line.rstrip().split(",")
                outcomes[cells[-1]] += 1
                z[k] = (float(cells[v]) - truth[k]) / float(cells[v_std])
                last = [float(cells[f]), float(cells[f_std])]
                if k % max(count // 10, 1) == 1000:
                    print(f"row {k:7d}: {memory(process.pid):.1f} MB, {time.perf_counter() - began:.0f} s", flush=True)
        result = (folder / "out" / "result.json").read_text()
    print(f"{sum(outcomes.values())} estimates of {count} rows: {dict(outcomes)}; exit status {process.returncode}")
    error = np.sqrt(np.nanmean(z[100:] ** 2))
    print(f"friction {last[0]:.3f} +- {last[1]:.3f} N (true {FRICTION}); rms of the velocity's error over its std {error:.2f}")
    print(result[result.index('"latency_ms"') : result.index('"solver"')])


if __name__ == "__main__":
    main()
