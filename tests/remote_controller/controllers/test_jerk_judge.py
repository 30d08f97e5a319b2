"""A controller knows beforehand what a robot with a limit of jerk will hold back."""

from __future__ import annotations

import numpy as np
import pytest
from support.command_bench import inside
from support.small_arm import arm

from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.controllers.jerk_judge import MEMORY, JerkJudge, judge_of
from hoap3.robot_emulator.filters.jerk import JerkFilter
from hoap3.tools.logs.log import Log

T = 1e-3
ROBOT = arm(
    joints=tuple(
        joint.model_copy(update={"setpoint_jerk_max": 2e4, "setpoint_acceleration_max": 200.0})
        for joint in arm().joints
    )
)


@pytest.mark.parametrize("seed", range(5))
def test_it_foresees_what_the_robot_takes_over(seed):
    rng = np.random.default_rng(seed)
    robot, judge = JerkFilter(ROBOT, T), JerkJudge(ROBOT)
    robot.reset(ROBOT.initial_position)
    v, a, earlier = np.zeros((3, 3))
    right = taken = 0
    for tick in range(3000):
        wild = tick % 200 > 180
        a = 0.98 * a - 2.0 * v + 20.0 * rng.uniform(-1.0, 1.0, 3) * (3.0 if wild else 0.9)
        answer = robot.value + (v + a * T) * T
        held = judge.holds_back(answer, robot.value, at_rest=tick == 0, followed=tick > 0)
        truly = robot.follow(answer, tick) >= 0
        assert held or not truly
        right, taken = right + (held == truly), taken + (not truly)
        v, earlier = robot.rate.copy(), v
        a = (v - earlier) / T
    assert right > 0.98 * 3000
    assert 1000 < taken < 2990


def test_after_a_state_that_was_missed_it_waits_until_it_knows_again():
    judge, place = JerkJudge(ROBOT), ROBOT.initial_position.copy()
    assert not judge.holds_back(place, place, at_rest=True, followed=False)
    assert not judge.holds_back(place, place, at_rest=False, followed=True)
    assert judge.holds_back(place, place, at_rest=False, followed=False)
    for _ in range(MEMORY - 1):
        assert judge.holds_back(place, place, at_rest=False, followed=True)
    assert not judge.holds_back(place, place, at_rest=False, followed=True)


def test_without_a_limit_that_counts_there_is_none():
    assert judge_of(arm()) is None
    assert judge_of(ROBOT) is not None


def test_no_answer_that_the_robot_held_back_is_certified(tmp_path):
    smooth = "--set", "emulator.setpoint_jerk_max=250"
    given = "--robot", "ur5", "--controller", "qp12", "--duration", "0.4"
    inside("run", "--lockstep", *given, *smooth, "--out", tmp_path)
    log = Log.open(tmp_path, side="robot")
    payloads = [record.payload for record in log.records() if record.kind == Kind.STATE]
    states = np.frombuffer(b"".join(payloads), State.schema.dtype(log.description.state_lengths))
    follows = states[states["mode"] == State.ACTIVE]  # at the end it brakes instead
    applied = dict(zip(follows["tick"].tolist(), follows["reference"], strict=True))
    held = 0
    for record in Log.open(tmp_path, side="controller").records():
        if record.kind == Kind.SETPOINT:
            answer = Setpoint.allocate(**Setpoint.schema.lengths_in(record.payload))
            answer.load(record.payload)
            following = applied.get(answer.tick + 1, answer.values)
            if not np.array_equal(answer.values, following):
                assert answer.solver_status != STATUS["certified"]
                held += 1
    assert held > 0
