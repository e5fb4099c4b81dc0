"""The suite of concealed cases: what is written, that it is the same every time, and that what is concealed can be none at all."""

from __future__ import annotations

import gzip
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from backsight.data.cases import make_case, numbered
from backsight.data.cases.case import Bench, Case, Drawn
from backsight.data.cases.suite import benches
from backsight.data.generators.concealed.effects import FAMILY
from backsight.estimation.study.study import Study
from backsight.models import compile_model
from backsight.models.plants import PLANTS

CASES = numbered()
FAULTY = [(bench, case) for bench, case in CASES if case.strength != "none"]
# Structure that vanishes as its stiffness grows without bounds, or that is there or not: tested with the machines.
STIFF = ("backlash", "compliance", "elasticity", "presliding", "second_string_section", "asymmetric_lag", "input_lag")
LATER = ("end_stop", "bumps", "_bit", "harder_rock", "stick_slip", "aerodynamic")  # act where a short recording does not come
SECONDS = {"actuator": 0.3, "xy_table": 0.12, "drillstring": 0.5, "quadrotor": 0.4, "five_bar": 0.12}


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Recordings of a second or less."""
    with monkeypatch.context() as patch:
        for bench in benches:
            patch.setattr(type(bench), "conditions", replace(bench.conditions, duration=SECONDS[bench.plant]))
        yield


def first_of_each_plant() -> list[int]:
    """A clean and a faulty case of every plant."""
    return [CASES.index((bench, bench.cases[i])) + 1 for bench in benches for i in (0, 9)]


def named(entry: tuple[Bench, Case]) -> str:
    return f"{CASES.index(entry) + 1}-{entry[0].plant}-{entry[1].kind}"


# ---------------------------------------------------------------- the list


def test_there_are_enough_cases_of_every_sort() -> None:
    assert sum(case.strength == "none" for _, case in CASES) >= 40
    assert len(FAULTY) >= 60
    for bench in benches:
        kinds = [case.kind for case in bench.cases]
        assert any(kind.startswith("wrong:") for kind in kinds)
        assert any(kind.startswith("onset:") for kind in kinds)
        assert any(kind.startswith("unknown:") for kind in kinds)
        assert any("+" in kind for kind in kinds)
        assert any(case.strength == "weak" for case in bench.cases)
        assert any(case.core for case in bench.cases)


@pytest.mark.parametrize("entry", FAULTY, ids=named)
def test_what_is_concealed_is_told_in_the_words_of_the_interface(entry: tuple[Bench, Case]) -> None:
    bench, case = entry
    words = {word for members in FAMILY.values() for word in members.split()} | set(bench.order) | {"wrong_parameter"}
    verdicts = {"parameter", "sensor", "input", "missing_physics", "unknown_physics", "undecided"}
    assert {case.verdict, *case.also} <= verdicts
    for effect in case.effects(Drawn(values={**bench.base, **bench.known}, size=1.0)):
        assert {effect.physics, *(physics for _, physics in effect.rivals)} <= words
        signal = effect.place.partition(":")
        assert signal[0] != "input" or signal[2] in bench.inputs
        assert signal[0] != "sensor" or signal[2] in bench.conditions.noise
        assert set(effect.fixed) | set(effect.absent) <= set(bench.order)


@pytest.mark.parametrize("bench", benches, ids=lambda b: b.plant)
def test_studies_name_parameters_and_signals_of_their_plant(bench: Bench) -> None:
    dae = compile_model(PLANTS[bench.plant]())
    assert set(bench.order) <= {p.name for p in dae.parameters}
    assert set(bench.order) == set(bench.base) | set(bench.known)
    assert set(bench.inputs) == {u.name for u in dae.inputs}
    assert set(bench.conditions.noise) == {y.name for y in dae.outputs}


# ---------------------------------------------------------------- at strength zero


@pytest.mark.parametrize(
    "entry", [e for e in FAULTY if not any(word in e[1].kind for word in STIFF) and e[1].strength != "parameter"], ids=named
)
def test_at_strength_zero_the_record_is_that_of_the_machine_without_it(entry: tuple[Bench, Case]) -> None:
    bench, case = entry
    values = {**bench.base, **bench.known, **case.base}
    drawn = Drawn(values=values, size=1e-9)  # limits of inputs are over the size
    effects = tuple(replace(e, onset=None if e.onset is None else 0.06) for e in case.effects(drawn))
    plain = {name: 0.0 if any(name in e.absent for e in effects) else value for name, value in values.items()}
    true = {**values, **{name: value for e in effects for name, value in e.values.items()}}
    none = bench.take(plain, plain, (), case, "multisine", [1, 2])
    some = bench.take(true, plain, effects, case, "multisine", [1, 2])
    for output, y in none.outputs.items():
        # An event, of friction however small, cuts a step in two, which changes the error of the integration.
        assert np.abs(some.outputs[output] - y).max() < 1e-3 * bench.conditions.noise[output], output
    if any(word in case.kind for word in LATER):
        return
    full = tuple(replace(e, onset=None) for e in case.effects(replace(drawn, size=1.0)))
    true = {**values, **{name: value for e in full for name, value in e.values.items()}}
    other = bench.take(true, plain, full, case, "multisine", [1, 2])
    assert any(np.abs(other.outputs[o] - y).max() > 1e-3 * bench.conditions.noise[o] for o, y in none.outputs.items())


# ---------------------------------------------------------------- what is written


@pytest.mark.parametrize("number", first_of_each_plant())
def test_a_seed_writes_one_case_and_another_seed_another(number: int, tmp_path: Path) -> None:
    one, same, other = (
        make_case(number, tmp_path / name, tmp_path / f"{name}_truth", seed) for name, seed in (("a", 1), ("b", 1), ("c", 2))
    )
    for path in sorted(one.folder.iterdir()):
        assert path.read_bytes() == (same.folder / path.name).read_bytes()
        assert path.read_bytes() != (other.folder / path.name).read_bytes()
    assert one.truth == same.truth


@pytest.mark.parametrize("number", first_of_each_plant())
def test_a_case_is_a_study_that_can_be_read_and_says_nothing_of_the_truth(number: int, tmp_path: Path) -> None:
    bench, case = CASES[number - 1]
    made = make_case(number, tmp_path / "cases", tmp_path / "truth")
    study = Study.read(made.folder / "study.toml")
    problem = study.problem()
    assert sorted(path.name for path in made.folder.iterdir()) == [*(f"rec{i + 1}.csv.gz" for i in range(len(case.motions))), "study.toml"]
    assert [r.role for r in study.file.recording] == ["fit"] * (len(case.motions) - 1) + ["held_out"]
    assert {r.time.size for r in problem.recordings} == {round(SECONDS[bench.plant] / bench.conditions.step / case.rows)}
    told = json.loads((tmp_path / "truth" / f"{made.name}.json").read_text())
    assert set(told["guesses"]) == {name for name, value in study.file.parameters.items() if not isinstance(value, float)}
    for name, guess in told["guesses"].items():
        off = abs(guess / told["base_parameters_true"][name] - 1)
        assert 0.149 < off < 0.351
    kept = {name: value for name, value in study.file.parameters.items() if isinstance(value, float)}
    hidden = {name for e in case.effects(Drawn(values=told["base_parameters_true"], size=1.0)) for name in (*e.absent, *e.fixed)}
    assert all(value == told["base_parameters_true"][name] for name, value in kept.items() if name not in hidden)
    assert all(kept[name] == 0 or case.strength == "parameter" for name in hidden)


def test_a_wrong_parameter_is_fixed_off_its_true_value(tmp_path: Path) -> None:
    number = next(i for i, (_, case) in enumerate(CASES, start=1) if case.kind == "wrong:carriage.m")
    made = make_case(number, tmp_path / "cases", tmp_path / "truth")
    fixed = Study.read(made.folder / "study.toml").file.parameters["carriage.m"]
    assert fixed == pytest.approx(1.15 * made.truth["base_parameters_true"]["carriage.m"], rel=1e-5)  # type: ignore[index]
    assert made.truth["effects"][0]["physics"] == "carriage.m"  # type: ignore[index]


def test_readings_have_the_error_that_the_study_says(tmp_path: Path) -> None:
    """A still axis, quantised: noise and rounding together."""
    bench, case = next((b, c) for b, c in CASES if c.kind == "clean:quantised")
    assert bench.plant == "actuator"
    taken = bench.take(bench.base, bench.base, (), case, "multisine", [4])
    error = taken.outputs["x"] - taken.clean["x"]
    made = make_case(CASES.index((bench, case)) + 1, tmp_path / "cases", tmp_path / "truth")
    std = Study.read(made.folder / "study.toml").file.recording[0].outputs["x"].std
    assert error.std() == pytest.approx(std, rel=0.25)
    with gzip.open(made.folder / "rec1.csv.gz", "rt") as file:
        readings = np.array([float(line.split(",")[2]) for line in list(file)[1:]])
    assert np.abs(readings / 1e-5 - np.round(readings / 1e-5)).max() < 1e-6


def test_the_truth_does_not_lie_among_the_cases(tmp_path: Path) -> None:
    for truth in (tmp_path, tmp_path / "truth", tmp_path / "c001"):
        with pytest.raises(ValueError, match="name another folder"):
            make_case(1, tmp_path, truth)
    assert not any(tmp_path.iterdir())


def test_a_number_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="there are cases 1 to"):
        make_case(0, tmp_path / "a", tmp_path / "b")
