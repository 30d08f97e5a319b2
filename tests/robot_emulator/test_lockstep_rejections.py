"""Setpoints that answer nothing, in lockstep: the robot counts each by its reason."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from typing import Any

import pytest
from support.small_arm import arm

from hoap3.protocol.link import remote_lockstep
from hoap3.protocol.link.base import Arrival, Request
from hoap3.protocol.link.remote_lockstep import RemoteLockstepLink
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.protocol.runtime.recorder import MemoryRecorder
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.loop import RobotLoop

SESSION, ROUNDS = 7, 50
OTHERS: dict[str, list[dict[str, Any]]] = {
    "future": [{"tick": 1_000_000}, {"tick": 1_000_001}],
    "session": [{"session_id": 8}],
    "epoch": [{"epoch": 9}],
    "command": [{"command": 2}],
    "not_finite": [{"values": float("nan")}],
}
"""Sent with each answer, by the reason for which it is to be refused."""


class Network:
    """The robot's network: a controller answers each State, after what others send.

    Args:
        others: how often each of `OTHERS` is sent.
        times: how often an answer is sent.
    """

    name_conflicts = 0

    def __init__(self, others: int = 1, times: int = 1) -> None:
        self.arrival, self._arrived = threading.Event(), list[Arrival]()
        self._others, self._times, self._last = others, times, b""
        self._requests = [Request("acquire", "test", lambda _: None)]

    def publish(self, payload: bytes) -> None:
        state = State.allocate(**arm().state_lengths)
        state.load(payload)
        if state.mode != State.ACTIVE:
            return
        answer = setpoint(state)
        sent = [b"garbage", *(setpoint(state, **one) for each in OTHERS.values() for one in each)]
        again = [self._last] if self._last else []  # as where the last State was repeated
        for each in [*sent * self._others, *again, *[answer] * self._times]:
            self._arrived.append((0, each))
        self._last = answer
        self.arrival.set()

    def drain(self) -> Sequence[Arrival]:
        arrived, self._arrived = self._arrived, []
        return arrived

    def requests(self) -> Iterable[Request]:
        waiting, self._requests = self._requests, []
        return waiting

    def announce(self, event: bytes) -> None:
        """No listener."""

    def tokens(self) -> Sequence[tuple[str, bool]]:
        return ()

    def look_again(self, who: str) -> None:
        """Clients stay."""

    def counts(self) -> dict[str, int]:
        return {"crowded_out": 0}


def setpoint(state: State, **changes: Any) -> bytes:
    made = Setpoint(arm().n)
    made.session_id, made.tick, made.epoch = SESSION, state.tick, state.epoch
    made.values[:] = changes.pop("values", state.reference)
    for name, value in changes.items():
        setattr(made, name, value)
    return made.dump()


def ran(network: Network) -> tuple[RobotLoop, MemoryRecorder]:
    """A robot after `ROUNDS` ticks that asked."""
    clock, recorder = VirtualClock(), MemoryRecorder()
    link = RemoteLockstepLink(network, clock, 200_000, lambda: False)  # type: ignore[arg-type]
    robot = RobotLoop(
        arm(), EmulatorConfig(robot="arm"), clock, link, recorder, SESSION, grace_ticks=0
    )
    robot.run(0, lambda: False, ROUNDS)
    return robot, recorder


def test_each_setpoint_for_another_tick_or_robot_is_counted_by_its_reason():
    robot, recorder = ran(Network())
    expected = {reason: ROUNDS * len(changes) for reason, changes in OTHERS.items()}
    expected["size"] = ROUNDS
    summary = robot.summary()
    assert summary["rejections"] == expected
    assert (summary["in_time"], summary["run_rate"]) == (ROUNDS, 1.0)
    last = State.allocate(**arm().state_lengths)
    last.load(recorder.payloads(Kind.STATE)[-1])
    assert last.rejected == sum(expected.values())
    assert (last.duplicate, last.out_of_order, last.late, last.lost) == (0, 0, 0, 0)
    assert summary["link_counts"] == {"crowded_out": 0}


def test_what_is_too_much_for_one_tick_is_dropped_and_counted(monkeypatch):
    monkeypatch.setattr(remote_lockstep, "MAX_IN_FLIGHT", 10)
    summary = ran(Network(others=30))[0].summary()
    counts = summary["rejections"]
    dropped = summary["link_counts"]["overflowed"]
    assert dropped > ROUNDS
    assert dropped + counts["future"] + counts["size"] == 3 * 30 * ROUNDS
    assert counts["session"] == 30 * ROUNDS  # of the right tick, so none is dropped
    assert summary["in_time"] == ROUNDS


@pytest.mark.parametrize("times", [1, 3])
def test_an_answer_that_is_sent_again_is_no_duplicate(times):
    robot, _ = ran(Network(others=0, times=times))
    assert (robot.validator.duplicate, robot.validator.rejected) == (0, 0)
    assert robot.summary()["in_time"] == ROUNDS
