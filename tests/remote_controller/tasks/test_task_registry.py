"""Tasks by name and by dotted path; what is wrong with somebody's own, in one line."""

from __future__ import annotations

from importlib.metadata import EntryPoint

import numpy as np
import pytest
from task_cases import ARM, CASES, HOAP3, POINT, kinematics_of

from hoap3.protocol.config import plugins
from hoap3.protocol.errors import ConfigError, UnknownNameError
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.tasks.registry import TaskSettings, build, check_parameters, registered


def build_arm(task, parameters):
    settings = TaskSettings(task=task, parameters=parameters)
    return build(settings, ARM, kinematics_of(ARM.name), "mine.yaml", "v")


def test_a_users_own_v():
    own = build_arm("own_tasks:Sway", {"a_rad": 0.2})
    kinematics = kinematics_of(ARM.name)
    kinematics.update(np.array([0.1, 0.2, 0.3]))
    own.reset(kinematics, 0.0)
    own.update(kinematics, 0.0)
    assert own.value == pytest.approx(0.07)
    assert own.rate == pytest.approx(-0.36)
    assert own.error.size == 0
    assert own.jacobian.shape == (0, 3)


FAULTS = [
    ("Sway", "gradient", r"gradient\[1\].*elbow.*0\.9\S*.*0\.9"),
    ("Sway", "rate", r"rate.* 0, .*-0\.\d+.*0\.3 s"),
    ("Sway", "shape", r"gradient.*\(2,\).*\(3,\)"),
    ("Sway", "nan", r"gradient\[2\].*wrist.*nan"),
    ("Sway", "negative", r"value.*-99\.\d+"),
    ("Sway", "raises", r"'arm3'.*ZeroDivisionError: my own mistake .*own_tasks\.py, line \d+"),
    ("Reach", "jacobian", r"jacobian\[0, 1\].*elbow.*error\[0\]"),
    ("Reach", "error_rate", r"error_rate\[0\].* 0, .*error\[0\].*-0\.0"),
    ("Reach", "consistent", r"jacobian\[0, 2\].*wrist.*0\.\d+.*error\[0\]"),
    ("Reach", "square", r"value.*error.*0\.3 s"),
    ("Reach", "shape", "'arm3'.*ValueError"),
    ("Reach", "nan", r"error_rate\[0\].*nan"),
]


@pytest.mark.parametrize(("task", "fault", "named"), FAULTS)
def test_a_faulty_task_is_refused_by_component_and_figures(task, fault, named):
    with pytest.raises(ConfigError, match=named) as caught:
        build_arm(f"own_tasks:{task}", {"fault": fault})
    assert (caught.value.file, caught.value.key) == ("mine.yaml", "v.task")
    assert caught.value.value == f"own_tasks:{task}"


def test_v_follows_from_a_users_own_error():
    own = build_arm("own_tasks:Reach", {})
    kinematics = kinematics_of(ARM.name)
    kinematics.update(np.array([0.1, 0.2, 0.3]))
    own.reset(kinematics, 0.0)
    own.update(kinematics, 0.4)
    assert own.value == 0.5 * own.error[0] ** 2
    assert own.rate == own.error[0] * own.error_rate[0]
    np.testing.assert_array_equal(own.gradient, own.jacobian[0] * own.error[0])


def test_a_faulty_v_is_found_inside_a_sum():
    terms = [
        {"task": "posture", "parameters": {"posture": "bent"}},
        {"task": "own_tasks:Sway", "parameters": {"fault": "rate"}},
    ]
    with pytest.raises(ConfigError, match=r"^mine\.yaml: v\.parameters\.terms\.1\.task: "):
        build_arm("weighted_sum", {"terms": terms})


def test_a_sum_takes_a_users_own_v():
    terms = [
        {"weight": 2.0, "task": "posture", "parameters": {"posture": "bent"}},
        {"weight": 3.0, "task": "own_tasks:Sway"},
    ]
    both = build_arm("weighted_sum", {"terms": terms})
    parts = [build_arm(term["task"], term.get("parameters", {})) for term in terms]
    kinematics = kinematics_of(ARM.name)
    kinematics.update(np.array([0.3, 0.2, 0.1]))
    for function in (both, *parts):
        function.reset(kinematics, 0.0)
        function.update(kinematics, 0.4)
    assert both.value == pytest.approx(2.0 * parts[0].value + 3.0 * parts[1].value)
    assert both.rate == pytest.approx(3.0 * parts[1].rate)
    expected = 2.0 * parts[0].gradient + 3.0 * parts[1].gradient
    np.testing.assert_allclose(both.gradient, expected)
    assert both.error.size == 0  # V is no square of an error that it knows


