"""What the gains of the shipped configs reach: the figures of docs/theory/sdp.md."""

from __future__ import annotations

from copy import deepcopy
from functools import cache

import numpy as np
import pytest

from hoap3.protocol.config.settings import load_yaml
from hoap3.remote_controller.config import CONFIGS
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.solvers.sdp.sdp_gains import PATHS, SdpGains
from hoap3.remote_controller.tasks.registry import TaskSettings, build
from hoap3.robot_emulator.robots import load
from hoap3.tools.analysis.certificates import CertificateCount
from hoap3.tools.services.simulate import simulate

START = {"robot": "ur5", "posture": "outstretched"}


def settings(name: str, **parameters):
    content = deepcopy(load_yaml(CONFIGS / f"{name}.yaml"))
    content["parameters"].update(parameters)
    return content


@cache
def ur5(name: str = "clik_sdp_ur5", seconds: float = 2.1, **parameters: float):
    return simulate(START, settings(name, **parameters), seconds)


def column(run, name: str) -> np.ndarray:
    return run.setpoints["extra"][:, run.controller.extra_names.index(name)]


def test_constant_gains_halt_where_wished_ones_go_on():
    assert ur5("clik_ur5", 3.0).setpoints["v"][-1] == pytest.approx(1.95e-3, rel=0.01)
    first = int(np.argmax(ur5().setpoints["v"] < 1e-6))
    assert 1e-3 * first == pytest.approx(2.02, abs=0.05)


def test_a_smaller_delta_gains_beta():
    for delta, beta in ((5e-5, 2.1), (5e-6, 5.9), (1e-8, 8.0)):
        found = ur5() if delta == 5e-5 else ur5(delta=delta)
        assert column(found, "beta")[2000] == pytest.approx(beta, abs=0.05)


@pytest.mark.parametrize(("acceleration", "share", "off"), [(25.0, 0.99, 0.01), (5.0, 0.5, 0.1)])
def test_bounds_that_are_too_narrow_cost_certificates(acceleration, share, off):
    bounds = {"acceleration_rad_s2": acceleration}
    run = simulate(START, settings("clik_sdp_ur5", bounds=bounds), 3.0)
    certified = run.setpoints["solver_status"] == STATUS["certified"]
    assert certified.mean() == pytest.approx(share, abs=off)


def test_the_humanoid_is_cut_to_its_bounds_at_the_start():
    run = simulate("humanoid32", "clik_sdp_humanoid", 0.1)
    held = run.setpoints["margin"] <= 0.0
    held &= run.setpoints["solver_status"] == STATUS["uncertified"]
    held &= run.setpoints["solver_path"] == PATHS.index("warm")
    assert np.count_nonzero(held) == 44
    assert np.count_nonzero(column(run, "beta_actual")[held] < 0.0) == 13


def test_weights_of_one_cost_beta():
    config = settings("clik_sdp_hoap3")
    for task in config["parameters"]["tasks"]:
        task["weight"] = 1.0
    count = CertificateCount()
    for record in simulate("hoap3", config, 0.5).records:
        count.add(record)
    figures = count.figures()
    assert (figures["certified"], list(figures["reasons"]["certified"].values())) == (500, [400])


def beta_of(config, robot, q, order=(0, 1, 2), weights=None) -> float:
    """β that the tasks of a config have at a posture, without bounds."""
    tasks = [config["parameters"]["tasks"][place] for place in order]
    kinematics, rows, errors = Kinematics(robot), [], []
    for task in tasks:
        given = TaskSettings(task=task["task"], parameters=task["parameters"])
        function = build(given, robot, kinematics)
        kinematics.update(q)
        function.reset(kinematics, 0.0)
        function.update(kinematics, 0.0)
        rows.append(function.jacobian.copy())
        errors.append(-function.error)
    sizes = [each.size for each in errors]
    each = [task["weight"] for task in tasks] if weights is None else weights
    solver = SdpGains(sizes, robot.n)
    solver.weights[:] = np.repeat(each, sizes)
    desired = config["parameters"]["beta_per_s"]
    solver.solve(np.vstack(rows), np.concatenate(errors), robot.period_s, desired)
    return solver.beta


@pytest.mark.parametrize(
    ("name", "equal", "weighted"),
    [
        ("clik_sdp_humanoid", ("0.015", "0.06", "0.28"), ("0.70", "2.5", "3.6")),
        ("clik_sdp_hoap3", ("0.10", "0.04", "0.05"), ("2.6", "2.4", "2.4")),
    ],
)
def test_weights_are_worth_beta(name, equal, weighted):
    config = settings(name)
    robot = load(config["robot"])
    q = simulate(robot.name, config, 1.01).states["q"]
    for weights, printed in ((np.ones(3), equal), (None, weighted)):
        for tick, figure in zip((0, 500, 1000), printed, strict=True):
            digits = len(figure.partition(".")[2])
            found = beta_of(config, robot, q[tick], weights=weights)
            assert found == pytest.approx(float(figure), abs=0.51 * 10.0**-digits)


def test_the_centre_of_mass_does_not_belong_above_the_foot():
    config, robot = settings("clik_sdp_humanoid"), load("humanoid32")
    q = np.array(robot.initial_position)
    for order in ((1, 0, 2), (1, 2, 0), (2, 1, 0)):
        for weights in (np.ones(3), [1.0, 1e-2, 1e-4], [1.0, 1e-4, 1e-8]):
            assert beta_of(config, robot, q, order, weights) < 0.01
    assert beta_of(config, robot, q) > 0.5
