"""Writes the bundled recordings of a ball-screw axis: `python -m backsight.data.generators.axis [--seed N] [--out FOLDER]`.

    M x'' = F + n - d x' - f_c sgn(x') - f_0      true Coulomb friction with sticking (`sliding.py`)

F is the motor force of a sampled position control (`servo.py`), n a white disturbance held over each sample. One file is meant
for estimation (strokes at several speeds), the other for validation (a sum of sines). The same seed writes the same bytes.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .bundle import main, packed, written
from .references import Reference, strokes, sum_of_sines
from .run import Run
from .servo import Encoder, Servo, Tracking
from .sliding import Body, Motion, advance

__all__ = ["AXIS", "ENCODER", "SEED", "SERVO", "Axis", "card", "compressed", "operate", "record", "write"]

SEED = 20_240_607
SAMPLES = 10_001


@dataclass(frozen=True, kw_only=True)
class Axis:
    """The machine: body, offset force f_0 [N] against the motor, and the standard deviation [N] of the disturbance of one sample."""

    body: Body
    offset: float
    disturbance_std: float


AXIS = Axis(body=Body(m=95.0, d=200.0, f_c=20.0), offset=-3.0, disturbance_std=0.4)
ENCODER = Encoder(resolution=1e-6, noise_std=1e-6)
# Natural frequency 60 rad/s and damping ratio 0.7 with the mass of 95 kg; the limit is that of a small servo motor on a ball screw.
SERVO = Servo(k_p=342e3, k_d=7980.0, lag=0.004, limit=350.0, resolution=0.01, step=1e-3)


def operate(axis: Axis, encoder: Encoder, servo: Servo, time: np.ndarray, reference: Reference, rng: np.random.Generator) -> Run:
    """Run the axis from rest at 0 along the reference; row k reads the encoder at time[k] and holds force[k] until time[k + 1]."""
    n = time.size
    noise, disturbance = rng.standard_normal(n), axis.disturbance_std * rng.standard_normal(n)
    force, reading, position, velocity = (np.empty(n) for _ in range(4))
    motion, tracking = Motion(), Tracking(reading=0.0)
    for k in range(n):
        position[k], velocity[k] = motion.x, motion.v
        reading[k] = encoder.read(motion.x, noise[k])
        force[k], tracking = servo.command(tracking, reading[k], reference[0][k], reference[1][k])
        motion = advance(axis.body, motion, force[k] + disturbance[k] - axis.offset, servo.step)
    truth = {"carriage.s": position, "carriage.v": velocity, "clean.x": position, "disturbance": disturbance}
    return Run(time=time, inputs={"F": force}, outputs={"x": reading}, truth=truth, noise={"x": encoder.noise_std})


def record(name: str, seed: int = SEED, samples: int = SAMPLES) -> Run:
    """The bundled run `name`: "axis_fit" (strokes) or "axis_held_out" (sum of sines), `samples` rows at 1 kHz."""
    excitation, stream = {"axis_fit": (strokes, 0), "axis_held_out": (sum_of_sines, 1)}[name]
    rng = np.random.default_rng([seed, stream])
    time = np.arange(samples) * SERVO.step
    return operate(AXIS, ENCODER, SERVO, time, excitation(time, rng), rng)


def compressed(run: Run) -> bytes:
    """The run as a gzipped CSV file that carries neither a name nor a date, so that equal runs are equal bytes."""
    rows = ["t_s,F_N,x_m"]
    rows += [f"{t:.3f},{f + 0.0:.2f},{x + 0.0:.6f}" for t, f, x in zip(run.time, run.inputs["F"], run.outputs["x"], strict=True)]
    return packed(rows)


def card(seed: int = SEED) -> str:
    """The card of the two recordings: machine, true values, columns, origin, licence."""
    body, servo, encoder = AXIS.body, SERVO, ENCODER
    density = AXIS.disturbance_std * servo.step**0.5
    noise_um, step_um = encoder.noise_std * 1e6, encoder.resolution * 1e6
    total_um = (noise_um**2 + step_um**2 / 12) ** 0.5
    return f"""# `axis_fit.csv.gz`, `axis_held_out.csv.gz`: a simulated ball-screw axis under position control

## Machine
A carriage on a ball screw, driven by a servo motor; position by an encoder, control sampled at {1 / servo.step:.0f} Hz.

    M x'' = F + n - d x' - f_c sgn(x') - f_0

| true value | symbol | in the model `actuator` |
|---|---|---|
| {body.m:g} kg | M, moving mass | `carriage.m` |
| {body.d:g} N s/m | d, viscous friction | `friction.d` |
| {body.f_c:g} N | f_c, Coulomb friction; the axis sticks while the other forces are smaller | `friction.f_c` |
| {AXIS.offset:g} N | f_0, constant offset | `offset.f` |
| {AXIS.disturbance_std:g} N | standard deviation of n, white, held over each sample | residual at `carriage`: ({density:.4f} N)^2 x 1 s |

Encoder: white interpolation noise of {noise_um:g} um, then rounded to steps of {step_um:g} um: together {total_um:.3f} um rms.
Control: F = k_p (r - y) + k_d (r' - v), k_p = {servo.k_p:g} N/m, k_d = {servo.k_d:g} N s/m, v the difference quotient of y
behind a lag of {servo.lag * 1e3:g} ms; F limited to +-{servo.limit:g} N, rounded to {servo.resolution:g} N, held over the sample.
The recorded F is the force that acted.

## Columns
| column | unit | meaning |
|---|---|---|
| `t_s` | s | time of the sample |
| `F_N` | N | motor force on the carriage, held from this row to the next (input `F`) |
| `x_m` | m | encoder reading at this row's time (output `x`) |

| file | rows | excitation |
|---|---|---|
| `axis_fit.csv.gz` | {SAMPLES} | twenty strokes forth and back at 0.02 to 0.40 m/s, 1.2 to 2.8 m/s^2, no long rests |
| `axis_held_out.csv.gz` | {SAMPLES} | four sines, 0.31 to 2.29 Hz, faded in |

## Origin
Written by `python -m backsight.data.generators.axis --seed {seed}`: simulated, DOP853 between located events (start, stop, reversal),
true Coulomb friction with sticking. The program shares no code with the models or the estimators.

## Licence
Generated by this project; Apache-2.0, as the project itself.
"""


def write(folder: Path, seed: int = SEED) -> list[Path]:
    """Write both recordings and their card into `folder`; returns the paths written."""
    contents = {f"{name}.csv.gz": compressed(record(name, seed)) for name in ("axis_fit", "axis_held_out")}
    contents["axis.md"] = card(seed).encode("utf-8")
    return written(folder, contents)


if __name__ == "__main__":
    main("axis", __doc__ or "", SEED, write)
