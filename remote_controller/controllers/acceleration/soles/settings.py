"""How a config says that the base is free, and what that asks of the robot."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.robot.description import RobotDescription

WRENCH = 6  # numbers of State.contact for each sole


class ContactSettings(Settings):
    """How the soles of a free base stand on the ground."""

    friction: float = Field(
        0.5, gt=0, le=10, description="coefficient μ that the answer counts on, at every corner"
    )
    margin_m: float = Field(
        0.005, ge=0, description="by which the soles' outlines are drawn in [m]"
    )
    least_share: float = Field(
        0.01, ge=0, lt=0.5, description="of the weight, that every sole shall carry"
    )
    damping_per_s: float = Field(
        20.0, ge=0, description="a sole that moves is asked to accelerate by −damping·ν [1/s]"
    )
    loaded_share: float = Field(
        0.005, ge=0, lt=1, description="of the weight: a sole that carries less is in the air"
    )
    within_support: bool = Field(
        True, description="the centre of mass asks for what soles give without the trunk's help"
    )
    lost_after_s: float = Field(
        0.01, ge=0, description="how long a sole carries less before it counts as in the air [s]"
    )


def check_base(robot: RobotDescription, parameters: Any, *, able: bool) -> None:
    """Refuse a controller and a robot of which one has a free base and the other has not.

    Args:
        robot: its description.
        parameters: of the controller: `base`, `constraints`.
        able: whether such a controller can stand on soles.

    Raises:
        ConfigError: with the remedy.
    """
    free, name = parameters.base == "free", f"robot {robot.name!r}"
    published, felt = (robot.state_arrays.get(key, 0) for key in ("base", "contact"))
    others = "Take ghc, hqp, weighted or tsid"
    if published and not free:
        remedy = "Set parameters.base to free" if able else others
        raise ConfigError("", "base", "fixed", f"{name} has a base that moves", remedy)
    if not free:
        return
    if not able:
        raise ConfigError("", "base", "free", "this controller has no contacts", others)
    if parameters.constraints:
        problem, remedy = "are for a base that stands", "Leave them out with a free base"
        raise ConfigError("", "constraints", None, problem, remedy)
    if not published:
        problem = f"{name} publishes no base"
        remedy = "Set parameters.base to fixed, or give the robot a plant with a free base"
        raise ConfigError("", "base", "free", problem, remedy)
    if not robot.soles:
        problem, remedy = f"{name} has no soles to stand on", "Add soles to its description"
        raise ConfigError("", "base", "free", problem, remedy)
    if felt not in {0, WRENCH * len(robot.soles)}:
        problem = f"{name} publishes {felt // WRENCH} contacts, and has {len(robot.soles)} soles"
        remedy = "Have it publish the contact of each sole, in their order, or none"
        raise ConfigError("", "base", "free", problem, remedy)
