"""An arm of one's own: from a URDF to a tip that follows what it is sent.

    hoap3 robot import examples/own_arm/desk_arm.urdf --out desk_arm
    hoap3 robot check desk_arm
    hoap3 run --lockstep --robot desk_arm

`desk_arm/` beside this file is what the first command wrote: a `robot.yaml` that says what was
read and what was guessed, and the URDF that travels. A start posture was added at its end.
`steered.yaml` is a controller for it: a live target with bounds of speed, acceleration, jerk and
place. Then, in three terminals:

    hoap3 emulator examples/own_arm/desk_arm
    hoap3 controller examples/own_arm/steered.yaml
    python examples/own_arm/steer.py

The tip goes along a square over the desk, corner by corner; a corner that lies outside of what
`steered.yaml` allows is refused, and the tip stays where it is.
"""

from __future__ import annotations

import argparse

import numpy as np

import hoap3

CORNERS = [[0.40, -0.1, 0.2], [0.40, 0.1, 0.2], [0.30, 0.1, 0.2], [0.30, -0.1, 0.2]]  # [m]
OUTSIDE = [0.40, -0.1, -0.2]  # below the desk
STILL_RAD_S = 1e-3
QUIET_TICKS = 300  # for so long before the motion counts as over


def go(robot: hoap3.Connection, place: list[float]) -> np.ndarray:
    """Send a target, and wait until no joint has moved for a while; where they are, (4,) [rad]."""
    before, number = counted(robot), robot.send_target(place)
    quiet_since = None
    for state in robot.states():
        if quiet_since is None:
            quiet_since = state.tick if counted(robot) > before else None
        elif np.abs(state.dq).max() > STILL_RAD_S:
            quiet_since = state.tick
        elif state.tick - quiet_since > QUIET_TICKS:
            return state.q.copy()
    raise RuntimeError(f"the robot ended before it answered message {number}")


def counted(robot: hoap3.Connection) -> int:
    """How many messages the controller has taken or refused."""
    counts = robot.counts()
    return int(counts["taken"]) + sum(counts["refused"].values())


def square(endpoint: str | None) -> list[np.ndarray]:
    """Go to each corner; the joints at each of them, and after a target that is refused."""
    with hoap3.connect("desk_arm", endpoint) as robot:
        (target,) = robot.acquire(timeout_s=60.0)  # the controller may still compile
        print(f"we steer {target['name']!r}: {target['dimension']} numbers in {target['unit']}")
        found = []
        for place in CORNERS:
            found.append(go(robot, place))
            print(f"sent {place}: joints at {np.round(found[-1], 3)}")
        try:
            robot.send_target(OUTSIDE)
        except hoap3.BadProblemError as error:
            print(f"refused: {error}")
        found.append(robot.state().q.copy())
        print("what came of it:", robot.counts())
    return found


if __name__ == "__main__":
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("--connect", help="endpoint; default: the robot on this machine")
    try:
        square(asked.parse_args().connect)
    except hoap3.Hoap3Error as error:
        raise SystemExit(f"steer: {error}") from None
