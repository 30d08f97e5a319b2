"""What the two logs of a run say about its ticks, as arrays: the robot's side, and the cycles.

Stamps are int64 [ns], `NEVER` where there is none. Those of the robot and those of the controller
are of two clocks, and are never compared with each other; only durations are.
"""

from __future__ import annotations

from dataclasses import dataclass
from dataclasses import field as made
from pathlib import Path

import numpy as np
import numpy.typing as npt

from hoap3.protocol.errors import LogError
from hoap3.protocol.messages import COMMANDS, Event, Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.disk_rows import RowsAt
from hoap3.tools.logs.log import Log, Rows
from hoap3.tools.machine.stalls import Stall

Stamps = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

NEVER = -1
EVENTS = Event.schema.constants
_COUNTED = ("rejected", "duplicate", "out_of_order")
_FAILURES = (EVENTS["REASON_MISSES"], EVENTS["REASON_HOLDER_LOST"])


@dataclass(frozen=True)
class RobotSide:
    """What the robot's log says.

    Attributes:
        joints: n.
        period: T [ns].
        due: how long an answer has [ns].
        from_publication: it has it from the publication of its State, not from the intended start.
        states: one row per State, sorted by tick.
        arrivals: when each of `setpoints` arrived, by the robot's clock [ns].
        setpoints: one row per Setpoint, in the order of arrival.
        commands: kinds of command that the robot takes.
        stalls: of the host, of all CPUs, by their begin; None where nobody watched.
        lockstep: all stamps are virtual.
        messages: how many setpoints were `rejected`, `duplicate`, `out_of_order`, as it counted.
        safe_stops: how often misses, or a holder that vanished, made it stop.
        misses_to_stop: misses in a row that stop it, by its config; None where that is not known.
        left_out: States of other sessions, and messages that cannot be read, by what they are.
    """

    joints: int
    period: int
    due: int
    from_publication: bool
    states: RowsAt
    arrivals: Stamps
    setpoints: Rows
    commands: tuple[int, ...]
    stalls: list[Stall] | None
    lockstep: bool
    messages: dict[str, int]
    safe_stops: int
    misses_to_stop: int | None = None
    left_out: dict[str, int] = made(default_factory=dict)

    @classmethod
    def read(cls, path: Path | str) -> RobotSide:
        """Read the log of a robot.

        Raises:
            LogError: there is none, it cannot be read, it holds no State, or it was recorded from
                outside: then the arrival stamps are not the robot's.
        """
        log = Log.open(path, side="robot")
        if "recorded" in log.metadata.get("run", {}):
            raise LogError(
                f"{log.paths[0]}: was recorded from outside, so nobody knows when setpoints "
                "reached the robot. Name the log that the robot itself has written"
            )
        description = log.description
        (arrivals, setpoints), (_, events) = log.table(Kind.SETPOINT), log.table(Kind.EVENT)
        states = RowsAt.of(log.states())
        if not len(states):
            raise LogError(f"{log.paths[0]}: holds no State. Name the log of a run")
        count = len(states)
        states = states[states["session_id"] == states["session_id"][-1]]
        left_out = {"States of other sessions": count - len(states)}
        for kind, unreadable in log.unreadable.items():
            left_out[f"messages of kind {kind.name} that cannot be read"] = unreadable
        misses_to_stop = (log.settings or {}).get("misses_to_stop")
        states = states[np.argsort(states["tick"], kind="stable")]
        return cls(
            joints=description.n,
            period=round(description.period_s * 1e9),
            due=description.due,
            from_publication=description.deadline == "after_receipt",
            states=states,
            arrivals=arrivals,
            setpoints=setpoints,
            commands=tuple(COMMANDS[kind] for kind in description.command_kinds),
            stalls=stalls_of(events),
            lockstep=bool(log.session.get("lockstep")),
            messages={name: int(states[-1][name] - states[0][name]) for name in _COUNTED},
            safe_stops=_safe_stops(events),
            misses_to_stop=misses_to_stop if isinstance(misses_to_stop, int) else None,
            left_out={what: count for what, count in left_out.items() if count},
        )


