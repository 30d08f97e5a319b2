"""Misses that a load next to a robot adds: from pairs of runs."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import ttest_1samp
from support import HOUSE

from benchmarks.load.runs import QUIET, added, race
from benchmarks.load.show import show_race
from hoap3.protocol.errors import Hoap3Error, UsageError

SHARES = st.lists(
    st.tuples(*(st.floats(0.0, 0.1).map(lambda x: round(x, 5)) for _ in range(2))),
    min_size=2,
    max_size=12,
)


def runs(shares: list[tuple[float, float]]) -> list[dict[str, object]]:
    """Pairs of runs with these shares of missed ticks, the later ones first."""
    return [
        {"pair": pair, "beside": there, "missed": share, "missed_outside": share, "rtt_p99_us": 1e3}
        for pair, both in reversed(list(enumerate(shares)))
        for there, share in zip((False, True), both, strict=True)
    ]


@given(shares=SHARES)
def test_the_bound_is_that_of_students_t_over_the_pairs(shares):
    found = added(runs(shares))
    differences = np.array([there - without for without, there in shares])
    assert found["missed"]["mean"] == pytest.approx(differences.mean(), abs=1e-15)
    if np.ptp(differences) > 1e-6:
        high = ttest_1samp(differences, 0.0, alternative="less").confidence_interval(0.95).high
        assert found["missed"]["upper"] == pytest.approx(high, rel=1e-9)
    assert found["pairs"] == len(shares)


def test_without_a_watch_for_stalls_nothing_is_said_of_what_is_outside_them():
    rows = runs([(0.1, 0.2), (0.1, 0.1)])
    rows[1]["missed_outside"] = None
    assert added(rows)["missed_outside"] is added(rows)["alone"] is None


@given(shares=SHARES)
def test_what_the_machine_misses_alone_is_the_mean_of_the_runs_without(shares):
    assert added(runs(shares))["alone"] == pytest.approx(np.mean([alone for alone, _ in shares]))


def test_a_run_that_nobody_answered_has_no_rtt_to_compare():
    rows = runs([(0.1, 0.2), (0.1, 0.1)])
    rows[0]["rtt_p99_us"] = None
    assert added(rows)["rtt_p99_ratio"] == 1.0
    rows[2]["rtt_p99_us"] = None
    assert added(rows)["rtt_p99_ratio"] is None


def shown(capsys: pytest.CaptureFixture[str], stops: int, alone: float = 0.0) -> list[list[str]]:
    """Words of each line of two pairs; without it, one missed `alone`, the other had `stops`."""
    rows = [
        {**row, "ticks": 4321, "rtt_p50_us": None, "safe_stops": 0}
        for row in runs([(alone, 0.025), (0.0, 0.0)])
    ]
    rows[0]["safe_stops"] = stops
    cpus = {"loops": [], "beside": [0, 1]}
    did = [{"states": 7, "failed": []}, {"states": 9, "failed": []}]
    show_race({"rows": rows, "added": added(rows), "did": did, "cpus": cpus})
    return [line.split() for line in capsys.readouterr().out.splitlines()]


def test_each_run_is_a_row_and_one_that_stopped_is_told(capsys):
    stopped, whole = shown(capsys, 1), shown(capsys, 0)
    heads, *rows = whole[:5]
    missed = [dict(zip(heads, row, strict=True))["missed"] for row in rows]
    assert missed == ["0.00000"] * 3 + ["0.02500"]
    assert [row[heads.index("safe_stops")] for row in stopped[1:5]] == ["1", "0", "0", "0"]
    assert len(stopped) == len(whole) + 1


def test_a_machine_that_misses_much_by_itself_is_told_once(capsys):
    quiet, noisy = shown(capsys, 0, 2 * QUIET), shown(capsys, 0, 2.2 * QUIET)
    assert len(noisy) == len(quiet) + 1


RUN = {
    "ticks": 100, "skipped": 0, "misses": {"late": 0, "lost": 0}, "misses_outside_stalls": 0,
    "rtt_us": {}, "safe_stops": 0,
}  # fmt: skip
LOOKS_ON = """
import json, os
from hoap3.tools.machine.processes import Lifeline, read_order
lifeline, order = Lifeline(), read_order()
print("ready", flush=True)
lifeline.cut(None)
print(json.dumps({"failed": [], "cpus": sorted(os.sched_getaffinity(0))}))
"""


class Stage:
    """Stands in for placement and for runs: what was asked of both.

    Attributes:
        cpu: that is given, or None.
        run_on: CPUs of robot and controller, a pair a run.
        held: whether the CPU is claimed.
    """

    def __init__(self, monkeypatch, cpu):
        self.cpu, self.run_on, self.held = cpu, [], 0
        monkeypatch.setattr("benchmarks.load.runs.placed", self.placed)
        monkeypatch.setattr("benchmarks.load.runs.claim_cpu", self.claim)
        monkeypatch.setattr("benchmarks.load.runs.run_realtime", self.run)

    def claim(self):
        self.held += self.cpu is not None
        return None if self.cpu is None else self

    def placed(self, robot, controller, _report):
        sides = [side.model_copy(update={"cpu": self.cpu}) for side in (robot, controller)]
        return *sides, [self.claim()]

    def release(self):
        self.held -= 1

    def run(self, emulator, law, *_, **__):
        assert self.held == 1
        self.run_on.append((emulator.realtime.cpu, law.realtime.cpu))
        return RUN


@pytest.fixture
def looks_on(tmp_path, monkeypatch):
    """A module that runs beside, and tells its CPUs."""
    (tmp_path / "looks_on.py").write_text(LOOKS_ON)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    return "looks_on"


@pytest.mark.parametrize("apart", [False, True])
def test_what_runs_beside_has_all_cpus_or_those_that_the_loops_have_not(
    looks_on, monkeypatch, apart
):
    *others, last = cpus = sorted(os.sched_getaffinity(0))
    if not others:
        pytest.fail("two CPUs are needed")
    stage = Stage(monkeypatch, last)
    told = race(looks_on, {}, 2, 0.5, lambda *_: None, apart=apart)
    assert stage.run_on == [(last, last)] * 4
    assert stage.held == 0
    beside = others if apart else cpus
    assert told["cpus"] == {"loops": [last], "beside": beside}
    assert [each["cpus"] for each in told["did"]] == [beside] * 2
    assert sorted(os.sched_getaffinity(0)) == cpus


@pytest.mark.parametrize(
    ("cpu", "allowed", "realtime"), [(1, {1}, True), (None, {0, 1}, True), (1, {0, 1}, False)]
)
def test_what_cannot_be_kept_apart_is_refused(looks_on, monkeypatch, cpu, allowed, realtime):
    monkeypatch.setattr("os.sched_getaffinity", lambda _: allowed)
    stage = Stage(monkeypatch, cpu if realtime else "none")
    with pytest.raises(UsageError):
        race(looks_on, {}, 2, 0.5, lambda *_: None, apart=True, realtime=realtime)
    assert (stage.run_on, stage.held) == ([], 0)


def test_what_dies_beside_the_robot_is_no_race(tmp_path, monkeypatch):
    monkeypatch.setattr("benchmarks.load.runs.run_realtime", lambda *_, **__: RUN)
    lines = "sys.stdin.buffer.read()", "print('ready', flush=True)", "raise SystemExit(3)"
    (tmp_path / "dies.py").write_text("\n".join(["import sys", *lines]))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    with pytest.raises(Hoap3Error, match="code 3"):
        race("dies", {}, 2, 0.5, lambda *_: None, realtime=False)


def measured(*words: object) -> list[dict[str, float]]:
    """What did something beside two of four runs, as `python -m benchmarks.load` prints it."""
    given = *map(str, words), "--pairs", "2", "--json", "--no-realtime"
    command = [sys.executable, "-m", "benchmarks.load", *given]
    done = subprocess.run(command, cwd=HOUSE, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert [row["beside"] for row in told["rows"]] == [False, True, True, False]
    assert len(told["did"]) == told["added"]["pairs"] == 2
    return told["did"]


@pytest.mark.long  # a busy robot stops before anybody steers
def test_clients_steer_and_look_in_every_other_run():
    did = measured("clients", "--count", 3, "--rate", 50, "--seconds", 6)
    assert all(each["targets"] > 0 and each["states"] > 0 for each in did)


@pytest.mark.long
def test_a_stranger_floods_in_every_other_run():
    did = measured("flood", "--rate", 5000, "--seconds", 1)
    assert all(each["messages"] > 100 for each in did)


@pytest.mark.long
def test_a_page_is_looked_at_in_every_other_run():
    for each in measured("view", "--seconds", 8):  # a page takes seconds to begin
        assert each["frames"] > 0
        assert each["bytes"] > 100 * each["frames"]
