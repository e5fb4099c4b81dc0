"""Three recorded machines smoothed with models declared from components: what comes out, and how far it is to be believed.

    BACKSIGHT_DATA=/path/to/recordings .venv/bin/python tests/studies/real_sets.py [--force] [name of a set ...]

All three are under feedback: a controller answers what the model lacks, so the torque follows the very force that is left over. White
residual forces know nothing of that, and inertias come out several times too large, or run away (`--force`). Where a stiff
controller prescribes the motion the torque is the answer to it: it gets the room, Weights(V={input: std}), and the residual force next to
none. Samples are thinned to 50 Hz or so; an encoder's std includes the ripple of gears that the model lacks.

Published: F. Wiebe et al., Open source dual-purpose acrobot and pendubot platform, IEEE Robotics & Automation Magazine 2023 (model 2.0);
S. Mamedov, S. Mikhel, Practical aspects of model-based collision detection, Frontiers in Robotics and AI 2020; Quanser's configuration
of the flexible link, with the stiffness of their impulse test.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from real_models import double_pendulum, flexible_stage, turned_joint
from real_recordings import PENDULUM, STAGE, fit_and_later

from backsight.estimation import Free, OutputFit, Problem, Recording, Smoothing, Weights, smooth

DOUBT = 0.01  # chance of the prediction errors' colour below which they are not white


@dataclass(frozen=True, kw_only=True)
class RealSet:
    """A problem on a recorded machine. file, others: what it reads, below the folder of the data; published: parameter -> value."""

    file: str
    pose: Callable[[Path], Problem]
    published: Mapping[str, float]
    others: tuple[str, ...] = field(default=())


def pendulum(file: Path) -> Problem:
    """Slow tracked sines: fitted where both joints move most, held out what follows, and faster sines without control on another day."""
    columns = {**PENDULUM, "std": {"q_1": 1.5e-3, "q_2": 1.5e-3}}
    return Problem(
        model=double_pendulum(length=0.3, mass=0.6043),
        recordings=[
            *fit_and_later(file, 20.0, 35.0, 50.0, every=6, **columns),
            Recording.read(file.parent / "A0_20220815_traj00.csv", name="sines", role="held_out", every=4, **columns),
        ],
        parameters={
            "link_1.m": 0.5594,  # turns about a fixed point: it has no effect
            "link_1.m_y": Free(-0.1),
            "link_1.J": Free(0.1, min=1e-4),
            "link_2.m_y": Free(-0.05),
            "link_2.J": Free(0.05, min=1e-4),
            "friction_1.d": Free(0.05, min=0.0),
            "friction_1.tau_c": Free(0.1, min=0.0),
            "friction_2.d": Free(0.05, min=0.0),
            "friction_2.tau_c": Free(0.1, min=0.0),
        },
        weights=Weights(V={"tau_1": 0.2, "tau_2": 0.1}, W={"shoulder": 2e-3, "elbow": 7e-4}),
    )


def joint_1(file: Path) -> Problem:
    """The vertical axis in one slow sine: nothing to lift, and hardly anything to accelerate."""
    return _joint(file, "1", gain=10.0, std=0.25, lifted={"arm.m_x": 0.0, "arm.m_y": 0.0})


def joint_2(file: Path) -> Problem:
    """The shoulder in one slow sine, with the whole arm to lift."""
    return _joint(file, "2", gain=10.6956, std=0.3, lifted={"arm.m_x": Free(5.0), "arm.m_y": Free(0.0)})


def joint_2_loaded(file: Path) -> Problem:
    """The shoulder again, with friction in the gear that grows with its load: what the residual of joint_2 asks for."""
    problem = joint_2(file)
    return replace(
        problem,
        model=turned_joint(10.6956, loaded=True),
        parameters={**problem.parameters, "teeth.mu": Free(0.02, min=0.0)},
        weights=Weights(V={"i": 0.2}, W={"joint": 1e-2}),
    )


def _joint(file: Path, number: str, *, gain: float, std: float, lifted: Mapping[str, Free | float]) -> Problem:
    columns = {
        "time": "t_s",
        "inputs": {"i": f"i{number}_A"},
        "outputs": {"q": f"q{number}_rad"},
        "std": {"q": 3e-5},  # rad: values have four decimals
        "hold": "linear",
        "every": 4,
    }
    return Problem(
        model=turned_joint(gain),
        recordings=fit_and_later(file, 0.0, 40.0, 58.0, **columns),
        parameters={
            **lifted,
            "arm.J": Free(3.0, min=1e-3),
            "friction.d": Free(10.0, min=0.0),
            "friction.tau_c": Free(5.0, min=0.0),
            "offset.tau": Free(0.0),
        },
        weights=Weights(V={"i": std}, W={"joint": 1e-2}),
    )


def link(file: Path) -> Problem:
    """The first stage of the flexible robot, whose strain gauge is filtered; the second stage rides on its tip and counts as load."""
    outputs = {**STAGE["outputs"], "deflection": "tip1_deflection_rad"}
    columns = {**STAGE, "outputs": outputs, "std": {"hub": 1e-5, "deflection": 5e-5}, "every": 5}
    return Problem(
        model=flexible_stage(gain=8.925, lag=0.1),
        recordings=fit_and_later(file, 0.0, 12.0, 20.0, **columns),
        parameters={
            "hub.J": Free(0.06, min=1e-4),
            "tip.J": Free(0.17, min=1e-4),
            "link.k": Free(40.0, min=0.0),
            "link.d": Free(0.05, min=0.0),
            "friction.d": Free(4.0, min=0.0),
            "friction.tau_c": Free(0.5, min=0.0),
            "offset.tau": Free(0.0),
            "filter.tau": Free(0.1, min=1e-3),
        },
        weights=Weights(V={"i": 0.03}, W={"hub": 2e-3}),
    )


SETS = {
    "pendulum": RealSet(
        file="dfki_double_pendulum/A0_20220812_061157_slow_excitation_75s.csv",
        others=("dfki_double_pendulum/A0_20220815_traj00.csv",),
        pose=pendulum,
        published={
            "link_1.m_y": -0.5594 * 0.3,
            "link_1.J": 0.05347,
            "link_2.m_y": -0.6043 * 0.1838,
            "link_2.J": 0.02392,
            "friction_1.d": 0.001,
            "friction_1.tau_c": 0.146,  # 0.093 arctan(...)
            "friction_2.d": 0.001,
            "friction_2.tau_c": 0.123,  # 0.078 arctan(...)
        },
    ),
    "joint_1": RealSet(
        file="ur10e/joint1_only.csv", pose=joint_1, published={"friction.d": 21.256, "friction.tau_c": 12.548, "offset.tau": 0.196}
    ),
    "joint_2": RealSet(
        file="ur10e/joint2_only.csv", pose=joint_2, published={"friction.d": 20.221, "friction.tau_c": 13.266, "offset.tau": -0.754}
    ),
    "joint_2_loaded": RealSet(file="ur10e/joint2_only.csv", pose=joint_2_loaded, published={}),
    "link": RealSet(
        file="quanser_2dof_flexible_link/lqr_steps_20s.csv",
        pose=link,
        published={"hub.J": 0.06354, "tip.J": 0.1704, "link.k": 27.0, "friction.d": 4.0},
    ),
}


def with_force(problem: Problem) -> Problem:
    """The same with the inputs as recorded, and residual forces from the data."""
    return replace(problem, weights=Weights())


def table(result: Smoothing, published: Mapping[str, float]) -> str:
    """One row per free parameter; the last deviation is what is left of it if the prediction errors are worth as little as they look."""
    factor = max(widening(fit) for outputs in result.fit.values() for fit in outputs.values())
    rows = [f"{'parameter':18}{'estimate':>12}{'std':>11}{'widened':>11}{'published':>12}  unit"]
    for p in result.parameters.values():
        if not p.fixed:
            std, wide = ("-", "-") if p.std is None else (f"{p.std:.2g}", f"{factor * p.std:.2g}")
            other = f"{published[p.name]:.4g}" if p.name in published else "-"
            rows.append(f"{p.name:18}{p.value:12.5g}{std:>11}{wide:>11}{other:>12}  {p.unit}")
    return "\n".join(rows)


def widening(fit: OutputFit) -> float:
    """By how much coloured prediction errors make deviations too small, for a parameter whose effect is slow; 1 where they are white."""
    if fit.whiteness_p is None or fit.effective_samples is None or fit.whiteness_p > DOUBT:
        return 1.0
    return max(1.0, (fit.prediction_rms or 1.0) * (fit.samples / fit.effective_samples) ** 0.5)


def verdicts(result: Smoothing) -> str:
    """Fit, whiteness and what the notes say of deviations, per output; then the held-out recordings."""
    rows = []
    for name, outputs in result.fit.items():
        for output, fit in outputs.items():
            percent = "-" if fit.fit_percent is None else f"{fit.fit_percent:.2f} %"
            p = "-" if fit.whiteness_p is None else f"{fit.whiteness_p:.1g}"
            rows.append(f"{name}, {output}: fit {percent}, prediction errors white p = {p}")
    rows += [f"  {note}" for note in result.notes if "not white" in note or "follows" in note or "bound" in note or "apart" in note]
    for name, prediction in result.held_out.items():
        for output, fit in prediction.fit.items():
            windows = prediction.window_rms.get(output)
            short = "" if windows is None else f"; {windows:.3g} over windows of {prediction.window_s:.2g} s"
            rows.append(f"{name}, {output}: simulated {fit.rms:.3g} rms (fit {fit.fit_percent:.1f} %){short}")
    return "\n".join(rows)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="*", help=f"of {', '.join(SETS)}; all by default")
    parser.add_argument("--force", action="store_true", help="with white residual forces from the data, inputs as recorded")
    asked = parser.parse_args()
    if unknown := set(asked.sets) - set(SETS):
        parser.error(f"no set is called {', '.join(sorted(unknown))}; there are {', '.join(SETS)}")
    folder = os.environ.get("BACKSIGHT_DATA", "")
    for name in asked.sets or SETS:
        real = SETS[name]
        print(f"\n{name}: {real.pose.__doc__}")
        missing = [f for f in (real.file, *real.others) if not (Path(folder) / f).is_file()]
        if not folder or missing:
            print(f"skipped: needs {' and '.join(missing or [real.file])} in the folder that BACKSIGHT_DATA names")
            continue
        problem = real.pose(Path(folder) / real.file)
        start = time.perf_counter()
        result = smooth(with_force(problem) if asked.force else problem)
        print(table(result, real.published))
        print(verdicts(result))
        print(f"{result.solver.status} {time.perf_counter() - start:.1f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
