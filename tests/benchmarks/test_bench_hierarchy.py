"""Hierarchies beside other solvers: the same problems, the same answers, one picture."""

from __future__ import annotations

import json

import numpy as np
import pytest
from support.solvers.one_shot import ghc

from benchmarks import hierarchy, hierarchy_problems, qp_peers
from benchmarks.hierarchy import OURS, PEERS, QUICK_TASKS, bench_hierarchy, missing, ratios
from benchmarks.hierarchy_problems import FRAMES, bounds, moments, program
from benchmarks.plot import draw_hierarchies
from hoap3.tools.reproduce.papers.ghc.times import STATES, W_R, hierarchies

pytestmark = pytest.mark.slow

KEYS = {"solver", "robot", "n", "tasks", "case", "samples", "min_us", "mean_us", "p50_us"} | {
    *("p99_us", "max_us", "times_ghc", "times_ghc_min", "worst_error", "worst_residual"),
    *("active_mean", "active_max", "paper"),
}
MACHINE = {"processor": "Abacus", "kernel": "0.1"}


@pytest.fixture(scope="module")
def walk():
    return moments("lwr")


@pytest.fixture(scope="module")
def measured():
    return bench_hierarchy(samples=10, tasks=QUICK_TASKS, robots=["lwr"])


def row(solver: str, p50_us: float, times: float, **more: object) -> dict:
    common = {"robot": "lwr", "n": 7, "tasks": 5, "case": "free", "times_ghc_min": times}
    return {"solver": solver, "p50_us": p50_us, "times_ghc": times, **common, **more}


def test_tasks_are_frames_in_strict_order_above_a_posture(walk):
    assert len(walk) == STATES
    problem = hierarchies(walk, 3)[0]
    assert problem.sizes == [3, 3, 7]
    np.testing.assert_array_equal(problem.jacobian[6:], np.eye(7))
    np.testing.assert_array_equal(problem.alpha, [[0, 0, 0], [1, 0, 0], [1, 1, 0]])
    mixed = hierarchies(walk, 3, seed=0)[0].alpha
    assert ((mixed > 0) & (mixed < 1)).all()
    assert all(len(frames) == 6 for frames in FRAMES.values())


def test_a_walk_goes_to_and_fro(walk):
    assert walk[-1] is walk[0]
    assert np.abs(walk[1].mass - walk[0].mass).max() > 1e-4


