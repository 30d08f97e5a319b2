"""Robots that take accelerations or torques, with efforts that suffice for what they do."""

from __future__ import annotations

from hoap3.protocol.robot.description import CommandKind, RobotDescription
from hoap3.robot_emulator.robots import load
from support import arm3


def small(kind: CommandKind, gravity: str = "full", **changes: object) -> RobotDescription:
    """The arm of three joints."""
    return arm3.describe(command_kinds=(kind,), gravity=gravity, **changes)


def changed(robot: RobotDescription, **values: float | tuple[float, ...]) -> RobotDescription:
    """A robot whose joints have other figures: one for all, or one each."""
    joints = list(robot.joints)
    for name, value in values.items():
        each = value if isinstance(value, tuple) else (value,) * robot.n
        pairs = zip(joints, each, strict=True)
        joints = [joint.model_copy(update={name: figure}) for joint, figure in pairs]
    return robot.model_copy(update={"joints": tuple(joints)})


def strong(kind: CommandKind, gravity: str = "full", times: float = 4.0) -> RobotDescription:
    """Baxter's left arm with motors so much stronger: as it is, gravity may be too much for s1."""
    arm = load("baxter_left_arm")
    arm = changed(arm, effort=tuple(times * joint.effort for joint in arm.joints))
    return arm.model_copy(update={"command_kinds": (kind,), "gravity": gravity})
