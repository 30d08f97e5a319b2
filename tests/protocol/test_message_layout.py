"""The schemas, the memory behind a message, and what `load` refuses."""

from __future__ import annotations

import struct
import typing
from contextlib import suppress

import numpy as np
import pytest
from cdr_by_hand import EXAMPLES, FIELDS, golden
from hypothesis import given
from hypothesis import strategies as st

from hoap3.protocol import messages
from hoap3.protocol.errors import WireError
from hoap3.protocol.messages import Event, Message, Setpoint, State, Target

MAKERS = {
    "State": lambda n: State(n, 6, reference_rate=n, followed=1, base=13),
    "Setpoint": lambda n: Setpoint(n, 3, decision=n, gains=2),
    "Event": lambda n: Event(),
    "Target": lambda n: Target(n, 3, rates=3),
}
PYTHON_TYPES = {"I": int, "Q": int, "q": int, "d": float, "d[]": messages.FloatArray}
KINDS = pytest.mark.parametrize("kind", MAKERS)


def numbered(kind: str, n: int = 3) -> Message:
    """A message whose scalars behind the version are 2, 3 …, and whose arrays go on counting."""
    message = MAKERS[kind](n)
    count = 0
    for name, scalar in message.schema.scalars.items():
        count += 1
        setattr(message, name, float(count) if scalar == "float64" else count)
    message.wire_version = message.schema.version
    for name in message.schema.arrays:
        array = getattr(message, name)
        array[:] = np.arange(count, count + len(array))
        count += len(array)
    return message


@KINDS
def test_the_annotations_of_the_class_are_the_fields_of_the_schema(kind):
    cls = type(MAKERS[kind](1))
    hints = typing.get_type_hints(cls)
    expected = {name: PYTHON_TYPES[code] for name, code in FIELDS[kind]}
    own = {name: hints[name] for name in cls.__annotations__ if name != "certificate"}  # a view
    assert {"wire_version": hints["wire_version"], **own} == expected


def test_the_certificate_is_a_view_of_its_six_scalars():
    setpoint = Setpoint(3, extra=2)
    setpoint.certificate[:] = range(1, 7)
    names = ("v", "v_rate_required", "v_rate_predicted", "rho", "margin", "kkt_residual")
    assert Setpoint.scalars(setpoint.dump(), *names) == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    assert [getattr(setpoint, name) for name in names] == setpoint.certificate.tolist()
    other = setpoint.copy()
    other.certificate[:] = 0.0
    assert (other.rho, setpoint.rho) == (0.0, 4.0)


@KINDS
def test_a_copy_says_the_same_whatever_becomes_of_the_other(kind):
    message = numbered(kind)
    before = message.dump()
    copied = message.copy()
    assert copied.dump() == before
    for name in message.schema.scalars:
        setattr(message, name, 0)
    for name in message.schema.arrays:
        getattr(message, name)[:] = 0.0
    assert copied.dump() == before
    assert message.dump() != before
    copied.load(before)


@KINDS
def test_a_new_message_has_nothing_of_one_before(kind):
    lengths = MAKERS[kind](5).lengths
    empty = type(MAKERS[kind](5)).allocate(**lengths).dump()
    before = numbered(kind, 5)
    assert before.lengths == lengths
    assert type(before).allocate(**lengths).dump() == empty != before.dump()


def test_the_constants_of_the_classes_are_those_of_the_schemas():
    for cls, names in (
        (State, ("IDLE", "ACTIVE", "STOPPING", "STOPPED")),
        (Setpoint, ("POSITION", "ACCELERATION", "TORQUE")),
    ):
        assert {name: getattr(cls, name) for name in names}.items() <= cls.schema.constants.items()
    for cls in (State, Setpoint, Target):
        assert cls.schema.constants["WIRE_VERSION"] == messages.WIRE_VERSION
    assert Event.schema.version == 1


def test_no_two_events_and_no_two_reasons_have_the_same_number():
    constants = Event.schema.constants
    reasons = [value for name, value in constants.items() if name.startswith("REASON_")]
    kinds = [value for name, value in constants.items() if not name.startswith("REASON_")]
    assert len(set(reasons)) == len(reasons)
    assert len(set(kinds)) == len(kinds)


def test_stamp_fields_are_the_stamps_of_a_setpoint_but_the_echoed_one():
    stamps = {name for name in Setpoint.schema.scalars if name.startswith("stamp_")}
    assert stamps - {"stamp_state"} == messages.STAMP_FIELDS


@KINDS
@pytest.mark.parametrize("n", [0, 1, 2, 21, 128])
def test_arrays_are_aligned_writable_views_of_the_message(kind, n):
    message = MAKERS[kind](n)
    for name in message.schema.arrays:
        array = getattr(message, name)
        before = message.dump()
        array += 1.5
        after = message.dump()
        assert array.dtype == np.float64
        assert array.flags.aligned
        assert array.flags.c_contiguous
        assert array.flags.writeable
        assert array.ctypes.data % 8 == 0
        assert (before != after) == bool(len(array))


@KINDS
def test_load_keeps_the_arrays_that_somebody_holds(kind):
    message, other = MAKERS[kind](3), numbered(kind)
    held = {name: getattr(message, name) for name in message.schema.arrays}
    message.load(other.dump())
    for name, array in held.items():
        assert getattr(message, name) is array
        np.testing.assert_array_equal(array, getattr(other, name))


