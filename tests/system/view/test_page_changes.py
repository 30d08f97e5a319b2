"""γ by a slider of the page, on HOAP-3 that follows QP12: it is in the log, which stays true."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from support.command_bench import (
    PATIENT,
    QUIET,
    Command,
    controller,
    emulator,
    endpoint,
    wait_for_mode,
)
from support.pages.chromium import change_number, chromium

from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.log import Log
from hoap3.tools.replay import replay

pytestmark = pytest.mark.long  # robot, controller and a browser need two CPUs for themselves


def test_gamma_by_slider_is_in_the_log(tmp_path: Path) -> None:
    at, log = endpoint(), tmp_path / "log"
    with (
        chromium() as browser,
        emulator("hoap3", *QUIET, *PATIENT, at=at),
        controller("qp12", "--out", log, at=at) as law,
        Command("view", "hoap3", "--connect", at, "--port", 0) as view,
    ):
        law.hear("following robot")
        wait_for_mode("active", at)
        page = browser.new_page(viewport={"width": 800, "height": 600})
        page.goto(view.hear(r"http://\S+", stream="stdout")[0])
        page.wait_for_function("() => window.hoap3?.proved && hoap3.drawn.length > 3")
        change_number(page, "gamma", "0.8")
        assert law.end(2) == 0
    records = Log.open(log, "controller").records()
    changes = [json.loads(each.payload) for each in records if each.kind == Kind.CHANGE]
    assert changes[-1]["gamma"] == pytest.approx(0.8)
    assert replay(log, []).identical
