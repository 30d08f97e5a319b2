"""`clik` and `clik_sdp`: V falls as certified, limits hold, and what cannot be is said so."""

from __future__ import annotations

from copy import deepcopy
from functools import cache

import numpy as np
import pytest

from hoap3.protocol.config.settings import load_yaml, parse
from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.config import CONFIGS, ControllerConfig, check_parameters
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.controllers.velocity.clik import CONDITIONS
from hoap3.robot_emulator.robots import load
from hoap3.tools.services.simulate import simulate

UR5 = {"robot": "ur5", "posture": "outstretched"}
CIRCLE = {"kind": "circle", "center_m": [0.4, -0.3, 0.5], "radius_m": 0.05, "period_s": 2.0}


def settings(name: str, **parameters):
    content = deepcopy(load_yaml(CONFIGS / f"{name}.yaml"))
    content["parameters"].update(parameters)
    return content


@cache
def shipped(name: str):
    return simulate(UR5, settings(name), 1.0)


def column(run, name: str) -> np.ndarray:
    return run.setpoints["extra"][:, run.controller.extra_names.index(name)]


def noted(run, condition: str) -> bool:
    return bool(run.controller.present >> CONDITIONS.index(condition) & 1)


def test_v_never_rises_and_nearly_all_of_the_run_is_certified():
    run = shipped("clik_sdp_ur5")
    status, V, beta = run.setpoints["solver_status"], run.setpoints["v"], column(run, "beta")
    assert V[0] == pytest.approx(0.4558, rel=1e-3)
    assert (np.diff(V) < 0.0).all()
    assert (beta >= 0.0).all()
    certified = status == STATUS["certified"]
    assert certified.mean() > 0.9
    assert (column(run, "beta_actual") >= beta)[certified].all()
    assert (run.setpoints["solver_path"] == 1).mean() > 0.99


def test_constant_gains_have_no_certificate_there_and_the_robot_moves():
    run = shipped("clik_ur5")
    assert set(run.setpoints["solver_status"]) == {STATUS["uncertified"]}
    assert noted(run, "no certificate")
    assert column(run, "beta")[-1] < -0.4
    assert run.setpoints["v"][-1] < 0.05 * run.setpoints["v"][0]
    np.testing.assert_array_equal(run.setpoints["extra"][-1, -4:], [2.0, 2.0, 2.0, 1.0])


def test_constant_gains_of_a_single_task_are_certified():
    one = settings("clik_ur5")["parameters"]["tasks"][:1]
    run = simulate(UR5, settings("clik_ur5", tasks=one), 0.5)
    assert (run.setpoints["solver_status"] == STATUS["certified"]).mean() > 0.9
    # e' = (1 - 2T)e: V falls by 4 - 4T
    assert column(run, "beta")[-1] == pytest.approx(4.0 - 4e-3, rel=1e-9)


@pytest.mark.parametrize("name", ["clik_ur5", "clik_sdp_ur5"])
def test_limits_are_never_exceeded(name):
    run, ur5 = shipped(name), load("ur5")
    reference, T = run.states["reference"], ur5.period_s
    speed = np.diff(reference, axis=0) / T
    assert (np.abs(speed) <= ur5.velocity + 1e-9).all()
    assert (np.abs(np.diff(speed, axis=0)) / T <= ur5.setpoint_acceleration_max + 1e-6).all()


@pytest.mark.parametrize("name", ["clik_ur5", "clik_sdp_ur5"])
def test_feed_forward_follows_a_target_that_moves(name):
    tasks = settings(name)["parameters"]["tasks"][:1]
    tasks[0]["parameters"]["target"] = {**CIRCLE, "approach_s": 0.5}
    run = simulate(UR5, settings(name, tasks=tasks), 1.5)
    assert column(run, "error_hand")[-500:].max() < 1e-4
    assert set(run.setpoints["solver_status"][-500:]) == {STATUS["certified"]}
    assert not noted(run, "target too fast")


def test_dependent_tasks_keep_the_robot_still():
    hand = settings("clik_sdp_ur5")["parameters"]["tasks"][0]
    again = deepcopy(hand)
    again["name"] = "again"
    run = simulate(UR5, settings("clik_sdp_ur5", tasks=[hand, again]), 0.05)
    assert noted(run, "no certificate")
    assert (run.setpoints["fallback"] == 1).all()
    assert (column(run, "beta") == 0.0).all()
    assert np.ptp(run.states["reference"], axis=0).max() == 0.0
    assert set(run.setpoints["solver_status"]) == {STATUS["uncertified"]}


def test_a_budget_that_is_spent_is_said_and_not_certified():
    run = simulate(UR5, settings("clik_sdp_ur5", budget=1), 0.1)
    spent = run.setpoints["solver_path"] == 3
    assert spent.any()
    assert (run.setpoints["fallback"] == 2)[spent].all()
    assert not (run.setpoints["solver_status"][spent] == STATUS["certified"]).any()
    assert (column(run, "beta") >= 0.0).all()


@pytest.mark.parametrize("name", ["clik_ur5", "clik_sdp_ur5"])
def test_two_runs_are_the_same(name):
    once, again = (simulate(UR5, settings(name), 0.1) for _ in range(2))
    assert once.setpoints.tobytes() == again.setpoints.tobytes()


def test_two_tasks_of_one_name_are_refused():
    tasks = settings("clik_sdp_ur5")["parameters"]["tasks"]
    content = settings("clik_sdp_ur5", tasks=[tasks[0], tasks[0]])
    with pytest.raises(ConfigError, match=r"tasks\.1"):
        check_parameters(parse(ControllerConfig, content, "mine.yaml"), "mine.yaml")
