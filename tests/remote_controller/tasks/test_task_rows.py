"""What tasks of accelerations say of their errors' motion, against differences along a motion."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from task_cases import ARM, CIRCLE, HOAP3, TOOL
from task_rows import (
    MORE,
    ROWS,
    Rows,
    acceleration_tasks,
    force_tasks,
    motion_through,
    rows_of,
    slope,
)

STEP = 1e-4  # s
CLOSE = 1e-6  # relative
SEEDS, TIMES = range(3), (0.31, 0.83, 1.9)  # between the corners of the cases' targets
each_case = pytest.mark.parametrize("case", ROWS)
each_seed = pytest.mark.parametrize("seed", SEEDS)


def near(found, expected):
    """Equal to 10⁻⁶ of the largest row, or of 1."""
    scale = max(1.0, float(np.max(np.abs(expected), initial=0.0)))
    np.testing.assert_allclose(found, expected, rtol=0, atol=CLOSE * scale)


def along(q, dq, ddq):
    """q and q̇ at a time from now."""
    return lambda s: (q + s * dq + 0.5 * s * s * ddq, dq + s * ddq)


def copied(tasks):
    """What the rows say, kept."""
    names = "jacobian", "error", "motion", "rate", "slope", "wanted"
    return SimpleNamespace(**{name: getattr(tasks, name).copy() for name in names})


def test_every_registered_task_is_tried():
    assert {task for _, task, _ in ROWS.values()} == set(acceleration_tasks())
    assert force_tasks() == {"wrench"}


@each_case
@each_seed
def test_the_motion_changes_by_j_ddq_and_the_rate(case, seed):
    rows, time_s = rows_of(case), TIMES[seed]
    q, dq, ddq = motion_through(rows.robot, seed)
    there = along(q, dq, ddq)
    said = copied(rows.look(q, dq, time_s))
    change = slope(lambda s: rows.motion(*there(s), time_s + s), STEP)
    near(said.jacobian @ ddq + said.rate, change)


@each_case
@each_seed
def test_v_changes_by_slope_times_motion(case, seed):
    rows, time_s = rows_of(case), TIMES[seed]
    q, dq, ddq = motion_through(rows.robot, seed)
    there = along(q, dq, ddq)
    said = copied(rows.look(q, dq, time_s))
    change = slope(lambda s: rows.value(*there(s), time_s + s), STEP)
    near(said.slope @ said.motion, change)


@each_case
@each_seed
def test_the_jacobian_is_how_velocities_move_the_rows(case, seed):
    rows, time_s = rows_of(case), TIMES[seed]
    q, dq, _ = motion_through(rows.robot, seed)
    jacobian = rows.look(q, dq, time_s).jacobian.copy()
    still = rows.motion(q, dq, time_s)
    columns = [rows.motion(q, dq + axis, time_s) - still for axis in np.eye(rows.robot.n)]
    near(jacobian, np.transpose(columns))


@each_case
@each_seed
def test_what_is_wanted_is_spring_and_damper(case, seed):
    """J·q̈ = wanted has ν's rate be kp·e − kd·ν, the error as the row has it."""
    rows, time_s = rows_of(case), TIMES[seed]
    q, dq, _ = motion_through(rows.robot, seed)
    said = copied(rows.look(q, dq, time_s))
    kp = 10.0
    near(said.wanted + said.rate, kp * said.error - 2.0 * np.sqrt(kp) * said.motion)


@pytest.mark.parametrize("case", ["tool", "hand", "palm", "palm's pose", "tool turns", "com"])
def test_a_target_is_where_an_acceleration_held_for_a_period_leads(case):
    """What the target's velocity gains in it is its acceleration, not that of its beginning."""
    period = 1e-3
    rows, time_s = rows_of(case, period), TIMES[1]
    q, dq, ddq = motion_through(rows.robot, 5)
    there = along(q, dq, ddq)
    said = copied(rows.look(q, dq, time_s))
    drift = slope(lambda s: rows.motion(*there(s), time_s), STEP)
    gained = (rows.motion(q, dq, time_s + period) - rows.motion(q, dq, time_s)) / period
    near(said.jacobian @ ddq + said.rate, drift + gained)


COMPILED = {
    "tool": "tool by differences",
    "tool at a point": "tool at a point, by differences",
    "tool held": "tool held, by differences",
    "tool in a pose": "pose by differences",
    "tool in a posture's": "posture's by differences",
    "tool's pose held": "pose held, by differences",
    "arm": "arm by differences",
    "some joints": "joints by differences",
    "palm": "palm by differences",
    "head": "head by differences",
}


