"""`hoap3 verify` of controllers that command accelerations and torques."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from tampering import (
    ANSWERS,
    SETPOINT,
    STATE,
    Change,
    assert_no_false_alarm,
    bigger,
    changed_field,
    config_of,
    find_change,
    rewrite,
)
from tampering import ran as ran_with

from hoap3.protocol.config.settings import parse_yaml
from hoap3.tools.verify.verify import verify

Story = Callable[[str], Path]
OWN = "controller.parameters."
ORDER = f"{OWN}priorities.order=[hand, elbow, posture]"
HANDS = f"{OWN}priorities.order=[[right_hand, left_hand], head, left_foot, posture]"
SOON = (
    f"{OWN}priorities.timeline=[{{at_s: 0.1, order: [elbow, hand], over_s: 0.05}}, "
    "{at_s: 0.2, remove: elbow}]"
)
JOINTS, TSID = "joint_acceleration", "tsid_baxter"
STORIES: dict[str, tuple[str, str, tuple[str, ...]]] = {
    JOINTS: ("hoap3", JOINTS, ()),
    TSID: ("baxter", "tsid_baxter", ()),
    "tsid of accelerations": ("ur5", "tsid", ("emulator.command=acceleration",)),
    "ghc": ("lwr_weightless", "ghc", (ORDER, SOON)),
    "ghc_torque": ("lwr_weightless", "ghc_torque", (ORDER, SOON)),
    "hqp": ("lwr_weightless", "hqp", (ORDER, SOON)),
    "weighted": (
        "lwr_weightless",
        "weighted",
        (f"{OWN}priorities.timeline=[{{at_s: 0.1, weights: {{hand: 0.1}}, over_s: 0.1}}]",),
    ),
    "force": ("lwr_with_table", "ghc_force", ()),
    "humanoid": ("humanoid32_torque", "ghc_humanoid", (f"{OWN}priorities.timeline=[]", HANDS)),
}
"""Robot, controller and settings by name."""
SECONDS = 0.3


def marked_slow(names: Iterable[str], *quick: str) -> list[Any]:
    """All names as parameters; those that are not `quick` are slow."""
    return [pytest.param(name, marks=() if name in quick else pytest.mark.slow) for name in names]


def ran(folder: Path, robot: str, controller: str, *settings: str, seconds: float) -> Path:
    """A run in lockstep with settings."""
    given = "--robot", robot, "--controller", controller
    return ran_with(folder, *given, sets=settings, seconds=seconds)


@pytest.fixture(scope="module")
def story(tmp_path_factory: pytest.TempPathFactory) -> Story:
    """The log of a story, made once."""

    @cache
    def get(name: str) -> Path:
        robot, controller, settings = STORIES[name]
        folder = tmp_path_factory.mktemp("story") / "run"
        return ran(folder, robot, controller, *settings, seconds=SECONDS)

    return get


@pytest.mark.parametrize("name", marked_slow(STORIES, JOINTS, TSID, "ghc"))
def test_a_true_log_is_true(name, story):
    assert_no_false_alarm(story(name))


BOUNDS = f"{OWN}bounds."
CARRIED = "regularise=gravity_compensated"
WEAKER = "acceleration_max=[1000]"
LATE = "emulator.lockstep.compute_time_us=1500", "emulator.misses_to_stop=600"
LWR, FULL = "lwr_weightless", "emulator.plant.gravity=full"
SETTINGS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "naive bounds": ("hoap3", JOINTS, (f"{BOUNDS}kind=naive",)),
    "no bounds": ("hoap3", JOINTS, (f"{BOUNDS}kind=none",)),
    "less acceleration": ("hoap3", JOINTS, (f"{BOUNDS}shrink=true", f"{BOUNDS}{WEAKER}")),
    "lost answers": ("hoap3", JOINTS, LATE),
    "a wall": ("hoap3", JOINTS, (f"{OWN}posture=null", f"{OWN}posture_rad={[-3.0] * 21}")),
    "accelerations": (
        "ur5",
        JOINTS,
        ("emulator.command=acceleration", f"{OWN}posture=null", f"{OWN}posture_rad={[0.5] * 6}"),
    ),
    "tsid with weak motors": ("baxter", TSID, (f"{BOUNDS}torque_max=[8]",)),
    "tsid with naive bounds": ("baxter", TSID, (f"{BOUNDS}kind=naive", f"{OWN}task.kp=400")),
    "ghc with weak motors": ("lwr", "ghc", (FULL, f"{BOUNDS}torque_max=[20]")),
    "ghc_torque with weak motors": ("lwr", "ghc_torque", (FULL, f"{BOUNDS}torque_max=[20]")),
    "hqp with weak motors": ("lwr", "hqp", (FULL, f"{BOUNDS}torque_max=[20]")),
    "ghc at bounds": (LWR, "ghc", (ORDER, f"{BOUNDS}acceleration_max=[3]")),
    "hqp at bounds": (LWR, "hqp", (ORDER, f"{BOUNDS}torque_max=[5]")),
    "ghc without damping": (LWR, "ghc", (ORDER, SOON, f"{OWN}null_damping_per_s=0")),
    "ghc that smooths": (LWR, "ghc", (ORDER, f"{OWN}smoothing=0.05")),
    "ghc without regularisation": (LWR, "ghc", (ORDER, f"{OWN}regularise=none")),
    "weighted, otherwise": (LWR, "weighted", (f"{OWN}{CARRIED}", f"{BOUNDS}kind=none")),
    "the robot carries itself": ("lwr", "ghc", ("emulator.plant.gravity=compensated", ORDER)),
    "without friction": ("lwr", "ghc", (FULL, f"{OWN}compensate_friction=false", ORDER)),
}


@pytest.mark.slow
def test_levels_beside_a_singular_one_raise_no_false_alarm(tmp_path):
    slow = f"{BOUNDS}acceleration_max=[3]"  # axes of the wrist come to be parallel

    run = ran(tmp_path / "run", LWR, "hqp", ORDER, slow, seconds=2.0)

    assert verify(run).claims.by_tick() == []


@pytest.mark.parametrize("name", marked_slow(SETTINGS, "lost answers"))
def test_other_settings_raise_no_false_alarm(name, tmp_path):
    robot, controller, settings = SETTINGS[name]

    found = assert_no_false_alarm(ran(tmp_path / "run", robot, controller, *settings, seconds=0.4))

    if "weak" in name:
        fallbacks = [n for c, n in found.claims.counts.items() if c.startswith("fallback: ")]
        assert max(each.checked for each in fallbacks) > 10


MANY = """
controller: ghc
robot: humanoid32
parameters:
  w_r: 1.0e-3
  tasks:
    - {name: com, task: com, kp: 50.0,
       parameters: {frame: l_sole, target: {kind: circle, center_m: [0.0, -0.1, 0.8],
                    radius_m: 0.02, period_s: 2.0, approach_s: 0.5}}}
    - {name: turn, task: frame_orientation, kp: 40.0,
       parameters: {frame: head, rotation_rad: [0.1, 0.0, 0.2], turn_s: 1.0}}
    - {name: hand, task: frame_pose, kp: 60.0, kd: 12.0,
       parameters: {frame: r_palm, reference: head, rotation_rad: [0.0, 0.3, 0.0], turn_s: 0.7,
                    target: {kind: point, position_m: [0.3, -0.3, -0.3], approach_s: 1.0}}}
    - {name: left, task: frame_position, kp: 30.0,
       parameters: {frame: l_palm, axes: [x, z], weights: [1.0, 2.0],
                    target: {kind: waypoints, speed_m_s: 0.4,
                             points_m: [[0.4, 0.2, 0.2], [0.3, 0.3, 0.3]]}}}
    - {name: held, task: frame_pose, kp: 30.0, parameters: {frame: r_sole}}
    - {name: posture, task: posture, kp: 30.0, parameters: {approach_s: 0.5}}
  priorities: {order: [com, [turn, hand], left, held, posture]}
