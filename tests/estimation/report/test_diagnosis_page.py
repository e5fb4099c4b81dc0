"""The page of a diagnosis: what is on it, that its numbers are those of the diagnosis, and that the drawing is the model's."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from diagnoses import diagnosis

from backsight.estimation.diagnosis import Diagnosis, Explanation, Tried
from backsight.estimation.report import write_diagnosis_report
from backsight.estimation.report.graph import Mark, drawing
from backsight.estimation.report.quantities import quantity
from backsight.models import Dae, Model
from backsight.models.model import GROUNDS
from backsight.models.plants import PLANTS, actuator


class Page(HTMLParser):
    """Text outside of scripts and styles, the anchors of the sections, the charts' data."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self.text, self.charts, self.anchors, self._inside, self._kind = "", [], [], "", ""
        self.tags: list[str] = []
        self.source = source
        self.feed(source)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        found = dict(attrs)
        if tag == "section":
            self.anchors.append(found["id"])
        if tag in ("script", "style"):
            self._inside, self._kind = tag, found.get("type") or ""

    def handle_endtag(self, tag: str) -> None:
        self._inside = "" if tag in ("script", "style") else self._inside

    def handle_data(self, data: str) -> None:
        if self._inside == "script" and self._kind == "application/json":
            self.charts.append(json.loads(data))
        elif not self._inside:
            self.text += data


def unpacked(array: dict[str, str]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(array["bdata"]), dtype=f"<{array['dtype']}")


