"""docs/gains.md: it names what the log has, and what it says in figures is so."""

from __future__ import annotations

import re
from copy import deepcopy
from functools import cache

import numpy as np
import pytest
from pages import page, table

from hoap3.protocol.config.settings import load_yaml
from hoap3.remote_controller.config import CONFIGS
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.solvers.sdp.sdp_gains import PATHS, SdpGains
from hoap3.remote_controller.tasks.registry import TaskSettings, build
from hoap3.robot_emulator.robots import load
from hoap3.tools.analysis.certificates import CertificateCount, in_a_line
from hoap3.tools.services.simulate import simulate

PAGE = "gains.md"
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


def said(pattern: str) -> tuple[float, ...]:
    """Figures of a sentence of the page."""
    found = re.search(pattern, page(PAGE).replace("\n", " "))
    assert found, pattern
    return tuple(float(each.replace("−", "-")) for each in found.groups())


def test_v_is_as_the_caption_says():
    (halt,) = said(r"V halts at ([\d.]+)·10⁻³")
    assert ur5("clik_ur5", 3.0).setpoints["v"][-1] == pytest.approx(1e-3 * halt, rel=0.01)
    (time,) = said(r"with 8/s V is below 10⁻⁶ after ([\d.]+) s")
    first = int(np.argmax(ur5().setpoints["v"] < 1e-6))
    assert 1e-3 * first == pytest.approx(time, abs=0.05)


def test_delta_costs_what_the_page_says():
    figures = said(r"at 2 s has β = ([\d.]+)/s with 5·10⁻⁵, ([\d.]+)/s with 5·10⁻⁶ and ([\d.]+)/s")
    for delta, beta in zip((5e-5, 5e-6, 1e-8), figures, strict=True):
        found = ur5() if delta == 5e-5 else ur5(delta=delta)
        assert column(found, "beta")[2000] == pytest.approx(beta, abs=0.05)


def test_bounds_that_are_too_narrow_cost_certificates():
    def certified(acceleration: float) -> float:
        bounds = {"acceleration_rad_s2": acceleration}
        run = simulate(START, settings("clik_sdp_ur5", bounds=bounds), 3.0)
        return float((run.setpoints["solver_status"] == STATUS["certified"]).mean())

    pattern = r"in (\d+) % of its cycles with (\d+) rad/s², and in half .*? with (\d)"
    share, wide, narrow = said(pattern)
    assert certified(wide) == pytest.approx(0.01 * share, abs=0.01)
    assert certified(narrow) == pytest.approx(0.5, abs=0.1)


def test_the_humanoid_is_cut_to_its_bounds_at_the_start_as_often_as_the_page_says():
    pattern = r"has (\d+) such cycles in its first tenth of a second, and in (\d+) of them V"
    cut, rises = said(pattern)
    run = simulate("humanoid32", "clik_sdp_humanoid", 0.1)
    held = run.setpoints["margin"] <= 0.0
    held &= run.setpoints["solver_status"] == STATUS["uncertified"]
    held &= run.setpoints["solver_path"] == PATHS.index("warm")
    assert np.count_nonzero(held) == cut
    assert np.count_nonzero(column(run, "beta_actual")[held] < 0.0) == rises


def test_weights_of_one_are_told_as_the_page_says():
    (told,) = re.findall(r"`(\d+ of \d+ answers certified, \d+ with [a-z ]+)`", page(PAGE))
    config = settings("clik_sdp_hoap3")
    for task in config["parameters"]["tasks"]:
        task["weight"] = 1.0
    count = CertificateCount()
    for record in simulate("hoap3", config, 0.5).records:
        count.add(record)
    assert in_a_line(count.figures()) == told


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


@pytest.mark.parametrize("row", table(PAGE, "How to choose"), ids=("humanoid", "hoap3"))
def test_weights_are_worth_what_the_table_says(row):
    first, without, with_weights = row.values()
    config = settings(re.match(r"`(\w+)`", first)[1])
    robot = load(config["robot"])
    q = simulate(robot.name, config, 1.01).states["q"]
    for weights, printed in ((np.ones(3), without), (None, with_weights)):
        for tick, figure in zip((0, 500, 1000), printed.split(", "), strict=True):
            digits = len(figure.partition(".")[2])
            found = beta_of(config, robot, q[tick], weights=weights)
            assert found == pytest.approx(float(figure), abs=0.51 * 10.0**-digits)


def test_the_centre_of_mass_does_not_belong_above_the_foot():
    config, robot = settings("clik_sdp_humanoid"), load("humanoid32")
    q = np.array(robot.initial_position)
    (limit,) = said(r"is below ([\d.]+)/s, whatever the weights")
    for order in ((1, 0, 2), (1, 2, 0), (2, 1, 0)):
        for weights in (np.ones(3), [1.0, 1e-2, 1e-4], [1.0, 1e-4, 1e-8]):
            assert beta_of(config, robot, q, order, weights) < limit
    assert beta_of(config, robot, q) > 0.5
