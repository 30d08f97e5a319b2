"""The page in a browser: on robots that run, and of long logs."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.command_bench import (
    PATIENT,
    QUIET,
    Command,
    controller,
    emulator,
    endpoint,
    followed,
    wait_for_mode,
)
from support.pages.chromium import change_number, chromium
from support.pages.steered_arm import pose

import hoap3
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.analysis.replay import replay
from hoap3.tools.logs.log import Log

pytestmark = pytest.mark.long
ROBOT, TOOL = "ur5", "tool0"
SEEN = "() => ({ tick: hoap3.tick, poses: hoap3.poses })"
UPPER_M = 0.9  # of the target's z, in `steered_ur5`
TRIES = 5  # of a drag: on a busy machine the browser may fall silent in the midst of it


@pytest.fixture(scope="module")
def at() -> str:
    return endpoint()


@pytest.fixture(scope="module")
def law(at: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Command, Path]]:
    """UR5 that follows `steered_ur5`; the controller, and the folder of its log."""
    log = tmp_path_factory.mktemp("page") / "log"
    with followed(at, (ROBOT, "steered_ur5"), law=("--out", log)) as (_, command):
        wait_for_mode("active", at, ROBOT)
        yield command, log


@pytest.fixture(scope="module")
def page(law: Any, at: str) -> Iterator[Any]:
    """One that has the token, and steers."""
    with ExitStack() as stack:
        view = stack.enter_context(Command("view", ROBOT, "--connect", at, "--port", 0))
        address = view.wait_for(r"http://\S+", stream="stdout")[0]
        browser = stack.enter_context(chromium())
        found = browser.new_page(viewport={"width": 800, "height": 600})
        found.goto(address)
        found.wait_for_function("() => window.hoap3?.drawn.length > 3 && hoap3.proved")
        yield found


def steer(page: Any) -> None:
    """Become the operator, or stay so: a browser that gets no time is held to be gone."""
    if page.locator("#steer").get_attribute("aria-pressed") != "true":
        page.click("#steer")
        page.wait_for_selector("#steer[aria-pressed=true]")


def drawn(columns: list[float]) -> np.ndarray:
    """A matrix as the page has it, (4, 4)."""
    return np.reshape(columns, (4, 4)).T


def drag(page: Any, pixels: int) -> None:
    """Pull the hand's gizmo along the world's x, and let it go at last."""
    found = page.evaluate("hoap3.gizmo('hand')")
    start, along = np.array(found["handle"]), np.subtract(found["handle"], found["centre"])
    along /= np.linalg.norm(along)
    page.mouse.move(*start)
    page.mouse.down()
    for far in range(0, pixels, 4):
        page.mouse.move(*(start + far * along))
        page.wait_for_timeout(15)


def test_a_drag_moves_the_tool_and_links_are_drawn_where_the_log_has_them(page, law):
    before, seen = drawn(page.evaluate(SEEN)["poses"][TOOL]), []
    for _ in range(TRIES):
        steer(page)
        drag(page, 80)
        for _ in range(30):
            seen.append(page.evaluate(SEEN))
            page.wait_for_timeout(30)
        page.mouse.up()
        after = drawn(seen[-1]["poses"][TOOL])
        if abs(after[0, 3] - before[0, 3]) > 0.02:
            break
    else:
        pytest.fail("the tool is where it was")
    assert after[2, 3] < UPPER_M + 1e-3
    page.wait_for_timeout(1000)
    command, folder = law
    del command
    states = wait_for_states(folder, seen[-1]["tick"])
    checked = 0
    for each in seen:
        rows = states[states["tick"] == each["tick"]]
        if not len(rows):
            continue
        checked += 1
        for link, columns in each["poses"].items():
            expected = pose(hoap3.load_robot(ROBOT), link, np.asarray(rows[0]["q"], float))
            np.testing.assert_allclose(drawn(columns), expected, atol=1e-3)
    assert checked > len(seen) // 2


def wait_for_states(folder: Path, tick: int) -> Any:
    """States of the log, once it has come so far."""
    until = time.monotonic() + 30.0
    while time.monotonic() < until:
        states = Log.open(folder).states()
        if len(states) and states["tick"][-1] >= tick:
            return states
    raise AssertionError(f"the log does not come to tick {tick}")


def test_a_slider_changes_the_controller(page, at, law):
    change_number(page, "tasks.posture.gain_per_s", "2.5")
    with hoap3.connect(ROBOT, at) as robot:
        until = time.monotonic() + 20.0
        while robot.changeable()["tasks"]["posture"]["gain_per_s"] != pytest.approx(2.5, rel=0.01):
            assert time.monotonic() < until


def test_stop_stops_and_recover_lets_it_move_again(page, at):
    page.keyboard.press("Space")
    wait_for_mode("stopped", at, ROBOT)
    page.wait_for_selector("#mode[data-mode=stopped]")
    page.click("#recover")
    wait_for_mode("active", at, ROBOT)
    page.wait_for_selector("#mode[data-mode=active]")


def test_a_page_that_is_closed_makes_way(page, at, law):
    steer(page)
    page.context.close()
    with hoap3.connect(ROBOT, at) as robot:
        until = time.monotonic() + 20.0
        while True:
            try:
                robot.acquire()
            except hoap3.UsageError:
                assert time.monotonic() < until, "still taken"
            else:
                return


def test_gamma_by_slider_is_in_the_log(tmp_path: Path) -> None:
    at, log = endpoint(), tmp_path / "log"
    with (
        chromium() as browser,
        emulator("hoap3", *QUIET, *PATIENT, at=at),
        controller("qp12", "--out", log, at=at) as law,
        Command("view", "hoap3", "--connect", at, "--port", 0) as view,
    ):
        law.wait_for("following robot")
        wait_for_mode("active", at)
        page = browser.new_page(viewport={"width": 800, "height": 600})
        page.goto(view.wait_for(r"http://\S+", stream="stdout")[0])
        page.wait_for_function("() => window.hoap3?.proved && hoap3.drawn.length > 3")
        change_number(page, "gamma", "0.8")
        assert law.end(2) == 0
    records = Log.open(log, "controller").records()
    changes = [json.loads(each.payload) for each in records if each.kind == Kind.CHANGE]
    assert changes[-1]["gamma"] == pytest.approx(0.8)
    assert replay(log, []).identical


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
        law.wait_for("following robot")
        wait_for_mode("active", at, "ur5")
        with Command("view", "ur5", "--connect", at, "--port", 0) as view:
            live = pictures(browser, view.wait_for(r"http://\S+", stream="stdout")[0])
        wall_ms = (time.time_ns() - time.monotonic_ns()) / 1e6  # of a stamp, as the page tells time
        law.end(2)
        with Command("view", str(log), "--port", 0) as view:
            replayed = pictures(browser, view.wait_for(r"http://\S+", stream="stdout")[0])
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
            page.goto(view.wait_for(r"http://\S+", stream="stdout")[0])
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
