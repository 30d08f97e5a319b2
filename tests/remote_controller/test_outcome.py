"""What a controller tells at the end of a run, beside what its robot did, computed anew."""

from __future__ import annotations

import json
import math
import sys
from typing import Any

import numpy as np
import pytest

from hoap3.protocol.config.settings import Settings, parse
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.recorder import MemoryRecorder, NoRecorder
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.balance import balance_of
from hoap3.remote_controller.config import CONFIGS, ControllerConfig, build
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.outcome import EVERY, Outcome
from hoap3.remote_controller.service import Service
from hoap3.remote_controller.tasks.error_task import ErrorTask
from hoap3.remote_controller.tasks.lyapunov import LyapunovFunction
from hoap3.robot_emulator.robots import load
from hoap3.tools.analysis.certificates import CountingRecorder
from hoap3.tools.analysis.deadline_verdict import unknown_deadlines
from hoap3.tools.analysis.verdicts import judge
from hoap3.tools.services.configs import load_controller_config, load_emulator_config
from hoap3.tools.services.simulate import Lockstep

NOTHING_HELD = {"interventions": 0, "torque_limited": 0}

IN_TIME = unknown_deadlines("", "", "pass")
HOAP3 = load("hoap3")
Told = dict[str, Any]


def run(controller: Any, duration: float, robot: str = "hoap3") -> tuple[Told, list[State], list]:
    """What the controller told, the States that asked, and its records."""
    log, robot_log = MemoryRecorder(), MemoryRecorder()
    file = (
        load_controller_config(controller)[1]
        if isinstance(controller, str)
        else str(CONFIGS / "x.yaml")
    )
    settings = load_emulator_config(robot, seed=0)[0], load_controller_config(controller)[0]
    lockstep = Lockstep(*settings, robot_log, log, files=("robot", file))
    lockstep.run(duration)
    states = []
    for record in robot_log.records:
        if record.kind == Kind.STATE:
            description = lockstep.controller.description
            state = State.allocate(**description.state_lengths)
            state.load(record.payload)
            states.append(state)
    told = lockstep.controller_loop.summary
    assert told is not None
    return told, [state for state in states if state.mode == State.ACTIVE], log.records


def com(q: np.ndarray, frame: str = "r_sole") -> np.ndarray:
    """Centre of mass of HOAP-3 as seen from a frame."""
    kinematics, found = Kinematics(HOAP3), np.zeros(3)
    kinematics.update(q)
    kinematics.com(kinematics.frame_id(frame), found, np.zeros((3, HOAP3.n)))
    return found


def test_the_error_is_that_of_the_last_state_that_was_answered():
    told, states, records = run("qp12", 0.3)
    target = np.array([0.01, 0.025, 0.2869])  # of HOAP-3's default task
    (error,) = told["tasks"]
    expected = float(np.linalg.norm(com(states[-1].q) - target))
    assert error["error"] == pytest.approx(expected, rel=1e-9)
    assert (error["task"], error["unit"], error["tolerance"]) == ("com", "m", 1e-3)
    assert (error["within"], error["judged"]) == (False, True)
    (summary,) = [json.loads(r.payload) for r in records if r.kind == Kind.SUMMARY]
    assert summary.pop("session_id") == states[-1].session_id
    assert summary == told
    assert told["answers"] == told["certifiable"] == told["certified"] == len(states)


def test_a_tolerance_is_a_parameter_of_the_controller():
    law = {"controller": "qp12", "parameters": {"tolerance_m": 0.1}}
    (error,) = run(law, 0.05)[0]["tasks"]
    assert error["within"]
    assert error["tolerance"] == 0.1


def stable(task: str, **parameters: Any) -> Told:
    law = {
        "controller": "stable_qp",
        "parameters": {"task": {"task": task, "parameters": parameters}},
    }
    return run(law, 0.05)[0]


