"""Make real-time logs with misses or stalls: processes of a run are stopped for 30 ms at a time."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import time
from pathlib import Path

from .revision import Revision

PAUSES, PAUSE_S, BETWEEN_S = 6, 0.03, 0.3
START_S = 300.0  # kernels may have to be compiled


def record_realtime(revision: Revision, folder: Path, *, stalls: bool) -> None:
    """Record HOAP-3 with qp12 in real time.

    Args:
        revision: whose services are run.
        folder: where the log goes.
        stalls: pause the robot, the controller and their monitors, as a host does that takes the
            CPU away; otherwise only the controller, whose answers are late then.

    Raises:
        RuntimeError: the robot has not become active.
    """
    folder.mkdir(parents=True)
    port = free_port()
    rights = () if stalls else ("--no-realtime",)
    common = "--out", "log", *rights, "--set"
    place = f"[tcp/127.0.0.1:{port}]"
    robot_words = "hoap3", "emulator", "hoap3", *common, f"link.listen={place}"
    words = "hoap3", "controller", "qp12", *common, f"link.connect={place}"
    with (folder / "stderr").open("w") as errors:
        streams = {"stdout": errors, "stderr": errors}
        patient = "--set", "misses_to_stop=100000"
        robot = revision.start((*robot_words, *patient), folder, **streams)
        controller = revision.start(words, folder, **streams)
        try:
            wait_until_active(revision, folder, port)
            for _ in range(PAUSES):
                time.sleep(BETWEEN_S)
                pause([robot.pid, controller.pid] if stalls else [controller.pid], family=stalls)
            time.sleep(BETWEEN_S)
        finally:
            for process in (controller, robot):
                process.send_signal(signal.SIGINT)
                end(process)


def free_port() -> int:
    """A port that was free a moment ago."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_until_active(revision: Revision, folder: Path, port: int) -> None:
    """Poll the robot's status until it follows its controller."""
    words = "hoap3", "status", "hoap3", "--connect", f"tcp/127.0.0.1:{port}", "--json"
    until = time.monotonic() + START_S
    while time.monotonic() < until:
        streams = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        text = revision.start(words, folder, **streams).communicate()[0]
        if text and json.loads(text).get("mode") == "active":
            return
    raise RuntimeError(f"the robot does not become active: see {folder / 'stderr'}")


def pause(pids: list[int], *, family: bool) -> None:
    """Stop processes, perhaps with their children, for a moment."""
    if family:
        pids = [each for pid in pids for each in (pid, *descendants_of(pid))]
    for number in (signal.SIGSTOP, signal.SIGCONT):
        for pid in pids:
            try:
                os.kill(pid, number)
            except ProcessLookupError:
                continue
        if number == signal.SIGSTOP:
            time.sleep(PAUSE_S)


def descendants_of(pid: int) -> list[int]:
    """Processes that a process, or one of these, has started."""
    files = Path(f"/proc/{pid}/task").glob("*/children")
    children = [int(word) for path in files for word in path.read_text(encoding="ascii").split()]
    return [each for child in children for each in (child, *descendants_of(child))]


def end(process: subprocess.Popen[str]) -> None:
    """Wait for the end of a process, and kill it if it does not come."""
    try:
        process.wait(60.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
