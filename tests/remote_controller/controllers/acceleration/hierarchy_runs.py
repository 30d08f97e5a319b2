"""Controllers of hierarchies, and States of their robots."""

from __future__ import annotations

from typing import Any

import numpy as np

from hoap3.protocol.config.settings import parse
from hoap3.protocol.messages import State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.config import ControllerConfig, build, read_config
from hoap3.robot_emulator.service import describe
from hoap3.tools.services.configs import load_emulator_config

PLACES = {"lwr": "lwr_weightless", "humanoid32": "humanoid32_torque"}  # emulator configs


def robot(name: str = "lwr_weightless", **changes: Any) -> RobotDescription:
    """A robot as its shipped emulator config has it."""
    return describe(*load_emulator_config(name)).model_copy(update=changes)


def content(name: str, **parameters: Any) -> dict[str, Any]:
    """A shipped config with some other parameters."""
    found, _ = read_config(name)
    return {**found, "parameters": {**found["parameters"], **parameters}}


def made(name: str, description: RobotDescription | None = None, **parameters: Any) -> Any:
    """A shipped controller with some other parameters, whose clock stands still."""
    config = parse(ControllerConfig, content(name, **parameters), name)
    controller = build(config, description or robot(PLACES[config.robot]), name)
    controller.now = lambda: 0
    return controller


def state_of(controller: Any, q: np.ndarray, dq: np.ndarray, tick: int = 0) -> State:
    """A State of the controller's robot, which begins there at tick 0."""
    description = controller.description
    state = State(description.n, 6 * len(description.wrench_sensors))
    state.q[:], state.dq[:], state.tick = q, dq, tick
    if tick == 0:
        controller.reset(state, None)
    return state


def states(controller: Any, count: int, seed: int = 3, speed: float = 0.3) -> list[State]:
    """Random States, each the first of its motion."""
    robot, rng = controller.description, np.random.default_rng(seed)
    middle, span = 0.5 * (robot.upper + robot.lower), 0.5 * (robot.upper - robot.lower)
    return [
        state_of(
            controller,
            middle + 0.8 * span * rng.uniform(-1.0, 1.0, robot.n),
            speed * robot.velocity * rng.uniform(-1.0, 1.0, robot.n),
        )
        for _ in range(count)
    ]
