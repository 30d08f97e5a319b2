"""Tasks whose error cannot fall are named: stationary ones, and those that something blocks."""

from __future__ import annotations

import json

import numpy as np
import pytest

import hoap3
from hoap3.protocol.config.settings import parse
from hoap3.protocol.messages import Event, State
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.config import ControllerConfig, build
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.robot_emulator.robots import load
from hoap3.tools.analysis.verdicts import in_words, judge

NOTHING_HELD = {"interventions": 0, "torque_limited": 0}

LENGTH = 0.3


def urdf(limit: float = 2.0) -> str:
    """A planar arm of three links along x; the second joint ends at `limit`."""
    links = "".join(
        f'<link name="{name}"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" '
        'izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        for name in ("a", "b", "c", "tip")
    )
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{x} 0 0"/><axis xyz="0 0 1"/>'
        f'<limit lower="-2" upper="{upper}" velocity="2" effort="50"/></joint>'
        for name, parent, child, x, upper in (
            ("joint1", "base", "a", 0.0, 2.0),
            ("joint2", "a", "b", LENGTH, limit),
            ("joint3", "b", "c", LENGTH, 2.0),
        )
    )
    end = (
        f'<joint name="end" type="fixed"><parent link="c"/><child link="tip"/>'
        f'<origin xyz="{LENGTH} 0 0"/></joint>'
    )
    return f'<robot name="planar"><link name="base"/>{links}{joints}{end}</robot>'


def position(x: float, y: float = 0.0, **more: object) -> dict:
    target = {"kind": "point", "position_m": [x, y, 0.0]}
    parameters = {"frame": "tip", "axes": ["x", "y"], "target": target, **more}
    return {"task": "frame_position", "parameters": parameters}


def controller(name: str, x: float, y: float = 0.0, **more: object) -> dict:
    """A controller that brings the tip to a point."""
    if name in {"qp12", "pinv", "osqp"}:
        parameters = {"point": "tip", "reference_frame": "base", "target_m": [x, y, 0.0], **more}
    elif name == "stable_qp":
        parameters = {"task": position(x, y, **more)}
    else:
        parameters = {"tasks": [position(x, y, **more)]}
    return {"controller": name, "parameters": parameters}


POSITIONS = ("qp12", "pinv", "osqp", "stable_qp", "clik", "clik_sdp", "ghc_velocity")
ACCELERATIONS = ("tsid", "weighted", "ghc", "ghc_torque", "hqp")
EVERY = (*POSITIONS, *ACCELERATIONS)


@pytest.fixture
def arm(tmp_path):
    def build(limit: float = 2.0) -> str:
        file = tmp_path / f"planar{limit}.urdf"
        file.write_text(urdf(limit))
        return str(file)

    return build


def outcome(run: hoap3.Simulation) -> dict:
    told = [json.loads(each.payload) for each in run.records if each.kind == Kind.SUMMARY][-1]
    return judge(None, NOTHING_HELD, told) | {"told": told}


def began(run: hoap3.Simulation) -> list[str]:
    """Conditions that began, by name."""
    session = next(json.loads(each.payload) for each in run.records if each.kind == Kind.SESSION)
    events = [each.payload for each in run.records if each.kind == Kind.EVENT]
    found = [Event.scalars(payload, "kind", "detail") for payload in events]
    start = Event.schema.constants["CONDITION_BEGAN"]
    return [session["conditions"][detail] for kind, detail in found if kind == start]


@pytest.mark.parametrize("name", EVERY)
def test_a_stretched_arm_is_stationary_and_its_task_fails(name, arm):
    run = hoap3.simulate(arm(), controller(name, 3 * LENGTH - 0.01), duration=0.05)
    assert not np.abs(run.states["q"]).any()
    task = "tip" if name in {"qp12", "pinv", "osqp"} else "frame_position"
    assert f"stationary: {task}, x of base" in began(run)
    assert set(run.setpoints["solver_status"]) == {STATUS["uncertified"]}
    judged = outcome(run)
    assert judged["verdicts"]["task"] == "fail"
    assert judged["task"]["certified"] == 0
    error = judged["task"]["errors"][0]
    assert (error["within"], error["reason"]) == (False, "stationary: x of base")
    assert error["error"] == pytest.approx(0.01)
    assert "stationary: x of base" in in_words(judged)["task"]


@pytest.mark.parametrize("name", EVERY)
def test_at_its_target_it_is_not(name, arm):
    run = hoap3.simulate(arm(), controller(name, 3 * LENGTH), duration=0.05)
    assert not began(run) or not any("stationary" in each for each in began(run))
    assert outcome(run)["task"]["errors"][0]["within"]


@pytest.mark.parametrize("name", ["qp12", "stable_qp"])
def test_a_stationary_point_within_the_tolerance_is_at_target(name, arm):
    run = hoap3.simulate(arm(), controller(name, 3 * LENGTH - 5e-4), duration=0.02)
    assert set(run.setpoints["solver_status"]) <= {STATUS["at_target"], STATUS["certified"]}
    assert not any("stationary" in each for each in began(run))


