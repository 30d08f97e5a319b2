"""`ghc_velocity`: strict where it says so, smooth where priorities move, and within its bounds."""

from __future__ import annotations

import numpy as np
import pytest
from ranked_runs import (
    COM,
    FOOT,
    FREE,
    HOAP3,
    POSTURE,
    answer,
    controller,
    joints,
    motion,
    point,
    settings,
    state_at,
)

from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError, UnknownNameError
from hoap3.remote_controller.config import ControllerConfig, check_parameters
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.controllers.velocity.ghc_velocity import CONDITIONS
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.tools.services.simulate import simulate

DT = HOAP3.period_s
READY = np.array(HOAP3.postures["walk_ready"])
TASKS = {"com": COM, "foot": FOOT, "posture": POSTURE}
MOVING = 1 << CONDITIONS.index("priorities in transition")


def com_rows(q):
    kinematics, J = Kinematics(HOAP3), np.zeros((3, HOAP3.n))
    number = kinematics.frame_id("r_sole")
    kinematics.update(np.array(q))
    kinematics.com(number, np.zeros(3), J)
    return J


def test_lower_tasks_do_not_change_what_the_upper_one_gets():
    """J_1·u is the same to 1e-9 with no, one or two tasks below, as nothing is bounded."""
    J = com_rows(READY)
    slow = {name: {**task, "gain_per_s": 0.5} for name, task in TASKS.items()}
    alone = J @ answer(controller(slow["com"], bounds=FREE), READY)
    assert np.linalg.norm(alone) > 1e-3
    for order in (["com", "foot"], ["com", "foot", "posture"], ["com", "posture", "foot"]):
        tasks = [slow[name] for name in order]
        made = controller(*tasks, priorities={"order": order}, bounds=FREE)
        u = answer(made, READY)
        assert made.command.solver_path == 0
        np.testing.assert_allclose(J @ u, alone, atol=1e-9, rtol=0.0)
        assert np.linalg.norm(u) > 1.1 * np.linalg.norm(J @ u)
    level = controller(*slow.values(), bounds=FREE)
    assert np.linalg.norm(J @ answer(level, READY) - alone) > 1e-3, "without an order they mix"


def test_a_task_that_is_inserted_below_leaves_the_motion_above_as_it_was():
    parameters = {"priorities": {"order": ["com", "foot"]}, "bounds": FREE}
    without = controller(
        COM, FOOT, priorities={"order": ["com", "foot"], "inactive": ["foot"]}, bounds=FREE
    )
    still = motion(without, 600)
    inserted = controller(
        COM,
        FOOT,
        bounds=FREE,
        priorities={
            "order": ["com", "foot"],
            "inactive": ["foot"],
            "timeline": [{"at_s": 0.2, "over_s": 0.1, "insert": "foot"}],
        },
    )
    moved = motion(inserted, 600)
    assert np.abs(moved["reference"][-1] - still["reference"][-1]).max() > 0.05
    # of the second order in the period: 1.5 % of the way in 0.6 s without it
    assert np.abs(moved["extra"][:, 0] - still["extra"][:, 0]).max() < 2e-5
    assert moved["extra"][-1, 0] < 0.1 * moved["extra"][0, 0]
    with_it = motion(controller(COM, FOOT, **parameters), 600)
    assert np.abs(with_it["extra"][:, 0] - still["extra"][:, 0]).max() < 2e-5


def largest_jump(over_s):
    """Of a joint velocity from tick to tick [rad/s], when two wishes for one thing swap."""
    elsewhere = {"frame": "r_sole", "target": point((-0.02, 0.0, 0.28))}
    made = controller(
        COM,
        {**COM, "name": "other", "parameters": elsewhere},
        POSTURE,
        priorities={
            "order": ["com", "other", "posture"],
            "timeline": [{"at_s": 0.4, "over_s": over_s, "set": [["com", "other", 1.0]]}],
        },
        bounds=FREE,
    )
    found = motion(made, 1000)
    assert found["extra"][398, 0] < 0.2 * found["extra"][398, 1]
    assert found["extra"][-1, 1] < 0.2 * found["extra"][-1, 0]
    return np.abs(np.diff(found["u"], axis=0))[390:].max()


def test_a_transition_makes_no_jump_and_at_once_makes_one():
    assert largest_jump(0.0) > 0.1
    assert largest_jump(0.4) < 0.03 * largest_jump(0.0)


