"""`hoap3 run` in real time: what it counts, writes, prints, where it listens; a tick's cost."""

from __future__ import annotations

import io
import os
import signal
import socket
import sys
from collections.abc import Iterator
from contextlib import redirect_stderr
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from socket_census import addresses, assert_loopback_only, census
from support.command_bench import (
    QUIET,
    Command,
    assert_at_rest,
    assert_no_traceback,
    endpoint,
    events,
    followed,
    hoap3,
    inside,
)

from hoap3.protocol.messages import State
from hoap3.protocol.runtime.recorder import MemoryRecorder
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.analysis.deadline_verdict import judge_deadlines
from hoap3.tools.analysis.summary import LiveTable
from hoap3.tools.logs.log import Log, payload_hash
from hoap3.tools.services.configs import load_controller_config, load_emulator_config
from hoap3.tools.services.messages import LoopEvent, StatusMessage
from hoap3.tools.services.simulate import Lockstep

TICKS = 1000


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("run") / "log"


@pytest.fixture(scope="module")
def run(folder: Path) -> Iterator[Command]:
    patient = ("--set", "emulator.misses_to_stop=100000")  # busy machines miss many
    words = ("--duration", TICKS / 1000, "--json", "--out", folder, *patient)
    with Command("run", *words) as command:
        command.wait_for("following robot")
        command.listens = census(command)
        assert command.end() in {0, 1}
        yield command


def test_it_listens_on_loopback_only(run):
    assert run.listens == {"127.0.0.1"}


def test_json_has_every_promised_key(run, folder):
    summary = run.json()
    assert summary.keys() >= {
        "verdicts", "task", "limits_and_balance",
        "ticks", "skipped", "misses", "misses_outside_stalls", "host_stalls",
        "success_rate", "rtt_us", "wakeup_us", "stages_us", "final_error", "machine", "log",
    }  # fmt: skip
    assert summary["misses"].keys() == {
        "late", "lost", "rejected", "duplicate", "conflicting", "out_of_order", "longest_run",
    }  # fmt: skip
    assert summary["success_rate"].keys() == {"run", "outside_stalls", "worst_window"}
    figures = {"n", "min", "p50", "p90", "p99", "p99_9", "max"}
    answered = summary["ticks"] - summary["misses"]["lost"]  # none at all on a crowded machine
    for histogram in (summary["rtt_us"], summary["wakeup_us"], *summary["stages_us"].values()):
        assert histogram["n"] or answered <= 1
        assert histogram.keys() >= (figures if histogram["n"] else {"n"})
    assert summary["machine"]["versions"]["python"] == sys.version.split()[0]
    assert summary["log"] == str(folder)


def test_verdicts_and_exit_code_follow_from_the_counts(run):
    summary = run.json()
    rate = summary["success_rate"]["run"]
    in_time = summary["ticks"] - summary["misses"]["late"] - summary["misses"]["lost"]
    assert rate == pytest.approx(in_time / summary["ticks"])
    expected = judge_deadlines(summary)["verdict"]
    verdicts = summary["verdicts"]
    assert verdicts["deadlines"] == expected
    assert verdicts["limits_and_balance"] == ("fail" if summary["interventions"] else "pass")
    assert run.end() == (1 if expected == "fail" or "fail" in verdicts.values() else 0)


def test_asked_and_skipped_ticks_make_up_the_duration(run, folder):
    log = Log.open(folder, side="robot")
    states = log.states()
    active = states[states["mode"] == State.ACTIVE]
    first = int(active["tick"][0])
    after = states[states["tick"] >= first]
    steps = np.diff(states["tick"].astype(np.int64), prepend=-1)
    assert np.array_equal(np.cumsum(steps - 1), states["skipped"])  # each is counted once
    moves = states["mode"] == State.ACTIVE
    while_moving = np.diff(states["skipped"].astype(np.int64))[moves[1:] & moves[:-1]]
    assert run.json()["skipped"] == while_moving.sum()
    if run.json()["safe_stops"]:  # then the rest of the duration asked for nothing
        return
    stopping = after[after["mode"] != State.ACTIVE][0]
    skipped = int(stopping["skipped"]) - int(active["skipped"][0])
    assert len(active) + skipped == int(stopping["tick"]) - first >= TICKS
    assert run.json()["ticks"] == len(active)


def test_counts_are_those_of_the_log(run, folder):
    summary, log = run.json(), Log.open(folder, side="robot")
    last = log.states()[-1]
    for name in ("late", "lost", "rejected", "duplicate", "out_of_order"):
        assert summary["misses"][name] == last[name]
    if not summary["safe_stops"]:  # after one, answers that nothing asked for are still recorded
        assert summary["rtt_us"]["n"] == len(log.setpoints())
    assert summary["complete"]


