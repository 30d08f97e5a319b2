"""Benchmarks print what they define; their times are nobody's to assert."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from protocol.errors import UnknownNameError
from tools.bench.cycle import bench_cycle
from tools.bench.peers import PEERS, peer
from tools.bench.solvers import bench_solvers, gradients
from tools.bench.timing import time_calls
from tools.cli import app

FIGURES = {"samples", "min_us", "mean_us", "p50_us", "p99_us", "max_us"}
FIGURES |= {"batch_min_us", "batch_mean_us", "batch_max_us"}


def test_every_call_is_timed_after_a_warm_up():
    calls: list[int] = []
    figures = time_calls(calls.append, 50, warm_up=7)
    assert calls == [*range(7), *range(50), *range(50)]
    assert figures.keys() == FIGURES
    assert figures["min_us"] <= figures["p50_us"] <= figures["p99_us"] <= figures["max_us"]
    assert figures["batch_min_us"] <= figures["batch_mean_us"] <= figures["batch_max_us"]


def test_the_stream_changes_at_every_call_and_has_no_jump():
    stream, decrease = gradients(21)
    steps = np.abs(np.diff(np.vstack([stream, stream[:1]]), axis=0)).max(axis=1)
    assert (stream > 0).all()
    assert (decrease > 0).all()
    assert steps.max() < 0.15
    assert np.count_nonzero(steps) >= len(steps) - 2  # it turns round twice


@pytest.mark.parametrize("name", PEERS)
def test_peers_agree_with_the_kernel(name):
    stream, decrease = gradients(7)
    solve, ours = peer(name, 7, 0.3), peer("qp12", 7, 0.3)
    if solve is None:
        assert name == "proxqp"  # an extra that the tests do not install
        return
    for a, b in zip(stream[::50], decrease[::50], strict=True):
        np.testing.assert_allclose(np.abs(solve(a, b)), np.abs(ours(a, b)), atol=1e-5)


def test_an_unknown_peer_is_named():
    with pytest.raises(UnknownNameError, match="daqp"):
        peer("daqpp", 3, 0.5)


def test_rows_of_solvers_and_of_a_cycle():
    rows = bench_solvers(samples=20)
    assert {"qp12", "daqp", "osqp", "quadprog", "pinv", "pinv_svd"} <= {r["solver"] for r in rows}
    assert all(row.keys() >= FIGURES for row in rows)
    assert all(row["worst_error"] < 1e-4 for row in rows if row["worst_error"] is not None)
    assert [row["solver"] for row in bench_cycle(samples=20)] == ["qp12 step", "qp12 answer"]


def test_the_command_prints_json_on_standard_output():
    done = CliRunner().invoke(app, ["bench", "cycle", "--samples", "20", "--json"])
    assert done.exit_code == 0
    assert json.loads(done.stdout).keys() == {"rows", "machine"}