@dataclass(frozen=True)
class Cycles:
    """Cycles of a controller, sorted by tick: at most one for each State.

    Attributes:
        tick: of the State that was answered.
        published: when the robot had published it, by the robot's clock [ns].
        received, decoded, kinematics, solved, encoded, sent: by the controller's clock [ns].
            From `decoded` to `encoded` they are NEVER where nothing was sent; `sent` is NEVER
            where no later answer has told it.
        answered: an answer was handed to the link.
        overwritten: pairs of ticks (first, last) that the controller says it never saw.
    """

    tick: Stamps
    published: Stamps
    received: Stamps
    decoded: Stamps
    kinematics: Stamps
    solved: Stamps
    encoded: Stamps
    sent: Stamps
    answered: Flags
    overwritten: Stamps

    @classmethod
    def read(cls, folder: Path | str, robot: RobotSide) -> Cycles:
        """Those of the controller's log, where there is one, and those whose answers arrived.

        Args:
            folder: of the run, or a log of its robot.
            robot: whose session counts.

        Raises:
            LogError: the controller's log cannot be read.
        """
        path = Path(folder)
        log = None
        if path.is_dir() and any(path.glob("controller*.mcap")):
            log = Log.open(path, side="controller")
        return cls.of(log, robot)

    @classmethod
    def of(cls, log: Log | None, robot: RobotSide) -> Cycles:
        """The same of an open log, or of the robot's log alone."""
        session = robot.states["session_id"][0]
        known = robot.states["tick"]
        arrived = RowsAt.of(robot.setpoints)[answers(robot)]
        overwritten = np.empty((0, 2), np.int64)
        seen = np.empty(0, known.dtype)
        seen_received = seen_published = np.empty(0, np.int64)
        sent_rows = arrived[:0]
        if log is not None:
            stamps, states = log.table(Kind.STATE)
            ours = states["session_id"] == session
            seen, seen_published = states["tick"][ours], states["stamp_published"][ours]
            seen_received = stamps[ours]
            sent_rows = RowsAt.of(log.setpoints())
            sent_rows = sent_rows[sent_rows["session_id"] == session]
            overwritten = _overwritten(log.table(Kind.EVENT)[1], int(session))
        told_ticks, first = np.unique(
            np.concatenate([sent_rows["tick"], arrived["tick"]]), return_index=True
        )
        ticks = np.union1d(seen, told_ticks).astype(np.int64)
        fields = {name: np.full(len(ticks), NEVER) for name in _ANSWER_FIELDS}
        at = np.searchsorted(ticks, told_ticks.astype(np.int64))
        for name, field in _ANSWER_FIELDS.items():
            fields[name][at] = np.concatenate([sent_rows[field], arrived[field]])[first]
        answered = np.zeros(len(ticks), bool)
        answered[at] = True
        at = np.searchsorted(ticks, seen.astype(np.int64))
        own = np.zeros(len(ticks), bool)
        own[at] = True
        silent = ~answered[at]
        fields["published"][at] = seen_published
        fields["received"][at[silent]] = seen_received[silent]
        told_by_next = fields.pop("sent_previous")
        _mend(fields, answered)
        sent = _sent(ticks, fields, told_by_next, answered, own)
        return cls(tick=ticks, **fields, sent=sent, answered=answered, overwritten=overwritten)

    def __len__(self) -> int:
        return len(self.tick)

    def waits(self) -> npt.NDArray[np.float64]:
        """How long each State waited for the controller to end the cycle before [ns].

        A State that comes while the controller is busy waits in a channel, where a newer one
        replaces it. Its waiting time follows Lindley's recursion for a queue with one server,

            w_n = max(0, w_{n-1} + b_{n-1} - (p_n - p_{n-1})),

        b the length of a cycle by the controller's clock, p the publication by the robot's: only
        durations of two clocks are compared. Every State is taken to travel for equally long.
        """
        if not len(self):
            return np.empty(0)
        ready = np.where(self.sent != NEVER, self.sent, self.encoded)
        busy = np.where(ready != NEVER, ready - self.received, 0)
        step = np.concatenate([[0], busy[:-1] - np.diff(self.published)])
        load = np.cumsum(step)
        waits: npt.NDArray[np.float64] = (load - np.minimum.accumulate(load)).astype(np.float64)
        return waits

    def ready(self) -> npt.NDArray[np.float64]:
        """For how long after its State's arrival each cycle kept the controller busy [ns]."""
        ready = np.where(self.sent != NEVER, self.sent, self.encoded)
        return self.waits() + np.where(ready != NEVER, ready - self.received, 0)

    def says_overwritten(self, ticks: Stamps) -> Flags:
        """Which of these ticks the controller says it never saw."""
        first, last = self.overwritten[:, 0], self.overwritten[:, 1]
        place = np.searchsorted(first, ticks, "right") - 1
        found: Flags = place >= 0
        if len(first):
            found &= ticks <= last[place]
        return found