def test_a_live_change_in_the_middle_of_a_transition_makes_no_jump():
    made = controller(
        COM,
        FOOT,
        POSTURE,
        priorities={
            "order": ["com", "foot", "posture"],
            "timeline": [{"at_s": 0.3, "over_s": 0.4, "set": [["foot", "posture", 1.0]]}],
        },
    )
    calls = {
        500: lambda: made.change({"set": [["foot", "posture", 0.0]], "over_s": 0.3}),
        600: lambda: made.change({"remove": "foot", "over_s": 0.3}),
    }

    def at_once():
        made.change({"remove": "com"})

    found = motion(made, 1000, calls)
    names = made.extra_names
    alpha = found["extra"][:, names.index("alpha_foot_posture")]
    assert 0.4 < alpha[499] < 0.6
    assert np.abs(np.diff(alpha)).max() < np.pi / 2.0 * DT / 0.3 * 1.001
    assert (alpha[505:560] < alpha[499]).all()
    assert alpha[-1] == 1.0
    # at once, a jump would be as large as the acceleration lets it, 0.04 rad/s
    assert np.abs(np.diff(found["u"], axis=0))[290:].max() < 8e-3
    sudden = motion(made, 520, {500: at_once})["u"]
    assert np.abs(np.diff(sudden, axis=0))[490:].max() > 0.039
    assert not np.isin(found["status"][301:890], [STATUS["certified"], STATUS["at_target"]]).any()
    assert (found["present"][301:890] & MOVING).all()


def test_within_its_bounds_the_robot_has_nothing_to_hold_back():
    """Far beyond reach, and in haste."""
    made = controller(
        {**COM, "gain_per_s": 80.0},
        {
            **FOOT,
            "gain_per_s": 80.0,
            "parameters": {**FOOT["parameters"], "target": point((0.3, 0.5, 0.4))},
        },
        priorities={
            "order": ["com", "foot"],
            "timeline": [{"at_s": 0.5, "set": [["com", "foot", 1.0]]}],
        },
        bounds={"speed_rad_s": 2.0},
    )
    found = motion(made, 1500)
    np.testing.assert_array_equal(found["reference"][1:], found["values"])
    speeds = np.diff(found["reference"], axis=0) / DT
    assert np.abs(speeds).max() <= 2.0 * (1 + 1e-9)
    assert np.abs(speeds).max() > 1.9
    braking = np.minimum(HOAP3.brake_acceleration, HOAP3.setpoint_acceleration_max)
    assert (np.abs(np.diff(speeds, axis=0)) <= braking * DT * (1 + 1e-6)).all()
    assert (found["reference"] >= HOAP3.lower).all()
    assert (found["reference"] <= HOAP3.upper).all()
    at_end = np.minimum(found["reference"][-1] - HOAP3.lower, HOAP3.upper - found["reference"][-1])
    assert (at_end < 1e-3).sum() >= 2, "some joints went to the end of their range"
    assert (found["fallback"] == 0).all()


NETWORK = [(2, 1), (3, 1), (3, 2), (5, 4), (6, 4), (6, 5), (5, 2)]
"""(i, j): task i is kept out of task j: 1▷2▷3, 4▷5▷6 and 2▷5."""


def tasks_of_joints():
    """Six tasks that contradict each other in single joints, and what each wants of them."""
    return {
        1: {"r_knee": 0.9, "l_knee": 0.5},
        2: {"r_knee": 0.4, "r_elbow": -1.0, "l_elbow": -0.5},
        3: {"l_knee": 0.9, "r_elbow": -0.5, "waist_pitch": 0.3},
        4: {"l_elbow": -1.0, "l_hip_roll": 0.1},
        5: {"l_hip_roll": -0.1, "r_elbow": -0.3, "l_shoulder_roll": 0.5},
        6: {"l_shoulder_roll": 0.2, "waist_pitch": 0.1, "l_elbow": -0.2},
    }


def test_a_network_that_is_no_order_keeps_out_exactly_those_that_it_names():
    wanted = tasks_of_joints()
    matrix = np.zeros((6, 6))
    for i, j in NETWORK:
        matrix[i - 1, j - 1] = 1.0
    made = controller(
        *(joints(f"t{number}", **targets) for number, targets in wanted.items()),
        priorities={"matrix": matrix.tolist()},
        bounds=FREE,
        regularisation=1e-6,
    )
    u = answer(made, READY)
    assert made.command.solver_path == 0
    expected = np.zeros(HOAP3.n)
    for i, targets in wanted.items():
        for name, target in targets.items():
            joint = list(HOAP3.joint_names).index(name)
            if not any(name in wanted[j] for a, j in NETWORK if a == i):
                expected[joint] += target - READY[joint]
    np.testing.assert_allclose(u, expected, atol=1e-5)


