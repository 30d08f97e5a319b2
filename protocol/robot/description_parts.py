"""The pieces of a robot description: joints, soles, default task, each checked for itself."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Annotated, ClassVar, NoReturn, Self

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ModelWrapValidatorHandler,
    PlainSerializer,
    StrictStr,
    ValidationError,
    model_validator,
)

from hoap3.protocol.errors import DescriptionError, did_you_mean

FAR_M = 1e6  # of a corner of a sole
MAX_CORNERS = 64

LEAST, MOST = 1e-9, 1e12  # of limits, in SI units; beyond them kernels overflow or never end
Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-MOST, le=MOST)]


def _or_infinite(sign: float) -> Callable[[object], object]:
    return lambda given: sign * math.inf if given is None else given


def _or_null(limit: float) -> float | None:
    return limit if math.isfinite(limit) else None


_IN_JSON = PlainSerializer(_or_null, when_used="json")  # which has no infinity
Least = Annotated[float, Field(strict=True), BeforeValidator(_or_infinite(-1.0)), _IN_JSON]
Greatest = Annotated[float, Field(strict=True), BeforeValidator(_or_infinite(1.0)), _IN_JSON]
"""Limits: null in JSON, and −inf or +inf here, where there is none."""

_JOINT_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_./-]{0,63}")


class Part(BaseModel):
    """A piece of a description: whatever is wrong with it is a `DescriptionError` that names it."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    kind: ClassVar[str]
    label: ClassVar[str]

    def check(self) -> None:
        """Raise `DescriptionError` where the fields do not agree with each other."""

    @model_validator(mode="wrap")
    @classmethod
    def _validated(cls, data: object, build: ModelWrapValidatorHandler[Self]) -> Self:
        found = data.get(cls.label) if isinstance(data, Mapping) else getattr(data, cls.label, None)
        who = f"{cls.kind} {found!r:.60}" if isinstance(found, str) else f"a {cls.kind}"
        try:
            part = build(data)
            part.check()
        except ValidationError as error:
            raise DescriptionError(f"{who}: {cls._explain(error)}") from error
        except DescriptionError as error:
            raise DescriptionError(f"{who}: {error}") from error
        return part

    @classmethod
    def _explain(cls, error: ValidationError) -> str:
        finding = error.errors(include_url=False, include_context=False)[0]
        key = ".".join(str(place)[:60] for place in finding["loc"]) or cls.kind
        if finding["type"] == "missing":
            return f"{key} is missing. Add it."
        if finding["type"] == "extra_forbidden":
            return f"unknown key {key!r}. {did_you_mean(key, cls.model_fields, 'Remove it.')}"
        remedy = finding["msg"].removeprefix("Input ")
        return f"{key} cannot be {finding['input']!r:.60}. It {remedy}."


