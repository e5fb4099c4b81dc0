"""The pages: everything in one file, every number and unit on it, and the curves are the data. Results are made by hand from formulas."""

import base64
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import pytest

from backsight.estimation.problem import Weights
from backsight.estimation.recordings.recording import Recording
from backsight.estimation.report import write_report, write_simulation_report
from backsight.estimation.results import (
    Companion,
    Criteria,
    OutputFit,
    ParameterEstimate,
    Profile,
    ResidualSummary,
    Smoothing,
    SolverFacts,
    Trimmed,
)

NAME = "axis <1>.csv"
UNITS = {"t_s": "s", "x": "m", "carriage.s": "m", "carriage.v": "m/s", "residual.carriage": "N", "F": "N"}


SOLVER = SolverFacts(
    status="Solved to the requested accuracy.", converged=True, iterations=7, seconds=0.83, build_seconds=1.25, variables=12_345
)


def estimate(name: str, value: float, unit: str, **more: Any) -> ParameterEstimate:
    return ParameterEstimate(name=name, value=value, unit=unit, **({"std": None, "fixed": False, "identifiable": True} | more))


@pytest.mark.parametrize(
    ("value", "std", "written"),
    [
        (95.01149, 0.0271, "95.011 ± 0.027 kg"),
        (1234567.8, 20.0, "1234568 ± 20 kg"),
        (3.2e136, 4.1e140, "3.2e+136 ± 4.1e+140 kg"),
        (4.2e-9, 3.1e-12, "4.2000e-09 ± 3.1e-12 kg"),
        (-4.00040e-5, 3.7e-9, "-4.00040e-05 ± 3.7e-09 kg"),
        (0.00150001, 3e-8, "0.001500010 ± 3.0e-08 kg"),
        (0.0, 3e-18, "0.000000000000000 ± 3.0e-18 kg"),
        (-4.8662, 0.0701, "-4.866 ± 0.070 kg"),
        (94997.13, 4.02, "94997.1 ± 4.0 kg"),
        (20.0321, 0.0996, "20.03 ± 0.10 kg"),
        (1324.4, 12120.2, "1300 ± 12000 kg"),
        (52.33, 264.0, "52 ± 260 kg"),
        (-8847.797, 131.0, "-8850 ± 130 kg"),
        (2211474.47, 20437256.9, "2.2e+06 ± 2.0e+07 kg"),
        (2.87454e22, None, "2.87e+22 kg (not determined)"),
    ],
)
def test_an_estimate_is_written_to_the_digits_of_its_deviation_and_no_longer(value, std, written):
    assert str(estimate("body.m", value, "kg", std=std)) == written


PARAMETERS = {
    p.name: p
    for p in (
        estimate(name="carriage.m", value=95.0131, std=0.0213, unit="kg"),
        estimate(name="friction.d", value=199.87, std=0.231, unit="N.s/m"),
        estimate(name="friction.f_c", value=20.0321, std=0.0412, unit="N"),
        estimate(name="offset.f", value=-3.0052, std=0.0112, unit="N"),
        estimate(name="friction.width", value=1e-3, unit="m/s", fixed=True, identifiable=None),
    )
}


