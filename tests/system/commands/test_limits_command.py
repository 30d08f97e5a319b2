"""`hoap3 limits` and `hoap3 bench limits`."""

from __future__ import annotations

import json

import numpy as np
import pytest
from support.command_bench import inside
from typer.testing import CliRunner

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.robot.viability_bounds import AccelerationBounds
from hoap3.robot_emulator.robots import load
from hoap3.tools.bench import limits as bench
from hoap3.tools.bench.problems.steps import motion
from hoap3.tools.bench.qp_peers import installed
from hoap3.tools.cli.app import app

KEYS = {"solver", "n", "samples", "min_us", "mean_us", "p50_us", "p99_us", "max_us"}


def found(*words: str, code: int) -> dict:
    result = CliRunner().invoke(app, ["limits", *words, "--samples", "20000", "--json"])
    assert result.exit_code == code
    return json.loads(result.stdout)


def test_a_robot_that_claims_no_more_than_it_has_is_fit():
    told = found("ur5", code=0)
    robot: RobotDescription = load("ur5")
    assert [row["joint"] for row in told["joints"]] == list(robot.joint_names)
    assert told["findings"] == []
    for row in told["joints"]:
        assert row["lower"] < 0.0 < row["upper"]
        assert row["either_way"] == min(-row["lower"], row["upper"]) >= row["brake_acceleration"]


def test_joints_that_cannot_hold_their_load_or_claim_too_much_are_named():
    assert found("baxter_left_arm", code=1)["findings"] == [
        "left_s1: in some state it cannot even hold its load"
    ]
    told = found("hoap3", code=1)["findings"]
    assert any(line.startswith("r_hip_yaw: brake_acceleration is 40, and it") for line in told)


def test_the_table_has_a_row_a_joint():
    done = inside("limits", "baxter", "--samples", "1000")
    text = done.stdout
    assert done.code == 1
    assert "rad/s²" in text
    for name in load("baxter_left_arm").joint_names:
        assert name in text


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nosuch"], "nosuch"),
        (["ur5", "--velocities", "some"], "corners"),
        (["ur5", "--samples", "0"], "samples"),
    ],
)
def test_wrong_words_are_one_clear_error(words, message):
    done = inside("limits", *words)
    assert done.code == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr


def test_the_bench_times_everything_in_turn_and_says_what_sampling_took():
    result = CliRunner().invoke(
        app, ["bench", "limits", "--samples", "20", "--sampled", "5000", "--json"]
    )
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    timed = {(row["solver"], row["n"]) for row in told["rows"]}
    assert timed >= {(name, n) for name in ("bounds", "naive bounds") for n in (7, 21, 32)}
    assert timed >= {("setpoint filter", 21), ("tsid step", 7), ("tsid QP", 7), ("daqp", 7)}
    assert all(row.keys() >= KEYS for row in told["rows"])
    assert told["sampling"]["samples"] == 5000
    assert told["sampling"]["paper_seconds"] is None
    assert set(told["missing"]) <= set(bench.PEERS)


def test_the_peers_solve_what_the_controller_solves():
    """ProxQP ends at a gradient of 1e-9, which the least curvature makes 1e-5 of an answer."""
    law, states = motion("baxter", "tsid_baxter", 2.0)
    solver = law.solver
    effort = np.array(law.description.effort)
    for state in states[::40]:
        given = bench._arguments(law, state)
        problem = bench.program(given, effort)
        solver.solve(*given)
        for name, make in installed(bench.PEERS).items():
            near = 1e-5 if name == "proxqp" else 1e-6
            solved, ddq, _ = make(problem)(bench.TOLERANCE)
            assert solved
            np.testing.assert_allclose(ddq, solver.ddq, atol=near)


def test_the_bounds_that_are_timed_are_those_that_hold():
    contender = bench._bounds(np.random.default_rng(0), 7)[0]
    q, dq, least, most = contender.problems[0]
    contender.call(q, dq, least, most)
    again = AccelerationBounds(-np.ones(7), np.ones(7), 2.0, 20.0, 1e-3)
    lower, upper = np.zeros(7), np.zeros(7)
    again.solve(q, dq, lower, upper)
    np.testing.assert_array_equal((least, most), (lower, upper))
