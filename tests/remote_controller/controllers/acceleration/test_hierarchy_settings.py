"""What is wrong in the config of a hierarchy is said by file, key and value."""

from __future__ import annotations

import pytest
from hierarchy_runs import content, made, robot

from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.config import ControllerConfig, check_parameters

HAND = {"name": "hand", "kind": "position", "frame": "ee"}
PRESS = {"kind": "force", "name": "press", "frame": "ee", "normal": [0.0, 0.0, 1.0], "force_n": 5.0}
PRESS |= {"target": {"kind": "point", "position_m": [0.0, 0.0, 0.0]}}
WRONG = [
    ([{**HAND, "frame": "elbwo"}], "parameters.tasks.0.frame", "elbow"),
    ([HAND, {**HAND}], "parameters.tasks.1.name", "two tasks"),
    ([{**HAND, "reference": "link_2"}], "parameters.tasks.0.reference", "joints move it"),
    ([{**HAND, "name": "a b"}], "parameters.tasks.0", "pattern"),
    ([{**HAND, "kind": "positon"}], "parameters.tasks.0", "positon"),
    ([], "parameters.tasks", "one task or more"),
    ([{**PRESS, "sensor": "elbow"}], "parameters.tasks.0.sensor", "no wrench sensor"),
    ([{**PRESS, "normal": [0.0, 0.0, 0.0]}], "parameters.tasks.0", "normal"),
    (
        [{"name": "rest", "kind": "posture", "joints": ["joint_9"]}],
        "parameters.tasks.0.joints",
        "joint_9",
    ),
    (
        [{"name": "rest", "kind": "posture", "joints": ["joint_1", "joint_1"]}],
        "parameters.tasks.0.joints",
        "twice",
    ),
    (
        [{"name": "rest", "kind": "posture", "posture": "bend"}],
        "parameters.tasks.0.posture",
        "bend",
    ),
    (
        [{**HAND, "kind": "pose", "goal": {"posture": "nowhere"}}],
        "parameters.tasks.0.goal.posture",
        "nowhere",
    ),
]


@pytest.mark.parametrize(("tasks", "key", "said"), WRONG)
def test_a_task_that_does_not_fit(tasks, key, said):
    with pytest.raises(ConfigError) as raised:
        made("ghc", tasks=tasks, priorities={})
    text = str(raised.value)
    assert key in text
    assert said in text


@pytest.mark.parametrize("name", ["ghc", "hqp"])
def test_priorities_are_checked_without_a_robot(name):
    wrong = {"matrix": [[0.0, 1.0], [0.0, 0.0]]}
    config = parse(ControllerConfig, content(name, priorities=wrong), name)
    with pytest.raises(ConfigError, match=r"parameters\.priorities\.matrix"):
        check_parameters(config, name)


def test_so_are_weights():
    wrong = {"weights": {"hnad": 1.0}}
    config = parse(ControllerConfig, content("weighted", priorities=wrong), "weighted")
    with pytest.raises(ConfigError, match="hand"):
        check_parameters(config, "weighted")
    later = {"timeline": [{"at_s": 1.0, "weights": {"foot": 1.0}}]}
    with pytest.raises(ConfigError, match=r"timeline\.0\.weights\.foot"):
        made("weighted", priorities=later)


@pytest.mark.parametrize("weight", [True, "2", -1.0, float("nan"), 1e7])
def test_a_weight_is_a_number_that_is_not_negative(weight):
    with pytest.raises(ConfigError, match=r"weights\.hand"):
        made("weighted", priorities={"weights": {"hand": weight}})


@pytest.mark.parametrize(
    ("later", "said"),
    [
        ({"at_s": 1.5, "weights": {"hand": 1.0, "elbow": 0.0}}, "at_s 2"),
        ({"at_s": 1.0, "weights": {"hand": 1.0}}, "Make one change of both"),
        ({"at_s": 1.5, "weights": {"elbow": 1.0}}, None),
        ({"at_s": 2.0, "weights": {"hand": 1.0}}, None),
    ],
)
def test_changes_of_one_weight_do_not_overlap(later, said):
    timeline = {"timeline": [later, {"at_s": 1.0, "over_s": 1.0, "weights": {"hand": 0.0}}]}
    if not said:
        made("weighted", priorities=timeline)
        return
    with pytest.raises(ConfigError, match=r"timeline\.\d\.at_s: overlaps timeline") as raised:
        made("weighted", priorities=timeline)
    assert "hand" in str(raised.value)
    assert said in str(raised.value)


def test_two_changes_of_one_weight_at_one_time_are_one():
    both = [{"at_s": 1.0, "weights": {"hand": value}} for value in (0.0, 1.0)]
    with pytest.raises(ConfigError, match="Make one change of both"):
        made("weighted", priorities={"timeline": both})


def test_a_change_of_no_weight_is_none():
    with pytest.raises(ConfigError, match=r"timeline\.0\.weights"):
        made("weighted", priorities={"timeline": [{"at_s": 1.0, "weights": {}}]})
    with pytest.raises(ConfigError, match="weights"):
        made("weighted").change({"weights": {}})


@pytest.mark.parametrize("key", ["torque_max", "speed_max"])
def test_bounds_have_one_value_or_one_for_each_joint(key):
    with pytest.raises(ConfigError, match=rf"parameters\.bounds\.{key}"):
        made("ghc", bounds={key: [1.0, 2.0]})
    controller = made("ghc", bounds={key: [1e6]})
    assert (controller.torque_max == robot().effort).all()


def test_a_change_that_is_wrong_changes_nothing():
    for name, request in (
        ("ghc", {"order": ["hand", "foot"]}),
        ("ghc", {}),
        ("weighted", {"weights": {"foot": 1.0}}),
        ("weighted", {"weights": {"hand": -1.0}}),
    ):
        controller = made(name)
        with pytest.raises(ConfigError):
            controller.change(request)
        assert not controller.importance.moving