def made(n: int = 2000, names: tuple[str, ...] = (NAME,), dry: float = 0.0) -> tuple[Smoothing, list[Recording]]:
    """A sine of 1.5 rad/s with 1 um of white noise; the residual is `dry` times the sign of the velocity, and noise of 0.3 N."""
    frames, inputs, recordings, fit = {}, {}, [], {}
    for k, name in enumerate(names):
        rng = np.random.default_rng(k)
        t = np.arange(n) * 1e-2
        s, v = 0.2 * np.sin(1.5 * t), 0.3 * np.cos(1.5 * t)
        x, w = s + 1e-6 * rng.standard_normal(n), dry * np.sign(v) + 0.3 * rng.standard_normal(n)
        frames[name] = pd.DataFrame({"t_s": t, "x": s, "x.measured": x, "x.std": np.full(n, 2e-7)})
        for column, values, std in (("carriage.s", s, 2e-7), ("carriage.v", v, 1e-3), ("residual.carriage", w, 0.3)):
            frames[name][column], frames[name][f"{column}.std"] = values, np.full(n, std)
        inputs[name] = {"F": 100 * np.sin(1.5 * t)}
        recordings.append(Recording(name=name, time=t, inputs=inputs[name], outputs={"x": x}, output_std={"x": 1e-6}))
        fit[name] = {"x": OutputFit(rms=1.01e-6, fit_percent=99.9986, whiteness_p=0.31)}
    result = Smoothing(
        model="actuator",
        parameters=PARAMETERS,
        estimates=frames,
        inputs=inputs,
        units=UNITS,
        fit=fit,
        weights=Weights(W={"carriage": 0.0123}, V={"x": 1.04e-6}),
        solver=SOLVER,
        notes=("W of carriage was chosen by its evidence.",),
        residual_places={"carriage": ResidualSummary(place="carriage", unit="N", rms=0.3, origin="force balance of carriage")},
    )
    return result, recordings


