"""`benchmarks.limits` times what it says, and its peers solve what the controller solves."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks import limits
from benchmarks.qp_peers import installed, missing
from hoap3.protocol.limits.viability_bounds import AccelerationBounds
from hoap3.tools.bench.cycle import motion

KEYS = {"solver", "n", "samples", "min_us", "mean_us", "p50_us", "p99_us", "max_us"}


@pytest.mark.slow
def test_everything_is_timed_in_turn(run_command):
    told = json.loads(run_command(limits.command, "--samples", 20, "--json").stdout)
    timed = {(row["solver"], row["n"]) for row in told["rows"]}
    assert timed >= {(name, n) for name in ("bounds", "naive bounds") for n in (7, 21, 32)}
    assert timed >= {("setpoint filter", 21), ("tsid step", 7), ("tsid QP", 7)}
    assert timed >= {(name, 7) for name in installed(limits.PEERS)}
    assert all(row.keys() >= KEYS for row in told["rows"])
    assert told["missing"] == list(missing(limits.PEERS))


def test_the_peers_solve_what_the_controller_solves():
    """ProxQP ends at a gradient of 1e-9, which the least curvature makes 1e-5 of an answer."""
    law, states = motion("baxter", "tsid_baxter", 2.0)
    solver = law.solver
    effort = np.array(law.description.effort)
    for state in states[::40]:
        given = limits._arguments(law, state)
        problem = limits.program(given, effort)
        solver.solve(*given)
        for name, make in installed(limits.PEERS).items():
            near = 1e-5 if name == "proxqp" else 1e-6
            solved, ddq, _ = make(problem)(limits.TOLERANCE)
            assert solved
            np.testing.assert_allclose(ddq, solver.ddq, atol=near)


def test_the_bounds_that_are_timed_are_those_that_hold():
    contender = limits._bounds(np.random.default_rng(0), 7)[0]
    q, dq, least, most = contender.problems[0]
    contender.call(q, dq, least, most)
    again = AccelerationBounds(-np.ones(7), np.ones(7), 2.0, 20.0, 1e-3)
    lower, upper = np.zeros(7), np.zeros(7)
    again.solve(q, dq, lower, upper)
    np.testing.assert_array_equal((least, most), (lower, upper))
