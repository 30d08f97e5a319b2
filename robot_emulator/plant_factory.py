"""The plant of a robot and the filter before it, for what its setpoints are."""

from __future__ import annotations

from hoap3.protocol.description import RobotDescription
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.filters.acceleration import AccelerationFilter, TorqueFilter
from hoap3.robot_emulator.filters.base import SetpointFilter
from hoap3.robot_emulator.filters.position import PositionFilter
from hoap3.robot_emulator.plants.acceleration_servo import AccelerationServo
from hoap3.robot_emulator.plants.position_servo import Plant, PositionServo
from hoap3.robot_emulator.plants.rigid_body import RigidBody


def build_body(
    description: RobotDescription, config: EmulatorConfig
) -> tuple[Plant, SetpointFilter]:
    """What the first of the description's `command_kinds` needs.

    Raises:
        DescriptionError: the description lacks what the body needs.
    """
    kind = description.command_kinds[0]
    if kind == "position":
        servo = PositionServo(description, config.plant)
        return servo, PositionFilter(description, description.period_s)
    if kind == "acceleration":
        joints = AccelerationServo(description)
        return joints, AccelerationFilter(description, joints, config.hold_ticks)
    body = RigidBody(description, config.plant)
    return body, TorqueFilter(description, body, config.hold_ticks)
