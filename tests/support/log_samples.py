"""A robot and records of it for the tests of the log."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.records import ChunkIndex

from hoap3.protocol.messages import Event, Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.logs.log_writer import LogWriter

MS = 1_000_000
START = 5_000_000_000  # ns


def describe(n: int) -> RobotDescription:
    """A chain of n revolute joints with names of different lengths."""
    names = [f"joint_{'x' * (place % 5)}{place}" for place in range(n)]
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    links = "".join(
        f'<link name="link_{place}"><inertial><mass value="1"/>{inertia}</inertial></link>'
        for place in range(n + 1)
    )
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="link_{place}"/>'
        f'<child link="link_{place + 1}"/><axis xyz="0 0 1"/>'
        '<limit lower="-2" upper="2" velocity="5" effort="9"/></joint>'
        for place, name in enumerate(names)
    )
    limits = {
        "lower_hard": -2.0,
        "upper_hard": 2.0,
        "lower": -1.9,
        "upper": 1.9,
        "velocity": 5.0,
        "setpoint_acceleration_max": 1200.0,
        "brake_acceleration": 40.0,
        "effort": 9.0,
    }
    content = {
        "name": "sample",
        "urdf": f'<robot name="sample">{links}{joints}</robot>',
        "joints": [{"name": name, **limits} for name in names],
        "initial_posture": "zero",
        "postures": {"zero": [0.0] * n},
        "base_frame": "link_0",
    }
    return RobotDescription.from_json(json.dumps(content).encode())


def inputs(description: RobotDescription, stamp: int = START) -> list[Record]:
    """What a service records before its first tick; the session has blanks in its JSON."""
    session = {"side": "robot", "session_id": 7, "lockstep": False}
    return [
        Record(Kind.DESCRIPTION, stamp, description.to_json()),
        Record(Kind.SESSION, stamp + 1, json.dumps(session).encode()),
        Record(Kind.AUTHORITY, stamp + 2, b'{"epoch": 3}'),
    ]


def fill(message: Any, rng: np.random.Generator, **given: int | float) -> bytes:
    """Bytes of a message with a random value in each field that is not given."""
    for name, kind in message.schema.scalars.items():
        if name != "wire_version":
            value = float(rng.normal()) if kind == "float64" else int(rng.integers(0, 1 << 31))
            setattr(message, name, given.get(name, value))
    for name in message.schema.arrays:
        getattr(message, name)[:] = rng.normal(size=getattr(message, name).size)
    return bytes(message.dump())


def ticks(
    n: int, count: int, *, step: int = MS, first: int = 0, extra: int = 2, seed: int = 0
) -> list[Record]:
    """For each tick a State and its Setpoint, now and then an Event; `step` [ns] apart."""
    rng = np.random.default_rng(seed)
    state, setpoint, event = State(n), Setpoint(n, extra), Event()
    records: list[Record] = []
    for tick in range(first, first + count):
        now = START + 1000 + tick * step
        given = {"session_id": 7, "tick": tick}
        sent = fill(state, rng, **given, stamp_published=now)
        records.append(Record(Kind.STATE, now, sent))
        answer = fill(setpoint, rng, **given, stamp_encoded=now + 200)
        records.append(Record(Kind.SETPOINT, now + 300, answer))
        if tick % 7 == 0:
            told = fill(event, rng, **given, stamp=now + 400)
            records.append(Record(Kind.EVENT, now + 400, told))
    return records


def write(path: Path, records: list[Record], **options: Any) -> LogWriter:
    """A finished log of these records."""
    settings: dict[str, Any] = {
        "robot": "sample",
        "side": "robot",
        "attachments": {"config.yaml": b"period_ms: 1\n"},
        "metadata": {"versions": {"hoap3": "0"}},
    }
    with LogWriter(path, **(settings | options)) as writer:
        for record in records:
            writer.add(record)
    return writer


def chunks_of(path: Path) -> list[ChunkIndex]:
    """Where the chunks of a whole file stand."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    return summary.chunk_indexes


@dataclass(repr=False)
class Sample:
    """A whole log, and where its chunks stand."""

    content: bytes
    records: list[Record]
    chunks: list[ChunkIndex]

    @classmethod
    def of(cls, folder: Path, count: int) -> Sample:
        """A log of so many ticks of two joints."""
        records = inputs(describe(2)) + ticks(2, count)
        path = write(folder, records).paths[0]
        return cls(path.read_bytes(), records, chunks_of(path))

    def without(self, *lost: ChunkIndex) -> list[Record]:
        """What the other chunks hold."""
        spans = [(chunk.message_start_time, chunk.message_end_time) for chunk in lost]
        return [r for r in self.records if not any(a <= r.stamp <= b for a, b in spans)]

    def readable(self, size: int) -> list[Record]:
        """What the first bytes of the file hold."""
        whole = [c for c in self.chunks if c.chunk_start_offset + c.chunk_length <= size]
        newest = max((chunk.message_end_time for chunk in whole), default=0)
        return [record for record in self.records if record.stamp <= newest]
