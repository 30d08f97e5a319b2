"""`hoap3 bench cycle`: what one answer costs the controller, from bytes to bytes."""

from __future__ import annotations

from typing import Any

from protocol.clock import MonotonicClock
from protocol.messages import State
from protocol.recorder import MemoryRecorder, NoRecorder
from protocol.ring import Kind
from remote_controller.config import build
from remote_controller.loop import ControllerLoop
from tools.bench.timing import time_calls
from tools.simulate import Lockstep, controller_settings, emulator_settings

WARM_UP = 200
PAPER_US = 272.2
"""CoM 160.95, Jacobian 109.85 and QP12 1.36, as the QP12 paper measured them in section V-B."""


def bench_cycle(controller: str = "qp12", samples: int = 5000) -> list[dict[str, Any]]:
    """Rows {solver, n, samples, min_us, …} of `step`, and of `answer`, over a logged motion.

    `step` is kinematics, solve and Euler integration; `answer` is all that the service does
    between the bytes of a State and the bytes of its Setpoint.
    """
    config = controller_settings(controller)
    log = MemoryRecorder()
    lockstep = Lockstep(emulator_settings("hoap3", 0), config, log, NoRecorder())
    lockstep.run((2 * samples + WARM_UP) * 1e-3)
    payloads = [record.payload for record in log.records if record.kind == Kind.STATE]
    description = lockstep.controller.description
    law = build(config, description)
    state = State(description.n)
    state.load(payloads[0])
    law.reset(state, None)
    step = time_calls(lambda _: law.step(state), samples, WARM_UP)
    loop = ControllerLoop(law, MonotonicClock(), NoRecorder(), state.session_id)
    loop.grant(1)
    following = iter(payloads)

    def answer(_: int) -> None:
        loop.answer(0, next(following))
        loop.sent()

    whole = time_calls(answer, samples, WARM_UP)
    rows: list[dict[str, Any]] = [
        {
            "solver": f"{controller} step",
            "n": description.n,
            **step,
            "paper": {"mean_us": PAPER_US},
        },
        {"solver": f"{controller} answer", "n": description.n, **whole, "paper": None},
    ]
    return rows
