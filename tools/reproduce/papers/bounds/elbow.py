"""Fig. 5: the left hand of Baxter to a pose by (33) and (34), past the elbow's lower limit.

The shipped controller `tsid` in a closed loop: its answers are integrated exactly, (1), at 100 Hz,
and nothing stands between. The accelerations are what Algorithm 4 leaves, N = 10⁶ uniform states;
s1, which cannot hold the arm in all of them, is given 2 rad/s². Speeds of s0 to e1 up to 2 rad/s;
stops are moved away, so that a joint can go on beyond its limit. Accelerations that violate (11)
are lowered to it.

The paper prints no posture. Start and goal were sought until the elbow met its limit as there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hoap3.protocol.limits.torque_bounds import torque_acceleration_bounds
from hoap3.protocol.messages import State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.pinocchio_model import build_model
from hoap3.remote_controller.controllers.acceleration.tsid import TsidController
from hoap3.robot_emulator.plants.acceleration_servo import AccelerationServo
from hoap3.robot_emulator.robots import load
from hoap3.tools.reproduce.figures import Array
from hoap3.tools.reproduce.papers import Say

ROBOT, FRAME, START, GOAL = "baxter_left_arm", "left_gripper", "fig5_start", "fig5_goal"
JOINT = "left_e1"
PERIOD_S, SECONDS = 0.01, 4.0
KP, WEIGHT = 10.0, 1e-3
SPEED = 2.0  # rad/s, of s0 to e1
SAMPLES = 1_000_000
WHERE_NONE = 2.0  # rad/s²: for a joint that has no acceleration in every state
SHOWN = {"naive": (2.0, 20.0), "viability": (1.0, 2.0, 20.0)}
"""T_b/δt by kind of bounds."""


@dataclass(frozen=True, eq=False)
class Run:
    """A motion, one row a tick; of the elbow, but for the error.

    Attributes:
        room: distance from its lower limit [rad].
        dq, a: its velocity, and the acceleration that it is then given.
        error: |log(H⁻¹H_d)| of the hand.
        fallbacks: ticks at which the torques were too small for the bounds.
    """

    room: Array
    dq: Array
    a: Array
    error: Array
    fallbacks: int = 0

    @property
    def time_s(self) -> Array:
        """Since the start."""
        return np.arange(len(self.room), dtype=np.float64) * PERIOD_S

    @property
    def nearest_speed(self) -> float:
        """|dq| at the tick at which it is nearest its limit [rad/s]."""
        return float(abs(self.dq[self.room.argmin()]))

    @property
    def crossing(self) -> tuple[float, float]:
        """When it reaches its limit [s], and how fast [rad/s]; NaN where it does not go beyond."""
        beyond = np.flatnonzero(self.room < 0.0)
        if not beyond.size:
            return math.nan, math.nan
        k = int(beyond[0]) - 1
        speed = -math.sqrt(self.dq[k] ** 2 - 2.0 * self.a[k] * self.room[k])
        return (k * PERIOD_S) - 2.0 * self.room[k] / (self.dq[k] + speed), speed


@dataclass(frozen=True)
class Runs:
    """All of them.

    Attributes:
        accelerations: of Algorithm 4, (7,) [rad/s²].
        none: joints that have none.
        ideal: motions, by kind of bounds and T_b/δt.
    """

    accelerations: Array
    none: tuple[str, ...]
    ideal: Mapping[tuple[str, float], Run]


def ideal_robot() -> RobotDescription:
    """Baxter's left arm as the paper's: see above."""
    robot = load(ROBOT)
    joints = []
    for joint in robot.joints:
        hard = {"lower_hard": joint.lower - 1.0, "upper_hard": joint.upper + 1.0}
        joints.append(joint.model_copy(update={**hard, "velocity": max(joint.velocity, SPEED)}))
    changes = {"period_s": PERIOD_S, "command_kinds": ("acceleration",), "initial_posture": START}
    return robot.model_copy(update={"joints": tuple(joints), **changes})


def accelerations() -> tuple[Array, tuple[str, ...]]:
    """Algorithm 4 as printed, and the joints that it leaves nothing."""
    found = torque_acceleration_bounds(build_model(load(ROBOT)), SAMPLES, velocities="uniform")
    either = found.either_way
    return np.where(either > 0.0, either, WHERE_NONE), found.none


def settings(**bounds: Any) -> dict[str, Any]:
    """Parameters of `tsid`, (33) and (34)."""
    return {
        "frame": FRAME,
        "goal": {"posture": GOAL},
        "task": {"kp": KP},
        "posture": {"posture": START, "kp": KP, "weight": WEIGHT},
        "bounds": bounds,
    }


def whole(kind: str, periods: float, **more: Any) -> dict[str, Any]:
    """Settings of bounds without any reserve."""
    none = dict.fromkeys(("acceleration_share", "speed_share", "brake_share"), 1.0)
    none |= dict.fromkeys(("margin_rad", "softness_rad"), 0.0)
    return {"kind": kind, "horizon_periods": periods, **none, **more}


def move(kind: str, periods: float, most: Array) -> Run:
    """One motion.

    Args:
        kind: of bounds: viability or naive.
        periods: T_b/δt.
        most: accelerations, (7,) [rad/s²].
    """
    robot = ideal_robot()
    lowered = np.minimum(most, robot.velocity / (periods * PERIOD_S))
    bounds = whole(kind, periods, acceleration_max=tuple(lowered.tolist()))
    parameters = TsidController.Parameters.model_validate(
        {**settings(**bounds), "compensate_friction": False}
    )
    controller, body, state = TsidController(robot, parameters), AccelerationServo(robot), State(7)
    body.reset(robot.initial_position)
    state.q[:] = state.reference[:] = body.q
    controller.reset(state, None)
    elbow, ticks = robot.joint_names.index(JOINT), round(SECONDS / PERIOD_S)
    columns, fallbacks = np.zeros((4, ticks)), 0
    for k in range(ticks):
        state.tick, state.q[:], state.dq[:] = k, body.q, body.dq
        command = controller.step(state)
        room = body.q[elbow] - robot.lower[elbow]
        columns[:, k] = room, body.dq[elbow], command.values[elbow], math.sqrt(2.0 * command.v)
        fallbacks += command.fallback != 0
        body.step(command.values, PERIOD_S)
    room, dq, a, error = columns
    return Run(room, dq, a, error, fallbacks)


def run_all(say: Say) -> Runs:
    """Every motion that the figure or a row shows."""
    say(f"Fig. 5: Algorithm 4, {SAMPLES:,} states")
    most, none = accelerations()
    ideal = {}
    for kind, several in SHOWN.items():
        for periods in several:
            say(f"Fig. 5: {kind} ×{periods:g}, {SECONDS:g} s")
            ideal[kind, periods] = move(kind, periods, most)
    return Runs(most, none, ideal)
