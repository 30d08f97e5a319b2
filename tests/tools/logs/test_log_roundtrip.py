"""What is written to a log is read back, in order and to the byte."""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.log_samples import MS, START, describe, fill, inputs, ticks, write

from hoap3.protocol.errors import LogError, UsageError
from hoap3.protocol.messages import Setpoint, State, schema
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.logs.export import export
from hoap3.tools.logs.log import Log, payload_hash
from hoap3.tools.logs.log_format import pack_input, unpack_input
from hoap3.tools.logs.log_writer import LogWriter


@pytest.mark.parametrize("side", ["robot", "controller"])
@pytest.mark.parametrize("compress", [True, False])
@pytest.mark.parametrize("n", [1, 21, 128])
def test_records_come_back_equal(tmp_path: Path, side: str, compress: bool, n: int) -> None:
    records = inputs(describe(n)) + ticks(n, 30)
    records.append(Record(Kind.SUMMARY, START + 999 * MS, b'{"asked": 12}'))
    records.append(Record(Kind.GAP, START + 999 * MS, b'{"dropped": 3}'))
    write(tmp_path, records, side=side, compress=compress)
    log = Log.open(tmp_path)
    assert log.paths == [tmp_path / f"{side}.mcap"]
    assert list(log.records()) == records
    assert (log.robot, log.side, log.truncated, log.missing) == ("sample", side, False, "")


def test_description_config_and_facts_come_back(tmp_path: Path) -> None:
    description = describe(3)
    write(tmp_path / "any.mcap", inputs(description))
    log = Log.open(tmp_path / "any.mcap")
    assert log.description == description
    assert log.config == "period_ms: 1\n"
    assert log.attachments["robot.urdf"].decode() == description.urdf
    assert log.metadata["versions"] == {"hoap3": "0"}


def test_clock_says_when_monotonic_time_was_what_wall_time(tmp_path: Path) -> None:
    before = time.monotonic_ns(), time.time_ns()
    write(tmp_path, inputs(describe(1)))
    after = time.monotonic_ns(), time.time_ns()
    clock = Log.open(tmp_path).metadata["clock"]
    assert before[0] <= int(clock["monotonic_ns"]) <= after[0]
    assert before[1] <= int(clock["realtime_ns"]) <= after[1]


def test_arrays_hold_what_messages_hold(tmp_path: Path) -> None:
    records = inputs(describe(3)) + ticks(3, 25, extra=5)
    write(tmp_path, records)
    log = Log.open(tmp_path)
    state, setpoint = State(3), Setpoint(3, 5)
    for message, rows, kind in (
        (state, log.states(), Kind.STATE),
        (setpoint, log.setpoints(), Kind.SETPOINT),
    ):
        of_kind = [record for record in records if record.kind == kind]
        assert log.stamps(kind).tolist() == [record.stamp for record in of_kind]
        assert len(rows) == len(of_kind)
        for row, record in zip(rows, of_kind, strict=True):
            message.load(record.payload)
            for name in (*message.schema.scalars, *message.schema.arrays):
                assert np.array_equal(row[name], getattr(message, name))


def test_a_log_without_messages_gives_empty_arrays(tmp_path: Path) -> None:
    write(tmp_path, inputs(describe(3)))
    log = Log.open(tmp_path)
    assert log.states().size == log.setpoints().size == log.stamps(Kind.EVENT).size == 0
    assert "q" in (log.states().dtype.names or ())


HEADERS = st.sampled_from([b"\x00\x01\x00\x00", b"\x00\x00\x00\x00", b""])


@pytest.mark.slow
@given(
    kind=st.sampled_from(list(Kind)),
    header=HEADERS,
    body=st.one_of(
        st.binary(max_size=300),
        st.recursive(st.none() | st.text(), st.lists).map(lambda x: json.dumps(x).encode()),
    ),
)
def test_any_payload_comes_back(
    tmp_path_factory: pytest.TempPathFactory, kind: Kind, header: bytes, body: bytes
) -> None:
    stranger = Record(kind, START + 5, header + body)
    records = [*inputs(describe(2)), *ticks(2, 2), stranger, *ticks(2, 2, first=2)]
    folder = tmp_path_factory.mktemp("log")
    write(folder, records)
    assert list(Log.open(folder).records()) == records


