"""A law that is too fast for servos that give way certifies nothing, and says why."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hoap3.protocol.errors import UsageError
from hoap3.protocol.messages import State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.config import build
from hoap3.remote_controller.controllers.base import STATUS, Controller
from hoap3.remote_controller.controllers.servo_rate import too_fast
from hoap3.remote_controller.outcome import Outcome
from hoap3.robot_emulator.robots import load
from hoap3.tools.analysis.verdicts import in_words, judge
from hoap3.tools.services.configs import load_controller_config

NOTHING_HELD = {"interventions": 0, "torque_limited": 0}

HOAP3 = load("hoap3")
SLOW = HOAP3.model_copy(update={"servo_rate_1_s": 0.5})
LAWS = ("qp12", "pinv", "stable_qp")
COM = {
    "task": "com",
    "parameters": {
        "frame": "r_sole",
        "target": {"kind": "point", "position_m": [0.0, 0.0, 0.2]},
    },
}


def law(name: str, robot: RobotDescription, **parameters: Any) -> Controller:
    settings = load_controller_config(name)[0]
    changed = settings.model_copy(update={"parameters": {**settings.parameters, **parameters}})
    return build(changed, robot, load_controller_config(name)[1])


def answered(controller: Controller, robot: RobotDescription, ticks: int = 3) -> Outcome:
    """What comes of a robot that stays where it is."""
    state, outcome = State.allocate(**robot.state_lengths), Outcome(controller, robot)
    state.q[:] = state.reference[:] = robot.initial_position
    controller.reset(state, None)
    for state.tick in range(ticks):
        outcome.note(state, controller.step(state))
    return outcome


@pytest.mark.parametrize("name", LAWS)
def test_the_condition_and_the_verdict_tell_both_rates(name):
    controller = law(name, SLOW)
    told = answered(controller, SLOW).as_json()
    assert controller.command.solver_status == STATUS["uncertified"]
    (why,) = [each for each in told["not_certified"] if each.startswith("loop")]
    assert told["not_certified"][why] == told["certifiable"] == 3
    assert "servos 0.5/s" in why
    note = controller.notes()[0]
    assert why in note
    judged = judge(None, NOTHING_HELD, told)
    assert judged["task"]["not_certified"][why] == 3
    assert why in in_words(judged)["task"]


@pytest.mark.parametrize("name", LAWS)
def test_a_law_that_is_no_loop_around_its_servos_is_judged_as_ever(name):
    around, usual = law(name, SLOW, kinematics_from="reference"), law(name, HOAP3)
    assert around.conditions == usual.conditions
    assert answered(around, SLOW).as_json() == answered(usual, HOAP3).as_json()
    assert around.notes() == usual.notes()
    assert not any("certified" in note for note in usual.notes())


def test_the_limit_itself_is_too_fast():
    assert too_fast(SLOW, 0.5, "measured") == "loop 0.5/s >= servos 0.5/s"
    assert too_fast(SLOW, 0.499, "measured") == ""
    assert too_fast(SLOW, 9.0, "reference") == ""
    assert too_fast(HOAP3, 9.0, "measured") == ""


def servos(rate_1_s: float) -> RobotDescription:
    return HOAP3.model_copy(update={"servo_rate_1_s": rate_1_s})


@pytest.mark.parametrize("name", ["qp12", "pinv"])
def test_a_change_leaves_the_errors_those_of_the_last_state(name):
    controller, state = law(name, servos(1e3)), State.allocate(**HOAP3.state_lengths)
    controller.reset(state, None)
    state.q[:] = state.reference[:] = HOAP3.initial_position + 0.1
    controller.step(state)
    before = controller.task_errors()
    assert before != law(name, servos(1e3)).task_errors()
    controller.change({"beta": 45.0})
    assert controller.task_errors() == before


WEIGHTS = [
    ({"task.parameters.weights": [100.0]}, 10.0),
    ({"task.parameters.weights": [100.0], "psi.beta": 23.0}, 5.0),
    ({"psi.beta": 92.0}, 2.0),
    ({"task.parameters.weights": [4.0, 4.0, 4.0], "psi.beta": 23.0}, 1.0),
]


def told_rate(**parameters: Any) -> float:
    """The rate of a law that is too fast [1/s]."""
    (why,) = [each for each in law("stable_qp", SLOW, **parameters).conditions if "loop" in each]
    return float(why.split()[1].removesuffix("/s"))


@pytest.mark.parametrize(("request_", "faster"), WEIGHTS)
def test_changed_weights_count_as_those_of_a_config_do(request_, faster):
    """√W·J is what the rate is of: weights w make it √w times as fast."""
    rate = faster * told_rate(task=COM)
    enough = max(rate, told_rate(task=COM)) * 1.01
    law("stable_qp", servos(enough), task=COM).change(request_)
    if faster > 1.0:
        with pytest.raises(UsageError):
            law("stable_qp", servos(0.98 * rate), task=COM).change(request_)


def test_weights_of_the_config_are_no_part_of_the_changed_ones():
    heavy = {**COM, "parameters": {**COM["parameters"], "weights": [100.0]}}
    rate = told_rate(task=heavy)
    assert rate == pytest.approx(10.0 * told_rate(task=COM), rel=1e-2)
    controller = law("stable_qp", servos(1.01 * rate), task=heavy)
    controller.change({"task.parameters.weights": [1.0]})
    controller.change({"psi.beta": 460.0})
    with pytest.raises(UsageError, match=r"task\.parameters\.weights"):
        controller.change({"task.parameters.weights": [1.0, 1.0]})


def test_a_v_without_an_error_has_no_rate_that_servos_could_keep_up_with(monkeypatch):
    monkeypatch.syspath_prepend(Path(__file__).parent / "lyapunov_qp")
    controller = law("stable_qp", servos(1e6), task={"task": "flat_functions:Clock"})
    assert controller.too_fast
