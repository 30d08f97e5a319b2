"""A law that is too fast for servos that give way certifies nothing, and says why."""

from __future__ import annotations

from typing import Any

import pytest

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.messages import State
from hoap3.remote_controller.config import build
from hoap3.remote_controller.controllers.base import STATUS, Controller
from hoap3.remote_controller.controllers.servo_rate import too_fast
from hoap3.remote_controller.outcome import Outcome
from hoap3.robot_emulator.robots import load
from hoap3.tools.show.verdicts import in_words, judge
from hoap3.tools.simulate import controller_file, controller_settings

HOAP3 = load("hoap3")
SLOW = HOAP3.model_copy(update={"servo_rate_1_s": 0.5})
LAWS = ("qp12", "pinv", "stable_qp")


def law(name: str, robot: RobotDescription, **parameters: Any) -> Controller:
    settings = controller_settings(name)
    changed = settings.model_copy(update={"parameters": {**settings.parameters, **parameters}})
    return build(changed, robot, controller_file(name))


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
    (note,) = controller.notes()
    assert why in note
    judged = judge("fit", 0, 0, told)
    assert judged["task"]["not_certified"][why] == 3
    assert why in in_words(judged)["task"]


@pytest.mark.parametrize("name", LAWS)
def test_a_law_that_is_no_loop_around_its_servos_is_judged_as_ever(name):
    around, usual = law(name, SLOW, kinematics_from="reference"), law(name, HOAP3)
    assert around.conditions == usual.conditions
    assert answered(around, SLOW).as_json() == answered(usual, HOAP3).as_json()
    assert around.notes() == usual.notes() == []


def test_the_limit_itself_is_too_fast():
    assert too_fast(SLOW, 0.5, "measured") == "loop 0.5/s >= servos 0.5/s"
    assert too_fast(SLOW, 0.499, "measured") == ""
    assert too_fast(SLOW, 9.0, "reference") == ""
    assert too_fast(HOAP3, 9.0, "measured") == ""