def test_setpoints_of_all_shapes_are_in_the_table(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    strange = [fill(Setpoint(*shape), rng, tick=1) for shape in ((3, 3), (4, 2), (9, 0))]
    assert len(strange[0]) == len(strange[1]) != len(strange[2])  # equally long, split otherwise
    ours = ticks(3, 10, extra=3)
    records = [Record(Kind.SETPOINT, START, strange[1]), *ours]
    records += [Record(Kind.SETPOINT, START + 99 * MS, payload) for payload in strange[1:]]
    write(tmp_path, records)
    log = Log.open(tmp_path)
    assert list(log.records()) == records
    stamps, rows = log.table(Kind.SETPOINT)
    assert rows.dtype == schema("Setpoint").dtype({"values": 9, "extra": 3})
    sent = [record for record in records if record.kind == Kind.SETPOINT]
    assert stamps.tolist() == [record.stamp for record in sent]
    for row, record in zip(rows, sent, strict=True):
        message = Setpoint.like(record.payload)
        message.load(record.payload)
        for name in message.schema.scalars:
            assert row[name] == getattr(message, name)
        for name in message.schema.arrays:
            given = getattr(message, name)
            assert row[name][: len(given)].tobytes() == given.tobytes()
            assert np.isnan(row[name][len(given) :]).all()
    assert log.unreadable[Kind.SETPOINT] == 0


def test_a_table_is_not_much_larger_than_its_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stranger's setpoint that is 100 times as long does not make every row as long."""
    rng = np.random.default_rng(1)
    monkeypatch.setattr("hoap3.tools.logs.disk_rows.SLACK_BYTES", 0)
    long = fill(Setpoint(128, 1024, gains=1024, next=1024), rng, tick=1)
    write(tmp_path, [*ticks(1, 300), Record(Kind.SETPOINT, START + 999 * MS, long)])
    log = Log.open(tmp_path)
    assert len(log.setpoints()) == 300
    assert log.unreadable[Kind.SETPOINT] == 1
    written = export(tmp_path, tmp_path / "a.csv")
    assert (written.left_out["unreadable setpoints"], written.complete) == (1, False)


def test_a_new_description_takes_the_place_of_the_old_one(tmp_path: Path) -> None:
    first, second = describe(2), describe(3)
    records = inputs(first) + ticks(2, 20)
    records += inputs(second, START + 500 * MS) + ticks(3, 20, first=501)
    write(tmp_path, records)
    log = Log.open(tmp_path)
    assert list(log.records()) == records
    assert log.description == second


@given(
    st.sampled_from(list(Kind)),
    st.integers(-(2**63), 2**63 - 1),
    st.binary(max_size=60),
    st.booleans(),
)
def test_inputs_come_back(kind: Kind, stamp: int, payload: bytes, repeated: bool) -> None:
    record = Record(kind, stamp, payload)
    assert unpack_input(pack_input(record, repeated=repeated)) == (record, repeated)


def test_json_is_readable_in_the_log() -> None:
    packed = pack_input(Record(Kind.AUTHORITY, 12, b'{"epoch":  3}'))
    text = packed[8:-1].decode()
    assert json.loads(text)["body"] == {"epoch": 3}
    assert json.loads(text)["kind"] == "authority"


def test_equal_records_have_equal_hashes_whatever_stands_around_them(tmp_path: Path) -> None:
    records = inputs(describe(2)) + ticks(2, 50)
    folders = [tmp_path / name for name in "abc"]
    for folder, given_records, compress in (
        (folders[0], records, True),
        (folders[1], records, False),
        (folders[2], records[:-1] + ticks(2, 1, first=50)[:1], True),
    ):
        folder.mkdir()
        write(folder, given_records, compress=compress, metadata={"machine": {"n": folder.name}})
    hashes = [payload_hash(Log.open(folder)) for folder in folders]
    assert hashes[0] == hashes[1] != hashes[2]


def test_no_file_is_ever_replaced(tmp_path: Path) -> None:
    write(tmp_path, inputs(describe(1)))
    before = (tmp_path / "robot.mcap").read_bytes()
    with pytest.raises(UsageError, match=r"robot\.mcap"):
        write(tmp_path, [])
    assert (tmp_path / "robot.mcap").read_bytes() == before


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="nowhere"):
        write(tmp_path / "nowhere", [])


def test_close_twice_and_read_while_open(tmp_path: Path) -> None:
    records = inputs(describe(1)) + ticks(1, 2000)
    writer = LogWriter(tmp_path, robot="sample", side="robot", attachments={}, metadata={})
    for record in records:
        writer.add(record)
    assert writer.paths == [tmp_path / "robot.mcap"]
    running = Log.open(tmp_path)
    found = list(running.records())
    assert running.truncated
    assert found == records[: len(found)] != []
    writer.close()
    writer.close()
    assert list(Log.open(tmp_path).records()) == records
    assert writer.paths == [tmp_path / "robot.mcap"]


def test_what_is_not_enclosed_is_named(tmp_path: Path) -> None:
    write(tmp_path, [], attachments={"notes.txt": b"x"})
    log = Log.open(tmp_path)
    with pytest.raises(LogError, match=r"config\.yaml.*notes\.txt"):
        _ = log.config
    with pytest.raises(LogError, match=r"description\.json"):
        _ = log.description
