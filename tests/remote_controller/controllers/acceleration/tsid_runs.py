"""Motions of a Baxter arm that does exactly what task-space inverse dynamics asks for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hoap3.protocol.config.settings import parse
from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.robot.description import CommandKind, RobotDescription
from hoap3.remote_controller.config import ControllerConfig, build, read_config
from hoap3.remote_controller.controllers.acceleration.tsid import TsidController
from hoap3.robot_emulator.robots import load

EXACT = {
    "acceleration_share": 1.0,
    "margin_rad": 0.0,
    "speed_share": 1.0,
    "brake_share": 1.0,
    "softness_rad": 0.0,
}
ACCELERATIONS = (8.2, 2.0, 18.5, 31.0, 96.0, 98.0, 338.0)
"""Of the paper's Algorithm 4; s1, which it leaves none, has 2."""


def baxter(
    kind: CommandKind = "torque",
    period_s: float = 1e-3,
    fast: float | None = None,
    **changes: object,
) -> RobotDescription:
    """The left arm; `fast` is the greatest speed of its first four joints [rad/s]."""
    robot = load("baxter_left_arm")
    joints = [
        joint.model_copy(update={"velocity": fast}) if fast and place < 4 else joint
        for place, joint in enumerate(robot.joints)
    ]
    fields = {"command_kinds": (kind,), "period_s": period_s, "joints": tuple(joints)}
    return robot.model_copy(update={**fields, "initial_posture": "fig5_start", **changes})


def tsid(description: RobotDescription, **parameters: object) -> TsidController:
    """The shipped controller with some other parameters."""
    content, file = read_config("tsid_baxter")
    content["parameters"] = {**content["parameters"], **parameters}
    controller: TsidController = build(parse(ControllerConfig, content, file), description, file)
    controller.now = lambda: 0
    return controller


@dataclass
class Motion:
    """One row a tick."""

    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    tau: FloatArray
    v: FloatArray
    fallbacks: int


def exact_motion(controller: TsidController, duration: float) -> Motion:
    """What the accelerations that it finds give, each held for a period, and nothing else."""
    description = controller.description
    T, state = description.period_s, State(description.n)
    state.q[:] = description.initial_position
    controller.reset(state, None)
    rows: list[tuple[FloatArray, ...]] = []
    v, fallbacks = [], 0
    for tick in range(round(duration / T)):
        state.tick = tick
        command = controller.step(state)
        ddq = controller.solver.ddq.copy()
        rows.append((state.q.copy(), state.dq.copy(), ddq, controller.solver.tau.copy()))
        v.append(command.v)
        fallbacks += command.fallback > 0
        state.q[:] += T * state.dq + 0.5 * T * T * ddq
        state.dq[:] += T * ddq
    return Motion(*(np.array(each) for each in zip(*rows, strict=True)), np.array(v), fallbacks)