def test_a_pose_has_a_length_and_an_angle_and_what_has_no_weight_is_left_out():
    pose = {
        "frame": "l_sole",
        "reference": "r_sole",
        "target": {"kind": "point", "position_m": [0.0, 0.2, 0.0]},
        "rotation_rad": [0.0, 0.0, 0.5],
    }
    length, angle = stable("frame_pose", **pose)["tasks"]
    assert (length["unit"], angle["unit"]) == ("m", "deg")
    assert angle["error"] == pytest.approx(np.degrees(0.5), rel=0.1)
    (alone,) = stable("frame_pose", **pose, weights=[1, 1, 1, 0, 0, 0])["tasks"]
    assert alone["unit"] == "m"


def test_a_posture_has_the_greatest_error_of_any_joint():
    joints = ["l_elbow", "r_elbow"]
    start = [HOAP3.initial_position[HOAP3.joint_names.index(name)] for name in joints]
    target = [start[0] + 0.2, start[1] + 0.1]
    (error,) = stable("posture", joints=joints, target_rad=target, tolerance_deg=20)["tasks"]
    assert error["error"] == pytest.approx(np.degrees(0.2), rel=0.2)
    assert error["within"]


def test_each_term_of_a_sum_is_judged_by_its_own_tolerance():
    point = {"frame": "r_sole", "target": {"kind": "point", "position_m": [0.01, 0.025, 0.28]}}
    term = {"task": "com", "parameters": {**point, "tolerance_m": 0.05}}
    posture = {"task": "posture", "parameters": {"posture": "walk_ready", "tolerance_deg": 1e-3}}
    both = stable("weighted_sum", terms=[term, posture])
    names = ["weighted_sum: 1. com", "weighted_sum: 2. posture"]
    assert [error["task"] for error in both["tasks"]] == names
    assert [(error["judged"], error["within"]) for error in both["tasks"]] == [
        (True, True),
        (True, False),
    ]
    assert judge(IN_TIME, NOTHING_HELD, both)["verdicts"]["task"] == "fail"


class Elbow(ErrorTask):
    """e = q_0 - (start + away): a joint at a distance from where it starts."""

    class Parameters(Settings):
        away: float = 0.3
        lost: bool = False

    def __init__(self, description, kinematics, parameters):
        super().__init__(description.n, 1)
        self.q, self.parameters = np.zeros(description.n), parameters
        self.goal = description.initial_position[0] + parameters.away
        self.jacobian[0, 0] = 1.0

    def evaluate(self, kinematics, time_s):
        kinematics.joints(self.q)
        self.error[0] = self.q[0] - self.goal


class ElbowAngle(Elbow):
    """The same with a unit."""

    unit = "rad"


class OwnElbow(Elbow):
    """The same with a tolerance of its own."""

    tolerance = 0.5


class OnlyV(LyapunovFunction):
    """V = ½(q_0 - start - 0.3)², without an error."""

    def __init__(self, description, kinematics, parameters):
        super().__init__(description.n)
        self.q, self.goal = np.zeros(description.n), description.initial_position[0] + 0.3

    def update(self, kinematics, time_s):
        kinematics.joints(self.q)
        away = self.q[0] - self.goal
        self.value, self.gradient[0] = 0.5 * away**2, away


class Silent(Elbow):
    """The same, but it reports nothing."""

    def accuracy(self):
        return []


def own(task: type, **entry: Any) -> Told:
    """What a controller tells of a task of somebody else."""
    given = {"task": f"{__name__}:{task.__name__}", **entry}
    return run({"controller": "stable_qp", "parameters": {"task": given}}, 0.02)[0]


