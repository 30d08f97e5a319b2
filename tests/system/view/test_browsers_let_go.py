"""Browsers whose page is closed, freezes or is killed while it drags: held, stopped, then free.

Twenty of each, with a UR5 whose controller falls silent a second after the last target, and which
stops after as many ticks without an answer. All is counted in ticks of the robot, from the log of
its controller: a busy one may see neither a stop nor what follows it, but hears of it. How soon a
hold comes is printed: it depends on the machine. It must come before the hand is where it was
dragged to, and others must be able to steer soon after the lease.

A browser that is asked to close a page lets it live on until it has drawn, and the page says so
meanwhile. The time from its last message is printed, too.
"""

from __future__ import annotations

import os
import signal
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import TimeoutError as PlaywrightTimeout
from support.command_bench import EVENTS, PATIENCE_S, endpoint
from support.pages.chromium import chromium
from support.pages.steered_arm import HOME, ROBOT, Targets, address, hand, steer, viewed_arm
from support.pages.view_bench import page

import hoap3
from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.steering import LEASE_S
from hoap3.tools.logs.log import Log
from hoap3.tools.services.connection import Connection

pytestmark = pytest.mark.long  # robot, controller and a browser need two CPUs for themselves
TURNS, TRIES = 20, 60
SOON_S = 5.0  # after which a page asks again
LEASE_TICKS = round(1e3 * LEASE_S)
STALE_TICKS = 1000
SILENT_TICKS = 1000  # no machine keeps a controller silent so long: then the robot stops
FAR_PIXELS = 30  # some 15 to 20 cm
SPEED_M_S = 0.1  # at most, so that it takes well over a second
STILL_RAD_S = 2e-3  # of every joint: it does not move
MOVING_RAD = 2e-3  # of a joint: by then it moves
SOON_TICKS = 500  # what a busy machine may take for what should be at once
LATE_TICKS = 10  # answers just before the silence, which were late: the row of misses began there
SHORT_M = 0.05  # of where it was dragged to, it is held
CLOSE_M = 0.01  # to where it was held it stays: it brakes
STALE, STOP = (
    next(kind for kind, name in EVENTS.items() if name == wanted)
    for wanted in ("TARGET_STALE", "SAFE_STOP")
)
VIEWPORT = {"width": 640, "height": 480}


@dataclass(frozen=True)
class Turn:
    """One page that went.

    Attributes:
        moving_ns, gone_ns, free_ns: when the robot moved, the page went, and the next one steered.
        said_ns: when it said something last, or `gone_ns` where that was before.
        aim, held: where the page dragged the hand to, and where it was told to stay then.
        rest: where the hand was when the robot had stopped.
    """

    moving_ns: int
    gone_ns: int
    said_ns: int
    free_ns: int
    aim: FloatArray
    held: FloatArray
    rest: FloatArray


def processes(browser: Any, kind: str = "") -> list[int]:
    """What the browser says that it consists of, all or of one kind such as `renderer`."""
    asked = browser.new_browser_cdp_session()
    told = asked.send("SystemInfo.getProcessInfo")["processInfo"]
    asked.detach()
    return [each["id"] for each in told if kind in ("", each["type"])]


def send(number: int, pids: Sequence[int]) -> None:
    assert pids
    for pid in pids:
        with suppress(ProcessLookupError):
            os.kill(pid, number)


@contextmanager
def gone(seen: Any, how: str, pages: Sequence[int], all_: Sequence[int]) -> Iterator[int]:
    """Close, freeze or kill a page; when that began [ns]. At the end one that is frozen goes on.

    Args:
        pages, all_: processes of the pages, and those of the whole browser.
    """
    begin = time.monotonic_ns()
    if how == "closed":
        seen.close()
    else:
        send(*{"frozen": (signal.SIGSTOP, pages), "killed": (signal.SIGKILL, all_)}[how])
    try:
        yield begin
    finally:
        if how == "frozen":
            send(signal.SIGCONT, pages)
    if how == "frozen":  # it finds that it steers no longer
        seen.wait_for_selector("#steer[aria-pressed=false]")


