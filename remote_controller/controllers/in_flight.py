"""Where a robot that delays answers will be when it applies the next one."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.robot.description import RobotDescription


class InFlight:
    """Leads the reference of each State through the answers that are on their way.

    With a delay of d ticks the answer to tick k is applied at tick k + 1 + d, after those to the d
    ticks before k. Each of them is taken to arrive, and to move the reference as far as the robot's
    limits of position and speed let it.

    Args:
        description: of a robot with `delay_ticks` above 0.

    Attributes:
        foreseen: whether the reference of the last State is what was foreseen for its tick.
    """

    def __init__(self, description: RobotDescription) -> None:
        n, self._delay = description.n, description.delay_ticks
        self._range = description.lower, description.upper
        self._reach = description.velocity * description.period_s
        self._ahead = State.allocate(**description.state_lengths)
        self._sent_ticks = [-1] * self._delay  # the tick that uses this place
        self._sent = np.zeros((self._delay, n))
        self._foreseen_ticks = [-1] * self._delay
        self._foreseen = np.zeros((self._delay, n))
        self._epoch, self._last_tick, self._in_a_row = 0, -1, 0
        self.foreseen = True

    def ahead(self, state: State) -> State:
        """A State of which the reference is the one from which the next answer will move."""
        ahead, tick, place = self._ahead, state.tick, state.tick % self._delay
        ahead.load(state.dump())
        if state.mode != State.ACTIVE:
            self._epoch, self.foreseen = 0, True
            return ahead
        if state.epoch != self._epoch or tick == state.epoch_from_tick:
            self._begin(state)
        follows, self._last_tick = tick == self._last_tick + 1, tick
        self.foreseen = self._foreseen_ticks[place] == tick and bool(
            (self._foreseen[place] == state.reference).all()
        )
        self._in_a_row = self._in_a_row + 1 if self.foreseen and follows else 0
        if self._in_a_row > self._delay:  # what was foreseen a tick ago is good for the next, too
            ahead.reference[:] = self._foreseen[(tick - 1) % self._delay]
            self._move(ahead.reference, tick - 1)
        else:
            for sent in range(max(0, tick - self._delay), tick):
                self._move(ahead.reference, sent)
        self._foreseen_ticks[place] = tick + self._delay
        self._foreseen[place] = ahead.reference
        return ahead

    def sent(self, tick: int, values: FloatArray) -> None:
        """The answer to `tick` is known, (n,); the robot refuses one that is not finite."""
        place = tick % self._delay
        self._sent_ticks[place] = tick if np.isfinite(values).all() else -1
        self._sent[place] = values

    def _begin(self, state: State) -> None:
        """Nothing is on its way: until the first answer is applied the robot stays."""
        self._epoch, self._in_a_row, self._last_tick = state.epoch, 0, state.tick - 1
        self._sent_ticks[:] = [-1] * self._delay
        for tick in range(state.tick, state.tick + self._delay):
            self._foreseen_ticks[tick % self._delay] = tick
        self._foreseen[:] = state.reference

    def _move(self, reference: FloatArray, sent: int) -> None:
        """Let `reference` move by a period towards the answer to the tick `sent`, if there is."""
        place = sent % self._delay
        if self._sent_ticks[place] != sent:
            return
        lower, upper = self._range
        least = np.maximum(reference - self._reach, np.minimum(lower, reference))
        most = np.minimum(reference + self._reach, np.maximum(upper, reference))
        np.clip(self._sent[place], least, most, out=reference)
