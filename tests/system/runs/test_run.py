"""`hoap3 run` in real time: what it counts, writes and prints, and that its log can be repeated."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from contextlib import redirect_stderr
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from socket_census import census
from support.command_bench import (
    Command,
    assert_at_rest,
    assert_no_traceback,
    events,
    hoap3,
    inside,
)

from hoap3.protocol.messages import State
from hoap3.protocol.runtime.deadline_verdict import judge_deadlines
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.log import Log, payload_hash
from hoap3.tools.show.summary import LiveTable

TICKS = 1000


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("run") / "log"


@pytest.fixture(scope="module")
def run(folder: Path) -> Iterator[Command]:
    words = ("--duration", TICKS / 1000, "--json", "--out", folder)
    with Command("run", *words) as command:
        command.hear("following robot")
        command.listens = census(command)
        assert command.end() in {0, 1}
        yield command


def test_it_listens_on_loopback_only(run: Command) -> None:
    assert run.listens == {"127.0.0.1"}


def test_json_has_every_promised_key(run: Command, folder: Path) -> None:
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
    for histogram in (summary["rtt_us"], summary["wakeup_us"], *summary["stages_us"].values()):
        assert histogram.keys() >= figures
    assert summary["machine"]["versions"]["python"] == sys.version.split()[0]
    assert summary["log"] == str(folder)


def test_verdicts_and_exit_code_follow_from_the_counts(run: Command) -> None:
    summary = run.json()
    rate = summary["success_rate"]["run"]
    in_time = summary["ticks"] - summary["misses"]["late"] - summary["misses"]["lost"]
    assert rate == pytest.approx(in_time / summary["ticks"])
    expected = judge_deadlines(summary)["verdict"]
    verdicts = summary["verdicts"]
    assert verdicts["deadlines"] == expected
    assert verdicts["limits_and_balance"] == ("fail" if summary["interventions"] else "pass")
    assert run.end() == (1 if expected == "fail" or "fail" in verdicts.values() else 0)


def test_asked_and_skipped_ticks_make_up_the_duration(run: Command, folder: Path) -> None:
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


def test_counts_are_those_of_the_log(run: Command, folder: Path) -> None:
    summary, log = run.json(), Log.open(folder, side="robot")
    last = log.states()[-1]
    for name in ("late", "lost", "rejected", "duplicate", "out_of_order"):
        assert summary["misses"][name] == last[name]
    if not summary["safe_stops"]:  # after one, answers that nothing asked for are still recorded
        assert summary["rtt_us"]["n"] == len(log.setpoints())
    assert summary["complete"]


@pytest.mark.parametrize("side", ["robot", "controller"])
def test_both_logs_open_in_the_stock_reader(run: Command, folder: Path, side: str) -> None:
    with (folder / f"{side}.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count > TICKS / 2
    assert {channel.topic for channel in summary.channels.values()} >= {
        "/robots/hoap3/state",
        "/robots/hoap3/setpoint",
    }


def test_the_robot_starts_follows_and_ends_at_rest(run: Command, folder: Path) -> None:
    log = Log.open(folder, side="robot")
    names = [name for name, _ in events(log) if name not in {"SKIPPED", "CLIPPED"}]
    assert names[:2] == ["STARTED", "GRANTED"]
    assert names[-1] == "ENDED"
    assert_at_rest(log)


def test_neither_pins_nor_takes_priority(run: Command) -> None:
    assert "ordinary, as configured" in run.stderr
    assert "not pinned, as configured" in run.stderr
    assert "SCHED_FIFO" not in run.stderr


def test_a_real_time_run_is_repeated_bit_by_bit(run: Command, folder: Path) -> None:
    again = hoap3("replay", folder, "--json")
    answered = len(Log.open(folder, side="controller").table(Kind.SETPOINT)[1])
    assert again.end() == 0, again.stderr
    assert again.json()["setpoints"] == again.json()["same"] == answered > 0


@pytest.mark.slow
def test_people_get_a_summary_whatever_lies_in_their_folder(tmp_path: Path) -> None:
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
    for word in (
        "deadlines",
        "task",
        "limits and balance",
        "success rate",
        "misses",
        "RTT",
        "wake-up",
        "solve",
        "final error",
    ):
        assert word in run.stdout, run.stderr
    assert "somebody else" not in run.stderr
    assert_no_traceback(run)
    assert set(tmp_path.rglob("*")) == before  # nothing is written where nothing shall be


@pytest.mark.slow
def test_a_start_is_told_in_five_lines_and_the_end_says_what_is_next(tmp_path: Path) -> None:
    folder = tmp_path / "a log"
    words = ("run", "--duration", "0.2", "--out", folder)
    with Command(*words, verbose=False) as run:
        assert run.end() in {0, 1}
    head, _, tail = run.stderr.partition("next:")
    lines = [line for line in head.splitlines() if not line.startswith("compiling kernels")]
    assert 1 <= len(lines) <= 5
    for word in ("hoap3 with qp12", "0.2 s", "tcp/127.0.0.1:", str(folder)):
        assert word in lines[0]
    assert f"hoap3 report '{folder}'" in tail
    assert_no_traceback(run)


def test_the_normal_course_is_no_news_and_a_failure_is() -> None:
    quiet, all_of_it = LiveTable("title"), LiveTable("title", verbose=True)
    routine = [
        {"news": "event", "text": "robot: tick 0: started", "routine": True},
        {"news": "routine", "text": "following robot"},
        {"news": "detail", "text": "timer slack: 1 ns"},
    ]
    alarms = [
        {"news": "event", "text": "robot: tick 9: safe stop (misses)", "routine": False},
        {"news": "said", "text": "the log has gaps"},
        {"news": "damaged", "text": "the log is not whole"},
        {"news": "not granted", "text": "not granted by the system: memory lock"},
    ]
    for table, expected in ((quiet, alarms), (all_of_it, [*routine, *alarms])):
        heard = io.StringIO()
        with redirect_stderr(heard):
            for item in (*routine, *alarms, alarms[-1]):  # the other side is refused the same
                table.news(item)
        assert heard.getvalue().splitlines() == [item["text"] for item in expected]


def test_paths_and_hashes_are_printed_in_one_piece(tmp_path: Path) -> None:
    folder = tmp_path / ("a_folder_with_a_long_name_" * 3)
    done = inside("run", "--lockstep", "--duration", "0.01", "--out", folder)
    for side in ("robot", "controller"):
        assert payload_hash(Log.open(folder, side=side)) in done.stdout
    assert str(folder) in done.stdout
