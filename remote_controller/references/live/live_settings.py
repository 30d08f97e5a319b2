"""Live targets as a config has them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from hoap3.protocol.config.settings import RobotName, Settings
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.references.live.live import Live, Turning, WhenStale
from hoap3.remote_controller.references.live.live_plan import Bounds
from hoap3.remote_controller.references.target import Target

Position = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0)]

PLACE = ("x", "y", "z")
QUATERNION = ("qx", "qy", "qz", "qw")


class SteeredSettings(Settings):
    """What every live target has."""

    name: RobotName = Field("target", description="by which senders call it")
    stale_after_s: Positive | None = Field(
        None, description="how long the last target counts [s]; null: for ever"
    )
    when_stale: WhenStale = Field(
        "hold", description="what then: hold, return to where the task began, or stop the robot"
    )

    @property
    def _stale(self) -> tuple[float, WhenStale]:
        after = self.stale_after_s
        return math.inf if after is None else after, self.when_stale


class LiveSettings(SteeredSettings):
    """Where somebody steers it while the robot moves; before that, where the robot is."""

    kind: Literal["live"]
    speed_m_s: Positive = Field(0.25, description="most along each axis [m/s]")
    acceleration_m_s2: Positive = Field(1.0, description="most along each axis [m/s²]")
    jerk_m_s3: Positive = Field(20.0, description="most along each axis [m/s³]")
    lower_m: Position | None = Field(None, description="least that is taken [m]; null: anything")
    upper_m: Position | None = Field(None, description="most that is taken [m]; null: anything")

    @model_validator(mode="after")
    def _takes_something(self) -> Self:
        lower, upper = self._range
        for i in np.flatnonzero(lower > upper)[:1]:
            raise ValueError(
                f"upper_m[{i}] should be no less than lower_m[{i}], {lower[i]:g}, and is "
                f"{upper[i]:g}"
            )
        return self

    def build(self, folder: Path) -> Target:
        """The target of a position; files are sought in `folder`."""
        del folder
        return Live(self.name, "m", self._bounds, *self._range, *self._stale, layout=PLACE)

    @property
    def _bounds(self) -> Bounds:
        return Bounds(self.speed_m_s, self.acceleration_m_s2, self.jerk_m_s3)

    @property
    def _range(self) -> tuple[FloatArray, FloatArray]:
        lower = np.full(3, -np.inf) if self.lower_m is None else np.array(self.lower_m)
        return lower, np.full(3, np.inf) if self.upper_m is None else np.array(self.upper_m)


class TurningSettings(SteeredSettings):
    """How fast an orientation is steered, and which are taken."""

    speed_rad_s: Positive = Field(0.5, description="most about each axis [rad/s]")
    acceleration_rad_s2: Positive = Field(2.0, description="most about each axis [rad/s²]")
    jerk_rad_s3: Positive = Field(40.0, description="most about each axis [rad/s³]")
    around_rad: Position | None = Field(
        None,
        description="axis × angle of the middle of the orientations that are taken [rad]; null: "
        "the one at the begin",
    )
    within_rad: float = Field(
        math.pi, gt=0, le=math.pi, description="angle from there within which they are; π: all"
    )

    @property
    def _turning(self) -> Turning:
        bounds = Bounds(self.speed_rad_s, self.acceleration_rad_s2, self.jerk_rad_s3)
        around = None if self.around_rad is None else np.array(self.around_rad)
        return Turning(bounds, around, self.within_rad)


class LiveOrientationSettings(TurningSettings):
    """How somebody turns it while the robot moves, by quaternions; before that, as it is."""

    kind: Literal["live"]

    def build(self) -> Target:
        """The target of an orientation."""
        none = np.zeros(0)
        return Live(
            self.name,
            "unit quaternion",
            (),
            none,
            none,
            *self._stale,
            turning=self._turning,
            layout=QUATERNION,
        )


class LivePoseSettings(LiveSettings, TurningSettings):
    """A pose that somebody steers, by positions and quaternions; before that, the robot's own.

    Beside `rotation_rad` of the task its position alone, and nothing here about turns counts.
    """

    def pose(self) -> Target:
        """The target of a pose."""
        return Live(
            self.name,
            "m, unit quaternion",
            self._bounds,
            *self._range,
            *self._stale,
            turning=self._turning,
            layout=(*PLACE, *QUATERNION),
        )


class LivePostureSettings(SteeredSettings):
    """A posture that somebody steers; before that, where the robot is."""

    kind: Literal["live"]
    speed_rad_s: Positive = Field(0.5, description="most of each joint [rad/s or m/s]")
    acceleration_rad_s2: Positive = Field(2.0, description="likewise [rad/s² or m/s²]")
    jerk_rad_s3: Positive = Field(40.0, description="likewise [rad/s³ or m/s³]")

    def build(
        self, lower: FloatArray, upper: FloatArray, names: Sequence[str], units: Sequence[str]
    ) -> Target:
        """The target, of joints with these limits, (m,), names and units."""
        unit = " or ".join(sorted(set(units), reverse=True))
        bounds = Bounds(self.speed_rad_s, self.acceleration_rad_s2, self.jerk_rad_s3)
        return Live(self.name, unit, bounds, lower, upper, *self._stale, layout=names)


class LiveWrenchSettings(SteeredSettings):
    """A wrench that somebody steers; before that, what the task wants by itself."""

    kind: Literal["live"]
    rate_n_s: Positive = Field(20.0, description="fastest change of each force [N/s]")
    second_n_s2: Positive = Field(200.0, description="most of its second derivative [N/s²]")
    third_n_s3: Positive = Field(10_000.0, description="most of its third derivative [N/s³]")
    rate_nm_s: Positive = Field(2.0, description="fastest change of each torque [N m/s]")
    second_nm_s2: Positive = Field(20.0, description="most of its second derivative [N m/s²]")
    third_nm_s3: Positive = Field(1000.0, description="most of its third derivative [N m/s³]")
    lower: tuple[float, ...] | None = Field(
        None,
        description="least that is taken along each direction [N, N m]; null: 0 along `normal`, "
        "else anything",
    )
    upper: tuple[float, ...] | None = Field(
        None, description="most that is taken along each direction [N, N m]; null: anything"
    )

    def build(self, torques: Sequence[bool], names: Sequence[str], least: float) -> Live:
        """The target.

        Args:
            torques: whether each direction is one of a torque, (k,).
            names: of the directions.
            least: what is taken where nothing is said.
        """
        force = Bounds(self.rate_n_s, self.second_n_s2, self.third_n_s3)
        torque = Bounds(self.rate_nm_s, self.second_nm_s2, self.third_nm_s3)
        k = len(torques)
        lower = np.full(k, least) if self.lower is None else np.array(self.lower)
        upper = np.full(k, np.inf) if self.upper is None else np.array(self.upper)
        bounds = [torque if each else force for each in torques]
        return Live(self.name, "N or N m", bounds, lower, upper, *self._stale, layout=names)
