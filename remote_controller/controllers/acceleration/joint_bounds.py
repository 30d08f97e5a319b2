"""Bounds of the accelerations that a controller may ask for, and their settings."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from hoap3.protocol.config.changeable import CHANGEABLE
from hoap3.protocol.config.settings import Settings
from hoap3.protocol.errors import BadProblemError, ConfigError
from hoap3.protocol.limits.viability_bounds import AccelerationBounds
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription

NO_BOUND = 1e30
Positive = Annotated[float, Field(gt=0)]


class BoundSettings(Settings):
    """Which bounds; the defaults are for a robot that does exactly what it is told."""

    kind: Literal["viability", "naive", "none"] = Field(
        "viability",
        description="viability keeps the limits; naive, (2), and none only compare: not certified",
    )
    horizon_periods: float = Field(
        2.0,
        ge=1,
        description="T_b/T: periods an acceleration may be held; at a wall 1 chatters, 2 rests",
    )
    acceleration_max: tuple[Positive, ...] = Field(
        (),
        description="of all joints, or of each [rad/s² or m/s²]; empty: the description's, what "
        "it brakes with",
    )
    acceleration_share: float = Field(
        1.0 - 1e-6, gt=0, le=1, description="of the greatest acceleration"
    )
    margin_rad: float = Field(
        1e-9, ge=0, description="distance from the ends of the usable range [rad or m]"
    )
    speed_share: float = Field(
        1.0 - 1e-9,
        gt=0,
        le=1,
        description="of the greatest speed",
        json_schema_extra=CHANGEABLE,
    )
    brake_share: float = Field(
        1.0, gt=0, le=1, description="of the acceleration that stopping in time counts on"
    )
    softness_rad: float = Field(
        0.0,
        ge=0,
        description="how far beyond the margin a joint is drawn back gently [rad or m]; 0 where it "
        "does exactly what it is told",
    )
    shrink: bool = Field(
        False, description="lower greatest accelerations that violate (11), instead of refusing"
    )


class JointBounds:
    """Least and greatest accelerations, of `viability_bounds.AccelerationBounds` or others.

    Args:
        description: of the robot.
        settings: which bounds.

    Attributes:
        lower, upper: of the last state, (n,) [rad/s² or m/s²]; ∓`NO_BOUND` with `none`.
        greatest: accelerations in use, (n,).
        least, most: ends of the ranges that are kept, (n,) [rad or m].

    Raises:
        ConfigError: limits and settings that do not go together, such as against condition (11).
    """

    def __init__(self, description: RobotDescription, settings: BoundSettings) -> None:
        n = description.n
        self._description, self._settings = description, settings
        given = settings.acceleration_max
        if len(given) not in {0, 1, n}:
            problem, remedy = f"has {len(given)} values", f"Give none, one, or {n}"
            raise ConfigError("", "bounds.acceleration_max", None, problem, remedy)
        most = np.minimum(description.brake_acceleration, description.setpoint_acceleration_max)
        self.greatest = np.array(given or most) * settings.acceleration_share * np.ones(n)
        self.lower, self.upper = np.full(n, -NO_BOUND), np.full(n, NO_BOUND)
        self.least, self.most = np.array(description.lower), np.array(description.upper)
        self.least += settings.margin_rad
        self.most -= settings.margin_rad
        self._bounds = self._usual = self._between(self.least, self.most)
        self.greatest = np.minimum(self._bounds.up, self._bounds.down)

    def apply(self, settings: BoundSettings) -> None:
        """Read the share of the greatest speed."""
        for bounds in (self._usual, self._bounds):
            bounds.limit_speed(self._description.velocity * settings.speed_share)

    def validate(self, settings: BoundSettings) -> None:
        """Refuse bounds that do not fit the robot, or that would shrink accelerations.

        Raises:
            ConfigError: it is so.
        """
        if (JointBounds(self._description, settings).greatest != self.greatest).any():
            problem, remedy = "shrinks the accelerations", "Take a greater share"
            key, value = "bounds.speed_share", settings.speed_share
            raise ConfigError("", key, value, problem, remedy)

    def begin(self, q: FloatArray) -> None:
        """A joint that is outside its range here, (n,), may stay, and not go further out."""
        self._bounds = self._usual
        outside = (q < self.least) | (q > self.most)
        if outside.any() and np.isfinite(q).all():
            self._bounds = self._between(np.minimum(self.least, q), np.maximum(self.most, q))

    def update(self, q: FloatArray, dq: FloatArray) -> None:
        """Take a state that is finite, (n,) both."""
        if self._settings.kind == "viability":
            self._bounds.solve(q, dq, self.lower, self.upper)
        elif self._settings.kind == "naive":
            self._bounds.solve_naive(q, dq, self.lower, self.upper)

    def _between(self, least: FloatArray, most: FloatArray) -> AccelerationBounds:
        robot, settings = self._description, self._settings
        try:
            return AccelerationBounds(
                least,
                most,
                robot.velocity * settings.speed_share,
                self.greatest,
                robot.period_s,
                horizon_s=robot.period_s * settings.horizon_periods,
                brake_share=settings.brake_share,
                softness=settings.softness_rad,
                shrink=settings.shrink,
                naive=settings.kind == "naive",
                names=robot.joint_names,
            )
        except BadProblemError as error:
            problem = str(error).rstrip(".")
            raise ConfigError("", "bounds", None, problem, "Change one of them") from error
