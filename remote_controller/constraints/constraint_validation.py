"""Whether a constraint gives numbers of the right shape, tried before a robot depends on it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hoap3.protocol.config.plugins import blame
from hoap3.protocol.errors import ConfigError, Hoap3Error
from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.constraints.constraint import Constraint, Level
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.model.motion import Motion

Refuse = Callable[[str, str], ConfigError]


def check_first_update(
    constraint: Constraint,
    description: RobotDescription,
    kinematics: Kinematics,
    file: str,
    key: str,
    name: str,
    level: Level = "velocity",
) -> None:
    """Ask a constraint for bounds and rows in the initial posture, at rest, and look at them.

    Args:
        constraint: to be checked; it has been updated once afterwards, so give one to spare.
        description, kinematics: of the robot; `kinematics` is left in the initial posture.
        file, key, name: where the config names the constraint, and how, for the error.
        level: whether rows and bounds are those of velocities or of accelerations.

    Raises:
        ConfigError: it raised an error; rows, bounds or margins are NaN, infinite where they must
            not be, or of the wrong shape; or its bounds are empty.
    """

    def refuse(problem: str, remedy: str) -> ConfigError:
        return ConfigError(file, key, name, f"{problem} in the initial posture", remedy)

    n, rows = description.n, constraint.rows
    if len(constraint.names) != rows:
        remedy = "Give each row a name, in __init__"
        raise refuse(f"rows is {rows}, but names has {len(constraint.names)} entries", remedy)
    state = State.allocate(**description.state_lengths)
    state.q[:] = state.reference[:] = description.initial_position
    kinematics.update(state.q)
    A, b = np.zeros((rows, n)), np.full(rows, 0.0 if constraint.equality else np.inf)
    below = b.copy() if constraint.equality else np.full(rows, -np.inf)
    lower, upper = np.full(n, -np.inf), np.full(n, np.inf)
    try:
        constraint.reset()
        if level == "velocity":
            constraint.bounds(state, lower, upper)
            constraint.update(kinematics, state, A, b)
        else:
            brake = np.minimum(
                description.brake_acceleration, description.setpoint_acceleration_max
            )
            constraint.prepare_accelerations(np.array(description.velocity), brake)
            constraint.bound_accelerations(state, lower, upper)
            motion = Motion(description, kinematics)
            motion.update(state.q, state.dq)
            constraint.update_accelerations(motion, state, A, below, b)
            if constraint.guarantee == "conditional":
                constraint.margins_at(kinematics, np.zeros(constraint.margins.size))
    except Hoap3Error:
        raise
    except Exception as error:
        problem = f"cannot be updated: {blame(error, type(constraint))}"
        raise refuse(problem, f"A_out is ({rows}, {n}), b_out ({rows},)") from error
    for row, label in enumerate(constraint.names):
        if not np.isfinite(A[row]).all():
            worst = int(np.flatnonzero(~np.isfinite(A[row]))[0])
            where = f"A_out[{row}, {worst}] ({label}, {description.joint_names[worst]})"
            raise refuse(f"{where} is {A[row, worst]}", "Make it a finite number everywhere")
        if np.isnan(b[row]) or b[row] == -np.inf or (constraint.equality and b[row] == np.inf):
            remedy = "Make it a finite number everywhere; a row that is off has 0 in A_out"
            raise refuse(f"b_out[{row}] ({label}) is {b[row]}", remedy)
        if level == "acceleration" and not below[row] <= b[row]:
            problem = f"lower_out[{row}] ({label}) is {below[row]}, upper_out[{row}] {b[row]}"
            raise refuse(problem, "Write an interval, or equal ends for an equation")
    _check_bounds(lower, upper, description, refuse)
    _check_margins(constraint, refuse)


def _check_bounds(
    lower: FloatArray, upper: FloatArray, description: RobotDescription, refuse: Refuse
) -> None:
    for place, joint in enumerate(description.joint_names):
        least, most = lower[place], upper[place]
        if not (least <= most and least < np.inf and most > -np.inf):  # NaN is no bound either
            remedy = "Narrow what is there, and leave at least one value"
            raise refuse(f"bounds of {joint} are {least} and {most}", remedy)


def _check_margins(constraint: Constraint, refuse: Refuse) -> None:
    margins, names = np.asarray(constraint.margins), constraint.margin_names
    if margins.shape != (len(names),):
        remedy = "Make it one margin for each name"
        raise refuse(f"margins has shape {margins.shape}, margin_names {len(names)}", remedy)
    for margin, label in zip(margins, names, strict=True):
        if np.isnan(margin):
            remedy = "Make it a number everywhere; inf where it is switched off"
            raise refuse(f"the margin of {label} is nan", remedy)
