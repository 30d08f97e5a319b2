"""Pictures of the constraints: with and without each."""

from __future__ import annotations

from typing import Any

import numpy as np
from drawing import area, label, limit, lines, of, panels
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from runs import EDGE, JOINTS, POINTS, SPEEDS, WITHIN, Array, Run, qp12, reach, run, to

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
SOLE = ((54, 36.5), (-54, 36.5), (-54, -36.5), (54, -36.5))  # mm


def entry(constraint: str, **parameters: Any) -> dict[str, Any]:
    """A line of the list of constraints."""
    return {"constraint": constraint, "parameters": parameters}


def joint_velocity() -> Figure:
    """No joint faster than its limit."""
    figure, axes = panels(2)
    slow = entry("joint_velocity", limit_rad_s=0.1)
    kinds = {"without": WITHIN[1:], "limit_rad_s: 0.1": (slow, WITHIN[1])}
    for one, (title, kept) in zip(axes, kinds.items(), strict=True):
        found = run(1.0, constraints=kept, **ALL)
        shown = ("r_ankle_pitch", "r_knee", "r_hip_pitch", "waist_pitch")
        curves = {name: of(found, found.u[:, JOINTS.index(name)]) for name in shown}
        lines(one, curves, at="lower right")
        limit(one, 0.1)
        limit(one, -0.1)
        one.set_ylim(-0.2, 0.2)
        label(one, title, "t [s]", "u [rad/s]")
    return figure


def joint_position() -> Figure:
    """The end of a range is approached at rate η."""
    figure, (position, speed) = panels(2)
    task = {"task": "posture", "parameters": {"joints": ["r_elbow"], "target_rad": [0.3]}}
    elbow, where, how_fast = JOINTS.index("r_elbow"), {}, {}
    for eta in (2.0, 10.0, 50.0):
        kept = entry("joint_position", eta_per_s=eta)
        psi = {"form": "max_norm", "beta": 10.0}
        found = run(3.0, task, [SPEEDS, kept], objective=qp12(0.0), psi=psi)
        where[f"η = {eta:g}/s"] = of(found, found.q[:, elbow])
        how_fast[f"η = {eta:g}/s"] = of(found, found.u[:, elbow])
    lines(position, where)
    limit(position, 0.0, "end of the usable range")
    position.set_ylim(-0.8, 0.1)
    label(position, "elbow, asked to go beyond its range", "t [s]", "q [rad]")
    lines(speed, how_fast)
    label(speed, "its speed", "t [s]", "u [rad/s]")
    return figure


def support_polygon() -> Figure:
    """The centre of mass stops at the edge."""
    figure, (path, margin) = panels(2)
    wanted = to(0.03, 0.06, 0.2869)
    runs = {
        "without": run(1.5, wanted, WITHIN, **ALL),
        "support_polygon": run(1.5, wanted, [*WITHIN, EDGE], **ALL),
    }
    area(path, SOLE, "")
    tracks = {name: 1e3 * each.com() for name, each in runs.items()}
    lines(path, {name: thin(track[:, 0], track[:, 1]) for name, track in tracks.items()})
    path.plot(30, 60, "x", color="#222222")
    path.annotate("target", (30, 60), xytext=(5, -3), textcoords="offset points")
    path.set_aspect("equal")
    label(path, "from above, on the sole", "x [mm]", "y [mm]")
    lines(margin, {name: of(runs[name], 36.5 - track[:, 1]) for name, track in tracks.items()})
    limit(margin, 5.0, "margin_m: 0.005")
    label(margin, "distance from the edge", "t [s]", "[mm]")
    return figure


def zmp() -> Figure:
    """The zero-moment point stays under the sole; alone that is not enough."""
    figure, (point, speed, error) = panels(3, gap=0.36)
    kept = (*WITHIN, EDGE, entry("zmp"))
    runs = {
        "without": run(0.3, constraints=WITHIN, **ALL),
        "zmp": run(0.3, constraints=kept, **ALL),
    }
    curves = {name: of(each, 1e3 * moment(each), end=0.1) for name, each in runs.items()}
    lines(point, curves, marker=".", markersize=3)
    limit(point, 36.5, "edge of the sole")
    label(point, "zero-moment point", "t [s]", "y [mm]")
    curves = {
        name: of(each, 1e3 * np.gradient(each.com()[:, 1], 1e-3)) for name, each in runs.items()
    }
    lines(speed, curves)
    label(speed, "speed of the centre of mass", "t [s]", "ẏ [mm/s]")
    fast = {"objective": qp12(0.0), "psi": {"form": "one", "u_max_rad_s": 1.2}}
    both = {"zmp alone": (*WITHIN, entry("zmp")), "and support_polygon": kept}
    runs = {name: run(1.0, to(0.01, 0.0, 0.2869), each, **fast) for name, each in both.items()}
    curves = {name: of(each, 1e3 * np.sqrt(2 * each["v"])) for name, each in runs.items()}
    lines(error, curves, rough=True, first=2)
    label(error, "a fast motion", "t [s]", "|e| [mm]")
    return figure


