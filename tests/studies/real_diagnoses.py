"""Recorded machines, diagnosed from models that lack what is known to be there: where, what and how strong.

    BACKSIGHT_DATA=/path/to/recordings .venv/bin/python tests/studies/real_diagnoses.py [--jobs 2] [--keep folder] [name of a machine ...]

axis        M. Brunot, A. Janot: a ball screw with a force in and a position out, from mass and viscous friction alone. Known: Coulomb
            friction 20.4 N with an offset of 3.2 N against it, viscous friction that differs with the direction, 167 and 240 N s/m; 95.1 kg
pendulum    F. Wiebe et al.: two joints without friction. Known: Coulomb friction in both, 0.21 and 0.17 N.m in slow motion
stage       a geared hub with a flexible link, taken for rigid, without dry friction. Known: stiffness 23..27 N.m/rad; Coulomb 1.2 N.m
rotor       H. Andrade: a motor at one turn a second. Known: cogging 72 times a turn, 0.17 A at 0.032 N.m/A; stiction 0.054 A
held_rotor  the same motor, held every 0.002 rad for a while, one turn forth and back. Known: the same
joint       one joint of an arm in one slow sine, without dry friction. Known: Coulomb friction 12.5 N.m, viscous friction 21.3 N.m.s/rad
lifting     the next one, which lifts the arm, without dry friction. Known: Coulomb friction 13.3 N.m, viscous friction 20.2 N.m.s/rad
oscillator  T. Wigren, J. Schoukens: a circuit that moves as a mass on a hardening spring, taken for a linear one. Known: a cubic stiffness
            and an offset
flight      a small quadrotor, the speeds of its propellers known. Known: drag in proportion to the velocity, 0.31..0.44 1/s times its mass;
            4.06e-10 N/rpm2
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
from real_models import double_pendulum, driven_rotor, flown_body, rigid_stage, turned_joint
from real_models import oscillator as hardening
from real_recordings import PENDULUM, STAGE, fit_and_later
from scipy.spatial.transform import Rotation

from backsight.estimation import Diagnosis, Free, Problem, Recording, diagnose
from backsight.estimation.diagnosis.answer.words import when
from backsight.models.plants import actuator


def axis(folder: Path) -> Problem:
    columns = {"time": "t_s", "inputs": {"F": "u_force_N"}, "outputs": {"x": "q_m"}, "std": {"x": 2e-6}}
    return Problem(
        model=actuator(),
        recordings=[
            Recording.read(folder / "emps/emps_estimation.csv", **columns),
            Recording.read(folder / "emps/emps_pulses_validation.csv", role="held_out", **columns),
        ],
        parameters={"carriage.m": Free(90.0), "friction.d": Free(250.0), "friction.f_c": 0.0, "offset.f": 0.0},
    )


def pendulum(folder: Path) -> Problem:
    slow = folder / "dfki_double_pendulum/A0_20220812_061157_slow_excitation_75s.csv"
    return Problem(
        model=double_pendulum(length=0.3, mass=0.6043),
        recordings=fit_and_later(slow, 20.0, 35.0, 50.0, every=4, **PENDULUM),
        parameters={
            "link_1.m": 0.5594,
            "link_1.m_y": Free(-0.17),
            "link_1.J": Free(0.05, min=1e-4),
            "link_2.m_y": Free(-0.11),
            "link_2.J": Free(0.024, min=1e-4),
            "friction_1.d": Free(0.05, min=0.0),
            "friction_1.tau_c": 0.0,
            "friction_2.d": Free(0.05, min=0.0),
            "friction_2.tau_c": 0.0,
        },
    )


def stage(folder: Path) -> Problem:
    file = folder / "quanser_2dof_flexible_link/lqr_steps_20s.csv"
    return Problem(
        model=rigid_stage(gain=8.925),
        recordings=fit_and_later(file, 0.0, 12.0, 20.0, every=2, **STAGE),
        parameters={"hub.J": 0.0635, "tip.J": Free(0.17, min=1e-4), "friction.d": Free(4.0, min=0.0), "friction.tau_c": 0.0},
    )


def rotor(folder: Path) -> Problem:
    file = folder / "laas_bldc_cogging/speed_pi_1rps.csv"
    columns = {"time": "t_s", "inputs": {"i": "iq_A"}, "outputs": {"phi": "q_rad"}}
    return Problem(
        model=driven_rotor(gain=0.0318),
        recordings=fit_and_later(file, 1.0, 7.0, 12.0, **columns),
        parameters={"rotor.J": Free(4.7e-6, min=1e-7), "friction.d": Free(1e-5, min=0.0), "friction.tau_c": 0.0},
    )


def held_rotor(folder: Path) -> Problem:
    """Means of a quarter of a second: between two of them a rotor of such inertia is anywhere, and only where it is held is told."""
    log = pd.read_csv(folder / "laas_bldc_cogging/quasi_static_mapping_2turns.csv")
    rows = log.groupby((log["t_s"] // 0.25).astype(int)).mean()

    def part(name: str, start: float, end: float, role: Literal["fit", "held_out"]) -> Recording:
        own = rows[rows["t_s"].between(start, end, inclusive="left")]
        inputs, outputs = {"i": own["iq_A"].to_numpy()}, {"phi": own["q_rad"].to_numpy()}
        return Recording(name=name, time=own["t_s"].to_numpy(), inputs=inputs, outputs=outputs, output_std={"phi": 3e-4}, role=role)

    return Problem(
        model=driven_rotor(gain=0.0318),
        recordings=[part("round the turning point", 500.0, 1000.0, "fit"), part("back", 1000.0, 1250.0, "held_out")],
        parameters={"rotor.J": 4.7e-6, "friction.d": 0.0, "friction.tau_c": 0.0},
    )


def joint(folder: Path) -> Problem:
    return _turned(folder, "1", gain=10.0, start=0.0, arm={"arm.m_x": 0.0, "arm.m_y": 0.0})


def lifting(folder: Path) -> Problem:
    """From where it has been brought to where its motion begins."""
    return _turned(folder, "2", gain=10.6956, start=4.0, arm={"arm.m_x": Free(8.0), "arm.m_y": Free(1.0)})


def _turned(folder: Path, number: str, *, gain: float, start: float, arm: Mapping[str, Free | float]) -> Problem:
    columns = {"time": "t_s", "inputs": {"i": f"i{number}_A"}, "outputs": {"q": f"q{number}_rad"}}
    friction = {"friction.d": Free(20.0, min=0.0), "friction.tau_c": 0.0, "offset.tau": 0.0}
    return Problem(
        model=turned_joint(gain=gain),
        recordings=fit_and_later(folder / f"ur10e/joint{number}_only.csv", start, 30.0, 57.0, **columns),
        parameters={**arm, "arm.J": Free(5.0, min=1e-2), **friction},
    )


def oscillator(folder: Path) -> Problem:
    file, columns = folder / "silverbox/SNLS80mV.csv.gz", {"time": "t_s", "inputs": {"u": "u_V"}, "outputs": {"y": "y_V"}}
    return Problem(
        model=hardening(),
        recordings=[
            Recording.read(file, name="fit", range=(67.0, 74.0), **columns),
            Recording.read(file, name="later", role="held_out", range=(98.0, 103.0), **columns),
        ],
        parameters={"mass.m": Free(1e-5, min=1e-8), "spring.k": Free(1.0, min=1e-3), "damper.d": Free(1e-4, min=0.0)},
    )


def flight(folder: Path) -> Problem:
    flights = folder / "crazyflie_flights"
    return Problem(
        model=flown_body(m=0.037, inertia=(1.657e-5, 1.666e-5, 2.926e-5), arm=0.046),
        recordings=[
            flown(flights / "brushless_37g_figure8_ts1p0.csv", role="fit"),
            flown(flights / "brushless_37g_figure8_ts0p7.csv", role="held_out"),
        ],
        parameters={"rotor.k": Free(4e-8), "rotor.torque_ratio": Free(0.006)},
    )


def flown(file: Path, role: Literal["fit", "held_out"]) -> Recording:
    """A log of 500 Hz as means of five rows, and between the pictures of the cameras, which have a file of their own, straight lines.

    Axes x forward, y to the right and z down, and rotors counted as the model's, where the log has y to the left and z up.
    """
    log, seen = pd.read_csv(file), pd.read_csv(file.with_name(f"{file.stem}_mocap.csv"))
    rows = log.groupby(np.arange(len(log)) // 5).mean()
    motors, turned, time = {"n_1": 4, "n_2": 1, "n_3": 2, "n_4": 3}, {"x": 1.0, "y": -1.0, "z": -1.0}, rows["t_s"].to_numpy()
    there = (time >= seen["t_s"].iloc[0]) & (time <= seen["t_s"].iloc[-1])
    attitude = Rotation.from_quat(seen[["qx", "qy", "qz", "qw"]] * [1.0, -1.0, -1.0, 1.0]).as_euler("ZYX")
    pose = {k: sign * seen[f"{k}_m"] for k, sign in turned.items()} | dict(zip(("psi", "theta", "phi"), attitude.T, strict=True))
    return Recording(
        name=file.name,
        time=time,
        inputs={u: rows[f"rpm{number}"].to_numpy() * 2 * np.pi / 60 for u, number in motors.items()},
        outputs={f"a{k}": sign * rows[f"acc_{k}_mps2"].to_numpy() for k, sign in turned.items()}
        | {rate: turned[k] * rows[f"gyro_{k}_radps"].to_numpy() for rate, k in zip("pqr", "xyz", strict=True)}
        | {name: np.where(there, np.interp(time, seen["t_s"], values), np.nan) for name, values in pose.items()},
        hold="linear",
        role=role,
    )


MACHINES: dict[str, Callable[[Path], Problem]] = {
    f.__name__: f for f in (axis, pendulum, stage, rotor, held_rotor, joint, lifting, oscillator, flight)
}


def told(found: Diagnosis) -> str:
    """The verdict, what was found, its parameters and what else it could be; what was tried; the repaired model's parameters; held out."""
    rows = [f"verdict: {found.verdict}"]
    for x in found.findings:
        numbers = ", ".join(f"{n} {s.value:.5g} +- {s.std or np.nan:.2g} {s.unit}" for n, s in x.explanation.parameters.items())
        rows.append(f"  {x.explanation.words}: {numbers}; {x.gain:.0f} nats, {when(x)}, share {x.share}")
        rows += [f"    {x.described}"] if x.described else []
        rows += [f"    or {rival.words}" for rival in x.rivals]
    rows += [f"  tried {t.explanation.words}: predicted {t.predicted}, fitted {t.fitted}; {t.refused}" for t in found.tried[:30]]
    rows += [f"  {p.name} {p.value:.5g} +- {p.std or np.nan:.2g}" for p in found.after.parameters.values() if not p.fixed]
    if found.held_out is not None and found.held_out.repaired:
        rows.append(f"held out: {found.held_out.improvement_percent:.1f} %, p = {found.held_out.p_value:.2g}")
    return "\n".join([*rows, *found.notes])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("machines", nargs="*", help=f"of {', '.join(MACHINES)}; all by default")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--keep", type=Path, help="a folder for finished fits, so that a run that was interrupted goes on")
    asked = parser.parse_args()
    if unknown := set(asked.machines) - set(MACHINES):
        parser.error(f"no machine is called {', '.join(sorted(unknown))}; there are {', '.join(MACHINES)}")
    folder = Path(os.environ.get("BACKSIGHT_DATA", ""))
    for name in asked.machines or MACHINES:
        print(f"\n{name}", flush=True)
        try:
            problem = MACHINES[name](folder)
        except OSError as error:
            print(f"skipped: {error}; BACKSIGHT_DATA must name the folder of the recordings")
            continue
        start = time.perf_counter()
        clock = lambda words, start=start: print(f"{time.perf_counter() - start:7.1f} {words}", flush=True)  # noqa: E731
        keep = asked.keep / name if asked.keep else None
        print(told(diagnose(problem, jobs=asked.jobs, keep=keep, progress=clock)))
        print(f"{time.perf_counter() - start:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
