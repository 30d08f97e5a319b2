"""How long a State takes to the screen, beside the pictures of the same page that replays a log."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.command_bench import PATIENT, Command, controller, emulator, endpoint, wait_for_mode
from support.pages.chromium import chromium

pytestmark = pytest.mark.long
LOOK_S, PICTURES = 20.0, 20
MOST_INTERVALS = 3.0


def pictures(browser: Any, address: str) -> Any:
    """What a page has shown, once that is enough: tick and stamp of a State, and when."""
    page = browser.new_page(viewport={"width": 800, "height": 600})
    page.goto(address)
    page.wait_for_function("() => window.hoap3?.drawn.length > 0")
    if page.evaluate("hoap3.hello.log !== null"):
        page.click("#play")
    page.evaluate("hoap3.drawn.length = 0")
    page.wait_for_timeout(LOOK_S * 1e3)
    found = page.evaluate("hoap3.drawn")
    page.context.close()
    assert len(found) > PICTURES
    return found


def intervals_ms(found: Any) -> np.ndarray:
    """Between two pictures."""
    return np.diff([each["shown_ms"] for each in found])


def test_a_state_is_on_the_screen_within_three_pictures_of_a_replay(tmp_path: Path) -> None:
    at, log = endpoint(), tmp_path / "log"
    with (
        chromium() as browser,
        emulator("ur5", *PATIENT, at=at),
        controller("steered_ur5", "--out", log, at=at) as law,
    ):
        law.hear("following robot")
        wait_for_mode("active", at, "ur5")
        with Command("view", "ur5", "--connect", at, "--port", 0) as view:
            live = pictures(browser, view.hear(r"http://\S+", stream="stdout")[0])
        wall_ms = (time.time_ns() - time.monotonic_ns()) / 1e6  # of a stamp, as the page tells time
        law.end(2)
        with Command("view", str(log), "--port", 0) as view:
            replayed = pictures(browser, view.hear(r"http://\S+", stream="stdout")[0])
    took = np.array([each["shown_ms"] - each["stamp_ns"] / 1e6 - wall_ms for each in live])
    interval = np.median(intervals_ms(replayed))
    p50, p95 = np.percentile(took, [50, 95])
    print(
        f"State to screen: n {took.size}, min {took.min():.1f}, p50 {p50:.1f}, p95 {p95:.1f}, max "
        f"{took.max():.1f} ms; pictures of a replay every {interval:.1f} ms, of the robot every "
        f"{np.median(intervals_ms(live)):.1f}; p95 is {p95 / interval:.2f} intervals"
    )
    assert took.min() > 0.0
    assert p95 <= MOST_INTERVALS * interval
