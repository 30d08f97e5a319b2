"""Starts `hoap3` commands as a user would, hears what they say, and leaves none of them behind."""

from __future__ import annotations

import io
import json
import os
import re
import select
import signal
import socket
import subprocess
import sys
import sysconfig
import threading
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Self
from unittest.mock import patch

import numpy as np

from hoap3.protocol.messages import Event, State
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.analysis import result_folder
from hoap3.tools.cli.app import main
from hoap3.tools.logs.log import Log

HOAP3 = str(Path(sysconfig.get_path("scripts")) / "hoap3")
STOPS = (signal.SIGINT, signal.SIGTERM)
PATIENCE_S = 120.0  # with everything: machines are slow, shared and busy
SERVICES = frozenset({"run", "emulator", "controller"})
QUIET = ("--set", "log.record=false")
PATIENT = ("--set", "misses_to_stop=100000")  # busy machines miss many
OBSERVER = "hoap3.tools.services.observer"
_MARK = "HOAP3_TEST_MARK"
EVENTS = {value: name for name, value in Event.schema.constants.items() if name[:6] != "REASON"}


def free_port() -> int:
    """A port that was free a moment ago."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def endpoint() -> str:
    """A free place for a robot to listen."""
    return f"tcp/127.0.0.1:{free_port()}"


def on_path(folder: Path) -> dict[str, str]:
    """Environment in which a folder comes first on the import path."""
    return {"PYTHONPATH": os.pathsep.join([str(folder), *filter(None, [os.getenv("PYTHONPATH")])])}


class Command:
    """A `hoap3` command that runs, its descendants, and what it has said.

    Args:
        arguments: behind `hoap3`; the real-time commands get `--no-realtime`.
        verbose: have `run` say all that its services say, which tests wait for.
        environment: changes of ours; None takes a variable away.
        wrapper: what `hoap3` is started by.

    Attributes:
        listens: where it was found to listen, if anybody looked.
    """

    listens: frozenset[str] | set[str] = frozenset()

    def __init__(
        self,
        *arguments: object,
        cwd: Path | None = None,
        environment: Mapping[str, str | None] | None = None,
        wrapper: Sequence[str] = (),
        verbose: bool = True,
    ) -> None:
        self._mark = uuid.uuid4().hex
        words = [str(argument) for argument in arguments]
        plain = ["--no-realtime"] if words[0] in SERVICES else []
        plain += ["--verbose"] if words[0] == "run" and verbose else []
        changes = {_MARK: self._mark, **(environment or {})}
        merged = {**os.environ, **changes}
        self.process = subprocess.Popen(
            [*wrapper, HOAP3, *words, *plain],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=cwd,
            env={key: value for key, value in merged.items() if value is not None},
        )
        self._texts = {"stdout": "", "stderr": ""}
        self._ended: set[str] = set()
        self._news = threading.Condition()
        self._threads = [
            threading.Thread(target=self._read, args=(name,), daemon=True) for name in self._texts
        ]
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for pid in [self.process.pid, *self.family()]:
            _kill(pid)
        self.process.wait()
        for thread in self._threads:
            thread.join(PATIENCE_S)

    @property
    def stdout(self) -> str:
        """Standard output so far."""
        return self._texts["stdout"]

    @property
    def stderr(self) -> str:
        """Standard error so far."""
        return self._texts["stderr"]

    def wait_for(self, pattern: str, times: int = 1, stream: str = "stderr") -> re.Match[str]:
        """Wait until it has said something that matches; fails where it ends without."""
        found: list[re.Match[str]] = []

        def heard() -> bool:
            found[:] = re.finditer(pattern, self._texts[stream])
            return len(found) >= times or stream in self._ended

        with self._news:
            in_time = self._news.wait_for(heard, PATIENCE_S)
        why = f"{'ended' if in_time else 'waited'} without {pattern!r}"
        assert len(found) >= times, f"{why}:\n{self.stderr}"
        return found[times - 1]

    def send(self, number: int) -> None:
        """Send it, and it alone, a signal."""
        self.process.send_signal(number)

    def ended_within(self, seconds: float) -> bool:
        """Let it go on for some time; whether it has ended meanwhile."""
        try:
            self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        return True

    def end(self, number: int | None = None) -> int:
        """Wait for its end, after a signal if one is given; its exit code."""
        if number is not None:
            self.send(number)
        try:
            code = self.process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            raise AssertionError(f"does not end:\n{self.stderr}") from None
        with self._news:
            self._news.wait_for(lambda: self._ended == set(self._texts), PATIENCE_S)
        return code

    def json(self) -> Any:
        """The one JSON object on standard output."""
        return json.loads(self.stdout)

    def family(self) -> dict[int, list[str]]:
        """Command lines of all its descendants that live, wherever they have been adopted."""
        mark = f"{_MARK}={self._mark}".encode()
        found = {}
        for entry in Path("/proc").iterdir():
            if entry.name.isdecimal() and int(entry.name) != self.process.pid:
                try:
                    if mark in (entry / "environ").read_bytes().split(b"\0"):
                        words = (entry / "cmdline").read_bytes().decode().split("\0")
                        found[int(entry.name)] = words
                except OSError:
                    continue
        return found

    def assert_no_orphan(self) -> None:
        """Nothing that it started outlives it for long."""
        for pid in self.family():
            wait_for_end(pid)
        assert self.family() == {}

    def _read(self, name: str) -> None:
        stream = getattr(self.process, name)
        for line in stream:
            with self._news:
                self._texts[name] += line
                self._news.notify_all()
        with self._news:
            self._ended.add(name)
            self._news.notify_all()


@contextmanager
def emulator(*arguments: object, at: str, **kinds: Any) -> Iterator[Command]:
    """A robot that listens, ready to be talked to."""
    with Command("emulator", *arguments, "--set", f"link.listen=[{at}]", **kinds) as command:
        command.wait_for(r"is alive at")
        yield command


def controller(*arguments: object, at: str, **kinds: Any) -> Command:
    """A controller of the robot at an endpoint."""
    return Command("controller", *arguments, "--set", f"link.connect=[{at}]", **kinds)


@contextmanager
def following(*arguments: object, at: str, **kinds: Any) -> Iterator[Command]:
    """A controller that HOAP-3 at an endpoint follows, and is active."""
    with controller(*arguments, at=at, **kinds) as law:
        law.wait_for("following robot")
        wait_for_mode("active", at)
        yield law


@contextmanager
def followed(
    at: str,
    names: tuple[object, object] = ("hoap3", "qp12"),
    *,
    near: str | None = None,
    robot: Sequence[object] = (*QUIET, *PATIENT),
    law: Sequence[object] = QUIET,
    **kinds: Any,
) -> Iterator[tuple[Command, Command]]:
    """A robot that follows a controller: both commands.

    Args:
        at: where the robot listens.
        names: of the configs of the robot and of its controller.
        near: where its controller finds it instead.
        robot, law: further words of each.
        kinds: of the robot's command.
    """
    with (
        emulator(names[0], *robot, at=at, **kinds) as ours,
        controller(names[1], *law, at=near or at) as theirs,
    ):
        theirs.wait_for("following robot")
        yield ours, theirs


def spread(times: Sequence[float], unit: str) -> str:
    """How many times there are, the median and the longest, to be printed."""
    if not times:
        return "n 0"
    ranked = sorted(times)
    return (
        f"n {len(ranked)}, p50 {ranked[len(ranked) // 2]:.3g} {unit}, max {ranked[-1]:.3g} {unit}"
    )


def hoap3(*arguments: object, **kinds: Any) -> Command:
    """A command that has run to its end."""
    with Command(*arguments, **kinds) as command:
        command.end()
        return command


@dataclass(frozen=True)
class Done:
    """What a command that ran in this process left."""

    code: int
    stdout: str
    stderr: str

    def json(self) -> Any:
        """The one JSON object on standard output."""
        return json.loads(self.stdout)


def inside(*arguments: object) -> Done:
    """The same without a process of its own, which costs most of the time."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    before, handlers = sys.argv, {number: signal.getsignal(number) for number in STOPS}
    sys.argv = ["hoap3", *map(str, arguments)]
    ended: list[tuple[Any, ...]] = []  # what removes empty folders at the end of the process
    at_exit = SimpleNamespace(register=lambda *call: ended.append(call))
    try:
        with (
            redirect_stdout(out),
            redirect_stderr(err),
            patch.object(result_folder, "atexit", at_exit),
        ):
            main()
    except SystemExit as end:
        code = int(end.code or 0)
    finally:
        sys.argv = before
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for call, *of in reversed(ended):
            call(*of)
    return Done(code, out.getvalue(), err.getvalue())


