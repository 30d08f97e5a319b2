"""A log in several files: each stands by itself, together they are one, and the cap holds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from support.log_samples import MS, START, chunks_of, describe, inputs, ticks, write

from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.logs.log import Log, payload_hash
from hoap3.tools.logs.log_writer import LogWriter

JOINTS = 4
FILE = 200_000
WIDE = {"file_bytes": FILE, "cap_bytes": 100 * FILE, "compress": False}
CAPPED = {"file_bytes": FILE, "cap_bytes": 3 * FILE, "compress": False}


@pytest.fixture(scope="module")
def records() -> list[Record]:
    again = Record(Kind.AUTHORITY, START + 900 * MS, b'{"epoch": 4}')
    return inputs(describe(JOINTS)) + ticks(JOINTS, 900) + [again] + ticks(JOINTS, 600, first=901)


def rotated(folder: Path, records: list[Record], options: dict[str, Any]) -> list[Path]:
    paths = write(folder, records, **options).paths
    assert paths == sorted(folder.iterdir(), key=lambda path: (len(path.name), path.name))
    return paths


def test_files_together_are_the_log(tmp_path: Path, records: list[Record]) -> None:
    paths = rotated(tmp_path, records, WIDE)
    assert [path.name for path in paths[:3]] == ["robot.mcap", "robot.0001.mcap", "robot.0002.mcap"]
    assert len(paths) > 4
    assert all(path.stat().st_size <= FILE for path in paths)
    log = Log.open(tmp_path)
    assert list(log.records()) == records
    assert (log.paths, log.truncated, log.missing) == (paths, False, "")
    assert len(log.states()) == len(log.setpoints()) == 1500
    assert log.description == describe(JOINTS)


def test_its_size_is_what_lies_there_whenever_one_asks(
    tmp_path: Path, records: list[Record], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also between the end of one file and the begin of the next: metrics ask from a thread."""
    seen = []
    make_room = LogWriter._make_room

    def asked(writer: LogWriter) -> None:
        seen.append((writer.size, sum(path.stat().st_size for path in tmp_path.iterdir())))
        make_room(writer)

    monkeypatch.setattr(LogWriter, "_make_room", asked)
    writer = write(tmp_path, records, **WIDE)
    seen.append((writer.size, sum(path.stat().st_size for path in writer.paths)))
    assert len(seen) > 4
    assert all(told == there for told, there in seen)


def test_one_file_or_many_hold_the_same(tmp_path: Path, records: list[Record]) -> None:
    for name, options in (("many", WIDE), ("one", {})):
        (tmp_path / name).mkdir()
        write(tmp_path / name, records, **options)
    assert payload_hash(Log.open(tmp_path / "many")) == payload_hash(Log.open(tmp_path / "one"))


def test_each_file_stands_by_itself(tmp_path: Path, records: list[Record]) -> None:
    for place, path in enumerate(rotated(tmp_path, records, WIDE)):
        log = Log.open(path)
        found = list(log.records())
        newest = {record.kind: record for record in records[: records.index(found[-1])]}
        kinds = [Kind.DESCRIPTION, Kind.SESSION, Kind.AUTHORITY]
        assert [record.kind for record in found[:3]] == kinds
        assert found[:2] == [newest[kind] for kind in kinds[:2]]
        assert found[3:] == [r for r in records if r in found[3:]]
        assert log.config == "period_ms: 1\n"
        assert log.description == describe(JOINTS)
        assert log.missing == ("" if place == 0 else f"everything before {path.name}") or (
            "file that follows" in log.missing
        )
        with path.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            assert reader.get_summary() is not None
            assert {a.name for a in reader.iter_attachments()} == {
                "config.yaml",
                "description.json",
                "robot.urdf",
            }
            assert {"versions", "clock", "log"} <= {m.name for m in reader.iter_metadata()}


