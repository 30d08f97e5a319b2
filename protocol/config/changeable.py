"""Markers of settings that may change while a controller runs, and what they stand for unset."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pydantic.fields import FieldInfo

CHANGEABLE: dict[str, Any] = {"changeable": True}
"""`Field(…, json_schema_extra=CHANGEABLE)` declares that a number may change in a live change."""


@dataclass(frozen=True)
class Unset:
    """What a changeable field stands for while it is null or empty: `Annotated[…, Unset(…)]`.

    Attributes:
        value: of the settings that have the field, and the robot's description.
        follows: formula of another number of these settings that it follows; such a field cannot
            change to null, since the other one may be moving.
    """

    value: Callable[[Any, Any], float]
    follows: str = ""


UNIT_WEIGHT = Unset(lambda _settings, _robot: 1.0)
GREATEST_SPEED = Unset(lambda _settings, robot: float(robot.velocity.max()))
CRITICAL_DAMPING = Unset(lambda settings, _robot: 2.0 * math.sqrt(settings.kp), "2√kp")


def is_changeable(field: FieldInfo) -> bool:
    """Whether a field may change."""
    extra = field.json_schema_extra
    return isinstance(extra, dict) and extra.get("changeable") is True


def unset_of(field: FieldInfo) -> Unset | None:
    """The marker of what a field stands for while it is unset; None where nothing stands for it."""
    return next((each for each in field.metadata if isinstance(each, Unset)), None)
