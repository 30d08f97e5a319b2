"""Robots that take accelerations or torques, with efforts that suffice for what they do."""

from __future__ import annotations

from hoap3.protocol.description import CommandKind, RobotDescription
from hoap3.robot_emulator.robots import load
from support import arm3


def small(kind: CommandKind, gravity: str = "full", **changes: object) -> RobotDescription:
    """The arm of three joints."""
    return arm3.describe(command_kinds=(kind,), gravity=gravity, **changes)


def strong(kind: CommandKind, gravity: str = "full", times: float = 4.0) -> RobotDescription:
    """Baxter's left arm with motors so much stronger: as it is, gravity may be too much for s1."""
    arm = load("baxter_left_arm")
    joints = tuple(
        joint.model_copy(update={"effort": times * joint.effort}) for joint in arm.joints
    )
    return arm.model_copy(update={"joints": joints, "command_kinds": (kind,), "gravity": gravity})
