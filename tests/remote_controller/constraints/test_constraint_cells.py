"""Every task, in every controller, under every constraint: half a second without a violation."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from support.constraint_bench import ROUNDING, StatedDrift
from test_constraint_levels import TRIED

from benchmarks.tables.constraints_table import serves
from benchmarks.tables.tasks_table import level, takes
from hoap3.protocol.messages import Setpoint, State
from hoap3.remote_controller.config import ControllerConfig, build
from hoap3.remote_controller.controllers.acceleration.problem import (
    GAVE_UP,
    OVERLOADED_MOTORS,
    STOPPED,
)
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.registry import of_constraints
from hoap3.robot_emulator.robots import load

ROBOT, TICKS, T = load("hoap3"), 500, 1e-3
START = np.clip(ROBOT.initial_position, ROBOT.lower + 0.02, ROBOT.upper - 0.02)
HAND = {"frame": "r_forearm", "reference": "pelvis"}
THERE = {"target": {"kind": "point", "position_m": [0.06, -0.16, 0.06], "approach_s": 0.5}}
TURN = {"rotation_rad": [0.3, 0.1, -0.2], "turn_s": 0.5}
POSTURE = {"target_rad": [*map(float, START + 0.05)], "approach_s": 0.5}
JOINTS = {"joints": ["r_elbow", "l_elbow"], "radii_rad": [0.1, 0.1]}
ELLIPSE = {"center_m": [0.0, 0.03, 0.28], "radii_m": [0.02, 0.01]}
TASKS: dict[str, dict[str, Any]] = {  # a wrench needs a sensor, which this robot has not
    "com": {"target": {"kind": "point", "position_m": [0.01, 0.025, 0.28], "approach_s": 0.5}},
    "frame_position": {**HAND, **THERE},
    "frame_pose": {**HAND, **THERE, **TURN},
    "frame_orientation": {**HAND, **TURN},
    "posture": POSTURE,
    "weighted_sum": {"terms": [{"task": "posture", "parameters": POSTURE}, {"task": "com"}]},
    "joint_curve": {"curve_parameters": JOINTS, "speed_rad_s": 0.2},
    "task_curve": {"curve_parameters": ELLIPSE, "speed_m_s": 0.02},
}
NEAR = {"distance": {}}  # the watched pairs are those of everyday use, not all
CELLS = [
    cell for cell in product(TASKS, of_constraints(), sorted(TRIED)) if serves(cell[1], cell[2])
]
BY_DEFAULT = sorted(np.random.default_rng(18).choice(len(CELLS), 12, replace=False))


def made(task: str, controller: str, constraint: str) -> Any:
    """A controller with one task and one constraint."""
    wish, key = {"task": task, "parameters": TASKS[task]}, takes(controller)
    given = NEAR.get(constraint, TRIED[constraint][1].parameters)
    entry = {"constraint": constraint, "parameters": given}
    parameters = {key: [wish] if key == "tasks" else wish, "constraints": [entry]}
    kind = "position" if level(controller) == "velocity" else "acceleration"
    robot = ROBOT.model_copy(update={"command_kinds": (kind,)})
    config = ControllerConfig(controller=controller, robot="hoap3", parameters=parameters)
    found = build(config, robot, "cell")
    found.now = lambda: 0
    return found


def keeps_velocities(controller: Any, answer: Setpoint) -> None:
    """There is an answer, within the bounds, the rows and the equations."""
    stack, u = controller.stack, controller.u
    assert answer.solver_status != STATUS["infeasible"]
    assert (u >= stack.lower - ROUNDING).all()
    assert (u <= stack.upper + ROUNDING).all()
    assert (stack.A @ u <= stack.b + ROUNDING).all()
    assert np.abs(stack.C @ u - stack.c).max(initial=0.0) <= ROUNDING


def keeps_accelerations(controller: Any, answer: Setpoint, kept: Any) -> None:
    """Accelerations obey bounds, torques and rows; all but the rows where the robot stops.

    It never stops for equations, nor for what is invariant.
    """
    stack, ddq = controller.stack, controller.ddq
    slack = ROUNDING * controller.bounds.greatest
    assert (ddq >= controller.lower - slack).all()
    assert (ddq <= controller.upper + slack).all()
    assert answer.fallback != GAVE_UP
    if answer.fallback not in {OVERLOADED_MOTORS, STOPPED}:
        most = controller.torque_max
        assert (np.abs(controller.tau) <= most * (1.0 + ROUNDING)).all()
    if answer.fallback == STOPPED:
        assert kept.guarantee not in {"invariant", "bounded drift"}
    else:
        length = np.linalg.norm(stack.rows, axis=1) + 1e-300
        value = stack.rows @ ddq
        assert (value >= stack.rows_lower - 1e-4 * ROUNDING - ROUNDING * length).all()
        assert (value <= stack.rows_upper + ROUNDING * length).all()


def fixed(kept: Any, controller: str) -> StatedDrift:
    """What is known of the frame that the cells keep."""
    of, order = kept.parameters, 2 if level(controller) == "velocity" else 3
    seen_from = of.reference or ROBOT.base_frame
    return StatedDrift(ROBOT, of.frame, seen_from, of.axes, of.eta_per_s, order, START)


def run(task: str, controller: str, constraint: str, ticks: int = TICKS) -> None:
    """In lockstep with a robot that does just what it is told."""
    found = made(task, controller, constraint)
    (kept,) = found.stack.constraints
    frame = fixed(kept, controller) if constraint == "fixed_frame" else None
    state = State(ROBOT.n, 0)
    state.q[:] = state.reference[:] = START
    found.reset(state, None)
    promised = kept.guarantee in {"invariant", "conditional"}
    for tick in range(ticks):
        state.tick = tick
        answer = found.step(state)
        assert np.isfinite(answer.values).all()
        if promised:
            assert kept.margin() >= -ROUNDING, tick
        if frame is not None:
            assert kept.drift() == pytest.approx(frame.drift(state.q), abs=1e-12)
            assert kept.drift() <= frame.most, tick
        elif kept.guarantee == "bounded drift":
            assert kept.drift() <= ROUNDING, tick  # its matrix is constant
        if level(controller) == "velocity":
            keeps_velocities(found, answer)
            state.dq[:] = (answer.values - state.q) / T
            if frame is not None:
                frame.move(state.q, state.dq)
            state.q[:] = state.reference[:] = answer.values
        else:
            keeps_accelerations(found, answer, kept)
            if frame is not None:
                frame.move(state.q, state.dq, answer.values)
            state.q += T * state.dq + 0.5 * T * T * answer.values
            state.dq += T * answer.values
            state.reference[:] = state.q


@pytest.mark.parametrize("cell", [CELLS[place] for place in BY_DEFAULT], ids="-".join)
def test_a_cell_keeps_its_limits(cell):
    run(*cell)


@pytest.mark.long
@pytest.mark.parametrize("cell", CELLS, ids="-".join)
def test_every_cell_keeps_its_limits(cell):
    run(*cell)
