"""The motion of a log as the points of a trajectory."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np

from hoap3.protocol.errors import LogError
from hoap3.protocol.messages import schema
from hoap3.remote_controller.references.trajectories.motion_file import column_title
from hoap3.tools.logs.log import Log

ACTIVE = schema("State").constants["ACTIVE"]
Played = Literal["measured", "applied"]


def motion_of(path: Path, played: Played = "measured", every_s: float = 0.01) -> str:
    """A CSV of the joints while the robot followed a controller, from the time 0 on.

    Positions and velocities, of the State's `q` and `dq`, or of its `reference` and what that
    gains within a period. Positions are cut to the joints' ranges, beyond which no reference may
    be, and the last point is at rest.

    Args:
        path: `*.mcap`, or the folder of a run.
        played: which of both.
        every_s: time between the points; the last State is one in any case [s].

    Raises:
        LogError: not a log, or one in which nothing moves the robot for two States.
    """
    log = Log.open(path, side="robot" if path.is_dir() else None)
    states, robot = log.states(), log.description
    states = states[states["mode"] == ACTIVE]
    if len(states) < 2:
        raise LogError(f"{path}: has no two States in which the robot follows. Name another log")
    times = (states["tick"] - states["tick"][0]).astype(float) * robot.period_s
    if played == "measured":
        q, dq = states["q"], states["dq"]
    else:
        q, dq = states["reference"], np.gradient(states["reference"], times, axis=0)
    taken = np.arange(0, len(states), max(1, round(every_s / robot.period_s)))
    if taken[-1] != len(states) - 1:
        taken = np.append(taken, len(states) - 1)
    q, dq = np.clip(q[taken], robot.lower, robot.upper), dq[taken].copy()
    if not np.isfinite(q).all() or not np.isfinite(dq).all():
        raise LogError(f"{path}: joints are not finite in it. Name another log")
    dq[-1] = 0.0
    names = [column_title(name) for name in robot.joint_names]
    header = ["t", *names, *(f"{name}/velocity" for name in names)]
    return _csv(header, np.column_stack([times[taken], q, dq]))


def _csv(header: list[str], table: Any) -> str:
    rows = (",".join(map(repr, row)) for row in table.tolist())
    return "\n".join([",".join(header), *rows, ""])