"""
WRENCH = """
controller: ghc
robot: lwr
parameters:
  tasks:
    - {name: hand, task: wrench, kp: 30.0, kd: 20.0,
       parameters: {frame: ee, rotation_rad: hold, axes: [z, rx], wrench: [12.0, 0.0],
                    target: {kind: point, position_m: [-0.5, -0.25, 0.49], approach_s: 0.3},
                    force_kp: 0.2, force_ki_per_s: 4.0, force_kd: 3.0, integral_max: [5.0, 0.5]}}
    - {name: posture, task: posture, kp: 30.0, kd: 20.0, parameters: {posture: bent}}
  priorities:
    order: [hand, posture]
    timeline:
      - {at_s: 1.2, remove: hand, over_s: 0.1}
      - {at_s: 1.6, insert: hand, over_s: 0.1}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "config", "seconds"),
    [("humanoid32_torque", MANY, 0.5), ("lwr_with_table", WRENCH, 2)],
)
def test_tasks_of_all_kinds_raise_no_false_alarm(robot, config, seconds, tmp_path):
    file = tmp_path / "many.yaml"
    file.write_text(config, "utf-8")

    found = assert_no_false_alarm(ran(tmp_path / "run", robot, str(file), seconds=seconds))

    if robot == "lwr_with_table":
        assert found.claims.counts["wrench"].checked == 2000