def test_a_cycle_is_legal_and_each_yields_to_the_next():
    tasks = [joints("a", r_knee=1.0), joints("b", r_knee=0.5), joints("c", r_knee=0.2)]
    cycle = {"matrix": [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]}
    made = controller(*tasks, priorities=cycle, bounds=FREE)
    assert np.abs(answer(made, READY)).max() < 1e-12
    assert made.command.v > 0.0, "all of them, as none is on top"
    assert made.command.solver_status == STATUS["uncertified"]


def test_it_follows_a_moving_target_with_its_velocity():
    target = {
        "kind": "circle",
        "center_m": [0.0, 0.02, 0.28],
        "plane": "xy",
        "radius_m": 0.01,
        "period_s": 2.0,
        "approach_s": 0.5,
    }
    moving = {**COM, "parameters": {"frame": "r_sole", "target": target}}
    found = motion(controller(moving, POSTURE, priorities={"order": ["com", "posture"]}), 1500)
    # without feed-forward it would lag by |w|/g = 0.031/5 m
    assert found["extra"][600:, 0].max() < 1e-4


def test_where_nothing_is_within_the_bounds_it_brakes():
    made = controller(COM, POSTURE, priorities={"order": ["com", "posture"]})
    found = motion(made, 120, {50: lambda: made.change({"remove": ["com", "posture"]})})
    after = np.abs(found["u"][50:])
    assert after[0].max() > 0.02
    assert found["fallback"][50] == 1
    assert found["status"][50] == STATUS["infeasible"]
    assert after[-1].max() < 1e-12
    assert (np.diff(after, axis=0) <= 1e-12).all()
    np.testing.assert_array_equal(found["reference"][1:], found["values"])
    assert (found["fallback"][-20:] == 0).all()


def test_its_v_is_that_of_the_tasks_on_top_and_changes_once_priorities_rest():
    made = controller(
        COM,
        FOOT,
        POSTURE,
        priorities={
            "order": ["com", "foot", "posture"],
            "timeline": [{"at_s": 0.2, "over_s": 0.1, "order": ["foot", "com"]}],
        },
    )
    found = motion(made, 400)
    com, foot = found["extra"][:, 0], found["extra"][:, 1]
    np.testing.assert_allclose(found["v"][:301], 0.5 * com[:301] ** 2, rtol=1e-12)
    np.testing.assert_allclose(found["v"][302:], 0.5 * foot[302:] ** 2, rtol=1e-12)
    certified = found["status"] == STATUS["certified"]
    assert certified[30:200].all()
    assert certified[305:].all()
    both = certified[:-1] & certified[1:]
    assert (np.diff(found["v"])[both] < 0.0).all()


def test_the_log_has_the_error_of_each_task_and_the_priorities_of_few():
    made = controller(COM, FOOT, priorities={"matrix": [[0.0, 0.25], [0.75, 0.5]]})
    answer(made, READY)
    assert made.extra_names == (
        "error_com",
        "error_foot",
        "alpha_com_com",
        "alpha_com_foot",
        "alpha_foot_com",
        "alpha_foot_foot",
    )
    assert made.command.extra[2:].tolist() == [0.0, 0.25, 0.75, 0.5]
    many = controller(*(joints(f"t{number}", r_knee=0.1 * number) for number in range(7)))
    assert many.extra_names == tuple(f"error_t{number}" for number in range(7))
    assert len(many.command.extra) == 7


def test_reset_begins_the_timeline_anew_and_forgets_live_changes():
    timeline = [{"at_s": 0.05, "over_s": 0.1, "set": [["foot", "posture", 1.0]]}]
    made = controller(
        COM, FOOT, POSTURE, priorities={"order": ["com", "foot", "posture"], "timeline": timeline}
    )
    first = motion(made, 200)
    disturbed = motion(made, 200, {20: lambda: made.change({"remove": "com", "over_s": 0.5})})
    again = motion(made, 200, first=7000)
    assert np.abs(disturbed["u"] - first["u"]).max() > 1e-3
    for name, rows in first.items():
        np.testing.assert_array_equal(rows, again[name], err_msg=name)


def test_a_state_that_is_not_finite_is_refused_and_spoils_no_later_one():
    spoilt, clean = (controller(COM, FOOT, priorities={"order": ["com", "foot"]}) for _ in "12")
    spoilt.reset(state_at(np.full(HOAP3.n, np.nan)), None)
    clean.reset(state_at(READY), None)
    assert np.isnan(spoilt.step(state_at(np.full(HOAP3.n, np.nan))).values).all()
    assert spoilt.command.solver_status == STATUS["infeasible"]
    assert spoilt.present == 1 << CONDITIONS.index("state not finite")
    for tick in range(1, 50):
        if tick == 20:
            assert np.isnan(spoilt.step(state_at(np.full(HOAP3.n, np.nan), tick)).values).all()
            continue
        expected = clean.step(state_at(READY, tick)).values
        np.testing.assert_array_equal(spoilt.step(state_at(READY, tick)).values, expected)


