"""A slow brain steers a fast robot: chunks at 20 Hz that are 300 ms old when they arrive.

    hoap3 emulator ur5
    hoap3 controller steered_ur5
    python examples/slow_policy.py

Each chunk begins at the tick of the State that the policy saw and reaches 400 ms beyond its
arrival. So what it thinks for costs no accuracy: the hand is on the curve, not behind it.
"""

from __future__ import annotations

import argparse
import heapq
import time

import numpy as np

import hoap3

STEP_TICKS = 50  # between two points, and between two chunks: 20 Hz
DELAY_TICKS, JITTER_TICKS = 300, 50  # what the policy thinks for
AHEAD_TICKS = 400  # beyond the arrival
LOSS = 0.05  # of chunks that never arrive
WIDTH_M, ROUND_S = 0.12, 8.0  # of the figure of eight, at 0.1 m/s in its middle


class Policy:
    """Knows where the hand shall be at each tick.

    Args:
        centre: of the figure of eight, (3,) [m].
        seed: of what is late and lost.
    """

    def __init__(self, centre: np.ndarray, seed: int = 0) -> None:
        self.centre, self._rng = np.asarray(centre, float), np.random.default_rng(seed)

    def place(self, tick: np.ndarray) -> np.ndarray:
        """Where the hand shall be at some ticks of 1 ms, (…, 3) [m]."""
        angle = 2e-3 * np.pi / ROUND_S * np.asarray(tick, float)
        width = 0.5 * WIDTH_M
        eight = width * np.sin(angle), 0.5 * width * np.sin(2.0 * angle), 0.0 * angle
        return self.centre + np.stack(eight, -1)

    def chunk(self, tick: int) -> np.ndarray:
        """What it wants from the tick that it sees on, (p, 3) [m]."""
        count = (DELAY_TICKS + AHEAD_TICKS) // STEP_TICKS + 1
        return self.place(tick + STEP_TICKS * np.arange(count))

    def arrival(self, tick: int) -> int | None:
        """When the chunk of a tick arrives; None: never."""
        late = DELAY_TICKS + int(self._rng.integers(-JITTER_TICKS, JITTER_TICKS + 1))
        return None if self._rng.random() < LOSS else tick + late


def steer(robot: str, endpoint: str | None, centre: list[float], seconds: float) -> int:
    """Steer a running robot; how many chunks were sent."""
    policy, thinking, sent = Policy(np.array(centre)), [], 0
    with hoap3.connect(robot, endpoint) as connection:
        connection.acquire(timeout_s=60.0)  # the controller may still compile
        first = due = connection.state().tick
        for state in connection.states():
            tick = state.tick
            if tick >= first + 1000 * seconds:
                print(connection.counts())
                return sent
            if tick >= due:  # States may be skipped
                due += STEP_TICKS
                if (arrival := policy.arrival(tick)) is not None:
                    heapq.heappush(thinking, (arrival, tick))
            while thinking and thinking[0][0] <= tick:
                seen = heapq.heappop(thinking)[1]
                connection.send_chunk(policy.chunk(seen), seen, STEP_TICKS)
                sent += 1
    return sent


if __name__ == "__main__":
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("--robot", default="ur5")
    asked.add_argument("--connect", help="endpoint; default: the robot on this machine")
    asked.add_argument("--centre", type=float, nargs=3, default=[-0.55, -0.11, 0.3])
    asked.add_argument("--seconds", type=float, default=20.0)
    given = asked.parse_args()
    begun = time.monotonic()
    try:
        chunks = steer(given.robot, given.connect, given.centre, given.seconds)
    except hoap3.Hoap3Error as error:
        raise SystemExit(f"slow_policy: {error}") from None
    print(f"{chunks} chunks in {time.monotonic() - begun:.0f} s")
