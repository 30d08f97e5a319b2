"""Ten minutes of a log on the page: how soon it is there, and how many moments of it a second."""

from __future__ import annotations

import shutil
import time

import numpy as np
import pytest
from support.command_bench import Command
from support.pages.chromium import chromium

pytestmark = pytest.mark.long
MINUTES, PULLED_S = 10, 10.0
PULL_MS = 10  # between two moments; the page asks for one each 40 ms at most
MADE_S = 1800.0  # in which a busy machine has made the log
PULL = """async ([seconds, every_ms]) => {
  const slider = document.getElementById("at"), began = performance.now(), { min, max } = slider;
  let share = 0;
  hoap3.drawn.length = 0;
  while (performance.now() - began < 1e3 * seconds) {
    share = (share + (Math.sqrt(5) - 1) / 2) % 1;
    slider.valueAsNumber = Number(min) + share * (max - min);
    slider.dispatchEvent(new Event("input"));
    await new Promise((resolve) => setTimeout(resolve, every_ms));
  }
  return hoap3.drawn;
}"""
"""Pulls the slider of time to moments all over the log; the pictures that were drawn meanwhile."""


def test_ten_minutes_are_there_soon_and_are_pulled_through(tmp_path):
    log = tmp_path / "log"
    with Command("run", "--lockstep", "--duration", 60 * MINUTES, "--out", log) as run:
        assert run.ended_within(MADE_S)
        assert run.process.returncode in {0, 1}, run.stderr
    size = sum(path.stat().st_size for path in log.glob("*.mcap"))
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 640, "height": 480}, device_scale_factor=0.25)
        begin = time.monotonic()
        with Command("view", str(log), "--port", 0) as view:
            page.goto(view.hear(r"http://\S+", stream="stdout")[0])
            page.wait_for_function("() => window.hoap3?.drawn.length > 0")
            opened_s = time.monotonic() - begin
            pictures = page.evaluate(PULL, [PULLED_S, PULL_MS])
            page.context.close()
    shutil.rmtree(log)  # it is large
    ticks, shown = (np.array([each[key] for each in pictures]) for key in ("tick", "shown_ms"))
    assert ticks.size > 50
    between = np.percentile(np.diff(shown), [50, 95, 100])
    print(
        f"{MINUTES} minutes, {size / 1e6:.0f} MB: the first picture {opened_s:.2f} s after the "
        f"command began; pulled for {PULLED_S:g} s: {ticks.size / PULLED_S:.1f} pictures a second, "
        f"p50 {between[0]:.0f}, p95 {between[1]:.0f}, max {between[2]:.0f} ms apart"
    )
    assert np.unique(ticks).size > 0.9 * ticks.size  # each is another moment
    assert np.ptp(ticks) > 0.9 * 60_000 * MINUTES  # of the whole log
