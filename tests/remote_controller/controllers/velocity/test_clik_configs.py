"""What the shipped configs of `clik_sdp` say of themselves: weights that matter, and a path."""

from __future__ import annotations

import shutil
from copy import deepcopy
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from hoap3.protocol.config.settings import load_yaml
from hoap3.remote_controller.config import CONFIGS
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.controllers.velocity.clik import CONDITIONS, ClikSdpController
from hoap3.remote_controller.solvers.sdp.sdp_gains import BUDGET, IPM, WARM
from hoap3.robot_emulator import robots
from hoap3.tools.services.simulate import simulate

NAMES = "target too fast", "held by limits", "budget spent"
TOO_FAST, HELD, SPENT = (1 << CONDITIONS.index(name) for name in NAMES)
ROBOT_FOLDER = Path(robots.__file__).parent
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_feed_forward_keeps_the_hand_within_a_hundredth_of_a_millimetre_of_the_path():
    ahead, behind = (column(written(fed), "error_hand")[1500:].max() for fed in (True, False))
    assert ahead < 1e-5
    assert behind > 1000.0 * ahead


def test_feed_forward_may_exceed_the_bounds_where_feedback_holds_it_back():
    content = deepcopy(load_yaml(CONFIGS / "clik_sdp_writing.yaml"))
    hand, wrist = (task["parameters"]["target"] for task in content["parameters"]["tasks"])
    hand["plane"], wrist["position_m"] = "yz", [0.0, -0.11, 0.0]
    run = simulate("ur5", content, 3.0)
    assert column(run, "error_hand")[1500:].max() < 5e-4


@cache
def moving(name: str, robot: str = ""):
    """A shipped config with a target that moves, and its conditions by answered tick."""
    content = deepcopy(load_yaml(CONFIGS / f"{name}.yaml"))
    if name in ROBOTS:
        target = content["parameters"]["tasks"][-1]["parameters"]["target"]
        center = target.pop("position_m")
        target |= {"kind": "circle", "center_m": center, "radius_m": 0.01, "period_s": 4.0}
    answer, present = ClikSdpController.answer, {}

    def noting(self, state, *rest):
        answer(self, state, *rest)
        present[state.tick] = self.present

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ClikSdpController, "answer", noting)
        run = simulate(robot or ROBOTS.get(name, "ur5"), content, 4.0)
    return run, np.array([present[tick] for tick in run.setpoints["tick"]])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["clik_sdp_writing", *ROBOTS])
def test_along_a_path_the_cycles_within_bounds_and_budget_are_certified(name):
    run, present = moving(name)
    within = present & (TOO_FAST | HELD | SPENT) == 0
    certified = run.setpoints["solver_status"] == STATUS["certified"]
    assert certified[within].mean() >= 0.99
    if name == "clik_sdp_writing":
        assert (present & TOO_FAST == 0).mean() > 0.85
        assert certified[present & TOO_FAST == 0].mean() >= 0.99
    assert (column(run, "floor")[certified] <= 1e-4).all()


def test_what_is_certified_along_a_path_holds_from_tick_to_tick():
    run, _ = moving("clik_sdp_writing")
    v, certified = run.setpoints["v"], run.setpoints["solver_status"] == STATUS["certified"]
    kept = np.sqrt((1.0 - column(run, "beta") * 1e-3) * v) + column(run, "remainder")
    assert (np.sqrt(v[1:]) <= kept[:-1] + 1e-12)[certified[:-1]].all()
    predicted, required = (run.setpoints[f"v_rate_{name}"] for name in ("predicted", "required"))
    assert (predicted <= required + 1e-12)[certified].all()
    np.testing.assert_allclose(predicted[1:-1], np.diff(v)[1:] / 1e-3, rtol=1e-4, atol=1e-12)


def test_writing_keeps_within_its_floor_of_two_hundredths_of_a_millimetre():
    run, _ = moving("clik_sdp_writing")
    floor, left = column(run, "floor")[2500:].max(), np.sqrt(2.0 * run.setpoints["v"][2500:])
    assert left.max() <= floor <= 2e-5


@pytest.mark.slow
def test_half_the_period_leaves_a_quarter_of_the_remainder(tmp_path):
    folder = shutil.copytree(ROBOT_FOLDER / "ur5", tmp_path / "ur5")
    text = (folder / "robot.yaml").read_text()
    (folder / "robot.yaml").write_text(text.replace("period_s: 0.001", "period_s: 0.0005"))
    slow, _ = moving("clik_sdp_writing")
    fast, _ = moving("clik_sdp_writing", str(folder))
    ratio = column(slow, "remainder")[1500:3900] / column(fast, "remainder")[3000:7800:2]
    assert 3.6 < np.median(ratio) < 4.4


@pytest.mark.long
def test_a_million_certified_ticks_along_random_paths_keep_what_is_promised():
    rng, seen = np.random.default_rng(0), 0
    while seen < 1_000_000:
        center = np.array([-0.61, -0.11, 0.25]) + rng.uniform(-0.05, 0.05, 3)
        content = deepcopy(load_yaml(CONFIGS / "clik_sdp_writing.yaml"))
        target = content["parameters"]["tasks"][0]["parameters"]["target"]
        target["center_m"], target["period_s"] = center.tolist(), float(rng.uniform(2.0, 10.0))
        target["half_width_m"] = float(rng.uniform(0.02, 0.1))
        run = simulate("ur5", content, 20.0)
        root = np.sqrt(run.setpoints["v"])
        certified = run.setpoints["solver_status"] == STATUS["certified"]
        kept = np.sqrt(1.0 - column(run, "beta") * 1e-3) * root + column(run, "remainder")
        assert (root[1:] <= kept[:-1] + 1e-12)[certified[:-1]].all()
        seen += int(certified.sum())
