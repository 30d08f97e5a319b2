"""What settings of hierarchies promise, and when they certify nothing, at single States."""

from __future__ import annotations

import numpy as np
import pytest
from hierarchy_runs import made, robot, state_of, states
from support.solvers.one_shot import ghc

from hoap3.remote_controller.controllers.acceleration.problem import CONDITIONS
from hoap3.remote_controller.controllers.base import STATUS

FREE = {"kind": "none", "torque_max": [1e4]}
STILL = np.zeros(7)


def posture(name: str = "bent") -> np.ndarray:
    return np.array(robot().postures[name])


def said(controller, condition: str) -> bool:
    return bool(controller.present >> CONDITIONS.index(condition) & 1)


def test_a_joint_that_begins_beyond_its_margin_may_stay():
    controller = made("ghc")
    q = posture()
    q[3] = controller.description.upper[3] - 0.001  # the margin is 0.004 rad
    controller.step(state_of(controller, q, STILL))
    assert controller.bounds.lower[3] < 0.0
    assert controller.bounds.upper[3] == pytest.approx(0.0, abs=1e-6)
    controller.bounds.begin(posture())
    controller.bounds.update(q, STILL)
    assert controller.bounds.upper[3] < -1e-3  # it would be drawn back


def test_weights_follow_their_timeline():
    timeline = [{"at_s": 0.01, "over_s": 0.02, "weights": {"hand": 0.0}}]
    timeline += [{"at_s": 0.02, "weights": {"elbow": 3.0}}]
    for changes in (timeline, timeline[::-1]):
        controller = made("weighted", priorities={"timeline": changes})
        state = state_of(controller, posture(), STILL)
        hand = controller.extra_names.index("weight_hand")
        seen = []
        for state.tick in range(40):
            seen.append(controller.step(state).extra[hand : hand + 2].copy())
        found = np.array(seen)
        assert (found[:11, 0] == 1.0).all()
        assert found[20, 0] == pytest.approx(0.5)
        assert (found[30:, 0] == 0.0).all()
        np.testing.assert_array_equal(found[:, 1], np.where(np.arange(40) < 20, 1.0, 3.0))


@pytest.mark.parametrize("smoothing", [0.0, 0.3])
def test_smoothing_is_the_solvers(smoothing):
    controller = made(
        "ghc",
        bounds=FREE,
        smoothing=smoothing,
        priorities={"order": ["hand", "elbow", "posture"]},
    )
    tasks = controller.tasks
    answers = []
    for state in states(controller, 5):
        controller.reset(state, None)
        controller.step(state)
        arguments = (
            [tasks.jacobian[rows] for rows in tasks.rows],
            [tasks.wanted[rows] for rows in tasks.rows],
            np.tril(np.ones((3, 3)), -1),
            tasks.dynamics.mass,
            tasks.dynamics.bias,
            controller.w_r,
        )
        given = {"regularise": "torque"}
        ddq, _ = ghc(*arguments, **given, smoothing=smoothing)
        np.testing.assert_allclose(controller.ddq, ddq, atol=1e-9 * np.abs(ddq).max())
        other, _ = ghc(*arguments, **given, smoothing=0.3 - smoothing)
        answers.append(np.abs(ddq - other).max() / np.abs(ddq).max())
    assert max(answers) > 1e-3


def test_friction_that_is_not_compensated_is_left_to_the_robot():
    arm = robot("baxter_left_arm", command_kinds=("torque",))
    rest = [{"name": "rest", "task": "posture"}]
    taus = []
    for compensate in (True, False):
        controller = made(
            "ghc",
            arm,
            tasks=rest,
            regularise="none",
            bounds=FREE,
            priorities={},
            compensate_friction=compensate,
        )
        speeds = np.linspace(-0.5, 0.7, 7)
        controller.step(state_of(controller, np.array(arm.initial_position), speeds))
        taus.append(controller.tau.copy())
    friction = controller.tasks.dynamics.damping
    assert friction.min() > 0.0
    end = speeds + controller.description.period_s * controller.ddq
    np.testing.assert_allclose(taus[0] - taus[1], friction * end, rtol=1e-9)


def test_the_nearest_answer_is_nearest_to_what_the_tasks_would_do():
    """Tasks that keep each other out of all but joint 7, on an arm that has to sag at joint 2."""
    arm = robot(gravity="full")
    both = {"task": "posture", "parameters": {"posture": "table1"}, "kp": 5.0}
    six = {"posture": "table1", "joints": arm.joint_names[:6]}
    tasks = [{**both, "name": "all"}, {**both, "name": "six", "parameters": six}]
    given = {"tasks": tasks, "priorities": {"matrix": [[0.0, 1.0], [1.0, 0.0]]}}
    given |= {"regularise": "none", "null_damping_per_s": 0.0}
    q = posture()
    strong = made("ghc", arm, **given)
    assert strong.step(state_of(strong, q, STILL)).fallback == 0
    wish = strong.ddq.copy()
    assert np.flatnonzero(np.abs(wish) > 1e-9).tolist() == [6]
    most = strong.torque_max.copy()
    most[1] = 0.98 * abs(strong.tau[1])
    weak = made("ghc", arm, bounds={"torque_max": most.tolist()}, **given)
    assert weak.step(state_of(weak, q, STILL)).fallback == 1
    assert abs(wish[6]) > 1.0
    assert np.linalg.norm(weak.ddq - wish) < 0.5 * np.linalg.norm(wish)


def test_nothing_is_certified_within_bounds_that_may_leave_a_joint_unable_to_stop():
    for kind, status in (("viability", "certified"), ("naive", "uncertified")):
        controller = made("ghc", bounds={"kind": kind})
        command = controller.step(state_of(controller, posture(), STILL))
        assert command.fallback == 0
        assert command.solver_status == STATUS[status]


def test_nothing_is_certified_where_a_joint_cannot_hold_its_load():
    arm = robot(gravity="full")
    order = {"order": ["hand", "elbow", "posture"]}
    for share, status in ((1.1, "certified"), (0.99, "uncertified")):
        strong = made("ghc", arm, priorities=order)
        strong.step(state_of(strong, posture(), STILL))
        most = share * float(np.abs(strong.tasks.dynamics.bias).max())
        weak = made("ghc", arm, priorities=order, bounds={"torque_max": [most]})
        command = weak.step(state_of(weak, posture(), STILL))
        assert command.fallback == 0
        assert said(weak, "cannot hold its load") == (share < 1.0)
        assert command.solver_status == STATUS[status]
