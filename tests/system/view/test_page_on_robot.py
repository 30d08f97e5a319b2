"""The page in a browser, on UR5 that runs: it draws where the robot is, and moves it."""

from __future__ import annotations

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
    wait_for_mode,
)
from support.pages.chromium import change_number, chromium

import hoap3
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.tools.logs.log import Log

pytestmark = pytest.mark.long  # robot, controller and a browser need two CPUs for themselves
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
    with (
        emulator(ROBOT, *QUIET, *PATIENT, at=at),
        controller("steered_ur5", "--out", log, at=at) as command,
    ):
        command.hear("following robot")
        wait_for_mode("active", at, ROBOT)
        yield command, log


@pytest.fixture(scope="module")
def page(law: Any, at: str) -> Iterator[Any]:
    """One that has the token, and steers."""
    with ExitStack() as stack:
        view = stack.enter_context(Command("view", ROBOT, "--connect", at, "--port", 0))
        address = view.hear(r"http://\S+", stream="stdout")[0]
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


def place(q: np.ndarray, link: str) -> np.ndarray:
    """Where a link is, seen from what stands on the ground, (4, 4)."""
    robot = hoap3.load_robot(ROBOT)
    kinematics = Kinematics(robot)
    kinematics.update(q)
    frames = kinematics.frame_id(link), kinematics.frame_id(robot.base_frame)
    found = np.eye(4)
    position, rotation = np.zeros(3), np.zeros((3, 3))
    kinematics.frame(*frames, position, rotation, np.zeros((6, robot.n)))
    found[:3, :3], found[:3, 3] = rotation, position
    return found


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
            expected = place(np.asarray(rows[0]["q"], float), link)
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
