"""The page stands by itself, and shows every section and figure that is promised."""

from __future__ import annotations

import re

import pytest
from support.html_page import Page

from hoap3.tools.analysis.report.content import read_content
from hoap3.tools.analysis.report.page import POLICY, SECTIONS, headline, page
from hoap3.tools.services.configs import (
    config_name,
    load_controller_config,
    load_emulator_config,
)
from hoap3.tools.services.run import run_lockstep

MOTION = ["views", "sole", "path", "positions", "v", "psi", "u", "active"]
CERTIFICATES = ["rho", "margin"]
TIMES = ["deadlines", "success", "rtt", "wakeup", "typical", "tail"]
LOADING = {"script", "link", "img", "iframe", "object", "embed", "base", "form", "audio", "video"}
LOADING |= {"image", "feimage", "foreignobject", "animate", "set", "source", "track", "input"}


def read(path) -> Page:
    return Page(page(read_content(path)))


@pytest.fixture(scope="module")
def still(lockstep) -> Page:
    return read(lockstep[0])


@pytest.fixture(scope="module")
def live(story) -> Page:
    return read(story[0])


@pytest.fixture(params=["still", "live"])
def shown(request) -> Page:
    return request.getfixturevalue(request.param)


def test_nothing_is_loaded_and_nothing_runs(shown):
    for element in shown.root.all():
        assert element.tag not in LOADING
        for name, value in element.attributes.items():
            assert not name.startswith("on"), name
            assert name not in {"src", "srcset", "action", "xlink:href", "background", "poster"}
            assert "javascript:" not in value
            if name != "href":
                assert "//" not in value, (element.tag, name)
    assert not re.search(r"https?://|@import|expression\(", shown.source)
    assert all(place.startswith("#") for place in re.findall(r"url\(([^)]*)", shown.source))


def test_a_browser_is_told_to_load_nothing(shown):
    (told,) = [m for m in shown.root.all("meta") if "http-equiv" in m.attributes]
    assert told.attributes["http-equiv"] == "Content-Security-Policy"
    assert told.attributes["content"] == POLICY
    assert "default-src 'none'" in POLICY
    assert "script" not in POLICY


def test_the_config_that_was_run_is_named_beside_its_controller(tmp_path):
    (tmp_path / "mine.yaml").write_text("controller: qp12\n")
    emulator, _ = load_emulator_config("hoap3", [])
    controller, file = load_controller_config(tmp_path / "mine.yaml", [])
    run_lockstep(emulator, controller, 0.02, tmp_path / "run", ("config", file))
    content = read_content(tmp_path / "run", verify=False)
    (title,) = Page(page(content)).root.all("h1")
    assert title.text() == "hoap3 · mine.yaml (qp12)"
    assert content.as_json()["config"] == "mine.yaml"
    assert config_name(load_controller_config("qp12_bounded", [])[1]) == "qp12_bounded"


def test_every_link_leads_to_one_place_of_the_page(shown):
    ids = [e.attributes["id"] for e in shown.root.all() if "id" in e.attributes]
    assert len(ids) == len(set(ids))
    links = [e.attributes["href"] for e in shown.root.all() if "href" in e.attributes]
    links += re.findall(r"url\((#[^)]*)", shown.source)
    assert links
    assert {link[1:] for link in links} <= set(ids)
    assert all(link.startswith("#") for link in links)


def test_sections_are_those_of_the_navigation_and_none_is_empty(shown):
    assert shown.sections() == [a.attributes["href"][1:] for a in shown.root.all("nav")[0].all("a")]
    for anchor in shown.sections():
        section = shown.by_id(anchor)
        assert section.text().strip() != section.all("h2")[0].text(), anchor


def test_the_first_line_names_the_verdict_that_failed(still):
    verdicts = [badge.text() for badge in still.root.all("span", "badge")]
    assert verdicts == ["fail", "pass", "pass"]  # of the task, deadlines, limits
    (lead,) = still.root.all("p", "lead")
    assert lead.text().startswith("Failed: task (")
    assert "deadlines" not in lead.text()


def test_the_first_line_is_not_green_where_something_is_open_or_false():
    told = {key: {"text": "why; more"} for key in ("task", "deadlines", "limits_and_balance")}
    good = dict.fromkeys(told, "pass")
    assert headline({**told, "verdicts": good}, "true").startswith("Passed")
    assert "virtual" in headline({**told, "verdicts": good}, "true", virtual=True)
    assert headline({**told, "verdicts": good}, "false").startswith("Verification failed")
    mixed = {**good, "deadlines": "warn", "task": "not judged"}
    assert headline({**told, "verdicts": mixed}, "true") == (
        "Warning: deadlines (why). Not judged: task (why)"
    )


def test_a_run_in_lockstep_shows_the_motion_and_no_section_of_times(still):
    assert list(still.figures()) == [*MOTION, "margin", "success"]  # ρ is 1
    assert {"ticks", "stalls", "conditions"}.isdisjoint(still.sections())
    assert "RTT, median" not in still.tiles()


def test_a_run_in_real_time_shows_every_figure(live):
    motion = [each for each in MOTION if each != "psi"]  # no answer requires a decrease
    assert list(live.figures()) == motion + CERTIFICATES + TIMES
    assert live.sections() == [each for each in SECTIONS if each != "conditions"]
    assert {"RTT, median", "longest RTT", "outside stalls"} <= live.tiles().keys()


def test_every_figure_has_a_drawing_units_a_legend_its_n_and_a_definition(still, live):
    figures = {**live.figures(), **still.figures()}
    assert figures.keys() == {*MOTION, *CERTIFICATES, *TIMES}
    for name, figure in figures.items():
        drawn = figure.all("svg")
        assert len(drawn) in ((2, 3) if name == "views" else (1,))
        assert all(svg.all("path") for svg in drawn), name
        if name != "views":
            assert re.search(r"\[(mm|m²|m²/s|rad/s|s|µs|%.*)\]", drawn[0].text()), name
        assert figure.all("h3")[0].text(), name
        assert figure.all("ul", "legend")[0].all("li"), name
        assert re.search(r"\bn [≥ ]*\d", figure.all("p", "numbers")[0].text()), name
        assert len(figure.all("details", "what")) == 1
        assert not any(svg.all("a") for svg in drawn), name


def test_colours_come_from_the_page_so_that_dark_pages_have_dark_figures(shown):
    for figure in shown.figures().values():
        painted = [e for svg in figure.all("svg") for e in svg.all()]
        looks = ("style", "fill", "stroke", "color")
        styles = [e.attributes.get(look, "") for e in painted for look in looks]
        assert not re.search(r"#[0-9a-f]{3}|rgb", " ".join(styles))
    style = shown.root.all("style")[0].text()
    assert "prefers-color-scheme: dark" in style
    used = set(re.findall(r"var\(--(\w+)\)", shown.source))
    classes = {e.attributes.get("class", "") for e in shown.root.all("path")}
    used |= set(re.findall(r"\bc-(\w+)", " ".join(classes)))
    light, dark = (set(re.findall(r"--(\w+):", part)) for part in style.split("@media", 1))
    assert used <= light
    assert used <= dark
