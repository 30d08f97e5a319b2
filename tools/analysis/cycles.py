"""Cycles of a controller as arrays, from its log and from the answers in the log of the robot.

Stamps are int64 [ns], `NEVER` where there is none. Those of the robot and those of the controller
are of two clocks, and are never compared with each other; only durations are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.disk_rows import RowsAt
from hoap3.tools.logs.log import Log, Rows

Stamps = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

NEVER = -1
EVENTS = Event.schema.constants


@dataclass(frozen=True)
class Cycles:
    """Cycles of a controller, sorted by tick: at most one for each State.

    Attributes:
        tick: of the State that was answered.
        published: when the robot had published it, by the robot's clock [ns].
        received, decoded, kinematics, solved, encoded, sent: by the controller's clock [ns].
            From `decoded` to `encoded` they are NEVER where nothing was sent; `sent` is NEVER
            where no later answer states it.
        answered: an answer was handed to the link.
        overwritten: pairs of ticks (first, last) that the controller reports as overwritten.
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
    def read(cls, log: Log | None, session: int, arrived: RowsAt) -> Cycles:
        """Read the cycles of the controller's log, and those whose answers arrived at the robot.

        Args:
            log: of the controller, where there is one.
            session: of the robot.
            arrived: valid answers in the log of the robot.
        """
        overwritten = np.empty((0, 2), np.int64)
        seen = np.empty(0, arrived.dtype["tick"])
        seen_received = seen_published = np.empty(0, np.int64)
        sent_rows = arrived[:0]
        if log is not None:
            stamps, states = log.table(Kind.STATE)
            ours = states["session_id"] == session
            seen, seen_published = states["tick"][ours], states["stamp_published"][ours]
            seen_received = stamps[ours]
            sent_rows = RowsAt.of(log.setpoints())
            sent_rows = sent_rows[sent_rows["session_id"] == session]
            overwritten = _overwritten(log.table(Kind.EVENT)[1], session)
        answered_ticks, first = np.unique(
            np.concatenate([sent_rows["tick"], arrived["tick"]]), return_index=True
        )
        ticks = np.union1d(seen, answered_ticks).astype(np.int64)
        fields = {name: np.full(len(ticks), NEVER) for name in _ANSWER_FIELDS}
        at = np.searchsorted(ticks, answered_ticks.astype(np.int64))
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
        sent_previous = fields.pop("sent_previous")
        _discard_invalid(fields, answered)
        sent = _sent(ticks, fields, sent_previous, answered, own)
        return cls(tick=ticks, **fields, sent=sent, answered=answered, overwritten=overwritten)

    def __len__(self) -> int:
        return len(self.tick)

    def waits(self) -> npt.NDArray[np.float64]:
        """How long each State waited for the controller to finish the cycle before [ns].

        A State that comes while the controller is busy waits in a channel, where a newer one
        replaces it. Its waiting time follows Lindley's recursion for a queue with one server,

            w_n = max(0, w_{n-1} + b_{n-1} - (p_n - p_{n-1})),

        b the length of a cycle by the controller's clock, p the publication by the robot's: only
        durations of two clocks are compared. Every State is taken to travel for equally long.
        """
        if not len(self):
            return np.empty(0)
        step = np.concatenate([[0], self._busy()[:-1] - np.diff(self.published)])
        load = np.cumsum(step)
        waits: npt.NDArray[np.float64] = (load - np.minimum.accumulate(load)).astype(np.float64)
        return waits

    def ready(self) -> npt.NDArray[np.float64]:
        """For how long after its State's arrival each cycle kept the controller busy [ns]."""
        return self.waits() + self._busy()

    def _busy(self) -> Stamps:
        """Length of each cycle [ns]; 0 where it is not known."""
        ready = np.where(self.sent != NEVER, self.sent, self.encoded)
        return np.where(ready != NEVER, ready - self.received, 0)

    def is_overwritten(self, ticks: Stamps) -> Flags:
        """Which of these ticks the controller reports as overwritten."""
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


def _overwritten(events: Rows, session: int) -> Stamps:
    told = events[(events["kind"] == EVENTS["OVERWRITTEN"]) & (events["session_id"] == session)]
    before = told["tick"].astype(np.int64)
    return np.stack([before + 1, before + told["detail"]], axis=1)


def _discard_invalid(fields: dict[str, Stamps], answered: Flags) -> None:
    """Replace kinematics stamps out of bounds by the step's start; drop stamps out of order."""
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
    ticks: Stamps, fields: dict[str, Stamps], sent_previous: Stamps, answered: Flags, own: Flags
) -> Stamps:
    """When the link had taken each answer, as the answer of the cycle right after it states."""
    sent = np.full(len(ticks), NEVER)
    follows = answered[1:] & ((own[1:] & own[:-1]) | (np.diff(ticks) == 1))
    told = sent_previous[1:]
    begun = np.where(fields["encoded"] != NEVER, fields["encoded"], fields["received"])[:-1]
    possible = (begun != NEVER) & (told >= begun) & (told <= fields["received"][1:])
    sent[:-1] = np.where(follows & possible, told, NEVER)
    return sent
