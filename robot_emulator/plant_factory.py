"""The plant of a robot and the filter before it, for what its setpoints are."""

from __future__ import annotations

from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.filters.acceleration import (
    AccelerationFilter,
    FreeBaseFilter,
    TorqueFilter,
)
from hoap3.robot_emulator.filters.base import SetpointFilter
from hoap3.robot_emulator.filters.jerk import JerkFilter, limits_jerk
from hoap3.robot_emulator.filters.position import PositionFilter
from hoap3.robot_emulator.plants.base import Plant
from hoap3.robot_emulator.plants.registry import build_plant
from hoap3.robot_emulator.plants.rigid_body import RigidBody


def build_body(
    description: RobotDescription, config: EmulatorConfig
) -> tuple[Plant, SetpointFilter]:
    """The configured plant, and the filter of the first of the description's `command_kinds`.

    Raises:
        DescriptionError: the description lacks what the body needs.
        UsageError: there is no such plant, or its settings are wrong.
    """
    kind = description.command_kinds[0]
    plant: Plant = build_plant(description, config.plant, config.seed)
    if kind == "position":
        chosen = JerkFilter if limits_jerk(description) else PositionFilter
        return plant, chosen(description, description.period_s)
    if kind == "acceleration":
        return plant, AccelerationFilter(description, plant, config.hold_ticks)
    model = plant.torque_model or RigidBody.of_another(description, config.plant, plant)
    filter_of = FreeBaseFilter if plant.base.size else TorqueFilter
    return plant, filter_of(description, plant, config.hold_ticks, model)