@KINDS
def test_a_dump_is_a_copy(kind):
    message = numbered(kind)
    payload = message.dump()
    kept = bytes(payload)
    for name in message.schema.arrays:
        getattr(message, name)[:] = -1.0
    message.dump()
    assert payload == kept


def _spoilt(payload: bytes, at: int, value: int) -> bytes:
    return payload[:at] + struct.pack("<I", value) + payload[at + 4 :]


REFUSED = [
    ("State", lambda data: data[:-1], "size"),
    ("State", lambda data: data + b"\0", "size"),
    ("State", lambda data: b"", "size"),
    ("State", lambda data: b"\0\0\0\0" + data[4:], "layout"),  # big endian
    ("State", lambda data: b"\0\x03\0\0" + data[4:], "layout"),  # parameter list
    ("State", lambda data: _spoilt(data, 132, 2), "layout"),  # q
    ("State", lambda data: _spoilt(data, 164 + 32 * 3, 5), "layout"),  # wrench
    ("State", lambda data: _spoilt(data, 4, 1), "wire_version"),
    ("Setpoint", lambda data: data[:100], "size"),
    ("Setpoint", lambda data: _spoilt(data, 156, 4), "layout"),
    ("Setpoint", lambda data: _spoilt(data, 164 + 8 * 3, 2), "layout"),
    ("Setpoint", lambda data: _spoilt(data, 4, 0), "wire_version"),
    ("Event", lambda data: data[:43], "size"),
    ("Event", lambda data: b"\0\x01\0\x01" + data[4:], "layout"),
    ("Event", lambda data: _spoilt(data, 4, 2**32 - 1), "wire_version"),
]


@pytest.mark.parametrize(("kind", "spoil", "reason"), REFUSED)
def test_load_refuses_and_leaves_the_message_unchanged(kind, spoil, reason):
    message = numbered(kind)
    before = {name: np.copy(getattr(message, name)) for name, _ in FIELDS[kind]}
    payload = spoil(MAKERS[kind](3).dump())
    with pytest.raises(WireError, match=kind) as caught:
        message.load(payload)
    assert caught.value.kind == reason
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(message, name), value)


def test_an_array_that_a_message_does_not_have_is_refused():
    with pytest.raises(TypeError, match=r"Setpoint.*imu"):
        Setpoint(3, imu=10)


@pytest.mark.parametrize(
    ("payload", "message"),
    [
        (Setpoint(3).dump() + b"\0", ""),
        (Setpoint(3).dump()[:158], "'values'"),
        (Setpoint(3).dump()[:190], "'extra'"),
        (Setpoint(3).dump()[:-1], "'next'"),
        (_spoilt(Setpoint(3).dump(), 156, 1025), "1025"),
        (b"", ""),
    ],
)
def test_lengths_that_disagree_with_the_size_are_refused(payload, message):
    with pytest.raises(WireError, match=message or None) as caught:
        Setpoint.schema.lengths_in(payload)
    assert caught.value.kind == "size"


def test_the_greatest_message_may_have_1024_elements_in_an_array():
    payload = Setpoint(3, 1024).dump()
    assert Setpoint.schema.lengths_in(payload)["extra"] == 1024


@KINDS
def test_some_scalars_are_read_without_loading(kind):
    message = numbered(kind)
    names = list(message.schema.scalars)
    values = type(message).scalars(message.dump(), *reversed(names))
    assert values == tuple(getattr(message, name) for name in reversed(names))


def test_scalars_of_a_payload_that_is_too_short_are_refused():
    with pytest.raises(WireError) as caught:
        State.scalars(State(3).dump()[:131], "tick")
    assert caught.value.kind == "size"
    assert State.scalars(State(3).dump()[:132], "wire_version") == (2,)


def _mutations() -> st.SearchStrategy[bytes]:
    """Random bytes, and real messages with some bytes changed, cut or added."""

    def changed(arguments: tuple) -> bytes:
        payload, places, cut, tail = arguments
        data = bytearray(payload)
        for place, value in places:
            data[place % len(data)] = value
        return bytes(data[: len(data) - cut]) + tail

    real = st.sampled_from([golden(name) for name in EXAMPLES])
    places = st.lists(st.tuples(st.integers(0, 400), st.integers(0, 255)), max_size=4)
    mutated = st.tuples(real, places, st.sampled_from([0, 0, 0, 1, 8]), st.binary(max_size=8))
    return st.one_of(st.binary(max_size=500), mutated.map(changed))


@given(payload=_mutations())
def test_no_bytes_raise_anything_but_a_wire_error(payload):
    for maker in MAKERS.values():
        message = maker(2)
        with suppress(WireError):
            message.load(payload)
        with suppress(WireError):
            message.schema.lengths_in(payload)
        with suppress(WireError):
            message.scalars(payload, "wire_version")


@KINDS
def test_a_message_tells_how_long_its_arrays_are(kind: str) -> None:
    message = numbered(kind)
    assert message.lengths == message.schema.lengths_in(message.dump())


def test_a_state_is_shown_with_its_mode_and_its_numbers():
    state = State(2)
    state.tick, state.mode = 7, State.STOPPED
    state.q[:] = 0.123456, -1.0
    shown = repr(state)
    for part in ("tick=7", "mode=STOPPED", "q=[0.1235, -1.0]", "dq=[0.0, 0.0]"):
        assert part in shown
    assert "wrench" not in shown
    state.mode = 9
    assert "mode=9" in repr(state)