def tell(verb: str, at: str, robot: str = "hoap3") -> dict[str, Any]:
    """What `hoap3 stop|recover|status` answers."""
    done = inside(verb, robot, "--connect", at, "--json")
    assert done.stdout, done.stderr
    answer: dict[str, Any] = done.json()
    return answer


def wait_for_mode(mode: str, at: str, robot: str = "hoap3") -> dict[str, Any]:
    """Ask for the robot's status until it is in that mode."""
    for _ in range(1000):
        status = tell("status", at, robot)
        if status["mode"] == mode:
            return status
    raise AssertionError(f"never {mode}, but {status}")


def wait_for_ticks(at: str, count: int, robot: str = "hoap3") -> None:
    """Wait until an active robot has advanced so many ticks, still active."""
    tick = wait_for_mode("active", at, robot)["tick"]
    while wait_for_mode("active", at, robot)["tick"] < tick + count:
        continue


def observer_of(service: Command, log: str = "", at: str = "") -> int:
    """Process id of the observer of a service; of that which writes `log`, once a robot moves."""
    for _ in range(100):
        for pid, words in service.family().items():
            if OBSERVER in words:
                handles = [handle.resolve() for handle in Path(f"/proc/{pid}/fd").iterdir()]
                if not log or log in {handle.name for handle in handles}:
                    return pid
        if at:
            wait_for_ticks(at, 50)  # it has only begun
    raise AssertionError(f"none among {service.family()}")


