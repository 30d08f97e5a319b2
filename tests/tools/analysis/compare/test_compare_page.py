"""The page of a comparison stands by itself: a colour for each controller, and texts stay texts."""

from __future__ import annotations

import dataclasses
import re

import pytest
from support.html_page import Page

from hoap3.remote_controller.controllers.base import STATUS
from hoap3.tools.analysis.compare.comparison import compare
from hoap3.tools.analysis.compare.page import ROLES, SECTIONS, drawings, page
from hoap3.tools.analysis.document import POLICY

pytestmark = pytest.mark.slow

PLOTS = ["error", "v", "active", "switching", "control_effort", "certificates"]
EVIL = "</pre><script>alert(1)</script><img src=x onerror='a()'>\" onload=\"b()"


@pytest.fixture(scope="module")
def made():
    names = ["qp12_paper", "qp12_paper@gamma=0", "pinv=pinv@ramp_s=0"]
    return compare(names, duration=0.2, timing=False)


@pytest.fixture(scope="module")
def shown(made):
    return Page(page(made))


def test_every_section_and_plot_is_there(shown):
    assert list(shown.figures()) == PLOTS
    for section in SECTIONS:
        assert shown.by_id(section).text()


def test_nothing_is_loaded_and_nothing_runs(shown):
    (told,) = [m for m in shown.root.all("meta") if "http-equiv" in m.attributes]
    assert told.attributes["content"] == POLICY
    assert not re.search(r"https?://|@import|<script|<link|<img", shown.source)
    ids = [e.attributes["id"] for e in shown.root.all() if "id" in e.attributes]
    assert len(ids) == len(set(ids))
    for link in shown.root.all("a"):
        assert link.attributes["href"].removeprefix("#") in ids


def test_each_controller_has_its_colour_in_every_plot(made, shown):
    for name, plot in shown.figures().items():
        (legend,) = plot.all("ul", "legend")
        for place, label in enumerate(made.labels):
            entry = legend.all("li")[place]
            assert entry.text() == (f"{place + 1}: {label}" if name == "certificates" else label)
            colour = f"var(--{ROLES[place]})"
            assert colour in entry.all("span", "mark")[0].attributes["style"]
            drawn = [each.attributes.get("style", "") for each in plot.all("path")]
            assert any(colour in style for style in drawn)


def test_the_table_has_a_column_for_each_controller(made, shown):
    head, *rows = shown.rows("table")
    assert head == ["", *made.labels]
    cells = {row[0]: row[1:] for row in rows}
    assert cells["uncertified"] == ["0", "0", "118"]
    assert cells["to 1 % of the start [s]"] == ["–", "–", "–"]
    assert cells["∫ |u|₁ [rad]"][0] != "–"


def test_findings_stand_at_the_head(made, shown):
    assert "pinv: 118 of 200 answers are uncertified" in shown.root.all("div", "gaps")[0].text()
    quiet = Page(page(dataclasses.replace(made, findings=[])))
    assert not quiet.root.all("div", "gaps")


def test_bars_say_where_a_certificate_is_missing(made):
    def certificates(series):
        changed = dataclasses.replace(made, series=[series, *made.series[1:]])
        (drawing,) = [each for each in drawings(changed) if each.name == "certificates"]
        return drawing

    plain = made.series[0]
    status = plain.status.copy()
    assert [key.text for key in certificates(plain).keys][3:] == ["uncertified"]
    status[50:60] = STATUS["infeasible"]
    failed = certificates(dataclasses.replace(plain, status=status))
    assert [key.text for key in failed.keys][3:] == ["uncertified", "infeasible"]
    assert "var(--red)" in failed.svg
    assert "var(--red)" not in certificates(plain).svg
    assert failed.title.startswith("128 answers lack")


def test_labels_and_settings_stay_texts(made):
    words = f"{EVIL}=qp12"
    first = dataclasses.replace(made.candidates[0], label=EVIL, words=words)
    source = page(dataclasses.replace(made, candidates=[first, *made.candidates[1:]]))
    read = Page(source)
    assert EVIL in read.root.all("h1")[0].text()
    for found in read.root.all():
        assert found.tag not in {"script", "img"}
        assert not any(name.startswith("on") for name in found.attributes)


def test_more_controllers_than_colours_are_told_apart_by_dashes(made):
    n = len(ROLES) + 2
    many = dataclasses.replace(
        made,
        candidates=[
            dataclasses.replace(made.candidates[0], label=f"c{place}") for place in range(n)
        ],
        series=[made.series[0]] * n,
        figures=[made.figures[0]] * n,
    )
    marks = [(key.role, key.mark) for key in drawings(many)[0].keys]
    assert len(set(marks)) == n
    for drawing in drawings(many)[:5]:
        assert drawing.svg.count("stroke-dasharray") == 2, drawing.name
    assert len(Page(page(many)).figures()) == len(PLOTS)


def test_controllers_without_certificates_have_no_plot_of_v(made):
    silent = [
        dataclasses.replace(each, status=each.status * 0 + STATUS["none"], v=each.v * float("nan"))
        for each in made.series
    ]
    names = [each.name for each in drawings(dataclasses.replace(made, series=silent))]
    assert names == ["active", "switching", "control_effort", "certificates"]


def test_without_answers_there_is_nothing_to_draw(made):
    def first_none(each):
        arrays = {
            field.name: getattr(each, field.name)[:0]
            for field in dataclasses.fields(each)
            if field.name not in {"period_s", "unit"}
        }
        return dataclasses.replace(each, **arrays)

    empty = dataclasses.replace(made, series=[first_none(each) for each in made.series])
    assert drawings(empty) == []
    assert "nothing to draw" in Page(page(empty)).by_id("plots").text()
