"""A posture that a config names, or writes out."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from pydantic import model_validator

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription


class PostureValues(Settings):
    """Settings whose key `posture` takes joint values, too: they belong to `values_key`."""

    values_key: ClassVar[str] = "posture_rad"

    @model_validator(mode="before")
    @classmethod
    def _move_values(cls, content: Any) -> Any:
        match content:
            case {"posture": [*values]} if cls.values_key not in content:
                if {*map(type, values)} <= {int, float}:
                    return {**content, "posture": None, cls.values_key: values}
        return content


def posture_of(
    description: RobotDescription, name: str | None, values: tuple[float, ...], key: str
) -> FloatArray:
    """Joint positions, (n,): the values, or else the posture of that name, or where it starts.

    Args:
        description: of the robot.
        name, values: what the config says.
        key: where it stands, without the ending `_rad` of the values.

    Raises:
        ConfigError: no such posture, or too many values or too few.
    """
    if values:
        if len(values) != description.n:
            problem = f"has {len(values)} values"
            remedy = f"Give {description.n}, one for each joint"
            raise ConfigError("", f"{key}_rad", None, problem, remedy)
        return np.array(values)
    known = description.postures
    if name is not None and name not in known:
        remedy = f"Its postures: {', '.join(sorted(known))}"
        raise ConfigError("", key, name, "the robot has no such posture", remedy)
    return np.array(known[name or description.initial_posture])
