"""Real sessions on loopback: free ports, things in the background, and waiting without sleeping."""

from __future__ import annotations

import os
import re
import socket
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.link.zenoh_link import ZenohControllerLink, ZenohRobotLink, key
from hoap3.protocol.messages import Setpoint, State

PATIENCE_S = 30.0  # on a machine so busy that nothing else explains it


def free_endpoint() -> str:
    """An endpoint on a port that was free a moment ago."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def eventually(condition: Callable[[], Any], what: str = "this") -> Any:
    """Whatever `condition` returns once it is true; it is asked again and again."""
    end = time.monotonic() + PATIENCE_S
    while not (found := condition()):
        assert time.monotonic() < end, f"{what} did not happen"
        os.sched_yield()
    return found


def listening() -> set[tuple[str, str]]:
    """Protocol and local address of each socket of this process that takes what comes in."""
    descriptors = Path("/proc/self/fd").iterdir()
    targets = [os.readlink(path) for path in descriptors if path.is_symlink()]
    inodes = {
        found[1] for target in targets if (found := re.fullmatch(r"socket:\[(\d+)\]", target))
    }
    found = set()
    for protocol in ("tcp", "tcp6", "udp", "udp6"):
        for line in Path(f"/proc/self/net/{protocol}").read_text().splitlines()[1:]:
            _, local, _, state, *rest = line.split()
            if rest[5] in inodes and (state == "0A" or protocol.startswith("udp")):
                found.add((protocol, local))
    return found


class Network:
    """Links that one test opens; closed at its end.

    Attributes:
        endpoint: where the robot of `pair` listens.
    """

    def __init__(self) -> None:
        self.endpoint = ""
        self._opened: list[Any] = []
        self._threads = ThreadPoolExecutor()

    def robot(self, name: str = "arm", *, blocking: bool = False, **link: object) -> ZenohRobotLink:
        """The robot's side."""
        return self.keep(ZenohRobotLink(name, LinkSettings(**link), blocking=blocking))

    def controller(
        self, endpoint: str, name: str = "arm", who: str = "test", *, blocking: bool = False
    ) -> ZenohControllerLink:
        """The controller's side, once it knows that the robot is there."""
        settings = LinkSettings(connect=(endpoint,))
        link = self.keep(ZenohControllerLink(name, settings, who, blocking=blocking))
        came(link)
        return link

    def pair(self, *, blocking: bool = False) -> tuple[ZenohRobotLink, ZenohControllerLink]:
        """Both sides, each knowing that the other listens."""
        self.endpoint = free_endpoint()
        robot = self.robot(listen=(self.endpoint,), blocking=blocking)
        controller = self.controller(self.endpoint, blocking=blocking)
        known(robot, controller)
        return robot, controller

    def keep(self, link: Any) -> Any:
        """Close this, too, at the end."""
        self._opened.append(link)
        return link

    def start(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Run something in the background."""
        return self._threads.submit(function, *arguments)

    def close(self) -> None:
        """Close everything, the newest first."""
        for link in reversed(self._opened):
            link.close()
        self._threads.shutdown(wait=True)


def came(link: ZenohControllerLink) -> None:
    """Wait until the robot is there, and take the waking that tells so: it may hide a State."""
    assert link.presence.wait(PATIENCE_S)
    assert link.wait() is None


def token_seen(robot: ZenohRobotLink, who: str) -> None:
    """Wait until the robot knows of a client's token."""
    expression = key("arm", f"clients/{who}")
    liveliness = robot._session.liveliness()
    eventually(lambda: [reply for reply in liveliness.get(expression) if reply.ok], "a token")


def known(robot: ZenohRobotLink, controller: ZenohControllerLink) -> None:
    """Wait until either side knows that the other one listens."""
    eventually(lambda: robot._state.matching_status.matching, "a subscriber to states")
    eventually(lambda: controller._setpoint.matching_status.matching, "a subscriber to setpoints")


def next_state(link: ZenohControllerLink) -> tuple[int, bytes]:
    """The next arrival at the controller, whatever wakes it before."""
    end = time.monotonic() + PATIENCE_S
    alarm = threading.Timer(PATIENCE_S, link.wake)
    alarm.start()
    try:
        while (arrival := link.wait()) is None:
            assert time.monotonic() < end, "no State came"
    finally:
        alarm.cancel()
    return arrival


def answer_to(link: ZenohControllerLink, tick: int) -> Setpoint:
    """An answer to the State of a tick, for three joints, which asks for no motion."""
    state, setpoint = State(3), Setpoint(3)
    while state.tick != tick:
        state.load(next_state(link)[1])
    setpoint.session_id, setpoint.tick = state.session_id, state.tick
    setpoint.epoch, setpoint.stamp_state = state.epoch, state.stamp_published
    setpoint.values[:] = state.reference
    return setpoint
