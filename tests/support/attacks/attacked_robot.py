"""A robot on virtual time that attacks are made on: in this process, or in another network's.

As a program it is told by JSON lines what to do, one robot after the other.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.link.zenoh_link import ZenohRobotLink
from hoap3.protocol.link.zenoh_session import key
from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.protocol.runtime.realtime import Ticker
from hoap3.protocol.runtime.recorder import MemoryRecorder
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.loop import RobotLoop
from support.small_arm import arm

SESSION = 7


@dataclass(frozen=True)
class Now:
    """What a robot is after a tick."""

    mode: int
    tick: int
    epoch: int
    newest_tick: int


class AttackedRobot:
    """One in this process.

    Args:
        endpoint: where it listens.
        certs: folder of the authority, with certificates.
    """

    def __init__(self, endpoint: str, certs: str | None) -> None:
        secure = None if certs is None else str(Path(certs) / "arm")
        beyond = secure is None and "127.0.0.1" not in endpoint
        settings = LinkSettings(listen=(endpoint,), secure=secure, insecure=beyond)
        self._link = ZenohRobotLink("arm", settings, blocking=True)
        clock, config = VirtualClock(), EmulatorConfig(robot="arm", misses_to_stop=10**9)
        self._robot = RobotLoop(arm(), config, clock, self._link, MemoryRecorder(), SESSION)
        self._ticker = Ticker(clock, self._robot.period, 0)

    def step(self) -> Now:
        """One tick."""
        self._ticker.wait()
        self._robot.step(self._ticker)
        grant, validator = self._robot._authority.grant, self._robot.validator
        epoch = 0 if grant is None else grant.epoch
        return Now(self._robot.mode, self._robot.tick, epoch, validator.newest_tick)

    def stop(self) -> None:
        """As a command of its own machine does."""
        self._robot.stop("REASON_COMMAND")

    def clients(self) -> list[str]:
        """Names of the clients that it believes to be there."""
        found = self._link._session.liveliness().get(key("arm", "clients/*"), timeout=2.0)
        return [str(reply.ok.key_expr).rsplit("/", 1)[1] for reply in found if reply.ok]

    def lets_in(self, name: str) -> bool:
        """Whether the list has a name, as the robot knows it now."""
        guard = self._link._guard
        return guard is not None and name in guard._roles

    def close(self) -> None:
        """Listen no longer."""
        self._link.close()


class FarRobot:
    """The same in a process of its own, one after the other.

    Args:
        wrapper: what starts it, such as `nsenter`.
    """

    def __init__(self, wrapper: Sequence[str]) -> None:
        pipe = subprocess.PIPE
        words = [*wrapper, sys.executable, "-m", __name__]
        self._process = subprocess.Popen(words, stdin=pipe, stdout=pipe, text=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()

    def opened(self, endpoint: str, certs: str | None) -> Self:
        self._do("open", endpoint, certs)
        return self

    def step(self) -> Now:
        return Now(**self._do("step"))

    def stop(self) -> None:
        self._do("stop")

    def clients(self) -> list[str]:
        return self._do("clients")

    def lets_in(self, name: str) -> bool:
        return self._do("lets_in", name)

    def close(self) -> None:
        self._do("close")

    def _do(self, what: str, *given: str | None) -> Any:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps([what, *given]), file=self._process.stdin, flush=True)
        return json.loads(self._process.stdout.readline())


def serve() -> None:
    """Do what standard input says, until it ends."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # whatever else is printed
    for line in sys.stdin:
        what, *given = json.loads(line)
        result = None
        if what == "open":
            robot = AttackedRobot(*given)
        else:
            result = getattr(robot, what)(*given)
        told = asdict(result) if isinstance(result, Now) else result
        print(json.dumps(told), file=answers, flush=True)


if __name__ == "__main__":
    serve()
