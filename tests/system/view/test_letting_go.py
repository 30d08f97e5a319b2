"""Clients that freeze, are killed or are closed while they drag: what moves is held, others may.

They say what a page says, from a process of their own; real browsers have a longer test beside it.
"""

from __future__ import annotations

import os
import signal

import numpy as np
import pytest
from support.pages.steered_arm import FAR, dragging, steer, until_rest
from support.pages.view_bench import page

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_a_page_that_freezes_or_is_killed_while_it_drags_lets_go(number, home, host, token, robot):
    with dragging(host, token, FAR) as process:
        os.kill(process.pid, number)
        since = robot.state()
        took, place = until_rest(robot, since)
        print(f"{number.name}: at rest after {took:.3f} s")
        assert np.linalg.norm(place - FAR) > 0.05  # it did not go on to where it was dragged
        with page(host, token) as pen:
            steer(pen)
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
