"""What is wrong in the config of a hierarchy is said by file, key and value."""

from __future__ import annotations

import re
import warnings
from types import SimpleNamespace

import pytest
from hierarchy_runs import content, made, robot

from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError, LimitWarning, UnknownNameError
from hoap3.remote_controller.config import ControllerConfig, check_parameters
from hoap3.remote_controller.limits_above import warn_of_limits_above

POINT = {"kind": "point", "position_m": [0.0, 0.0, 0.0]}


def hand(name: str = "hand", **parameters: object) -> dict[str, object]:
    return {"name": name, "task": "frame_position", "parameters": {"frame": "ee", **parameters}}


def press(**parameters: object) -> dict[str, object]:
    up = {"normal": [0.0, 0.0, 1.0], "force_n": 5.0, "target": POINT}
    return {**hand("press", **{**up, **parameters}), "task": "wrench"}


def rest(**parameters: object) -> dict[str, object]:
    return {"name": "rest", "task": "posture", "parameters": parameters}


def limit(constraint: str, **parameters: object) -> dict[str, object]:
    return {"constraint": constraint, "parameters": parameters}


LIMIT = "constraints.0.parameters"


def summed(term: dict[str, object]) -> dict[str, object]:
    """A sum whose second term is that."""
    term = {key: term[key] for key in term if key != "name"}
    return {"task": "weighted_sum", "parameters": {"terms": [{"task": "posture"}, term]}}


TERM = "parameters.tasks.0.parameters.terms.1"


WRONG = [
    ([hand(frame="elbwo")], "parameters.tasks.0.parameters.frame", "elbow"),
    ([hand(), hand()], "parameters.tasks.1.name", "hand"),
    ([hand(reference="elbwo")], "parameters.tasks.0.parameters.reference", "elbow"),
    ([press(reference="link_2")], "parameters.tasks.0.parameters.reference", "link_2"),
    ([hand("a b")], "parameters.tasks.0.name", "a b"),
    ([{**hand(), "task": "frame_positon"}], "frame_positon", "'frame_position'"),
    ([{**hand(), "kp": 0.0}], "parameters.tasks.0.kp", "0.0"),
    ([], "parameters.tasks", ""),
    (
        [hand(weights=[1.0, -1.0, 1.0])],
        "parameters.tasks.0.parameters.weights: ",
        "(1.0, -1.0, 1.0)",
    ),
    ([summed(hand(weights=[1.0, 2.0]))], f"{TERM}.parameters.weights: ", "(1.0, 2.0)"),
    ([{**hand(), "gain_per_s": 3.0}], "parameters.tasks.0.gain_per_s: ", "kp"),
    ([{**hand(), "target": POINT}], "parameters.tasks.0.target: ", "`parameters`"),
    ([{**rest(), "frame": "ee"}], "parameters.tasks.0.frame: ", "`parameters`"),
    ([{"name": "hand", "kind": "pose", "frame": "ee"}], "parameters.tasks.0.kind: ", "frame_pose"),
    ([press(sensor="elbow")], "parameters.tasks.0.parameters.sensor", "elbow"),
    ([press(normal=[0.0, 0.0, 0.0])], "parameters.tasks.0", "normal"),
    ([rest(joints=["joint_9"])], "parameters.tasks.0.parameters.joints", "joint_9"),
    ([rest(joints=["joint_1", "joint_1"])], "parameters.tasks.0.parameters.joints", "joint_1"),
    ([rest(posture="bend")], "parameters.tasks.0.parameters.posture", "bend"),
    (
        [{**hand(posture="nowhere"), "task": "frame_pose"}],
        "parameters.tasks.0.parameters.posture",
        "nowhere",
    ),
]


@pytest.mark.parametrize(("tasks", "key", "said"), WRONG)
def test_a_task_that_does_not_fit(tasks, key, said):
    with pytest.raises((ConfigError, UnknownNameError)) as raised:
        made("ghc", tasks=tasks, priorities={})
    text = str(raised.value)
    assert key in text
    assert said in text


