"""Study files: what they say arrives in the problem unchanged, and what cannot be used is refused in one sentence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from examples import oscillator

from backsight.estimation.problem import Free, Known, Weights
from backsight.estimation.recordings.excitation import check_excitation, told_at_rest
from backsight.estimation.recordings.recording import Recording
from backsight.estimation.study.errors import line_of
from backsight.estimation.study.study import Study
from backsight.models import compile_model
from backsight.models.errors import InputError
from backsight.models.plants import actuator

T = np.arange(400) * 0.005
RECORD = pd.DataFrame({"t_s": T, "F_N": 60 * np.sin(4 * T), "x_m": 0.1 * np.cos(4 * T)})
STUDY = """model = "actuator"

[parameters]
"carriage.m" = { guess = 80.0, min = 1.0, max = 1e3 }
"friction.d" = { guess = 100, std = 20.0 }
"friction.f_c" = 0.0
"offset.f" = 0

[[recording]]
file = "record.csv"
role = "fit"
time = "t_s"
inputs = { F = "F_N" }
outputs = { x = { column = "x_m", std = 1e-5 } }
"""
RECORDING = STUDY[STUDY.index("[[recording]]") :]
NOISY = STUDY.replace(", std = 1e-5", "")  # nobody says how noisy the sensor is


@pytest.fixture
def folder(tmp_path) -> Path:
    RECORD.to_csv(tmp_path / "record.csv", index=False)
    return tmp_path


def study(folder: Path, text: str | bytes = STUDY) -> Study:
    (folder / "study.toml").write_bytes(text.encode() if isinstance(text, str) else text)
    return Study.read(folder / "study.toml", label="study.toml")


def swap(old: str, new: str, text: str = STUDY) -> str:
    assert old in text
    return text.replace(old, new)


def refused(folder: Path, text: str | bytes, *words: str) -> str:
    with pytest.raises(InputError) as caught:
        study(folder, text).problem()
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message, f"{word!r} is not in {message!r}"
    return message


# ---------------------------------------------------------------- sound studies


def test_a_study_becomes_the_problem_it_describes(folder):
    problem = study(folder).problem()
    free = problem.parameters["carriage.m"]
    assert isinstance(free, Free)
    assert (free.guess, free.min, free.max, free.std) == (80.0, 1.0, 1e3, None)
    assert problem.parameters["friction.d"].guess == 100.0
    assert problem.parameters["friction.d"].std == 20.0
    assert problem.parameters["friction.f_c"] == 0.0
    (recording,) = problem.recordings
    assert (recording.name, recording.role, recording.output_std) == ("record.csv", "fit", {"x": 1e-5})
    np.testing.assert_allclose(recording.inputs["F"], RECORD["F_N"])
    assert problem.dae.name == "actuator"


def test_bounds_that_are_left_out_are_the_physical_ones(folder):
    problem = study(folder).problem()
    assert problem.parameters["friction.d"].min == 0.0


def test_bounds_beyond_the_physical_ones_arrive_as_given_so_that_a_note_can_tell(folder):
    problem = study(folder, swap("min = 1.0", "min = -3.0", swap("guess = 100,", "guess = 100, max = 1e4,"))).problem()
    assert problem.parameters["carriage.m"] == Free(80.0, min=-3.0, max=1e3)
    assert problem.parameters["friction.d"] == Free(100.0, min=0.0, max=1e4, std=20.0)
    mass = [p.name for p in problem.dae.parameters].index("carriage.m")
    assert problem.parameter_range(mass) == (0.0, 1e3)


@pytest.mark.parametrize(
    "encoded", [STUDY.replace("\n", "\r\n").encode(), b"\xef\xbb\xbf" + STUDY.encode()], ids=["CRLF", "byte order mark"]
)
def test_line_ends_and_byte_order_marks_do_not_matter(folder, encoded):
    assert study(folder, encoded).problem().parameters == study(folder).problem().parameters


def test_names_need_no_quotes(folder):
    text = swap('"carriage.m" =', "carriage.m =", swap('"offset.f"', "offset.f"))
    assert study(folder, text).problem().parameters == study(folder).problem().parameters


def test_weights_are_standard_deviations_or_their_inverse_squares(folder):
    text = NOISY + '\n[weights]\nW = { "carriage" = { weight = 0.25 } }\nV = { x = { std = 3e-6 } }\n'
    weights = study(folder, text).problem().weights
    assert weights.W == {"carriage": 2.0}
    assert weights.V == {"x": 3e-6}


def test_the_noise_of_one_recording_is_named_by_its_file_and_range(folder):
    alone = study(folder, NOISY + '\n[weights]\nV = { "x [record.csv]" = { std = 3e-6 } }\n').problem()
    assert alone.weights.noise("x", alone.recordings[0]) == 3e-6
    own = NOISY[NOISY.index("[[recording]]") :]
    two = own.replace("role", "range = [0.0, 0.9]\nrole") + "\n" + own.replace('"fit"', '"held_out"\nrange = [1.0, 1.9]')
    parts = study(folder, swap(own, two, NOISY) + '\n[weights]\nV = { "x [record.csv [1, 1.9]]" = { std = 3e-6 } }\n').problem()
    assert [parts.weights.noise("x", r) for r in parts.recordings] == [None, 3e-6]


def test_a_noise_that_is_given_twice_alike_is_no_matter(folder):
    twice = study(folder, STUDY + '\n[weights]\nV = { "x" = { weight = 1e10 } }\n').problem()
    assert twice.weights.V["x"] == pytest.approx(twice.recordings[0].output_std["x"], rel=1e-12)


def test_initial_values_and_the_horizon_are_read(folder):
    own = study(folder, STUDY + '\n[initial]\n"carriage.v" = 0.5\n\n[horizon]\nsamples = 50\n')
    assert own.problem().initial == {"carriage.v": 0.5}
    assert own.horizon() == 50
    assert study(folder).horizon() is None


def test_starts_with_a_deviation_and_bounds_of_states_are_read(folder):
    tables = (
        '\n[initial]\n"carriage.s" = { value = 0.1, std = 0.01 }\ncarriage.v = 0.5\n\n[bounds]\n"carriage.s" = { min = 0.0, max = 0.3 }\n'
    )
    own = study(folder, STUDY + tables + "carriage.v = { max = 2.0 }\n")
    assert own.problem().initial == {"carriage.s": Known(0.1, 0.01), "carriage.v": 0.5}
    assert own.problem().bounds == {"carriage.s": (0.0, 0.3), "carriage.v": (-np.inf, 2.0)}
    assert own.initial() == {"carriage.s": 0.1, "carriage.v": 0.5}


def test_parameters_that_drift_or_are_every_recordings_own_are_read(folder):
    text = swap("guess = 100, std = 20.0", "guess = 100, drift = 0.1", swap("max = 1e3", "max = 1e3, per_recording = true"))
    parameters = study(folder, text).problem().parameters
    assert parameters["friction.d"] == Free(100.0, min=0.0, drift=0.1)
    assert parameters["carriage.m"] == Free(80.0, min=1.0, max=1e3, per_recording=True)


def test_coloured_forces_noisy_inputs_and_relaxed_kinematics_are_weights(folder):
    coloured = '"carriage" = { std = 2.0, tau = 0.02, kind = "matern" }'
    text = f'{STUDY}\n[weights]\nW = {{ {coloured}, "kinematics:carriage.s" = {{ std = 1e-3 }} }}\nV = {{ F = {{ weight = 4.0 }} }}\n'
    weights = study(folder, text).problem().weights
    assert weights == Weights(
        W={"carriage": 2.0, "kinematics:carriage.s": 1e-3}, V={"F": 0.5}, tau={"carriage": 0.02}, kind={"carriage": "matern"}
    )


def test_a_horizon_longer_than_the_recording_is_refused(folder):
    with pytest.raises(InputError, match=r"study\.toml, line 17: horizon, samples = 4000 is longer than record\.csv with 400 rows"):
        study(folder, STUDY + "\n[horizon]\nsamples = 4000\n").horizon()


def test_units_delays_and_ranges_reach_the_recording(folder):
    RECORD.assign(x_m=1e3 * RECORD["x_m"], F_N=1e-3 * RECORD["F_N"]).to_csv(folder / "record.csv", index=False)
    text = swap("std = 1e-5", 'std = 1e-5, unit = "mm", delay = 0.005').replace('"F_N"', '{ column = "F_N", unit = "kN" }')
    (recording,) = study(folder, swap('time = "t_s"', 'time = "t_s"\nrange = [0.5, 1.5]\nevery = 2', text)).problem().recordings
    np.testing.assert_allclose(recording.time, T[100:301:2])
    np.testing.assert_allclose(recording.inputs["F"], RECORD["F_N"][100:301:2])
    np.testing.assert_allclose(recording.outputs["x"], RECORD["x_m"][101:302:2])


def test_one_file_may_be_fitted_and_held_out_in_different_ranges(folder):
    two = RECORDING.replace("role", "range = [0.0, 0.9]\nrole") + "\n" + RECORDING.replace('"fit"', '"held_out"\nrange = [1.0, 1.9]')
    problem = study(folder, STUDY.replace(RECORDING, two)).problem()
    assert [r.name for r in problem.recordings] == ["record.csv [0, 0.9]", "record.csv [1, 1.9]"]
    assert [r.role for r in problem.recordings] == ["fit", "held_out"]


def test_a_model_may_come_from_a_file_beside_the_study(folder):
    (folder / "helper.py").write_text("MASS = 42.0\n")
    (folder / "plant.py").write_text(
        "from backsight.models.plants import actuator\nfrom helper import MASS\n\n"
        "def machine():\n    return actuator().with_values(carriage={'m': MASS})\n"
    )
    own = study(folder, swap('"actuator"', '"plant.py:machine"'))
    assert {p.name: p.value for p in own.dae.parameters}["carriage.m"] == 42.0
    assert not (folder / "__pycache__").exists()


# ---------------------------------------------------------------- unsound studies


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (swap("[parameters]", "[parameters"), ("study.toml", "TOML", "line 3")),
        ("", ("study.toml", '"model"', "missing")),
        (STUDY.replace('"actuator"', '"actuator" # é').encode("latin-1"), ("study.toml", "line 1", "0xe9", "UTF-8")),
        (swap('"actuator"', '"actuatr"'), ("study.toml, line 1", '"actuatr"', "did you mean 'actuator'")),
        (swap('"actuator"', "7"), ("study.toml, line 1", "model is 7", "text in quotes")),
        (swap('"carriage.m"', '"carriage.mass"'), ("line 4", '"carriage.mass"', "did you mean 'carriage.m'")),
        (STUDY + "\n[wieghts]\nV = { x = { std = 1e-5 } }\n", ("line 16", '"wieghts"', "did you mean 'weights'")),
        (swap('time = "t_s"', 'tiem = "t_s"'), ("line 12", '"tiem"', "did you mean 'time'")),
        (swap('time = "t_s"\n', ""), ('"time"', "recording 1", "missing", 'time = "t_s"')),
        (swap("guess = 80.0", "gess = 80.0"), ("line 4", '"gess"', '"carriage.m"', "did you mean 'guess'")),
        (swap("guess = 80.0, ", ""), ("line 4", '"guess"', '"carriage.m"', "missing")),
        (swap('role = "fit"', 'role = "training"'), ("line 11", "role", '"training"', "'held_out'")),
        (STUDY.replace(RECORDING, ""), ("no recording", "[[recording]]")),
        (swap('role = "fit"', 'role = "held_out"'), ('role = "fit"',)),
        (swap("guess = 80.0", 'guess = "eighty"'), ("line 4", '"carriage.m"', '"eighty"', "number")),
        (swap("guess = 80.0", "guess = true"), ('"carriage.m"', "true", "number")),
        (swap("guess = 80.0", "guess = nan"), ('"carriage.m"', "nan", "finite")),
        (swap('"offset.f" = 0', '"offset.f" = inf'), ("line 7", '"offset.f"', "inf", "finite")),
        (swap('"offset.f" = 0', '"offset.f" = "none"'), ("line 7", '"offset.f"', '"none"', "number")),
        (swap("min = 1.0", "min = 90.0"), ("line 4", '"carriage.m"', "guess = 80", "min = 90")),
        (swap("min = 1.0, max = 1e3", "min = 1e3, max = 1.0"), ('"carriage.m"', "min = 1000", "max = 1")),
        (swap("guess = 80.0, min = 1.0", "guess = -80.0"), ('"carriage.m"', "guess = -80", "below")),
        (swap("guess = 80.0", "guess = 80.0, std = -1.0"), ('"carriage.m"', "std", "-1.0", "greater than 0")),
        (swap("guess = 100,", "guess = 0, min = -1, max = 0,"), ("line 5", '"friction.d"', "max = 0 leaves nothing but 0 N.s/m")),
        (swap("std = 1e-5", "std = -1e-5"), ("line 14", "std", "x", "-1e-05")),
        (swap("std = 1e-5", "std = 0.0"), ("std", "x", "0.0", "leave it out where nobody knows it")),
        (swap("{ guess = 80.0, min = 1.0, max = 1e3 }", "-80.0"), ('"carriage.m"', "-80", "below", "kg")),
        (
            swap("std = 1e-5", 'std = 1e-5, unit = "furlongz"'),
            ('study.toml, line 14: recording 1, outputs, x, column "x_m"', '"furlongz" is not known; write one of "m", "mm"'),
        ),
        (swap('time = "t_s"', 'time = { column = "t_s", unit = "milisec" }'), ("line 12: recording 1, time", '"milisec"', '"s", "ms"')),
        (swap('"F_N"', '{ column = "F_N", unit = "Nm" }'), ("line 13: recording 1, inputs, F", '"Nm"', 'one of "N", "mN"')),
        (swap("std = 1e-5", 'std = 1e-5, unit = "kg"'), ("line 14", "x_m", '"kg"', "converted to m")),
        (swap("{ F =", "{ force ="), ("line 13", 'input "force"', "F")),
        (swap('inputs = { F = "F_N" }', "inputs = {}"), ("line 13", 'input "F"', "actuator", "no column")),
        (swap('inputs = { F = "F_N" }\n', ""), ('input "F"', "record.csv")),
        (swap("{ x = {", "{ x_motor = {"), ("line 14", 'output "x_motor"', "x")),
        (swap('{ x = { column = "x_m", std = 1e-5 } }', "{}"), ("no output",)),
        (swap('"x_m"', '"pos_m"'), ("record.csv, line 1", '"pos_m"')),
        (swap("record.csv", "nowhere.csv"), ("nowhere.csv", "no such file", "record.csv")),
        (swap('time = "t_s"', 'time = "t_s"\nrange = [1.5, 0.5]'), ("line 13", "range", "[1.5, 0.5]", "earlier one first")),
        (swap('time = "t_s"', 'time = "t_s"\nrange = [1.0]'), ("range", "[1.0]", "too few")),
        (swap('time = "t_s"', 'time = "t_s"\nrange = [50.0, 60.0]'), ("record.csv", "range", "0 to 1.995")),
        (swap('time = "t_s"', 'time = "t_s"\nevery = 0'), ("every is 0", "at least 1")),
        (swap('time = "t_s"', 'time = "t_s"\nevery = 1.5'), ("every is 1.5", "whole number")),
        (swap('time = "t_s"', 'time = "t_s"\nhold = "cubic"'), ("hold", '"cubic"', "'linear'")),
        (swap("std = 1e-5", "std = 1e-5, delay = -1.0"), ("delay", "-1.0")),
        (STUDY + '\n[weights]\nW = { "carrige" = { std = 2.0 } }\n', ("line 17", 'place "carrige"', "did you mean 'carriage'")),
        (STUDY + '\n[weights]\nW = { "carriage" = { std = -2.0 } }\n', ("carriage", "std", "-2.0")),
        (STUDY + '\n[weights]\nW = { "carriage" = { std = 2.0, weight = 1.0 } }\n', ("carriage", "not both")),
        (STUDY + '\n[weights]\nW = { "carriage" = {} }\n', ("carriage", "either std or weight")),
        (
            STUDY + '\n[weights]\nW = { "carriage" = 2.0 }\n',
            ("line 17", "carriage is 2.0", "a table is wanted, as in carriage = { std = 2.0 }"),
        ),
        (STUDY + "\n[weights]\nV = { x = 0.1 }\n", ("line 17: weights, V, x is 0.1", "as in x = { std = 0.1 }")),
        (STUDY + "\n[weights]\nV = 0.1\n", ("line 17: weights, V is 0.1", 'as in V = { "output" = { std = 0.1 } }')),
        ("V = { x = 0.1 }\n" + STUDY, ('line 1: unknown key "V"', 'under [weights], as in V = { "output" = { std = 0.1 } }')),
        (STUDY + "V = { x = 0.1 }\n", ('line 15: unknown key "V" in recording 1', "under [weights], as in V")),
        (swap("guess = 80.0", 'guess = 80.0, unit = "g"'), ("line 4", 'unknown key "unit"', "that of the model", "leave this out")),
        (swap("guess = 80.0", "value = 80.0"), ("line 4", 'unknown key "value"', "write guess, or a bare number")),
        (
            swap("guess = 80.0", 'guess = 80.0, per_recording = "yes"'),
            ("line 4", 'per_recording is "yes"; true or false is wanted, without quotes'),
        ),
        (STUDY + 'unit = "ms"\n', ('line 15: unknown key "unit" in recording 1', 'time = { column = "t_ms", unit = "ms" }')),
        (STUDY + "delay = 0.1\n", ('line 15: unknown key "delay" in recording 1', 'x = { column = "x_m", delay = 0.001 }')),
        (
            swap("std = 1e-5 }", 'std = 1e-5 }, unit = "mm"'),
            ('line 14: unknown output "unit"', 'said of a column, as in x = { column = "x_mm"'),
        ),
        (
            swap('{ column = "x_m", std = 1e-5 }', '"x_m", std = 1e-5'),
            ("line 14: recording 1, outputs, std is 1e-05", "it is said of a column"),
        ),
        (swap('{ F = "F_N" }', '"F_N"'), ('line 13: recording 1, inputs is "F_N"', 'as in inputs = { x = "x_m" }')),
        (swap("[[recording]]", "[recording]"), ("line 9: recording is", "write [[recording]], in double brackets")),
        (
            STUDY + '\n[bounds]\n"carriage.s" = [0, 1]\n',
            ('line 17: bounds, "carriage.s" is [0, 1]', '"carriage.s" = { min = 0.0, max = 1.0 }'),
        ),
        (STUDY + '\n[weights]\nW = { "carriage" = { std = 2.0, kind = "ou" } }\n', ("line 17", 'kind = "ou"', "give tau in seconds")),
        (STUDY + '\n[weights]\nW = { "carriage" = { std = 2.0, tau = 1, kind = "red" } }\n', ("line 17", '"red"', "'ou' or 'matern'")),
        (STUDY + '\n[weights]\nW = { "kinematics:carriage.v" = { std = 2.0 } }\n', ("line 17", "did you mean 'kinematics:carriage.s'?")),
        (swap("std = 20.0", "drift = -1.0"), ("line 5", "drift is -1.0", "greater than 0")),
        (swap("std = 20.0", "drift = 1.0, per_recording = true"), ("line 5", "leave per_recording out")),
        (STUDY + '\n[initial]\n"carriage.s" = { std = 0.1 }\n', ("line 17", '"value"', "is missing; add it, as in value = 0.0")),
        (STUDY + '\n[initial]\n"carriage.s" = { value = 0.0, mean = 1 }\n', ('unknown key "mean"', "known: value, std")),
        (STUDY + '\n[bounds]\n"carriage.s" = { min = 1.0, max = 0.0 }\n', ("line 17", "min = 1 is not below max = 0")),
        (STUDY + "\n[initial]\ncarriage.v = 0.5\n\n[bounds]\ncarriage.v = { min = 1.0 }\n", ("line 20", "value 0.5", "(min = 1)")),
        (STUDY + "\n[initial]\ncarriage.v = 2\n\n[bounds]\ncarriage.v = { max = 1.0 }\n", ("line 20", "value 2", "(max = 1)")),
        (
            STUDY + '\n[bounds]\n"carriage.s" = { min = 1.0 }\n',
            (
                "line 17",
                '"carriage.s", min = 1 m',
                'all samples of column "x_m" of record.csv',
                "lie below: -0.1 .. 0.1 m; give other bounds",
            ),
        ),
        (
            STUDY + '\n[weights]\nV = { "x" = { std = 2e-5 } }\n',
            ("line 17", "V, x, std is 2e-05", "std of x", "is 1e-05 (line 14)", "leave one"),
        ),
        (
            STUDY + '\n[weights]\nV = { "x [record.csv]" = { weight = 1e8 } }\n',
            ("V, x [record.csv], std is 0.0001", "(line 14); leave one out"),
        ),
        (STUDY + '\n[bounds]\n"carriage.x" = { min = 1.0 }\n', ("line 17", 'unknown state "carriage.x"')),
        (STUDY + '\n[weights]\nV = { "speed" = { std = 2.0 } }\n', ('output or input "speed"', "x")),
        (
            STUDY + '\n[weights]\nV = { "x [rec.csv]" = { std = 2.0 }, "x [record.csv]" = { std = 1.0 } }\n',
            ("line 17", 'recording "rec.csv"'),
        ),
        (STUDY + '\n[weights]\nV = { "x" = { std = 2.0, tau = 1.0 } }\n', ("tau", "white")),
        (STUDY + '\n[initial]\n"carriage.speed" = 0.0\n', ("line 17", 'state "carriage.speed"', "carriage.s")),
        (STUDY + "\n[horizon]\nsamples = -5\n", ("horizon", "samples", "-5")),
        (STUDY + '\n[horizon]\nsamples = "ten"\n', ("horizon", "samples", '"ten"', "integer")),
        (STUDY + RECORDING.replace('"fit"', '"held_out"'), ("record.csv", '"fit"', '"held_out"')),
        (STUDY + RECORDING, ("record.csv", "twice")),
        (STUDY + RECORDING.replace("record.csv", "./record.csv"), ("record.csv", "twice")),
    ],
)
def test_an_unusable_study_is_refused_by_one_sentence(folder, text, words):
    assert len(refused(folder, text, *words)) < 500


@pytest.mark.parametrize(
    ("source", "name", "words"),
    [
        ("x = 1\n", "nowhere.py:machine", ("no file nowhere.py", "did you mean 'plant.py'")),
        ("def engine():\n    return 1\n", "plant.py:machine", ("machine does not exist", "engine")),
        ("machine = 1\n", "plant.py:machine", ("machine is not a function",)),
        ("def machine():\n    raise ValueError('no such gearbox 42')\n", "plant.py:machine", ("plant.py, line 2", "no such gearbox 42")),
        ("import nothing_like_this\n", "plant.py:machine", ("plant.py, line 1", "nothing_like_this")),
        ("def machine():\n    return (1\n", "plant.py:machine", ("plant.py, line 2",)),
        ("raise SystemExit(3)\n", "plant.py:machine", ("plant.py, line 1", "SystemExit")),
        ("def machine():\n    return 42\n", "plant.py:machine", ("machine()", "42", "int", "Model")),
        ("def machine(size):\n    return size\n", "plant.py:machine", ("machine", "size")),
        ("x = 1\n", "plant.py", ("plant.py", "function")),
        ("x = 1\n", "axis.mo:Axis", ('"axis.mo:Axis"', "there is no file")),
    ],
)
def test_a_fault_in_a_model_file_is_reported_with_file_and_line(folder, source, name, words):
    (folder / "plant.py").write_text(source)
    refused(folder, swap('"actuator"', f'"{name}"'), "study.toml, line 1", *words)


def test_a_model_that_does_not_balance_is_bad_input(folder):
    (folder / "plant.py").write_text(
        "from backsight.models import Model\nfrom backsight.models.mechanics.translational import Mass\n\n"
        "def machine():\n    return Model(name='loose', components={'a': Mass(m=1.0)}, connections=(('a.flange', 'b.flange'),))\n"
    )
    refused(folder, swap('"actuator"', '"plant.py:machine"'), "study.toml, line 1", "plant.py", "b")


def test_a_missing_study_names_the_one_beside_it(folder):
    (folder / "study.toml").write_text(STUDY)
    with pytest.raises(InputError, match=r"studdy\.toml: no such study; did you mean 'study\.toml'"):
        Study.read(folder / "studdy.toml")


def test_gap_hold_loss_and_delay_of_a_recording_arrive_in_the_problem(folder):
    text = swap(
        'time = "t_s"', 'time = "t_s"\ngap = 0.5\nhold = "auto"\nclock_std = 1e-4', swap("std = 1e-5", 'loss = "huber", delay = "estimate"')
    )
    (recording,) = study(folder, text).recordings
    assert (recording.gap, recording.hold, recording.open_hold, recording.clock_std) == (0.5, "zero", True, 1e-4)
    assert (recording.output_loss, recording.open_delays) == ({"x": "huber"}, ("x",))
    problem = study(folder, text).problem()
    assert problem.parameters["delay:x"] == Free(0.0, min=0.0)
    assert problem.dae.parameters[-1].name == "delay:x"


@pytest.mark.parametrize(
    ("new", "words"),
    [
        ('delay = "auto"', ('outputs, x, delay is "auto"', "'estimate' or a number of seconds")),
        ("delay = -1.0", ("outputs, x, delay is -1.0", "at least 0")),
        ('loss = "student"', ('loss is "student"', "'square', 'huber' or 'auto'")),
    ],
)
def test_a_delay_or_loss_that_there_is_not_is_refused(folder, new, words):
    refused(folder, swap("std = 1e-5", new), "study.toml, line 14", *words)


@pytest.mark.parametrize("delay", ['"auto"', "0.1"])
def test_a_delay_of_an_input_is_estimated_or_given_to_the_outputs(folder, delay):
    text = swap('"F_N"', f'{{ column = "F_N", delay = {delay} }}')
    refused(folder, text, f"study.toml, line 13: recording 1, inputs, F, delay is {delay}", "'estimate', for all", "to every output")


# ---------------------------------------------------------------- excitation


def recording(u: np.ndarray, y: np.ndarray) -> Recording:
    return Recording(name="r.csv", time=T, inputs={"F": u}, outputs={"x": y})


def test_constant_inputs_over_a_plant_at_rest_teach_nothing():
    noise = 1e-5 * np.random.default_rng(0).standard_normal(400)
    for y in (np.full(400, 0.01), 0.01 + noise, noise):
        with pytest.raises(InputError, match=r"every input is constant \(F = 5 throughout r\.csv\)"):
            check_excitation([recording(np.full(400, 5.0), y)], label="study.toml")


@pytest.mark.parametrize(
    ("free", "told"),
    [("offset.f", True), ("spring.k", True), ("mass.m", False), ("damper.d", False)],
)
def test_a_plant_at_rest_tells_what_it_leans_on_and_nothing_of_what_moves(free, told):
    """k s = -offset: a spring and a constant force are felt at rest, a mass and a damper are not."""
    at_rest = recording(np.zeros(400), -0.014 + 1e-4 * np.random.default_rng(0).standard_normal(400))
    dae = compile_model(oscillator())
    assert told_at_rest(dae, [free], {}, [at_rest]) == [free] * told
    if told:
        check_excitation([at_rest], label="study.toml", told=lambda: [free])


def test_an_axis_that_sticks_tells_no_inertia_and_no_friction():
    """Held by a constant force below its friction, an axis that could rest anywhere."""
    still = recording(np.full(400, 5.0), np.zeros(400))
    free = ["carriage.m", "friction.d", "friction.f_c"]
    assert told_at_rest(compile_model(actuator()), free, {"friction.f_c": 20.0}, [still]) == []
    assert told_at_rest(compile_model(actuator()), free, {"friction.f_c": 0.0}, [still]) == []


def test_a_changing_input_or_a_plant_that_moves_under_a_constant_one_will_do():
    noise = 1e-3 * np.random.default_rng(0).standard_normal(400)
    check_excitation([recording(np.sin(T), np.zeros(400))], label="study.toml")
    check_excitation([recording(np.zeros(400), 0.1 * np.cos(6 * T) + noise)], label="study.toml")
    check_excitation([recording(np.full(400, 5.0), 1 - np.exp(-T) + noise)], label="study.toml")


# ---------------------------------------------------------------- lines


def test_the_line_of_a_key_is_found_where_it_stands():
    text = '# x = 1\nmodel = "m"\n[[recording]]\nfile = "a"\n[[recording]]\n# file\nfile = "b"\noutputs = { x = { std = 1 } }\n'
    assert line_of(text, ["model"]) == 2
    assert line_of(text, ["recording", 0, "file"]) == 4
    assert line_of(text, ["recording", 1, "file"]) == 7
    assert line_of(text, ["recording", 1, "outputs", "x", "std"]) == 8
    assert line_of(text, ["weights"]) is None


@pytest.mark.parametrize(
    "above",
    [
        '# "carriage.m" is told, see [parameters]\n',
        "# 'carriage.m' = 1, parameters\n",
        'model = "a # b" # [parameters] "carriage.m"\n',
        'model = "parameters carriage.m"\n',
        "model = 'C:\\parameters carriage.m'\n",
        'model = "a\\"parameters carriage.m"\n',
        'model = """\nparameters\n# carriage.m """\n',
    ],
)
def test_neither_a_comment_nor_a_value_is_taken_for_a_key(above):
    text = above + '[parameters]\n"friction.d" = 1.0 # "carriage.m" = 2\n"carriage.m" = { guess = 1.0 }\n'
    assert line_of(text, ["parameters", "carriage.m"]) == above.count("\n") + 3
    assert line_of(text, ["parameters", "friction.d"]) == above.count("\n") + 2


