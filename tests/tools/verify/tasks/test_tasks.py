"""Tasks that `verify` recomputes: against the product's own, and against difference quotients."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.model.model_reference import cross_matrix
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.remote_controller.problems.oracles.tasks.config_oracle import (
    UnverifiableError,
    default_entry,
    task_of,
)
from hoap3.remote_controller.problems.oracles.tasks.logarithm_oracle import (
    angular_velocity,
    pose_logarithm,
    rotation_of,
    rotation_vector,
)
from hoap3.remote_controller.tasks.accelerations.by_differences import TaskRows, TasksByDifferences
from hoap3.remote_controller.tasks.registry import TaskSettings, build
from hoap3.robot_emulator.robots import load

T = 1e-3
EIGHT = {
    "kind": "lemniscate",
    "center_m": [0.01, 0.02, 0.25],
    "half_width_m": 0.02,
    "period_s": 2.0,
    "plane": "yz",
    "direction": "backward",
}
CIRCLE = {"kind": "circle", "center_m": [0.2, 0.0, 0.1], "radius_m": 0.05, "period_s": 3.0}
WAY = {"kind": "waypoints", "points_m": [[0.1, 0.0, 0.2], [0.1, 0.1, 0.2]]}
TIMED = {**WAY, "times_s": [0.5, 1.1]}
EVEN = {**WAY, "speed_m_s": 0.4, "profile": "trapezoid"}
POINT = {"kind": "point", "position_m": [0.01, 0.025, 0.28], "approach_s": 1.0}
TURN = {"rotation_rad": [0.4, -1.1, 0.6], "turn_s": 2.0}
HAND = {"frame": "r_forearm", "reference": "l_sole"}
TOOL = {"frame": "tool0", "reference": "base"}
XYZ = "t,z,x,y\n0.2,0.28,0.01,0.03\n0.7,0.27,0.02,0.03\n1.1,0.28,0.01,0.02\n"
PATH = {"kind": "trajectory", "csv": XYZ, "interpolation": "quintic", "time_scaling": 0.8}
TURNS = "0,0.1,0.2,0.3,1,0,0,0\n0.5,0.1,0.2,0.4,0.6,0,0.8,0\n1.2,0,0.2,0.4,0,0,-0.8,0.6\n"
TURNING = {"kind": "trajectory", "csv": "t,x,y,z,qx,qy,qz,qw\n" + TURNS, "interpolation": "cubic"}
ELBOW = "t,elbow_joint,elbow_joint/velocity,elbow_joint/acceleration\n"
JOINTS = {
    "kind": "trajectory",
    "csv": ELBOW + "0,1.4,0.3,1\n0.5,1.2,-0.2,0.5\n1.3,1.5,0,0\n",
    "approach_s": 0.3,
}
SUM = [
    {"weight": 3.0, "task": "com", "parameters": {"target": POINT}},
    {"weight": 0.5, "task": "frame_pose", "parameters": {**HAND, **TURN, "target": CIRCLE}},
]
ZX, WEIGHTS = {"axes": ["z", "x"], "weights": [1.0, 3.0]}, {"weights": [1.0, 2.0, 0.5]}
CASES = {
    "com": ("hoap3", "com", {"frame": "l_sole", "target": EIGHT, "weights": [1.0, 2.0, 0.0]}),
    "com that stays": ("humanoid32", "com", {"frame": "r_sole"}),
    "hand": ("hoap3", "frame_position", {**HAND, "target": CIRCLE}),
    "tool": ("ur5", "frame_position", {**TOOL, "target": EVEN}),
    "elbow": ("lwr", "frame_position", {"frame": "elbow", "target": TIMED}),
    "hand's z and x": ("hoap3", "frame_position", {**HAND, **ZX, "target": CIRCLE}),
    "hand pose": ("hoap3", "frame_pose", {**HAND, **TURN, "target": CIRCLE}),
    "tool pose": ("ur5", "frame_pose", {**TOOL, **TURN, "target": EVEN, "weights": [2.0]}),
    "pose of a posture": ("baxter_left_arm", "frame_pose", {"frame": "left_gripper"}),
    "pose that stays": ("humanoid32", "frame_pose", {"frame": "head"}),
    "hand orientation": ("hoap3", "frame_orientation", {**HAND, **TURN, **WEIGHTS}),
    "orientation that stays": ("ur5", "frame_orientation", TOOL),
    "posture": ("hoap3", "posture", {"posture": "walk_ready", "approach_s": 1.0}),
    "some joints": (
        "ur5",
        "posture",
        {"joints": ["wrist_1_joint", "elbow_joint"], "target_rad": [0.2, 1.1]},
    ),
    "sum": ("hoap3", "weighted_sum", {"terms": SUM}),
    "tool trajectory": ("ur5", "frame_position", {**TOOL, "target": PATH, "axes": ["z", "x"]}),
    "pose trajectory": ("ur5", "frame_pose", {**TOOL, "target": TURNING}),
    "turn beside a trajectory": ("ur5", "frame_pose", {**TOOL, **TURN, "target": PATH}),
    "com trajectory": ("hoap3", "com", {"frame": "l_sole", "target": {**PATH, "csv": XYZ}}),
    "posture trajectory": ("ur5", "posture", {"target": JOINTS}),
    "straight posture": ("ur5", "posture", {"target": {**JOINTS, "interpolation": "linear"}}),
}


@cache
def described(name: str) -> RobotDescription:
    return load(name)


def begun(case: str):
    """Ours and the product's, begun in the same place, and what else is needed to look."""
    name, task, parameters = CASES[case]
    description = described(name)
    if case == "pose of a posture":
        parameters = {**parameters, "posture": list(description.postures)[-1]}
    robot, kinematics = Robot(description), Kinematics(description)
    ours = task_of({"task": task, "parameters": parameters}, robot)
    theirs = build(TaskSettings(task=task, parameters=parameters), description, kinematics)
    robot.place(description.initial_position)
    kinematics.update(description.initial_position)
    ours.begin(robot, 0.4)
    theirs.reset(kinematics, 0.4)
    return description, robot, kinematics, ours, theirs