@pytest.mark.slow
def test_the_shipped_motion_is_what_its_comments_say():
    """The foot gets near its target, then yields to the posture; the centre of mass never does."""
    found = simulate("hoap3", "ghc_velocity", 8.0)
    com, foot, posture = found.setpoints["extra"][:, :3].T
    assert found.controller.extra_names[:3] == ("error_com", "error_foot", "error_posture")
    assert foot[3999] < 0.01
    assert foot[-1] > 0.045
    assert posture[3999] > 0.45
    assert posture[-1] < 0.1
    assert com[3500:].max() < 2e-6
    rest = found.setpoints["solver_status"]
    moving = (found.time[: len(rest)] > 4.0) & (found.time[: len(rest)] < 6.0)
    unproven = rest == STATUS["uncertified"]
    assert abs(int(unproven.sum()) - int(moving.sum())) < 5


BAD = [
    ({"tasks": []}, "tasks", ""),
    ({"tasks": [COM, COM]}, "tasks.1.name", "com"),
    ({"tasks": [{**COM, "task": "comm"}]}, "tasks.0.task", "'com'"),
    ({"tasks": [{**COM, "gain_per_s": 0.0}]}, "tasks.0.gain_per_s", "0.0"),
    ({"tasks": [{**COM, "name": "The CoM"}]}, "tasks.0.name", "The CoM"),
    ({"tasks": [{**FOOT, "parameters": {}}]}, "tasks.0.parameters.frame", ""),
    ({"priorities": {"order": ["com"]}}, "priorities.order", "foot"),
    ({"priorities": {"matrix": [[0.0]]}}, "priorities.matrix", "2"),
    (
        {"priorities": {"timeline": [{"at_s": 1.0, "remove": "posture"}]}},
        "priorities.timeline.0.remove",
        "posture",
    ),
    ({"regularisation": 1e-9}, "regularisation", "1e-09"),
    ({"smoothing": -1.0}, "smoothing", "-1.0"),
    ({"bounds": {"speed_rad_s": 0.0}}, "bounds.speed_rad_s", "0.0"),
]


@pytest.mark.parametrize(("changes", "key", "value"), BAD)
def test_what_is_wrong_for_any_robot_is_refused_without_one(changes, key, value):
    content = settings(COM, FOOT)
    content["parameters"].update(changes)
    with pytest.raises((ConfigError, UnknownNameError)) as caught:
        check_parameters(parse(ControllerConfig, content, "mine.yaml"), "mine.yaml")
    for part in (f"parameters.{key}", value, "mine.yaml"):
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("tasks", "changes", "key"),
    [
        ([COM], {"bounds": {"margin_rad": 1.0}}, "parameters.bounds.margin_rad"),
        (
            [{**COM, "parameters": {**COM["parameters"], "frame": "tail"}}],
            {},
            "parameters.tasks.0.parameters.frame",
        ),
        ([COM, {"task": "ranked_scalar:Tilted"}], {}, "parameters.tasks.1.task"),
    ],
)
def test_what_does_not_fit_the_robot_is_refused_by_its_key(tasks, changes, key):
    with pytest.raises(ConfigError) as caught:
        controller(*tasks, **changes)
    assert caught.value.key == key
    assert caught.value.file == "mine.yaml"


def test_it_shows_its_priorities_as_they_are_now():
    made = controller(COM, FOOT, priorities={"order": ["com", "foot"]})
    motion(made, 30, {10: lambda: made.change({"set": [["com", "foot", 0.5]], "over_s": 0.01})})
    shown = {"names": ["com", "foot"], "alpha": [[0.0, 0.5], [0.5, 0.0]], "moving": False}
    shown["out"] = []
    assert made.changeable()["priorities"] == shown


def test_a_live_change_that_is_wrong_is_refused_and_the_motion_goes_on():
    made = controller(COM, FOOT, priorities={"order": ["com", "foot"]})

    def wrong():
        with pytest.raises(ConfigError, match=r"'fot'.*'foot'"):
            made.change({"set": [["com", "fot", 0.5]]})

    expected = motion(controller(COM, FOOT, priorities={"order": ["com", "foot"]}), 60)
    np.testing.assert_array_equal(motion(made, 60, {30: wrong})["u"], expected["u"])