def opened(browser: Any, view: tuple[str, str]) -> tuple[Any, deque[int]]:
    """A page that may steer, and when it has sent its last message [ns]: its browser says so."""
    host, token = view
    seen = browser.new_page(viewport=VIEWPORT, device_scale_factor=0.25)
    seen.set_default_timeout(1e3 * PATIENCE_S)
    said, session = deque[int](maxlen=1), seen.context.new_cdp_session(seen)
    session.send("Network.enable")
    session.on(  # its clock is the monotonic one
        "Network.webSocketFrameSent", lambda told: said.append(round(1e9 * told["timestamp"]))
    )
    seen.goto(f"http://{host}/#{token}")
    seen.wait_for_function("() => window.hoap3?.drawn.length > 3 && hoap3.proved")
    return seen, said


def follow(robot: Connection) -> None:
    """Have the robot follow, also where a hold has become stale, and be where it was held."""
    for state in robot.states(PATIENCE_S):
        if state.mode == State.ACTIVE and np.abs(state.reference_rate).max() < STILL_RAD_S:
            return
        if state.mode == State.STOPPED:
            robot.recover()


def stopped(robot: Connection) -> FloatArray:
    """Wait until it has stopped; where its hand is, (3,) [m]."""
    return next(hand(state) for state in robot.states(PATIENCE_S) if state.mode == State.STOPPED)


def become_operator(seen: Any) -> bool:
    """Ask for it, unless the page steers already; whether it does soon. A busy one may fail."""
    if seen.locator("#steer").get_attribute("aria-pressed") != "true":
        seen.click("#steer")
        with suppress(PlaywrightTimeout):
            seen.wait_for_selector("#steer[aria-pressed=true]", timeout=1e3 * SOON_S)
    return bool(seen.locator("#steer").get_attribute("aria-pressed") == "true")


def pull(seen: Any, targets: Targets, robot: Connection) -> int | None:
    """Become the operator, and pull the hand's gizmo along x, until the robot moves.

    It is pulled to where it began: each turn ends somewhere else, and the arm is not endless.

    Returns:
        How many targets have been sent by then, of all; None where the page was held meanwhile, as
        one is that the busy machine leaves no time.
    """
    seen.mouse.up()
    follow(robot)
    if not become_operator(seen):
        return None
    gizmo = seen.evaluate("hoap3.gizmo('hand')")
    start, along = np.array(gizmo["handle"]), np.subtract(gizmo["handle"], gizmo["centre"])
    along = np.sign(HOME[0] - hand(robot.state())[0]) * along / np.linalg.norm(along)
    seen.mouse.move(*start)
    seen.mouse.down()
    before, rest = len(targets.sent), robot.state().reference
    seen.mouse.move(*(start + FAR_PIXELS * along))
    end = time.monotonic() + SOON_S
    for state in robot.states(PATIENCE_S):
        count = len(targets.sent)
        if count > before + 1 or time.monotonic() > end:
            return None
        if count == before + 1 and np.abs(state.reference - rest).max() > MOVING_RAD:
            return count
    raise AssertionError


def let_go(
    visit: tuple[Any, deque[int]],
    how: str,
    view: tuple[str, str],
    targets: Targets,
    robot: Connection,
) -> Turn | None:
    """Have a page drag and go, the next one steer, and the robot stop and recover.

    Args:
        visit: a page, and when it said something last.
        how, view, targets, robot: how it goes, where it came from, and whom it steers.

    Returns:
        None where the page was held just before it went.
    """
    seen, said = visit
    browser = seen.context.browser
    pages, all_ = processes(browser, "renderer"), processes(browser)
    for _ in range(TRIES):
        count = pull(seen, targets, robot)
        if count is not None:
            break
    else:
        pytest.fail("the machine is so busy that a page is held whenever it drags")
    moving = time.monotonic_ns()
    with gone(seen, how, pages, all_) as begin:
        assert targets.wait_for(count + 1), "nothing is held"
        with page(*view) as pen:
            steer(pen)
            free = time.monotonic_ns()
            pen.act(verb="release")
    rest = stopped(robot)
    holds = targets.sent[count:]
    for _, values in holds:  # one may be sent again, and nothing else is
        np.testing.assert_array_equal(values, holds[0][1])
    if holds[0][0] < begin:
        return None
    last = max(begin, said[-1]) if how == "closed" else begin
    return Turn(moving, begin, last, free, targets.sent[count - 1][1], holds[0][1], rest)


