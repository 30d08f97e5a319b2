"""Settings of the robot emulator."""

from __future__ import annotations

import math
import os
import sys
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, field_validator

from hoap3.protocol.config.endpoints import Endpoint
from hoap3.protocol.config.regular_file import check_path
from hoap3.protocol.config.settings import (
    LinkSettings,
    LogSettings,
    MetricsSettings,
    RealtimeSettings,
    RobotName,
    Settings,
    load_yaml,
)
from hoap3.protocol.config.user_code import may_import
from hoap3.protocol.errors import UnknownNameError
from hoap3.protocol.robot.description import (
    MAX_DELAY_TICKS,
    CommandKind,
    DeadlineRule,
    Gravity,
)
from hoap3.protocol.robot.description_parts import LEAST, MOST

CONFIGS = Path(__file__).parent / "configs"
FAR_M = 1000.0
PATHS = (".yaml", ".yml")  # endings of a robot's name that make it a path


class ContactSettings(Settings):
    """A compliant plane, and the point of the robot that can touch it."""

    frame: str = Field(description="the point that touches is its origin; some joint must move it")
    offset_m: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0), description="the point in the frame instead"
    )
    point_m: tuple[float, float, float] = Field(description="of the plane, in the root's axes")
    normal: tuple[float, float, float] = Field(
        description="of the plane, towards the robot, in the root's axes; of any length"
    )
    stiffness_n_m: float = Field(20000.0, gt=0, le=1e9, description="K, in normal direction")
    damping_n_s_m: float | None = Field(
        None, ge=0, le=1e9, description="D, in normal direction; null: 2√K"
    )
    friction: float = Field(0.0, ge=0, le=10, description="coefficient μ, Coulomb's")

    @field_validator("offset_m", "point_m")
    @classmethod
    def _near(cls, value: tuple[float, float, float]) -> tuple[float, float, float]:
        if max(abs(each) for each in value) > FAR_M:
            raise ValueError(f"should be within {FAR_M:g} m")
        return value

    @field_validator("normal")
    @classmethod
    def _a_direction(cls, value: tuple[float, float, float]) -> tuple[float, float, float]:
        if not 1e-6 <= math.hypot(*value) <= 1e6:
            raise ValueError("should point somewhere, with a length from 1e-6 to 1e6")
        return value

    @property
    def law(self) -> tuple[float, float, float]:
        """K [N/m], D [N s/m] and μ."""
        damping = self.damping_n_s_m
        if damping is None:
            damping = 2.0 * math.sqrt(self.stiffness_n_m)
        return self.stiffness_n_m, damping, self.friction


class PlantSettings(Settings):
    """How the robot's body behaves."""

    kind: str | None = Field(
        None,
        description="servo, acceleration, rigid_body, mujoco, or another plant, by its registered "
        "name or as package.module:Class; null: what the commands need",
    )
    parameters: dict[str, Any] = Field({}, description="settings of that plant itself")
    servo: Literal["ideal", "lag"] = Field(
        "ideal", description="joints follow their reference at once, or with a first-order lag"
    )
    time_constant_ms: float = Field(20.0, gt=0, description="of the lag")
    encoder: Literal["ideal", "counts"] = Field(
        "ideal",
        description="of position servos; counts: positions are rounded to the encoder's int16 "
        "counts",
    )
    gravity: Gravity = Field(
        "full",
        description="where torques are commanded; compensated: the robot adds what holds it",
    )
    friction: bool = Field(True, description="where torques are commanded: that of the URDF")
    substeps: int = Field(
        4, ge=1, le=100, description="where torques are commanded: integration steps a period"
    )
    contacts: tuple[ContactSettings, ...] = Field(
        (), description="where torques are commanded: planes that the robot can touch"
    )


class LockstepSettings(Settings):
    """Virtual time instead of the wall clock."""

    compute_time_us: float = Field(
        200.0,
        ge=0,
        le=1e9,
        description="from a State to its answer, in virtual time; beyond the deadline all are late",
    )


class EmulatorLink(LinkSettings):
    """Where controllers find the robot."""

    listen: tuple[Endpoint, ...] = Field(
        ("tcp/127.0.0.1:7447",), description="endpoints to listen on"
    )

    @property
    def reachable(self) -> tuple[str, ...]:
        """Where others reach the robot."""
        if self.kind == "hoap3_tcp":
            return (f"tcp/{self.hoap3_tcp.host}:{self.hoap3_tcp.init_port}",)
        return super().reachable


