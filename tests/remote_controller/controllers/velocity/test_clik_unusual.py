"""`clik` and `clik_sdp` where tasks, limits or numbers are not as they should be: named or safe."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from hoap3.protocol.config.settings import load_yaml, parse
from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.config import CONFIGS, ControllerConfig, build
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.controllers.velocity.clik import CONDITIONS
from hoap3.robot_emulator.robots import load
from hoap3.testing import Body
from hoap3.tools.analysis.replay import replay_records
from hoap3.tools.services.simulate import simulate

BOTH = pytest.mark.parametrize("kind", ["clik", "clik_sdp"])
FAST = {"acceleration_rad_s2": 1e4}  # the robot's own limits remain
ALONE = {"rows": [[1.0]], "target": [0.1]}
NO_STABILISING_GAINS = (
    {"rows": [[-2.0, 1.0, 1.0, -3.0]], "target": [0.1]},
    {"rows": [[1.0, 0.0, 3.0, -1.0], [-1.0, 1.0, 3.0, -3.0]], "target": [0.1, 0.1]},
)


def linear(kind: str, *tasks, **parameters):
    """Settings with linear tasks for the joints of a UR5."""
    each = [
        {"name": f"task{place}", "task": "linear_tasks:Linear", "parameters": task}
        for place, task in enumerate(tasks)
    ]
    return {
        "controller": kind,
        "robot": "ur5",
        "parameters": {"tasks": each, "bounds": FAST, **parameters},
    }


def column(run, name: str) -> np.ndarray:
    return run.setpoints["extra"][:, run.controller.extra_names.index(name)]


def noted(run, condition: str) -> bool:
    return bool(run.controller.present >> CONDITIONS.index(condition) & 1)


def travelled(run) -> float:
    """The longest way of a joint."""
    return float(np.ptp(run.states["reference"], axis=0).max())


@pytest.mark.parametrize("tasks", [NO_STABILISING_GAINS, (ALONE, ALONE)], ids=["none", "dependent"])
class TestNoCertificate:
    """Independent tasks that no diagonal gains stabilise, and one task twice."""

    def test_of_gains_that_are_sought_the_robot_keeps_still(self, tasks):
        run = simulate("ur5", linear("clik_sdp", *tasks), 0.05)
        assert noted(run, "no certificate")
        assert set(run.setpoints["solver_status"]) == {STATUS["uncertified"]}
        assert set(run.setpoints["fallback"]) == {1}
        assert set(run.setpoints["solver_path"]) == {0}
        assert not column(run, "beta").any()
        assert not run.setpoints["extra"][:, [n.startswith("gain") for n in names(run)]].any()
        assert travelled(run) == 0.0

    def test_of_constant_gains_it_moves_and_says_so(self, tasks):
        run = simulate("ur5", linear("clik", *tasks), 0.05)
        assert noted(run, "no certificate")
        assert set(run.setpoints["solver_status"]) == {STATUS["uncertified"]}
        assert (column(run, "beta") < 0.0).all()
        assert travelled(run) > 1e-4


def names(run) -> tuple[str, ...]:
    return run.controller.extra_names


def test_tasks_that_nearly_depend_on_each_other_have_a_beta_near_0():
    close = {"rows": [[1.0, 1e-3]], "target": [0.2]}
    run = simulate("ur5", linear("clik_sdp", ALONE, close), 0.05)
    assert set(column(run, "task_rank")) == {2}
    assert (column(run, "beta") < 1e-6).all()
    assert (np.diff(run.setpoints["v"]) <= 0.0).all()


@BOTH
def test_tasks_that_do_not_touch_each_other_are_certified(kind):
    two = {"rows": [[0.0, 1.0]], "target": [0.05]}
    three = {"rows": [[0.0, 0.0, 1.0, 1.0], [0.0, 0.0, 0.0, 1.0]], "target": [0.02, 0.03]}
    run = simulate("ur5", linear(kind, ALONE, two, three), 0.5)
    assert set(run.setpoints["solver_status"]) == {STATUS["certified"]}
    wanted = {"clik": 2.0 - 1e-3, "clik_sdp": 4.0}[kind]
    assert column(run, "beta")[-1] == pytest.approx(wanted, rel=1e-3)


def test_more_than_one_over_the_period_is_met_by_that():
    near = {"rows": [[1.0]], "target": [1e-5]}
    run = simulate("ur5", linear("clik_sdp", near, beta_per_s=5000.0), 0.05)
    beta = column(run, "beta")
    assert beta[0] == pytest.approx(1000.0, rel=1e-3)
    assert beta.max() <= 1000.0 * (1.0 + 1e-9)
    assert run.setpoints["v"][1] < 1e-6 * run.setpoints["v"][0]


OF_BOTH = (
    {"tasks": []},
    {"bounds": {"speed_rad_s": 0.0}},
    {"bounds": {"margin_rad": 7.0}},
    {"damping": -1.0},
)
WRONG = [(kind, change) for kind in ("clik", "clik_sdp") for change in OF_BOTH]
WRONG += [("clik_sdp", {"beta_per_s": 0.0}), ("clik_sdp", {"delta": 0.0})]
WRONG += [("clik_sdp", {"budget": 0}), ("clik", {"beta_per_s": 4.0})]


@pytest.mark.parametrize(("kind", "change"), WRONG)
def test_settings_that_make_no_sense_are_named(kind, change):
    ((key, value),) = change.items()
    with pytest.raises(ConfigError) as caught:
        simulate("ur5", linear(kind, ALONE, **change), 0.01)
    within = f".{next(iter(value))}" if isinstance(value, dict) else ""
    assert caught.value.key == f"parameters.{key}{within}"


@BOTH
@pytest.mark.parametrize("entry", [{"weight": 0.0}, {"weight": math.nan}, {"name": "Hand!"}])
def test_so_are_those_of_a_task(kind, entry):
    content = linear(kind, ALONE)
    content["parameters"]["tasks"][0].update(entry)
    with pytest.raises(ConfigError) as caught:
        simulate("ur5", content, 0.01)
    assert caught.value.key == f"parameters.tasks.0.{next(iter(entry))}"


@BOTH
def test_limits_of_nothing_but_rest_stop_everything(kind):
    ur5 = load("ur5")
    margin = float((ur5.upper - ur5.lower).min()) / 2.0  # of the elbow, which is out of it then
    rows = {"rows": [[1.0, 0.0, 1.0]], "target": [0.1]}
    run = simulate("ur5", linear(kind, rows, bounds={**FAST, "margin_rad": margin}), 0.05)
    assert column(run, "beta") == pytest.approx(0.0, abs=1e-200)
    assert noted(run, "no certificate")
    assert set(run.setpoints["solver_status"]) == {STATUS["uncertified"]}


@BOTH
def test_limits_beyond_the_robots_are_the_robots(kind):
    wide = {"speed_rad_s": 1e9, "acceleration_rad_s2": 1e9}
    ours, theirs = (
        simulate("ur5", linear(kind, ALONE, bounds=bounds), 0.05) for bounds in (wide, FAST)
    )
    assert ours.setpoints.tobytes() == theirs.setpoints.tobytes()


@BOTH
def test_a_task_that_is_no_number_is_not_followed_and_comes_back(kind):
    other = {"rows": [[0.0, 1.0]], "target": [0.1]}
    run = simulate("ur5", linear(kind, {**ALONE, "clouded_s": [0.05, 0.1]}, other), 0.15)
    status, u = run.setpoints["solver_status"], np.diff(run.states["reference"], axis=0)
    assert set(status[50:100]) == {STATUS["infeasible"]}
    assert set(run.setpoints["fallback"][50:100]) == {2}
    assert not column(run, "beta")[50:100].any()
    assert np.abs(u[70:99]).max() < 1e-15  # after braking
    assert np.isfinite(run.states["reference"]).all()
    assert set(status[101:150]) == {STATUS["certified"]}


@BOTH
def test_a_state_that_is_no_number_is_refused(kind):
    ur5 = load("ur5")
    controller = build(parse(ControllerConfig, linear(kind, ALONE), "mine"), ur5, "mine")
    body = Body(ur5)
    controller.reset(body.state, None)
    assert controller.step(body.state).solver_status == STATUS["certified"]
    body.state.q[2] = math.nan
    command = controller.step(body.state)
    assert command.solver_status == STATUS["infeasible"]
    assert controller.present == 1 << CONDITIONS.index("state not finite")
    assert np.isnan(command.values).all()  # which robots reject: it counts as missed


class TestDeadline:
    """With a budget of one iteration, on the way of the paper."""

    def test_every_cycle_is_certified_or_says_that_the_budget_is_spent(self):
        run = within(1)
        status, spent = run.setpoints["solver_status"], run.setpoints["solver_path"] == 3
        assert spent.mean() > 0.9
        assert (run.setpoints["fallback"] == np.where(spent, 2, 0)).all()
        assert set(status[spent]) <= {STATUS["uncertified"]}
        assert set(status[~spent]) <= {STATUS["certified"], STATUS["uncertified"]}

    def test_v_falls_all_the_same_and_beta_is_what_these_gains_certify(self):
        run = within(1)
        beta, actual = column(run, "beta"), column(run, "beta_actual")
        assert (beta >= 0.0).all()
        falls = (beta > 0.0) & (run.setpoints["margin"] > 1e-9)  # and no bound cuts u
        assert falls.mean() > 0.9
        assert (actual >= 0.99 * beta)[falls].all()
        assert (np.diff(run.setpoints["v"])[falls[:-1]] < 0.0).all()

    def test_a_replay_takes_the_same_way(self):
        run = within(1)
        again = replay_records(run.records, parse(ControllerConfig, hurried(1), "mine"))
        assert again.identical, str(again)
        assert again.setpoints == len(run.setpoints)

    def test_with_another_budget_it_does_not(self):
        again = replay_records(within(1).records, parse(ControllerConfig, hurried(2), "mine"))
        assert not again.identical


def hurried(budget: int):
    """Settings with so many iterations."""
    content = load_yaml(CONFIGS / "clik_sdp_ur5.yaml")
    return {**content, "parameters": {**content["parameters"], "budget": budget}}


@cache
def within(budget: int):
    return simulate({"robot": "ur5", "posture": "outstretched"}, hurried(budget), 1.0)
