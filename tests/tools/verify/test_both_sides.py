"""Messages of one tick in the logs of both sides, of any number and order."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.verify.both_sides import check_both
from hoap3.tools.verify.claims import Claims

ROW = np.dtype([("session_id", np.uint64), ("tick", np.uint64)])
SAME = SimpleNamespace(digest="the same robot")


def log(*messages: tuple[int, int, bytes]) -> Any:
    """A log with these States, by session and tick."""
    rows = np.array([message[:2] for message in messages], ROW)
    contents = [content for *_, content in messages]

    def table(kind: Kind) -> tuple[None, np.ndarray]:
        return None, rows if kind == Kind.STATE else rows[:0]

    return SimpleNamespace(
        table=table,
        messages=lambda _, places: (contents[place] for place in places),
        unreadable={Kind.STATE: 0, Kind.SETPOINT: 0},
        description=SAME,
    )


def false_ticks(robot: Any, controller: Any) -> tuple[int, list[int]]:
    """How many ticks were compared, and those that differ."""
    claims = Claims()
    check_both(robot, controller, claims)
    return claims.counts["State in both logs"].checked, [each.tick for each in claims.by_tick()]


def test_a_message_equals_any_of_its_tick():
    robot = log((7, 1, b"a"), (7, 2, b"b"), (7, 2, b"c"), (7, 3, b"d"))

    assert false_ticks(robot, log((7, 2, b"c"), (7, 1, b"a"), (7, 2, b"b"))) == (2, [])
    assert false_ticks(robot, log((7, 2, b"c"), (7, 2, b"x"), (7, 3, b"d"))) == (2, [2])


def test_messages_of_other_sessions_and_ticks_are_not_compared():
    robot = log((7, 1, b"a"), (8, 1, b"b"), (8, 2, b"c"))

    assert false_ticks(robot, log((7, 1, b"a"), (7, 2, b"c"), (9, 1, b"b"))) == (1, [])
    assert false_ticks(robot, log((7, 1, b"b"), (8, 1, b"b"), (8, 2**63, b"z"))) == (2, [1])
