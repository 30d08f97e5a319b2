"""How far a task is from its target, in units that people use, and how far it may be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hoap3.protocol.config.changeable import CHANGEABLE
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.references.trajectories.tolerances import Violation

TOLERANCE_M = 1e-3
TOLERANCE_DEG = 0.5

JointToleranceDeg = Annotated[
    float,
    Field(
        gt=0,
        description="error of each revolute joint at the end that counts as reached [degrees]",
        json_schema_extra=CHANGEABLE,
    ),
]
JointToleranceM = Annotated[
    float,
    Field(
        gt=0,
        description="the same for prismatic joints [m]",
        json_schema_extra=CHANGEABLE,
    ),
]

ToleranceM = Annotated[
    float,
    Field(
        gt=0,
        description="error at the end that counts as reached [m]",
        json_schema_extra=CHANGEABLE,
    ),
]
ToleranceDeg = Annotated[
    float,
    Field(
        gt=0,
        description="error of the orientation at the end that counts as reached [degrees]",
        json_schema_extra=CHANGEABLE,
    ),
]

LOWER = "lower priority"
ABSENT = "takes no part"

SILENT = "reports no error"

ErrorUnit = Literal["m", "rad", "N", "N m", ""]
"""Of the error of a task, as its class declares it; "" for an error without a declared unit."""
DEFAULT_TOLERANCES: dict[ErrorUnit, float] = {
    "m": TOLERANCE_M,
    "rad": math.radians(TOLERANCE_DEG),
    "N": 0.5,
    "N m": 0.05,
    "": 1e-3,
}
"""By the unit of an error: the largest norm that counts as reached, by default."""

Unit = Literal["m", "deg", "N", "N m", ""]


@dataclass(frozen=True)
class TaskError:
    """One error of a task beside its tolerance.

    Attributes:
        error: size of the error, >= 0, in `unit`; NaN where it is not known.
        unit: m, deg, N or N m; "" where the task declares none.
        tolerance: greatest error that counts as reached, in the same unit.
        task: name of the task.
        note: why the error is not judged, such as "lower priority"; "" where it is judged.
        reason: which tolerance was violated on the way, in words; "" for none.
        default: whether `tolerance` is the default for an error without a unit.
    """

    error: float
    unit: Unit
    tolerance: float
    task: str = ""
    note: str = ""
    reason: str = ""
    default: bool = False

    @property
    def judged(self) -> bool:
        """Whether the verdict on the task counts it."""
        return not self.note

    @property
    def within(self) -> bool:
        """Whether the target is reached; False for NaN."""
        return self.error <= self.tolerance

    def as_json(self) -> dict[str, Any]:
        """The error as one JSON object; an error that is not finite is null."""
        return {
            "task": self.task,
            "error": self.error if math.isfinite(self.error) else None,
            "unit": self.unit,
            "tolerance": self.tolerance,
            "within": self.within,
            "judged": self.judged,
            "note": self.note,
            "reason": self.reason,
            "default_tolerance": self.default,
        }


def violated(violation: Violation) -> TaskError:
    """The error of a tolerance that was violated, though the task may be near its target now."""
    unit: Unit = "m" if violation.unit == "m" else "deg"
    scale = 1.0 if unit == "m" else math.degrees(1.0)
    error, tolerance = violation.error * scale, violation.tolerance * scale
    return TaskError(error, unit, tolerance, reason=str(violation))


def norm_error(
    error: FloatArray, unit: ErrorUnit = "", tolerance: float | None = None
) -> list[TaskError]:
    """Norm of an error (m,) of any task, with the tolerance of its unit where None is given."""
    default = tolerance is None and not unit
    most = DEFAULT_TOLERANCES[unit] if tolerance is None else tolerance
    size = float(np.linalg.norm(error))
    if unit == "rad":
        return [TaskError(math.degrees(size), "deg", math.degrees(most))]
    return [TaskError(size, unit, most, default=default)]


def name_errors(errors: Sequence[TaskError], name: str, note: str = "") -> list[TaskError]:
    """Errors of one task under its name; a term of a sum keeps its own name behind it.

    Args:
        errors: of the task; where there are none, that is listed as not judged.
        name: of the task.
        note: why they are not judged; "" where they are.
    """
    found = errors or [TaskError(math.nan, "", 0.0, note=SILENT)]
    return [
        replace(each, task=f"{name}: {each.task}" if each.task else name, note=each.note or note)
        for each in found
    ]


def length_error(error: FloatArray, tolerance_m: float) -> list[TaskError]:
    """Euclidean norm of an error in metres, (m,); empty for m = 0."""
    return [TaskError(float(np.linalg.norm(error)), "m", tolerance_m)] if len(error) else []


def angle_error(error: FloatArray, tolerance_deg: float) -> list[TaskError]:
    """Norm of a rotation vector in radians, (m,), in degrees; empty for m = 0."""
    if not len(error):
        return []
    return [TaskError(math.degrees(float(np.linalg.norm(error))), "deg", tolerance_deg)]


def joint_errors(
    error: FloatArray, prismatic: NDArray[np.bool_], tolerance_m: float, tolerance_deg: float
) -> list[TaskError]:
    """Greatest error of any revolute joint, and of any prismatic one.

    Args:
        error: of each joint, (m,) [rad or m].
        prismatic: which of these joints are prismatic, (m,).
        tolerance_m, tolerance_deg: of each joint.
    """
    found, sizes = [], np.abs(error)
    if not prismatic.all():
        angle = math.degrees(float(sizes[~prismatic].max()))
        found.append(TaskError(angle, "deg", tolerance_deg))
    if prismatic.any():
        found.append(TaskError(float(sizes[prismatic].max()), "m", tolerance_m))
    return found


def prismatic_joints(description: RobotDescription) -> NDArray[np.bool_]:
    """Which joints are prismatic, (n,), in wire order."""
    movable = description.structure.movable
    return np.array([movable[name].kind == "prismatic" for name in description.joint_names])