class EmulatorRealtime(RealtimeSettings):
    """The robot comes before its controller."""

    priority: int = Field(85, ge=1, le=98, description="SCHED_FIFO priority")


class EmulatorConfig(Settings):
    """One robot emulator."""

    robot: str = Field("hoap3", description="shipped robot, or path of a description or a URDF")
    tip: str | None = Field(
        None, description="of a URDF: link that the default task moves; null: the likeliest tool"
    )
    lock_joints: tuple[str, ...] = Field(
        (), description="of a URDF: joints that become fixed, each as NAME or NAME=VALUE [rad or m]"
    )
    name: RobotName | None = Field(None, description="name on the network; default: the robot's")
    posture: str | tuple[float, ...] | None = Field(
        None, description="start: a posture's name or joint values; default: the description's"
    )
    command: CommandKind | None = Field(
        None,
        description="what setpoints are; null: the description's first, or in run the controller's",
    )
    setpoint_jerk_max: float | None = Field(
        None,
        ge=LEAST,
        le=MOST,
        description="greatest jerk of positions, of all joints [rad/s³ or m/s³]; null: that of "
        "the description",
    )
    plant: PlantSettings = PlantSettings()
    loss_policy: Literal["hold", "extrapolate"] = Field(
        "hold", description="what the robot does with a missed setpoint"
    )
    hold_ticks: int = Field(
        5,
        ge=0,
        description="misses in a row in which an acceleration or torque is held; then it brakes",
    )
    misses_to_stop: int = Field(20, ge=1, description="consecutive misses that end in a safe stop")
    deadline: DeadlineRule = Field(
        "next_tick",
        description="until when an answer is in time: until the intended start of the next tick; "
        "after_receipt: for a period from when its State was published",
    )
    delay_ticks: int = Field(
        0,
        ge=0,
        le=MAX_DELAY_TICKS,
        description="ticks by which each answer is applied later, and by which it may come later",
    )
    seed: int = Field(0, ge=0, lt=2**63, description="of everything random; names the session")
    link: EmulatorLink = EmulatorLink()
    realtime: EmulatorRealtime = EmulatorRealtime()
    log: LogSettings = LogSettings()
    metrics: MetricsSettings = MetricsSettings()
    lockstep: LockstepSettings = LockstepSettings()


def available_configs() -> list[str]:
    """Names of the shipped configs."""
    return sorted(path.stem for path in CONFIGS.glob("*.yaml"))


def read_config(name: str) -> tuple[dict[str, Any], str]:
    """Content and file name of a shipped config, or of the user's own.

    A relative path of a robot, or in the parameters of a plant, counts from the folder of the file
    that names it. That of the user's own joins the end of the import path, so that a plant can lie
    beside it; not where `user_code` forbids to import it.

    Raises:
        ConfigError: the file cannot be read, or a path leads nowhere.
        UnknownNameError: neither a shipped config nor a file.
    """
    path = Path(name)
    if name in available_configs():
        path = CONFIGS / f"{name}.yaml"
    elif path.suffix not in {".yaml", ".yml"} and not os.path.exists(name):
        from hoap3.robot_emulator.robots import available

        check_path(name, "an emulator config, or a robot's folder, YAML file or URDF")
        known = {*available_configs(), *available()}
        raise UnknownNameError("robot or emulator config", name, known, " Or name a file.")
    from hoap3.robot_emulator.robots.urdf_import.source import absolute, is_source

    content = load_yaml(path)
    robot = content.get("robot")
    if isinstance(robot, str) and ("/" in robot or robot.endswith(PATHS) or is_source(robot)):
        content["robot"] = absolute(robot, path.parent)
    plant = content.get("plant")
    parameters = plant.get("parameters") if isinstance(plant, dict) else None
    if isinstance(parameters, dict) and isinstance(parameters.get("mjcf"), str):
        parameters["mjcf"] = str((path.parent / parameters["mjcf"]).resolve())
    folder = str(path.resolve().parent)
    if path.parent != CONFIGS and folder not in sys.path and may_import():
        sys.path.append(folder)
    return content, str(path)
