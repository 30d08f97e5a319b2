"""Gains beside conic solvers: consecutive ticks of a motion, the same problems, one table."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from hoap3.protocol.errors import UnknownNameError
from hoap3.remote_controller.solvers.sdp import sdp_backends
from hoap3.tools.bench import gains
from hoap3.tools.bench.gains import BARE, COLD, OURS, QUICK_S, TICK, bench_gains, missing
from hoap3.tools.bench.problems.gains_problems import Moment, stretches, walk
from hoap3.tools.cli.app import app

pytestmark = pytest.mark.slow

KEYS = {"solver", "robot", "n", "joints", "samples", "min_us", "mean_us", "p50_us", "p99_us"} | {
    *("max_us", "times_sdp", "times_sdp_min", "paths", "newton_mean", "worst_gap"),
    *("worst_beta", "failures", "problems"),
}


@pytest.fixture(scope="module")
def along():
    return walk("ur5", QUICK_S)


@pytest.fixture(scope="module")
def measured():
    return bench_gains(samples=10, robots=["ur5"], seconds=QUICK_S)


def test_a_walk_has_each_tick_of_a_motion_as_the_controllers_solver_meets_it(along):
    assert len(along.moments) == len(along.states) > 190
    ticks = [state.tick for state in along.states]
    assert set(np.diff(ticks)) == {1}
    solver, call = along.law.solver, along.call(along.solver())
    for state, it in zip(along.states[:20], along.moments, strict=False):
        along.law.step(state)
        np.testing.assert_array_equal(along.law.jacobian, it.jacobian)
        np.testing.assert_array_equal(call(*it).gains, solver.gains)
    along.law.reset(along.states[0], None)


def test_stretches_are_consecutive_and_spread_over_the_walk():
    moments = [Moment(*(np.full(1, float(k)),) * 4) for k in range(100)]
    found = [int(it.errors[0]) for it in stretches(moments, 4, 10)]
    assert found == [*range(10), *range(30, 40), *range(60, 70), *range(90, 100)]
    assert len(stretches(moments[:3], 2, 10)) == 20


def test_the_solvers_are_given_one_and_the_same_problem(along):
    it = along.moments[-1]
    ours = along.call(along.solver())(*it)
    for name in sdp_backends.SOLVERS:
        peer = along.solver(sdp_backends.ConicGains, solver=name)
        theirs = along.call(peer)(*it)
        np.testing.assert_allclose(theirs.gains, ours.gains, rtol=1e-6)
        (program,) = along.programs([it])
        x, _ = sdp_backends.SOLVERS[name](*program)
        assert x[-1] * along.desired == pytest.approx(ours.beta, abs=1e-3)


def test_each_solver_is_timed(measured):
    rows = {row["solver"]: row for row in measured["rows"]}
    there = sdp_backends.SOLVERS.keys() - missing().keys()
    peers = [name + kind for name in there for kind in ("", BARE)]
    assert rows.keys() == {OURS, COLD, TICK, *peers}
    for row in rows.values():
        assert row.keys() == KEYS
        assert (row["robot"], row["n"], row["joints"]) == ("ur5", 4, 6)
    assert rows[OURS]["times_sdp"] == rows[OURS]["times_sdp_min"] == 1.0
    assert rows[OURS]["samples"] == rows[COLD]["samples"] == 10 * gains.ALONE
    for name in (OURS, COLD):
        assert rows[name]["worst_gap"] <= 1e-9
        assert sum(rows[name]["paths"].values()) == pytest.approx(1.0)
    assert rows[OURS]["paths"]["warm"] > 0.9
    assert rows[COLD]["paths"]["ipm"] == 1.0
    for name in peers:
        assert rows[name]["worst_beta"] < 1e-2
        assert 0 <= rows[name]["failures"] < rows[name]["problems"] == 10
        assert rows[name]["samples"] == 10 - rows[name]["failures"]
    assert [row["peer"] for row in measured["ratios"]] == [n for n in rows if n in peers]


def test_a_peer_that_is_not_there_is_left_out_and_named(monkeypatch):
    real = sdp_backends.find_spec
    monkeypatch.setattr(sdp_backends, "find_spec", lambda n: None if n == "scs" else real(n))
    found = bench_gains(samples=10, robots=["ur5"], seconds=0.1)
    peers = {"clarabel", "clarabel_bare"}
    assert {row["solver"] for row in found["rows"]} == {OURS, COLD, TICK, *peers}
    assert missing() == {"scs": "scs"}


def test_a_robot_without_a_motion_is_named_before_anything_is_timed():
    with pytest.raises(UnknownNameError, match="humanoid32"):
        bench_gains(robots=["ur5", "humanoid"])


def test_the_command(monkeypatch, measured):
    asked = []

    def stub(*given, report):
        asked.append(given)
        return measured

    monkeypatch.setattr(gains, "bench_gains", stub)
    done = CliRunner().invoke(app, ["bench", "gains", "--quick", "--json"])
    told = json.loads(done.stdout)
    assert told.keys() == {"rows", "ratios", "missing", "machine"}
    assert told["rows"] == measured["rows"]
    done = CliRunner().invoke(app, ["bench", "gains", "--samples", "30", "--robot", "hoap3"])
    assert done.exit_code == 0
    for words in ("ur5, 4 rows, 6 joints: clarabel takes", "times as long", TICK):
        assert words in done.stdout
    assert asked == [(10, ("ur5",), QUICK_S), (30, ["hoap3"], gains.MOTION_S)]