@pytest.mark.parametrize(
    ("task", "entry", "unit", "tolerance", "verdict"),
    [
        (Elbow, {}, "", 1e-3, "fail"),
        (Elbow, {"parameters": {"away": 0.0}}, "", 1e-3, "pass"),
        (Elbow, {"tolerance": 0.4}, "", 0.4, "pass"),
        (ElbowAngle, {}, "deg", 0.5, "fail"),
        (ElbowAngle, {"tolerance": 0.4}, "deg", math.degrees(0.4), "pass"),
        (OwnElbow, {}, "", 0.5, "pass"),
        (OwnElbow, {"tolerance": 0.1}, "", 0.1, "fail"),
        (OnlyV, {}, "", 1e-3, "fail"),
        (OnlyV, {"tolerance": 0.4}, "", 0.4, "pass"),
    ],
)
def test_a_users_task_is_judged_like_ours(task, entry, unit, tolerance, verdict):
    told = own(task, **entry)
    (error,) = told["tasks"]
    size = math.radians(error["error"]) if unit == "deg" else error["error"]
    away = entry.get("parameters", {}).get("away", 0.3)
    assert size == pytest.approx(away, rel=0.1)
    assert (error["unit"], error["tolerance"]) == (unit, pytest.approx(tolerance))
    assert error["judged"]
    assert judge(IN_TIME, NOTHING_HELD, told)["verdicts"]["task"] == verdict
    named = "default tolerance" in judge(IN_TIME, NOTHING_HELD, told)["task"]["text"]
    assert named == error["default_tolerance"] == (tolerance == 1e-3)


def test_a_task_that_reports_no_error_is_listed_and_a_run_with_it_alone_never_passes():
    told = own(Silent)
    (error,) = told["tasks"]
    assert (error["error"], error["judged"], error["note"]) == (None, False, "reports no error")
    judged = judge(IN_TIME, NOTHING_HELD, told)
    assert judged["verdicts"]["task"] == "not judged"
    assert judged["task"]["reasons"] == ["no_target"]


@pytest.mark.parametrize("law", ["clik", "ghc_velocity"])
def test_so_it_is_by_controllers_of_several_tasks(law):
    task = {"name": "elbow", "task": f"{__name__}:Elbow"}
    told = run({"controller": law, "parameters": {"tasks": [task]}}, 0.02)[0]
    (error,) = told["tasks"]
    assert (error["task"], error["within"], error["judged"]) == ("elbow", False, True)


def test_a_task_of_ours_refuses_the_tolerance_of_others():
    entry = {"task": "com", "tolerance": 0.1}
    with pytest.raises(ConfigError, match=r"tolerance"):
        run({"controller": "stable_qp", "parameters": {"task": entry}}, 0.02)


def answers_of(statuses: list[int], present: list[int], certifies: bool) -> Told:
    """What comes of answers with these statuses, while these conditions hold."""
    controller = build(load_controller_config("qp12")[0], HOAP3)
    controller.certifies, controller.not_certified_in = certifies, 2
    controller.conditions = ("touches", "priorities in transition")
    outcome, state = Outcome(controller, HOAP3), State.allocate(**HOAP3.state_lengths)
    for status, bits in zip(statuses, present, strict=True):
        controller.present, controller.command.solver_status = bits, status
        outcome.note(state, controller.command)
    told = outcome.as_json()
    within = {"within": True, "error": 0.0}
    return {**told, "tasks": [{**error, **within} for error in told["tasks"]], "balance": None}


CERTIFIED, UNCERTIFIED, NONE = 0, 2, 4


