"""Pictures of the constraints: with and without each."""

from __future__ import annotations

from typing import Any

import numpy as np
from drawing import label, limit, lines, of, panels
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from runs import POINTS, WITHIN, Array, Run, qp12, reach, run

from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.robot_emulator.robots import load
from hoap3.tools.reproduce.figures import COLOURS

ALL = {"objective": qp12(0.0), "psi": {"form": "max_norm"}}
BEHIND = reach("r_forearm", 0.06, -0.16, 0.06)
BALL = {
    "shape": "sphere",
    "name": "ball",
    "frame": "pelvis",
    "center_m": [0.14, -0.14, 0.03],
    "radius_m": 0.025,
}
TIP = (0.19, 0.0, 0.0)  # m, of the forearm, in its frame


def entry(constraint: str, **parameters: Any) -> dict[str, Any]:
    """A line of the list of constraints."""
    return {"constraint": constraint, "parameters": parameters}


def distance() -> Figure:
    """Round the ball."""
    figure, (path, gap) = panels(2)
    kept = entry("distance", clearance_m=0.005, obstacles=[BALL])
    fast = entry("joint_velocity", limit_rad_s=1.0)
    runs = {
        "without": run(3.0, BEHIND, [fast, WITHIN[1]], **ALL),
        "distance": run(3.0, BEHIND, [fast, WITHIN[1], kept], **ALL),
    }
    path.add_patch(Circle((140, 30), 25, facecolor="#EEEEEE", edgecolor="#888888"))
    for place, (name, each) in enumerate(runs.items()):
        elbow, tip = 1e3 * each.frame("r_forearm"), 1e3 * each.frame("r_forearm", at=TIP)
        lines(path, {name: thin(tip[:, 0], tip[:, 2])}, first=place)
        for tick in (0, 1500, 2999):
            ends = np.stack((elbow[tick], tip[tick]))
            path.plot(ends[:, 0], ends[:, 2], color=COLOURS[place], linewidth=0.7, alpha=0.6)
    label(path, "forearm, its tip, and the ball, from the side", "x [mm]", "z [mm]")
    path.set_aspect("equal")
    lines(gap, {name: of(each, 1e3 * nearest(each)) for name, each in runs.items()})
    limit(gap, 5.0, "clearance_m: 0.005")
    label(gap, "nearest link to the ball", "t [s]", "distance [mm]")
    return figure


def nearest(found: Run) -> Array:
    """Distance of the nearest link from the ball [m]."""
    from hoap3.protocol.messages import State
    from hoap3.remote_controller.constraints.collision.distance import Distance

    robot = load("hoap3")
    kinematics, state = Kinematics(robot), State(robot.n, 0)
    parameters = Distance.Parameters.model_validate(
        {"pairs": [], "obstacles": [BALL], "clearance_m": 0.0}
    )
    measured = Distance(parameters, robot, kinematics, robot.period_s)
    A, b, gaps = np.zeros((measured.rows, robot.n)), np.zeros(measured.rows), []
    for q in found.q:
        kinematics.update(q)
        measured.update(kinematics, state, A, b)
        gaps.append(measured.margin())
    return np.array(gaps)


def thin(x: Array, y: Array) -> tuple[Array, Array]:
    """So many points of a path at the most."""
    chosen = np.linspace(0, len(x) - 1, min(POINTS, len(x))).round().astype(int)
    return x[chosen], y[chosen]
