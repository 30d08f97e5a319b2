"""What of a controller's config is drawn; and that a config of a stranger does no harm."""

from __future__ import annotations

import json

import numpy as np
import pytest
from view_samples import HAND, UR5, config_of, posed, task

from hoap3.remote_controller.config import ControllerConfig, build, read_config
from hoap3.tools.view.picture.config_scene import ConfigScene
from hoap3.tools.view.picture.targets import present

HOME = UR5.initial_position


def test_the_frames_of_tasks_are_named_after_them():
    config = config_of(task("frame_position"), {"task": "com", "parameters": {"frame": "base"}})
    assert ConfigScene(UR5, config).task_frames() == [("it", "tool0"), ("com", "com")]
    assert ConfigScene(UR5, None).task_frames() == [("tool0", "tool0")]  # the default task


def test_a_live_target_is_that_of_its_task():
    scene = ConfigScene(UR5, config_of(task("frame_position", reference="base")))
    (target,) = scene.steered([HAND])
    found = target.kind, target.frame, target.reference, target.dimension
    assert found == ("frame_position", "tool0", "base", 3)


def test_the_targets_of_a_shipped_config_are_found_where_the_controller_has_them():
    content, file = read_config("steered_ur5")
    config = ControllerConfig(**content)
    told = [live.as_json() for live in build(config, UR5, file).live]
    scene = ConfigScene(UR5, json.loads(config.model_dump_json()))
    targets = scene.steered(told)
    assert [(each.kind, each.frame, each.reference) for each in targets] == [
        ("frame_position", "tool0", "base")
    ]
    poses = posed(UR5, HOME)
    assert np.allclose(present(targets[0], poses, HOME), poses.pose("tool0")[:3])


def test_a_posture_is_in_the_order_of_its_layout():
    layout = list(reversed(UR5.joint_names))
    told = {"name": "arm", "dimension": 6, "rates": 6, "layout": layout, "unit": "rad"}
    (target,) = ConfigScene(UR5, config_of(task("posture", target="arm"))).steered([told])
    q = np.arange(6.0)
    assert present(target, posed(UR5, q), q) == [5, 4, 3, 2, 1, 0]


@pytest.mark.parametrize(
    ("config", "told"),
    [
        (None, HAND),
        ({}, HAND),
        ({"parameters": [1, 2]}, HAND),
        (config_of(task("frame_position", frame="nowhere")), HAND),
        (config_of(task("frame_position", reference="nowhere")), HAND),
        (config_of(task("frame_pose")), {**HAND, "dimension": 5}),
        (config_of(task("somebodys.module:Task")), HAND),
        (config_of(task("posture")), HAND),
    ],
)
def test_what_is_not_understood_is_unknown(config, told):
    (target,) = ConfigScene(UR5, config).steered([told])
    assert target.kind == "unknown"
    assert present(target, posed(UR5, HOME), HOME) is None


@pytest.mark.parametrize(
    "told", [None, 3, [None], [{"name": 1}], [{"name": "a", "dimension": -1, "rates": 1}]]
)
def test_targets_that_are_none_are_left_out(told):
    assert ConfigScene(UR5, None).steered(told) == []


def test_obstacles_and_planes_are_drawn_where_they_are():
    obstacles = [
        {"name": "ball", "shape": "sphere", "center_m": [0.1, 0.2, 0.3], "radius_m": 0.05},
        {"name": "bar", "shape": "capsule", "ends_m": [[0, 0, 0], [0, 2, 0]], "radius_m": 0.1},
        {"name": "crate", "shape": "box", "center_m": [1, 0, 0], "size_m": [0.1, 0.2, 0.3],
         "rpy_rad": [0, 0, 0], "frame": "tool0"},
        {"name": "odd", "shape": "torus"},
        {"name": "far", "shape": "sphere", "center_m": [1e300, 0, 0], "radius_m": 1},
        {"name": "lost", "shape": "sphere", "center_m": [0, 0, 0], "radius_m": 1, "frame": "x"},
        7,
    ]  # fmt: skip
    plane = {"frame": "tool0", "normal": [0.0, 0.0, 2.0], "offset_m": 0.25}
    constraints = [
        {"constraint": "distance", "parameters": {"obstacles": obstacles}},
        {"constraint": "half_space", "parameters": plane},
    ]
    ball, bar, crate, floor = ConfigScene(UR5, config_of(constraints=constraints)).constraints()
    assert (ball["shape"], ball["size"], ball["origin"][:3]) == ("sphere", [0.05], [0.1, 0.2, 0.3])
    assert (bar["shape"], bar["size"], bar["origin"][:3]) == ("capsule", [0.1, 2.0], [0, 1, 0])
    assert (crate["link"], crate["size"]) == ("tool0", [0.1, 0.2, 0.3])
    assert (floor["link"], floor["origin"][:3]) == (UR5.base_frame, [0, 0, 0.25])


def test_the_axis_of_a_capsule_leads_from_end_to_end():
    ends = [[0.1, -0.2, 0.3], [0.4, 0.1, -0.5]]
    given = {"name": "bar", "shape": "capsule", "ends_m": ends, "radius_m": 0.1}
    constraint = {"constraint": "distance", "parameters": {"obstacles": [given]}}
    (bar,) = ConfigScene(UR5, config_of(constraints=[constraint])).constraints()
    x, y, z, w = bar["origin"][3:]
    axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    half = axis * bar["size"][1] / 2
    middle = np.array(bar["origin"][:3])
    assert np.allclose([middle - half, middle + half], ends, atol=1e-9)


def test_a_deep_or_long_config_is_cut():
    deep: object = {"task": "com"}
    for _ in range(1000):
        deep = {"parameters": deep}
    assert ConfigScene(UR5, {"parameters": deep}).task_frames() == [("tool0", "tool0")]
    many = config_of(*(task("frame_position") | {"name": f"t{i}"} for i in range(1000)))
    assert len(ConfigScene(UR5, many).task_frames()) <= 64