WRONG = [
    ("own_tasks:NotATask", {}, "v.task"),
    ("own_tasks:NoUpdate", {}, "v.task.*update"),
    ("own_tasks:Tuned", {}, "v.task.*tune.*apply"),
    ("own_tasks:Nothing", {}, "v.task.*AttributeError"),
    ("com", {"target": POINT, "fraem": "base"}, "v.parameters.fraem"),
    ("com", {"target": POINT, "frame": "r_sole"}, "v.parameters.frame.*'arm3'"),
    ("com", {"target": POINT, "frame": "base", "weights": [1, 2]}, "weights"),
    ("com", {"target": POINT, "frame": "base", "weights": [0]}, "weights"),
    ("posture", {"posture": "bend"}, "v.parameters.posture.*bend"),
    ("posture", {"posture": "bent", "target_rad": [1.0]}, "posture, target_rad"),
    ("posture", {"target_rad": [1.0]}, "v.parameters.target_rad"),
    ("posture", {"joints": ["knee"], "target_rad": [1]}, "joints.*knee"),
    ("posture", {"joints": ["wrist", "wrist"], "target_rad": [1, 1]}, "joints.*wrist"),
    ("joint_curve", {"curve": "own_tasks:Flat", "speed_rad_s": 1}, r"curve.*\(1,\)"),
    ("joint_curve", {"curve": "helix", "speed_rad_s": 1}, "'helix'"),
    (
        "joint_curve",
        {"curve": "own_tasks:Eight", "curve_parameters": {"wrong": True}, "speed_rad_s": 1},
        r"v.parameters.curve.*gradient\[2\].*wrist",
    ),
    (
        "joint_curve",
        {"curve_parameters": {"joints": ["a", "b"], "radii_rad": [1, 1]}, "speed_rad_s": 1},
        "v.parameters.curve_parameters.*'a'",
    ),
    (
        "joint_curve",
        {
            "curve_parameters": {"joints": ["elbow", "wrist"], "radii_rad": [1, 1]},
            "speed_rad_s": 1,
            "objective_weights": [1.0, 0.0],
        },
        "objective_weights",
    ),
]


@pytest.mark.parametrize(("task", "parameters", "named"), WRONG)
def test_what_is_wrong_is_named(task, parameters, named):
    with pytest.raises((ConfigError, UnknownNameError), match=named):
        build_arm(task, parameters)


def test_an_unknown_task_names_the_nearest():
    with pytest.raises(UnknownNameError, match=r"'frame_pose'.*mine\.yaml: v\.task"):
        check_parameters(TaskSettings(task="frame_posee"), "mine.yaml", "v")


def test_installed_packages_register_theirs(monkeypatch):
    point = EntryPoint("sway", "own_tasks:Sway", "hoap3.tasks")
    found = {"hoap3.tasks": [point]}
    monkeypatch.setattr(plugins, "entry_points", lambda group: found.get(group, []))
    assert "sway" in registered()
    assert build_arm("sway", {}).value >= 0.0


@pytest.mark.parametrize("case", CASES)
def test_nothing_jumps_at_the_start(case):
    """A started target is where the robot is, and V does not depend on when that was."""
    robot, name, parameters = CASES[case]
    values = []
    for begin in (0.0, 500.0):
        kinematics = Kinematics(robot)
        function = build(TaskSettings(task=name, parameters=parameters), robot, kinematics)
        kinematics.update(robot.initial_position)
        function.reset(kinematics, begin)
        function.update(kinematics, begin)
        at_start = function.value
        function.update(kinematics, begin + 0.25)
        values.append((at_start, function.value, function.rate))
    np.testing.assert_allclose(values[1], values[0], rtol=1e-9, atol=1e-12)
    blends = {"com", "hand", "tool", "hand pose", "tool pose", "posture", "sum"}
    if case in blends:
        np.testing.assert_allclose(values[0][0], 0.0, atol=1e-18)


def test_a_tasks_arrays_stay_its_own():
    """What it gave at one posture is not rewritten by another task's look at another one."""
    robot, name, parameters = CASES["hand pose"]
    kinematics = kinematics_of(HOAP3.name)
    first, second = (
        build(TaskSettings(task=name, parameters=parameters), robot, kinematics) for _ in range(2)
    )
    first.reset(kinematics, 0.0)
    first.update(kinematics, 0.1)
    kept = first.error.copy(), first.jacobian.copy(), first.gradient.copy()
    kinematics.update(np.array(robot.lower))
    second.update(kinematics, 0.1)
    for now, before in zip((first.error, first.jacobian, first.gradient), kept, strict=True):
        np.testing.assert_array_equal(now, before)
