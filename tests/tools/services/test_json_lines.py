"""JSON lines of a service: whole ones on standard output, whatever becomes of it."""

from __future__ import annotations

import json
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
from support.log_samples import describe

from hoap3.protocol.config.settings import LogSettings
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.notes import Detail, NotGranted, Routine, Unserved
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.services import reporter as json_lines
from hoap3.tools.services.reporter import EVENTS, JsonLines, QueuedLines, Reporter, facts_of
from hoap3.tools.services.services import StatusReporter

FACTS = facts_of("robot", "arm")


def read(path: Path) -> list[dict[str, Any]]:
    """Every line of a file; each is an object."""
    return [json.loads(line) for line in path.read_text(encoding="ascii").splitlines()]


@contextmanager
def output_to(path: Path) -> Iterator[None]:
    """Lines for standard output go to a file."""
    with path.open("ab") as stream, pytest.MonkeyPatch.context() as patch:
        patch.setattr(json_lines, "STDOUT", stream.fileno())
        yield


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


@pytest.fixture
def file(tmp_path: Path) -> Iterator[Path]:
    """The file that standard output goes to."""
    with output_to(tmp_path / "robot.jsonl"):
        yield tmp_path / "robot.jsonl"


def test_a_line_says_when_who_and_what(file: Path) -> None:
    lines = JsonLines(FACTS, print)
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
    path = tmp_path_factory.mktemp("lines") / "robot.jsonl"
    with output_to(path):
        JsonLines(FACTS, print).write("info", "said", text)
    (line,) = read(path)
    assert line["text"] == text


def test_a_disk_that_is_full_is_said_once_and_lost_lines_are_counted(file: Path) -> None:
    told = list[str]()
    lines = JsonLines(FACTS, told.append)
    lines.write("info", "said", "before")
    with at_most(file.stat().st_size):
        for _ in range(3):
            lines.write("info", "said", "lost")
        assert [line["text"] for line in read(file)] == ["before"]
    lines.write("info", "said", "after")
    before, lost, after = read(file)
    assert (before["text"], after["text"]) == ("before", "after")
    assert (lost["event"], lost["lines"]) == ("lines_lost", 3)
    assert len(told) == 1


def test_lines_of_several_threads_are_written_by_one(file: Path) -> None:
    queued = QueuedLines(JsonLines(FACTS, print))
    said = [
        threading.Thread(target=lambda: queued.write("info", "said", "x" * 500)) for _ in range(20)
    ]
    for thread in said:
        thread.start()
    for thread in said:
        thread.join()
    queued.close()
    assert len(read(file)) == 20


def test_standard_output_that_is_closed_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    with pytest.raises(ConfigError, match=r"log\.json_lines"):
        StatusReporter(None).write_lines(LogSettings(json_lines="stdout"), "robot", "arm")


def test_what_a_service_says_has_its_severity(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    voice = StatusReporter(None, verbose=True)
    voice.write_lines(LogSettings(json_lines="stdout"), "controller", "arm")
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
    assert not capsys.readouterr().err  # it would stand in the journal twice


def test_events_carry_their_session_their_tick_and_their_stamp(file: Path) -> None:
    reporter = Reporter(None, "robot", "arm", JsonLines(FACTS, print))
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


def test_a_condition_is_told_with_its_first_begin_and_end(file: Path) -> None:
    reporter = Reporter(None, "controller", "arm", JsonLines(FACTS, print))
    reporter.description(Record(Kind.DESCRIPTION, 0, describe(2).to_json()))
    session = {"session_id": 7, "conditions": ["slowed", "held"]}
    reporter.session(Record(Kind.SESSION, 1, json.dumps(session).encode()))
    events = [("BEGAN", 5, 0), ("BEGAN", 6, 1), ("ENDED", 255, 0), ("BEGAN", 300, 0)]
    for name, tick, detail in (*events, ("ENDED", 301, 0)):
        event = Event()
        event.kind, event.tick, event.detail = EVENTS[f"CONDITION_{name}"], tick, detail
        reporter.event(Record(Kind.EVENT, tick, event.dump()))
    assert [(line["tick"], line["text"]) for line in read(file)] == [
        (5, "condition began (slowed)"),
        (6, "condition began (held)"),
        (255, "condition ended (slowed, after 0.250 s)"),
    ]