def both_ways(case):
    """A task by its kernel, and the same one by differences: weights of 1 change nothing else."""
    robot, task, parameters = ROWS[case]
    ways = Rows(robot, (task, parameters)), Rows(robot, (task, {**parameters, "weights": [1.0]}))
    assert not ways[0].tasks._functions
    assert ways[1].tasks._functions
    return ways


@pytest.mark.parametrize("case", COMPILED)
@each_seed
def test_a_kernel_says_the_same_as_differences(case, seed):
    """Of a pose the motion is a twist in the one and ė in the other: there e and V̇ agree."""
    said = []
    for rows in both_ways(case):
        q, dq, _ = motion_through(rows.robot, seed)
        said.append(copied(rows.look(q, dq, TIMES[seed])))
    compiled, followed = said
    near(compiled.error, followed.error)
    near(compiled.slope @ compiled.motion, followed.slope @ followed.motion)
    if "pose" not in ROWS[case][1]:
        for name in ("jacobian", "motion", "rate", "slope", "wanted"):
            near(getattr(compiled, name), getattr(followed, name))


@pytest.mark.parametrize("task", ["frame_position", "frame_pose"])
def test_a_reference_that_joints_move_is_followed_by_differences(task):
    (target,) = [{**CIRCLE, "center_m": [0.1, 0.0, 0.1]}]
    seen_from = {"frame": "tool", "reference": "forearm", "target": target}
    assert Rows(ARM, (task, seen_from)).tasks._functions


@each_case
def test_beginning_anew_forgets_and_repeats_bit_by_bit(case):
    used, new = rows_of(case, 1e-3), rows_of(case, 1e-3)

    def follow(rows):
        start = np.array(rows.robot.initial_position)
        middle = 0.5 * (rows.robot.lower + rows.robot.upper)
        dq = 0.3 * (middle - start)
        for tick in range(20):
            said = copied(rows.look(start + 1e-3 * tick * dq, dq, 1e-3 * tick))
            yield [array.tobytes() for array in vars(said).values()]

    expected = list(follow(new))
    for seed in SEEDS:
        q, dq, _ = motion_through(used.robot, seed)
        used.begin(7.0 + seed, q)
        used.look(q, dq, 8.5 + seed)
    used.begin()
    assert list(follow(used)) == expected


@pytest.mark.parametrize("robot", [ARM, HOAP3, *{MORE["palm"][0].name: MORE["palm"][0]}.values()])
def test_tasks_beside_each_other_say_what_each_says_alone(robot):
    """One pass over the robot serves all, whichever way they are followed."""
    cases = [case for case in ROWS if ROWS[case][0].name == robot.name]
    together = Rows(robot, *(ROWS[case][1:] for case in cases))
    alone = [rows_of(case) for case in cases]
    q, dq, _ = motion_through(robot, 1)
    for time_s in TIMES:
        said = copied(together.look(q, dq, time_s))
        for rows, each in zip(together.tasks.rows, alone, strict=True):
            expected = copied(each.look(q, dq, time_s))
            for name, array in vars(expected).items():
                np.testing.assert_array_equal(getattr(said, name)[rows], array)


@each_case
def test_rows_are_laid_out_once(case):
    rows = rows_of(case)
    tasks = rows.tasks
    kept = [getattr(tasks, name) for name in ("jacobian", "error", "motion", "rate", "wanted")]
    q, dq, _ = motion_through(rows.robot, 0)
    rows.look(q, dq, 0.4)
    now = [getattr(tasks, name) for name in ("jacobian", "error", "motion", "rate", "wanted")]
    assert all(one is other for one, other in zip(kept, now, strict=True))
    assert all(np.isfinite(array).all() for array in now)


def test_errors_are_those_of_the_velocity_level():
    """The same words, the same judgement: |e| of a point, whichever controller asks."""
    rows = Rows(ARM, ("frame_position", {**TOOL, "axes": ["z"]}), ("frame_position", TOOL))
    q, dq, _ = motion_through(ARM, 2)
    rows.look(q, dq, 0.2)
    lengths = [np.linalg.norm(rows.tasks.error[mine]) for mine in rows.tasks.rows]
    told = [rows.tasks.errors_of(i)[0] for i in range(2)]
    assert [error.error for error in told] == pytest.approx(lengths)
