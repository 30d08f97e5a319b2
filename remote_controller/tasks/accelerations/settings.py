"""Tasks as controllers of accelerations and torques have them in a config."""

from __future__ import annotations

import math
import warnings
from typing import Any

from pydantic import Field, model_validator

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.errors import RenamedWarning
from hoap3.remote_controller.tasks.registry import LabelledTask

FORMER_KINDS = {
    "position": "frame_position",
    "pose": "frame_pose",
    "posture": "posture",
    "force": "wrench",
}
"""Tasks by what `kind` called them before 0.2, when their settings stood beside the gains."""


class Gains(Settings):
    """Of a wanted acceleration kp·error − kd·velocity."""

    kp: float = Field(10.0, gt=0, description="of the error [1/s²]")
    kd: float | None = Field(None, ge=0, description="[1/s]; null: 2√kp, critical damping")

    @property
    def both(self) -> tuple[float, float]:
        """Gains kp and kd."""
        return self.kp, 2.0 * math.sqrt(self.kp) if self.kd is None else self.kd


class AccelerationTask(LabelledTask, Gains):
    """A task that asks for an acceleration: ë = −kp·e − kd·ė."""

    @model_validator(mode="before")
    @classmethod
    def _take_former_form(cls, content: Any) -> Any:
        if not isinstance(content, dict) or content.get("kind") not in FORMER_KINDS:
            return content
        kind, own = content["kind"], {"name", "kp", "kd"}
        task = FORMER_KINDS[kind]
        today = f"`task: {task}` with its settings under `parameters`"
        warnings.warn(f"config: `kind: {kind}` is {today} now", RenamedWarning, stacklevel=1)
        kept = {key: content[key] for key in content if key in own}
        settings = {key: content[key] for key in content if key not in own and key != "kind"}
        goal = settings.pop("goal", None)
        if isinstance(goal, dict):
            settings |= goal
        if "position_m" in settings:
            place = settings.pop("position_m")
            settings["target"] = {"kind": "point", "position_m": place}
        if kind == "posture" and "posture_rad" in settings:
            settings["target_rad"] = settings.pop("posture_rad")
        return {**kept, "task": task, "parameters": settings}
