"""What a controller of accelerations says and does where constraints are in its way."""

from __future__ import annotations

import numpy as np
import pytest
from hierarchy_runs import content, made, robot, state_of

from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.controllers.acceleration.problem import STOPPED
from hoap3.remote_controller.controllers.base import STATUS

STILL = np.zeros(7)
EVERY = pytest.mark.parametrize("name", ["ghc", "ghc_torque", "hqp", "weighted"])
T = 1e-3


def wall(offset_m: float, name: str = "wall", sign: float = 1.0) -> dict[str, object]:
    """The hand on one side of a plane across y; it starts at y = −0.465 m."""
    parameters = {"frame": "ee", "normal": [0.0, sign, 0.0], "offset_m": offset_m}
    return {"constraint": "half_space", "name": name, "parameters": parameters}


def kept(name: str, *constraints: dict[str, object]):
    return made(name, constraints=list(constraints))


def says(controller, condition: str) -> bool:
    return bool(controller.present >> controller.conditions.index(condition) & 1)


def start(controller) -> np.ndarray:
    return np.array(controller.description.initial_position)


@EVERY
def test_nothing_is_certified_while_a_constraint_is_violated(name):
    inside, outside = kept(name, wall(-0.6)), kept(name, wall(-0.4))
    for controller, violated in ((inside, False), (outside, True)):
        command = controller.step(state_of(controller, start(controller), STILL))
        assert (command.margin < -1e-3) == violated
        proved = name.startswith("ghc") and not violated
        assert command.solver_status == STATUS["certified" if proved else "uncertified"]
    assert says(outside, "wall: outside")


@EVERY
def test_a_default_rate_that_brakes_lower_can_be_asked_for_and_no_other_above_it(name):
    """It is 10 by default, and as low as the joints' brakes want it; who sets it is refused."""
    controller, rate = kept(name, wall(-0.6)), "constraints.wall.parameters.eta_per_s"
    with pytest.raises(ConfigError, match="eta_per_s"):
        kept(name, {**wall(-0.6), "parameters": {**wall(-0.6)["parameters"], "eta_per_s": 10.0}})
    controller.change({"constraints": controller.changeable()["constraints"]})
    controller.change({"constraints.wall.parameters.return_speed_m_s": 0.1})
    with pytest.raises(ConfigError, match="eta_per_s"):
        controller.change({rate: 10.5})
    controller.change({rate: 1.0})
    with pytest.raises(ConfigError, match="eta_per_s"):
        controller.change({rate: 10.0})


@EVERY
def test_walls_without_room_between_them_make_all_joints_brake_together(name):
    """To a stop that is the one that was looked at: in a straight line, in whole periods."""
    controller = kept(name, wall(-0.3), wall(0.6, "other", -1.0))
    assert controller.stack.margin() == np.inf
    dq = np.random.default_rng(1).uniform(-0.5, 0.5, 7)
    command = controller.step(state_of(controller, start(controller), dq))
    assert command.fallback == STOPPED
    assert command.solver_status == STATUS["infeasible"]
    assert says(controller, "stops for a constraint")
    periods = -dq / (T * controller.ddq)
    np.testing.assert_allclose(periods, periods[0], rtol=1e-9)
    assert periods[0] == pytest.approx(round(periods[0]), abs=1e-6)
    wanted = np.zeros(7)
    controller.stack.stop(dq, wanted)
    np.testing.assert_allclose(controller.ddq, wanted, rtol=1e-9)


@EVERY
@pytest.mark.parametrize(("limit_nm", "strained"), [(1e3, False), (1.0, True)])
def test_a_stop_that_motors_are_too_small_for_says_so(name, limit_nm, strained):
    motors = {"constraint": "joint_torque", "parameters": {"limit_nm": limit_nm}}
    controller = kept(name, motors, wall(-0.3), wall(0.6, "other", -1.0))
    command = controller.step(state_of(controller, start(controller), np.full(7, 0.5)))
    assert command.fallback == STOPPED
    assert says(controller, "torques too small") == strained
    wanted = np.zeros(7)
    controller.stack.stop(np.full(7, 0.5), wanted)
    assert np.allclose(controller.ddq, wanted, rtol=1e-6) != strained


def test_a_stop_brakes_with_what_constraints_leave_of_the_joints_accelerations():
    gentle = {"constraint": "joint_acceleration", "parameters": {"limit_rad_s2": 2.0}}
    controller = kept("ghc", gentle, wall(-0.3), wall(0.6, "other", -1.0))
    dq = np.linspace(-0.5, 0.4, 7)
    command = controller.step(state_of(controller, start(controller), dq))
    assert command.fallback == STOPPED
    np.testing.assert_allclose(controller.ddq, controller.ddq[0] / dq[0] * dq, rtol=1e-9)
    assert np.abs(controller.ddq).max() == pytest.approx(2.0, rel=0.01)


@pytest.mark.parametrize("speed", [1e308, 1e150])
def test_a_state_that_no_number_can_stop_is_refused(speed):
    controller = kept("ghc", wall(-0.6))
    with np.errstate(all="ignore"):
        command = controller.step(state_of(controller, start(controller), np.full(7, speed)))
    assert np.isnan(command.values).all()
    assert command.solver_status == STATUS["infeasible"]


def test_a_hand_on_its_way_out_is_stopped_in_time():
    """From a speed that no row of this period alone would stop."""
    controller = kept("ghc", wall(-0.49))
    q = start(controller)
    dq = np.zeros(7)
    dq[0] = 1.0
    y = []
    for tick in range(400):
        state = state_of(controller, q, dq, tick)
        controller.step(state)
        q = q + T * dq + 0.5 * T * T * controller.ddq
        dq = dq + T * controller.ddq
        y.append(float(controller.stack.constraints[0].margins[0]))
    assert min(y) > -1e-6


def test_a_torque_limit_of_nothing_is_refused():
    none = {"constraint": "joint_torque", "parameters": {"joints_nm": {"joint_2": 0.0}}}
    with pytest.raises(ConfigError, match=r"joints_nm\.joint_2"):
        kept("ghc", none)


def test_each_term_of_a_sum_is_judged():
    terms = [{"task": "posture"}, {"task": "posture", "parameters": {"target_rad": [0.1] * 7}}]
    both = [{"name": "both", "task": "weighted_sum", "parameters": {"terms": terms}}]
    controller = made("ghc", tasks=both, priorities={})
    controller.step(state_of(controller, start(controller), STILL))
    found = [(error.task, error.judged) for error in controller.task_errors()]
    assert found == [("both: 1. posture", True), ("both: 2. posture", True)]


def test_a_wrench_is_no_term_of_a_sum():
    wrench = content("ghc_force")["parameters"]["tasks"][0]
    term = {"task": "wrench", "parameters": wrench["parameters"]}
    tasks = [{"name": "sum", "task": "weighted_sum", "parameters": {"terms": [term]}}]
    with pytest.raises(ConfigError, match=r"terms\.0"):
        made("ghc", robot("lwr_with_table"), tasks=tasks, priorities={})