@pytest.mark.parametrize(
    ("statuses", "present", "certifies", "counts", "verdict"),
    [
        ([CERTIFIED] * 95 + [UNCERTIFIED] * 5, [0] * 100, True, (95, 100), "pass"),
        ([CERTIFIED] * 94 + [UNCERTIFIED] * 6, [0] * 100, True, (94, 100), "fail"),
        ([CERTIFIED] * 6 + [UNCERTIFIED] * 94, [0] * 6 + [1] * 94, True, (6, 100), "fail"),
        ([CERTIFIED] * 80 + [UNCERTIFIED] * 20, [0] * 80 + [2] * 20, True, (80, 80), "not judged"),
        ([UNCERTIFIED] * 20, [2] * 20, True, (0, 0), "not judged"),
        ([CERTIFIED] * 96 + [UNCERTIFIED] * 4, [0] * 96 + [2] * 4, True, (96, 96), "pass"),
        ([CERTIFIED] * 6 + [UNCERTIFIED] * 94, [0] * 100, False, (6, 100), "fail"),
        ([CERTIFIED] * 6 + [NONE] * 94, [0] * 100, True, (6, 100), "fail"),
        ([UNCERTIFIED] * 20, [0] * 20, False, (0, 0), "pass"),
        ([NONE] * 20, [0] * 20, True, (0, 0), "pass"),
    ],
)
def test_what_can_be_certified_is_what_a_controller_does(
    statuses, present, certifies, counts, verdict
):
    told = answers_of(statuses, present, certifies)
    assert (told["certified"], told["certifiable"]) == counts
    judged = judge(IN_TIME, NOTHING_HELD, told)
    assert judged["verdicts"]["task"] == verdict
    assert f"{counts[0]} of {counts[1]}" in judged["task"]["text"] or counts == (0, 0)


@pytest.mark.parametrize(
    ("config", "robot", "judged", "certifiable"),
    [
        ("clik_ur5", "ur5", {"hand"}, True),
        ("hqp", "lwr_weightless", {"posture"}, False),
        ("ghc_velocity", "hoap3", {"com"}, True),
        ("osqp", "hoap3", {"com"}, True),
        ("tsid_baxter", "baxter", {"pose"}, True),
        ("joint_acceleration", "hoap3", {"posture"}, True),
        ("com_circulation", "hoap3", {"task_curve"}, True),
    ],
)
def test_what_is_judged_by_each_controller(config, robot, judged, certifiable):
    told = run(config, 0.02, robot)[0]
    assert {error["task"] for error in told["tasks"] if error["judged"]} == judged
    assert {error["note"] for error in told["tasks"] if not error["judged"]} <= {"lower priority"}
    assert (told["certifiable"] > 0) == certifiable


def test_margins_are_judged_where_there_are_constraints():
    assert run("qp12", 0.02)[0]["margin"] is None
    margin = run("stable_qp", 0.02)[0]["margin"]
    assert margin["least"] >= 0.0
    assert margin["tolerance"] == 1e-6
    assert margin["of"].split(": ")[0] in {"joint_position", "support_polygon", "zmp"}
    assert margin["unit"] in {"m", "rad"}
    told = judge(IN_TIME, NOTHING_HELD, run("ghc", 0.02, "lwr_weightless")[0])["limits_and_balance"]
    assert told["smallest_margin_of"] == "bounds of joints"
    assert "of the greatest" in told["smallest_margin_unit"]


@pytest.mark.parametrize(
    ("margins", "least", "verdict"),
    [
        ((math.inf,), None, "pass"),
        ((0.5, math.inf), 0.5, "pass"),
        ((-1.0, -math.inf), -sys.float_info.max, "fail"),
        ((-1.0, math.nan, 0.5), -sys.float_info.max, "fail"),
    ],
)
def test_a_margin_of_minus_infinity_or_nan_is_a_violation(margins, least, verdict):
    settings = (
        load_emulator_config("hoap3", seed=0)[0],
        load_controller_config(load_controller_config("stable_qp")[1])[0],
    )
    outcome = Outcome(Lockstep(*settings, NoRecorder(), NoRecorder()).controller, HOAP3)
    state, answer = State(HOAP3.n), Setpoint(HOAP3.n)
    state.q[:] = HOAP3.initial_position
    for answer.margin in margins:
        outcome.note(state, answer)
    told = outcome.as_json()
    json.dumps(told["margin"], allow_nan=False)
    assert (told["margin"] or {"least": None})["least"] == least
    assert judge(IN_TIME, NOTHING_HELD, told)["verdicts"]["limits_and_balance"] == verdict