def test_a_row_on_which_one_range_ends_and_another_begins_belongs_to_the_later(folder):
    two = RECORDING.replace("role", "range = [0.0, 1.0]\nrole") + "\n" + RECORDING.replace('"fit"', '"held_out"\nrange = [1.0, 1.9]')
    fitted, held_out = study(folder, swap(RECORDING, two)).recordings
    assert fitted.time[-1] == pytest.approx(0.995)
    assert held_out.time[0] == 1.0
    assert fitted.name.endswith("[0, 1]")


def test_the_delay_that_a_recording_asks_for_may_be_bounded(folder):
    text = swap("std = 1e-5", 'std = 1e-5, delay = "estimate"')
    assert study(folder, text).problem().parameters["delay:x"].min == 0.0
    own = text.replace("[parameters]", '[parameters]\n"delay:x" = { guess = 0.0, min = -0.01, max = 0.05 }')
    asked = study(folder, own)
    assert asked.problem().parameters["delay:x"].min == -0.01
    assert "delay:x" not in asked.values()
    with pytest.raises(InputError, match='unknown parameter "delay:x"'):
        study(folder, own.replace(', delay = "estimate"', "")).problem()


def test_commands_are_cut_off_at_the_limits_of_their_input(folder):
    posed = study(folder, swap('{ F = "F_N" }', '{ F = { column = "F_N", limits = [-30.0, 20] } }')).problem()
    np.testing.assert_allclose(posed.recordings[0].inputs["F"], np.clip(RECORD["F_N"], -30.0, 20.0))
    refused(folder, swap('{ F = "F_N" }', '{ F = { column = "F_N", limits = [20, -30] } }'), "limits of input F", "the least comes first")