def test_a_wrong_entry_is_told_without_an_echo_about_its_list():
    with pytest.raises(ConfigError) as raised:
        made("ghc", tasks=[{**hand(), "kp": 0.0}], priorities={})
    assert not raised.value.others


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
    ("later", "refused"),
    [
        ({"at_s": 1.5, "weights": {"hand": 1.0, "elbow": 0.0}}, True),
        ({"at_s": 1.0, "weights": {"hand": 1.0}}, True),
        ({"at_s": 1.5, "weights": {"elbow": 1.0}}, False),
        ({"at_s": 2.0, "weights": {"hand": 1.0}}, False),
    ],
)
def test_changes_of_one_weight_do_not_overlap(later, refused):
    timeline = {"timeline": [later, {"at_s": 1.0, "over_s": 1.0, "weights": {"hand": 0.0}}]}
    if not refused:
        made("weighted", priorities=timeline)
        return
    with pytest.raises(ConfigError, match=r"timeline\.\d\.at_s.*timeline.*hand"):
        made("weighted", priorities=timeline)


def test_two_changes_of_one_weight_at_one_time_or_a_change_of_none_are_refused():
    both = [{"at_s": 1.0, "weights": {"hand": value}} for value in (0.0, 1.0)]
    for timeline, key in ((both, "at_s"), ([{"at_s": 1.0, "weights": {}}], "weights")):
        with pytest.raises(ConfigError, match=rf"timeline\.\d\.{key}"):
            made("weighted", priorities={"timeline": timeline})
    with pytest.raises(ConfigError, match="weights"):
        made("weighted").change({"weights": {}})


@pytest.mark.parametrize("key", ["torque_max", "speed_max"])
def test_bounds_have_one_value_or_one_for_each_joint(key):
    with pytest.raises(ConfigError, match=rf"parameters\.bounds\.{key}"):
        made("ghc", bounds={key: [1.0, 2.0]})
    controller = made("ghc", bounds={key: [1e6]})
    assert (controller.torque_max == robot().effort).all()


ABOVE = [
    ({"bounds": {"speed_max": [1e6]}}, "bounds.speed_max", r"1000000\.0"),
    ({"bounds": {"torque_max": [1.0] * 6 + [1e6]}}, "bounds.torque_max.6", "joint_7"),
    (
        {"bounds": {"acceleration_max": [1e5], "shrink": True}},
        "bounds.acceleration_max",
        r"100000\.0",
    ),
    ({"constraints": [limit("joint_velocity", limit_rad_s=99.0)]}, f"{LIMIT}.limit_rad_s", "99"),
    ({"constraints": [limit("viability", limit_rad_s=99.0)]}, f"{LIMIT}.limit_rad_s", "99"),
    (
        {"constraints": [limit("joint_torque", joints_nm={"joint_2": 1e4})]},
        f"{LIMIT}.joints_nm.joint_2",
        "10000",
    ),
]


@pytest.mark.parametrize(("given", "key", "said"), ABOVE)
def test_a_limit_above_the_robots_is_told(given, key, said):
    with pytest.warns(LimitWarning, match=rf"^ghc: parameters\.{re.escape(key)}: .*{said}"):
        made("ghc", **given)


def test_a_limit_that_some_joint_can_reach_is_not():
    limits = [limit("joint_velocity", limit_rad_s=float(robot().velocity.max()))]
    bounds = {"torque_max": [float(robot().effort.max())], "speed_max": [0.9]}
    with warnings.catch_warnings():
        warnings.simplefilter("error", LimitWarning)
        made("ghc", bounds=bounds, constraints=limits)


@pytest.mark.parametrize("own", [{"constraints": 3}, {"constraints": ["a"]}, {"bounds": "wide"}])
def test_somebody_else_may_use_these_words_otherwise(own):
    warn_of_limits_above(robot(), SimpleNamespace(**own), "mine.yaml")


@pytest.mark.parametrize("name", ["ghc", "ghc_humanoid", "ghc_torque", "hqp", "weighted"])
def test_no_shipped_config_asks_for_more_than_its_robot_can_do(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error", LimitWarning)
        made(name)


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
