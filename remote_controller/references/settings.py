"""Targets as a config has them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.references.curves import Circle, Lemniscate, Plane
from hoap3.remote_controller.references.live.live_settings import (
    LivePoseSettings,
    LivePostureSettings,
    LiveSettings,
    Position,
    Positive,
)
from hoap3.remote_controller.references.spline import Spline
from hoap3.remote_controller.references.target import Approach, Hold, Point, Target
from hoap3.remote_controller.references.trajectories.motion_file import read_motion, read_text
from hoap3.remote_controller.references.trajectories.trajectory_settings import (
    AXES,
    TrajectorySettings,
    check_motion,
)
from hoap3.remote_controller.references.waypoints import Profile, Waypoints


class PointSettings(Settings):
    """A point that stays."""

    kind: Literal["point"] = "point"
    position_m: Position = Field(description="where it shall be [m]")
    approach_s: float = Field(0.0, ge=0, description="duration of the way there [s]; 0: at once")

    def build(self, folder: Path) -> Target:
        """The target; files are sought in `folder`."""
        del folder
        return Approach(Point(np.array(self.position_m)), self.approach_s)


class WaypointSettings(Settings):
    """Straight lines from where the robot is, at rest at each waypoint."""

    kind: Literal["waypoints"]
    points_m: tuple[Position, ...] = Field(min_length=1, description="in the order of visit [m]")
    times_s: tuple[Positive, ...] = Field((), description="arrival at each, since the start [s]")
    speed_m_s: Positive | None = Field(None, description="instead: highest speed of a segment")
    profile: Profile = Field("quintic", description="of the speed along a segment")

    @model_validator(mode="after")
    def _timed(self) -> Self:
        if bool(self.times_s) == (self.speed_m_s is not None):
            raise ValueError("should have either times_s or speed_m_s")
        if self.times_s and len(self.times_s) != len(self.points_m):
            raise ValueError(
                f"should have a time for each point: {len(self.times_s)} times_s, "
                f"{len(self.points_m)} points_m"
            )
        if any(b <= a for a, b in zip(self.times_s, self.times_s[1:], strict=False)):
            raise ValueError("should have increasing times_s")
        return self

    def build(self, folder: Path) -> Target:
        """The target; files are sought in `folder`."""
        del folder
        points = np.array(self.points_m)
        return Waypoints(points, self.times_s, self.speed_m_s or 0.0, self.profile)


class _MovingSettings(Settings):
    approach_s: float = Field(
        1.0, ge=0, description="from where the robot is to the moving target [s]; 0: at once"
    )


class _CurveSettings(_MovingSettings):
    center_m: Position = Field(description="of the curve, in the frame of the task [m]")
    plane: Plane = Field("xy", description="axes of the curve")
    period_s: float = Field(gt=0, description="of one round [s]")
    direction: Literal["forward", "backward"] = Field(
        "forward", description="forward: from the first axis of the plane to the second"
    )

    @property
    def _signed_period(self) -> float:
        return self.period_s if self.direction == "forward" else -self.period_s


class CircleSettings(_CurveSettings):
    """Round and round a circle."""

    kind: Literal["circle"]
    radius_m: float = Field(gt=0, description="of the circle [m]")
    start_rad: float = Field(0.0, description="angle from the plane's first axis at the start")

    def build(self, folder: Path) -> Target:
        """The target; files are sought in `folder`."""
        del folder
        curve = Circle(
            np.array(self.center_m), self.radius_m, self._signed_period, self.plane, self.start_rad
        )
        return Approach(curve, self.approach_s)


class LemniscateSettings(_CurveSettings):
    """An eight that lies along the first axis of the plane."""

    kind: Literal["lemniscate"]
    half_width_m: float = Field(gt=0, description="from the middle to each tip [m]")

    def build(self, folder: Path) -> Target:
        """The target; files are sought in `folder`."""
        del folder
        curve = Lemniscate(
            np.array(self.center_m), self.half_width_m, self._signed_period, self.plane
        )
        return Approach(curve, self.approach_s)


class SplineSettings(_MovingSettings):
    """A smooth curve through the rows of a CSV file with the columns t [s], x, y, z [m]."""

    kind: Literal["spline"]
    file: str = Field(
        min_length=1, description="CSV with columns t, x, y, z [s, m], sought beside the config"
    )
    repeat: bool = Field(False, strict=True, description="a closed curve, run again and again")

    def build(self, folder: Path) -> Target:
        """The target; files are sought in `folder`.

        Raises:
            ConfigError: naming the file, the line and the value.
        """
        path = folder / self.file
        motion = read_motion(read_text(path), str(path), AXES)
        check_motion(motion, str(path), "linear", AXES)
        first, last = motion.positions[0].tolist(), motion.positions[-1].tolist()
        if motion.velocities is not None:
            problem, remedy = "has velocities, which a spline does not take", "Leave them out"
            raise ConfigError(str(path), "line 1", None, problem, remedy)
        if self.repeat and first != last:
            remedy = f"End it at {first}, or set repeat: false"
            raise motion.refuse(-1, AXES[0], last, "ends elsewhere than it begins", remedy)
        curve = Spline(motion.times_s, motion.positions, repeats=self.repeat)
        return Approach(curve, self.approach_s)


TargetSettings = Annotated[
    PointSettings
    | WaypointSettings
    | CircleSettings
    | LemniscateSettings
    | SplineSettings
    | LiveSettings
    | TrajectorySettings,
    Field(discriminator="kind"),
]

PoseTarget = Annotated[
    PointSettings
    | WaypointSettings
    | CircleSettings
    | LemniscateSettings
    | SplineSettings
    | LivePoseSettings
    | TrajectorySettings,
    Field(discriminator="kind"),
]

PostureTarget = Annotated[TrajectorySettings | LivePostureSettings, Field(discriminator="kind")]


def target_of(settings: TargetSettings | PoseTarget | None, folder: Path) -> Target:
    """The target, (3,) [m], that settings ask for; none: where the robot is at the start.

    Args:
        settings: what is wanted.
        folder: where other files are sought.
    """
    return Hold(3) if settings is None else settings.build(folder)
