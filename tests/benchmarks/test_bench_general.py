"""`bench_general`: its streams are what they say, its rows complete, and failures are seen."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks import general, qp_peers, solvers
from hoap3.remote_controller.solvers import StableQp
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.lyapunov_qp.stable_qp import QP
from hoap3.remote_controller.solvers.qp.dense_qp import daqp

pytestmark = pytest.mark.slow

DAQP = {"daqp": daqp}


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(general, "STREAM", 6)
    monkeypatch.setattr(general, "AT_LIMIT", 2)


def test_rows() -> None:
    rows = general.bench_general(21, 12, 0.5, qp_peers.installed())
    by_name = {row["solver"]: row for row in rows}
    ours = ["bounded qp12", "stable_qp, feasible", "stable_qp, limited"]
    assert [*by_name][:3] == ours
    assert {"daqp", "osqp", "quadprog", "reference"} <= by_name.keys()
    for row in rows:
        assert row["n"] == 21
        assert row["samples"] == 12
        assert row["problems"] == 6
        assert row["problems_at_limit"] == 2
        assert 0.0 < row["min_us"] <= row["p50_us"] <= row["max_us"]
    assert by_name["daqp"]["times_daqp"] == 1.0
    for name in (*ours, "daqp", "quadprog"):
        assert by_name[name]["failures"] == 0
    assert by_name["reference"]["failures"] is None
    assert by_name["daqp"]["failures_at_limit"] == 0


@pytest.mark.parametrize("kind", ["feasible", "limited"])
def test_streams_need_the_qp(kind: str) -> None:
    for problem in general.stream(21, 0.5, kind):
        solver = StableQp(21, general.ROWS)
        assert solver.solve(*problem) == status.OK
        assert solver.path == QP
        assert (solver.rho == 1.0) == (kind == "feasible")


def test_fewer_samples_than_problems_make_fewer_problems() -> None:
    for row in general.bench_general(21, 1, 0.5, DAQP):
        assert row["problems"] == row["problems_at_limit"] == row["samples"] == 1


def test_an_answer_of_ours_without_proof_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(general, "CERTAIN", -1.0)
    rows = {row["solver"]: row for row in general.bench_general(21, 6, 0.5, DAQP)}
    assert rows["bounded qp12"]["failures"] == rows["stable_qp, feasible"]["failures"] == 6
    assert rows["daqp"]["failures"] == 0


def test_the_command_has_them_as_a_second_table(run_command) -> None:
    done = run_command(solvers.command, "--samples", 10)
    assert done.exit_code == 0
    for words in ("times_qp12", "stable_qp, limited", "times_daqp", "0 of 6", "failures_at_limit"):
        assert words in done.stdout


def test_the_command_has_them_in_its_json_whole(run_command) -> None:
    done = run_command(solvers.command, "--samples", 60, "-n", 5, "--json")
    rows = {row["solver"]: row for row in json.loads(done.stdout)["general"]}
    assert {"bounded qp12", "stable_qp, feasible", "stable_qp, limited", "daqp"} <= rows.keys()
    for row in rows.values():
        assert row["samples"] == 12  # a fifth
        assert row["n"] == 5
        figures = {"min_us", "mean_us", "p50_us", "p99_us", "max_us", "times_daqp", "failures"}
        assert figures <= row.keys()


def test_what_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(qp_peers, "find_spec", lambda name: None if name == "piqp" else name)
    assert qp_peers.missing() == {"piqp": "piqp"}


def test_a_peer_that_is_wrong_is_counted() -> None:
    wrong = True, np.full(42, 0.1), np.zeros(6)
    peers = {**DAQP, "wrong": lambda program: lambda tolerance: wrong}
    row = {row["solver"]: row for row in general.bench_general(21, 6, 0.5, peers)}["wrong"]
    assert row["failures"] == 6
    assert row["failures_at_limit"] == 2