_ANSWER_FIELDS = {
    "published": "stamp_state",
    "received": "stamp_received",
    "decoded": "stamp_decoded",
    "kinematics": "stamp_kinematics",
    "solved": "stamp_solved",
    "encoded": "stamp_encoded",
    "sent_previous": "stamp_sent_previous",
}


def stalls_of(events: Rows) -> list[Stall] | None:
    """Stalls of the host that a log tells of, of all CPUs, by their begin; None if unwatched."""
    if not np.any(events["kind"] == EVENTS["STALLS_WATCHED"]):
        return None
    told = events[events["kind"] == EVENTS["HOST_STALL"]]
    told = told[np.argsort(told["stamp"], kind="stable")]
    return [
        Stall(start, start + length)
        for start, length in zip(told["stamp"].tolist(), told["detail"].tolist(), strict=True)
    ]


def _safe_stops(events: Rows) -> int:
    stops = events["kind"] == EVENTS["SAFE_STOP"]
    return int(np.count_nonzero(stops & np.isin(events["detail"], _FAILURES)))


def answers(robot: RobotSide) -> Flags:
    """Which setpoints the robot took for an answer to one of its States, in time or not."""
    setpoints = robot.setpoints
    fits = setpoints["wire_version"] == Setpoint.schema.version
    fits &= setpoints["session_id"] == robot.states["session_id"][0]
    fits &= np.isin(setpoints["command"], robot.commands)
    fits &= np.isfinite(setpoints["values"][:, : robot.joints]).all(axis=1)
    ticks = robot.states["tick"]
    place = np.minimum(np.searchsorted(ticks, setpoints["tick"]), len(ticks) - 1)
    asked = robot.states[place]
    fits &= (asked["tick"] == setpoints["tick"]) & (asked["mode"] == State.ACTIVE)
    fits &= asked["epoch"] == setpoints["epoch"]
    taken: Flags = fits & (robot.arrivals >= asked["stamp_published"])
    return taken


def _overwritten(events: Rows, session: int) -> Stamps:
    told = events[(events["kind"] == EVENTS["OVERWRITTEN"]) & (events["session_id"] == session)]
    before = told["tick"].astype(np.int64)
    return np.stack([before + 1, before + told["detail"]], axis=1)


def _mend(fields: dict[str, Stamps], answered: Flags) -> None:
    """Take a mark outside its bounds for the begin of the step; forget stamps out of order."""
    outside = (fields["kinematics"] < fields["decoded"]) | (fields["kinematics"] > fields["solved"])
    fields["kinematics"][outside] = fields["decoded"][outside]
    ordered = (
        (fields["received"] <= fields["decoded"])
        & (fields["decoded"] <= fields["solved"])
        & (fields["solved"] <= fields["encoded"])
    )
    for name in ("received", "decoded", "kinematics", "solved", "encoded"):
        fields[name][answered & ~ordered] = NEVER


def _sent(
    ticks: Stamps, fields: dict[str, Stamps], told_by_next: Stamps, answered: Flags, own: Flags
) -> Stamps:
    """When the link had taken each answer: the next cycle tells, where that is surely the next."""
    sent = np.full(len(ticks), NEVER)
    follows = answered[1:] & ((own[1:] & own[:-1]) | (np.diff(ticks) == 1))
    told = told_by_next[1:]
    begun = np.where(fields["encoded"] != NEVER, fields["encoded"], fields["received"])[:-1]
    possible = (begun != NEVER) & (told >= begun) & (told <= fields["received"][1:])
    sent[:-1] = np.where(follows & possible, told, NEVER)
    return sent
