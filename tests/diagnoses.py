"""A diagnosis of the bundled axis made by hand from two smoothing runs, for the tests of what is made of diagnoses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from math import nan

import numpy as np

from backsight.data import path
from backsight.estimation import Free, Problem, Recording, Smoothing, smooth
from backsight.estimation.diagnosis import Diagnosis, Errors, Explanation, Finding, HeldOut, Mismatch, Strength, Tried, Undetectable
from backsight.estimation.diagnosis.candidates.candidate import Candidate
from backsight.models.plants import actuator

PLACE = "carriage"


def found(c: Candidate, gain: float) -> Finding:
    """A finding of a candidate that gained so much [nats], with nothing else told of it."""
    explanation = Explanation(place=c.place, family=c.family, physics=c.physics)
    return Finding(explanation=explanation, p_value=nan, gain=gain, change="", share=None)


@cache
def runs() -> tuple[Problem, Smoothing, Problem, Smoothing]:
    """The axis smoothed without Coulomb friction, and with it."""
    log = Recording.read(path("axis_fit.csv.gz"), time="t_s", inputs={"F": "F_N"}, outputs={"x": "x_m"}, std={"x": 1e-6}, range=(0.0, 1.0))
    free = {"carriage.m": Free(90.0), "friction.d": Free(250.0), "offset.f": Free(0.0)}
    base = Problem(model=actuator(), recordings=[log], parameters={**free, "friction.f_c": 0.0})
    repaired = replace(base, parameters={**free, "friction.f_c": Free(10.0, min=0.0)})
    return base, smooth(base), repaired, smooth(repaired)


@cache
def diagnosis() -> Diagnosis:
    """Friction at the carriage, with a rival, an alternative that was refused, and an effect that nothing shows."""
    _, before, repaired, after = runs()
    f_c = after.parameters["friction.f_c"]
    found = Explanation(
        place=PLACE, family="friction", physics="coulomb_friction", parameters={"f_c": Strength(value=f_c.value, std=f_c.std, unit="N")}
    )
    refused = Explanation(place=PLACE, family="friction", physics="stribeck_friction", gap=6.4)
    rival = Explanation(place="input:F", family="actuator", physics="input_dead_zone", gap=1.2)
    finding = Finding(
        explanation=found,
        p_value=0.005,
        gain=812.0,
        change=f"friction = CoulombFriction(f_c={f_c.value:.3g}) at {PLACE}.flange",
        share=0.34,
        alternatives=(refused,),
        rivals=(rival,),
        separates="a slow reversal under a constant load",
    )
    return Diagnosis(
        verdict="missing_physics",
        findings=(finding,),
        before=before,
        after=after,
        repaired=repaired,
        held_out=proof(),
        undetectable=(
            Undetectable(place=PLACE, physics="backlash", parameter="gap", strength=2e-5, unit="m"),
            Undetectable(place=PLACE, physics="gravity", parameter="tilt", strength=float("inf"), unit="rad"),
        ),
        tried=(
            Tried(explanation=found, predicted=790.0, fitted=812.0),
            Tried(explanation=refused, predicted=792.0, fitted=805.6, refused="spread of v_s 140 %"),
            Tried(explanation=rival, predicted=3.0),
        ),
        mismatch=(mismatch(before), mismatch(after)),
        seconds=12.3,
        seed=7,
        notes=("The noise of x is that given.",),
    )


def proof() -> HeldOut:
    """Errors that the repair makes four times as small."""

    def errors(factor: float) -> Mapping[str, Errors]:
        return {"x": Errors(unit="m", windows={0.05: 1e-6 * factor, 0.25: 4e-6 * factor, 1.5: 9e-6 * factor})}

    force = {PLACE: (8.0, 0.4, "N")}
    return HeldOut(
        before=errors(4.0),
        after=errors(1.0),
        improvement_percent=75.0,
        p_value=0.001,
        blocks=12,
        recordings=("held.csv",),
        role="held_out",
        force=force,
        attainable_percent=93.0,
    )


def mismatch(result: Smoothing) -> Mismatch:
    """The residual force at the carriage."""
    ((name, table),) = result.estimates.items()
    column = f"residual.{PLACE}"
    time, force, std = (table[c].to_numpy(float) for c in ("t_s", column, f"{column}.std"))
    against = {
        "time": (time, "s"),
        "position": (table["carriage.s"].to_numpy(float), "m"),
        "velocity": (table["carriage.v"].to_numpy(float), "m/s"),
    }
    return Mismatch(place=PLACE, unit="N", recording=name, time=time, force=force, std=np.abs(std), against=against)
