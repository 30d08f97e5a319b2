"""`hoap3 bench cycle`: what one answer costs the controller, from bytes to bytes."""

from __future__ import annotations

from typing import Any

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.messages import State
from hoap3.protocol.runtime.clock import MonotonicClock
from hoap3.protocol.runtime.recorder import MemoryRecorder, NoRecorder
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.config import ControllerConfig, build
from hoap3.remote_controller.loop import ControllerLoop
from hoap3.tools.bench.reference import reference
from hoap3.tools.bench.timing import BATCH, BLOCKS, SETTLE, Contender, Report, race, silent
from hoap3.tools.simulate import Lockstep, controller_settings, emulator_settings

STATES = 512
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
    config = controller_settings(controller)
    description, payloads = motion(config, samples + BLOCKS * (SETTLE + BATCH))
    step = _step(f"{controller} step", config, description, payloads)
    answer = _answer(f"{controller} answer", config, description, payloads)
    times = race([step, answer, reference()], samples, report=report)
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


def motion(config: ControllerConfig, ticks: int) -> tuple[RobotDescription, list[bytes]]:
    """The robot that a controller's config names, and so many States of a motion of it, or more."""
    log = MemoryRecorder()
    lockstep = Lockstep(emulator_settings(config.robot, 0), config, log, NoRecorder())
    lockstep.run((ticks + 1) * 1e-3)
    payloads = [record.payload for record in log.records if record.kind == Kind.STATE]
    return lockstep.controller.description, payloads


def _step(
    name: str, config: ControllerConfig, description: RobotDescription, payloads: list[bytes]
) -> Contender:
    law = build(config, description)
    states = []
    for payload in payloads[:: max(1, len(payloads) // STATES)]:
        state = State.allocate(**description.state_lengths)
        state.load(payload)
        states.append((state,))
    law.reset(states[0][0], None)
    return Contender(name, law.step, states)


def _answer(
    name: str, config: ControllerConfig, description: RobotDescription, payloads: list[bytes]
) -> Contender:
    state = State.allocate(**description.state_lengths)
    state.load(payloads[0])
    loop = ControllerLoop(
        build(config, description), MonotonicClock(), NoRecorder(), state.session_id
    )
    loop.grant(state.epoch)

    def answer(payload: bytes) -> None:
        loop.answer(0, payload)
        loop.sent()

    return Contender(name, answer, [(payload,) for payload in payloads])