def test_the_newest_authority_is_repeated(tmp_path: Path, records: list[Record]) -> None:
    last = rotated(tmp_path, records, WIDE)[-1]
    authority = [record for record in Log.open(last).records() if record.kind == Kind.AUTHORITY]
    assert [record.payload for record in authority] == [b'{"epoch": 4}']


def test_no_chunk_of_a_further_file_spans_a_second(tmp_path: Path, records: list[Record]) -> None:
    for path in rotated(tmp_path, records, WIDE):
        for index in chunks_of(path):
            assert index.message_end_time - index.message_start_time <= 1000 * MS


def test_rosbags_joins_the_files(tmp_path: Path, records: list[Record]) -> None:
    paths = rotated(tmp_path, records, WIDE)
    with AnyReader(paths) as reader:
        chosen = [c for c in reader.connections if c.topic.endswith("/state")]
        ticks_found = [
            reader.deserialize(raw, connection.msgtype).tick
            for connection, _, raw in reader.messages(chosen)
        ]
    assert ticks_found == [*range(900), *range(901, 1501)]


def test_the_cap_deletes_the_oldest_and_says_so(tmp_path: Path, records: list[Record]) -> None:
    paths = rotated(tmp_path, records, CAPPED)
    assert sum(path.stat().st_size for path in paths) <= 3 * FILE
    log = Log.open(tmp_path)
    assert log.metadata["log"]["deleted"].split(", ")[:2] == ["robot.mcap", "robot.0001.mcap"]
    assert log.missing.startswith(f"everything before {paths[0].name}: the cap of {3 * FILE} bytes")
    assert not log.truncated
    found = list(log.records())
    kept = len(found) - 3
    assert found[:2] == records[:2]  # repeated at the head of the oldest file that is left
    assert found[3:] == records[-kept:]
    assert 0 < kept < len(records)


def test_other_files_of_the_folder_are_left_alone(tmp_path: Path, records: list[Record]) -> None:
    for name in ("robot.0000.mcap.txt", "controller.mcap", "notes"):
        (tmp_path / name).write_text("mine")
    write(tmp_path, records, **CAPPED)
    assert (tmp_path / "controller.mcap").read_text() == "mine"
    assert Log.open(tmp_path, side="robot").side == "robot"


def test_the_log_ends_where_a_file_is_missing(tmp_path: Path, records: list[Record]) -> None:
    paths = rotated(tmp_path, records, WIDE)
    paths[2].unlink()
    log = Log.open(tmp_path)
    found = list(log.records())
    assert log.truncated
    assert log.paths == paths[:2]
    assert "robot.0001.mcap" in log.missing
    assert found == records[: len(found)]


def test_the_log_ends_where_a_file_is_damaged(tmp_path: Path, records: list[Record]) -> None:
    paths = rotated(tmp_path, records, WIDE)
    content = paths[1].read_bytes()
    paths[1].write_bytes(content[: len(content) // 2])
    log = Log.open(tmp_path)
    found = list(log.records())
    assert log.truncated
    assert log.paths == paths[:2]
    assert found == records[: len(found)]


@pytest.mark.parametrize("left", [0, 5, 40])
def test_a_last_file_that_was_hardly_begun_is_no_obstacle(
    tmp_path: Path, records: list[Record], left: int
) -> None:
    paths = rotated(tmp_path, records, WIDE)
    paths[-1].write_bytes(paths[-1].read_bytes()[:left])
    log = Log.open(tmp_path)
    found = list(log.records())
    assert log.truncated
    assert paths[-1].name in log.missing
    assert found == records[: len(found)] != []


def test_a_tiny_cap_still_makes_a_log(tmp_path: Path, records: list[Record]) -> None:
    records = records[:300]
    paths = write(tmp_path, records, file_bytes=1000, cap_bytes=2000).paths
    log = Log.open(tmp_path)
    assert log.paths == paths
    assert list(log.records())[-1] == records[-1]
