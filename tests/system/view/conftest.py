"""UR5 that runs, and the live page's server that shows it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from support.command_bench import Command, endpoint
from support.pages.steered_arm import HOME, ROBOT, address, goes_to, steer, viewed_arm
from support.pages.view_bench import page

import hoap3
from hoap3.tools.services.connection import Connection


@pytest.fixture(scope="module")
def at() -> str:
    return endpoint()


@pytest.fixture(scope="module")
def viewed(at: str) -> Iterator[Command]:
    with viewed_arm(at) as (_, viewer):
        yield viewer


@pytest.fixture(scope="module")
def host(viewed: Command) -> str:
    return address(viewed)[0]


@pytest.fixture(scope="module")
def token(viewed: Command) -> str:
    return address(viewed)[1]


@pytest.fixture
def robot(at: str) -> Iterator[Connection]:
    with hoap3.connect(ROBOT, at, every_tick=True) as connected:
        yield connected


@pytest.fixture
def home(robot: Connection, host: str, token: str) -> None:
    """The hand is at its place, nobody steers, and the robot follows."""
    if robot.status()["mode"] == "stopped":
        robot.recover()
    for _ in range(3000):
        if robot.status()["mode"] == "active":
            break
    with page(host, token) as pen:
        steer(pen)
        goes_to(robot, pen, HOME)
        assert pen.act(verb="release")["error"] is None
