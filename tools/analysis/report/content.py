"""Compute everything that a report shows from the logs; `page` renders it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from hoap3.protocol.errors import LogError
from hoap3.protocol.messages import State
from hoap3.tools.analysis.canvas import Drawing
from hoap3.tools.analysis.certificates import Certificates
from hoap3.tools.analysis.report.certificate_plots import certificate_drawings
from hoap3.tools.analysis.report.checked import Checked, check_logs, skip
from hoap3.tools.analysis.report.events import (
    Condition,
    Interval,
    LogEvent,
    read_events,
    read_intervals,
    sum_up_conditions,
)
from hoap3.tools.analysis.report.motion import Motion, read_motion
from hoap3.tools.analysis.report.motion_plots import motion_drawings
from hoap3.tools.analysis.report.sources import Sources, of_ours
from hoap3.tools.analysis.report.timing_plots import timing_drawings
from hoap3.tools.analysis.tick_metrics import tick_figures
from hoap3.tools.analysis.ticks import IN_TIME, TickTable
from hoap3.tools.analysis.verdicts import judge


@dataclass(frozen=True)
class Content:
    """What a report says.

    Attributes:
        sources: the logs.
        motion: what the robot did, or None.
        ticks: what became of its ticks, of which at least one asked; or None.
        checked: what of the logs was recomputed, and holds.
        events: of both sides, each in order.
        intervals: in which conditions of the controller held; None without its log.
        gaps: what is missing, and why, in sentences.
        drawings: figures by section.
        tick_figures: under the names that `run --json` gives them; durations unless all time is
            virtual.
    """

    sources: Sources
    motion: Motion | None
    ticks: TickTable | None
    checked: Checked
    events: tuple[LogEvent, ...]
    intervals: tuple[Interval, ...] | None
    gaps: tuple[str, ...]
    drawings: Mapping[str, list[Drawing]]
    tick_figures: Mapping[str, Any]

    @cached_property
    def conditions(self) -> list[Condition] | None:
        """Sums of the intervals, the most lasting condition first."""
        return None if self.intervals is None else sum_up_conditions(self.intervals)

    @property
    def warnings(self) -> list[str]:
        """What stands above everything else: false claims, then the gaps."""
        return [*self.checked.gaps, *self.gaps]

    @property
    def certificates(self) -> Certificates | None:
        """What the answers prove, or None."""
        return self.motion.certificates if self.motion else None

    @cached_property
    def judged(self) -> dict[str, Any]:
        """The three verdicts, and what they rest on, as `run --json` has them.

        What the answers came to is computed from the logs, not taken from their summaries.
        """
        sources, motion = self.sources, self.motion
        outcome = self.checked.outcomes.get(motion.session_id) if motion is not None else None
        figures = self.tick_figures
        return judge(
            {"verdict": figures["verdicts"]["deadlines"], **figures["deadlines"]}
            if figures
            else None,
            sources.summary,
            outcome,
            damaged=sources.lost,
        )

    @property
    def robot(self) -> str:
        """Its name."""
        return str(self.sources.main.robot)

    @property
    def controller(self) -> str:
        """Its name, as its config gives it, or that it is not known."""
        name = self.sources.settings("controller").get("controller")
        return name if isinstance(name, str) else "a controller that is not in the log"

    @property
    def config(self) -> str:
        """Name of the controller's config, "" where it is not in the log."""
        log = self.sources.controller
        return log.metadata.get("run", {}).get("config", "") if log is not None else ""

    @property
    def duration_s(self) -> float | None:
        """Of the motion, or None."""
        return self.motion.duration_s if self.motion else None

    @property
    def transport(self) -> str:
        """How both sides were joined, as far as their settings tell."""
        if self.sources.lockstep:
            return "lockstep, virtual time"
        ends: list[str] = []
        for side, key in (("robot", "listen"), ("controller", "connect")):
            link = self.sources.settings(side).get("link")
            given = link.get(key) if isinstance(link, dict) else None
            ends += [str(end) for end in given] if isinstance(given, list) else []
        if not ends:
            return "a link that is not in the log"
        kinds = sorted({end.partition("/")[0] for end in ends})
        local = all(_is_local(end) for end in ends)
        return f"zenoh {', '.join(kinds)}, {'same host' if local else ', '.join(sorted(set(ends)))}"

    @property
    def date(self) -> str:
        """When the log was begun, UTC; "" where it does not say."""
        stamp = self.sources.main.metadata.get("clock", {}).get("realtime_ns", "")
        try:
            moment = datetime.fromtimestamp(int(stamp) / 1e9, UTC)
        except (ValueError, OverflowError, OSError):
            return ""
        return moment.strftime("%Y-%m-%d %H:%M:%S UTC")

    def machine(self, side: str) -> dict[str, Any]:
        """The machine block of a side's log; empty where there is none."""
        log = self.sources.of(side)
        block = log.metadata.get("machine", {}) if log is not None else {}
        return {key: _value(text) for key, text in block.items()}

    def as_json(self) -> dict[str, Any]:
        """The figures, as `--json` prints them."""
        held = self.conditions
        return {
            **self.tick_figures,
            **self.judged,
            "robot": self.robot,
            "controller": self.controller,
            "config": self.config,
            "duration_s": self.duration_s,
            "answers": self.motion.answers if self.motion else None,
            "transport": self.transport,
            "lockstep": self.sources.lockstep,
            "interventions": self.sources.counted("interventions"),
            "torque_limited": self.sources.counted("torque_limited"),
            "final_error": _final_error(self.motion),
            "certificates": self.certificates.as_json() if self.certificates else None,
            "verified": self.checked.as_json(),
            "conditions": None if held is None else [asdict(each) for each in held],
            "figures": [each.name for drawings in self.drawings.values() for each in drawings],
            "gaps": self.warnings,
            "damaged": dict(self.sources.damaged),
            "unreadable": dict(self.sources.unreadable),
            "repairable": sorted(self.sources.repairable),
            "machine": self.machine(self.sources.main.side),
            "log": self.sources.label,
        }


