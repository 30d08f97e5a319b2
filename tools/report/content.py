"""Everything that a report says, computed from the logs; how it looks is the page's business."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

from hoap3.protocol.errors import LogError
from hoap3.tools.html.drawing import Drawing
from hoap3.tools.report.certificates import Certificates
from hoap3.tools.report.checked import Checked, check
from hoap3.tools.report.conditions import Condition, read_conditions
from hoap3.tools.report.happenings import Happening, read_happenings
from hoap3.tools.report.motion import Motion, read_motion
from hoap3.tools.report.plots.certificate_plots import certificate_drawings
from hoap3.tools.report.plots.motion_plots import motion_drawings
from hoap3.tools.report.plots.timing_plots import timing_drawings
from hoap3.tools.report.sources import Sources, of_ours
from hoap3.tools.report.timing import Timing, read_timing
from hoap3.tools.show.verdicts import judge


@dataclass(frozen=True)
class Content:
    """What a report says.

    Attributes:
        sources: the logs.
        motion: what the robot did, or None.
        timing: what became of its ticks, or None.
        happenings: events of both sides, each in order.
        conditions: what stood in the controller's way; None without its log.
        gaps: what is missing, and why, in sentences.
        robot_here: name or path of the robot on this machine, whose meshes are drawn.
        allow_code: import what the log names by a dotted path.
    """

    sources: Sources
    motion: Motion | None
    timing: Timing | None
    happenings: tuple[Happening, ...]
    conditions: tuple[Condition, ...] | None
    gaps: tuple[str, ...]
    robot_here: str | None = None
    allow_code: bool = False

    @cached_property
    def checked(self) -> Checked:
        """What of the logs was recomputed, and holds; it is done when somebody asks."""
        return check(self.sources.path, allow_code=self.allow_code)

    @property
    def warnings(self) -> list[str]:
        """What stands above everything else: false claims, then the gaps."""
        return [*self.checked.gaps, *self.gaps]

    @cached_property
    def motion_drawings(self) -> tuple[Drawing, ...]:
        """Figures of the motion; they are drawn when somebody asks."""
        return tuple(motion_drawings(self.motion, self.robot_here)) if self.motion else ()

    @property
    def certificates(self) -> Certificates | None:
        """What the answers prove, or None."""
        return self.motion.certificates if self.motion else None

    @cached_property
    def certificate_drawings(self) -> tuple[Drawing, ...]:
        """Figures of what the answers prove, likewise."""
        return tuple(certificate_drawings(self.certificates)) if self.certificates else ()

    @cached_property
    def timing_drawings(self) -> tuple[Drawing, ...]:
        """Figures of what became of the ticks, likewise."""
        return tuple(timing_drawings(self.timing)) if self.timing else ()

    @cached_property
    def judged(self) -> dict[str, Any]:
        """The three verdicts, and what they rest on, as `run --json` has them.

        What the answers came to is computed from the logs, not taken from their summaries.
        """
        sources, motion = self.sources, self.motion
        outcome = self.checked.outcomes.get(motion.session_id) if motion is not None else None
        return judge(
            self.timing.verdict if self.timing else None,
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
        drawings = self.motion_drawings + self.certificate_drawings + self.timing_drawings
        held = self.conditions
        return {
            **(self.timing.figures if self.timing else {}),
            **self.judged,
            "robot": self.robot,
            "controller": self.controller,
            "duration_s": self.duration_s,
            "answers": self.motion.answers if self.motion else None,
            "transport": self.transport,
            "lockstep": self.sources.lockstep,
            "interventions": self.sources.interventions,
            "torque_limited": self.sources.torque_limited,
            "final_error": _final_error(self.motion),
            "certificates": self.certificates.as_json() if self.certificates else None,
            "verified": self.checked.as_json(),
            "conditions": None if held is None else [asdict(each) for each in held],
            "figures": [drawing.name for drawing in drawings],
            "gaps": self.warnings,
            "damaged": dict(self.sources.damaged),
            "unreadable": dict(self.sources.unreadable),
            "repairable": sorted(self.sources.repairable),
            "machine": self.machine(self.sources.main.side),
            "log": str(self.sources.path),
        }


def read_content(path: Path, robot: str | None = None, *, allow_code: bool = False) -> Content:
    """Compute a report.

    Args:
        path: folder of a run, or one `*.mcap`.
        robot: name or path of the robot on this machine, whose meshes are drawn. None: no log
            makes a report open files that it names.
        allow_code: import what the log names by a dotted path, to repeat its controller.

    Raises:
        LogError: there is no log of ours, or it holds what no service of ours has written.
    """
    with of_ours(path):
        return _read(Sources.open(path), robot, allow_code=allow_code)


def _read(sources: Sources, robot: str | None, *, allow_code: bool) -> Content:
    gaps = list(sources.gaps)
    motion = _motion(sources, gaps)
    timing = _timing(sources, gaps)
    if timing is not None:
        gaps += _doubts(sources, timing)
    if sources.lockstep:
        gaps.append(
            "All time of this run is virtual (lockstep): there are no durations, and so no plots "
            "of them."
        )
    elif timing is not None and timing.table.stalls is None:
        gaps.append(
            "Nobody watched for stalls of the host, which needs real-time rights: all rates are "
            "raw, and a stall counts like any other miss."
        )
    return Content(
        sources=sources,
        motion=motion,
        timing=timing,
        happenings=tuple(item for log in sources.logs for item in read_happenings(log)),
        conditions=_conditions(sources, motion),
        gaps=tuple(gaps),
        robot_here=robot,
        allow_code=allow_code,
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


def _conditions(sources: Sources, motion: Motion | None) -> tuple[Condition, ...] | None:
    if sources.controller is None:
        return None
    session_id = motion.session_id if motion is not None else None
    return tuple(read_conditions(sources.controller, session_id))


def _timing(sources: Sources, gaps: list[str]) -> Timing | None:
    try:
        timing = read_timing(sources)
    except LogError as error:
        gaps.append(f"Deadlines cannot be judged: {error}.")
        return None
    if timing is not None and timing.table.left_out:
        left = ", ".join(f"{n} {what}" for what, n in timing.table.left_out.items())
        gaps.append(f"Deadlines are those of the last session, without {left}.")
    if timing is not None and timing.table.safe_stops:
        gaps.append(
            "The robot was brought to a safe stop, after which nothing asks for an answer: that "
            "alone makes the deadlines fail."
        )
    held_back = sources.interventions
    if held_back:
        gaps.append(
            f"The robot held joints back in {held_back} periods, because what was asked for is "
            "beyond its limits: there it did not move as the controller meant it to."
        )
    if sources.torque_limited:
        gaps.append(
            f"Efforts were too small in {sources.torque_limited} periods: there the robot could "
            "not keep its limits, whatever the controller asked for."
        )
    if sources.robot is not None and timing is None:
        gaps.append("No tick asked for an answer: there is nothing to be in time for.")
    return timing


def _doubts(sources: Sources, timing: Timing) -> list[str]:
    """Where the log and the robot's own final count differ."""
    if not sources.summary:
        return ["The robot's own final count is not in the log: the figures end where it ends."]
    theirs = (sources.summary.get("asked"), sources.summary.get("in_time"))
    ours = (timing.asked, timing.table.count(0))
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
