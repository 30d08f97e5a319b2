"""`bench_general`: its streams are what they say, its rows complete, and failures are seen."""

from __future__ import annotations

import numpy as np
import pytest

from remote_controller.solvers import StableQp, status
from remote_controller.solvers.stable_qp import QP
from tools.bench import general


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(general, "STREAM", 6)
    monkeypatch.setattr(general, "AT_LIMIT", 2)


def test_rows() -> None:
    rows = general.bench_general(samples=12, kinds=("feasible", "limited"))
    by_name = {row["solver"]: row for row in rows}
    ours = ["bounded qp12", "stable_qp, feasible", "stable_qp, limited"]
    assert [*by_name][:3] == ours
    assert {"daqp", "osqp", "quadprog", "reference"} <= by_name.keys()
    for row in rows:
        assert row["n"] == 21
        assert row["samples"] == 12
        assert 0.0 < row["min_us"] <= row["p50_us"] <= row["max_us"]
    assert by_name["daqp"]["times_daqp"] == 1.0
    for name in (*ours[1:], "daqp", "quadprog"):
        assert by_name[name]["failures"] == 0
    assert by_name["daqp"]["failures_at_limit"] == 0


@pytest.mark.parametrize("kind", ["feasible", "limited"])
def test_streams_need_the_qp(kind: str) -> None:
    for problem in general.stream(21, 0.5, kind):
        solver = StableQp(21, general.ROWS)
        assert solver.solve(*problem) == status.OK
        assert solver.path == QP
        assert (solver.rho == 1.0) == (kind == "feasible")


def test_a_peer_that_is_wrong_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    spoilt = {"daqp": general.peers()["daqp"], "spoilt": lambda program: np.full(21, 0.1)}
    monkeypatch.setattr(general, "peers", lambda: spoilt)
    row = {row["solver"]: row for row in general.bench_general(samples=6)}["spoilt"]
    assert row["failures"] == 6
    assert row["failures_at_limit"] == 2
