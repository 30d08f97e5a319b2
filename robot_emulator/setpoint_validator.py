"""What becomes of each setpoint that arrives, and of each tick that asked for one.

Two questions, counted apart. A message is accepted, or a duplicate, or out of order, or rejected
for one named reason. A tick that asked for an answer got it in time, late, or not at all.
"""

from __future__ import annotations

from heapq import heappop, heappush

import numpy as np

from hoap3.protocol.errors import WireError
from hoap3.protocol.messages import CDR_HEADER, Setpoint
from hoap3.protocol.runtime.deadlines import Deadlines

HISTORY = 1024
MAX_LENGTHS = {"extra": 256, "decision": 512, "slacks": 256, "gains": 256, "next": 1024}
"""How long the arrays of a setpoint may be; `values` has one for each joint."""

REJECTION_KINDS = (
    "size",
    "layout",
    "wire_version",
    "session",
    "future",
    "unasked",
    "epoch",
    "command",
    "not_finite",
)
"""Why a setpoint is refused; the order is part of the wire (Event.detail of REJECTED)."""


class SetpointValidator:
    """Accepts or refuses setpoints, and decides which ticks were answered in time, late or never.

    Args:
        joints: n.
        session_id: the robot's.
        command: command kind that the robot takes now.
        delayed: whether answers wait until `release` lets them be followed.

    Attributes:
        setpoint: the newest accepted one, or the last that was released.
        fresh: whether `setpoint` has not been taken by a tick yet.
        duplicate: setpoints for a tick that was answered before.
        conflicting: those of them whose values are not those of the first answer.
        rejected: setpoints refused, of all kinds.
        rejections: the same by reason.
        deadlines: outcomes of ticks.
    """

    def __init__(
        self, joints: int, session_id: int, command: int, *, delayed: bool = False
    ) -> None:
        from hoap3.robot_emulator.plants.motion_kernels import all_finite

        self.setpoint = Setpoint(joints)
        self._incoming = Setpoint(joints)
        self._joints, self._session_id, self._command = joints, session_id, command
        self._all_finite = all_finite
        self._asked = [-1] * HISTORY  # the tick that uses this place
        self._epochs = [0] * HISTORY
        self._deadline = [0] * HISTORY
        self._arrival = [-1] * HISTORY
        self._values = np.zeros((HISTORY, joints))  # of the first answer
        self._counted_lost = [False] * HISTORY
        self._delayed = delayed
        self._waiting: list[int] = []  # ticks whose answers are here, a heap
        self._released = -1  # tick of the last answer that was followed
        self.fresh = False
        self.newest_tick = -1
        self.duplicate = self.conflicting = self.out_of_order = self.rejected = 0
        self.rejections = dict.fromkeys(REJECTION_KINDS, 0)
        self.deadlines = Deadlines()

    def ask(self, tick: int, epoch: int, deadline: int) -> None:
        """The State of `tick` asks for an answer under `epoch` that is there by `deadline` [ns]."""
        place = tick % HISTORY
        self._asked[place] = tick
        self._epochs[place] = epoch
        self._deadline[place] = deadline
        self._arrival[place] = -1
        self._counted_lost[place] = False

    def accept(self, stamp: int, payload: bytes, last_tick: int) -> str | None:
        """Take a payload that arrived at `stamp` [ns]; `last_tick` is the newest one published.

        Returns:
            None, or the reason for which it was refused.
        """
        reason = self._refusal(payload, last_tick)
        if reason is not None:
            self.rejected += 1
            self.rejections[reason] += 1
            return reason
        setpoint = self._incoming
        tick = setpoint.tick
        place = tick % HISTORY
        if self._arrival[place] >= 0:
            self.duplicate += 1
            self.conflicting += setpoint.values.tobytes() != self._values[place].tobytes()
            return None
        self._arrival[place] = stamp
        self._values[place] = setpoint.values
        if self._counted_lost[place]:
            self.deadlines.lost_arrived()
        if self._delayed and tick > self._released:
            heappush(self._waiting, tick)
        if tick <= self.newest_tick:
            self.out_of_order += 1
            return None
        self.newest_tick = tick
        if not self._delayed:
            self._incoming, self.setpoint = self.setpoint, setpoint
            self.fresh = True
        return None

    def release(self, tick: int) -> None:
        """Let the newest of the answers that wait be followed, of those to ticks up to `tick`."""
        waiting, newest = self._waiting, -1
        while waiting and waiting[0] <= tick:
            newest = heappop(waiting)
        if newest >= 0:
            self.setpoint.values[:] = self._values[newest % HISTORY]
            self.setpoint.tick = self._released = newest
            self.fresh = True

    def settled(self, tick: int) -> bool:
        """Whether nothing still to come can change what `release(tick)` lets be followed."""
        place = tick % HISTORY
        return tick <= self._released or (self._asked[place] == tick and self._arrival[place] >= 0)

    def in_time(self, tick: int) -> bool:
        """Whether the answer to `tick` is here, and came in time."""
        place = tick % HISTORY
        return 0 <= self._arrival[place] <= self._deadline[place]

    def count(self, tick: int) -> bool:
        """Count the outcome of `tick`, whose deadline has passed; True where it was in time."""
        if self.in_time(tick):
            self.deadlines.hit()
            return True
        place = tick % HISTORY
        arrived = self._arrival[place] >= 0
        self.deadlines.miss(arrived=arrived)
        self._counted_lost[place] = not arrived
        return False

    def start_anew(self, tick: int) -> None:
        """From `tick` on, follow no answer to an earlier tick, and let earlier misses not count."""
        self.fresh = False
        self._waiting.clear()
        self.newest_tick = max(self.newest_tick, tick - 1)
        self._released = max(self._released, tick - 1)
        self.deadlines.end_run()

    def _refusal(self, payload: bytes, last_tick: int) -> str | None:
        """Load a payload into `_incoming`, or say why it is refused.

        Only one that is refused for nothing else has room made for arrays of other lengths.
        """
        try:
            self._incoming.load(payload)
        except WireError as error:
            if error.kind == "wire_version":
                return error.kind
            return self._learn(payload, last_tick)
        found = self._incoming
        address = found.session_id, found.tick, found.epoch, found.command
        return self._strange(last_tick, *address) or self._unfit()

    def _learn(self, payload: bytes, last_tick: int) -> str | None:
        """Take a setpoint whose arrays have other lengths than the last one's, or refuse it."""
        try:
            lengths = Setpoint.schema.lengths_in(payload)
            if lengths["values"] != self._joints:
                return "size"
            if any(lengths[name] > most for name, most in MAX_LENGTHS.items()):
                return "size"
            if payload[: len(CDR_HEADER)] != CDR_HEADER:
                return "layout"
            if Setpoint.scalars(payload, "wire_version") != (Setpoint.schema.version,):
                return "wire_version"
            address = Setpoint.scalars(payload, "session_id", "tick", "epoch", "command")
            reason = self._strange(last_tick, *address)
            if reason is not None:
                return reason
            self._incoming = Setpoint.allocate(**lengths)
            self._incoming.load(payload)
        except WireError as error:
            return error.kind
        return self._unfit()

    def _strange(
        self, last_tick: int, session_id: int, tick: int, epoch: int, command: int
    ) -> str | None:
        """Why a setpoint answers nothing that this robot asked, or None."""
        place = tick % HISTORY
        if session_id != self._session_id:
            return "session"
        if tick > last_tick:
            return "future"
        if self._asked[place] != tick or last_tick - tick >= HISTORY:
            return "unasked"
        if self._epochs[place] != epoch:
            return "epoch"
        return "command" if command != self._command else None

    def _unfit(self) -> str | None:
        """Why the values of `_incoming` cannot be followed, or None."""
        return None if self._all_finite(self._incoming.values) else "not_finite"
