"""A velocity controller in its loop, driven by a robot that the test makes up; and its run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hoap3.protocol.config.settings import parse, parse_yaml
from hoap3.protocol.messages import Setpoint, State, Target
from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.protocol.runtime.recorder import MemoryRecorder
from hoap3.protocol.runtime.shm_ring import Record
from hoap3.remote_controller.loop import ControllerLoop
from hoap3.remote_controller.references.live.live import collected
from hoap3.remote_controller.registry import find
from hoap3.robot_emulator.robots import load
from hoap3.tools.verify.controller_log import ControllerRun, runs

CONFIGS = Path(__file__).parents[3] / "remote_controller" / "configs"
SESSION = 7


def driven(
    config: str,
    robot: str,
    ticks: int,
    *,
    posture: str | None = None,
    changes: Mapping[int, Mapping[str, Any]] | None = None,
    seed: int = 0,
    lost: float = 0.0,
    unseen: float = 0.0,
    noise: float = 0.0,
    pauses: tuple[int, ...] = (),
    **parameters: object,
) -> tuple[ControllerRun, dict[str, Any]]:
    """The run of `recorded`, and the controller's parameters."""
    records, given = recorded(
        config,
        robot,
        ticks,
        posture=posture,
        changes=changes,
        seed=seed,
        lost=lost,
        unseen=unseen,
        noise=noise,
        pauses=pauses,
        **parameters,
    )
    return next(iter(runs(records))), given


def recorded(
    config: str,
    robot: str,
    ticks: int,
    *,
    posture: str | None = None,
    changes: Mapping[int, Mapping[str, Any]] | None = None,
    targets: Mapping[int, bytes] | None = None,
    seed: int = 0,
    lost: float = 0.0,
    unseen: float = 0.0,
    noise: float = 0.0,
    pauses: tuple[int, ...] = (),
    **parameters: object,
) -> tuple[list[Record], dict[str, Any]]:
    """What the controller of a shipped config answers to a made-up robot; and its parameters.

    Args:
        config, robot, posture: which, and where it starts.
        ticks: how many States.
        changes, targets: requests, and messages of live targets, by the tick before they come.
        seed, lost, unseen, noise: of answers and of States, shares; and of what is measured [rad].
        pauses: ticks at which the robot is idle.
        parameters: in place of those of the config.
    """
    random, description = np.random.default_rng(seed), load(robot)
    content = parse_yaml((CONFIGS / f"{config}.yaml").read_text(encoding="utf-8"), config)
    given = {**content["parameters"], **parameters}
    known = find(content["controller"])
    parsed = parse(known.Parameters, given, config, "parameters")
    with collected() as live:
        controller = known.configured(description, parsed, config)
    controller.live = tuple(live)
    controller.begin_changes()
    clock, recorder = VirtualClock(1_000), MemoryRecorder()
    loop = ControllerLoop(controller, clock, recorder, SESSION)
    loop.begin(description, lockstep=True)
    loop.grant(1)
    place = description.initial_posture if posture is None else posture
    reference = np.array(description.postures[place])
    state, answer = State(description.n), Setpoint.like(controller.command.dump())
    for tick in range(ticks):
        state.session_id, state.tick, state.epoch = SESSION, tick, 1
        state.mode = State.IDLE if tick in pauses else State.ACTIVE
        state.stamp_published = 1_000_000 * (tick + 1)
        state.reference[:] = reference
        state.q[:] = reference + noise * random.normal(size=description.n)
        state.dq[:] = noise * random.normal(size=description.n)
        if tick in (changes or {}):
            loop.change(json.dumps(changes[tick]).encode())
        if tick in (targets or {}):
            target = Target.like(targets[tick])
            target.load(targets[tick])
            target.session_id = SESSION
            target.epoch = loop.steering.acquire("test", 1, loop.last_tick)["epoch"]
            loop.steer("test", target.dump())
        if random.random() < unseen:
            continue
        payload = loop.answer(clock.now(), state.dump())
        loop.sent()
        if payload is not None and random.random() >= lost:
            answer.load(payload)
            reference = answer.values.copy()
    return list(recorder.records), given
