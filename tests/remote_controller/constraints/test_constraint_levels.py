"""Which controller takes which constraint; what does not fit is refused by key when it is built."""

from __future__ import annotations

import re

import numpy as np
import pytest
from registered_constraints import cases

from benchmarks.tables.constraints_table import serves
from benchmarks.tables.tasks_table import level, of_tasks, takes
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import State
from hoap3.remote_controller.config import ControllerConfig, build
from hoap3.remote_controller.constraints.registry import BUILTIN, ConstraintSettings
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.registry import of_constraints
from hoap3.robot_emulator.robots import load

TORQUES = ConstraintSettings(constraint="joint_torque", parameters={"limit_nm": 1e3})
TRIED = {case.settings.constraint: (case.robot, case.settings) for case in reversed(cases())}
TRIED["joint_torque"] = load("hoap3"), TORQUES  # says nothing about u, so it is none of the cases


def made(controller, robot, given):
    """A controller that keeps a posture and one constraint."""
    task = {"task": "posture", "parameters": {"target_rad": [*map(float, robot.initial_position)]}}
    key = takes(controller)
    parameters = {key: [task] if key == "tasks" else task, "constraints": [given.model_dump()]}
    config = ControllerConfig(controller=controller, robot=robot.name, parameters=parameters)
    kind = "position" if level(controller) == "velocity" else "acceleration"
    return build(config, robot.model_copy(update={"command_kinds": (kind,)}), "mine.yaml")


def test_every_constraint_is_tried():
    assert set(BUILTIN) <= set(TRIED)


@pytest.mark.parametrize("controller", of_constraints())
@pytest.mark.parametrize("constraint", TRIED)
def test_a_cell_of_the_table_is_so(controller, constraint):
    robot, given = TRIED[constraint]
    if not serves(controller, constraint):
        with pytest.raises(ConfigError) as refused:
            made(controller, robot, given)
        assert refused.value.key == "parameters.constraints.0.constraint"
        assert refused.value.value == constraint
        return
    found = made(controller, robot, given)
    found.now = lambda: 0
    (kept,) = found.stack.constraints
    assert constraint == given.constraint
    assert any(f"held by {label}" in found.conditions for label in found.stack.labels)
    inside = np.clip(robot.initial_position, robot.lower + 0.02, robot.upper - 0.02)
    for tick in range(3):
        state = State(robot.n, 6 * len(robot.wrench_sensors))
        state.tick, state.q[:] = tick, inside
        state.reference[:] = state.q
        if tick == 0:
            found.reset(state, None)
        answer = found.step(state)
        assert np.isfinite(answer.values).all()
        assert answer.solver_status != STATUS["infeasible"]
        assert answer.margin <= kept.margin() or not kept.margins.size


@pytest.mark.parametrize(
    "controller", [each for each in of_tasks() if each not in of_constraints()]
)
def test_who_takes_none_says_who_does(controller):
    takers = re.escape(", ".join(of_constraints()))
    refused = f"^mine.yaml: parameters.constraints: .*{controller}.* {takers}"
    with pytest.raises(ConfigError, match=refused):
        made(controller, load("hoap3"), TRIED["half_space"][1])
