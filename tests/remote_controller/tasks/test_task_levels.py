"""Which controller serves which task; what does not fit is refused by key when it is built."""

from __future__ import annotations

import re

import numpy as np
import pytest
from task_cases import ARM
from task_rows import ROWS

from benchmarks.tables.tasks_table import (
    OWN_ERROR,
    OWN_V,
    level,
    of_tasks,
    serves,
    takes,
)
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import State
from hoap3.remote_controller.config import ControllerConfig, build
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.tasks.registry import BUILTIN
from hoap3.tools.services.simulate import simulate

V_ONLY, ERROR = {"task": "own_tasks:Sway"}, {"task": "own_tasks:Reach"}
TASKS = {name: (robot, {"task": name, "parameters": given}) for robot, name, given in ROWS.values()}
TASKS |= {OWN_ERROR: (ARM, ERROR), OWN_V: (ARM, V_ONLY)}
WITH_V = {"task": "weighted_sum", "parameters": {"terms": [ERROR, V_ONLY]}}
SEVERAL = [name for name in of_tasks() if takes(name) == "tasks"]


def made(controller, robot, task):
    """A controller with one task, for a robot that takes what it gives."""
    parameters = {takes(controller): [task] if controller in SEVERAL else task}
    config = ControllerConfig(controller=controller, robot=robot.name, parameters=parameters)
    kind = "position" if level(controller) == "velocity" else "torque"
    return build(config, robot.model_copy(update={"command_kinds": (kind,)}), "mine.yaml")


def key(controller):
    return f"parameters.{'tasks.0' if controller in SEVERAL else 'task'}.task"


def answers(controller, ticks=3):
    """What it answers to a robot that moves a little."""
    robot = controller.description
    controller.now = lambda: 0
    q, dq = np.array(robot.initial_position), 0.05 * np.ones(robot.n)
    for tick in range(ticks):
        state = State(robot.n, 6 * len(robot.wrench_sensors))
        state.tick, state.dq[:] = tick, dq
        state.q[:] = state.reference[:] = q + 1e-3 * tick * dq
        if tick == 0:
            controller.reset(state, None)
        yield controller.step(state)


def test_every_task_is_tried():
    assert {*BUILTIN, OWN_ERROR, OWN_V} <= set(TASKS)


@pytest.mark.parametrize("controller", of_tasks())
@pytest.mark.parametrize("task", TASKS)
def test_a_cell_of_the_table_is_so(controller, task):
    if not serves(controller, task):
        with pytest.raises(ConfigError, match=rf"^mine.yaml: {re.escape(key(controller))}: "):
            made(controller, *TASKS[task])
        return
    for answer in answers(made(controller, *TASKS[task])):
        assert np.isfinite(answer.values).all()
        assert answer.solver_status != STATUS["infeasible"]
        assert answer.fallback == 0 or controller == "clik_sdp"  # has no gains for V = 0
    assert answer.v > 0.0


@pytest.mark.parametrize("controller", SEVERAL)
@pytest.mark.parametrize(("task", "term"), [(V_ONLY, ""), (WITH_V, "parameters.terms.1.")])
def test_several_tasks_are_followed_by_their_errors(controller, task, term):
    place = key(controller).removesuffix("task") + term + "task"
    with pytest.raises(ConfigError) as caught:
        made(controller, ARM, task)
    assert caught.value.key == place
    assert caught.value.value == V_ONLY["task"]


def test_what_makes_v_decrease_serves_a_sum_with_a_v_alone():
    assert all(answer.v > 0.0 for answer in answers(made("stable_qp", ARM, WITH_V)))


def test_no_task_of_tsid_has_the_name_of_its_posture():
    with pytest.raises(ConfigError, match=r"^mine.yaml: parameters.tasks.0.name: "):
        made("tsid", ARM, {**ERROR, "name": "rest"})


@pytest.mark.parametrize("controller", [name for name in of_tasks() if level(name) == "velocity"])
def test_no_velocity_is_a_force(controller):
    with pytest.raises(ConfigError) as caught:
        made(controller, *TASKS["wrench"])
    assert (caught.value.key, caught.value.value) == (key(controller), "wrench")


@pytest.mark.parametrize("controller", [name for name in of_tasks() if level(name) == "velocity"])
def test_a_curve_is_circulated_at_its_speed(controller):
    """The row of the speed is followed beside those of the error, and the error stays small."""
    joints = {"joints": ["joint_2", "joint_4"], "radii_rad": [0.3, 0.2]}
    curve = {"curve_parameters": joints, "speed_rad_s": 0.4}
    task = {"task": "joint_curve", "parameters": curve}
    parameters = {takes(controller): [task] if controller in SEVERAL else task}
    run = simulate("lwr", {"controller": controller, "parameters": parameters}, duration=0.5)
    speeds = np.linalg.norm(np.diff(run.states["q"], axis=0), axis=1) / 1e-3
    assert speeds[400:495] == pytest.approx(0.4, rel=1e-3)
    assert np.sqrt(2.0 * run.setpoints["v"][495]) < 1e-3
