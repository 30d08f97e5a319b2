"""A log as a source of frames, or two logs over each other: each page has a place of its own."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hoap3.protocol.errors import LogError, UsageError
from hoap3.protocol.messages import State
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.analysis.verdicts import judge_reported, shown
from hoap3.tools.logs.log import Log
from hoap3.tools.view.picture.frame import Frames, rounded
from hoap3.tools.view.picture.geometry import looks_of, shipped_robot
from hoap3.tools.view.sources.log_overview import Overview
from hoap3.tools.view.sources.play_clock import PlayClock

HEAD = 600  # chunks of a log's begin, half a second each, in which an active State is looked for
UNASKED = "no State near the begin of this log asks for an answer: seconds count from its begin"
TAIL = 4  # of its end, in which a summary is


class ShownLog:
    """One run, as far as it is shown.

    Args:
        path: a log, or the folder of a run.
        folder: of the robot on this machine, for its meshes; None: that of a robot that we know.

    Attributes:
        log: that is shown: the robot's, or else the controller's.
        zero: log time of the first active State [ns], from which seconds count; of the first
            message where none is near it, which `notes` say.
        frames: make its frames.
        verdicts: of the whole run.

    Raises:
        LogError: it cannot be read as one of ours.
    """

    def __init__(self, path: Path, folder: str | None = None) -> None:
        self.log, theirs = _sides(path)
        emulator = self.log.settings if self.log.side == "robot" else None
        law = theirs or (self.log if self.log.side == "controller" else None)
        about = {"config": law.settings, "extra": _extra(law)} if law else {}
        description = self.log.description
        named = folder or shipped_robot(emulator)
        self.frames = Frames(description, looks_of(description, named), about, emulator)
        first = self._first_active()
        self.zero, self._skipped = first or (self.log.begin, 0)
        self.notes = () if first else (UNASKED,)
        self.verdicts = self._judge(law)

    def frame(self, at_s: float) -> dict[str, Any] | None:
        """The frame of a time [s]; None where there is no State up to then, or none that fits."""
        found = self.log.state_at(round(at_s * 1e9) + self.zero)
        if found is None:
            return None
        if not self.frames.fits(found.state):
            return None
        shown = self.frames.frame(found.state, found.setpoint)
        if self.log.side == "robot" and found.setpoint is not None and found.answered is not None:
            took = found.answered - found.setpoint.stamp_state
            shown["values"]["answer_us"] = round(took / 1e3, 1)
        at_s = round((found.stamp - self.zero) / 1e9, 6)
        return {**shown, "at_s": at_s, "verdicts": self.verdicts}

    def _first_active(self) -> tuple[int, int] | None:
        """Log time of the first active State near the begin, and ticks skipped before."""
        for chunk in range(min(HEAD, self.log.chunks)):
            for record in self.log.chunk(chunk, keep=False):
                if record.kind == Kind.STATE:
                    mode, skipped = State.scalars(record.payload, "mode", "skipped")
                    if mode == State.ACTIVE:
                        return record.stamp, skipped
        return None

    def _judge(self, law: Log | None) -> dict[str, dict[str, str]]:
        """Return the verdicts on the run as the log states them: `report` derives its own."""
        robot = _summary(self.log) if self.log.side == "robot" else None
        outcome = None if law is None else _summary(law)
        skipped = None  # as the robot's summary counts them
        if "skipped" not in (robot or {}):
            last = self.log.state_at(self.log.end)
            skipped = max(last.state.skipped - self._skipped, 0) if last else 0
        verdicts = shown(judge_reported(robot or {}, outcome, skipped))
        for each in verdicts.values():
            each["words"] = f"as logged: {each['words']}"
        return verdicts


class LogSource:
    """A log, or two.

    Args:
        paths: of one log or two; the second is drawn as a ghost.
        folder: of the robot on this machine, for its meshes; None: that of a robot that we know.

    Attributes:
        live: False.
        version: stays; what is found later is told by `events`.

    Raises:
        LogError: one cannot be read as one of ours.
        UsageError: they are of robots with different links.
    """

    live = False

    def __init__(self, paths: Sequence[Path], folder: str | None = None) -> None:
        self.first, *others = (ShownLog(path, folder) for path in paths)
        self.second = others[0] if others else None
        if self.second is not None and self._links(self.second) != self._links(self.first):
            raise UsageError(f"{paths[1]}: its robot has other links than that of {paths[0]}")
        extras = self.first.frames.extras
        self.overview = Overview(self.first.log, self.first.zero, extras)
        self.overview.start()
        self._told = 0
        self.watched, self.version = False, 1

    def close(self) -> None:
        """End what goes on."""
        self.overview.close()

    @property
    def edition(self) -> int:
        """What `hello` is made of: how much was found so far."""
        return self.overview.version

    @property
    def meshes(self) -> Mapping[str, bytes]:
        """By digest."""
        return self.first.frames.looks.meshes

    def hello(self) -> dict[str, Any]:
        """What a page must know before the first frame."""
        fixed = self.first.frames.hello()
        return {
            "live": False,
            **fixed,
            "notes": [*fixed["notes"], *self.first.notes],
            "changeable": [],
            "log": self.overview.as_json(),
            "second": self.second is not None,
        }

    def changeable(self) -> list[dict[str, Any]]:
        """Nothing."""
        return []

    def frame(self) -> None:
        """None: each page has its own."""

    def events(self) -> list[dict[str, Any]]:
        """What more was found of the whole log."""
        version = self.overview.version
        if version == self._told:
            return []
        self._told = version
        return [{"kind": "log", "log": self.overview.as_json()}]

    def player(self) -> LogPlayer:
        """A place in it."""
        return LogPlayer(self)

    @staticmethod
    def _links(shown: ShownLog) -> tuple[str, ...]:
        return shown.frames.poses.links


class LogPlayer:
    """One page's place in the log."""

    def __init__(self, source: LogSource) -> None:
        self._source = source
        self._clock = PlayClock(time.monotonic)
        log, zero = source.first.log, source.first.zero
        self._clock.ends = (log.begin - zero) / 1e9, (log.end - zero) / 1e9
        self._shown: float | None = None

    def seek(self, at_s: float) -> None:
        """Go to a time [s]."""
        self._source.overview.give_way()
        self._clock.go(at_s)

    def play(self, speed: float) -> None:
        """Move on so many times as fast as it was; 0: stay; below 0: backwards."""
        self._clock.run(speed)

    def frame(self) -> dict[str, Any] | None:
        """The frame of the time where it is; None where that is shown already."""
        playing, at_s = self._clock.runs(), self._clock.at_s
        if at_s == self._shown:
            return None
        self._shown = at_s
        found = self._source.first.frame(at_s)
        if found is None:
            return None
        found, second = {**found, "playing": playing}, self._source.second
        if second is None:
            return found
        ghost = second.frame(at_s)
        return {**found, "ghost": None if ghost is None else rounded(ghost["poses"])}


def _sides(path: Path) -> tuple[Log, Log | None]:
    """The robot's log, and the controller's beside it; or the only one that there is."""
    if not path.is_dir():
        return Log.indexed(path), None
    found = []
    wrong: LogError | None = None
    for side in ("robot", "controller"):
        try:
            found.append(Log.indexed(path, side))
        except LogError as error:
            wrong = wrong or error
    if not found:
        raise wrong or LogError(f"{path}: holds no log")
    return found[0], found[1] if len(found) > 1 else None


def _extra(law: Log) -> list[str]:
    """Names of the controller's own columns."""
    for record in law.chunk(0):
        if record.kind == Kind.SESSION:
            found = _body(record.payload).get("extra")
            return [str(name) for name in found] if isinstance(found, list) else []
    return []


def _summary(log: Log) -> dict[str, Any] | None:
    """The last summary of its end."""
    for chunk in range(log.chunks - 1, max(log.chunks - 1 - TAIL, -1), -1):
        for record in reversed(log.chunk(chunk)):
            if record.kind == Kind.SUMMARY:
                return _body(record.payload)
    return None


def _body(payload: bytes) -> dict[str, Any]:
    try:
        found = json.loads(payload)
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}
