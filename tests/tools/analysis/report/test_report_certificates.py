"""Cycles without certificate are seen: at the head, in their section, in figures and in JSON."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_logs import active_log
from support.html_page import Page

from hoap3.protocol.messages import Setpoint
from hoap3.tools.analysis.certificates import Certificates
from hoap3.tools.analysis.report.content import read_content
from hoap3.tools.analysis.report.page import page

pytestmark = pytest.mark.slow

CERTIFIED, AT_TARGET, UNCERTIFIED, INFEASIBLE = range(4)
NONE = Setpoint.schema.constants["STATUS_NONE"]
SHADE = "no certificate"


def told(tick):
    """Of 400 answers: 3 without proof, 40 infeasible with a ρ that falls, 60 at the target."""
    status, rho, margin = CERTIFIED, 1.0, 0.01
    if 50 <= tick < 53:
        status = UNCERTIFIED
    if 100 <= tick < 140:
        status, rho, margin = INFEASIBLE, 1.0 - (tick - 99) / 30, -2e-3
    if tick >= 340:
        status = AT_TARGET
    fields = {"solver_status": status, "rho": rho, "margin": margin, "v": 1.0 / (1 + tick)}
    return {**fields, "v_rate_required": -1.0, "v_rate_predicted": -1.0}


@pytest.fixture(scope="module")
def content(tmp_path_factory):
    folder = tmp_path_factory.mktemp("certificates")
    return read_content(active_log(folder, count=400, setpoint=told))


@pytest.fixture(scope="module")
def shown(content):
    return Page(page(content))


def figures(content):
    return {drawing.name: drawing for drawing in content.drawings["certificates"]}


def test_json_counts_by_status_and_names_the_first_and_the_longest_stretch(content):
    assert content.as_json()["certificates"] == {
        "n": 400,
        "certified": 297,
        "at_target": 60,
        "uncertified": 3,
        "infeasible": 40,
        "without": 43,
        "reasons": {},
        "stretches": 2,
        "first": {"answers": 3, "tick": 50, "begin_s": 0.05, "end_s": 0.052},
        "longest": {"answers": 40, "tick": 100, "begin_s": 0.1, "end_s": 0.139},
        "least_rho": pytest.approx(1.0 - 40 / 30),
        "least_margin": -2e-3,
    }


def test_the_head_says_it_twice(shown):
    tile = shown.tiles()["without certificate"]
    assert "43" in tile
    assert "of n 400 answers" in tile
    assert "first at 0.050 s, longest interval 40" in tile
    said = shown.root.all("div", "gaps")[0].text()
    assert "43 of 400 answers came without a certificate, the first at tick 50" in said


def test_certificates_that_are_worth_little_are_told_beside_those_that_are_missing(content):
    reasons = {"certified": {"beta below": 7}, "infeasible": {"infeasible_constraints": 40}}
    gaps = replace(content.motion.certificates, reasons=reasons).gaps
    assert "43 of 400 answers came without a certificate" in gaps[0]
    assert gaps[1:] == ["In 7 of 400 answers a certificate says little: beta below."]


def test_the_section_counts_by_status(shown):
    assert shown.rows("certificates") == [
        ["answers", "n", "share"],
        ["certified", "297", "74.250 %"],
        ["at target", "60", "15.000 %"],
        ["uncertified", "3", "0.750 %"],
        ["infeasible", "40", "10.000 %"],
    ]
    said = shown.by_id("certificates").text()
    assert "in 2 intervals" in said
    for part in ("0.050 s (tick 50)", "0.100 s (tick 100)", "40 answers, until 0.139"):
        assert part in said


def test_rho_is_drawn_where_it_falls_below_1(content):
    rho = figures(content)["rho"]
    assert rho.title == "V may rise in 10 of 400 answers: ρ is below 0"
    assert "below 1 40, below 0 10" in rho.figures
    assert SHADE in [key.text.partition(":")[0] for key in rho.keys]


def test_the_margin_is_drawn_and_violations_are_counted(content, shown):
    margin = figures(content)["margin"]
    assert margin.title == "A constraint is violated in 40 of 400 answers"
    assert "outside 40" in margin.figures
    assert {"rho", "margin"} <= shown.figures().keys()
    for name in ("rho", "margin"):
        (svg,) = shown.figures()[name].all("svg")
        assert "fill: var(--red)" in "".join(e.attributes.get("style", "") for e in svg.all())


def test_where_all_is_proved_nothing_is_red_and_rho_is_left_out(tmp_path):
    fields = {"solver_status": CERTIFIED, "rho": 1.0, "margin": 0.25, "v": 1.0}
    fields |= {"v_rate_required": -1.0, "v_rate_predicted": -1.0}
    content = read_content(active_log(tmp_path, setpoint=fields))
    assert list(figures(content)) == ["margin"]
    assert "0.250" in figures(content)["margin"].title
    assert [key.text for key in figures(content)["margin"].keys] == ["margin", "limit"]
    assert content.as_json()["certificates"]["longest"] is None
    seen = Page(page(content))
    assert "n 50 answers" in seen.by_id("certificates").text()
    assert not any("without a certificate" in gap for gap in content.gaps)
    assert seen.tiles()["without certificate"].startswith("without certificate0")


def test_without_any_constraint_there_is_no_margin_to_draw(tmp_path):
    fields = {"solver_status": CERTIFIED, "rho": 0.5, "margin": np.inf}
    content = read_content(active_log(tmp_path, setpoint=fields))
    assert list(figures(content)) == ["rho"]
    assert content.as_json()["certificates"]["least_margin"] is None


def test_a_controller_without_certificates_is_said_to_have_none(tmp_path):
    content = read_content(active_log(tmp_path, setpoint={"solver_status": NONE}))
    assert content.certificates is None
    assert content.as_json()["certificates"] is None
    assert "certificates" not in Page(page(content)).sections()


def test_a_status_that_nobody_defined_proves_nothing(tmp_path):
    fields = {"solver_status": 77, "rho": 1.0, "margin": 1.0}
    content = read_content(active_log(tmp_path, setpoint=fields))
    assert content.certificates.counts["unknown"] == content.certificates.without == 50
    assert ["unknown", "50", "100.000 %"] in Page(page(content)).rows("certificates")


@given(st.lists(st.sampled_from([0, 1, 2, 3, 9]), min_size=1, max_size=60))
def test_stretches_are_the_runs_of_what_is_not_proved(status):
    k = len(status)
    certificates = Certificates(
        tick=np.arange(10, 10 + k, dtype=np.uint64),
        time_s=np.arange(k) / 100.0,
        status=np.array(status, np.uint32),
        rho=np.ones(k),
        margin=np.ones(k),
        duration_s=1.0,
    )
    covered = {
        tick
        for stretch in certificates.stretches
        for tick in range(stretch.tick, stretch.tick + stretch.answers)
    }
    assert covered == {10 + place for place, each in enumerate(status) if each > 1}
    assert sum(each.answers for each in certificates.stretches) == certificates.without
    for stretch in certificates.stretches:
        assert stretch.end_s - stretch.begin_s == pytest.approx((stretch.answers - 1) / 100.0)
    for before, after in zip(certificates.stretches, certificates.stretches[1:], strict=False):
        assert before.tick + before.answers < after.tick