def wait_for_end(pid: int) -> None:
    """Return once a process that need not be our child has ended."""
    try:
        handle = os.pidfd_open(pid)
    except ProcessLookupError:
        return
    try:
        assert select.select([handle], [], [], PATIENCE_S)[0], f"process {pid} does not end"
    finally:
        os.close(handle)


def events(log: Log) -> list[tuple[str, int]]:
    """Kinds and details of a log's events, in order."""
    rows = log.table(Kind.EVENT)[1]
    return [(EVENTS[kind], detail) for kind, detail in rows[["kind", "detail"]].tolist()]


def assert_at_rest(log: Log) -> None:
    """The robot of this log stands still at its end, and does not ask for an answer."""
    states = log.states()
    assert len(states)
    last = states[-1]
    assert last["mode"] in {State.IDLE, State.STOPPED}
    assert not last["dq"].any()
    assert np.array_equal(last["q"], last["reference"])


def assert_ran(done: Done) -> None:
    """A run that came to its end; the code is 1 where it was too short to reach its target."""
    assert done.code in {0, 1}, done.stderr
    assert "error:" not in done.stderr, done.stderr


def assert_no_traceback(command: Command) -> None:
    """It failed, if it did, in words."""
    assert "Traceback" not in command.stderr, command.stderr
    assert "Exception" not in command.stderr, command.stderr


def _kill(pid: int) -> None:
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        return
