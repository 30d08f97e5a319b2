"""Trajectories as a config has them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.references.target import Target
from hoap3.remote_controller.references.trajectories.motion_file import (
    Motion,
    read_motion,
    read_text,
)
from hoap3.remote_controller.references.trajectories.tolerances import Tolerances, each_of
from hoap3.remote_controller.references.trajectories.trajectory import Degree, Trajectory, degree_of

AXES = ("x", "y", "z")
TURNS = ("rx", "ry", "rz")
LOG_SUFFIX = ".mcap"
Tolerance = Annotated[float, Field(gt=0)]
EachTolerance = Tolerance | Annotated[dict[str, Tolerance], Field(min_length=1)]


def check_motion(motion: Motion, file: str, degree: Degree, needed: Sequence[str]) -> None:
    """Refuse a motion that has not all it needs, or does not end at rest.

    Args:
        motion: that was read.
        file: where it stands, for errors.
        degree: of its interpolation.
        needed: columns that must be there.

    Raises:
        ConfigError: naming the line and the column.
    """
    for name in needed:
        if name not in motion.names:
            raise ConfigError(file, "line 1", name, "column is missing", f"Add {name}")
    if degree == "linear" or motion.velocities is None:
        return
    for i in np.flatnonzero(np.nan_to_num(motion.velocities[-1]))[:1]:
        name, speed = f"{motion.names[i]}/velocity", float(motion.velocities[-1, i])
        remedy = "End with velocity 0: it stays at the last point"
        raise motion.refuse(-1, name, speed, "does not end at rest", remedy)


class TrajectorySettings(Settings):
    """A motion through the points of a CSV file at their times, or that of a log."""

    kind: Literal["trajectory"]
    file: str = Field(
        "",
        description="CSV with t [s] and a column for each joint, or x, y, z [m]; or a log, whose "
        "motion is played back; sought beside the config",
    )
    csv: str = Field("", description="the content of that file, which is not read then")
    interpolation: Degree | None = Field(
        None,
        description="of the points; null: linear, with velocities cubic, with accelerations, too, "
        "quintic",
    )
    time_scaling: float = Field(
        1.0, gt=0, le=1e6, description="times are multiplied by it: 2 is half as fast"
    )
    approach_s: float = Field(
        1.0,
        ge=0,
        description="from where the robot is to the first point, where that one's time is 0 [s]; "
        "0: at once",
    )
    path_tolerance: EachTolerance | None = Field(
        None,
        description="greatest error on the way, of each joint or axis, or by its name [rad or m]; "
        "null: any",
    )
    goal_tolerance: EachTolerance | None = Field(None, description="the same at the end; null: any")
    goal_time_s: float = Field(
        0.0, ge=0, description="how much later than the end the goal may be reached [s]"
    )
    if_violated: Literal["hold", "continue"] = Field(
        "hold", description="a tolerance: stay where the robot is, or go on"
    )
    played: Literal["measured", "applied"] = Field(
        "measured", description="of a log: the joints as they were, or the robot's reference"
    )
    played_every_s: float = Field(
        0.01, gt=0, description="of a log: time between the points that are taken [s]"
    )

    @model_validator(mode="after")
    def _somewhere(self) -> Self:
        if not self.file and not self.csv:
            raise ValueError("should have a file, or its content as csv")
        return self

    @property
    def watched(self) -> bool:
        """Whether there are tolerances."""
        return self.path_tolerance is not None or self.goal_tolerance is not None

    def build(self, folder: Path) -> Target:
        """The target of a position, (3,) [m]; files are sought in `folder`."""
        return self._through(self.motion(folder, AXES, needed=AXES))

    def pose(self, folder: Path) -> Target:
        """The target of a position, (3,), or with a quaternion of a pose, (6,) [m, rad]."""
        return self._through(self.motion(folder, AXES, turns=True, needed=AXES))

    def posture(self, folder: Path, description: RobotDescription, joints: list[int]) -> Target:
        """The target of joints, (m,) [rad or m]; those without a column stay where they are.

        Args:
            folder: where files are sought.
            description: of the robot.
            joints: places of the task's joints in wire order.

        Raises:
            ConfigError: also where a point is out of a joint's range, or a segment is a jump: even
                its mean speed is above the joint's limit, so that no interpolation keeps it.
        """
        names = [description.joint_names[i] for i in joints]
        motion = self.motion(folder, names)
        place = [names.index(name) for name in motion.names]
        self._check_limits(motion, description, [joints[i] for i in place])
        return self._through(motion, place, len(joints))

    def motion(
        self, folder: Path, known: Sequence[str], needed: Sequence[str] = (), *, turns: bool = False
    ) -> Motion:
        """What the file says; arguments as for `read_motion`, and columns that must be there."""
        path = folder / self.file
        label = str(path) if self.file else "csv"
        if not self.csv and (path.suffix == LOG_SUFFIX or path.is_dir()):
            remedy = "Write its motion into a CSV first: hoap3 trajectory from LOG --out FILE"
            raise ConfigError(label, "", None, "is a log, which is not read here", remedy)
        motion = read_motion(self.csv or read_text(path), label, known, turns=turns)
        check_motion(motion, label, self.interpolation or degree_of(motion), needed)
        return motion

    def tolerances(
        self, target: Target, names: Sequence[str], units: Sequence[str]
    ) -> Tolerances | None:
        """What watches the errors of a task; None where nothing does.

        Args:
            target: that was built of this.
            names, units: of the components of the task's error, (m,).
        """
        path = each_of(self.path_tolerance, names, "path_tolerance")
        goal = each_of(self.goal_tolerance, names, "goal_tolerance")
        if not self.watched:
            return None
        holds = self.if_violated == "hold"
        end = target.rests_after_s
        return Tolerances(names, units, path, goal, self.goal_time_s, end, holds=holds)

    def _through(
        self, motion: Motion, place: list[int] | None = None, dimension: int | None = None
    ) -> Target:
        degree = self.interpolation or degree_of(motion)
        return Trajectory(motion, degree, self.time_scaling, self.approach_s, place, dimension)

    def _check_limits(
        self, motion: Motion, description: RobotDescription, joints: list[int]
    ) -> None:
        lower, upper = description.lower[joints], description.upper[joints]
        outside = (motion.positions < lower) | (motion.positions > upper)
        for row, i in np.argwhere(outside)[:1]:
            value = float(motion.positions[row, i])
            problem = "is outside the joint's range"
            unit = description.joint_units[joints[i]]
            degrees = "" if unit == "m" else "; multiply degrees by pi/180"
            remedy = f"Keep to {lower[i]} … {upper[i]} {unit}{degrees}"
            raise motion.refuse(row, motion.names[i], value, problem, remedy)
        speeds, most = mean_speeds(motion, self.time_scaling), description.velocity[joints]
        for row, i in np.argwhere(speeds > most)[:1]:
            problem = (
                f"is a jump: {speeds[row, i]:.6g} per s on the mean since the line before, and the "
                f"joint's limit is {most[i]:.6g}"
            )
            least = float((speeds / most).max()) * self.time_scaling
            remedy = f"Set time_scaling to at least {least:.4g}, or correct the row"
            value = float(motion.positions[row + 1, i])
            raise motion.refuse(row + 1, motion.names[i], value, problem, remedy)


def mean_speeds(motion: Motion, scaling: float) -> FloatArray:
    """Of each segment between points, (k − 1, m) [1/s]."""
    widths = np.diff(motion.times_s)[:, None] * scaling
    return np.asarray(np.abs(np.diff(motion.positions, axis=0)) / widths, float)


def tolerances_of(
    settings: object, target: Target, names: Sequence[str], units: Sequence[str] | str
) -> Tolerances | None:
    """As `TrajectorySettings.tolerances`; None for any other settings of a target."""
    if not isinstance(settings, TrajectorySettings):
        return None
    each = [units] * len(names) if isinstance(units, str) else units
    return settings.tolerances(target, names, each)
