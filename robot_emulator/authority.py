"""Who may command the robot, and what becomes of its motion when that changes.

One holder at a time, named by an epoch that never comes back. Every step is pure: it takes the
standing and what happened, and returns the next standing, or the same object where nothing changes.
The robot's loop keeps the newest. `python -m tests.proofs authority` searches everything that these
steps can lead to (docs/internals/proofs.md).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from hoap3.protocol.messages import Event, State

NO_TOKEN, HELD, NAME_TAKEN = "no_token", "held", "name_taken"
"""Why authority is refused."""

_REASONS = Event.schema.constants
RELEASED = _REASONS["REASON_RELEASED"]
ENDING = frozenset({_REASONS["REASON_SHUTDOWN"], _REASONS["REASON_ENDED"]})
"""Reasons of a stop: one that needs no recovery, and those after which the schedule ends."""


@dataclass(frozen=True)
class Grant:
    """Authority of one holder.

    Attributes:
        epoch: counts grants from 1; setpoints carry it.
        holder: identity of the client.
        from_tick: first tick whose answer must carry this epoch.
    """

    epoch: int
    holder: str
    from_tick: int


@dataclass(frozen=True)
class Authority:
    """How the robot stands towards its clients.

    Attributes:
        granted: how many grants there were.
        grant: what is in force or will be, or None.
        mode: State.IDLE, ACTIVE, STOPPING or STOPPED.
        followed: epoch of the motion, 0 at rest.
        stop_reason: of the stop that lasts, a REASON of `Event`; 0 for none.
        look_tick: when the holder is looked up next.
    """

    granted: int = 0
    grant: Grant | None = None
    mode: int = State.IDLE
    followed: int = 0
    stop_reason: int = 0
    look_tick: int = 0

    @property
    def latched(self) -> bool:
        """Whether the robot stops, or is stopped, until an explicit recover."""
        return self.stop_reason not in (0, RELEASED)

    @property
    def told_from_tick(self) -> int:
        """First tick of the grant as States tell it; unless the robot moves, 0 says: none."""
        if self.grant is None:
            return 0
        least = 0 if self.mode == State.ACTIVE else 1
        return max(self.grant.from_tick, least)

    def acquire(
        self,
        who: str,
        *,
        present: bool,
        tick: int,
        from_tick: int,
        lease: int,
        unique: bool = True,
    ) -> tuple[Authority, str]:
        """Grant authority from a tick on; the holder itself gets its own grant again.

        Args:
            who: asks.
            present: whether its liveliness token is seen.
            tick: now.
            from_tick: of a new grant.
            lease: ticks after which a holder is looked up.
            unique: whether no other robot on the network uses the robot's name.

        Returns:
            What comes next, and why it is refused: `NO_TOKEN`, `HELD` by another controller,
            `NAME_TAKEN` by another robot, or "". While the name is not unique, only the holder is
            not refused.
        """
        grant = self.grant
        if not present and (grant is None or grant.holder == who):
            return self, NO_TOKEN
        if grant is None and not unique:
            return self, NAME_TAKEN
        if grant is None:
            epoch = self.granted + 1
            fresh = Grant(epoch, who, from_tick)
            return replace(self, granted=epoch, grant=fresh, look_tick=tick + lease), ""
        if grant.holder == who:
            return self, ""
        return replace(self, look_tick=tick), HELD if unique else NAME_TAKEN

    def drop(self, who: str, reason: int) -> Authority:
        """Take authority from `who`, if it has it, and stop for a reason."""
        if self.grant is None or self.grant.holder != who:
            return self
        return replace(self, grant=None).stop(reason)

    def stop(self, reason: int) -> Authority:
        """Brake to rest; a stop that lasts until a recovery is not weakened by a later release."""
        if self.latched:
            ends = reason in ENDING and reason != self.stop_reason
            return replace(self, stop_reason=reason) if ends else self
        if self.mode == State.ACTIVE:
            return replace(self, mode=State.STOPPING, stop_reason=reason)
        told = replace(self, stop_reason=reason)
        return told.come_to_rest() if self.mode == State.IDLE else told

    def come_to_rest(self) -> Authority:
        """The motion has ended: wait for the next grant, or for a recovery."""
        if self.latched:
            return replace(self, mode=State.STOPPED, followed=0)
        return replace(self, mode=State.IDLE, followed=0, stop_reason=0)

    def recover(self, tick: int, from_tick: int) -> Authority:
        """Release the latch: the holder, if there is one, counts from a tick on; look it up."""
        if self.mode != State.STOPPED:
            return replace(self, look_tick=tick)
        grant = self.grant and replace(self.grant, from_tick=from_tick)
        return replace(self, mode=State.IDLE, stop_reason=0, grant=grant, look_tick=tick)

    def begin(self, tick: int) -> Authority:
        """From its first tick on, a grant makes the robot active."""
        if self.mode != State.IDLE or self.grant is None or tick < self.grant.from_tick:
            return self
        return replace(self, mode=State.ACTIVE, followed=self.grant.epoch)

    def to_look_up(self, tick: int) -> str | None:
        """The holder, where it is to be looked up: once each lease, and when it is in doubt."""
        return self.grant.holder if self.grant is not None and tick >= self.look_tick else None

    def looked_up(self, tick: int, lease: int) -> Authority:
        """Its look-up is on the way."""
        return replace(self, look_tick=tick + lease)
