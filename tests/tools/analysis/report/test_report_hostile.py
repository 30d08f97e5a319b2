"""A log that somebody sent can put text on the page, and nothing else."""

from __future__ import annotations

import contextlib
import json
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_logs import active_log
from support.html_page import Page
from support.log_samples import START, describe, write

from hoap3.protocol.errors import LogError
from hoap3.protocol.messages import Event, Setpoint
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.analysis.canvas import Drawing, Key
from hoap3.tools.analysis.certificates import STATUS
from hoap3.tools.analysis.document import PAGES
from hoap3.tools.analysis.event_words import in_words
from hoap3.tools.analysis.report.content import read_content
from hoap3.tools.analysis.report.events import read_events
from hoap3.tools.analysis.report.page import page, write_report
from hoap3.tools.cli.app import main
from hoap3.tools.logs.log import Log

pytestmark = pytest.mark.slow

EVIL = "</pre></style></title><script>alert(1)</script><img src=x onerror='a()'>\"' onload=\"b()"


def harmless(source: str) -> Page:
    read = Page(source)
    for found in read.root.all():
        assert found.tag not in {"script", "img", "iframe", "a()"}
        assert not any(name.startswith("on") for name in found.attributes)
        assert found.tag != "style" or found.parent.tag == "head"
    return read


def evil_log(folder, **more):
    config = json.dumps({"controller": EVIL, "parameters": {"frame": EVIL}})  # YAML, too
    options = {
        "attachments": {
            "config.yaml": config.encode(),
            "description.json": describe(2).to_json(),
        },
        "metadata": {
            "versions": {EVIL: EVIL},
            "machine": {EVIL: EVIL, "kernel": f'"{EVIL}"', "cores": "[[[", "versions": "{}"},
            "run": {"seed": EVIL},
            "clock": {"realtime_ns": EVIL},
        },
    }
    return active_log(folder, **{**options, **more})


def test_texts_of_a_log_stay_texts(tmp_path):
    source = page(read_content(evil_log(tmp_path)))
    read = harmless(source)
    assert EVIL in read.by_id("machine").text()


def test_the_name_of_a_controller_stays_a_text(tmp_path):
    kept = tmp_path / "kept"
    kept.mkdir()
    evil_log(tmp_path, side="controller")
    (tmp_path / "robot.mcap").rename(kept / "controller.mcap")
    read = harmless(page(read_content(kept)))
    assert EVIL in read.root.all("h1")[0].text()


def test_frames_with_markup_in_their_names_stay_texts(tmp_path):
    # a robot may call a link anything that XML allows; it becomes the frame of the path
    plain = describe(1)
    name = "<b>$x^2$</b>"
    urdf = plain.urdf.replace('"link_0"', '"&lt;b&gt;$x^2$&lt;/b&gt;"')
    robot = plain.model_copy(update={"urdf": urdf, "base_frame": name})
    read = harmless(page(read_content(active_log(tmp_path, description=robot))))
    assert not [b for b in read.root.all("b") if b.text() == "$x^2$"]
    assert name in read.figures()["sole"].text()


def test_the_path_of_a_log_stays_a_text(tmp_path):
    folder = tmp_path / "<script>alert(1)<"
    folder.mkdir()
    read = harmless(page(read_content(active_log(folder))))
    assert str(folder) in read.root.all("header")[0].text()


@pytest.mark.parametrize("detail", [-1, 2, 1 << 40, -(1 << 62)])
def test_events_that_nobody_knows_are_shown_as_numbers(detail, tmp_path):
    kinds = tuple((kind, detail) for kind in (0, 6, 10, 18, 21, 57, 4_000_000_000))
    told = read_events(Log.open(active_log(tmp_path, count=1, events=kinds), "robot"))
    names = {happening.name for happening in told}
    assert {"unknown event 57", "unknown event 4000000000", "clipped", "rejected"} <= names
    assert str(detail) in {happening.detail for happening in told}


def test_a_clipped_joint_and_a_reason_are_named():
    assert in_words(18, 1, ("r_knee", "l_knee")) == "l_knee"
    assert in_words(18, 9, ("r_knee",)) == "joint 9"
    assert in_words(6, 1, ()) == "misses"
    assert in_words(10, 3, ()) == "session"


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e308, -1e308])
def test_certificates_that_are_no_numbers_do_not_end_the_report(value, tmp_path):
    odd = {"v": value, "v_rate_required": value, "solver_status": 0}
    content = read_content(active_log(tmp_path, setpoint=odd))
    assert {"u", "active"} <= {drawing.name for drawing in content.drawings["motion"]}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("stamp_intended", 0),
        ("stamp_intended", (1 << 62) - 1),
        ("stamp_published", (1 << 62) - 1),
        ("skipped", (1 << 62) - 1),
    ],
)
def test_stamps_that_make_no_sense_give_a_report_or_one_error(name, value, tmp_path):
    log = active_log(tmp_path, count=5, state={name: value})
    with contextlib.suppress(LogError):
        write_report(log)
        harmless((log / "report.html").read_text(encoding="utf-8"))


@given(st.text())
def test_any_text_is_escaped_everywhere(content):
    parts = PAGES.get_template("analysis/templates/parts.html").module
    drawing = Drawing("x", content, "<svg></svg>", (Key("blue", content),), content)
    shown = parts.link(content, content), parts.table([content], [[content]])
    known = ["a", "p", "div", "table", "thead", "tbody", "tr", "th", "td", "figure", "h3", "svg"]
    known += ["ul", "li", "span", "details", "summary"]
    for source in (*shown, parts.gaps([content]), parts.grid([drawing], {"x": lambda: content})):
        assert {e.tag for e in Page(str(source)).root.all()} <= set(known)


def test_texts_of_a_log_do_not_steer_the_terminal(tmp_path, monkeypatch, capsys):
    esc = "\x1b]0;mine\x07\x1b[2J"
    evil_log(tmp_path, setpoint={"solver_status": STATUS["uncertified"]})
    names = json.dumps({"session_id": 7, "lockstep": False, "conditions": [esc]}).encode()
    began, answer = Event(), Setpoint(2)
    began.kind, began.session_id = Event.schema.constants["CONDITION_BEGAN"], 7
    answer.session_id, answer.solver_status = 7, STATUS["uncertified"]
    payloads = ((Kind.SESSION, names), (Kind.EVENT, began.dump()), (Kind.SETPOINT, answer.dump()))
    records = [Record(kind, START + i, payload) for i, (kind, payload) in enumerate(payloads)]
    about = {"description.json": describe(2).to_json()}
    write(tmp_path / "controller.mcap", records, side="controller", attachments=about)
    monkeypatch.setattr(sys, "argv", ["hoap3", "report", str(tmp_path)])
    with pytest.raises(SystemExit):
        main()
    told = "".join(capsys.readouterr())
    assert "uncertified: \\x1b]0;mine\\x07\\x1b[2J" in told
    assert all(char.isprintable() or char == "\n" for char in told)


def test_control_characters_and_turned_writing_are_replaced():
    text = PAGES.from_string("{{ given }}").render
    assert text(given="a\x00b\x1b[31m\u202ec\x85") == "a�b�[31m�c�"
    assert text(given="tab\tline\nß µ Ψ") == "tab\tline\nß µ Ψ"
