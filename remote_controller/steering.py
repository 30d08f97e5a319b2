"""Who steers a controller's live targets, and which of their messages count."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hoap3.protocol.errors import UsageError, WireError
from hoap3.protocol.messages import CDR_HEADER, Target
from hoap3.remote_controller.references.live.live import Live

LEASE_S = 2.0  # without a word of the operator, after which somebody else may steer
GRANTS = 1 << 20  # of one engagement, whose epochs are apart from those of any other

REFUSALS = (
    "malformed",
    "not_following",
    "other_session",
    "not_operator",
    "unknown_target",
    "behind",
    "wrong_size",
    "not_finite",
    "not_unit",
    "late",
    "too_far_ahead",
    "out_of_range",
    "too_fast",
)
"""Why a message is refused; docs/guides/live.md explains each reason."""


class Steering:
    """One operator at a time, and what its messages come to.

    Time is the robot's: its ticks times its period.

    Args:
        live: targets of the controller, in the order of `Target.target`.
        session_id: of the robot.
        period_s: its period [s].

    Attributes:
        operator: who steers, "" for nobody.
        taken, late_points: messages that count, and their points that were in the past.
        lost: messages of operators that never arrived, by the gaps between the numbers of others.
        refused: messages that do not, by reason.
    """

    def __init__(self, live: Sequence[Live], session_id: int, period_s: float) -> None:
        self._live, self._session_id, self._period = tuple(live), session_id, period_s
        self._lease = round(LEASE_S / period_s)
        self._epoch = self._heard = self._newest = self._last_number = 0
        self.operator = ""
        self.taken = self.late_points = self.lost = 0
        self.refused = dict.fromkeys(REFUSALS, 0)
        self._before = self.counts()  # when somebody began to steer

    def acquire(
        self, who: str, authority: int, tick: int, *, following: bool = True
    ) -> dict[str, Any]:
        """Make somebody the operator, or note that it still is; what it must know.

        Args:
            who: asks.
            authority: epoch under which the robot follows us.
            tick: the newest one.
            following: whether the robot follows us.

        Raises:
            UsageError: there is nothing to steer, or somebody else steers.
        """
        if not self._live:
            raise UsageError("no target of this controller is live: give a task `kind: live`")
        self._expire(tick)
        if self.operator not in {"", who}:
            raise UsageError(f"{self.operator!r} steers; it is free {LEASE_S:g} s after its end")
        if not self.operator:
            base = authority * GRANTS
            self._epoch = max(self._epoch, base) + 1
            self.operator, self._before = who, self.counts()
            self._newest = self._last_number = 0
        self._heard = tick
        return {
            "epoch": self._epoch,
            "session_id": self._session_id,
            "tick": tick,
            "following": following,
            "period_s": self._period,
            "lease_s": LEASE_S,
            "newest": self._newest,
            "targets": [
                {**each.as_json(), "at_rest": each.is_at_rest(tick * self._period)}
                for each in self._live
            ],
            **self.counts(self._before),
        }

    def release(self, who: str) -> bool:
        """Free what somebody steers; whether it did."""
        if who != self.operator or not who:
            return False
        self.operator = ""
        return True

    def take(self, who: str, payload: bytes, tick: int, *, following: bool) -> bool:
        """Have a task follow a message; whether it counts, else why not is counted.

        Args:
            who: sent it.
            payload: a `Target`.
            tick: the newest one.
            following: whether the robot follows us.
        """
        self._expire(tick)
        refusal = self._doubt(who, payload, following=following)
        if not refusal:
            self._heard = tick
            (self._newest,) = Target.scalars(payload, "number")
            refusal = self.follow(payload, tick)
        if refusal:
            self.refused[refusal] += 1
        return not refusal

    def follow(self, payload: bytes, tick: int) -> str:
        """Have a task follow a message, whoever sent it; "" or why it is refused."""
        try:
            target = Target.like(payload)
            target.load(payload)
        except WireError:
            return "malformed"
        if target.target >= len(self._live):
            return "unknown_target"
        shape = target.points, target.dimension
        if target.values.size != shape[0] * shape[1] or not target.values.size:
            return "wrong_size"
        live = self._live[target.target]
        rates = target.points, live.space.dimension
        if target.rates.size not in {0, rates[0] * rates[1]}:
            return "wrong_size"
        found = live.take(
            target.first_tick * self._period,
            target.tick_step * self._period,
            target.values.reshape(shape),
            target.rates.reshape(rates if target.rates.size else (0, rates[1])),
            (tick + 1) * self._period,
        )
        if isinstance(found, str):
            return found
        self.taken += 1
        self.late_points += found
        return ""

    def silent(self, tick: int) -> bool:
        """Whether the controller is to send nothing, as a target is stale that stops it."""
        time_s = tick * self._period
        return any(each.stops_at_s <= time_s for each in self._live)

    def counts(self, since: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """What came of all messages, or of those since other counts."""
        before = since or {"taken": 0, "late_points": 0, "lost": 0, "refused": {}}
        refused = {
            reason: count - before["refused"].get(reason, 0)
            for reason, count in self.refused.items()
            if count > before["refused"].get(reason, 0)
        }
        return {
            "taken": self.taken - before["taken"],
            "late_points": self.late_points - before["late_points"],
            "lost": self.lost - before["lost"],
            "refused": refused,
        }

    def as_json(self) -> dict[str, Any]:
        """The same, and who steers."""
        return {"operator": self.operator or None, **self.counts()}

    def __str__(self) -> str:
        refused = ", ".join(
            f"{count} {reason}" for reason, count in self.counts()["refused"].items()
        )
        return (
            f"targets: {self.taken} taken, {self.late_points} of their points late; "
            f"{self.lost} lost; refused: {refused or 'none'}"
        )

    def _expire(self, tick: int) -> None:
        if tick - self._heard > self._lease:
            self.operator = ""

    def _doubt(self, who: str, payload: bytes, *, following: bool) -> str:
        try:
            _, size = Target.schema.measure(payload)
            given = Target.scalars(payload, "wire_version", "session_id", "epoch", "number")
        except WireError:
            return "malformed"
        version, session_id, epoch, number = given
        if size != len(payload) or payload[: len(CDR_HEADER)] != CDR_HEADER:
            return "malformed"
        if version != Target.schema.version:
            return "malformed"
        is_operator = self.operator != "" and (who, epoch) == (self.operator, self._epoch)
        if is_operator and session_id == self._session_id and number > self._last_number:
            self.lost += number - self._last_number - 1
            self._last_number = number
        if not following:
            return "not_following"
        if session_id != self._session_id:
            return "other_session"
        if not is_operator:
            return "not_operator"
        return "behind" if number <= self._newest else ""
