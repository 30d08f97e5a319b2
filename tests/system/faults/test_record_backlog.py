"""A recorder that is slower than what it hears stops when told, and says what it dropped."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from support.command_bench import endpoint
from support.fake_robot import FakeRobot

from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.robot_emulator.robots import load
from hoap3.tools.logs.log import Log
from hoap3.tools.logs.log_writer import LogWriter
from hoap3.tools.services import record


def test_a_flood_neither_fills_memory_nor_keeps_it_from_stopping(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two more records are heard while each one is written."""
    backlogs: list[record.Backlog] = []
    added: list[Record] = []
    lengths: list[int] = []

    class Heard(record.Backlog):
        def __init__(self) -> None:
            super().__init__()
            backlogs.append(self)

    class SlowWriter(LogWriter):
        def add(self, record: Record) -> None:
            added.append(record)
            assert len(added) < 100_000
            super().add(record)
            for _ in range(2):
                backlogs[0].put(Record(Kind.EVENT, record.stamp + 1, b"x"))
            lengths.append(len(backlogs[0]))

    monkeypatch.setattr(record, "BACKLOG", 64)
    monkeypatch.setattr(record, "Backlog", Heard)
    monkeypatch.setattr(record, "LogWriter", SlowWriter)
    said: list[str] = []
    description, at = load("hoap3").to_json(), endpoint()
    robot = FakeRobot(at, lambda verb, _: description if verb == "description" else None)
    try:
        outcome = record.record_robot("hoap3", at, tmp_path / "out", 0.2, said.append)
    finally:
        robot.close()
    assert max(lengths) <= 64 + 1  # and a record of the gap
    logged = [r for r in Log.open(tmp_path / "out").records() if r.kind == Kind.GAP]
    assert logged == [r for r in added if r.kind == Kind.GAP]
    dropped = sum(json.loads(gap.payload)["dropped"] for gap in logged)
    assert 0 < dropped <= outcome["dropped"]
    assert outcome["dropped"] + outcome["events"] + len(backlogs[0]) >= 2 * len(added)
    assert f"{outcome['dropped']} records" in said[-1]
