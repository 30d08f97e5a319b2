"""The YAML file of a robot, and how it becomes a description.

What is not written has a default:

===========================  ================================================================
`joints`                     the movable joints of the URDF that follow no others, in its order
`lower`, `upper`             usable range: `<limit lower upper>` of the URDF, as far as those of its
                             mimic joints allow; none of a continuous joint
`lower_hard`, `upper_hard`   the usable range
`velocity`, `effort`         `<limit velocity effort>` of the URDF; the velocity as far as those of
                             its mimic joints allow
`setpoint_acceleration_max`  the one at the top of the file, for all joints; else `<limit
                             acceleration>` of the URDF; else 250/s times the velocity: full speed
                             within 4 ms
`brake_acceleration`         the one at the top of the file, for all joints; else `<limit
                             deceleration>`, or `<limit acceleration>`, of the URDF; else 10/s times
                             the velocity: rest within 0.1 s
`setpoint_jerk_max`          the one at the top of the file, for all joints; else `<limit jerk>` of
                             the URDF; else no limit
`postures`                   `zero` is added: all joints at 0, or at the limit nearest to it
`initial_posture`            `zero`
`armature`                   0
`base_frame`                 the root link of the URDF
`period_s`                   0.001
`command_kinds`              position
`default_task`               none: controllers whose config names no task refuse the robot
===========================  ================================================================
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, StrictStr

from hoap3.protocol.config.regular_file import read_at_most
from hoap3.protocol.config.settings import RobotName, Settings, load_yaml, parse
from hoap3.protocol.errors import ConfigError, DescriptionError
from hoap3.protocol.robot.description import (
    MAX_BYTES,
    CommandKind,
    RobotDescription,
    independent_joint,
)
from hoap3.protocol.robot.description_parts import Number
from hoap3.protocol.robot.urdf import CONTINUOUS, UrdfStructure, read_urdf
from hoap3.robot_emulator.robots.mimic_limits import limits_with_mimic_joints

SETPOINT_RATE = 250.0  # [1/s] default setpoint_acceleration_max / velocity
BRAKE_RATE = 10.0  # [1/s] default brake_acceleration / velocity
_OF_ALL_JOINTS = {"setpoint_acceleration_max", "brake_acceleration", "setpoint_jerk_max"}


def _not_text(value: object) -> object:
    if isinstance(value, str):
        problem = "should be a number; in quotes it is text"
        raise ValueError(problem)  # noqa: TRY004 - the error that pydantic understands
    return value


Figure = Annotated[Number, BeforeValidator(_not_text)]


Guess = Literal["range", "velocity", "acceleration"]


class JointEntry(Settings):
    """One joint; a bare name stands for an entry with nothing but the name."""

    name: StrictStr
    lower: Figure | None = Field(None, description="least usable position [rad]")
    upper: Figure | None = Field(None, description="greatest usable position [rad]")
    lower_hard: Figure | None = Field(None, description="lower mechanical stop [rad]")
    upper_hard: Figure | None = Field(None, description="upper mechanical stop [rad]")
    velocity: Figure | None = Field(None, description="greatest speed [rad/s]")
    setpoint_acceleration_max: Figure | None = Field(None, description="[rad/s²]")
    brake_acceleration: Figure | None = Field(None, description="[rad/s²]")
    setpoint_jerk_max: Figure | None = Field(None, description="of positions [rad/s³]")
    effort: Figure | None = Field(None, description="peak torque [N m]")
    effort_average: Figure | None = Field(None, description="torque that can be held [N m]")
    encoder_counts_per_rad: Figure | None = Field(None, description="signed scale [1/rad]")
    armature: Figure = Field(0.0, description="inertia of the rotor at the joint [kg m²]")
    guessed: tuple[Guess, ...] = Field(
        (), description="what nobody gave, and an import has filled in; for people"
    )


class SoleEntry(Settings):
    """One sole."""

    frame: StrictStr = Field(description="a link of the URDF, z upwards")
    polygon: tuple[tuple[Figure, Figure], ...] = Field(
        description="corners in that frame, (x, y), counter-clockwise [m]"
    )


class DefaultTaskEntry(Settings):
    """What controllers do whose config names no task."""

    point: StrictStr = Field(description="a link of the URDF, such as the tool, or com")
    reference: StrictStr = Field(description="the link that the point is seen from")
    target_m: tuple[Figure, Figure, Figure] | None = Field(
        None, description="where the point shall be, in the reference's axes [m]"
    )
    move_m: tuple[Figure, Figure, Figure] | None = Field(
        None, description="or: how far from where it is in the start posture [m]"
    )


class CompanionEntry(Settings):
    """A file that a mesh names, such as a material or a texture, beside it in that folder."""

    file: StrictStr = Field(
        pattern=r"^[A-Za-z0-9_][A-Za-z0-9_. -]*(/[A-Za-z0-9_][A-Za-z0-9_. -]*)*$",
        description="its name as seen from the mesh",
    )
    sha256: StrictStr = Field(pattern=r"^[0-9a-f]{64}$", description="of its content")


class MeshEntry(Settings):
    """A mesh that a link is drawn with: a file in the folder `meshes` beside the robot's."""

    link: StrictStr = Field(description="a link of the URDF")
    file: StrictStr = Field(
        pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$", description="its name in that folder"
    )
    sha256: StrictStr = Field(pattern=r"^[0-9a-f]{64}$", description="of its content")
    scale: tuple[Figure, Figure, Figure] = Field((1.0, 1.0, 1.0), description="of its coordinates")
    xyz_m: tuple[Figure, Figure, Figure] = Field((0.0, 0.0, 0.0), description="in the link [m]")
    rpy_rad: tuple[Figure, Figure, Figure] = Field(
        (0.0, 0.0, 0.0), description="roll, pitch, yaw there [rad]"
    )
    companions: tuple[CompanionEntry, ...] = Field((), description="files that it names")