class Link:
    """A robot that grants authority at once."""

    robot = "hoap3"
    session_id = 7

    def name_conflict(self) -> str:
        return ""

    def ask(self, verb: str, *, body: bytes) -> bytes:
        status = {"mode": "idle", "holder": None, "session_id": self.session_id, "tick": 3}
        status["lockstep"] = False
        if verb == "acquire":
            status |= {"granted": True, "epoch": 1, "from_tick": 23}
        return HOAP3.to_json() if verb == "description" else json.dumps(status).encode()


def test_what_was_before_the_last_engagement_counts_too():
    recorder, link = CountingRecorder(), Link()
    config = parse(ControllerConfig, {"robot": "hoap3", "controller": "qp12"}, "config")
    service: Any = Service(config, recorder, lambda _: None, lambda: False)

    def engage(q: np.ndarray, tick: int) -> Told:
        """What is told of an engagement with one answer."""
        assert service._engage(link)
        state = State.allocate(**HOAP3.state_lengths)
        state.session_id, state.tick, state.epoch = link.session_id, tick, 1
        state.mode, state.q[:], state.reference[:] = State.ACTIVE, q, q
        assert service.loop.answer(0, state.dump()) is not None
        service.loop.sent()
        service.loop.sum_up()
        assert recorder.outcome is not None
        return recorder.outcome

    start = np.array(HOAP3.initial_position)
    falling = start.copy()
    falling[[HOAP3.joint_names.index(f"{side}_shoulder_roll") for side in "rl"]] += 1.2
    falling[HOAP3.joint_names.index("l_knee")] += 0.2
    assert engage(falling, 30)["balance"]["outside"] == 1
    for tick in range(100, 100 + EVERY):
        told = engage(start, tick)
    assert told["answers"] == told["certifiable"] == 1 + EVERY
    assert (told["balance"]["checked"], told["balance"]["outside"]) == (2, 1)
    assert judge(IN_TIME, NOTHING_HELD, told)["verdicts"]["limits_and_balance"] == "fail"
    link.session_id = 8  # the robot was started again
    assert engage(start, 30)["answers"] == 1


def test_balance_is_that_of_every_tenth_state():
    law = {"controller": "qp12", "parameters": {"target_m": [9, 9, 9], "psi_scale": "one"}}
    told, states, _ = run(law, 0.5)
    sole = np.array([0.054, 0.0365])
    edges = [float((sole - np.abs(com(state.q)[:2])).min()) for state in states[::EVERY]]
    found = told["balance"]
    assert found["checked"] == len(edges)
    assert found["outside"] == sum(edge < -1e-4 for edge in edges) > 0
    assert found["least_m"] == pytest.approx(min(edges), abs=1e-9)


def test_both_soles_carry_while_both_are_flat_on_the_ground():
    start = np.array(HOAP3.initial_position)  # both soles are flat
    start[[HOAP3.joint_names.index(f"{side}_shoulder_roll") for side in "rl"]] += 1.2
    assert 0.04 < com(start)[1] < 0.05  # beside the right sole, between both
    balance = balance_of(HOAP3)
    assert balance is not None
    balance.look(start)
    assert (balance.checked, balance.outside) == (1, 0)
    lifted = start.copy()
    lifted[HOAP3.joint_names.index("l_knee")] += 0.2
    balance.look(lifted)
    assert (balance.checked, balance.outside) == (2, 1)


def test_postures_that_are_not_finite_are_left_out():
    balance = balance_of(HOAP3)
    assert balance is not None
    balance.look(np.full(HOAP3.n, np.nan))
    assert balance.as_json() is None


@pytest.mark.parametrize("robot", ["ur5", "humanoid32"])
def test_where_no_sole_is_fixed_none_carries(robot):
    assert balance_of(load(robot)) is None
