"""Who may command the robot: one holder at a time, named by an epoch that never comes back."""

from __future__ import annotations

from dataclasses import dataclass, replace


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


class Authority:
    """Gives and takes back authority.

    Attributes:
        grant: what is in force or will be, or None.
    """

    def __init__(self) -> None:
        self._epoch = 0
        self.grant: Grant | None = None

    def acquire(self, who: str, from_tick: int) -> Grant | None:
        """Grant authority from a tick on; the holder itself gets its own grant again.

        Returns:
            The grant, or None where somebody else holds authority.
        """
        if self.grant is None:
            self._epoch += 1
            self.grant = Grant(self._epoch, who, from_tick)
        return self.grant if self.grant.holder == who else None

    def renew(self, from_tick: int) -> Grant | None:
        """After a recovery: the holder's answers count from a tick on."""
        if self.grant is not None:
            self.grant = replace(self.grant, from_tick=from_tick)
        return self.grant

    def drop(self, who: str) -> int:
        """Take authority from `who`; the epoch that ended, or 0 where `who` held none."""
        if self.grant is None or self.grant.holder != who:
            return 0
        epoch, self.grant = self.grant.epoch, None
        return epoch
