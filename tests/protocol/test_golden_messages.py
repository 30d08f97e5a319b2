"""Our messages against golden bytes, a writer of another hand, and two independent readers."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from cdr_by_hand import EXAMPLES, FIELDS, golden, write
from hypothesis import given
from hypothesis import strategies as st
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from hoap3.protocol.messages import Event, Message, Setpoint, State, Target

CLASSES: dict[str, type[Message]] = {
    "State": State,
    "Setpoint": Setpoint,
    "Event": Event,
    "Target": Target,
}
DOUBLES = st.floats(width=64)
SCALARS = {
    "I": st.integers(0, 2**32 - 1),
    "Q": st.integers(0, 2**64 - 1),
    "q": st.integers(-(2**63), 2**63 - 1),
    "d": DOUBLES,
}


def arrays(length: int) -> st.SearchStrategy:
    """Lists of doubles, quick to draw also where they are long."""
    words = st.binary(min_size=8 * length, max_size=8 * length)
    return words.map(lambda data: list(struct.unpack(f"<{length}d", data)))


@st.composite
def contents(draw, kind: str) -> dict:
    """Any value of every field of a message."""
    joints = draw(st.integers(0, 128))
    own = {"wrench": draw(st.sampled_from([0, 6])), "extra": draw(st.integers(0, 10))}
    if kind != "Target":
        trailing = ("followed", "base", "contact", "imu", "decision", "slacks", "gains", "next")
        own |= {name: draw(st.sampled_from([0, 1, 2, 7])) for name in trailing}
    values = {}
    for name, code in FIELDS[kind]:
        if code.endswith("[]"):
            values[name] = draw(arrays(own.get(name, joints)))
        else:
            values[name] = draw(SCALARS[code])
    return {**values, "wire_version": CLASSES[kind].schema.version}


def empty(kind: str, values: dict) -> Message:
    """A message of ours, of the lengths that `values` have."""
    lengths = {name: len(values[name]) for name, code in FIELDS[kind] if code.endswith("[]")}
    return CLASSES[kind].allocate(**lengths)


def filled(kind: str, values: dict) -> Message:
    """A message of ours with these values."""
    message = empty(kind, values)
    for name, code in FIELDS[kind]:
        if code.endswith("[]"):
            getattr(message, name)[:] = values[name]
        else:
            setattr(message, name, values[name])
    return message


def same(found: object, expected: object) -> bool:
    """Equal, where NaN equals NaN; integers and floats are told apart."""
    if isinstance(expected, list | tuple):
        return np.array_equal(np.asarray(found), np.asarray(expected, np.float64), equal_nan=True)
    if isinstance(expected, float) and math.isnan(expected):
        return isinstance(found, float) and math.isnan(found)
    return type(found) is type(expected) and found == expected


@pytest.fixture(scope="module")
def readers() -> dict[str, list]:
    """For each kind of message, functions of two other projects that read it by our `.msg` text."""
    store = get_typestore(Stores.EMPTY)
    found: dict[str, list] = {}
    for kind, cls in CLASSES.items():
        text, ros_name = cls.schema.text, cls.schema.ros_name
        store.register(get_types_from_msg(text, ros_name))
        schema = Schema(id=1, name=ros_name, encoding="ros2msg", data=text.encode())
        decoder = DecoderFactory().decoder_for("cdr", schema)
        found[kind] = [decoder, lambda data, name=ros_name: store.deserialize_cdr(data, name)]
    return found


@pytest.mark.parametrize("name", EXAMPLES)
def test_golden_bytes_are_what_a_writer_of_another_hand_writes(name):
    assert golden(name) == write(*EXAMPLES[name])


@pytest.mark.parametrize("name", EXAMPLES)
def test_our_messages_write_and_read_the_golden_bytes(name):
    kind, values = EXAMPLES[name]
    message = filled(kind, values)
    assert message.dump() == golden(name)
    assert message.size == len(golden(name))
    loaded = empty(kind, values)
    loaded.load(golden(name))
    assert all(same(getattr(loaded, field), value) for field, value in values.items())


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_structured_dtype_reads_the_golden_bytes(name):
    kind, values = EXAMPLES[name]
    schema = CLASSES[kind].schema
    dtype = schema.dtype(schema.lengths_in(golden(name)))
    (row,) = np.frombuffer(golden(name), dtype)
    assert set(row.dtype.names) == set(values)
    for field, value in values.items():
        assert np.array_equal(row[field], np.asarray(value, row[field].dtype))


@pytest.mark.parametrize("kind", CLASSES)
@given(data=st.data())
def test_whatever_the_values_all_readers_and_writers_agree(kind, readers, data):
    values = data.draw(contents(kind))
    payload = filled(kind, values).dump()
    assert payload == write(kind, values)
    loaded = empty(kind, values)
    loaded.load(payload)
    others = [read(payload) for read in readers[kind]]
    for message in (loaded, *others):
        for field, value in values.items():
            assert same(getattr(message, field), value), (type(message), field)
    assert loaded.dump() == payload