def moment(found: Run, height_m: float = 0.287) -> Array:
    """Where the cart-table's zero-moment point is, y [m]; at rest before the start."""
    y = found.com()[:, 1]
    speed = np.diff(y, prepend=y[0]) / 1e-3
    acceleration = np.diff(speed, append=speed[-1]) / 1e-3
    return np.asarray(y - height_m / 9.81 * acceleration)


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


def fixed_frame() -> Figure:
    """The other foot stays on the ground."""
    figure, (moved, first) = panels(2)
    kinds = {
        "without": (),
        "η = 0": (entry("fixed_frame", frame="l_sole", reference="r_sole", eta_per_s=0.0),),
        "η = 10/s": (entry("fixed_frame", frame="l_sole", reference="r_sole"),),
    }
    runs = {name: run(2.0, constraints=[*WITHIN, *kept], **ALL) for name, kept in kinds.items()}
    shift = {
        name: np.linalg.norm(foot - foot[0], axis=1)
        for name, foot in ((name, each.frame("l_sole", "r_sole")) for name, each in runs.items())
    }
    lines(moved, {name: of(runs[name], 1e3 * values) for name, values in shift.items()})
    label(moved, "left sole, moved", "t [s]", "[mm]")
    names = ("η = 0", "η = 10/s")
    lines(first, {name: of(runs[name], 1e6 * shift[name]) for name in names}, first=1)
    label(first, "the same, magnified", "t [s]", "[µm]")
    return figure


def half_space() -> Figure:
    """A plane that a point does not cross."""
    figure, (path, height) = panels(2)
    kept = entry(
        "half_space", frame="r_forearm", reference="pelvis", normal=[0, 0, -1], offset_m=-0.04
    )
    runs = {
        "without": run(3.0, BEHIND, WITHIN, **ALL),
        "half_space": run(3.0, BEHIND, [*WITHIN, kept], **ALL),
    }
    tracks = {name: 1e3 * each.frame("r_forearm") for name, each in runs.items()}
    lines(path, {name: thin(track[:, 0], track[:, 2]) for name, track in tracks.items()})
    limit(path, 40.0, "the plane")
    label(path, "forearm, from the side", "x [mm]", "z [mm]")
    lines(height, {name: of(runs[name], 40.0 - track[:, 2]) for name, track in tracks.items()})
    limit(height, 0.0)
    label(height, "margin", "t [s]", "[mm]")
    return figure


def minimum_speed() -> Figure:
    """One joint never rests."""
    figure, (speed, value) = panels(2)
    kept = entry("minimum_speed", speed=0.2, joints={"l_shoulder_pitch": -1.0})
    runs = {
        "without": run(2.0, BEHIND, WITHIN, **ALL),
        "minimum_speed": run(2.0, BEHIND, [*WITHIN, kept], **ALL),
    }
    arm = JOINTS.index("l_shoulder_pitch")
    lines(speed, {name: of(each, each.u[:, arm]) for name, each in runs.items()})
    speed.set_ylim(-0.3, 0.1)
    label(speed, "left shoulder", "t [s]", "u [rad/s]")
    lines(value, {name: of(each, each["v"] / each["v"][0]) for name, each in runs.items()})
    value.set_yscale("log")
    label(value, "V / V(0) of the right arm's task", "t [s]", "")
    return figure


def pfaffian() -> Figure:
    """Two joints move alike."""
    figure, axes = panels(2)
    row = [0.0] * len(JOINTS)
    row[JOINTS.index("r_knee")], row[JOINTS.index("l_knee")] = 1.0, -1.0
    for one, (title, kept) in zip(
        axes, {"without": (), "pfaffian": (entry("pfaffian", matrix=[row]),)}.items(), strict=True
    ):
        found = run(1.5, constraints=[*WITHIN, *kept], **ALL)
        knees = {name: of(found, found.u[:, JOINTS.index(name)]) for name in ("r_knee", "l_knee")}
        lines(one, knees)
        one.set_ylim(-0.12, 0.02)
        label(one, title, "t [s]", "u [rad/s]")
    return figure


def thin(x: Array, y: Array) -> tuple[Array, Array]:
    """So many points of a path at the most."""
    chosen = np.linspace(0, len(x) - 1, min(POINTS, len(x))).round().astype(int)
    return x[chosen], y[chosen]