class Page(HTMLParser):
    """What a browser would see: elements, text outside of scripts and styles, the charts' data."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text, self.charts, self.styles = "", [], ""
        self._inside, self._kind = "", ""
        source = path.read_text(encoding="utf-8")
        self.size = path.stat().st_size
        self.feed(source)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag in {"script", "style"}:
            self._inside, self._kind = tag, dict(attrs).get("type") or ""

    def handle_endtag(self, tag: str) -> None:
        self._inside = "" if tag in {"script", "style"} else self._inside

    def handle_data(self, data: str) -> None:
        if self._inside == "script" and self._kind == "application/json":
            self.charts.append(json.loads(data))
        elif self._inside == "style":
            self.styles += data
        elif not self._inside:
            self.text += data

    def trace(self, name: str, which: int = 0) -> tuple[np.ndarray, np.ndarray]:
        traces = [t for c in self.charts for t in c["data"] if t["name"].startswith(name) and t.get("line", {}).get("width") != 0]
        return unpacked(traces[which]["x"]), unpacked(traces[which]["y"])


def unpacked(array: dict[str, Any]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(array["bdata"]), dtype={"f4": "<f4", "f8": "<f8"}[array["dtype"]])


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Page:
    result, recordings = made()
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_report(result, path, recordings=recordings)
    return Page(path)


def test_the_page_loads_nothing_from_elsewhere(page: Page) -> None:
    assert not {tag for tag, _ in page.elements} & {"link", "img", "iframe", "object", "embed", "base", "video", "audio", "source", "form"}
    for tag, attributes in page.elements:
        assert "src" not in attributes, tag
        assert attributes.get("href", "#").startswith("#"), tag  # type: ignore[union-attr]
    assert "url(" not in page.styles
    assert "@import" not in page.styles
    policy = next(a["content"] for t, a in page.elements if t == "meta" and a.get("http-equiv") == "Content-Security-Policy")
    assert policy is not None
    assert policy.startswith("default-src 'none'")
    assert "http" not in policy


def test_every_parameter_is_listed_with_value_uncertainty_and_unit(page: Page) -> None:
    text = page.text
    for name in PARAMETERS:
        assert name in text
    for shown in ("95.013 ± 0.021 kg", "199.87 ± 0.23 N·s/m", "20.032 ± 0.041 N", "−3.005 ± 0.011 N"):
        assert shown in text
    for shown in ("m/s", "fixed", "estimated", "0.022 %"):
        assert shown in text


def test_what_stands_in_for_friction_near_rest_is_said_apart(tmp_path: Path) -> None:
    result, recordings = made()
    place = replace(result.residual_places["carriage"], rest_share=0.0251, rest_rms=8.2)
    write_report(replace(result, residual_places={"carriage": place}), tmp_path / "r.html", recordings=recordings)
    text = Page(tmp_path / "r.html").text
    assert re.search(r"Unexplained: 0\.3 N rms at carriage, .* rms\) \(and 8\.2 N rms in the 2\.5 % of the samples near rest, where", text)


def test_correlations_are_shown_below_the_diagonal(tmp_path: Path) -> None:
    result, recordings = made()
    names = ["carriage.m", "friction.d", "offset.f"]
    matrix = np.array([[1.0, -0.873, 0.004], [-0.873, 1.0, 0.125], [0.004, 0.125, 1.0]])
    write_report(replace(result, correlation=pd.DataFrame(matrix, names, names)), tmp_path / "r.html", recordings=recordings)
    page = Page(tmp_path / "r.html").text
    shown = page[page.index("correlation") :]
    assert re.search(r"^correlation\s*carriage.m\s*friction.d\s*friction.d\s*−0.87\s*offset.f\s*0.00\s*0.12", shown), shown[:200]


def test_the_words_say_how_well_it_fits_and_that_nothing_is_odd(page: Page) -> None:
    assert "x is met to 1.01 µm rms (fit 99.9986 %)" in page.text
    force = f"{np.sqrt(np.mean(made()[0].inputs[NAME]['F'] ** 2)):.3g}"
    assert f"Unexplained: 0.3 N rms at carriage, 0.42 % of the input F ({force} N rms)" in page.text
    assert "Nothing looks odd" in page.text
    assert "cannot be told from white noise" in page.text


def test_outliers_that_a_loss_left_out_are_counted_apart_and_spoil_no_figure(tmp_path: Path) -> None:
    result, recordings = made()
    frame = result.estimates[NAME].copy()
    frame.loc[[100, 900], "x.measured"] += 0.5
    fit = OutputFit(rms=0.0158, fit_percent=88.8, whiteness_p=0.31, trimmed=Trimmed(rms=1.01e-6, fit_percent=99.9986, outliers=2))
    write_report(replace(result, fit={NAME: {"x": fit}}, estimates={NAME: frame}), tmp_path / "page.html", recordings=recordings)
    text = Page(tmp_path / "page.html").text
    assert "x is met to 1.01 µm rms (fit 99.9986 %) without 2 outliers" in text
    assert "outliers left out" in text
    assert "15.8 mm (88.8 %)" in text
    assert "times the noise it was weighed with" not in text
    assert "2 samples of x lie more than six robust standard deviations off." in text


def test_weights_rules_and_solver_facts_are_on_the_page(page: Page) -> None:
    for shown in ("12.3 mN", "1.04 µm", "W of carriage was chosen by its evidence.", SOLVER.status, "12\u202f345", "0.83 s"):
        assert shown in page.text


def test_every_axis_has_its_unit_in_brackets(page: Page) -> None:
    titles = [axis["title"]["text"] for c in page.charts for key, axis in c["layout"].items() if re.match("[xy]axis", key)]
    assert titles
    assert all(re.search(r"\[[^\]]+\]$", t) for t in titles), titles
    expected = {
        "time [s]",
        "x [m]",
        "error [µm]",
        "residual carriage [N]",
        "carriage.v [m/s]",
        "carriage.s [m]",
        "F [N]",
    }
    assert expected <= set(titles)
    assert any(re.fullmatch(r"lag of [\d.]+ ms \[samples\]", t) for t in titles)


def test_the_drawing_library_knows_every_attribute_of_every_chart(page: Page) -> None:
    assert len(page.charts) == 6
    for chart in page.charts:
        go.Figure(chart)  # raises on an unknown name or a value of the wrong kind


def test_the_curves_are_the_numbers_of_the_recording(page: Page) -> None:
    result, recordings = made()
    frame = result.estimates[NAME]
    t, x = page.trace("measured")
    assert t == pytest.approx(recordings[0].time, rel=1e-6)
    assert x == pytest.approx(recordings[0].outputs["x"], abs=1e-8)
    error = (frame["x.measured"] - frame["x"]).to_numpy() * 1e6
    assert page.trace("error")[1] == pytest.approx(error, abs=1e-6)
    assert page.trace("residual at")[1] == pytest.approx(frame["residual.carriage"].to_numpy(), abs=1e-6)


def test_the_band_holds_95_percent_and_the_noise_lines_are_two_deviations(page: Page) -> None:
    traces = next(c["data"] for c in page.charts if any(t["name"].startswith("residual at") for t in c["data"]))
    around, middle = (unpacked(t["y"]) for t in traces)
    low, high = around[: middle.size], around[middle.size : -1][::-1]
    assert np.isnan(around[-1])
    assert high - middle == pytest.approx(np.full(middle.size, 1.96 * 0.3), rel=1e-4)
    assert middle - low == pytest.approx(np.full(middle.size, 1.96 * 0.3), rel=1e-4)
    assert page.trace("±2 std")[1] == pytest.approx([2.08, 2.08], rel=1e-6)  # µm


def test_a_residual_that_follows_the_sign_of_the_velocity_is_said_to(tmp_path: Path) -> None:
    result, recordings = made(dry=2.0)
    seen = Companion(what="the sign of carriage.v", law="dry friction", correlation=0.98, std=0.01)
    places = {"carriage": replace(result.residual_places["carriage"], follows=seen)}
    write_report(replace(result, residual_places=places), tmp_path / "r.html", recordings=recordings)
    text = Page(tmp_path / "r.html").text
    assert "The residual force at carriage goes with the sign of carriage.v (r = 0.98)" in text
    assert "dry friction" in text
    assert "Nothing looks odd" not in text


def test_a_parameter_that_is_small_and_may_be_nothing_is_no_open_question(tmp_path: Path) -> None:
    result, recordings = made()
    small = estimate("friction.f_c", 3e-3, "N", std=4e-3, identifiable=False, guess=10.0)
    unknown = estimate("friction.f_v", 3.0, "N", std=40.0, identifiable=False, guess=10.0)
    gone = estimate("link.k", 3e-13, "N.m/rad", std=20.0, identifiable=False, guess=25.0)
    assert str(small).endswith("(not told from 0)")
    for guess in (0.0, 5e-3):  # what may have either sign is small beside its size, wherever it was guessed
        assert str(replace(small, guess=guess, size=1.0)).endswith("(not told from 0)")
        assert str(replace(small, guess=guess)).endswith("(not determined)")
    assert str(unknown).endswith("(not determined)")
    write_report(
        replace(result, parameters={**result.parameters, "friction.f_c": small, "friction.f_v": unknown, "link.k": gone}),
        tmp_path / "r.html",
        recordings=recordings,
    )
    text = Page(tmp_path / "r.html").text
    assert "friction.f_c cannot be told from 0" in text
    assert "The data do not determine friction.f_v: its value is that of its guess" in text
    assert "The data do not determine link.k: it ran towards 0" in text


def test_errors_with_a_memory_are_said_to_have_one(tmp_path: Path) -> None:
    result, recordings = made()
    fit = {NAME: {"x": replace(result.fit[NAME]["x"], whiteness_p=1e-30, effective_samples=87.2, samples=2000)}}
    write_report(replace(result, fit=fit), tmp_path / "r.html", recordings=recordings)
    text = Page(tmp_path / "r.html").text
    assert "The prediction errors of x are not white: 87 effective of 2\u202f000 samples." in text
    assert "structure is left in them: 87 effective" in text


def test_profiles_and_criteria_are_shown(tmp_path: Path) -> None:
    result, recordings = made()
    values = np.linspace(94.97, 95.06, 7)
    closed = Profile(
        name="carriage.m",
        unit="kg",
        estimate=95.0,
        std=0.02,
        values=values,
        cost=((values - 95.0) / 0.02) ** 2 / 2,
        lower=94.97,
        upper=95.06,
    )
    half = replace(closed, name="friction.d", unit="N.s/m", upper=None, limited=("upper",), std=None)
    criteria = Criteria(log_evidence=None, log_likelihood=12.5, aic=-20.25, bic=-10.5, effective_parameters=7.5, samples=2000)
    shown = replace(result, profiles={p.name: p for p in (closed, half)}, criteria=criteria)
    write_report(shown, tmp_path / "r.html", recordings=recordings)
    page = Page(tmp_path / "r.html")
    for text in ("Profile likelihood", "94.97", "95.06", "open", "a bound, at the upper end", "−20.25", "effective parameters"):
        assert text in page.text
    x, y = page.trace("profile")
    assert x == pytest.approx(values, rel=1e-6)
    assert y == pytest.approx(closed.cost, rel=1e-5)
    assert page.trace("95 % level")[1] == pytest.approx([1.9207, 1.9207], rel=1e-4)


def test_a_bin_mean_of_the_residual_over_velocity_shows_the_step(tmp_path: Path) -> None:
    result, recordings = made(n=6000, dry=2.0)
    write_report(result, tmp_path / "r.html", recordings=recordings)
    v, w = Page(tmp_path / "r.html").trace("mean of a bin")
    assert np.all(np.abs(w - 2 * np.sign(v)) < 0.15)


def test_names_and_notes_cannot_become_markup(tmp_path: Path) -> None:
    evil = '<script>alert("1")</script><img src=x> & </script>'
    result, recordings = made()
    frame = result.estimates[NAME].rename(columns={"x": evil, "x.measured": f"{evil}.measured", "carriage.v": f"{evil}.v"})
    renamed = replace(
        result,
        model=evil,
        notes=(evil,),
        estimates={evil: frame},
        inputs={evil: {evil: result.inputs[NAME]["F"]}},
        parameters={evil: estimate(name=evil, value=1.0, std=0.1, unit=evil)},
        fit={evil: {evil: OutputFit(rms=1.0, fit_percent=5.0, whiteness_p=0.5)}},
        units={evil: evil},
        residual_places={"carriage": ResidualSummary(place=evil, unit=evil, rms=1.0, origin=evil)},
        solver=replace(SOLVER, status=evil, converged=False),
        weights=Weights(W={"carriage": 1.0, evil: 1.0}, V={evil: 1.0}, tau={evil: 0.1}),
    )
    again = Recording(name=evil, time=recordings[0].time, inputs=recordings[0].inputs, outputs={evil: recordings[0].outputs["x"]})
    for ordinary, page_of in ((made(), "a.html"), ((renamed, [again]), "b.html")):
        write_report(ordinary[0], tmp_path / page_of, recordings=ordinary[1])
    plain, attacked = Page(tmp_path / "a.html"), Page(tmp_path / "b.html")
    count = [sum(tag == "script" for tag, _ in p.elements) for p in (plain, attacked)]
    assert count[1] - len(attacked.charts) == count[0] - len(plain.charts) == 2
    assert not any(tag == "img" for tag, _ in attacked.elements)
    assert attacked.text.count('alert("1")') > 5
    words = [t["name"] for c in attacked.charts for t in c["data"]]
    words += [axis["title"]["text"] for c in attacked.charts for key, axis in c["layout"].items() if re.match("[xy]axis", key)]
    assert not any("<" in w for w in words)


def test_a_quarter_of_a_million_samples_stay_below_eight_megabytes_and_keep_their_spike(tmp_path: Path) -> None:
    result, recordings = made(n=250_000)
    frame = result.estimates[NAME].copy()
    frame.loc[123_457, "x.measured"] += 5e-5
    write_report(replace(result, estimates={NAME: frame}), tmp_path / "r.html", recordings=recordings)
    page = Page(tmp_path / "r.html")
    assert page.size < 8e6
    assert "drawn by the minimum and the maximum" in page.text
    t, error = page.trace("error")
    assert t[error.argmax()] == pytest.approx(1234.57, abs=1e-3)
    assert error.max() == pytest.approx(50, abs=5)
    assert t.size < 20_000
    assert "1 sample of x lies more than six" in page.text


def test_several_recordings_have_a_section_each_and_stay_small(tmp_path: Path) -> None:
    names = tuple(f"run_{k}.csv" for k in range(6))
    result, recordings = made(n=30_000, names=names)
    held_out = Recording(name="held_out.csv", time=np.arange(3) * 1.0, inputs={}, outputs={}, role="held_out")
    write_report(result, tmp_path / "r.html", recordings=[*recordings, held_out])
    page = Page(tmp_path / "r.html")
    for name in names:
        assert f"Measured and smoothed: {name}" in page.text
    assert "6 recordings (" in page.text
    assert "6 outputs are met with a fit of 99.9986 % (x on run_0.csv) to 99.9986 %" in page.text
    assert "Not part of this estimation: held_out.csv" in page.text
    assert page.size < 8e6
    groups = {a["data-group"] for t, a in page.elements if t == "figure" and "data-group" in a}
    assert len(groups) == 6


def test_missing_values_do_not_stop_the_page(tmp_path: Path) -> None:
    result, recordings = made()
    frame = result.estimates[NAME].copy()
    frame["x.std"] = np.nan
    frame["residual.carriage.std"] = np.nan
    frame["residual.nowhere"] = np.nan
    frame.loc[100:400, "x.measured"] = np.nan
    frame = frame.drop(columns=["carriage.s.std"])
    bare = replace(
        result,
        parameters={
            "a": estimate(name="a", value=1.0, unit=""),
            "b": estimate(name="b", value=float("nan"), std=float("nan"), unit="kg", identifiable=False),
            "c": estimate(name="c", value=0.0, std=0.0, unit="1"),
        },
        estimates={NAME: frame},
        inputs={},
        units={},
        fit={NAME: {"x": OutputFit(rms=float("nan"), fit_percent=float("nan"), whiteness_p=None)}},
        weights=Weights(W={}, V={}),
        residual_places={},
        notes=(),
        solver=replace(SOLVER, status="Iteration limit reached.", converged=False),
    )
    write_report(bare, tmp_path / "r.html", recordings=recordings)
    page = Page(tmp_path / "r.html")
    assert "301 samples are missing" in page.text
    assert "The solver did not converge" in page.text
    assert "The data do not determine b" in page.text
    assert "not tested" in page.text
    for chart in page.charts:
        go.Figure(chart)
    write_report(replace(bare, estimates={}, fit={}, parameters={}), tmp_path / "empty.html", recordings=[])
    assert "actuator" in Page(tmp_path / "empty.html").text


def test_a_page_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    result, recordings = made()
    write_report(result, str(tmp_path / "r.html"), recordings=recordings)
    first = (tmp_path / "r.html").read_bytes()
    write_report(result, tmp_path / "r.html", recordings=recordings)
    assert (tmp_path / "r.html").read_bytes() == first, "equal results are equal pages"
    assert [p.name for p in tmp_path.iterdir()] == ["r.html"]


def test_a_simulation_stands_beside_its_recording_with_the_fit_of_the_formula(tmp_path: Path) -> None:
    result, recordings = made(n=3000)
    frame = result.estimates[NAME][["t_s", "carriage.s", "carriage.v"]].assign(x=lambda f: 0.9 * f["carriage.s"])
    parameters = {"carriage.m": (95.0, "kg")}
    notes = ("Started at rest.",)
    write_simulation_report(frame, recordings, tmp_path / "s.html", model="actuator", units=UNITS, parameters=parameters, notes=notes)
    page = Page(tmp_path / "s.html")
    # A tenth of a sine of amplitude 0.2 is missing: rms 0.02 / sqrt 2 over whole periods, fit 90 %.
    assert re.search(r"x to 14\.\d mm rms \(fit 90\.0 %\)", page.text)
    assert "Started at rest." in page.text
    assert "95" in page.text
    assert page.trace("simulated")[1] == pytest.approx(frame["x"].to_numpy(), abs=1e-7)
    for chart in page.charts:
        go.Figure(chart)
    assert not any("src" in a for _, a in page.elements)


def test_a_simulation_without_measured_outputs_shows_the_model_alone(tmp_path: Path) -> None:
    result, recordings = made(names=("a.csv", "b.csv"))
    bare = [Recording(name=r.name, time=r.time, inputs=r.inputs, outputs={}) for r in recordings]
    frames = {name: frame[["t_s", "x", "carriage.v"]] for name, frame in result.estimates.items()}
    write_simulation_report(frames, bare, tmp_path / "s.html", model="actuator", units=UNITS)
    page = Page(tmp_path / "s.html")
    assert "nothing measured" in page.text
    assert "States and inputs: b.csv" in page.text
