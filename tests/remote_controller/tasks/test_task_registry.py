"""Tasks by name and by dotted path; what is wrong with somebody's own, in one line."""

from __future__ import annotations

import re
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


FAULTS = {
    "gradient": r"gradient\[1\] \(elbow\) is 0\.9\S*, but value has the difference quotient 0\.9",
    "rate": r"rate \(∂V/∂t\) is 0, but value has the difference quotient -0\.\d+ at t = 0\.3 s",
    "shape": r"gradient has shape \(2,\) at t = 0\.3 s .*Make it \(3,\)",
    "nan": r"gradient\[2\] \(wrist\) is nan",
    "negative": r"value is -99\.\d+ .*V ≥ 0",
    "raises": r"cannot be built for robot 'arm3' with 3 joints: ZeroDivisionError: my own mistake "
    r"\(own_tasks\.py, line \d+\)",
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_faulty_v_is_refused_by_component_and_figures(fault):
    with pytest.raises(ConfigError, match=FAULTS[fault]) as caught:
        build_arm("own_tasks:Sway", {"fault": fault})
    assert caught.value.file == "mine.yaml"
    assert caught.value.key == "v.task"
    assert caught.value.value == "own_tasks:Sway"


FAULTS_OF_ERRORS = {
    "jacobian": r"jacobian\[0, 1\] \(elbow\) is -?\d\S*, but error\[0\] has",
    "error_rate": r"error_rate\[0\] \(∂e/∂t\) is 0, but error\[0\] has .* quotient -0\.0",
    "consistent": r"jacobian\[0, 2\] \(wrist\) is 0\.\d+, but error\[0\] has",
    "square": r"value is \S+, but ½\|error\|² is \S+ at t = 0\.3 s",
    "shape": r"cannot be built for robot 'arm3'.*Value",
    "nan": r"error_rate\[0\] \(∂e/∂t\) is nan",
}


@pytest.mark.parametrize("fault", FAULTS_OF_ERRORS)
def test_a_faulty_error_is_refused_by_component_and_figures(fault):
    with pytest.raises(ConfigError, match=FAULTS_OF_ERRORS[fault]) as caught:
        build_arm("own_tasks:Reach", {"fault": fault})
    assert caught.value.key == "v.task"


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
    with pytest.raises(ConfigError, match=r"^mine\.yaml: v\.parameters\.terms\.1\.task: rate"):
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
    ("own_tasks:NotATask", {}, "v.task: is not a task class"),
    ("own_tasks:NoUpdate", {}, "v.task: lacks the method update"),
    ("own_tasks:Tuned", {}, "v.task: has the method tune, which was renamed apply"),
    ("own_tasks:Nothing", {}, "v.task: cannot be imported: AttributeError"),
    ("com", {"target": POINT, "fraem": "base"}, "v.parameters.fraem: unknown key"),
    ("com", {"target": POINT, "frame": "r_sole"}, "v.parameters.frame: robot 'arm3' has no such"),
    ("com", {"target": POINT, "frame": "base", "weights": [1, 2]}, "expected 1 or 3 numbers"),
    ("com", {"target": POINT, "frame": "base", "weights": [0]}, "not all of them 0"),
    ("posture", {"posture": "bend"}, "v.parameters.posture: the robot has no such posture"),
    ("posture", {"posture": "bent", "target_rad": [1.0]}, "one of posture, target_rad"),
    ("posture", {"target_rad": [1.0]}, "v.parameters.target_rad: has 1 values"),
    ("posture", {"joints": ["knee"], "target_rad": [1]}, "joints: is no joint of this robot"),
    ("posture", {"joints": ["wrist", "wrist"], "target_rad": [1, 1]}, "joints: is named twice"),
    ("joint_curve", {"curve": "own_tasks:Flat", "speed_rad_s": 1}, "has α of shape (1,)"),
    ("joint_curve", {"curve": "helix", "speed_rad_s": 1}, "no curve is called 'helix'"),
    (
        "joint_curve",
        {"curve": "own_tasks:Eight", "curve_parameters": {"wrong": True}, "speed_rad_s": 1},
        "v.parameters.curve: gradient[2] (wrist) is",
    ),
    (
        "joint_curve",
        {"curve_parameters": {"joints": ["a", "b"], "radii_rad": [1, 1]}, "speed_rad_s": 1},
        "v.parameters.curve_parameters: the robot has no such joint (found 'a')",
    ),
    (
        "joint_curve",
        {
            "curve_parameters": {"joints": ["elbow", "wrist"], "radii_rad": [1, 1]},
            "speed_rad_s": 1,
            "objective_weights": [1.0, 0.0],
        },
        "expected 1 or 2 numbers > 0",
    ),
]


@pytest.mark.parametrize(("task", "parameters", "problem"), WRONG)
def test_what_is_wrong_is_named(task, parameters, problem):
    with pytest.raises((ConfigError, UnknownNameError), match=re.escape(problem)):
        build_arm(task, parameters)


def test_an_unknown_task_names_the_nearest():
    with pytest.raises(UnknownNameError, match=r"Did you mean 'frame_pose'.*mine\.yaml: v\.task"):
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