class Joint(Part):
    """One movable joint; for a prismatic one read m for rad, and N for N m.

    Attributes:
        lower_hard, upper_hard: mechanical stops [rad]; -inf and inf, in JSON null, of a joint that
            turns without end.
        lower, upper: usable range, inside the stops [rad]; likewise.
        velocity: greatest speed [rad/s].
        setpoint_acceleration_max: greatest acceleration of the commanded motion [rad/s²].
        brake_acceleration: deceleration to count on in a stop [rad/s²].
        setpoint_jerk_max: greatest jerk of commanded positions [rad/s³]; inf, in JSON null or not
            there, where there is no limit.
        effort, effort_average: peak torque, and torque that can be held [N m]; a peak of inf, in
            JSON null, where nobody knows it.
        encoder_counts_per_rad: signed scale of the encoder, None if the robot speaks rad only.
        armature: inertia of the rotor as the joint feels it, gear ratio squared [kg m²; prismatic
            kg].
    """

    kind: ClassVar[str] = "joint"
    label: ClassVar[str] = "name"

    name: StrictStr
    lower_hard: Least
    upper_hard: Greatest
    lower: Least
    upper: Greatest
    velocity: Number
    setpoint_acceleration_max: Number
    brake_acceleration: Number
    effort: Greatest
    effort_average: Number | None = None
    encoder_counts_per_rad: Number | None = None
    armature: Number = 0.0
    setpoint_jerk_max: Greatest = math.inf

    def check(self) -> None:
        """Refuse limits that contradict each other."""
        if not _JOINT_NAME.fullmatch(self.name):
            refuse("name", self.name, "Use letters, digits and _ . / - only, at most 64.")
        for key in ("lower_hard", "upper_hard", "lower", "upper"):
            limit, none = getattr(self, key), -math.inf if key.startswith("lower") else math.inf
            if not (abs(limit) <= MOST or limit == none):
                remedy = f"Write a finite number up to {MOST:g}, or null where there is no limit."
                refuse(key, limit, remedy)
        if not self.lower < self.upper:
            refuse("lower", self.lower, f"It must be less than upper, {self.upper}.")
        if self.lower < self.lower_hard:
            refuse("lower", self.lower, f"It must not be below lower_hard, {self.lower_hard}.")
        if self.upper > self.upper_hard:
            refuse("upper", self.upper, f"It must not be above upper_hard, {self.upper_hard}.")
        for key in (
            "velocity",
            "setpoint_acceleration_max",
            "brake_acceleration",
            "effort",
            "setpoint_jerk_max",
        ):
            if not LEAST <= getattr(self, key) <= MOST and getattr(self, key) != math.inf:
                remedy = f"Write a positive number between {LEAST:g} and {MOST:g}."
                refuse(key, getattr(self, key), remedy)
        if self.effort_average is not None and not 0.0 < self.effort_average <= self.effort:
            refuse("effort_average", self.effort_average, f"Stay between 0 and {self.effort}.")
        if self.encoder_counts_per_rad == 0.0:
            refuse("encoder_counts_per_rad", 0.0, "Write the signed scale, or leave it out.")
        if self.encoder_counts_per_rad and math.isinf(self.upper_hard - self.lower_hard):
            remedy = "Leave it out, or give the joint limits: counts have 16 bits, and do not wrap."
            refuse("encoder_counts_per_rad", self.encoder_counts_per_rad, remedy)
        if self.armature < 0.0:
            refuse("armature", self.armature, "Write 0 or more.")


class Sole(Part):
    """A flat sole: ``frame`` lies in it, z up; ``polygon`` is its outline there, (x, y) [m]."""

    kind: ClassVar[str] = "sole"
    label: ClassVar[str] = "frame"

    frame: StrictStr
    polygon: tuple[tuple[Number, Number], ...]

    def check(self) -> None:
        """Refuse an outline that is not convex and counter-clockwise.

        Every corner must lie to the left of every edge, or on it.
        """
        corners = np.array(self.polygon, dtype=np.float64).reshape(-1, 2)
        if not 3 <= len(corners) <= MAX_CORNERS:
            refuse("polygon", f"{len(corners)} corners", f"Give 3 to {MAX_CORNERS}.")
        if not np.abs(corners).max() <= FAR_M:
            refuse("polygon", self.polygon, f"Give corners within {FAR_M:g} m.")
        edges = np.roll(corners, -1, axis=0) - corners
        corners_from = corners[None, :, :] - corners[:, None, :]
        left = edges[:, None, 0] * corners_from[:, :, 1] - edges[:, None, 1] * corners_from[:, :, 0]
        slack = 1e-12 * float(np.ptp(corners, axis=0).max()) ** 2  # of corners in one line
        if not ((left >= -slack).all() and (left > slack).any()):
            refuse("polygon", self.polygon, "Go round a convex outline counter-clockwise.")


class DefaultTask(Part):
    """What controllers do whose config names no task: bring a point of the robot to a target.

    Attributes:
        point: a link, for its origin, or `com`, the centre of mass.
        reference: the link that the point is seen from.
        target_m: (x, y, z) where the point shall be, in the reference's axes [m]; or instead
        move_m: (x, y, z) how far from where it is in the initial posture [m].
    """

    kind: ClassVar[str] = "default task"
    label: ClassVar[str] = "point"

    point: StrictStr
    reference: StrictStr
    target_m: tuple[Number, Number, Number] | None = None
    move_m: tuple[Number, Number, Number] | None = None

    def check(self) -> None:
        """Refuse two targets, or none."""
        if (self.target_m is None) == (self.move_m is None):
            found = [key for key in ("target_m", "move_m") if getattr(self, key) is not None]
            refuse("target", found, "Write either target_m or move_m.")


def refuse(key: str, value: object, remedy: str) -> NoReturn:
    """Raise `DescriptionError` over one value."""
    raise DescriptionError(f"{key} cannot be {value!r:.60}. {remedy}")
