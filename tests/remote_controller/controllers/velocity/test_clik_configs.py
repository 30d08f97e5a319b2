"""What the shipped configs of `clik_sdp` say of themselves: weights that matter, and a path."""

from __future__ import annotations

from copy import deepcopy
from functools import cache

import numpy as np
import pytest

from hoap3.protocol.config.settings import load_yaml
from hoap3.remote_controller.config import CONFIGS
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.controllers.velocity.clik import CONDITIONS, ClikSdpController
from hoap3.remote_controller.solvers.sdp.sdp_gains import BUDGET, IPM, WARM
from hoap3.tools.simulate import simulate

MOVES = 1 << CONDITIONS.index("target moves")
ROBOTS = {"clik_sdp_humanoid": "humanoid32", "clik_sdp_hoap3": "hoap3"}
THREE_TASKS = pytest.mark.parametrize("name", ROBOTS)


def column(run, name: str) -> np.ndarray:
    return run.setpoints["extra"][:, run.controller.extra_names.index(name)]


@cache
def three_tasks(name: str, weighted: bool, seconds: float, **parameters: int):
    content = deepcopy(load_yaml(CONFIGS / f"{name}.yaml"))
    content["parameters"].update(parameters)
    for task in content["parameters"]["tasks"]:
        task["weight"] = task["weight"] if weighted else 1.0
    return simulate(ROBOTS[name], content, seconds)


@THREE_TASKS
def test_with_its_weights_v_is_proved_to_fall_ten_times_as_fast(name):
    with_weights, without = (three_tasks(name, *each) for each in ((True, 3.0), (False, 0.6)))
    beta = [column(run, "beta")[50:600] for run in (with_weights, without)]
    assert (beta[1] > 0.0).all()
    assert (beta[0] >= 10.0 * beta[1]).all()


@THREE_TASKS
def test_it_arrives_within_three_seconds(name):
    run = three_tasks(name, True, 3.0)
    status = run.setpoints["solver_status"]
    assert (status == STATUS["certified"]).mean() > 0.95
    assert (status[-2500:] == STATUS["certified"]).all()
    for task in ("foot", "com", "hand"):
        assert column(run, f"error_{task}")[-1] < 1e-3
    assert run.setpoints["v"][-1] < 1e-3 * run.setpoints["v"][0]
    path = run.setpoints["solver_path"]
    assert (np.isin(path, [WARM, IPM, BUDGET])).all()
    assert (path == BUDGET).mean() <= 3e-3  # what needs longer goes on at the next tick


@THREE_TASKS
def test_where_the_budget_is_spent_v_is_proved_to_fall_nearly_as_fast_as_it_can(name):
    run, ample = three_tasks(name, True, 3.0), three_tasks(name, True, 3.0, budget=400)
    spent = run.setpoints["solver_path"] == BUDGET
    assert spent.any() == (name == "clik_sdp_humanoid")
    assert not (ample.setpoints["solver_path"] == BUDGET).any()
    assert (column(run, "beta")[spent] >= 0.98 * column(ample, "beta")[spent]).all()


@cache
def written(fed: bool):
    """The eight, with the velocity of the target or without."""
    solve = ClikSdpController.solve

    def blind(self):
        self.solver.rates[:] = 0.0
        return solve(self)

    with pytest.MonkeyPatch.context() as patch:
        if not fed:
            patch.setattr(ClikSdpController, "solve", blind)
        return simulate("ur5", "clik_sdp_writing", 3.0)


def test_feed_forward_keeps_the_hand_within_a_tenth_of_a_millimetre_of_the_path():
    ahead, behind = (column(written(fed), "error_hand")[1500:].max() for fed in (True, False))
    assert ahead < 1e-4
    assert behind > 100.0 * ahead


def test_feed_forward_may_exceed_the_bounds_where_feedback_holds_it_back():
    content = deepcopy(load_yaml(CONFIGS / "clik_sdp_writing.yaml"))
    hand, wrist = (task["parameters"]["target"] for task in content["parameters"]["tasks"])
    hand["plane"], wrist["position_m"] = "yz", [0.0, -0.11, 0.0]
    run = simulate("ur5", content, 3.0)
    assert column(run, "error_hand")[1500:].max() < 2e-4


def test_a_path_is_never_certified_and_says_why():
    run = written(True)
    assert run.controller.present & MOVES
    assert set(run.setpoints["solver_status"][1:]) == {STATUS["uncertified"]}
    assert (column(run, "beta")[100:] > 6.0).all()  # of the tasks, if their targets stood
