"""What every filter between setpoints and a plant does."""

from __future__ import annotations

from typing import Protocol

from hoap3.protocol.messages import Event, FloatArray
from hoap3.protocol.robot.description import RobotDescription

POSITION, SPEED, ACCELERATION, JERK, TORQUE = (
    Event.schema.constants[f"LIMIT_{name}"]
    for name in ("POSITION", "SPEED", "ACCELERATION", "JERK", "TORQUE")
)
ROUNDING = 1e-6
"""Of a speed, an acceleration or a jerk relative to its limit: from there on the limit acts."""
STARTUP_TICKS = 200
"""Ticks from the first active one in which a clipped setpoint counts as a start-up step."""


def limit_figures(
    robot: RobotDescription, joint: int, limit: int, position: float
) -> dict[str, object]:
    """Return the name, value and unit of a joint's limit, for the robot's summary.

    Args:
        robot: its description.
        joint: its number.
        limit: `Event.LIMIT_*`.
        position: of the joint; of a range the nearer end counts [rad or m].
    """
    lower, upper = float(robot.lower[joint]), float(robot.upper[joint])
    acceleration = robot.setpoint_acceleration_max[joint]
    if robot.command_kinds[0] != "position":
        acceleration = min(acceleration, robot.brake_acceleration[joint])
    name, value, power = {
        POSITION: ("position", lower if position - lower < upper - position else upper, ""),
        SPEED: ("speed", robot.velocity[joint], "/s"),
        ACCELERATION: ("acceleration", acceleration, "/s²"),
        JERK: ("jerk", robot.setpoint_jerk_max[joint], "/s³"),
        TORQUE: ("torque", robot.effort[joint], ""),
    }[limit]
    slides = robot.structure.movable[robot.joint_names[joint]].kind == "prismatic"
    unit = ("N" if slides else "N m") if limit == TORQUE else ("m" if slides else "rad") + power
    return {"limit": name, "value": float(value), "unit": unit}


class SetpointFilter(Protocol):
    """Turns any stream of setpoints, with gaps in it, into commands within the robot's limits.

    Attributes:
        value: command for the plant, (n,): rad, rad/s² or N m; m, m/s² or N for prismatic joints.
        reference: where the commanded motion is, (n,) [rad or m].
        rate: its velocity over the last period, (n,) [rad/s or m/s].
        interventions: periods in which some joint was held back.
        held_back: the first joint held back in the last period, or -1.
        overloaded: the first joint whose effort is too small for the limits in this period, or -1.
        torque_limited: periods in which there was one.
    """

    value: FloatArray
    reference: FloatArray
    rate: FloatArray
    interventions: int
    held_back: int
    overloaded: int
    torque_limited: int

    def reset(self, q: FloatArray) -> None:
        """Be at rest at `q`, (n,)."""

    def forget(self) -> None:
        """Forget earlier setpoints: there is nothing to hold but the place."""

    def follow(self, setpoint: FloatArray, tick: int) -> int:
        """Take a setpoint that answers `tick`; the first joint held back, or -1."""

    def limit_of(self, joint: int) -> int:
        """Return the limit, `Event.LIMIT_*`, that clipped a joint in the last period."""

    def hold(self) -> int:
        """No setpoint: keep to the last one; the first joint held back, or -1."""

    def extrapolate(self) -> int:
        """No setpoint: go on as the last two did; the first joint held back, or -1."""

    def begin_stop(self) -> None:
        """Plan to brake to rest."""

    def brake(self) -> bool:
        """One period of the planned stop; True once at rest, or where only brakes can help."""