def read_content(
    *paths: Path,
    robot: str | None = None,
    say: Callable[[str], None] = lambda _: None,
    allow_code: bool = False,
    verify: bool = True,
) -> Content:
    """Compute a report.

    Args:
        paths: folder of a run, one `*.mcap`, or those of two services.
        say: takes progress.
        robot: name or path of the robot on this machine, whose meshes are drawn. None: no log
            makes a report open files that it names.
        allow_code: import what the log names by a dotted path, to repeat its controller.
        verify: recompute what the logs claim.

    Raises:
        LogError: there is no log of ours, or it holds what no service of ours has written.
    """
    with of_ours(paths[0]):
        sources = Sources.open(*paths, say=say)
        if not verify:
            return _content(sources, robot, skip(sources.controller))
        # first, so that the memory that it takes is free again when the page is drawn
        logs = {log.side: log for log in sources.logs}
        checked = check_logs(sources.path, logs, say, allow_code=allow_code)
        return _content(sources, robot, checked)


def _content(sources: Sources, robot: str | None, checked: Checked) -> Content:
    gaps = list(sources.gaps)
    motion = _motion(sources, gaps)
    ticks = _ticks(sources, gaps)
    if ticks is not None:
        gaps += _other_controllers(sources)
    if sources.lockstep:
        gaps.append(
            "All time of this run is virtual (lockstep): there are no durations, and so no "
            "plots of them."
        )
    elif ticks is not None and ticks.stalls is None:
        gaps.append(
            "Stalls of the host were not monitored, which needs real-time rights: rates include "
            "them, and a stall counts like any other miss."
        )
    intervals = None
    if sources.controller is not None:
        session_id = motion.session_id if motion is not None else None
        intervals = tuple(read_intervals(sources.controller, session_id))
    certificates = motion.certificates if motion is not None else None
    drawings = {
        "motion": motion_drawings(motion, robot) if motion else [],
        "certificates": certificate_drawings(certificates) if certificates else [],
        "time": timing_drawings(ticks) if ticks else [],
    }
    found = sources.summary.get("realtime")
    realtime = list(map(str, found)) if isinstance(found, list) else None
    figures = tick_figures([ticks], realtime=realtime) if ticks else {}
    if ticks is not None:
        ticks.free_stages()
    return Content(
        sources=sources,
        motion=motion,
        ticks=ticks,
        checked=checked,
        events=tuple(event for log in sources.logs for event in read_events(log)),
        intervals=intervals,
        gaps=tuple(gaps),
        drawings=drawings,
        tick_figures=figures,
    )