@pytest.mark.parametrize(
    ("constraint", "verdict"),
    [
        ("constraint: joint_torque", "true"),
        ("constraint: pfaffian, parameters: {function: 'numpy:atleast_2d'}", "not verified"),
    ],
)
def test_constraints_that_cannot_be_recomputed_are_named(constraint, verdict, tmp_path):
    settings = f"{OWN}constraints=[{{{constraint}}}]"

    run = ran(tmp_path / "run", LWR, "ghc", settings, seconds=0.05)

    counts = assert_no_false_alarm(run, verdict).claims.counts
    assert counts["torques"].checked == 50
    assert ("optimum" in counts) == (verdict == "true")
    if verdict == "not verified":
        (reason,) = counts["constraint pfaffian"].unverified
        assert "function" in reason


CHANGES: dict[str, Callable[[int], Change]] = {
    **ANSWERS,
    "reference": lambda n: changed_field(STATE, n, "reference", bigger, joint=3),
    "dq": lambda n: changed_field(STATE, n, "dq", lambda v: v + 1e-6, joint=3),
    "setpoint": lambda n: changed_field(SETPOINT, n, "values", bigger, joint=3),
    "decision": lambda n: changed_field(SETPOINT, n, "decision", lambda a: a + 1e-5, joint=3),
    "torque": lambda n: changed_field(SETPOINT, n, "decision", lambda t: t + 1e-6, joint=-1),
    "required V rate": lambda n: changed_field(SETPOINT, n, "v_rate_required", lambda r: r + 1e-6),
    "margin": lambda n: changed_field(SETPOINT, n, "margin", lambda m: m + 1e-6),
    "active joints": lambda n: changed_field(SETPOINT, n, "active_joints", lambda a: a + 1),
    "status": lambda n: changed_field(SETPOINT, n, "solver_status", lambda s: s + 1),
    "path": lambda n: changed_field(SETPOINT, n, "solver_path", lambda p: p + 1),
    "fallback": lambda n: changed_field(SETPOINT, n, "fallback", lambda f: f + 1),
    "torque share": lambda n: changed_field(SETPOINT, n, "extra", bigger, joint=0),
    "error": lambda n: changed_field(SETPOINT, n, "extra", bigger, joint=1),
    "importance": lambda n: changed_field(SETPOINT, n, "extra", lambda a: a + 1e-6, joint=-1),
}
MEASURED, COLUMNS = {"q", "dq"}, {"torque share", "error", "importance"}


def changes_of(name: str) -> list[str]:
    """The kinds of change that move what a controller claims."""
    if name == JOINTS:  # which starts from the reference, and has no columns
        return [kind for kind in CHANGES if kind not in MEASURED | COLUMNS]
    return [kind for kind in CHANGES if kind != "reference"]