def let_all_go(
    how: str, view: tuple[str, str], targets: Targets, robot: Connection
) -> Iterator[Turn]:
    """Turn after turn; a page and a browser as long as they last."""
    with ExitStack() as stack:
        browser = visit = None
        for _ in range(TRIES):
            browser = browser or stack.enter_context(chromium())
            visit = visit or opened(browser, view)
            turn = let_go(visit, how, view, targets, robot)
            if turn is not None:
                yield turn
            if how != "frozen":
                visit = None
            if how == "killed":
                browser = None
                stack.close()


def judge(log: Log, how: str, turns: Sequence[Turn]) -> None:
    """Each was held, then stopped as its config says, and made way; prints when, in ticks.

    A robot counts as stopped from when it begins to stop.
    """
    received, states = log.table(Kind.STATE)
    taken, _ = log.table(Kind.TARGET)
    events = log.table(Kind.EVENT)[1]
    silences = events["tick"][events["kind"] == STALE]
    ticks = states["tick"]
    sent = ticks[np.searchsorted(received, taken) - 1] + 1  # of the States that are answered by it
    stops = events["tick"][events["kind"] == STOP]
    found = list[list[int]]()
    for turn in turns:
        stamps = [turn.gone_ns, turn.said_ns, turn.free_ns]
        begin, last, free = np.searchsorted(states["stamp_published"], stamps)
        hold = sent[np.searchsorted(taken, turn.moving_ns)]
        silent = silences[np.searchsorted(silences, hold)]
        due = sent[np.searchsorted(sent, silent) - 1] + STALE_TICKS  # of the last that was sent
        first = np.searchsorted(ticks, due)
        assert silent in ticks[first : first + 2]  # rounded
        stop = stops[np.searchsorted(stops, silent)]
        found.append([int(tick) - int(ticks[begin]) for tick in (hold, ticks[free], silent, stop)])
        found[-1].append(int(hold) - int(ticks[last]))
        short, off = (np.linalg.norm(turn.held - each) for each in (turn.aim, turn.rest))
        assert -LATE_TICKS <= int(stop) - int(silent) - SILENT_TICKS <= SOON_TICKS
        print(f"{how}: after {found[-1]}; {short:.3f} m short, and {1e3 * off:.1f} mm off at rest")
        assert short > SHORT_M
        assert off < CLOSE_M
    whats = "held", "free", "silent", "stopped", "held, from its last message on,"
    for what, each in zip(whats, np.transpose(found), strict=True):
        p50, p95 = np.percentile(each, [50, 95])
        spread = f"min {each.min()}, p50 {p50:.0f}, p95 {p95:.0f}, max {each.max()}"
        print(f"{how}: {what} after {spread} ticks, n {each.size}")
    assert max(each[1] for each in found) <= LEASE_TICKS + SOON_TICKS


@pytest.mark.parametrize("how", ["closed", "frozen", "killed"])
def test_twenty_pages_that_go_are_held_and_stopped_and_make_way(how, tmp_path):
    at, target = endpoint(), "parameters.tasks.0.parameters.target"
    changes = {"speed_m_s": SPEED_M_S, "stale_after_s": 1e-3 * STALE_TICKS, "when_stale": "stop"}
    words = (("--set", f"{target}.{key}={value}") for key, value in changes.items())
    law = (*(word for pair in words for word in pair), "--out", tmp_path)
    with (
        viewed_arm(at, law, ("--set", f"misses_to_stop={SILENT_TICKS}")) as (command, viewer),
        hoap3.connect(ROBOT, at) as robot,
        Targets(at) as targets,
    ):
        turns = list(islice(let_all_go(how, address(viewer), targets, robot), TURNS))
        command.end(signal.SIGINT)
    assert len(turns) == TURNS
    judge(Log.open(tmp_path), how, turns)
