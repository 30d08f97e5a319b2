"""What a report is made from: the logs of one run, and what they say about themselves."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hoap3.protocol.errors import LogError
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.log import NEVER_OURS, Log, open_sides


@dataclass
class Sources:
    """The logs of one run.

    Attributes:
        path: the first folder or file that was given.
        robot, controller: the log of each side, or None.
        lockstep: whether all stamps are virtual.
        summary: what the robot counted itself, at its end; empty where that is not in its log.
        gaps: what is missing, in words, each with what follows from it.
        damaged: what is lost of each log that is cut off or damaged, in words, by side.
        unreadable: why a log that is there cannot be read at all, in words, by side.
        label: all folders or files that were given, as text.
    """

    path: Path
    robot: Log | None
    controller: Log | None
    lockstep: bool
    summary: dict[str, Any]
    gaps: list[str] = field(default_factory=list)
    damaged: dict[str, str] = field(default_factory=dict)
    unreadable: dict[str, str] = field(default_factory=dict)
    label: str = ""

    @classmethod
    def open(cls, path: Path, *more: Path, say: Callable[[str], None] = lambda _: None) -> Sources:
        """Open the folder of a run, one file, or the folders of two services.

        Raises:
            LogError: there is no log of ours, or those of two sessions.
        """
        opened, unreadable = open_sides(path, *more)
        found = [log.load(say) for log in opened.values()]
        gaps = [f"The log of the {side} cannot be read: {why}." for side, why in unreadable.items()]
        logs = {log.side: log for log in found}
        robot, controller = logs.get("robot"), logs.get("controller")
        cut = [log for log in found if log.missing]
        gaps += [f"The log of the {log.side} is not whole: {log.missing}." for log in cut]
        damaged = {log.side: log.missing for log in found if log.truncated or log.damages}
        gaps += [
            f"There is no log of the {side}: {what} only there."
            for side, what in _ONLY_THERE.items()
            if side not in logs and side not in unreadable
        ]
        said = {log.side: _inputs(log) for log in found}
        gaps += [
            f"{len(each['not JSON'])} records of the log of the {side} cannot be read."
            for side, each in said.items()
            if each["not JSON"]
        ]
        gaps += [
            f"{log.others} messages of the log of the {log.side} are on topics that are not ours."
            for log in found
            if log.others
        ]
        dropped = sum(gap["dropped"] for each in said.values() for gap in each["gap"])
        if dropped:
            gaps.append(f"{dropped} records came faster than they were written, and are not there.")
        sessions = [session for each in said.values() for session in each["session"]]
        lockstep = any(session.get("lockstep") is True for session in sessions)
        summaries = said.get("robot", {}).get("summary", [])
        counted = summaries[-1] if summaries else {}
        label = ", ".join(map(str, (path, *more)))
        return cls(path, robot, controller, lockstep, counted, gaps, damaged, unreadable, label)

    @property
    def logs(self) -> list[Log]:
        """Those that there are, the robot's first."""
        return [log for log in (self.robot, self.controller) if log is not None]

    def of(self, side: str) -> Log | None:
        """The log of one side."""
        return self.robot if side == "robot" else self.controller

    @property
    def main(self) -> Log:
        """The robot's log, or what there is."""
        return self.logs[0]

    @property
    def lost(self) -> set[str]:
        """Sides of which evidence may be lost: a recording from outside never had any."""
        robot = self.robot
        outside = robot is not None and "recorded" in robot.metadata.get("run", {})
        return {*self.damaged, *self.unreadable} - ({"robot"} if outside else set())

    @property
    def repairable(self) -> set[str]:
        """Sides of damaged logs that nobody has repaired yet."""
        damaged = [log for log in self.logs if log.side in self.damaged]
        return {log.side for log in damaged if "repair" not in log.metadata}

    def counted(self, name: str) -> int | None:
        """A count of the robot's own summary; None where that is not in its log."""
        found = self.summary.get(name)
        return found if isinstance(found, int) else None

    def settings(self, side: str) -> dict[str, Any]:
        """The resolved config of a side; empty where it is not known."""
        log = self.of(side)
        return (log.settings if log is not None else None) or {}


_ONLY_THERE = {
    "robot": "whether answers were in time, and when it woke, stands",
    "controller": "its settings, and States that it never got, stand",
}


@contextmanager
def of_ours(path: Path) -> Iterator[None]:
    """Turn what a log of ours could never lead to into an error that names the log.

    Raises:
        LogError: instead of whatever reading or drawing it raised.
    """
    try:
        yield
    except NEVER_OURS as error:
        raise LogError(
            f"{path}: holds a record that no service of ours has written "
            f"({type(error).__name__}: {error}). Name a log of `hoap3`"
        ) from error


def _inputs(log: Log) -> dict[str, list[dict[str, Any]]]:
    """What the JSON records of a log say, by kind."""
    kinds = {Kind.SESSION: "session", Kind.SUMMARY: "summary", Kind.GAP: "gap"}
    said: dict[str, list[dict[str, Any]]] = {name: [] for name in (*kinds.values(), "not JSON")}
    for record in log.records(*kinds):
        try:
            content = json.loads(record.payload)
        except (ValueError, RecursionError):
            said["not JSON"].append({})
            continue
        if isinstance(content, dict):
            said[kinds[record.kind]].append(content)
    return said