@pytest.mark.parametrize("side", ["robot", "controller"])
def test_both_logs_open_in_the_stock_reader(run, folder, side):
    with (folder / f"{side}.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count > TICKS / 2
    topics = {channel.topic for channel in summary.channels.values()}
    assert topics >= {"/robots/hoap3/state", "/robots/hoap3/setpoint"}


def test_the_robot_starts_follows_and_ends_at_rest(run, folder):
    log = Log.open(folder, side="robot")
    names = [name for name, _ in events(log) if name not in {"SKIPPED", "CLIPPED"}]
    assert names[:2] == ["STARTED", "GRANTED"]
    assert names[-1] == "ENDED"
    assert_at_rest(log)


def test_neither_pins_nor_takes_priority(run):
    assert "ordinary" in run.stderr
    assert "not pinned" in run.stderr
    assert "SCHED_FIFO" not in run.stderr


def test_a_real_time_run_is_repeated_bit_by_bit(run, folder):
    again = hoap3("replay", folder, "--json")
    answered = len(Log.open(folder, side="controller").table(Kind.SETPOINT)[1])
    assert again.end() == 0, again.stderr
    assert again.json()["setpoints"] == again.json()["same"] == answered > 0


@pytest.mark.slow
def test_people_get_a_summary_whatever_lies_in_their_folder(tmp_path):
    """Neither packages of our names in it matter, nor folders called like what is to be run."""
    for room in ("protocol", "tools"):
        (tmp_path / room).mkdir()
        (tmp_path / room / "__init__.py").write_text("raise SystemExit('of somebody else')")
    for name in ("hoap3", "qp12"):
        (tmp_path / name).mkdir()
    before = set(tmp_path.rglob("*"))
    off = "emulator.log.record=false"
    with Command("run", "--duration", "0.2", "--set", off, cwd=tmp_path) as run:
        assert run.end() in {0, 1}
        run.assert_no_orphan()
    assert "deadlines" in run.stdout, run.stderr
    assert "somebody else" not in run.stderr
    assert_no_traceback(run)
    assert set(tmp_path.rglob("*")) == before  # nothing is written where nothing shall be


def test_the_normal_course_is_no_news_and_a_failure_is():
    quiet, all_of_it = LiveTable("title"), LiveTable("title", verbose=True)
    routine = [
        LoopEvent("robot: tick 0: started", "started", routine=True),
        StatusMessage("following robot", "routine"),
        StatusMessage("timer slack: 1 ns", "detail"),
    ]
    alarms = [
        LoopEvent("robot: tick 9: safe stop (misses)", "safe stop", routine=False),
        StatusMessage("the log has gaps"),
        StatusMessage("the log is not whole", "damaged"),
        StatusMessage("not granted by the system: memory lock", "not granted"),
    ]
    for table, expected in ((quiet, alarms), (all_of_it, [*routine, *alarms])):
        heard = io.StringIO()
        with redirect_stderr(heard):
            for item in (*routine, *alarms, alarms[-1]):  # the other side is refused the same
                table.show(item)
        assert heard.getvalue().splitlines() == [item.text for item in expected]


def test_paths_and_hashes_are_printed_in_one_piece(tmp_path):
    folder = tmp_path / ("a_folder_with_a_long_name_" * 3)
    done = inside("run", "--lockstep", "--duration", "0.01", "--out", folder)
    for side in ("robot", "controller"):
        assert payload_hash(Log.open(folder, side=side)) in done.stdout
    assert str(folder) in done.stdout


@pytest.mark.slow
def test_the_census_sees_what_listens_everywhere():
    with socket.socket() as tcp, socket.socket(type=socket.SOCK_DGRAM) as udp:
        tcp.bind(("0.0.0.0", 0))
        tcp.listen()
        udp.bind(("127.0.0.1", 0))
        assert addresses(os.getpid()) >= {"0.0.0.0", "127.0.0.1"}


@pytest.mark.slow
def test_services_and_tools_listen_on_loopback_only(tmp_path):
    at = endpoint()
    with (
        followed(at, robot=QUIET) as (robot, law),
        Command("record", "hoap3", "--connect", at, "--out", tmp_path / "log") as record,
    ):
        record.wait_for("recording")
        assert census(robot) == {"127.0.0.1"}
        for client in (law, record):
            assert_loopback_only(census(client))
            assert census(client) == set()  # clients open no port at all
        assert record.end(signal.SIGTERM) == 0
        for words in (("status",), ("stop",), ("recover",), ("list", "--live")):
            with Command(*words, "--connect", at) as tool:
                while not tool.ended_within(0.02):
                    assert_loopback_only(census(tool))
                assert tool.end() in {0, 1}, tool.stderr


@pytest.mark.long
def test_a_run_never_listens_elsewhere_at_any_moment(tmp_path):
    with Command("run", "--duration", "5", "--out", tmp_path / "log") as run:
        while not run.ended_within(0.02):
            assert_loopback_only(census(run))


WARM, COUNTED = 100, 100  # ticks
MOST_CALLS = 96


def test_one_state_of_qp12_takes_few_python_calls():
    sides = load_emulator_config("hoap3", seed=0)[0], load_controller_config("qp12")[0]
    lockstep = Lockstep(*sides, MemoryRecorder(), MemoryRecorder())
    calls = 0

    def count(frame: FrameType, event: str, argument: Any) -> None:
        nonlocal calls
        calls += event == "call"

    def watch() -> bool:
        tick = lockstep.robot.tick
        if tick in (WARM, WARM + COUNTED):
            sys.setprofile(count if tick == WARM else before)
        return False

    before = sys.getprofile()
    try:
        lockstep.run((WARM + COUNTED + 10) * 1e-3, should_stop=watch)
    finally:
        sys.setprofile(before)
    assert COUNTED < calls <= MOST_CALLS * COUNTED
