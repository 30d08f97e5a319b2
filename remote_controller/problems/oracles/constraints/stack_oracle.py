"""The constraints of a config, by name."""

from __future__ import annotations

from collections.abc import Iterable

from hoap3.protocol.errors import FrameNotFoundError
from hoap3.remote_controller.problems.oracles.constraints.barrier_oracle import (
    HalfSpace,
    SupportPolygon,
)
from hoap3.remote_controller.problems.oracles.constraints.base_oracle import Constraint, Level
from hoap3.remote_controller.problems.oracles.constraints.com_motion_oracle import FrictionCone, Zmp
from hoap3.remote_controller.problems.oracles.constraints.distance_oracle import Distance
from hoap3.remote_controller.problems.oracles.constraints.frames_oracle import (
    FixedFrame,
    MinimumSpeed,
    Pfaffian,
)
from hoap3.remote_controller.problems.oracles.constraints.joints_oracle import (
    JointAcceleration,
    JointPosition,
    JointTorque,
    JointVelocity,
    Viability,
)
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError, complete
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot

KINDS: dict[str, type[Constraint]] = {
    "distance": Distance,
    "fixed_frame": FixedFrame,
    "friction_cone": FrictionCone,
    "half_space": HalfSpace,
    "joint_acceleration": JointAcceleration,
    "joint_position": JointPosition,
    "joint_torque": JointTorque,
    "joint_velocity": JointVelocity,
    "minimum_speed": MinimumSpeed,
    "pfaffian": Pfaffian,
    "support_polygon": SupportPolygon,
    "viability": Viability,
    "zmp": Zmp,
}
"""Those that can be recomputed; all others are users' own, as `user_function` is."""


def constraints_of(
    entries: Iterable[tuple[str, object]], robot: Robot, level: Level = "velocity"
) -> tuple[list[Constraint], dict[str, str]]:
    """The constraints of a config's entries, and why others cannot be recomputed, by name.

    Args:
        entries: names and parameters.
        robot: that they look at.
        level: what a user's constraint must limit by its margins alone.
    """
    known: list[Constraint] = []
    unknown: dict[str, str] = {}
    for name, given in entries:
        try:
            if name not in KINDS:
                from hoap3.remote_controller.problems.oracles.user_code_oracle import UserBarrier

                known.append(UserBarrier(name, given, robot, level))
                continue
            settings = complete(given, KINDS[name].defaults, name)
            known.append(KINDS[name](settings, robot.description, robot))
        except (UnverifiableError, FrameNotFoundError, ValueError, KeyError, TypeError) as error:
            unknown[name] = f"{error!s:.240}"
    return known, unknown
