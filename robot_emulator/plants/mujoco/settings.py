"""Settings of a body in MuJoCo, and what they say of a robot."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.robot.description import RobotDescription

FAR_M = 1000.0
Metre = Annotated[float, Field(ge=-FAR_M, le=FAR_M)]
Point = tuple[Metre, Metre, Metre]
Newton = Annotated[float, Field(ge=-1e6, le=1e6)]
Angle = Annotated[float, Field(ge=-10.0, le=10.0)]
Angles = tuple[Angle, Angle, Angle]
Length = Annotated[float, Field(gt=0, le=FAR_M)]
Gain = Annotated[float, Field(gt=0, le=1e9)]
Inertia = Annotated[float, Field(ge=0, le=1e9)]
Gains = Gain | dict[str, Inertia]  # 0 has a better message where joints are known


class FloorSettings(Settings):
    """A level plane without end."""

    height_m: Metre = Field(0.0, description="z of the plane")
    friction: float = Field(0.8, ge=0, le=10, description="coefficient μ of sliding")


class BoxSettings(Settings):
    """A box that stands still."""

    position_m: Point = Field(description="of its centre")
    size_m: tuple[Length, Length, Length] = Field(description="length, width, height")
    rotation_rad: Angles = Field((0.0, 0.0, 0.0), description="roll, pitch, yaw, as in a URDF")
    friction: float = Field(0.8, ge=0, le=10, description="coefficient μ of sliding")


class PushSettings(Settings):
    """A constant force on a link for a while."""

    frame: str = Field(description="link that is pushed, at its centre of mass")
    at_s: float = Field(ge=0, le=1e6, description="begin, since the robot was placed [s]")
    for_s: float = Field(gt=0, le=1e6, description="duration [s]")
    force_n: tuple[Newton, Newton, Newton] = Field(description="in the world [N]")


class MujocoParameters(Settings):
    """What a body in MuJoCo is made of, and what stands around it."""

    base: Literal["fixed", "free"] = Field(
        "fixed",
        description="fixed: the description's base frame is the world; free: the root link may "
        "move and fall",
    )
    mjcf: str | None = Field(
        None, description="MJCF file instead of the robot's URDF; its joints are found by name"
    )
    position_m: Point | None = Field(
        None,
        description="of a free root link at the start; null: the first sole at the world's origin, "
        "or the lowest point on the floor",
    )
    rotation_rad: Angles | None = Field(
        None, description="of a free root link at the start; null: the first sole level"
    )
    kp: Gains | None = Field(
        None,
        description="stiffness of the position servos, of all or by joint [N m/rad or N/m]; null: "
        "servo_rad_s² times the inertia that the joint moves at the start",
    )
    kv: Gains | None = Field(
        None,
        description="damping of the servos [N m s/rad or N s/m]; null: 2 servo_rad_s times that",
    )
    servo_rad_s: float = Field(100.0, gt=0, le=1e4, description="where kp or kv is null")
    armature: Inertia | dict[str, Inertia] | None = Field(
        None,
        description="inertia of the rotors [kg m² or kg]; null: the description's",
    )
    joint_friction: bool = Field(
        True, description="damping and friction of the URDF's joints; not with mjcf"
    )
    substeps: int = Field(1, ge=1, le=100, description="integration steps a period")
    floor: FloorSettings | None = Field(
        None,
        description="null: one at height 0 below a free base of a URDF, else none",
    )
    boxes: tuple[BoxSettings, ...] = Field((), max_length=100, description="that stand around")
    collide: Literal["auto", "none", "all"] | tuple[str, ...] = Field(
        "auto",
        description="links that touch the surroundings, and each other where they are more than "
        "two joints apart and apart at the start; auto: those with soles, or all where there are "
        "none; not with mjcf",
    )
    contact_frames: tuple[str, ...] | None = Field(
        None,
        max_length=64,
        description="whose links' contact forces State has; null: those of the soles",
    )
    imu_frames: tuple[str, ...] | None = Field(
        None, max_length=16, description="null: the root link of a free base, else none"
    )
    pushes: tuple[PushSettings, ...] = Field(
        (), max_length=100, description="forces from outside, to see what becomes of the robot"
    )
    noise_rad: float = Field(
        0.0, ge=0, le=1, description="standard deviation of each measured position [rad or m]"
    )


def felt_soles(description: RobotDescription, parameters: MujocoParameters) -> tuple[str, ...]:
    """Frames whose contact forces State has."""
    if parameters.contact_frames is not None:
        return parameters.contact_frames
    touches = parameters.base == "free" or parameters.floor or parameters.boxes
    return tuple(sole.frame for sole in description.soles) if touches else ()


def rotors_of(
    description: RobotDescription, parameters: MujocoParameters
) -> tuple[float, ...] | None:
    """Armatures of the joints, (n,), where torques are commanded and they are not as described."""
    given = parameters.armature
    if given is None or description.command_kinds[0] == "position":
        return None
    if isinstance(given, dict):
        return tuple(given.get(joint.name, joint.armature) for joint in description.joints)
    return (given,) * description.n


def imu_frames_of(description: RobotDescription, parameters: MujocoParameters) -> tuple[str, ...]:
    """Frames with inertial units."""
    if parameters.imu_frames is not None:
        return parameters.imu_frames
    free = parameters.base == "free" and parameters.mjcf is None
    return (description.structure.root,) if free else ()