def _entry(value: object) -> object:
    return {"name": value} if isinstance(value, str) else value


class RobotFile(Settings):
    """A robot's YAML file."""

    name: RobotName
    urdf: StrictStr = Field(description="a file, counted from the folder of this one")
    joints: tuple[Annotated[JointEntry, BeforeValidator(_entry)], ...] | None = Field(
        None, description="in wire order; names, or entries that say more"
    )
    setpoint_acceleration_max: Figure | None = Field(None, description="of all joints [rad/s²]")
    brake_acceleration: Figure | None = Field(None, description="of all joints [rad/s²]")
    setpoint_jerk_max: Figure | None = Field(
        None, description="of all joints, of positions [rad/s³]; null: no limit"
    )
    postures: dict[StrictStr, tuple[Figure, ...]] = Field(
        {}, description="joint positions in wire order [rad]"
    )
    initial_posture: StrictStr = "zero"
    period_s: Figure = 0.001
    command_kinds: tuple[CommandKind, ...] = ("position",)
    soles: tuple[SoleEntry, ...] = ()
    base_frame: StrictStr | None = Field(None, description="the link fixed to the ground")
    wrench_sensors: tuple[StrictStr, ...] = Field((), description="links that measure a wrench")
    default_task: DefaultTaskEntry | None = Field(
        None, description="what controllers do whose config names no task"
    )
    meshes: tuple[MeshEntry, ...] = Field(
        (), description="what links are drawn with; it stays here, and controllers get none of it"
    )


def read_robot(path: Path) -> RobotDescription:
    """Describe the robot of a YAML file.

    Raises:
        ConfigError: a file is missing or cannot be read, or a key or a type is wrong.
        DescriptionError: the figures or the URDF do not hold together.
    """
    robot, urdf = read_files(path)
    try:
        return describe(robot, urdf)
    except DescriptionError as error:
        raise DescriptionError(f"{path}: {error}") from error


def read_files(path: Path) -> tuple[RobotFile, str]:
    """What a robot's YAML file says, and the text of its URDF.

    Raises:
        ConfigError: a file is missing or cannot be read, or a key or a type is wrong.
    """
    robot = parse(RobotFile, load_yaml(path), str(path))
    return robot, _read_text(path.parent / robot.urdf, str(path))


def describe(robot: RobotFile, urdf: str) -> RobotDescription:
    """Fill in what the file leaves to the URDF and to the defaults.

    Raises:
        DescriptionError: the figures or the URDF do not hold together.
    """
    structure = read_urdf(urdf)
    entries = robot.joints
    if entries is None:
        entries = tuple(JointEntry(name=name) for name in structure.movable)
    joints = [_joint(robot, entry, structure) for entry in entries]
    zero = tuple(min(max(0.0, joint["lower"]), joint["upper"]) for joint in joints)
    given = robot.model_dump(exclude=_OF_ALL_JOINTS | {"meshes"})
    return RobotDescription.model_validate(
        {
            **given,
            "urdf": urdf,
            "joints": joints,
            "postures": {"zero": zero, **robot.postures},
            "base_frame": robot.base_frame or structure.root,
        }
    )


def _joint(robot: RobotFile, entry: JointEntry, structure: UrdfStructure) -> dict[str, Any]:
    try:
        urdf = independent_joint(structure, entry.name)
    except DescriptionError as error:
        raise DescriptionError(f"robot {robot.name!r}: {error}") from error
    limits = limits_with_mimic_joints(structure, entry.name)
    given = {**limits, **entry.model_dump(exclude_none=True, exclude={"guessed"})}
    if given.get("effort") == 0.0:  # as exporters write what nobody filled in
        given["effort"] = math.inf
    if urdf.kind == CONTINUOUS:
        given = {"lower": -math.inf, "upper": math.inf, **given}
    incomplete = [key for key in ("lower", "upper", "velocity", "effort") if key not in given]
    if incomplete:
        raise DescriptionError(
            f"robot {robot.name!r}: joint {entry.name!r}: its limits are not complete. "
            f"Write {' and '.join(incomplete)} in the <limit> of the URDF, or in the YAML file."
        )
    velocity = given["velocity"]
    accelerations = {
        "setpoint_acceleration_max": urdf.acceleration or SETPOINT_RATE * velocity,
        "brake_acceleration": urdf.deceleration or urdf.acceleration or BRAKE_RATE * velocity,
        "setpoint_jerk_max": urdf.jerk,
        **robot.model_dump(include=_OF_ALL_JOINTS, exclude_none=True),
    }
    stops = {"lower_hard": given["lower"], "upper_hard": given["upper"]}
    return {**stops, **accelerations, **given}


def _read_text(path: Path, file: str) -> str:
    try:
        data = read_at_most(path, MAX_BYTES)
        text = data.decode("utf-8")
    except OSError as error:
        reason = error.strerror or "cannot be read"
        remedy = "Name a URDF file, counted from the folder of this one"
        raise ConfigError(file, "urdf", str(path), reason, remedy) from error
    except UnicodeDecodeError as error:
        raise ConfigError(file, "urdf", str(path), "is not UTF-8 text", "Save it so") from error
    if len(data) > MAX_BYTES:
        raise ConfigError(file, "urdf", str(path), "is larger than 1 MiB", "Make it smaller")
    return text
