"""Gains by conic solvers: the same problems as ours, timed in turn, one table."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks import gains, sdp_backends
from benchmarks.conic_gains import SOLVERS, ConicGains
from benchmarks.gains import BARE, COLD, MOTION_S, OURS, QUICK_S, TICK, compare_gains
from benchmarks.gains_problems import Moment, walk
from hoap3.protocol.errors import UnknownNameError

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def along():
    return walk("ur5", QUICK_S)


@pytest.fixture(scope="module")
def measured():
    return compare_gains(samples=10, robots=["ur5"], seconds=QUICK_S)


def test_stretches_are_consecutive_and_spread_over_the_walk():
    moments = [Moment(*(np.full(1, float(k)),) * 4) for k in range(100)]
    found = [int(it.errors[0]) for it in gains.stretches(moments, 4, 10)]
    assert found == [*range(10), *range(30, 40), *range(60, 70), *range(90, 100)]
    assert len(gains.stretches(moments[:3], 2, 10)) == 20


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


def test_the_solvers_are_given_one_and_the_same_problem(along):
    it = along.moments[-1]
    ours = along.call(along.solver())(*it)
    for name in SOLVERS:
        peer = along.solver(ConicGains, solver=name)
        theirs = along.call(peer)(*it)
        np.testing.assert_allclose(theirs.gains, ours.gains, rtol=1e-6)
        (program,) = gains.programs(along, [it])
        x, _ = SOLVERS[name](*program)
        assert x[-1] * along.desired == pytest.approx(ours.beta, abs=1e-3)


def test_each_solver_is_timed(measured):
    rows = {row["solver"]: row for row in measured["rows"]}
    there = SOLVERS.keys() - gains.missing().keys()
    peers = [name + kind for name in there for kind in ("", BARE)]
    assert rows.keys() == {OURS, COLD, TICK, *peers}
    assert all(row.keys() == rows[OURS].keys() for row in rows.values())
    for row in rows.values():
        assert (row["robot"], row["n"], row["joints"]) == ("ur5", 4, 6)
    assert rows[OURS]["times_sdp"] == rows[OURS]["times_sdp_min"] == 1.0
    assert rows[OURS]["samples"] == rows[COLD]["samples"] == 10 * gains.ALONE
    for name in (OURS, COLD):
        assert rows[name]["worst_gap"] <= 1e-9
        assert sum(rows[name]["paths"].values()) == pytest.approx(1.0)
    assert rows[OURS]["paths"]["warm"] > 0.9
    assert rows[COLD]["paths"]["ipm"] == 1.0
    assert rows[OURS]["problems"] is rows[TICK]["failures"] is rows[COLD]["worst_beta"] is None
    for name in peers:
        assert rows[name]["worst_beta"] < 1e-2
        assert 0 <= rows[name]["failures"] < rows[name]["problems"] == 10
        assert rows[name]["samples"] == 10 - rows[name]["failures"]
    assert [row["peer"] for row in measured["ratios"]] == [n for n in rows if n in peers]


def test_a_peer_that_is_not_there_is_left_out_and_named(monkeypatch):
    real = sdp_backends.find_spec
    monkeypatch.setattr(sdp_backends, "find_spec", lambda n: None if n == "scs" else real(n))
    found = compare_gains(samples=10, robots=["ur5"], seconds=0.1)
    peers = {"clarabel", "clarabel_bare"}
    assert {row["solver"] for row in found["rows"]} == {OURS, COLD, TICK, *peers}
    assert gains.missing() == {"scs": "scs"}


def test_a_robot_without_a_motion_is_named_before_anything_is_timed():
    with pytest.raises(UnknownNameError, match="humanoid32"):
        compare_gains(robots=["ur5", "humanoid"])


def test_the_command(monkeypatch, measured, run_command):
    asked = []

    def stub(*given, report):
        asked.append(given)
        return measured

    monkeypatch.setattr(gains, "compare_gains", stub)
    told = json.loads(run_command(gains.command, "--quick", "--json").stdout)
    assert told.keys() == {"rows", "ratios", "missing", "machine"}
    assert told["rows"] == measured["rows"]
    done = run_command(gains.command, "--samples", 30, "--robot", "hoap3")
    assert done.exit_code == 0
    for words in ("clarabel", TICK):
        assert words in done.stdout
    assert asked == [(10, ("ur5",), QUICK_S), (30, ["hoap3"], MOTION_S)]
