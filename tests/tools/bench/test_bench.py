"""Benchmarks print what they define; their times are nobody's to assert."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
import pytest
from typer.testing import CliRunner

from hoap3.tools.bench import peers
from hoap3.tools.bench.case_runner import BATCH, SETTLE, Case, Times, time_cases
from hoap3.tools.bench.cycle import bench_cycle
from hoap3.tools.bench.peers import PEERS
from hoap3.tools.bench.solvers import STREAM, bench_solvers, gradients, jacobians, worst_error
from hoap3.tools.cli.app import app

FIGURES = {"samples", "min_us", "mean_us", "p50_us", "p99_us", "max_us"}
OF_BATCHES = {"batches", "batch_min_us", "batch_mean_us", "batch_max_us"}
ERRORS = {  # what each solver's tolerance allows, relative to the largest speed
    "qp12": 1e-12,
    "daqp": 1e-10,
    "osqp": 1e-3,
}


def test_all_take_their_turn_in_each_block_and_go_on_with_their_own_problems():
    calls: list[tuple[str, int]] = []
    sizes = {"a": 5, "b": 1000}
    cases = [
        Case(name, lambda k, name=name: calls.append((name, k)), [(k,) for k in range(size)])
        for name, size in sizes.items()
    ]
    times = time_cases(cases, samples=20, blocks=4)
    turn = SETTLE + 5 + BATCH
    assert [name for name, _ in calls] == (["a"] * turn + ["b"] * turn) * 4
    for name, size in sizes.items():
        assert [k for each, k in calls if each == name] == [k % size for k in range(4 * turn)]
        assert times[name].single.shape == (4, 5)
        assert times[name].batch.shape == (4,)


def test_arrays_are_read_before_they_are_timed_wherever_they_are_in_a_problem(monkeypatch):
    seen: list[object] = []

    class Watched(np.ndarray):
        def tobytes(self, *given):
            seen.append(len(self))
            return super().tobytes(*given)

    @dataclass
    class Program:
        H: object

    first, second, third = (np.ones(n).view(Watched) for n in (1, 2, 3))
    problems = [(first, 0.5, [second], Program(third))]
    time_cases(
        [Case("a", lambda *problem: seen.append("call"), problems)], samples=1, batches=False
    )
    assert seen == [1, 2, 3] * (SETTLE + 1) + ["call"] * (SETTLE + 1)


def test_without_batches_there_are_none():
    calls: list[int] = []
    times = time_cases([Case("a", calls.append, [(1,)])], samples=6, blocks=2, batches=False)
    assert len(calls) == 2 * (SETTLE + 3)
    assert times["a"].figures().keys() == FIGURES


def test_fewer_samples_make_fewer_blocks():
    times = time_cases([Case("a", int, [()])], samples=7)
    assert times["a"].single.shape == (7, 1)


def test_figures_are_those_of_single_calls_and_of_batches():
    single = np.arange(1.0, 101.0).reshape(10, 10)
    found = Times(single, np.array([1.0, 9.0, 2.0])).figures()
    assert found == {
        "samples": 100,
        "min_us": 1.0,
        "mean_us": 50.5,
        "p50_us": 50.5,
        "p99_us": pytest.approx(99.01),
        "max_us": 100.0,
        "batches": 3,
        "batch_min_us": 1.0,
        "batch_mean_us": 2.0,
        "batch_max_us": 9.0,
    }


def test_a_ratio_does_not_see_how_the_machine_drifts():
    noise = np.random.default_rng(0).uniform(0.99, 1.01, size=(2, 21, 50))
    block = np.arange(21)[:, None]  # the machine slows down within block 10, between the two
    ours = Times(np.where(block <= 10, 1.0, 2.0) * noise[0], np.zeros(0))
    theirs = Times(np.where(block < 10, 3.0, 6.0) * noise[1], np.zeros(0))
    assert np.median(theirs.single) / np.median(ours.single) > 5.0
    assert theirs.times(ours) == pytest.approx(3.0, rel=0.01)
    assert ours.times(ours) == 1.0


@pytest.mark.parametrize("stream", [gradients(21), jacobians(21)], ids=["gradients", "jacobians"])
def test_a_stream_changes_at_every_call_and_has_no_jump(stream):
    rows = np.array([np.ravel(first) for first, _ in stream])
    steps = np.abs(np.diff(np.vstack([rows, rows[:1]]), axis=0)).max(axis=1)
    assert len(rows) == STREAM
    assert steps.max() < 0.15
    assert np.count_nonzero(steps) >= len(steps) - 2  # it turns round twice


def test_gradients_are_positive_and_the_whole_of_a_jacobian_is_in_one_piece():
    assert all((a > 0).all() and b > 0 for a, b in gradients(21))
    assert all(jacobian.flags["C_CONTIGUOUS"] for jacobian, _ in jacobians(21))


@pytest.mark.parametrize("gamma", [0.0, 0.5, 0.8])
@pytest.mark.parametrize("name", PEERS)
def test_a_peer_agrees_with_the_kernel_at_every_call(name, gamma):
    exact, found = PEERS["qp12"](13, gamma), PEERS[name](13, gamma)
    problems = gradients(13)
    assert worst_error(found, exact, problems + problems[::-7]) < ERRORS[name]


def test_the_error_of_an_answer_is_relative_to_the_largest_speed():
    exact = peers.Peer(lambda a, b: a)
    other = peers.Peer(lambda a, b: -a + [0.0, 0.0, b])
    problems = [(np.array([1.0, 4.0, 2.0]), 0.2), (np.array([1.0, 8.0, 2.0]), -0.8)]
    assert worst_error(other, exact, problems) == pytest.approx(0.1)


def test_rows_of_solvers():
    rows = {row["solver"]: row for row in bench_solvers(samples=20)}
    assert rows.keys() == {*PEERS, "pinv", "pinv_svd", "reference"}
    for name, row in rows.items():
        assert row.keys() == FIGURES | OF_BATCHES | {
            "solver",
            "n",
            "worst_error",
            "times_qp12",
            "paper",
        }
        assert row["samples"] == row["batches"] == 20
        if name in {*PEERS, "pinv"}:
            assert row["worst_error"] < ERRORS.get(name, 1e-10)
    assert rows["qp12"]["times_qp12"] == 1.0
    assert rows["qp12"]["paper"]["mean_us"] == 1.358


def test_rows_of_a_cycle():
    rows = bench_cycle(samples=20)
    assert [row["solver"] for row in rows] == ["qp12 step", "qp12 answer", "reference"]
    for row in rows:
        assert row.keys() == FIGURES | OF_BATCHES | {"solver", "n", "times_reference", "paper"}
    assert rows[2]["times_reference"] == 1.0


def test_any_controller_has_a_cycle():
    assert bench_cycle("osqp", samples=10)[0]["solver"] == "osqp step"


def test_people_see_a_row_for_each_solver():
    done = CliRunner().invoke(app, ["bench", "cycle", "--samples", "10"])
    assert done.exit_code == 0
    for word in ("qp12 step", "qp12 answer", "reference", "times_reference", "272.20"):
        assert word in done.stdout


def test_the_commands_print_json_on_standard_output():
    done = CliRunner().invoke(app, ["bench", "solvers", "--samples", "10", "--json"])
    assert json.loads(done.stdout).keys() == {"rows", "machine"}
    done = CliRunner().invoke(app, ["bench", "cycle", "--samples", "20", "--json"])
    assert done.exit_code == 0
    assert json.loads(done.stdout).keys() == {"rows", "machine"}
