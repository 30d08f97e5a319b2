"""`hoap3 trajectory check`: what a motion asks of a robot, before anything moves."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.references.trajectories.motion_file import (
    LONGEST_S,
    QUATERNION,
    Motion,
    are_columns,
    read_motion,
    read_text,
)
from hoap3.remote_controller.references.trajectories.trajectory import Degree, Trajectory, degree_of
from hoap3.remote_controller.references.trajectories.trajectory_settings import (
    AXES,
    check_motion,
)
from hoap3.robot_emulator.service import describe
from hoap3.tools.logs.motion_files import is_log, motion_of
from hoap3.tools.robots.trajectory_limits import limits_exceeded
from hoap3.tools.services.configs import load_emulator_config

RADIANS = "positions are read in rad (prismatic joints: m): multiply degrees by pi/180 = 0.0174533"
FAR_BEYOND = 1.5  # times a limit: perhaps degrees, also where angles are small
LONG_STEP_S = 5.0  # between rows: perhaps milliseconds


def look(
    file: str, robot: str, interpolation: Degree | None, scaling: float, approach_s: float
) -> dict[str, Any]:
    """What is found, as one JSON object; `exceeded` has what is beyond a limit.

    Args:
        file: CSV, log or folder of a run.
        robot: robot or emulator config: a name or a path.
        interpolation, scaling, approach_s: as in a trajectory's settings.

    Raises:
        UsageError: the file or the robot cannot be read.
    """
    description = describe(*load_emulator_config(robot, []))
    text = motion_of(Path(file)) if is_log(Path(file)) else read_text(Path(file))
    known = description.joint_names
    of_joints, is_either = are_columns(text, known), are_columns(text, (*AXES, *QUATERNION))
    names = known if of_joints else (*known, *AXES)
    motion = read_motion(text, file, names, turns=not of_joints)
    degree = interpolation or degree_of(motion)
    found: dict[str, Any] = {
        "file": file,
        "robot": description.name,
        "columns": list(motion.names),
        "points": len(motion.times_s),
        "duration_s": float(motion.times_s[-1]) * scaling,
        "interpolation": degree,
        "time_scaling": scaling,
        "hints": [],
    }
    if float(np.median(np.diff(motion.times_s))) >= LONG_STEP_S:
        found["hints"].append("times are read in seconds: divide milliseconds by 1000")
    if of_joints and is_either:
        found["hints"].append(f"{', '.join(motion.names)} are joints of the robot here, not axes")
    others = [name for name in motion.names if name not in known]
    in_space = len(others) == len(motion.names)
    check_motion(motion, file, degree, AXES if in_space else ())
    if in_space:
        return found | _of_points(motion, degree, scaling, description.period_s)
    if others:
        remedy = f"Joints are one motion; {', '.join((*AXES, *QUATERNION))} are another"
        raise ConfigError(file, "line 1", others[0], "stands beside joints", remedy)
    joints = [known.index(name) for name in motion.names]
    path = Trajectory(motion, degree, scaling, approach_s)
    path.start(description.initial_position[joints], 0.0)
    found |= limits_exceeded(path, motion, description, joints, scaling)
    if not path.times_s[1]:
        later = look(file, robot, degree, scaling, 1.0)
        found["fits_with_approach_s"] = later["fits_with_approach_s"]
    if any(
        each["what"] in {"position", "velocity"}
        and abs(each["value"]) > FAR_BEYOND * abs(each["limit"])
        for each in found["exceeded"]
    ):
        found["hints"].append(RADIANS)
    return found


def shown(found: dict[str, Any]) -> Iterator[str]:
    """The same for people, line by line."""
    what = f"{found['points']} points of {', '.join(found['columns'])}"
    yield f"{found['file']}: {what} in {found['duration_s']:g} s, {found['interpolation']}"
    if "ranges_m" in found:
        speed, bend = found["top_speed_m_s"], found["top_acceleration_m_s2"]
        yield f"greatest speed {speed:.4g} m/s, greatest acceleration {bend:.4g} m/s²"
        for axis, (least, most) in found["ranges_m"].items():
            yield f"{axis} from {least:.6g} m to {most:.6g} m"
        yield f"whether {found['robot']} reaches them is not looked at: run it with --lockstep"
        return
    for each in found["exceeded"]:
        where = "on the way to" if each["approach"] else "behind"
        more = f", and in {each['segments'] - 1} other segments" if each["segments"] > 1 else ""
        yield (
            f"{each['joint']}: {each['what']} {each['value']:.6g} {each['unit']} at "
            f"{each['time_s']:.6g} s, {where} line {each['line']}, limit {each['limit']:.6g}{more}"
        )
    yield from found["hints"]
    if not found["exceeded"]:
        yield f"no limit of {found['robot']} is exceeded"
        return
    fits, approach = found["fits_with_time_scaling"], found["fits_with_approach_s"]
    if fits is None:
        yield "no time scaling changes positions: correct them first"
    elif fits > found["time_scaling"]:
        yield f"it fits with time_scaling: {fits:g}"
    if approach > found["approach_s"]:
        yield f"the way to the first point fits with approach_s: {approach:g}"


def _of_points(motion: Motion, degree: Degree, scaling: float, period: float) -> dict[str, Any]:
    """Of a motion in space, at each period: how fast it is, and where.

    Raises:
        ConfigError: scaled it is so long that nobody waits for that.
    """
    if motion.times_s[-1] * scaling > LONGEST_S:
        problem = f"makes it longer than {LONGEST_S:g} s, and each period is looked at"
        raise ConfigError("--time-scaling", "", scaling, problem, "Give less")
    path = Trajectory(motion, degree, scaling)
    axes = [i for i, name in enumerate(motion.names) if name in AXES]
    (place, velocity), before = np.zeros((2, path.dimension)), None
    least, most, fastest, bend = np.full(3, np.inf), np.full(3, -np.inf), 0.0, 0.0
    for tick in range(math.ceil(path.rests_after_s / period) + 1):
        path.at(tick * period, place, velocity)
        moves = velocity[axes]
        least, most = np.minimum(least, place[axes]), np.maximum(most, place[axes])
        fastest = max(fastest, float(np.linalg.norm(moves)))
        if before is not None:
            bend = max(bend, float(np.linalg.norm(moves - before)) / period)
        before = moves
    ranges = zip((motion.names[i] for i in axes), least, most, strict=True)
    return {
        "exceeded": [],
        "top_speed_m_s": fastest,
        "top_acceleration_m_s2": bend,
        "ranges_m": {name: [float(low), float(high)] for name, low, high in ranges},
    }
