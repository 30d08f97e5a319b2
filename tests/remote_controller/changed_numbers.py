"""A change of numbers for each shipped law, and runs in which it comes."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

import numpy as np

from hoap3.protocol.messages import State
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.config import ControllerConfig, build
from hoap3.remote_controller.controllers.base import Controller
from hoap3.remote_controller.loop import ControllerLoop
from hoap3.tools.services.simulate import Simulation, simulate
from hoap3.tools.testing.controller_case import ControllerCase, controller_case

LAWS: dict[str, dict[str, Any]] = {
    "qp12": {"gamma": 0.9, "beta": 20.0},
    "osqp": {"gamma": 0.2, "u_max_rad_s": 0.3},
    "pinv": {"beta": 20.0, "u_max_rad_s": 0.3},
    "stable_qp_hoap3": {
        "objective": {"gamma": 0.2},
        "psi": {"u_max_rad_s": 0.3, "beta": 20.0},
        "task": {"parameters": {"weights": [1.0, 2.0, 1.0]}},
        "constraints.support_polygon.parameters.eta_per_s": 5.0,
        "constraints.joint_velocity.parameters.limit_rad_s": 0.5,
    },
    "clik_ur5": {
        "tasks": {"hand": {"gain_per_s": 2.0, "weight": 3.0, "parameters": {"weights": [2.0]}}},
        "bounds.speed_rad_s": 0.4,
        "damping": 0.01,
    },
    "clik_sdp_ur5": {"tasks.0.weight": 2.0, "beta_per_s": 2.0, "delta": 0.1},
    "ghc_velocity": {
        "tasks.foot.gain_per_s": 3.0,
        "regularisation": 1e-5,
        "bounds": {"speed_rad_s": 0.3},
        "tasks.com.parameters.weights": [1.0, 1.0, 3.0],
    },
    "ghc": {
        "tasks.hand.kp": 40.0,
        "tasks.posture.kd": 9.0,
        "w_r": 1e-3,
        "null_damping_per_s": 5.0,
        "bounds.speed_share": 0.5,
    },
    "ghc_torque": {"tasks.hand.kp": 40.0, "w_r": 1e-3, "bounds.speed_share": 0.5},
    "hqp": {"tasks.hand.kp": 40.0, "w_r": 1e-3},
    "weighted": {"tasks.hand.kp": 40.0, "w_r": 1e-3, "null_damping_per_s": 5.0},
    "tsid": {"task.kp": 20.0, "posture.kp": 5.0, "bounds.speed_share": 0.5},
    "joint_acceleration": {"kp": 50.0, "kd": 20.0, "bounds.speed_share": 0.5},
}
"""By the config of a law: numbers in each way in which people may write them."""

WITH_CONSTRAINTS: dict[str, dict[str, Any]] = {
    "obstacle": {
        "constraints.joint_velocity.parameters.limit_rad_s": 0.4,
        "constraints.joint_position.parameters": {"eta_per_s": 5.0, "return_speed_rad_s": 0.2},
        "constraints.distance.parameters": {"eta_per_s": 4.0, "return_speed_m_s": 0.1},
        "psi.beta": 20.0,
    }
}
"""The same for a config whose constraints have numbers that change."""
REQUESTS = {**LAWS, **WITH_CONSTRAINTS}

TICK, OVER_S = 60, 0.03


def with_parameters(config: ControllerConfig, **parameters: Any) -> ControllerConfig:
    """A config with some parameters that are others."""
    return config.model_copy(update={"parameters": {**config.parameters, **parameters}})


def asking(requests: Mapping[int, Mapping[str, Any]]) -> Any:
    """What asks for changes after some ticks: a `steer` of `simulate`."""
    left = dict(requests)

    def steer(loop: ControllerLoop) -> None:
        request = left.pop(loop.last_tick, None)
        if request is not None:
            loop.change(json.dumps(request).encode())

    return steer


@cache
def changed_run(law: str) -> tuple[ControllerConfig, Simulation]:
    """A run of 150 ticks away from rest, in which the law's numbers change."""
    case = controller_case(law, None)
    config = case.config
    if law in {"ghc", "ghc_torque", "hqp"}:  # the posture first keeps all where they are
        config = with_parameters(config, priorities={"order": ["hand", "elbow", "posture"]})
    request = {**REQUESTS[law], "over_s": OVER_S}
    return config, simulate(case.emulator, config, 0.15, steer=asking({TICK: request}))


def states_of(done: Simulation) -> Iterator[State]:
    """The States of a run, in one message that each rewrites."""
    state: State | None = None
    for record in done.records:
        if record.kind == Kind.STATE:
            state = state or State.like(record.payload)
            state.load(record.payload)
            yield state


def answers(
    controller: Controller, done: Simulation, requests: Mapping[int, Mapping[str, Any]]
) -> np.ndarray[Any, Any]:
    """What a controller would send to the States of a run, (ticks, n), with changes before some."""
    found, begun = [], False
    for number, state in enumerate(states_of(done)):
        if not begun:
            controller.reset(state, None)
            begun = True
        if number in requests:
            controller.change(requests[number])
        command = controller.step(state)
        found.append(np.concatenate([command.values, command.decision]))
    return np.array(found)


def built(case: ControllerCase, config: ControllerConfig) -> Controller:
    """A controller of a config for the robot of a case, whose clock stands still."""
    controller: Controller = build(config, case.robot, case.name)
    controller.now = lambda: 0
    return controller
