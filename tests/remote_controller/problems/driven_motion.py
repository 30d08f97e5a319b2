"""A controller of accelerations or torques in its loop, with a robot that the test makes up."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hoap3.protocol.config.settings import parse, parse_yaml
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.protocol.runtime.recorder import MemoryRecorder
from hoap3.protocol.runtime.shm_ring import Record
from hoap3.remote_controller.loop import ControllerLoop
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.remote_controller.registry import find
from hoap3.robot_emulator.robots import load

CONFIGS = Path(__file__).parents[3] / "remote_controller" / "configs"
SESSION = 7


def recorded_motion(
    config: str,
    robot: str,
    ticks: int,
    *,
    command: str = "torque",
    gravity: str = "none",
    start: str | None = None,
    changes: Mapping[int, Mapping[str, Any]] | None = None,
    targets: Mapping[int, bytes] | None = None,
    seed: int = 0,
    lost: float = 0.0,
    unseen: float = 0.0,
    noise: float = 0.0,
    ignored: float = 0.0,
    pauses: tuple[int, ...] = (),
    pressed: Mapping[int, float] | None = None,
    not_finite: tuple[int, ...] = (),
    **parameters: object,
) -> tuple[list[Record], dict[str, Any]]:
    """The records of a controller of a shipped config, and its parameters.

    The made-up robot moves by the q̈ of the answers; one that takes positions commands these.

    Args:
        config, robot, command, gravity, start: which, and the posture that it starts in.
        ticks: how many States.
        changes, targets: requests, and messages of live targets, by the tick before they come.
        seed, lost, unseen, noise: of answers and of States, shares; and of q [rad] and dq.
        ignored: share of ticks at which half of the joints do not command what was sent.
        pauses: ticks at which the robot follows nobody.
        pressed: by tick, the force on all wrench sensors from then on, along the root's z [N].
        not_finite: ticks whose State has a joint velocity that is NaN.
        parameters: in place of those of the config.
    """
    random, description = np.random.default_rng(seed), load(robot)
    update = {"gravity": gravity, "command_kinds": (command,)}
    description = description.model_copy(update=update)
    content = parse_yaml((CONFIGS / f"{config}.yaml").read_text(encoding="utf-8"), config)
    given = {**content["parameters"], **parameters}
    known = find(content["controller"])
    parsed = parse(known.Parameters, given, config, "parameters")
    controller = known.configured(description, parsed, config)
    clock, recorder = VirtualClock(1_000), MemoryRecorder()
    loop = ControllerLoop(controller, clock, recorder, SESSION)
    loop.begin(description, lockstep=True)
    loop.grant(1)
    model, n, T = Robot(description), description.n, description.period_s
    place = description.initial_posture if start is None else start
    q, dq, ddq = np.array(description.postures[place]), np.zeros(n), np.zeros(n)
    state, force = State.allocate(**description.state_lengths), 0.0
    answer = Setpoint.like(controller.command.dump())
    for tick in range(ticks):
        force = (pressed or {}).get(tick, force)
        state.session_id, state.tick, state.epoch = SESSION, tick, 1
        state.mode = State.IDLE if tick in pauses else State.ACTIVE
        state.stamp_published = 1_000_000 * (tick + 1)
        state.reference[:] = q
        state.q[:] = q + noise * random.normal(size=n)
        state.dq[:] = dq + noise * random.normal(size=n)
        for i, sensor in enumerate(description.wrench_sensors):
            model.place(q)
            _, axes, _ = model.in_root(sensor)
            felt = axes.T @ np.array([0.0, 0.0, force]) + noise * random.normal(size=3)
            state.wrench[6 * i : 6 * i + 3] = felt
        if tick in not_finite:
            state.dq[0] = np.nan
        if tick in (changes or {}):
            loop.change(json.dumps(changes[tick]).encode())
        if tick in (targets or {}):
            loop.steer("test", targets[tick])
        if random.random() >= unseen:
            payload = loop.answer(clock.now(), state.dump())
            loop.sent()
            if payload is not None and random.random() >= lost:
                answer.load(payload)
                ddq = np.nan_to_num(answer.decision[:n])
            elif payload is None:
                ddq, dq = np.zeros(n), np.zeros(n)  # at rest
        before, q = q, q + T * dq + 0.5 * T**2 * ddq
        dq = dq + T * ddq
        if command == "position" and answer.tick == tick and np.isfinite(answer.values).all():
            q = answer.values.copy()
            if random.random() < ignored:
                q[: n // 2] = before[: n // 2]
    return list(recorder.records), given
