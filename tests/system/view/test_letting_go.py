"""Pages that freeze, go or are killed while they drag: what moves is held, and others may steer.

How long a hold takes is printed, and how much of it the server itself waited for a CPU. The tests
share theirs with others, so what is bounded is the time that is left.
"""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from support.command_bench import PATIENCE_S, Command, endpoint, events, wait_for_mode
from support.pages.steered_arm import (
    FAR,
    HOME,
    ROBOT,
    Targets,
    address,
    dragging,
    goes_to,
    hand,
    steer,
    until_rest,
    viewed_arm,
)
from support.pages.view_bench import PagePen, page

import hoap3
from hoap3.tools.logs.log import Log

pytestmark = pytest.mark.slow
HELD_S = 0.2  # what a hold may take, by the issue that asked for the page
TURNS = 20
MOST_TURNS = 60
SILENT_TICKS = 1000  # so busy is the machine never, and so long is the controller silent


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_a_page_that_freezes_or_is_killed_while_it_drags_lets_go(number, home, host, token, robot):
    with dragging(host, token, FAR) as process:
        os.kill(process.pid, number)
        since = robot.state()
        took, place = until_rest(robot, since)
        print(f"{number.name}: at rest after {took:.3f} s")
        assert np.linalg.norm(place - FAR) > 0.05  # it did not go on to where it was dragged
        with page(host, token) as pen:
            assert pen.prove()
            for _ in range(300):  # the next one may steer within the lease
                if pen.act(verb="acquire")["error"] is None:
                    break
                pen.hear("frame")
            else:
                pytest.fail("nobody else may steer")
            free = robot.state().tick - since.tick
            print(f"the next page steers after {free} ticks")
            pen.act(verb="release")


def test_a_page_that_is_closed_while_it_drags_lets_go(home, host, token, robot):
    with page(host, token) as pen:
        steer(pen)
        pen.act(verb="target", name="hand", values=FAR)
        for _ in range(15):  # half a second: it moves
            pen.beat()
            pen.hear("frame")
        since = robot.state()
    took, place = until_rest(robot, since)
    print(f"closed: at rest after {took:.3f} s")
    assert np.linalg.norm(place - FAR) > 0.05


class Holds:
    """How long holds took, and how long the server waited for a CPU meanwhile.

    Args:
        server: the command that shows the robot.
    """

    def __init__(self, server: Command) -> None:
        self._server = server.process.pid
        self._begin = self._waited = 0.0
        self.took: list[float] = []
        self.without: list[float] = []
        self.free: list[float] = []

    def begin(self) -> float:
        """Now; the page goes next."""
        self._waited = self._waited_so_far()
        self._begin = time.monotonic()
        return self._begin

    def end(self, took: float) -> None:
        """The hold was sent so long after."""
        self.took.append(took)
        self.without.append(self._waited_so_far() - self._waited)

    def check(self, what: str) -> None:
        """Print them all, and hold those against the issue that the machine has not lengthened."""
        print(f"{what}: held after {ranks(self.took)}; free after {ranks(self.free)}")
        print(f"{what}: of that the server waited for a CPU {ranks(self.without)}")
        left = [took - waited for took, waited in zip(self.took, self.without, strict=True)]
        print(f"{what}: held after, without that, {ranks(left)}")
        assert len(self.took) == TURNS
        assert max(left) <= HELD_S

    def _waited_so_far(self) -> float:
        """Of its first thread, which hears pages and decides: others may have waited, too [s]."""
        return int(Path(f"/proc/{self._server}/schedstat").read_text().split()[1]) * 1e-9


def ranks(times: list[float]) -> str:
    """How many there are, and their spread."""
    if not times:
        return "n 0"
    p50, p95 = np.percentile(times, [50, 95])
    return f"n {len(times)}, p50 {p50:.3f} s, p95 {p95:.3f} s, max {max(times):.3f} s"


def next_page_steers(pen: PagePen) -> None:
    for _ in range(600):
        if pen.act(verb="acquire")["error"] is None:
            return
        pen.hear("frame")
    pytest.fail("nobody else may steer")


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL, signal.SIGTERM])
def test_twenty_pages_that_freeze_or_go_are_held_in_time(number, viewed, host, token, robot, at):
    """Turns in which the busy machine had held the page before are done again."""
    holds, aims = Holds(viewed), [HOME, FAR]
    with Targets(at) as targets:
        for turn in range(MOST_TURNS):
            if len(holds.took) == TURNS:
                break
            with page(host, token) as pen:
                steer(pen)
                goes_to(robot, pen, aims[turn % 2])
                pen.act(verb="release")
            drag = time.monotonic()
            with dragging(host, token, aims[1 - turn % 2]) as process:
                begin = holds.begin()
                if sum(drag < each < begin for each in targets.times) > 1:
                    continue
                os.kill(process.pid, number)
                holds.end(targets.first_since(begin))
                since = robot.state().tick
                with page(host, token) as pen:
                    assert pen.prove()
                    next_page_steers(pen)
                    holds.free.append((robot.state().tick - since) * 1e-3)
                    pen.act(verb="release")
    holds.check(number.name)


STALE = ("stale_after_s=1.0", "when_stale=stop")


@pytest.mark.long  # it needs the machine for itself
@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_where_the_config_says_stop_a_robot_whose_page_freezes_or_goes_stops(number, tmp_path):
    """The controller falls silent, a second after the hold was sent; its log says why."""
    at, target = endpoint(), "parameters.tasks.0.parameters.target"
    words = [word for each in STALE for word in ("--set", f"{target}.{each}")]
    law = (*words, "--out", tmp_path / "log")
    with (
        viewed_arm(at, law, ("--set", f"misses_to_stop={SILENT_TICKS}")) as command,
        hoap3.connect(ROBOT, at, every_tick=True) as robot,
    ):
        host, token = address(command)
        with dragging(host, token, FAR) as process:
            os.kill(process.pid, number)
            wait_for_mode("stopped", at, ROBOT)
        deadline = time.monotonic() + PATIENCE_S
        while "TARGET_STALE" not in dict(events(Log.open(tmp_path / "log"))):
            assert time.monotonic() < deadline, "it stopped for another reason"
        assert np.linalg.norm(hand(robot.state()) - FAR) > 0.05
        with page(host, token) as pen:
            assert pen.prove()
            next_page_steers(pen)
            pen.act(verb="release")
