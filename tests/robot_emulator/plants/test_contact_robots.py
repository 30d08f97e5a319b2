"""Contact and the rest of the robot: its setpoint_filter, its States, its config."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from support.arm3 import describe as arm3
from touching import T, arm, touching

from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.pinocchio_model import build_model
from hoap3.robot_emulator.config import ContactSettings, EmulatorConfig
from hoap3.robot_emulator.filters.acceleration import TORQUE_MARGIN, TorqueFilter
from hoap3.robot_emulator.service import describe
from hoap3.tools.services.simulate import simulate

PLANE = {"frame": "ee", "point_m": [0.0, 0.0, 0.3], "normal": [0.0, 0.0, 1.0]}


def placed(description: RobotDescription, frame: str, q: np.ndarray) -> pin.SE3:
    """Where a frame is in the root."""
    robot = build_model(description)
    there = np.zeros(robot.model.nq)
    there[robot.order] = q
    pin.framesForwardKinematics(robot.model, robot.data, there)
    return pin.SE3(robot.data.oMf[robot.frame_id(frame)])


ARM = arm()
START = placed(ARM, "ee", ARM.initial_position)


def wall(depth: float, side: float) -> dict[str, object]:
    """A plane that the tool of the small arm is inside of, and that turns its shoulder."""
    point = placed(arm3(), "tool", arm3().initial_position).translation
    normal = np.array([0.0, side, 0.0])
    return {"frame": "tool", "point_m": tuple(point + depth * normal), "normal": tuple(normal)}


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_plane_that_pushes_a_joint_to_its_limit_is_held_by_its_motor(side):
    description = arm3(command_kinds=("torque",), gravity="none")
    shoulder = description.joints[0].model_copy(
        update={"lower": -0.05, "upper": 0.05, "velocity": 2.0}
    )
    description = description.model_copy(update={"joints": (shoulder, *description.joints[1:])})
    pushed = touching(description, {**wall(0.05, side), "stiffness_n_m": 500.0})
    setpoint_filter = TorqueFilter(description, pushed, 5, pushed)
    setpoint_filter.reset(pushed.q)
    worst = 0.0
    for tick in range(1000):
        setpoint_filter.follow(np.zeros(3), tick)
        pushed.step(setpoint_filter.value, T)
        worst = max(worst, float(np.abs(pushed.q[0])))
        assert abs(pushed.dq[0]) <= shoulder.velocity
    assert setpoint_filter.interventions > 0
    assert setpoint_filter.torque_limited == 0
    assert 0.04 < worst <= 0.05 - 0.9 * TORQUE_MARGIN[0]
    assert np.abs(pushed.tau[0]) > 1.0  # against the plane


def test_what_keeps_the_limits_passes_bit_by_bit_in_contact():
    above = START.translation + np.array([0.0, 0.0, 1e-3])
    body = touching(ARM, {**PLANE, "point_m": tuple(above)})
    setpoint_filter = TorqueFilter(ARM, body, 5, body)
    setpoint_filter.reset(body.q)
    press = body.tau.copy()  # what balances the plane
    for tick in range(100):
        assert setpoint_filter.follow(press, tick) == -1
        assert setpoint_filter.value.tobytes() == press.tobytes()
        body.step(setpoint_filter.value, T)
    np.testing.assert_allclose(body.q, ARM.initial_position, atol=1e-9)


def pressing(**plant: object) -> dict[str, object]:
    """The arm, which presses from above on a plane 5 mm below its flange."""
    height = float(START.translation[2]) - 0.005
    contact = {**PLANE, "point_m": [0.0, 0.0, height]}
    return {
        "robot": "lwr",
        "command": "torque",
        "plant": {"gravity": "none", "contacts": [contact], **plant},
    }


def lower(by: float) -> dict[str, object]:
    """A controller that brings the flange that much lower."""
    place = (START.translation - [0.0, 0.0, by]).tolist()
    goal = {"position_m": place, "rotation_rad": pin.log3(START.rotation).tolist()}
    task = {"kp": 100.0}
    return {
        "controller": "tsid",
        "robot": "lwr",
        "parameters": {"frame": "ee", "goal": goal, "task": task},
    }


def test_states_carry_the_wrench_in_lockstep():
    run = simulate(pressing(), lower(0.02), duration=1.0)
    wrench = run.states["wrench"]
    assert wrench.shape[1] == 6
    assert not wrench[:20].any()
    assert np.linalg.norm(wrench[-20, :3]) > 1.0
    for q, w in zip(run.states["q"][-20:], wrench[-20:], strict=True):
        turned = placed(ARM, "ee", q).rotation @ w[:3]
        assert turned[2] > 1.0
        np.testing.assert_allclose(turned[:2], 0.0, atol=0.2)
        np.testing.assert_allclose(w[3:], 0.0, atol=1e-9)  # at the sensor's own origin
    again = simulate(pressing(), lower(0.02), duration=1.0)
    assert run.states.tobytes() == again.states.tobytes()


@pytest.mark.parametrize("kind", ["position", "acceleration", "torque"])
def test_a_body_that_touches_nothing_publishes_zeros(kind):
    controller = {"controller": "joint_acceleration", "robot": "lwr"}
    if kind == "torque":
        controller = lower(0.001)
    run = simulate(
        {"robot": "lwr", "command": kind, "plant": {"gravity": "full"}}, controller, 0.05
    )
    assert run.states["wrench"].shape[1] == 6
    assert not run.states["wrench"].any()


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"frame": "eee"}, "'eee'.*'ee'.*base, ee, elbow, link_1"),
        ({"frame": "base"}, "base"),
        ({"normal": [0.0, 0.0, 0.0]}, ""),
        ({"point_m": [0.0, 0.0, 1e9]}, "1000 m"),
        ({"stiffness_n_m": 0.0}, "0"),
        ({"damping_n_s_m": -1.0}, "-1"),
        ({"friction": -0.1}, "-0.1"),
        ({"stiffnes_n_m": 1.0}, "'stiffness_n_m'"),
    ],
)
def test_a_wrong_contact_is_one_error_that_names_it(change: dict[str, object], named: str):
    content = {"robot": "lwr", "command": "torque", "plant": {"contacts": [{**PLANE, **change}]}}
    with pytest.raises(ConfigError, match=rf"plant\.contacts\.0\.{next(iter(change))}: .*{named}"):
        describe(parse(EmulatorConfig, content, "file.yaml"), "file.yaml")


@pytest.mark.parametrize("kind", ["position", "acceleration"])
def test_a_body_that_feels_no_force_takes_no_contacts(kind: str):
    content = {"robot": "lwr", "command": kind, "plant": {"contacts": [PLANE]}}
    config = parse(EmulatorConfig, content, "file.yaml")
    with pytest.raises(ConfigError, match=rf"plant\.contacts: .*{kind}"):
        describe(config, "file.yaml")


def test_a_damper_is_twice_the_root_of_the_stiffness_unless_it_is_given():
    assert ContactSettings(**PLANE, stiffness_n_m=1e4).law == (1e4, 200.0, 0.0)
    assert ContactSettings(**PLANE, damping_n_s_m=0.0, friction=0.5).law == (2e4, 0.0, 0.5)
