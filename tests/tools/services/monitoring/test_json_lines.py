"""JSON lines of a service: whole ones, in files of a size, whatever becomes of disk and folder."""

from __future__ import annotations

import errno
import json
import os
import resource
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hoap3.protocol.config.settings import LogSettings
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.notes import Detail, NotGranted, Routine, Unserved
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.services.monitoring.json_lines import KEPT, JsonLines, QueuedLines, facts_of
from hoap3.tools.services.monitoring.reporter import EVENTS, Reporter
from hoap3.tools.services.services import StatusReporter

FACTS = facts_of("robot", "arm")


def read(path: Path) -> list[dict[str, Any]]:
    """Every line of a file; each is an object."""
    return [json.loads(line) for line in path.read_text(encoding="ascii").splitlines()]


def lines_at(place: Path | str, told: list[str] | None = None, **more: Any) -> JsonLines:
    """A writer whose complaints are kept."""
    return JsonLines(str(place), FACTS, (told if told is not None else []).append, **more)


@contextmanager
def at_most(size: int) -> Iterator[None]:
    """Files of this process cannot grow beyond so many bytes, as on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    heard = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, heard)


def test_a_line_says_when_who_and_what(tmp_path: Path) -> None:
    file = tmp_path / "robot.jsonl"
    lines = lines_at(file)
    before = datetime.now(UTC)
    lines.write("warning", "SAFE_STOP", "braking", stamp=123, more={"session": "7", "tick": 9})
    lines.write("info", "said", "goes on")
    first, second = read(file)
    assert datetime.fromisoformat(first.pop("time")).timestamp() >= before.timestamp() - 1e-3
    assert first == {
        **FACTS,
        "monotonic_ns": 123,
        "severity": "warning",
        "event": "SAFE_STOP",
        "session": "7",
        "tick": 9,
        "text": "braking",
    }
    assert "tick" not in second
    assert second["monotonic_ns"] > 123


@given(text=st.text())
def test_any_text_is_one_line_and_comes_back(text: str, tmp_path_factory: Any) -> None:
    file = tmp_path_factory.mktemp("lines") / "robot.jsonl"
    lines = lines_at(file)
    lines.write("info", "said", text)
    lines.close()
    (line,) = read(file)
    assert line["text"] == text


def test_what_was_there_stays(tmp_path: Path) -> None:
    file = tmp_path / "robot.jsonl"
    for text in ("one run", "the next"):
        lines = lines_at(file)
        lines.write("info", "said", text)
        lines.close()
    assert [line["text"] for line in read(file)] == ["one run", "the next"]


def test_a_full_file_is_renamed_and_only_so_many_are_kept(tmp_path: Path) -> None:
    file, told = tmp_path / "robot.jsonl", list[str]()
    lines = lines_at(file, told, most_bytes=1000)
    for number in range(100):
        lines.write("info", "said", str(number))
    names = [file, *(tmp_path / f"robot.jsonl.{number + 1}" for number in range(KEPT))]
    assert set(tmp_path.iterdir()) == set(names)
    kept = [int(line["text"]) for name in reversed(names) for line in read(name)]
    assert kept == list(range(kept[0], 100))  # none is lost between two files
    assert all(name.stat().st_size < 1300 for name in names)
    assert not told


def test_several_services_in_one_file_lose_nothing(tmp_path: Path) -> None:
    file, told = tmp_path / "all.jsonl", list[str]()

    def write(who: int) -> None:
        lines = lines_at(file, told, most_bytes=20_000 if who < 2 else None)
        for number in range(100):
            lines.write("info", "said", f"{who} {number}")
        lines.close()

    writers = [threading.Thread(target=write, args=(who,)) for who in range(3)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    found = [line["text"] for path in tmp_path.iterdir() for line in read(path)]
    assert sorted(found) == sorted(f"{who} {number}" for who in range(3) for number in range(100))
    assert not told


def test_a_file_that_another_program_renames_is_begun_anew(tmp_path: Path) -> None:
    file = tmp_path / "robot.jsonl"
    lines = lines_at(file)
    lines.write("info", "said", "before")
    file.rename(tmp_path / "taken")
    lines.write("info", "said", "after")
    assert [line["text"] for line in read(file)] == ["after"]


def test_a_disk_that_is_full_leaves_whole_lines_and_is_said_once(tmp_path: Path) -> None:
    file, told = tmp_path / "robot.jsonl", list[str]()
    lines = lines_at(file, told)
    lines.write("info", "said", "before")
    with at_most(file.stat().st_size + 50):  # less than a line
        for _ in range(3):
            lines.write("info", "said", "lost")
        assert [line["text"] for line in read(file)] == ["before"]
    lines.write("info", "said", "after")
    before, lost, after = read(file)
    assert (before["text"], after["text"]) == ("before", "after")
    assert (lost["event"], lost["lines"]) == ("lines_lost", 3)
    assert len(told) == 1
    assert str(file) in told[0]


def test_a_folder_that_goes_and_comes_back(tmp_path: Path) -> None:
    folder, told = tmp_path / "lines", list[str]()
    folder.mkdir()
    lines = lines_at(folder / "robot.jsonl", told)
    lines.write("info", "said", "before")
    (folder / "robot.jsonl").unlink()
    folder.rmdir()
    lines.write("info", "said", "lost")
    folder.mkdir()
    lines.write("info", "said", "after")
    assert [line["event"] for line in read(folder / "robot.jsonl")] == ["lines_lost", "said"]
    assert len(told) == 1


def test_lines_of_several_threads_are_written_by_one(tmp_path: Path) -> None:
    file = tmp_path / "robot.jsonl"
    queued = QueuedLines(lines_at(file))
    said = [
        threading.Thread(target=lambda: queued.write("info", "said", "x" * 500)) for _ in range(20)
    ]
    for thread in said:
        thread.start()
    for thread in said:
        thread.join()
    queued.close()
    assert len(read(file)) == 20


@pytest.mark.parametrize("kind", ["no folder", "folder", "pipe"])
def test_a_place_that_cannot_be_written_is_refused_at_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    monkeypatch.chdir(tmp_path)
    place = Path("none/robot.jsonl" if kind == "no folder" else "place")
    if kind == "folder":
        place.mkdir()
    elif kind == "pipe":
        os.mkfifo(place)
    voice = StatusReporter(None)
    with pytest.raises(ConfigError) as refused:
        voice.write_lines(LogSettings(json_lines=str(place)), "robot", "arm")
    assert refused.value.key == "log.json_lines"
    assert str(place) in str(refused.value)


def test_standard_output_that_is_closed_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    with pytest.raises(OSError, match=os.strerror(errno.EBADF)):
        lines_at("stdout").open()


def test_what_a_service_says_has_its_severity(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "robot.jsonl"
    voice = StatusReporter(None, verbose=True)
    voice.write_lines(LogSettings(json_lines=str(file)), "controller", "arm")
    for text in (Detail("a"), Routine("b"), "c", NotGranted("d"), Unserved("e")):
        voice.say(text)
    voice.lost("f")
    voice.close()
    told = {line["text"]: (line["severity"], line["event"]) for line in read(file)}
    assert told == {
        "a": ("debug", "said"),
        "b": ("info", "said"),
        "c": ("warning", "said"),
        "d": ("warning", "not_granted"),
        "e": ("error", "metrics_lost"),
        "f": ("error", "log_lost"),
    }
    assert capsys.readouterr().err.split() == sorted(told)  # people read it, too


def test_events_carry_their_session_their_tick_and_their_stamp(tmp_path: Path) -> None:
    file = tmp_path / "robot.jsonl"
    reporter = Reporter(None, "robot", "arm", lines_at(file))
    reporter.session(Record(Kind.SESSION, 1, b'{"session_id": 9223372036854775807}'))
    forced = EVENTS["REASON_MISSES"]
    for name, tick, detail in (("GRANTED", 5, 1), ("REFUSED", 6, 1), ("SAFE_STOP", 7, forced)):
        event = Event()
        event.kind, event.tick, event.detail = EVENTS[name], tick, detail
        reporter.event(Record(Kind.EVENT, 100 + tick, event.dump()))
    told = [(line["event"], line["severity"], line["tick"]) for line in read(file)]
    assert told == [("GRANTED", "info", 5), ("REFUSED", "warning", 6), ("SAFE_STOP", "error", 7)]
    assert {line["session"] for line in read(file)} == {"9223372036854775807"}
    assert [line["monotonic_ns"] for line in read(file)] == [105, 106, 107]
