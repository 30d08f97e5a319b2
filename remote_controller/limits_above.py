"""Limits of a config that are above its robot's: a warning says which ones count instead."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from hoap3.protocol.errors import LimitWarning
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription

CUT = "the robot's counts"
HELD_BACK = "the robot does not brake so hard, and may hold it back"
OF_BOUNDS = {
    "speed_max": ("velocity", CUT),
    "speed_rad_s": ("velocity", CUT),
    "torque_max": ("effort", CUT),
    "acceleration_rad_s2": ("setpoint_acceleration_max", CUT),
    "acceleration_max": ("brake_acceleration", HELD_BACK),
}
OF_CONSTRAINTS = {
    "joint_velocity": {"limit_rad_s": "velocity", "joints_rad_s": "velocity"},
    "joint_acceleration": dict.fromkeys(
        ("limit_rad_s2", "joints_rad_s2"), "setpoint_acceleration_max"
    ),
    "joint_torque": {"limit_nm": "effort", "joints_nm": "effort"},
    "viability": {"limit_rad_s": "velocity", "limit_rad_s2": "setpoint_acceleration_max"},
}


def warn_of_limits_above(robot: RobotDescription, parameters: Any, file: str) -> None:
    """Warn of each limit of a controller, or of its constraints, that is above the robot's.

    One for all joints may be above the limits of some, as what leaves these as they are.

    Args:
        robot: that it controls.
        parameters: of the controller, with which it could be built.
        file: where they stand, under `parameters`.
    """
    from hoap3.remote_controller.constraints.registry import ConstraintSettings
    from hoap3.remote_controller.controllers.acceleration.joint_bounds import BoundSettings
    from hoap3.remote_controller.controllers.velocity.velocity_task_stack import (
        VelocityBounds,
    )

    bounds = getattr(parameters, "bounds", None)
    if not isinstance(bounds, BoundSettings | VelocityBounds):
        bounds = None  # somebody else's
    for key, (of_robot, instead) in OF_BOUNDS.items():
        given, own = getattr(bounds, key, None), np.array(getattr(robot, of_robot))
        if isinstance(given, tuple) and len(given) == 1:
            given = given[0]
        _warn(f"{file}: parameters.bounds.{key}", given, own, robot.joint_names, instead)
    entries = getattr(parameters, "constraints", None)
    for place, entry in enumerate(entries if isinstance(entries, tuple) else ()):
        if not isinstance(entry, ConstraintSettings):
            continue
        for key, of_robot in OF_CONSTRAINTS.get(entry.constraint, {}).items():
            where = f"{file}: parameters.constraints.{place}.parameters.{key}"
            own = np.array(getattr(robot, of_robot))
            _warn(where, entry.parameters.get(key), own, robot.joint_names, CUT)


def _warn(where: str, given: Any, own: FloatArray, names: tuple[str, ...], instead: str) -> None:
    if isinstance(given, int | float):
        if given > own.max():
            text = f"is above the limit of every joint, at most {own.max():.6g}"
            warnings.warn(f"{where}: {text} (found {given}): {instead}", LimitWarning, stacklevel=3)
        return
    for place, name, value in _of_joints(given, names):
        limit = own[names.index(name)]
        if value > limit:
            text = f"is above the limit of joint {name!r}, {limit:.6g}"
            text = f"{where}.{place}: {text} (found {value}): {instead}"
            warnings.warn(text, LimitWarning, stacklevel=3)


def _of_joints(given: Any, names: tuple[str, ...]) -> Iterator[tuple[int | str, str, float]]:
    """Key, joint and limit of each that is given for a single joint."""
    if isinstance(given, Mapping):
        yield from ((name, name, value) for name, value in given.items())
    elif given:
        yield from zip(range(len(names)), names, given, strict=True)
