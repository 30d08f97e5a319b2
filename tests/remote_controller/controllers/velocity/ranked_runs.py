"""`ghc_velocity` with tasks of a test's own, and motions tick by tick."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hoap3.protocol.config.settings import parse
from hoap3.protocol.messages import State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.config import ControllerConfig, build
from hoap3.robot_emulator.robots import load
from hoap3.testing import Body

HOAP3 = load("hoap3")


def point(position_m, **more: Any) -> dict[str, Any]:
    return {"kind": "point", "position_m": list(position_m), **more}


COM = {
    "name": "com",
    "task": "com",
    "parameters": {"frame": "r_sole", "target": point((0.01, 0.02, 0.28))},
}
FOOT = {
    "name": "foot",
    "task": "frame_position",
    "parameters": {
        "frame": "l_sole",
        "reference": "r_sole",
        "target": point((0.05, 0.1, 0.05)),
    },
}
POSTURE = {"name": "posture", "task": "posture", "parameters": {"posture": "q0"}}
FREE = {"acceleration_rad_s2": 1200.0}  # as fast as the robot lets them; no test reaches that


def joints(name: str, **targets: float) -> dict[str, Any]:
    """A posture task of some joints."""
    wanted = {"joints": list(targets), "target_rad": list(targets.values())}
    return {"name": name, "task": "posture", "gain_per_s": 1.0, "parameters": wanted}


def settings(*tasks: Mapping[str, Any], **parameters: Any) -> dict[str, Any]:
    return {"controller": "ghc_velocity", "parameters": {"tasks": [*tasks], **parameters}}


def controller(
    *tasks: Mapping[str, Any], robot: RobotDescription = HOAP3, **parameters: Any
) -> Any:
    content = settings(*tasks, **parameters)
    built = build(parse(ControllerConfig, content, "mine.yaml"), robot, "mine.yaml")
    built.now = lambda: 0
    return built


def state_at(q, tick: int = 0) -> State:
    """HOAP-3 at rest in a posture."""
    state = State(HOAP3.n, 6 * len(HOAP3.wrench_sensors))
    state.mode, state.tick = State.ACTIVE, tick
    state.q[:] = state.reference[:] = q
    return state


def answer(made: Any, q) -> np.ndarray:
    """Joint velocities for a robot at rest in a posture, (n,)."""
    state = state_at(q)
    made.reset(state, None)
    made.step(state)
    return made.u.copy()


def motion(
    made: Any,
    ticks: int,
    meanwhile: Mapping[int, Callable[[], None]] | None = None,
    first: int = 0,
) -> dict[str, np.ndarray]:
    """A motion from the initial posture, with the robot at its tick `first`.

    `meanwhile` is called before the step of its tick since then.
    """
    body = Body(HOAP3)
    body.state.tick = body.state.epoch_from_tick = first
    made.reset(body.state, None)
    rows: dict[str, list[Any]] = {"u": [], "extra": [], "status": [], "v": [], "fallback": []}
    reference, values, present = [body.state.reference.copy()], [], []
    for tick in range(ticks):
        (meanwhile or {}).get(tick, lambda: None)()
        command = made.step(body.state)
        rows["u"].append(made.u.copy())
        rows["extra"].append(command.extra.copy())
        rows["status"].append(command.solver_status)
        rows["v"].append(command.v)
        rows["fallback"].append(command.fallback)
        values.append(command.values.copy())
        present.append(made.present)
        body.follow(command.values)
        reference.append(body.state.reference.copy())
    found = {name: np.array(row) for name, row in rows.items()}
    return {
        **found,
        "reference": np.array(reference),
        "values": np.array(values),
        "present": np.array(present),
    }