@pytest.mark.parametrize("name", [name for name in PEERS if name not in missing()])
@pytest.mark.parametrize("bounded", [False, True])
def test_peers_agree_on_every_problem(walk, name, bounded):
    make = qp_peers.PEERS[name]
    for it in hierarchies(walk, 4)[: STATES // 2]:
        edges = np.cumsum(it.sizes)[:-1]
        tasks = np.split(it.jacobian, edges), np.split(it.targets, edges), it.alpha
        given = *tasks, it.mass, it.bias, W_R
        free = ghc(*given)
        most = bounds(it, *free) if bounded else None
        limits = {} if most is None else {"qdd_upper": most[0], "tau_upper": most[1]}
        limits |= {name.replace("upper", "lower"): -most for name, most in limits.items()}
        qdd, tau = ghc(*given, **limits)
        p = program(it, most)
        solved, x, _ = make(p)(hierarchy.TOLERANCE)
        assert solved
        np.testing.assert_allclose(p.motion @ x, qdd, atol=1e-8 * (1 + np.abs(qdd).max()))
        np.testing.assert_allclose(x[-7:], tau, atol=1e-8 * (1 + np.abs(tau).max()))
        if bounded:
            assert np.abs(qdd - free[0]).max() > 1e-3  # they hold it back


def test_each_solver_is_timed_with_each_number_of_tasks(measured):
    absent = missing()
    names = [OURS, *(name for name in PEERS if name not in absent)]
    rows = measured["rows"]
    assert all(each.keys() == KEYS for each in rows)
    cases = "free", "bounded"
    wanted = {(name, k, case) for name in names for k in QUICK_TASKS for case in cases}
    wanted |= {("ghc, mixed", 5, case) for case in cases} | {("ghc tick", 3, "ghc")}
    assert {(r["solver"], r["tasks"], r["case"]) for r in rows} == wanted
    for each in rows:
        if each["solver"] in PEERS:
            assert each["worst_error"] < 1e-8
            assert each["samples"] == 10
        elif each["solver"] != "ghc tick":
            assert each["worst_residual"] < 1e-8
            assert each["samples"] == 10 * hierarchy.ALONE
            assert (each["active_mean"] > 0) == (each["case"] == "bounded")
    assert [r["paper"]["mean_us"] for r in rows if r["paper"]] == [2700.0]


def test_the_ratio_is_that_of_the_best_peer():
    rows = [row("ghc", 1, 1.0), row("daqp", 9, 9.0), row("quadprog", 7, 7.0)]
    rows += [row("daqp", 5, 5.0, tasks=2), row("daqp", 30, 30.0, case="bounded")]
    found = {each["case"]: each for each in ratios(rows)}
    assert found["free"]["best_peer"] == "quadprog"
    assert found["free"]["times_ghc"] == 7.0
    assert found["bounded"]["best_peer"] == "daqp"


def test_a_peer_that_is_not_there_is_left_out_and_named(monkeypatch):
    real = qp_peers.find_spec
    monkeypatch.setattr(qp_peers, "find_spec", lambda n: None if n == "quadprog" else real(n))
    found = bench_hierarchy(samples=10, tasks=[1], robots=["lwr"])
    assert {each["solver"] for each in found["rows"]} == {"ghc", "daqp", "ghc tick"}
    assert found["ratios"] == []
    assert missing() == {"quadprog": "quadprog"}


def test_icub_is_its_vendors_and_named_where_it_is_not_installed(monkeypatch):
    assert len(moments("icub")[0].bias) == 32
    rows = bench_hierarchy(samples=10, tasks=[1], robots=["icub"])["rows"]
    assert {each["robot"] for each in rows} == {"icub"}
    assert all(each["worst_error"] < 1e-9 for each in rows if each["solver"] in PEERS)
    absent = {"icub": ("no-such-package", "icub.urdf")}
    monkeypatch.setattr(hierarchy_problems, "VENDORS", absent)
    assert missing() == {"icub": "no-such-package"}
    assert bench_hierarchy(samples=10, tasks=[1], robots=["icub"])["rows"] == []


def test_the_picture_has_a_panel_a_robot_and_a_line_a_solver_and_case(tmp_path):
    rows = [
        row(name, 10.0 * k, 1.0, tasks=k, case=case, robot=robot, n=n)
        for name in ("ghc", "daqp")
        for case in ("free", "bounded")
        for robot, n in (("lwr", 7), ("humanoid32", 32))
        for k in (1, 5)
    ]
    rows.append(row("ghc, mixed", 3.0, 1.0, times_ghc=None))
    path = tmp_path / "hierarchy.svg"
    draw_hierarchies({"rows": rows, "machine": MACHINE}, path)
    text = path.read_text(encoding="utf-8")
    for words in ("lwr, 7 joints", "humanoid32, 32 joints", "daqp, bounded", "ghc, free"):
        assert words in text
    assert "mixed" not in text


def test_the_command(monkeypatch, tmp_path, measured, run_command):
    asked = []

    def stub(*given, report):
        asked.append(given)
        return measured

    monkeypatch.setattr(hierarchy, "bench_hierarchy", stub)
    picture = tmp_path / "h.png"
    done = run_command(hierarchy.command, "--quick", "--json", "--plot", picture)
    told = json.loads(done.stdout)
    assert told.keys() == {"rows", "ratios", "missing", "machine"}
    assert told["rows"] == measured["rows"]
    assert picture.stat().st_size > 1000
    done = run_command(hierarchy.command, "--samples", 30)
    assert done.exit_code == 0
    assert "lwr, 5 tasks, free" in done.stdout
    assert asked == [(10, QUICK_TASKS), (30, hierarchy.TASKS)]