def places(description: RobotDescription, number: int = 3):
    """Joint positions and velocities, and times: on the way and beyond it."""
    random = np.random.default_rng(7)
    for k in range(number):
        q = random.uniform(description.lower, description.upper)
        yield q, random.uniform(-1.0, 1.0, description.n), 0.4 + 0.61 * k


@pytest.mark.parametrize("case", CASES)
def test_a_task_is_that_of_the_product(case: str) -> None:
    description, robot, kinematics, ours, theirs = begun(case)
    for q, _, time_s in places(description):
        robot.place(q)
        kinematics.update(q)
        theirs.update(kinematics, time_s)

        rows = ours.at(robot, time_s)

        for found, wanted in zip(rows, theirs.followed, strict=False):
            size = max(1.0, np.abs(wanted).max())
            np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-11 * size)
        robot.place_only(q)
        np.testing.assert_allclose(ours.error_at(robot, time_s), rows.error, rtol=0, atol=1e-14)
        assert rows.value == pytest.approx(theirs.value, rel=1e-11)
        assert rows.value_rate == pytest.approx(theirs.rate, rel=1e-10, abs=1e-13)
        np.testing.assert_allclose(rows.gradient, theirs.gradient, rtol=0, atol=1e-10)


@pytest.mark.parametrize("case", CASES)
def test_its_jacobian_and_its_rate_are_difference_quotients(case: str) -> None:
    description, robot, _, ours, _ = begun(case)
    step = 1e-6
    for q, dq, time_s in places(description, 2):

        def error(share: float, later: float, q=q, dq=dq, time_s=time_s):
            robot.place(q + share * dq)
            return ours.at(robot, time_s + later).error

        robot.place(q)
        rows = ours.at(robot, time_s + step)
        moved = (error(step, step) - error(-step, step)) / (2.0 * step)
        np.testing.assert_allclose(rows.jacobian @ dq, moved, atol=1e-7)
        later = (error(0.0, 2.0 * step) - error(0.0, 0.0)) / (2.0 * step)
        np.testing.assert_allclose(rows.rate, later, atol=1e-6)


@pytest.mark.parametrize("case", CASES)
def test_how_it_moves_is_what_the_product_finds(case: str) -> None:
    description, robot, kinematics, ours, theirs = begun(case)
    m = len(theirs.followed[0])
    out = TaskRows(np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m), np.zeros((m, description.n)))
    product = TasksByDifferences([theirs], [out], kinematics, T)
    for q, dq, time_s in places(description):
        product.update(q, dq, time_s, time_s + T)

        motion, rate = ours.motion(robot, q, dq, time_s, T)

        np.testing.assert_allclose(motion, out.motion, atol=1e-9)
        np.testing.assert_allclose(rate, out.rate, atol=2e-7 * max(1.0, np.abs(rate).max()))


