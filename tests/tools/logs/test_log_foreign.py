"""What is no log of ours is refused, with its path and what to do."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.records import Channel, Metadata
from mcap.writer import Writer
from support.log_samples import describe, inputs, ticks, write

from hoap3.protocol.errors import LogError
from hoap3.tools.logs.export import export_csv, export_npz
from hoap3.tools.logs.log import Log
from hoap3.tools.logs.mcap_scan import McapScan
from hoap3.tools.logs.mcap_write import MAGIC, McapFile
from hoap3.tools.logs.repair import repair

Opener = Callable[[Path], object]


def refused(path: Path, named: str = "", side: str | None = None) -> None:
    with pytest.raises(LogError, match=rf"{re.escape(str(path))}.*{named}"):
        Log.open(path, side=side)


def foreign(path: Path, profile: str, topic: str) -> None:
    """A log that another program wrote with the library's own writer."""
    writer = Writer(str(path))
    writer.start(profile)
    schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
    channel = writer.register_channel(topic, "cdr", schema)
    writer.add_message(channel, 1, b"\0\1\0\0\2\0\0\0a\0", 1)
    writer.finish()


def altered(path: Path, source: Path, **facts: str) -> None:
    """A copy of a log, with other facts about it; `topic` renames the first channel."""
    scan = McapScan.of(source)
    file = McapFile(path, facts.pop("profile", "ros2"), "test")
    topic = facts.pop("topic", None)
    file.add(Metadata("log", {**scan.metadata["log"], **facts}))
    for schema in scan.schemas.values():
        file.add(schema)
    for channel in scan.channels.values():
        name = topic if topic and channel.id == 1 else channel.topic
        file.add(Channel(channel.id, name, "cdr", {}, channel.schema_id))
    for message in scan.messages():
        file.message(*message)
    file.finish()


@pytest.fixture
def ours(tmp_path: Path) -> Path:
    (tmp_path / "ours").mkdir()
    return write(tmp_path / "ours", inputs(describe(2)) + ticks(2, 20)).paths[0]


def test_nothing_there(tmp_path: Path) -> None:
    refused(tmp_path / "no.mcap")
    refused(tmp_path, r"robot\.mcap")
    refused(tmp_path, r"controller\.mcap", side="controller")
    (tmp_path / "a.mcap").touch()
    refused(tmp_path / "a.mcap")


@given(content=st.binary(min_size=1, max_size=200), magic=st.booleans())
def test_garbage(tmp_path_factory: pytest.TempPathFactory, content: bytes, magic: bool) -> None:
    path = tmp_path_factory.mktemp("garbage") / "a.mcap"
    path.write_bytes((MAGIC if magic else b"") + content)
    with pytest.raises(LogError, match=r"a\.mcap"):
        Log.open(path)
    with pytest.raises(LogError, match=r"a\.mcap"):
        repair(path)


@pytest.mark.slow
@given(opcode=st.integers(1, 15), body=st.binary(max_size=120), claim=st.integers(0, 2**64 - 1))
def test_garbage_behind_a_good_head(
    tmp_path_factory: pytest.TempPathFactory, opcode: int, body: bytes, claim: int
) -> None:
    """No record, whatever it claims to be, does more than end the log."""
    folder = tmp_path_factory.mktemp("garbage")
    records = inputs(describe(1)) + ticks(1, 5)
    path = write(folder, records).paths[0]
    good = McapScan.of(path)
    end = path.read_bytes().index(b"continues") - 24  # where its last metadata record begins
    for length in (claim, len(body)):
        tail = bytes([opcode]) + length.to_bytes(8, "little") + body
        path.write_bytes(path.read_bytes()[:end] + tail)
        found, problem = [], ""
        try:
            found = list(Log.open(path).records())
        except LogError as error:
            problem = str(error)
        assert found == records[: len(found)]
        assert not problem or str(path) in problem
    assert good.whole


@pytest.mark.parametrize(
    ("profile", "topic"),
    [("ros1", "/robots/a/state"), ("ros2", "/chatter"), ("", "/x"), ("ros2", "/robots/a/state")],
)
def test_an_mcap_of_somebody_else(tmp_path: Path, profile: str, topic: str) -> None:
    foreign(tmp_path / "a.mcap", profile, topic)
    refused(tmp_path / "a.mcap")
    with pytest.raises(LogError, match=r"a\.mcap"):
        repair(tmp_path / "a.mcap")


@pytest.mark.parametrize(
    ("facts", "named"),
    [
        ({"wire_version": "3"}, "3"),
        ({"wire_version": "1"}, "hoap3 0.2"),
        ({"format": "9"}, "9"),
        ({"robot": "other"}, ""),
        ({"side": "neither"}, ""),
        ({"part": "-1"}, ""),
        ({"part": "²"}, ""),
    ],
)
def test_an_mcap_of_another_version(
    tmp_path: Path, ours: Path, facts: dict[str, str], named: str
) -> None:
    altered(tmp_path / "a.mcap", ours, **facts)
    refused(tmp_path / "a.mcap", named)


def test_an_unaltered_copy_is_accepted(tmp_path: Path, ours: Path) -> None:
    altered(tmp_path / "a.mcap", ours)
    assert list(Log.open(tmp_path / "a.mcap").records()) == list(Log.open(ours).records())


def test_another_profile_is_accepted_and_another_topic_is_counted(
    tmp_path: Path, ours: Path
) -> None:
    altered(tmp_path / "a.mcap", ours, profile="ros1")
    assert list(Log.open(tmp_path / "a.mcap").records()) == list(Log.open(ours).records())
    altered(tmp_path / "b.mcap", ours, topic="/robots/sample/else")
    log = Log.open(tmp_path / "b.mcap")
    assert (len(log.states()), log.others, len(log.setpoints())) == (0, 20, 20)


def test_the_wrong_side(tmp_path: Path, ours: Path) -> None:
    refused(ours, "robot.*controller", side="controller")
    refused(ours, "'left'", side="left")
    folder = ours.parent
    write(folder, inputs(describe(2)), side="controller")
    refused(folder, "controller.*robot")
    assert Log.open(folder, side="controller").side == "controller"
    assert Log.open(folder, side="robot").side == "robot"


def test_a_description_that_does_not_hold_together(tmp_path: Path) -> None:
    records = inputs(describe(2)) + ticks(2, 20)
    wrong = records[0].payload.replace(b"joint_x1", b"joint_y1", 1)
    records[0] = type(records[0])(records[0].kind, records[0].stamp, wrong)
    path = write(tmp_path, records).paths[0]
    log = Log.open(path)
    assert list(log.records()) == records
    with pytest.raises(LogError, match=r"robot\.mcap: "):
        _ = log.description


def test_names_in_a_log_are_never_followed(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    folder.mkdir(parents=True)
    names = ["../../evil.yaml", "/evil.yaml", "os.system", "config.yaml"]
    path = write(folder, ticks(1, 20), attachments=dict.fromkeys(names, b"x")).paths[0]
    path.write_bytes(path.read_bytes()[:-1])
    log = Log.open(path)
    assert set(log.attachments) == set(names)
    repair(path)
    export_csv(log, folder / "a.csv")
    export_npz(log, folder / "a.npz")
    found = {str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*") if p.is_file()}
    expected = ("robot.mcap", "robot.repaired.mcap", "a.csv", "a.json", "a.npz")
    assert found == {f"a/b/{name}" for name in expected}