def _motion(sources: Sources, gaps: list[str]) -> Motion | None:
    try:
        motion = read_motion(sources)
    except LogError as error:
        gaps.append(f"The motion cannot be shown: {error}.")
        return None
    if motion is None:
        gaps.append("The robot was never active in this log: there is no motion.")
    else:
        gaps += motion.gaps
    return motion


def _ticks(sources: Sources, gaps: list[str]) -> TickTable | None:
    ticks = None
    try:
        if sources.robot is not None:
            ticks = TickTable.from_logs(sources.robot, sources.controller)
    except LogError as error:
        gaps.append(f"Deadlines cannot be judged: {error}.")
        return None
    if ticks is not None and not ticks.asked.any():
        ticks = None
    if ticks is not None and ticks.left_out:
        left = ", ".join(f"{n} {what}" for what, n in ticks.left_out.items())
        gaps.append(f"Deadlines are those of the last session, without {left}.")
    if ticks is not None and ticks.safe_stops:
        gaps.append(
            "The robot was brought to a safe stop, after which nothing asks for an answer: that "
            "alone makes the deadlines fail."
        )
    held_back, weak = sources.counted("interventions"), sources.counted("torque_limited")
    if held_back:
        gaps.append(
            f"The robot held joints back in {held_back} periods, because what was asked for is "
            "beyond its limits: there it did not move as the controller meant it to."
        )
    if weak:
        gaps.append(
            f"Efforts were too small in {weak} periods: there the robot could "
            "not keep its limits, whatever the controller asked for."
        )
    if sources.robot is not None and ticks is None:
        gaps.append("No tick asked for an answer: there is nothing to be in time for.")
    if ticks is not None:
        gaps += _doubts(sources, ticks)
    return ticks


def _other_controllers(sources: Sources) -> list[str]:
    """Ticks for which the robot followed a controller whose log is not part of the report."""
    robot, controller = sources.robot, sources.controller
    if robot is None or controller is None or controller.missing:
        return []
    states, answers = robot.states(), controller.setpoints()
    session = states["session_id"][-1]
    ours = (states["session_id"] == session) & (states["mode"] == State.ACTIVE)
    followed, sent = states["epoch"][ours], answers["epoch"][answers["session_id"] == session]
    others = int(np.count_nonzero(~np.isin(followed, sent)))
    if not others or not len(sent):
        return []
    part = f"in {others} of {len(followed)} ticks, and its log is not part of this report"
    judged = "Deadlines are those of all ticks; the task is judged by the controller that is named."
    return [f"The robot followed another controller {part}. {judged}"]


def _doubts(sources: Sources, ticks: TickTable) -> list[str]:
    """Where the log and the robot's own final count differ."""
    if not sources.summary:
        return ["The robot's own final count is not in the log: the figures end where it ends."]
    theirs = (sources.summary.get("asked"), sources.summary.get("in_time"))
    ours = (int(np.count_nonzero(ticks.asked)), ticks.count(IN_TIME))
    if theirs == ours:
        return []
    counted = f"{theirs[1]} answers in time of {theirs[0]} ticks"
    return [f"The robot itself counted {counted}, the log shows {ours[1]} of {ours[0]}."]


def _final_error(motion: Motion | None) -> float | None:
    """√(2V) of the last answer, or None."""
    if motion is None or not motion.has_certificates or not motion.v[-1] >= 0.0:
        return None
    return float((2.0 * motion.v[-1]) ** 0.5)


def _is_local(endpoint: str) -> bool:
    address = endpoint.partition("/")[2]
    return address.startswith(("127.", "localhost:", "[::1]"))


def _value(text: str) -> Any:
    """A fact of the machine block, which is written as JSON."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text
