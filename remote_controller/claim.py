"""What a controller makes of its authority: pure steps, from one State of the robot to the next.

`python -m tests.proofs authority` searches this code together with the robot's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from hoap3.protocol.messages import State

MOST_STRANGE_STATES = 100
"""In a row. One State may be old, or forged; so many are not."""


@dataclass(frozen=True)
class Claim:
    """Authority as its holder knows it.

    Attributes:
        session_id: of the robot.
        epoch: what was granted in that session, 0 for nothing.
        strange: States in a row that do not fit.
        stale: the robot is to be asked anew.
    """

    session_id: int
    epoch: int = 0
    strange: int = 0
    stale: bool = False

    def fits(self, session_id: int) -> bool:
        """Whether a grant is of the robot's session that the claim is for."""
        return session_id == self.session_id

    def update(self, session_id: int, mode: int, epoch: int, from_tick: int) -> Claim:
        """Take a State: the robot's mode, the epoch that it follows, the first tick of its grant.

        While it comes to rest, it follows an earlier grant to the end: ours may be the next one.
        """
        if not self.fits(session_id):  # the robot has started again, or another uses its name
            return self.doubt(True)
        if epoch == self.epoch or not self.epoch:
            return self.doubt(False)
        return self.doubt(mode == State.ACTIVE or from_tick == 0)

    def doubt(self, strange: bool) -> Claim:
        """Count a State that does, or does not, fit what was agreed."""
        strange_ones = self.strange + 1 if strange else 0
        if strange_ones == self.strange:
            return self
        stale = self.stale or strange_ones >= MOST_STRANGE_STATES
        return replace(self, strange=strange_ones, stale=stale)
