"""Run under either revision: a lockstep run in which something comes at given ticks.

    python simulate.py INPUT.json

No command does this on virtual time, so it uses `hoap3.simulate`. Writes the States and Setpoints
to the current folder.
"""

from __future__ import annotations

import json
import random
import sys
from pathlib import Path
from typing import Any

import numpy as np

import hoap3
from hoap3.protocol.messages import Target

WHO = "frozen"
COMPUTE_NS, LATE_NS = 200_000, 1_500_000


class Script:
    """Changes and targets that are given to the controller after their ticks."""

    def __init__(self, changes: dict[str, Any], targets: dict[str, Any]) -> None:
        self.changes, self.targets = changes, targets
        self.number = 0

    def __call__(self, loop: Any) -> None:
        tick = str(loop.last_tick)
        if tick in self.changes:
            loop.change(json.dumps(self.changes.pop(tick)).encode())
        if tick in self.targets:
            self.send(loop, self.targets.pop(tick))

    def send(self, loop: Any, points: list[list[float]]) -> None:
        """Send points that follow each other every 20 ticks."""
        grant = loop.operate("acquire", WHO)
        target = Target(len(points), len(points[0]))
        self.number += 1
        target.number, target.tick_step, target.first_tick = self.number, 20, loop.last_tick
        target.session_id, target.epoch = grant["session_id"], grant["epoch"]
        target.values[:] = np.ravel(points)
        loop.steer(WHO, target.dump())


def fate_of(shares: dict[str, float] | None) -> Any:
    """What becomes of each answer: lost, late or doubled in these shares, by a fixed seed."""
    if shares is None:
        return None
    rng = random.Random(46)

    def fate(answer: bytes) -> list[tuple[int, bytes]]:
        drawn = rng.random()
        if drawn < shares["lost"]:
            return []
        if drawn < shares["lost"] + shares["late"]:
            return [(LATE_NS, answer)]
        twice = drawn < shares["lost"] + shares["late"] + shares["doubled"]
        return [(COMPUTE_NS, answer)] * (2 if twice else 1)

    return fate


def main() -> None:
    given = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    script = Script(given.get("changes", {}), given.get("targets", {}))
    done = hoap3.simulate(
        given["robot"],
        given["controller"],
        given["seconds"],
        fate=fate_of(given.get("answers")),
        steer=script,
    )
    np.save("states.npy", done.states)
    np.save("setpoints.npy", done.setpoints)
    left = [*script.changes, *script.targets]
    print(json.dumps({"not_sent": left, "in_time": done.deadlines.run_rate}))


if __name__ == "__main__":
    main()
