"""Settings of the controllers of several tasks by accelerations."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from hoap3.protocol.config.changeable import CHANGEABLE
from hoap3.remote_controller.constraints.registry import ConstraintSettings
from hoap3.remote_controller.controllers.acceleration.bounds import HierarchyBounds
from hoap3.remote_controller.controllers.acceleration.soles.settings import ContactSettings
from hoap3.remote_controller.controllers.base import Controller
from hoap3.remote_controller.tasks.accelerations.settings import AccelerationTask


class HierarchyParameters(Controller.Parameters):
    """Tasks and bounds of all of them."""

    tasks: tuple[AccelerationTask, ...] = Field(min_length=1, description="what shall be")
    constraints: tuple[ConstraintSettings, ...] = Field(
        (), description="what is kept beside the bounds, as rows of the accelerations"
    )
    bounds: HierarchyBounds = Field(HierarchyBounds(), description="of the motion")
    compensate_friction: bool = Field(
        True, description="count the viscous friction of the URDF among the torques"
    )
    base: Literal["fixed", "free"] = Field(
        "fixed", description="free: the robot may fall, and its soles stand on the ground"
    )
    contacts: ContactSettings = Field(ContactSettings(), description="of the soles of a free base")


class RegularisedParameters(HierarchyParameters):
    """And what damps the tasks."""

    w_r: float = Field(
        0.01,
        ge=1e-6,
        le=1e3,
        description="ω_r: weight of the regularisation; less is more exact, but livelier",
        json_schema_extra=CHANGEABLE,
    )
    null_damping_per_s: float = Field(
        10.0,
        ge=0,
        le=1e4,
        description="d: motion that no task speaks of brakes with −d·dq; 0: it goes on",
        json_schema_extra=CHANGEABLE,
    )
