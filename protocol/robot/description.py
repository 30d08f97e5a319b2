"""What a robot tells about itself: URDF, joints and their limits, postures, frames, period.

It travels as canonical JSON, of which `RobotDescription.digest` is the fingerprint. Nothing from
the wire is trusted: whatever does not hold together raises `DescriptionError`, which names the
robot, the joint, the value and the remedy. Figures are in SI units.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from operator import attrgetter
from typing import Any, ClassVar, Literal, Self

import numpy as np
import pydantic_core
from numpy.typing import NDArray
from pydantic import StrictFloat, StrictInt, StrictStr

from hoap3.protocol.errors import DescriptionError, did_you_mean, one_of
from hoap3.protocol.robot.description_parts import DefaultTask, Joint, Number, Part, Sole, refuse
from hoap3.protocol.robot.urdf import UrdfJoint, UrdfStructure, first_twice, read_urdf

__all__ = [
    "COM", "CommandKind", "DeadlineRule", "DefaultTask", "Gravity", "Joint", "RobotDescription",
    "Sole",
]  # fmt: skip

MAX_BYTES = 1 << 20
MAX_JOINTS = 128
MAX_DELAY_TICKS = 100
COM = "com"  # the centre of mass, as the point of a task

Vector = NDArray[np.float64]
CommandKind = Literal["position", "acceleration", "torque"]
Gravity = Literal["full", "compensated", "none"]
DeadlineRule = Literal["next_tick", "after_receipt"]

_ROBOT_NAME = re.compile(r"[a-z][a-z0-9_]{0,31}")


def _read_only(values: Iterable[float]) -> Vector:
    array = np.fromiter(values, dtype=np.float64)
    array.setflags(write=False)
    return array


class _PerJoint(cached_property[Vector]):
    """The field of the same name of every joint, in wire order; `meaning` is what `help` says."""

    def __init__(self, meaning: str) -> None:
        super().__init__(
            lambda robot: _read_only(map(attrgetter(str(self.attrname)), robot.joints))
        )
        self.__doc__ = meaning


class RobotDescription(Part):
    """Everything that a controller needs to know of a robot.

    All arrays have n entries in wire order, the order of ``joints``; they are read-only.

    Attributes:
        name: ``[a-z][a-z0-9_]{0,31}``.
        urdf: the whole text; its movable joints that follow no others are exactly ``joints``, in
            any order. Mimic joints (<mimic>) are none of ``joints``: they move with their mimicked
            joints.
        initial_posture: the one of ``postures`` in which the robot starts.
        postures: named joint positions [rad], inside the hard limits.
        base_frame: the frame that is fixed to the ground.
        period_s: the robot's control period [s].
        command_kinds: what the robot accepts as a setpoint.
        gravity: `full`, or `compensated` where the robot adds the torques that hold it to commanded
            ones, or `none`.
        soles: the frames that can stand, with their support polygons.
        wrench_sensors: frames in which a wrench is measured.
        default_task: what a controller does whose config names no task; None: nothing is known.
        deadline: from when an answer has its time: `next_tick`, from the intended start of its
            tick, or `after_receipt`, from when its State was published.
        delay_ticks: d; the answer to tick k is applied at tick k + 1 + d, and has 1 + d periods.
        servo_rate_1_s: rate below which a loop around its position servos must stay, as they give
            way, in the start posture [1/s]; None: they follow their reference.
        state_arrays: lengths of the optional arrays of its States, by name; those that are not
            named are empty.
    """

    kind: ClassVar[str] = "robot"
    label: ClassVar[str] = "name"

    name: StrictStr
    urdf: StrictStr
    joints: tuple[Joint, ...]
    initial_posture: StrictStr
    postures: dict[StrictStr, tuple[StrictFloat, ...]]
    base_frame: StrictStr
    period_s: Number = 0.001
    command_kinds: tuple[CommandKind, ...] = ("position",)
    gravity: Gravity = "full"
    soles: tuple[Sole, ...] = ()
    wrench_sensors: tuple[StrictStr, ...] = ()
    default_task: DefaultTask | None = None
    deadline: DeadlineRule = "next_tick"
    delay_ticks: StrictInt = 0
    servo_rate_1_s: Number | None = None
    state_arrays: dict[StrictStr, StrictInt] = {}  # noqa: RUF012 - pydantic copies it

    @classmethod
    def from_json(cls, raw: bytes) -> Self:
        """Read what a robot sent.

        Raises:
            DescriptionError: too long, not JSON, or not a description that holds together.
        """
        if len(raw) > MAX_BYTES:
            raise DescriptionError(f"robot description: {len(raw)} bytes. At most {MAX_BYTES}.")
        try:
            data = pydantic_core.from_json(raw, allow_inf_nan=False)
        except ValueError as error:
            raise DescriptionError(
                f"robot description: not JSON ({error}). Send what to_json() returns."
            ) from error
        found = cls.model_validate(data)
        found.check_moves()
        return found

    def to_json(self) -> bytes:
        """Canonical JSON: sorted keys, no blanks, ASCII; no optional key that has its default."""
        fields = self.model_dump(mode="json")
        for key in ("default_task", "deadline", "delay_ticks", "servo_rate_1_s", "state_arrays"):
            if fields[key] == type(self).model_fields[key].default:
                del fields[key]  # as in logs from before there was one
        for joint in fields["joints"]:
            if joint["setpoint_jerk_max"] is None:
                del joint["setpoint_jerk_max"]
        return json.dumps(fields, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Replace some fields, and check the whole anew.

        Pydantic's own would check nothing, and would keep the digest and the arrays of the old.
        """
        del deep  # nothing in a description changes
        fields = {key: getattr(self, key) for key in type(self).model_fields}
        return type(self)(**{**fields, **(update or {})})

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the canonical JSON, hexadecimal."""
        return hashlib.sha256(self.to_json()).hexdigest()

    @cached_property
    def structure(self) -> UrdfStructure:
        """Links and joints of the URDF."""
        return read_urdf(self.urdf)

    @property
    def frames(self) -> tuple[str, ...]:
        """All frames of the robot: the links of the URDF, in its order."""
        return self.structure.links

    @property
    def n(self) -> int:
        """Number of joints, without mimic joints."""
        return len(self.joints)

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names in wire order."""
        return tuple(joint.name for joint in self.joints)

    @cached_property
    def joint_units(self) -> tuple[str, ...]:
        """Units of the joint positions in wire order: "m" of prismatic joints, else "rad"."""
        kinds = (self.structure.movable[name].kind for name in self.joint_names)
        return tuple("m" if kind == "prismatic" else "rad" for kind in kinds)

    @cached_property
    def initial_position(self) -> Vector:
        """Joint positions of the initial posture, (n,) [rad]."""
        return _read_only(self.postures[self.initial_posture])

    lower: ClassVar = _PerJoint("Least usable positions, (n,) [rad]; -inf where there is none.")
    upper: ClassVar = _PerJoint("Greatest usable positions, (n,) [rad]; inf where there is none.")
    lower_hard: ClassVar = _PerJoint(
        "Lower mechanical stops, (n,) [rad]; -inf where there is none."
    )
    upper_hard: ClassVar = _PerJoint("Upper mechanical stops, (n,) [rad]; inf where there is none.")
    velocity: ClassVar = _PerJoint("Greatest speeds, (n,) [rad/s].")
    setpoint_acceleration_max: ClassVar = _PerJoint(
        "Greatest accelerations of the commanded motion, (n,) [rad/s²]."
    )
    setpoint_jerk_max: ClassVar = _PerJoint(
        "Greatest jerks of commanded positions, (n,) [rad/s³]; inf where there is no limit."
    )
    brake_acceleration: ClassVar = _PerJoint("Decelerations to count on in a stop, (n,) [rad/s²].")
    effort: ClassVar = _PerJoint("Peak torques, (n,) [N m]; inf where nobody knows.")
    armature: ClassVar = _PerJoint(
        "Inertias of the rotors as the joints feel them, (n,) [kg m²; prismatic kg]."
    )

    @cached_property
    def sampling_range(self) -> tuple[Vector, Vector]:
        """Positions to draw from, (n,) each [rad]: the usable range, and one turn without a limit.

        That turn ends at the limit that there is, or is the one around 0.
        """
        ends = []
        for joint in self.joints:
            least, greatest = joint.lower, joint.upper
            if math.isinf(least) and math.isinf(greatest):
                least, greatest = -math.pi, math.pi
            elif math.isinf(least):
                least = greatest - math.tau
            elif math.isinf(greatest):
                greatest = least + math.tau
            ends.append((least, greatest))
        lower, upper = zip(*ends, strict=True)
        return _read_only(lower), _read_only(upper)

    @property
    def due(self) -> int:
        """How long an answer has, from where `deadline` counts [ns]."""
        return (1 + self.delay_ticks) * round(self.period_s * 1e9)

    @property
    def state_lengths(self) -> dict[str, int]:
        """Lengths of all arrays of its States, by name."""
        per_joint = dict.fromkeys(("q", "dq", "tau", "reference"), self.n)
        return {**per_joint, "wrench": 6 * len(self.wrench_sensors), **self.state_arrays}

    @cached_property
    def counts_per_rad(self) -> Vector | None:
        """Signed encoder scales, (n,) [1/rad]; None unless every joint has one."""
        scales = [joint.encoder_counts_per_rad for joint in self.joints]
        known = [scale for scale in scales if scale is not None]
        return _read_only(known) if len(known) == self.n else None

    def check(self) -> None:
        """Refuse a description whose pieces do not agree with each other."""
        if not _ROBOT_NAME.fullmatch(self.name):
            refuse("name", self.name, f"It must match {_ROBOT_NAME.pattern}.")
        if not 1 <= self.n <= MAX_JOINTS and (self.n or self.structure.movable):
            refuse("joints", f"{self.n} joints", f"Give 1 to {MAX_JOINTS}.")
        if not 0.0 < self.period_s <= 1.0:
            refuse("period_s", self.period_s, "Write seconds, such as 0.001.")
        if not 0 <= self.delay_ticks <= MAX_DELAY_TICKS:
            refuse("delay_ticks", self.delay_ticks, f"Write 0 to {MAX_DELAY_TICKS}.")
        if self.servo_rate_1_s is not None and not self.servo_rate_1_s > 0.0:
            refuse("servo_rate_1_s", self.servo_rate_1_s, "Write a rate in 1/s, or null.")
        self._check_state_arrays()
        if not self.command_kinds:
            refuse("command_kinds", [], "Name at least one of position, acceleration, torque.")
        _unique("joints", self.joint_names)
        _unique("command_kinds", self.command_kinds)
        _unique("soles", [sole.frame for sole in self.soles])
        _unique("wrench_sensors", self.wrench_sensors)
        self._check_joints()
        self._check_postures()
        self._check_frames()
        self._check_dynamics()
        if len(self.to_json()) > MAX_BYTES:
            refuse("description", f"{len(self.to_json())} bytes", f"At most {MAX_BYTES}.")

    def check_moves(self) -> None:
        """Refuse a robot without a joint that moves, as where an import has locked all of them.

        Raises:
            DescriptionError: it has none.
        """
        if not self.n:
            raise DescriptionError(
                f"robot {self.name!r}: all joints are fixed, so there is nothing to control. Give "
                "one of them limits with room between them in its URDF."
            )

    def check_mass(self) -> None:
        """Refuse a robot without a centre of mass.

        Raises:
            DescriptionError: nothing that moves has a mass.
        """
        if not self.structure.weighs:
            raise DescriptionError(
                "URDF: nothing that moves has a mass, so there is no centre of mass to control. "
                "Give moving links an <inertial> with <mass> and <inertia>, and check the spelling."
            )

    def _check_dynamics(self) -> None:
        """Refuse commands and tasks of a body of which only the places are known."""
        if self.command_kinds != ("position",) or (
            self.default_task is not None and self.default_task.point == COM
        ):
            self.check_mass()
        unknown = [joint.name for joint in self.joints if not math.isfinite(joint.effort)]
        if unknown and "torque" in self.command_kinds:
            raise DescriptionError(
                f"joint {unknown[0]!r}: takes torques, and has no effort. Write it in the <limit> "
                "of the URDF or in the YAML file, or leave torque out of command_kinds."
            )

    def _check_state_arrays(self) -> None:
        known = {
            **dict.fromkeys(("reference_rate", "reference_acceleration"), (self.n, self.n)),
            "followed": (1, 1),
            "base": (13, 13),
            "contact": (6, 384),
            "imu": (10, 160),
        }
        for name, length in self.state_arrays.items():
            if name not in known:
                remedy = did_you_mean(name, known, "Leave it out.")
                refuse("state_arrays", name, remedy)
            one, most = known[name]
            if length % (one or 1) or not 0 <= length <= most:
                allowed = f"0 or {one}" if one == most else f"multiples of {one} up to {most}"
                refuse(f"state_arrays.{name}", length, f"It must be {allowed}.")

    def _check_joints(self) -> None:
        movable = self.structure.movable
        for name in self.joint_names:
            independent_joint(self.structure, name)
        for name in movable:
            if name not in self.joint_names:
                raise DescriptionError(
                    f"joint {name!r}: movable in the URDF but not listed in joints. "
                    'Add it, or make it type="fixed".'
                )
        for joint in self.joints:
            limits = joint.lower, joint.upper, joint.lower_hard, joint.upper_hard
            if joint.name not in self.structure.continuous and not all(map(math.isfinite, limits)):
                raise DescriptionError(
                    f"joint {joint.name!r}: no position limits, but {movable[joint.name].kind} in "
                    'the URDF. Give it limits, or make it type="continuous".'
                )

    def _check_postures(self) -> None:
        if self.initial_posture not in self.postures:
            name = self.initial_posture
            remedy = did_you_mean(name, self.postures, "Add it to postures.")
            refuse("initial_posture", name, remedy)
        for posture, values in self.postures.items():
            if len(values) != self.n:
                remedy = f"Write {self.n}, one a joint in wire order."
                refuse(f"posture {posture!r:.60}", f"{len(values)} values", remedy)
            for joint, value in zip(self.joints, values, strict=True):
                inside = joint.lower_hard <= value <= joint.upper_hard
                if not (inside and math.isfinite(value)):
                    raise DescriptionError(
                        f"posture {posture!r:.60}: joint {joint.name!r} at {value}. "
                        f"Stay within [{joint.lower_hard}, {joint.upper_hard}]."
                    )

    def _check_frames(self) -> None:
        used = [("base_frame", self.base_frame)]
        used += [("soles", sole.frame) for sole in self.soles]
        used += [("wrench_sensors", frame) for frame in self.wrench_sensors]
        if self.default_task is not None:
            used.append(("default_task.reference", self.default_task.reference))
            if self.default_task.point != COM:
                used.append(("default_task.point", self.default_task.point))
        for key, frame in used:
            if frame not in self.frames:
                remedy = did_you_mean(frame, self.frames, "Add that link to the URDF.")
                refuse(key, frame, remedy)


def independent_joint(structure: UrdfStructure, name: str) -> UrdfJoint:
    """Return a joint that can be commanded.

    Raises:
        DescriptionError: the URDF has no such joint, or it is fixed or a mimic joint.
    """
    if name in structure.mimic_joints:
        raise DescriptionError(
            f"joint {name!r:.60}: it follows {structure.mimic_joints[name].mimicked!r} (<mimic> in "
            "the URDF). Take it out of joints: it moves with that one."
        )
    if name not in structure.movable:
        raise DescriptionError(
            f"joint {name!r:.60}: not a movable joint of the URDF. "
            f"{one_of(name, structure.movable, 'Its movable joints'):.400}."
        )
    return structure.movable[name]


def _unique(key: str, names: Sequence[str]) -> None:
    twice = first_twice(names)
    if twice is not None:
        refuse(key, twice, "It appears twice; name each once.")
