"""Frames of HOAP-3's protocol, and how many of them a client announces."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hoap3.protocol.errors import DescriptionError, WireError
from hoap3.protocol.link.hoap3_tcp.frames import Frames, exchanges
from hoap3.robot_emulator.robots import load

HOAP3 = load("hoap3")
SCALES = HOAP3.counts_per_rad
INT16 = st.integers(-32768, 32767)


@pytest.mark.parametrize("slots", [21, 22])
@given(counts=st.lists(INT16, min_size=21, max_size=21))
def test_counts_survive_both_ways(slots: int, counts: list[int]) -> None:
    frames = Frames(HOAP3, slots)
    sent = frames.pack(np.array(counts) / SCALES)

    assert struct.unpack(f"<{slots}d", sent)[:21] == tuple(map(float, counts))
    assert len(sent) == 8 * slots
    assert np.array_equal(frames.unpack(sent), np.array(counts) / SCALES)


@given(st.lists(st.floats(-2.5, 2.5), min_size=21, max_size=21))
def test_positions_are_rounded_and_slots_are_truncated(positions: list[float]) -> None:
    frames = Frames(HOAP3, 21)
    exact = np.array(positions) * SCALES
    inside = np.abs(exact) < 32767

    rounded = np.array(struct.unpack("<21d", frames.pack(np.array(positions))))
    cut = frames.unpack(struct.pack("<21d", *exact)) * SCALES

    assert (np.abs(rounded - exact)[inside] <= 0.5).all()
    assert np.abs(rounded).max() <= 32768
    assert (np.abs(cut) <= np.abs(exact) + 1e-9).all()
    assert np.allclose(cut, np.rint(cut), atol=1e-9)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("slot", [0, 20])
def test_a_slot_that_is_no_number_spoils_its_frame(wrong: float, slot: int) -> None:
    counts = [0.0] * 21
    counts[slot] = wrong
    assert Frames(HOAP3, 21).unpack(struct.pack("<21d", *counts)) is None


def test_what_a_robot_does_not_use_of_a_frame_may_be_anything() -> None:
    frame = struct.pack("<22d", *[0.0] * 21, math.nan)
    assert np.array_equal(Frames(HOAP3, 22).unpack(frame), np.zeros(21))


@pytest.mark.parametrize("robot", ["ur5", "humanoid32"])
def test_a_robot_without_encoder_scales_is_refused(robot: str) -> None:
    with pytest.raises(DescriptionError, match="encoder_counts_per_rad"):
        Frames(load(robot), 22)


@pytest.mark.parametrize(
    ("cycle", "check", "number"),
    [(2, 4, 2000), (1, 86_400, 86_400_000), (2.0, 1.0, 500), (3, 3, 1000)],
)
def test_a_client_says_how_many_exchanges_follow(cycle: float, check: float, number: int) -> None:
    assert exchanges(struct.pack("<2d", cycle, check)) == number


@pytest.mark.parametrize(
    ("cycle", "check"),
    [
        (math.nan, 4),
        (2, math.inf),
        (0, 4),
        (0.5, 4),
        (-1, 4),
        (2, -1),
        (2, 0),
        (2, 1.5),
        (2.5, 4),
        (2**40, 4),
        (5000, 4),
    ],
)
def test_times_on_which_both_ends_do_not_agree_are_refused(cycle: float, check: float) -> None:
    with pytest.raises(WireError, match="CYCLE_TIME"):
        exchanges(struct.pack("<2d", cycle, check))


def test_more_joints_than_slots_are_refused() -> None:
    with pytest.raises(DescriptionError, match="21 joints"):
        Frames(HOAP3, 20)