@pytest.mark.parametrize("name", marked_slow(STORIES, JOINTS))
def test_what_is_changed_is_found(name, story, tmp_path):
    for kind in changes_of(name):
        _find_all(kind, story(name), 1, tmp_path / kind)


@pytest.mark.long
@pytest.mark.parametrize("name", STORIES)
def test_what_is_changed_is_found_at_a_hundred_places(name, story, tmp_path):
    for kind in changes_of(name):
        _find_all(kind, story(name), 100, tmp_path / kind)


PARAMETERS: dict[str, tuple[str, ...]] = {
    JOINTS: ("kp",),
    TSID: ("task.kp", "posture.kp", "posture.weight"),
    "ghc": ("w_r", "tasks.0.kp", "tasks.1.parameters.target.position_m.2"),
    "ghc_torque": ("tasks.0.kp", "tasks.0.kd"),
    "hqp": ("w_r", "tasks.1.kp"),
    "weighted": ("w_r", "priorities.weights.elbow"),
    "force": ("tasks.1.kp", "priorities.timeline.0.over_s"),
}


@pytest.mark.parametrize("name", marked_slow(PARAMETERS, JOINTS, TSID))
def test_another_parameter_in_the_config_is_found(name, story, tmp_path):
    for key in PARAMETERS[name]:
        config = parse_yaml(config_of(story(name)), "config")
        parent, last = config["parameters"], key.rsplit(".")[-1]
        for part in key.split(".")[:-1]:
            parent = parent[int(part) if part.isdigit() else part]
        place = int(last) if last.isdigit() else last
        parent[place] = bigger(parent[place])
        text = json.dumps(config).encode()

        path = rewrite(story(name), "controller", tmp_path / key, list, text)

        assert verify(path).claims.false, key


def test_a_changed_schedule_is_found(story, tmp_path):
    config = parse_yaml(config_of(story("ghc")), "config")
    config["parameters"]["priorities"]["timeline"][1]["at_s"] = 0.201

    path = rewrite(story("ghc"), "controller", tmp_path, list, json.dumps(config).encode())

    assert verify(path).claims.counts["alpha"].first_false == 200


@pytest.mark.parametrize(
    "wrong",
    [
        "joint_acceleration: {kp: .nan}",
        "joint_acceleration: {kp: yes}",
        "joint_acceleration: {posture: [1]}",
        "joint_acceleration: {bounds: {kind: some}}",
        "tsid: {bounds: 3}",
        "tsid: {task: {kp: .inf}}",
        "ghc: {tasks: []}",
        "ghc: {tasks: [{task: nothing}]}",
        "ghc: {tasks: [{task: frame_pose, kp: x, parameters: {frame: trunk}}]}",
        "ghc: {tasks: [{task: wrench, parameters: {frame: trunk}}]}",
        "hqp: {tasks: [{task: posture}], priorities: {order: [none]}}",
        "weighted: {tasks: [{task: posture}], priorities: {weights: {posture: [1]}}}",
        "weighted: {}",
    ],
)
def test_a_config_that_is_none_is_not_reckoned_with(wrong, story, tmp_path):
    controller, parameters = wrong.split(": ", 1)
    config = f"controller: {controller}\nparameters: {parameters}\n".encode()

    found = verify(rewrite(story(JOINTS), "controller", tmp_path, list, config))

    assert found.verdict == "not verified"
    assert found.claims.counts["certificate"].checked == 0


def test_states_that_are_not_finite_are_refused_and_no_false_alarm(story, tmp_path):
    change = changed_field(STATE, 20, "q", lambda _: float("nan"), joint=2)

    found = verify(rewrite(story(TSID), "controller", tmp_path, change)).claims

    assert found.counts["refused: values"].first_false == 20


def _find_all(kind: str, run: Path, count: int, folder: Path) -> None:
    """A change is found at so many random places, unless it changes nothing there."""
    places = range(10, round(1000 * SECONDS) - 10)
    for number in random.Random(kind).sample(places, count):
        find_change(CHANGES[kind](number), run, "controller", number, folder)
