"""How times grow with joints: the slope is the exponent, the picture has a line a solver."""

from __future__ import annotations

import json
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks import scaling
from benchmarks.plot import FIT_FROM, draw_scaling
from benchmarks.qp12_peers import installed
from benchmarks.scaling import SIZES, bench_scaling, slope, slopes
from hoap3.protocol.errors import ConfigError, NotInstalledError

pytestmark = pytest.mark.slow

MACHINE = {"processor": "Abacus", "kernel": "0.1"}


def law(name: str, exponent: float, factor: float = 0.1, call: float = 0.0) -> list[dict]:
    """Rows of a solver that takes call + factor·n^exponent."""
    return [{"solver": name, "n": n, "p50_us": call + factor * n**exponent} for n in SIZES]


@given(exponent=st.floats(-1, 4), factor=st.floats(1e-3, 1e3))
def test_the_slope_of_a_power_law_is_its_exponent(exponent, factor):
    rows = law("a", exponent, factor)
    assert slopes(rows)["a"] == pytest.approx(exponent, abs=1e-6)


def test_slopes_are_fitted_from_a_hundred_joints_on_and_for_each_solver():
    rows = law("a", 1.0) + law("b", 3.0)
    for row in rows:
        if row["n"] < FIT_FROM:
            row["p50_us"] = 1e6
    assert slopes(rows) == {"a": pytest.approx(1.0), "b": pytest.approx(3.0)}


def test_one_size_has_no_slope():
    assert slopes([{"solver": "a", "n": 100, "p50_us": 1.0}]) == {}


def test_what_a_call_costs_by_itself_flattens_the_slope():
    sizes, times = zip(*[(r["n"], r["p50_us"]) for r in law("a", 1.0, call=5.0)], strict=True)
    assert slope(sizes, times) < 0.8


def test_each_solver_is_timed_at_each_size():
    told: list[str] = []
    found = bench_scaling(samples=10, sizes=(14, 7), report=told.append)
    assert found.keys() == {"rows", "slopes", "left_out"}
    timed = {(row["solver"], row["n"]) for row in found["rows"]}
    assert timed == {(name, n) for name in installed() for n in (7, 14)}
    keys = {"solver", "n", "samples", "min_us", "mean_us", "p50_us", "p99_us", "max_us"}
    assert all(row.keys() == keys for row in found["rows"])
    set_up = [f"setting up {name} for {n} joints" for n in (7, 14) for name in installed()]
    assert told[: len(set_up)] == set_up
    assert any("%" in each for each in told[len(set_up) :])
    assert found["left_out"] == []


def test_slow_solvers_are_timed_less_often(monkeypatch):
    monkeypatch.setattr(scaling, "SLOW_S", 0.0)
    (row,) = bench_scaling(samples=50, sizes=[7], solvers=["qp12"])["rows"]
    assert row["samples"] == scaling.SLOW_SAMPLES


def test_a_solver_that_is_too_slow_is_left_out_from_there_on(monkeypatch):
    monkeypatch.setattr(scaling, "LONGEST_S", 0.0)
    found = bench_scaling(samples=10, sizes=(7, 14), solvers=["qp12", "daqp"])
    assert [(out["solver"], out["n"]) for out in found["left_out"]] == [("qp12", 7), ("daqp", 7)]
    assert found["rows"] == []


@pytest.mark.parametrize("name", ["scaling.txt", "no/where.png"])
def test_a_picture_that_cannot_be_is_refused_before_anything_is_measured(
    tmp_path, monkeypatch, run_command, name
):
    monkeypatch.setattr(scaling, "bench_scaling", lambda *_, **__: pytest.fail("it measured"))
    done = run_command(scaling.command, "--plot", tmp_path / name)
    assert isinstance(done.exception, ConfigError)
    assert name in str(done.exception)


def test_without_matplotlib_nothing_is_measured(tmp_path, monkeypatch, run_command):
    monkeypatch.setitem(sys.modules, "matplotlib", None)  # as if it were not installed
    monkeypatch.setattr(scaling, "bench_scaling", lambda *_, **__: pytest.fail("it measured"))
    done = run_command(scaling.command, "--plot", tmp_path / "scaling.png")
    assert isinstance(done.exception, NotInstalledError)


def test_a_picture_that_cannot_be_written_is_an_error_of_one_line(tmp_path):
    (tmp_path / "folder.png").mkdir()
    made = {"rows": law("a", 1.0), "slopes": {}, "machine": MACHINE}
    with pytest.raises(ConfigError, match=r"folder\.png"):
        draw_scaling(made, tmp_path / "folder.png")


def test_the_command_writes_json_and_a_picture(tmp_path, run_command):
    path = tmp_path / "scaling.png"
    words = "--samples", 10, "--most", 14, "--json", "--plot", path
    done = run_command(scaling.command, *words)
    assert done.exit_code == 0, done.output
    printed = json.loads(done.stdout)
    assert printed.keys() == {"rows", "slopes", "left_out", "missing", "machine"}
    assert {row["n"] for row in printed["rows"]} == {7, 14}
    assert path.read_bytes().startswith(b"\x89PNG")


def test_people_see_a_row_for_each_size(run_command):
    done = run_command(scaling.command, "--samples", 10, "--most", 14)
    assert done.exit_code == 0
    for word in ("median us", "daqp", "osqp_bare", "14", "slope"):
        assert word in done.stdout
