"""Figures of a run, from the records of the robot's own log, as they come."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from hoap3.protocol.errors import WireError
from hoap3.protocol.messages import COMMANDS, Setpoint, State
from hoap3.protocol.runtime.deadlines import Durations, Jitter
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.controllers.certificate import checked_status
from hoap3.robot_emulator.setpoint_validator import HISTORY
from hoap3.tools.analysis.certificates import CertificateCount, reasons_on_wire
from hoap3.tools.machine.stalls import FOREVER, OutsideStalls

STAGES = ("decode", "kinematics", "solve", "encode", "send", "network")
"""Parts of the round trip. The first five are the controller's, on its own clock; `network` is
what remains of the RTT, both ways together, so no two clocks are ever compared."""


_STATE = (  # in the order of the schema: quickest to read
    "mode", "session_id", "tick", "epoch", "stamp_intended", "stamp_actual", "skipped", "late",
    "lost", "duplicate", "out_of_order", "rejected", "success_rate",
)  # fmt: skip

_NO_CERTIFICATE = Setpoint.schema.constants["STATUS_NONE"]


class RunStatistics:
    """Counts, histograms and the verdict of one robot's run.

    Args:
        period_ns: of the robot's schedule.
        stalls: takes the times of missed and skipped ticks.
        timing: whether durations mean anything; not in lockstep, where all time is virtual.

    Attributes:
        asked: States that asked for an answer.
        delay_ticks: of the robot.
        rtt, wakeup, stages: durations so far.
    """

    def __init__(
        self, period_ns: int, stalls: OutsideStalls | None = None, *, timing: bool = True
    ) -> None:
        self._period_ns, self._timing = period_ns, timing
        self._stalls = stalls or OutsideStalls({})
        self._stalls.begin = FOREVER  # until it moves
        self._missed = 0
        self._intended: int | None = None  # of the last State, where that was an active one
        self._last_intended: int | None = None  # of the last State
        self._deadline, self.delay_ticks, self.asked = "next_tick", 0, 0
        self._state: tuple[Any, ...] = ()
        self._summary: dict[str, Any] | None = None
        self._v = math.nan
        self._certificates, self._answered = CertificateCount(), -1
        self._takes: tuple[int, int] | None = None  # kind of command and joints, once known
        self._asked: dict[int, tuple[int, int]] = {}  # epoch and publication of ticks that asked
        self._setpoint: Setpoint | None = None  # takes every message in turn
        self._jitter = Jitter(period_ns)
        self._skipped = 0
        self._active_tick = -1
        self._skipped_active = 0
        self._encoded: tuple[int, int] | None = None
        self.rtt, self.wakeup = Durations(), Durations()
        self.stages = {name: Durations() for name in STAGES}

    def add(self, record: Record) -> None:
        """Take one record of the robot's log."""
        try:
            if record.kind == Kind.STATE:
                self._add_state(record.payload)
            elif record.kind == Kind.SETPOINT:
                self._add_setpoint(record)
            elif record.kind == Kind.SUMMARY:
                self._summary = json.loads(record.payload)
            elif record.kind == Kind.DESCRIPTION:
                robot = json.loads(record.payload)
                self._takes = (COMMANDS[robot["command_kinds"][0]], len(robot["joints"]))
                self._deadline = robot.get("deadline", self._deadline)
                self.delay_ticks = robot.get("delay_ticks", 0)
        except WireError:
            return  # the robot refused it too, and counts it

    @property
    def state(self) -> dict[str, Any]:
        """Mode and counts of the newest State; empty before the first."""
        return dict(zip(_STATE, self._state, strict=False))

    def live(self) -> dict[str, Any]:
        """What people watch while it runs."""
        state = self.state
        figures = {**state, "ticks": state.get("tick", -1) + 1, "error": self._error}
        if self._timing:
            figures["rtt_us"] = self.rtt.summary()
            figures["wakeup_us"] = self.wakeup.summary()
        return figures

    @property
    def _error(self) -> float:
        """|e|, from V = |e|²/2 of the last certificate."""
        return math.sqrt(2.0 * self._v) if self._v >= 0.0 else math.nan

    @property
    def counts(self) -> dict[str, Any]:
        """What the robot counted itself; empty where its summary is lost."""
        return self._summary or {}

    def figures(self) -> dict[str, Any]:
        """Figures as `run --json` prints them, without verdicts."""
        robot, state = self.counts, self.state
        run_rate = robot.get("run_rate") if robot.get("asked") else None
        safe_stops = robot.get("safe_stops", 0)
        skipped = self._skipped_active
        outside, outside_rate = self._outside(robot.get("in_time", 0))
        result: dict[str, Any] = {
            "deadline": self._deadline,
            "delay_ticks": self.delay_ticks,
            "ticks": robot.get("asked", 0),
            "skipped": skipped,
            "misses": {
                "late": state.get("late", 0),
                "lost": state.get("lost", 0),
                "rejected": state.get("rejected", 0),
                "duplicate": state.get("duplicate", 0),
                "conflicting": robot.get("conflicting", 0),
                "out_of_order": state.get("out_of_order", 0),
                "longest_run": robot.get("longest_run", 0),
            },
            "misses_outside_stalls": outside,
            "host_stalls": self._stalls.figures() if outside is not None else None,
            "success_rate": {
                "run": run_rate,
                "outside_stalls": outside_rate,
                "worst_window": robot.get("worst_window"),
            },
            "rejections": robot.get("rejections", {}),
            "safe_stops": safe_stops,
            "interventions": robot.get("interventions", 0),
            "torque_limited": robot.get("torque_limited", 0),
            "final_error": None if math.isnan(self._error) else self._error,
            "certificates": self._certificates.figures(),
            "complete": self._summary is not None,
            "realtime": robot.get("realtime", []),
            "link_counts": robot.get("link_counts", {}),
            "plant": robot.get("plant", {}),
        }
        if self._timing:
            result["plant_us"] = robot.get("plant_us", {"n": 0})
            result["rtt_us"] = self.rtt.summary()
            result["wakeup_us"] = self.wakeup.summary()
            result["jitter_us"] = self._jitter.summary()
            result["stages_us"] = {name: stage.summary() for name, stage in self.stages.items()}
        return result

    def _outside(self, in_time: int) -> tuple[int | None, float | None]:
        """Misses and skipped ticks that no stall excuses, and the success rate without the others.

        None where nothing watched for stalls.
        """
        if not self._timing or not self._stalls.known:
            return None, None
        self._stalls.attribute(FOREVER)
        outside = self._stalls.outside
        return outside, in_time / (in_time + outside) if in_time + outside else None

    def _note_failures(self, mode: int, intended: int, actual: int, skipped: int) -> None:
        """Give the times of missed and skipped ticks to the judge of stalls."""
        late, lost = self._state[7:9]
        missed, before, period = late + lost - self._missed, self._intended, self._period_ns
        self._missed = late + lost
        lag = self.delay_ticks + (self._deadline == "after_receipt")  # until a tick is judged
        asked = self._last_intended if lag else before
        if asked is not None and missed > 0:
            self._stalls.failed(asked - lag * period, asked + missed * period, missed)
        if before is not None and skipped > self._skipped and mode == State.ACTIVE:
            more = skipped - self._skipped
            for tick in range(1, more):
                self._stalls.failed(before + tick * period, before + (tick + 1) * period, 1)
            self._stalls.failed(before + more * period, actual, 1)
        self._intended = intended if mode == State.ACTIVE else None
        self._last_intended = intended

    def _note_motion(self, moves: bool, intended: int) -> None:
        """Let stalls count from the first active tick until the robot rests."""
        if moves:
            self._stalls.begin = min(self._stalls.begin, intended)
            self._stalls.end = FOREVER
        elif self._stalls.end == FOREVER:
            self._stalls.end = intended

    def _add_state(self, payload: bytes) -> None:
        was_active = bool(self._state) and self._state[0] == State.ACTIVE
        self._state = values = State.scalars(payload, *_STATE)
        mode, _, tick, epoch, intended, actual, skipped = values[:7]
        if mode == State.ACTIVE:
            self.asked += 1
            if not was_active:  # no answer to an earlier tick is followed any more
                self._answered = max(self._answered, tick - 1)
            self._asked[tick] = (epoch, *State.scalars(payload, "stamp_published"))
            if len(self._asked) > HISTORY:
                del self._asked[next(iter(self._asked))]
        if self._timing:
            self._note_failures(mode, intended, actual, skipped)
            self._note_motion(mode == State.ACTIVE, intended)
        if was_active and mode == State.ACTIVE:
            self._skipped_active += skipped - self._skipped
        if self._timing and mode == State.ACTIVE:
            self.wakeup.add(actual - intended, tick)
            if skipped != self._skipped or tick != self._active_tick + 1:
                self._jitter.skip()
            self._jitter.start(actual)
            self._active_tick = tick
        self._skipped = skipped

    def _add_setpoint(self, record: Record) -> None:
        """Take a setpoint; only one that the robot accepts for the newest answer counts."""
        setpoint = self._load(record.payload)
        tick = setpoint.tick
        if not self._state or setpoint.session_id != self._state[1] or tick <= self._answered:
            return
        epoch, published = self._asked.get(tick, (0, 0))  # no epoch is 0
        fits = self._takes in {None, (setpoint.command, len(setpoint.values))}
        if setpoint.epoch != epoch or not fits or not np.isfinite(setpoint.values).all():
            return
        self._answered = tick
        status, invalid = checked_status(setpoint)
        self._certificates.answer(status, invalid or reasons_on_wire(status, record.payload))
        self._v = setpoint.v if setpoint.solver_status != _NO_CERTIFICATE else math.nan
        if not self._timing or setpoint.stamp_state != published:
            return  # without a true echo its stamps are worth nothing
        received, decoded = setpoint.stamp_received, setpoint.stamp_decoded
        kinematics, solved = setpoint.stamp_kinematics, setpoint.stamp_solved
        encoded = setpoint.stamp_encoded
        rtt = record.stamp - published
        self.rtt.add(rtt, tick)
        if encoded == received:
            return  # they are not the controller's: its link carries none
        self.stages["decode"].add(decoded - received, tick)
        self.stages["kinematics"].add(kinematics - decoded, tick)
        self.stages["solve"].add(solved - kinematics, tick)
        self.stages["encode"].add(encoded - solved, tick)
        self.stages["network"].add(rtt - (encoded - received), tick)
        if self._encoded is not None and self._encoded[0] == tick - 1:
            sent = setpoint.stamp_sent_previous - self._encoded[1]
            self.stages["send"].add(sent, tick - 1)
        self._encoded = (tick, encoded)

    def _load(self, payload: bytes) -> Setpoint:
        """Read a setpoint, however long its arrays are."""
        setpoint = self._setpoint
        if setpoint is not None and len(payload) == setpoint.size:
            try:
                setpoint.load(payload)
            except WireError:
                setpoint = None  # as long, and divided otherwise, or none at all
            else:
                return setpoint
        self._setpoint = setpoint = Setpoint.like(payload)
        setpoint.load(payload)
        return setpoint