def written(found: Diagnosis, folder: Path) -> Page:
    path = folder / "report.html"
    write_diagnosis_report(found, path)
    return Page(path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Page:
    return written(diagnosis(), tmp_path_factory.mktemp("page"))


def test_the_story_is_told_in_the_order_of_an_engineers_questions(page):
    assert page.anchors == ["where", "when", "what", "tried", "held-out", "parameters", "limits", "notes"]
    first = page.text.index("The model leaves out coulomb friction at carriage (f_c = ")
    assert first < page.text.index("cannot tell coulomb friction at carriage from input dead zone at input:F")
    assert "a slow reversal under a constant load" in page.text
    assert "chance without it" in page.text
    assert "spread of v_s 140 %" in page.text
    assert "cannot be told from what was accepted" in page.text
    assert "75 % smaller" in page.text
    assert "p = 0.001 from 12 blocks" in page.text
    assert "93 % of what forces that are free at every place would take from them" in page.text
    assert "these recordings show none" in page.text
    assert "20 µm" in page.text


def test_the_residual_force_is_drawn_before_and_after_and_against_what_it_hangs_on(page):
    forces = [t for chart in page.charts for t in chart["data"] if t["name"] == "model as declared"]
    force = unpacked(forces[0]["y"])
    truth = diagnosis().mismatch[0].force
    assert force == pytest.approx(truth, rel=1e-6, abs=1e-6)
    titles = json.dumps([chart["layout"] for chart in page.charts])
    for title in ("time [s]", "position [m]", "velocity [m/s]", "force at carriage [N]", "ahead [s]"):
        assert title in titles


def test_the_parameters_stand_side_by_side(page):
    before, after = diagnosis().before.parameters["carriage.m"], diagnosis().after.parameters["carriage.m"]
    row = page.text[page.text.rindex("model as declared") :]
    assert f"{before.value:.2f}"[:4] in row
    assert f"{after.value:.3f}"[:5] in row


@pytest.mark.parametrize("balance", ["", ".phi"])
def test_an_onset_is_marked_at_all_balances_of_its_place(tmp_path, balance):
    finding = replace(diagnosis().findings[0], onset=0.4, regime="forwards")
    mismatch = tuple(replace(m, place=m.place + balance) for m in diagnosis().mismatch)
    page = written(replace(diagnosis(), findings=(finding,), mismatch=mismatch), tmp_path)
    assert "It acts: from 0.4 s on, forwards." in page.text
    marks = [t for chart in page.charts for t in chart["data"] if t["name"] == "sets in, or ends"]
    assert unpacked(marks[0]["x"]) == pytest.approx(0.4)


def test_text_is_escaped_everywhere(tmp_path):
    evil = '<img src=x onerror="alert(1)">'
    explanation = Explanation(place=evil, family=evil, physics=evil)
    finding = replace(
        diagnosis().findings[0],
        explanation=explanation,
        change=evil,
        regime=evil,
        separates=evil,
        rivals=(explanation,),
        alternatives=(explanation,),
    )
    tried = (Tried(explanation=explanation, predicted=1.0, refused=evil),)
    mismatch = tuple(replace(m, place=evil, recording=evil) for m in diagnosis().mismatch)
    found = replace(diagnosis(), findings=(finding,), tried=tried, notes=(evil,), mismatch=mismatch)
    held = replace(diagnosis().held_out, recordings=(evil,), force={evil: (1.0, 2.0, "N")})
    page = written(replace(found, held_out=held), tmp_path)
    assert "img" not in page.tags
    assert evil in page.text
    assert "<img src" not in re.sub(r"<script>.*?</script>", "", page.source, flags=re.DOTALL)


def test_a_verdict_of_nothing_has_what_could_not_have_been_seen(tmp_path):
    calm = replace(diagnosis(), verdict="none", findings=(), held_out=None, tried=(), mismatch=(), after=diagnosis().before)
    page = written(calm, tmp_path)
    assert page.anchors == ["where", "parameters", "limits", "notes"]
    assert "Nothing is missing" in page.text
    assert "Mind" not in page.text


def test_a_verdict_of_nothing_has_what_the_model_predicts_of_what_was_held_out(tmp_path):
    had = diagnosis()
    calm = replace(had, verdict="none", findings=(), held_out=had.held_out.unrepaired, after=had.before)
    page = written(calm, tmp_path)
    assert "What the fit has not seen" in page.text
    assert "Before and after" not in page.text
    assert "repaired" not in page.text
    assert "does not confirm" not in page.text
    (name, errors), *_ = had.held_out.before.items()
    assert name in page.text
    assert all(quantity(rms, errors.unit) in page.text for rms in errors.windows.values())


def test_a_proof_that_does_not_confirm_is_said_first(tmp_path):
    held = replace(diagnosis().held_out, p_value=0.4, improvement_percent=-3.0)
    page = written(replace(diagnosis(), held_out=held), tmp_path)
    assert "does not confirm the repair (p = 0.4)" in page.text
    assert "3 % larger with it" in page.text
    refuting = written(replace(diagnosis(), verdict="undecided", held_out=replace(held, p_value=0.999)), tmp_path)
    assert "contradicts the repair" in refuting.text


def test_a_compiled_model_has_no_drawing_and_all_the_rest(tmp_path):
    posed = diagnosis().repaired
    assert isinstance(posed.dae, Dae)
    page = written(replace(diagnosis(), repaired=replace(posed, model=posed.dae)), tmp_path)
    assert "svg" not in page.tags
    assert "where" in page.anchors


# ---------------------------------------------------------------- the drawing


def boxes(model: Model, marks: dict[str, Mark] | None = None) -> dict[str, tuple[float, float, float, float]]:
    source = drawing(model, marks or {}, caption="")
    found = re.findall(r'<title>([^<]*?) \([^<]*\)</title><rect x="([\d.]+)" y="([\d.]+)" width="(\d+)" height="(\d+)"', source)
    return {name: tuple(float(v) for v in numbers) for name, *numbers in found}


@pytest.mark.parametrize("name", PLANTS)
def test_every_part_that_is_joined_is_drawn_once_and_none_on_another(name):
    model = PLANTS[name]()
    at = boxes(model)
    joined = {end.partition(".")[0] for pair in model.connections for end in pair}
    grounds = {n for n, c in model.components.items() if isinstance(c, tuple(GROUNDS.values()))}
    assert {n for n in at if ":" not in n} >= joined - grounds
    assert {n for n in at if ":" in n} == {*(f"input:{u}" for u in model.inputs), *(f"sensor:{y}" for y in model.outputs)}
    places = sorted(at.values())
    for a in places:
        for b in places:
            assert a == b or abs(a[0] - b[0]) >= a[2] or abs(a[1] - b[1]) >= a[3]


def test_a_chain_runs_from_the_input_to_the_right():
    at = boxes(actuator(screw="compliant"))
    order = ["input:F", "motor", "screw", "carriage", "friction"]
    assert all(at[a][0] < at[b][0] for a, b in pairwise(order))
    assert drawing(actuator(), {}, caption="") == drawing(actuator(), {}, caption="")


def test_marks_are_drawn_as_what_they_are():
    marks = {"carriage": Mark("guilty", "residual <8> N"), "input:F": Mark("rival")}
    source = drawing(actuator(), marks, caption="")
    assert source.count('stroke-width="2.6"') == 1
    assert source.count("stroke-dasharray") == 1
    assert "residual &lt;8&gt; N" in source