@pytest.mark.parametrize("name", ["hoap3", "ur5", "humanoid32"])
def test_what_a_frame_accelerates_by_is_the_rate_of_its_twist(name: str) -> None:
    description = described(name)
    robot, step = Robot(description), 1e-6
    frame = description.frames[-1]
    for q, dq, _ in places(description):
        for own in (False, True):
            twists = []
            for share in (step, -step):
                robot.place(q + share * dq)
                robot.move(dq)
                twists.append(robot.frame_motion(frame, own_axes=own)[1])
            robot.place(q)
            robot.move(dq)
            J, twist, drift = robot.frame_motion(frame, own_axes=own)
            np.testing.assert_allclose(J @ dq, twist, atol=1e-12)
            quotient = (twists[0] - twists[1]) / (2.0 * step)
            np.testing.assert_allclose(drift, quotient, atol=1e-6 * max(1.0, np.abs(drift).max()))


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 0.3, 0.999, 1.001, 2.9, np.pi - 1e-7])
def test_the_logarithm_is_exact_at_every_angle(angle: float) -> None:
    from scipy.linalg import expm, logm

    axis, t = np.array([0.6, -0.64, 0.48]), np.array([0.3, -0.2, 0.7])
    R = rotation_of(angle * axis)
    e, rates = pose_logarithm(t, R)
    np.testing.assert_allclose(e[3:], angle * axis, atol=1e-9)

    def twisted(vector):
        top = np.hstack([cross_matrix(vector[3:]), vector[:3, None]])
        return np.vstack([top, np.zeros((1, 4))])

    np.testing.assert_allclose(expm(twisted(e))[:3], np.hstack([R, t[:, None]]), atol=1e-9)
    if angle < 3.0:
        motion = np.array([0.2, 0.5, -0.4, 0.3, 0.1, -0.6])
        pose, rate = np.eye(4), np.zeros((4, 4))
        pose[:3, :3], pose[:3, 3] = R, t
        rate[:3, :3], rate[:3, 3] = twisted(np.r_[0, 0, 0, motion[3:]])[:3, :3] @ R, motion[:3]
        both = np.real(logm(np.block([[pose, rate], [np.zeros((4, 4)), pose]])))[:4, 4:]
        wanted = np.r_[both[:3, 3], both[2, 1], both[0, 2], both[1, 0]]
        np.testing.assert_allclose(rates @ motion, wanted, atol=1e-7)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 0.099, 0.101, 2.0, 3.1])
def test_a_rotation_and_its_angular_velocity_are_those_of_the_exponential(angle: float) -> None:
    from scipy.linalg import expm, expm_frechet

    phi, rate = angle * np.array([0.6, -0.64, 0.48]), np.array([0.3, 0.5, -0.2])
    R, turning = expm_frechet(cross_matrix(phi), cross_matrix(rate))
    np.testing.assert_allclose(rotation_of(phi), expm(cross_matrix(phi)), atol=1e-14)
    omega = R.T @ turning
    wanted = [omega[2, 1], omega[0, 2], omega[1, 0]]
    np.testing.assert_allclose(angular_velocity(phi, rate), wanted, atol=1e-13)


def test_a_rotation_vector_is_that_of_its_rotation_near_half_a_turn() -> None:
    phi = (np.pi - 1e-9) * np.array([0.0, 0.6, -0.8])
    np.testing.assert_allclose(rotation_vector(rotation_of(phi)), phi, atol=1e-8)


@pytest.mark.parametrize("name", ["hoap3", "ur5", "lwr", "baxter_left_arm", "humanoid32"])
def test_the_default_task_is_that_of_the_product(name: str) -> None:
    from hoap3.remote_controller.default_task import default_goal

    description = described(name)
    wanted = default_goal(description, "task").settings

    entry = default_entry(description)

    assert entry["task"] == wanted.task
    place = entry["parameters"].pop("target")["position_m"]
    there = dict(wanted.parameters)
    np.testing.assert_allclose(place, there.pop("target")["position_m"], atol=1e-14)
    assert entry["parameters"] == there


@pytest.mark.parametrize(
    "entry",
    [
        {"task": "my.own:Task"},
        {"task": "com", "parameters": {"frame": "nowhere"}},
        {"task": "com", "parameters": {"target": {"kind": "spline", "file": "a"}}},
        {"task": "posture", "parameters": {"joints": ["none"]}},
        {"task": "com", "parameters": {"weights": [-1.0]}},
    ],
)
def test_what_cannot_be_recomputed_is_refused(entry: dict) -> None:
    with pytest.raises(UnverifiableError):
        task_of(entry, Robot(described("hoap3")))
