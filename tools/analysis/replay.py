"""`hoap3 replay`: the logged controller on its logged inputs, setpoint by setpoint.

The controller's own log is the truth: what it was given, in the order in which it processed it.
Bit identity is promised for the same machine and versions; elsewhere there is a tolerance.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from dataclasses import field as made
from pathlib import Path
from typing import Any

import numpy as np

from hoap3.protocol.config.settings import apply_overrides, parse, parse_yaml
from hoap3.protocol.config.user_code import code_of_log
from hoap3.protocol.errors import Hoap3Error, LogError
from hoap3.protocol.messages import STAMP_FIELDS, Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.clock import MonotonicClock, VirtualClock
from hoap3.protocol.runtime.recorder import NoRecorder, Recorder
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.config import ControllerConfig, build
from hoap3.remote_controller.loop import ControllerLoop
from hoap3.remote_controller.outcome import Outcome
from hoap3.remote_controller.registry import registered
from hoap3.tools.logs.log import NEVER_OURS, Log
from hoap3.tools.logs.motion_files import reopened
from hoap3.tools.machine.machine import differences, in_words
from hoap3.tools.verify.both_sides import enclosed_alike

SAID_SETPOINTS = 500  # after so many the progress is told


@dataclass
class ReplayReport:
    """How a replay compares with its log.

    Attributes:
        setpoints: logged setpoints that could be compared.
        same: those that were equal.
        first_difference: tick of the first that was not, or None.
        field: what differed there.
        gap: tick beyond which nothing can be verified, or None.
        skipped: logged setpoints that could not be compared: of no session, or beyond the gap.
        absent: setpoints of the replay that are not in the log.
        tolerance: largest difference of a value that counts as equal.
        missing: what the log has lost, so that it cannot be compared, or "".
        contradictions: what the logs of both sides say differently of the run.
        software: versions that are not those of the log, by name: the log's, and the present one.
    """

    setpoints: int = 0
    same: int = 0
    first_difference: int | None = None
    field: str = ""
    gap: int | None = None
    skipped: int = 0
    absent: int = 0
    tolerance: float = 0.0
    missing: str = ""
    contradictions: list[str] = made(default_factory=list)
    software: dict[str, list[str]] = made(default_factory=dict)

    @property
    def passed(self) -> bool:
        """Whether all was compared and equal, and the logs agree about the run."""
        return self.identical and not (self.skipped or self.absent or self.contradictions)

    @property
    def identical(self) -> bool:
        """Whether everything that could be compared was equal, and there was something."""
        return self.setpoints > 0 and self.same == self.setpoints

    def as_json(self) -> dict[str, Any]:
        """All of it."""
        return {**asdict(self), "identical": self.identical}

    def __str__(self) -> str:
        word = "identical" if self.tolerance == 0.0 else f"equal within {self.tolerance:g}"
        text = f"{self.same}/{self.setpoints} setpoints {word}"
        if not self.setpoints:
            text = "no setpoint to compare"
        if self.first_difference is not None:
            if self.software:
                text = f"{in_words(self.software)}; {text}"
            text += f"; first difference at tick {self.first_difference}: {self.field}"
        if self.missing:
            text += f"; the log is not whole: {self.missing}"
        if self.gap is not None:
            text += f"; not verifiable beyond tick {self.gap}: records are missing there"
        if self.contradictions:
            text += f"; the logs contradict each other: {', '.join(self.contradictions)}"
        if self.skipped:
            text += f"; {self.skipped} setpoints were not compared"
        if self.absent:
            text += f"; {self.absent} setpoints are missing from the log"
        return text


def replay(
    path: Path | Log,
    overrides: list[str],
    *,
    tolerance: float = 0.0,
    allow_code: bool = False,
    say: Callable[[str], None] = lambda _: None,
    note: Callable[[str], None] = lambda _: None,
    repeated: Recorder | None = None,
) -> ReplayReport:
    """Repeat a log.

    Args:
        path: log of a controller, also an open one, or the folder of a run.
        overrides: changes of the logged settings, as `--set` takes them.
        tolerance: largest difference of a value that counts as equal.
        allow_code: import what the log names by a dotted path: a controller, a task, a constraint;
            the current folder joins the end of the import path.
        say: takes how far it is, in words.
        note: is told before an error where the software is not that of the log.
        repeated: takes what the controller records again, each summary included.

    Raises:
        LogError: not a controller's log, or one that names code.
        UsageError: the logged settings do not fit this version.
    """
    log = path if isinstance(path, Log) else Log.open(path, side="controller")
    others = differences(log.metadata.get("versions", {}))
    try:
        report = _replay(log, overrides, tolerance, allow_code, say, repeated)
    except Hoap3Error:
        if others:
            note(in_words(others))
        raise
    report.missing, report.software = log.missing, others
    if isinstance(path, Path) and path.is_dir():
        logs = [log, *([Log.open(path, "robot")] if any(path.glob("robot*.mcap")) else [])]
        alike = enclosed_alike(logs)
        report.contradictions = [name for name, same in alike.items() if same is False]
    return report


def _replay(
    log: Log,
    overrides: list[str],
    tolerance: float,
    allow_code: bool,
    say: Callable[[str], None],
    repeated: Recorder | None,
) -> ReplayReport:
    path = log.paths[0].parent if len(log.paths) > 1 else log.paths[0]
    file = f"config in {path}"
    content = apply_overrides(reopened(parse_yaml(log.config, file), log.attachments), overrides)
    config = parse(ControllerConfig, content, file)
    if config.controller not in registered() and not allow_code:
        raise LogError(
            f"{path}: its controller {config.controller!r} is not registered here, and code is not "
            "run on the word of a log. If you trust it, add --allow-code"
        )
    try:
        with code_of_log(allowed=allow_code):
            given: dict[str, Any] = {"tolerance": tolerance, "file": file, "say": say}
            given |= {"repeated": repeated, "expected": log.count(Kind.SETPOINT)}
            return replay_records(log.records(), config, **given)
    except NEVER_OURS as error:
        raise LogError(
            f"{path}: holds a record that no service of ours has written "
            f"({type(error).__name__}: {error}). Name a log of a controller"
        ) from error


def replay_records(
    records: Iterable[Record],
    config: ControllerConfig,
    *,
    tolerance: float = 0.0,
    file: str = "config",
    say: Callable[[str], None] = lambda _: None,
    repeated: Recorder | None = None,
    expected: int = 0,
) -> ReplayReport:
    """Repeat the records of a controller's log; see `replay`.

    Args:
        records, config, tolerance, file, say: see there.
        repeated: takes what the controller records again, each summary included.
        expected: number of setpoints in the records, for progress; 0 if unknown.
    """
    report = ReplayReport(tolerance=tolerance)
    engaged = _Engagements(config, file, repeated)
    description: RobotDescription | None = None
    loop: ControllerLoop | None = None
    answer, tick, awaited = None, 0, False
    comparison: _Comparison | None = None
    records, sent = iter(records), 0
    for record in records:
        sent += record.kind == Kind.SETPOINT
        if record.kind == Kind.DESCRIPTION:
            description = RobotDescription.from_json(record.payload)
        elif record.kind == Kind.SESSION and description is not None:
            session = json.loads(record.payload)
            loop = engaged.begin(description, session)
            lockstep, command = bool(session["lockstep"]), engaged.controller.command
            comparison = _Comparison(command, lockstep, tolerance)
        elif record.kind == Kind.STATE and loop is not None:
            (tick,) = State.scalars(record.payload, "tick")
            answer = loop.answer(record.stamp, record.payload)
            loop.sent()
            report.absent += awaited  # the last State of a log that was cut off may have none
            awaited = answer is not None
        elif record.kind == Kind.GAP:
            report.gap = tick
            break
        elif record.kind == Kind.SETPOINT and comparison is not None:
            report.setpoints, awaited = report.setpoints + 1, False
            if report.setpoints % SAID_SETPOINTS == 0:
                of = f", {100 * report.setpoints // expected} %" if expected else ""
                say(f"{report.setpoints} setpoints{of}")
            differs = comparison.difference(record.payload, answer)
            if differs is None:
                report.same += 1
            elif report.first_difference is None:
                report.first_difference, report.field = tick, differs
        elif loop is not None:
            _take(loop, record)
    engaged.end()
    sent += sum(record.kind == Kind.SETPOINT for record in records)
    report.skipped = sent - report.setpoints
    return report


def _take(loop: ControllerLoop, record: Record) -> None:
    """Repeat what others did to a controller."""
    if record.kind == Kind.AUTHORITY:
        loop.grant(int(json.loads(record.payload)["epoch"]))
    elif record.kind == Kind.CHANGE:
        loop.change(record.payload)
    elif record.kind == Kind.TARGET:
        loop.steer_again(record.payload)


class _Engagements:
    """Engages the controller once more for each session in a log, as the service does.

    Args:
        config, file: of the controller.
        repeated: takes what it records, or None.
    """

    def __init__(self, config: ControllerConfig, file: str, repeated: Recorder | None) -> None:
        self._config, self._file, self._repeated = config, file, repeated
        self._loop: ControllerLoop | None = None
        self._outcome: Outcome | None = None
        self._digest, self._session = "", 0
        self.controller: Any = None

    def begin(self, description: RobotDescription, session: dict[str, Any]) -> ControllerLoop:
        """Engage; the controller is built again where the robot is another one."""
        self.end()
        if description.digest != self._digest:
            self.controller = build(self._config, description, self._file)
            self._digest, self._outcome = description.digest, None
        if self._outcome is None or session["session_id"] != self._session:
            self._outcome = Outcome(self.controller, description)
        self._session = int(session["session_id"])
        lockstep = bool(session["lockstep"])
        clock = VirtualClock() if lockstep else MonotonicClock()
        recorder = self._repeated or NoRecorder()
        loop = ControllerLoop(self.controller, clock, recorder, self._session, self._outcome)
        if self._repeated is not None:
            loop.begin(description, lockstep=lockstep)
        self._loop = loop
        return loop

    def end(self) -> None:
        """Sum up what the answers so far came to, where that is recorded."""
        if self._loop is not None and self._repeated is not None:
            self._loop.sum_up()


class _Comparison:
    """Compares setpoints; stamps count in lockstep only, where they are virtual."""

    def __init__(self, like: Setpoint, lockstep: bool, tolerance: float) -> None:
        self._logged, self._again = Setpoint.like(like.dump()), Setpoint.like(like.dump())
        self._tolerance = tolerance
        ignored = frozenset() if lockstep else STAMP_FIELDS
        self._scalars = [name for name in Setpoint.schema.scalars if name not in ignored]

    def difference(self, logged: bytes, again: bytes | None) -> str | None:
        """Name and values of the first field that differs, or None."""
        if logged == again:
            return None
        if again is None:
            return "no answer"
        if Setpoint.schema.lengths_in(logged) != self._logged.lengths:
            self._logged = Setpoint.like(logged)
        self._logged.load(logged)
        self._again.load(again)
        for name in self._scalars:
            before, after = getattr(self._logged, name), getattr(self._again, name)
            if before != after and not self._close(before, after):
                return f"{name} {before!r} became {after!r}"
        for name in Setpoint.schema.arrays:
            before, after = getattr(self._logged, name), getattr(self._again, name)
            if before.size != after.size:
                return f"{name} has {before.size} numbers, and {after.size} again"
            same = (before == after) | (np.isnan(before) & np.isnan(after))
            differs = ~(same | (np.abs(before - after) <= self._tolerance))
            if differs.any():
                at = int(np.argmax(differs))
                return f"{name}[{at}] {float(before[at])!r} became {float(after[at])!r}"
        return None

    def _close(self, before: float, after: float) -> bool:
        return isinstance(before, float) and abs(before - after) <= self._tolerance
