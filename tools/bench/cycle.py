"""`hoap3 bench cycle`: what one answer costs the controller, from bytes to bytes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hoap3.protocol.messages import State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.clock import MonotonicClock
from hoap3.protocol.runtime.recorder import MemoryRecorder, NoRecorder
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.config import ControllerConfig, build
from hoap3.remote_controller.loop import ControllerLoop
from hoap3.tools.bench.case_runner import (
    BATCH,
    BLOCKS,
    SETTLE,
    Case,
    Report,
    reference,
    silent,
    time_cases,
)
from hoap3.tools.services.configs import load_controller_config, load_emulator_config
from hoap3.tools.services.simulate import Lockstep

STATES, MOTION_STATES = 512, 256
FIRST = 10  # State of a motion: those before belong to the start
PAPER_US = 272.2
"""CoM 160.95, Jacobian 109.85 and QP12 1.36, as the QP12 paper measured them in section V-B."""


def bench_cycle(
    controller: str = "qp12", samples: int = 5000, report: Report = silent
) -> list[dict[str, Any]]:
    """Rows {solver, n, samples, min_us, …} of `step`, of `answer`, and of the fixed reference.

    `step` is kinematics, solve and Euler integration; `answer` is all that the service does
    between the bytes of a State and the bytes of its Setpoint. Both walk along a motion
    of the robot that the config names.
    """
    ticks = samples + BLOCKS * (SETTLE + BATCH)
    robot = load_controller_config(controller)[0].robot
    config, description, payloads = record_motion(robot, controller, (ticks + 1) * 1e-3)
    step = _step(f"{controller} step", config, description, payloads)
    answer = _answer(f"{controller} answer", config, description, payloads)
    times = time_cases([step, answer, reference()], samples, report=report)
    paper = {"mean_us": PAPER_US} if description.name == "hoap3" else None
    return [
        {
            "solver": name,
            "n": description.n,
            **taken.figures(),
            "times_reference": taken.times(times["reference"]),
            "paper": paper if name == step.name else None,
        }
        for name, taken in times.items()
    ]


def record_motion(
    emulator: str | Mapping[str, Any], controller: str | Mapping[str, Any], duration: float
) -> tuple[ControllerConfig, RobotDescription, list[bytes]]:
    """A controller's config, its robot, and the States of a motion of `duration` [s] in lockstep.

    Args:
        emulator, controller: names of configs, or settings.
        duration: of the motion [s].
    """
    log, config = MemoryRecorder(), load_controller_config(controller)[0]
    lockstep = Lockstep(load_emulator_config(emulator, seed=0)[0], config, log, NoRecorder())
    lockstep.run(duration)
    return config, lockstep.controller.description, log.payloads(Kind.STATE)


def motion(
    emulator: str | Mapping[str, Any],
    controller: str | Mapping[str, Any],
    duration: float,
    *,
    every: bool = False,
) -> tuple[Any, list[State]]:
    """A controller after its reset, and States of a motion in lockstep, in their order.

    Args:
        emulator, controller, duration: as of `record_motion`.
        every: whether all States are wanted, not only some 256 of them.
    """
    config, description, payloads = record_motion(emulator, controller, duration)
    stride = 1 if every else max(1, len(payloads) // MOTION_STATES)
    states = [_state(description, payload) for payload in payloads[FIRST::stride]]
    law = build(config, description)
    law.reset(states[0], None)
    return law, states


def _state(description: RobotDescription, payload: bytes) -> State:
    state = State.allocate(**description.state_lengths)
    state.load(payload)
    return state


def _step(
    name: str, config: ControllerConfig, description: RobotDescription, payloads: list[bytes]
) -> Case:
    law = build(config, description)
    some = payloads[:: max(1, len(payloads) // STATES)]
    states = [(_state(description, payload),) for payload in some]
    law.reset(states[0][0], None)
    return Case(name, law.step, states)


def _answer(
    name: str, config: ControllerConfig, description: RobotDescription, payloads: list[bytes]
) -> Case:
    state = _state(description, payloads[0])
    loop = ControllerLoop(
        build(config, description), MonotonicClock(), NoRecorder(), state.session_id
    )
    loop.grant(state.epoch)

    def answer(payload: bytes) -> None:
        loop.answer(0, payload)
        loop.sent()

    return Case(name, answer, [(payload,) for payload in payloads])