@pytest.mark.parametrize("name", ["qp12", "clik", "ghc_velocity", "stable_qp"])
def test_at_target_keeps_to_a_tolerance_however_small(name, arm):
    x = 3 * LENGTH - 5e-6
    fine = controller(name, x, tolerance_m=1e-6)
    run = hoap3.simulate(arm(), fine, duration=0.02)
    assert STATUS["at_target"] not in run.setpoints["solver_status"]


def test_small_weights_do_not_make_a_target_reached(arm):
    given = controller("ghc_velocity", 0.6, 0.3, weights=[1e-12])
    run = hoap3.simulate(arm(), given, duration=0.01)
    assert STATUS["at_target"] not in run.setpoints["solver_status"]


@pytest.mark.parametrize("name", ["qp12", "stable_qp", "clik", "ghc_velocity"])
def test_random_postures_are_not_stationary(name):
    rng = np.random.default_rng(3)
    robot = load("ur5")
    x, y, z = 0.3, 0.2, 0.4
    if name == "qp12":
        parameters = {"point": "tool0", "reference_frame": "base", "target_m": [x, y, z]}
    else:
        target = {"kind": "point", "position_m": [x, y, z]}
        task = {"task": "frame_position", "parameters": {"frame": "tool0", "target": target}}
        parameters = {"task": task} if name == "stable_qp" else {"tasks": [task]}
    content = {"robot": "ur5", "controller": name, "parameters": parameters}
    built = build(parse(ControllerConfig, content, "config"), robot)
    for tick in range(200):
        state = State.allocate(**robot.state_lengths)
        state.q[:] = state.reference[:] = rng.uniform(-2.5, 2.5, robot.n)
        state.tick = tick
        built.reset(state, None)
        built.step(state)
        assert not built.is_stationary


@pytest.mark.slow
@pytest.mark.parametrize("name", EVERY)
def test_a_joint_at_its_limit_blocks_and_is_named(name, tmp_path):
    file = tmp_path / "one.urdf"
    file.write_text(
        '<robot name="one"><link name="base"/><link name="tip"><inertial><mass value="1"/>'
        '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="slider" type="prismatic"><parent link="base"/><child link="tip"/>'
        '<axis xyz="1 0 0"/><limit lower="-0.1" upper="0.1" velocity="2" effort="50"/></joint>'
        "</robot>"
    )
    more = {} if name in {"qp12", "pinv", "osqp"} else {"axes": ["x"]}
    run = hoap3.simulate(str(file), controller(name, 0.15, **more), duration=3.0)
    assert run.states["q"].max() <= 0.1 + 1e-9
    names = [each for each in began(run) if each.startswith(("blocked", "stationary"))]
    assert set(names) == {"blocked: bounds of slider"}
    judged = outcome(run)
    assert judged["verdicts"]["task"] == "fail"
    assert judged["task"]["errors"][0]["reason"] == "blocked: bounds of slider"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["clik", "clik_sdp", "ghc_velocity", "ghc", "ghc_torque"])
def test_only_what_holds_a_judged_task_is_named(name, tmp_path):
    file = tmp_path / "two.urdf"
    inertial = (
        '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" '
        'ixz="0" iyz="0"/></inertial>'
    )
    file.write_text(
        f'<robot name="two"><link name="base"/><link name="a">{inertial}</link>'
        f'<link name="tip">{inertial}</link>'
        + "".join(
            f'<joint name="along_{axis}" type="prismatic"><parent link="{parent}"/>'
            f'<child link="{child}"/><axis xyz="{direction}"/>'
            '<limit lower="-0.1" upper="0.1" velocity="2" effort="50"/></joint>'
            for axis, parent, child, direction in (
                ("x", "base", "a", "1 0 0"),
                ("y", "a", "tip", "0 1 0"),
            )
        )
        + "</robot>"
    )
    tasks = [position(0.15, axes=["x"]), position(0.0, 0.15, axes=["y"])]
    tasks = [{**task, "name": label} for task, label in zip(tasks, "ab", strict=True)]
    more = {} if name.startswith("clik") else {"priorities": {"order": ["a", "b"]}}
    given = {"controller": name, "parameters": {"tasks": tasks, **more}}
    run = hoap3.simulate(str(file), given, duration=3.0)
    assert run.states["q"].max(axis=0) == pytest.approx([0.1, 0.1], abs=5e-3)
    names = [each for each in began(run) if each.startswith(("blocked", "stationary"))]
    assert names == ["blocked: bounds of along_x"]
    reasons = [error["reason"] for error in outcome(run)["task"]["errors"]]
    assert reasons == ["blocked: bounds of along_x", ""]


@pytest.mark.parametrize(("name", "robot"), [("ghc_velocity", "hoap3"), ("tsid_baxter", "baxter")])
def test_a_robot_on_its_way_is_not_blocked(name, robot):
    run = hoap3.simulate(robot, name, duration=0.6)
    assert not [each for each in began(run) if each.startswith("blocked")]
